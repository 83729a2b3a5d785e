"""Limits of memory and output, in every command and in encoding."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec.cli.main import run
from pdecodec.codec.encoding_memory import encoding_bytes, memory_plan
from pdecodec.codec.settings import EncodeSettings
from pdecodec.codec.source import usual_limits

ROOT = Path(__file__).resolve().parents[2]
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def animation(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("limits") / "clip.pdeanim"
    points = np.random.default_rng(0).normal(size=(12, 30, 3)).cumsum(axis=0)
    pdecodec.encode(pdecodec.ArraySequence(points), path, tolerance=1e-2)
    return path


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("limits") / "paper.pdeanim"
    points = np.random.default_rng(0).normal(size=(12, 30, 3)).cumsum(axis=0)
    pdecodec.encode(pdecodec.ArraySequence(points), path, profile="paper")
    return path


COMMANDS = {
    "info": ["IN"],
    "compare": ["IN", "IN"],
    "convert": ["IN", "out.npz"],
    "decode": ["IN", "out.npz"],
    "encode": ["IN", "out.pdeanim"],
    "coefficients": ["PAPER", "-o", "out.npz"],
    "cut": ["IN", "--frames", "0:4", "--recode", "-o", "out.pdeanim"],
    "join": ["IN", "IN", "--shift", "-o", "out.pdeanim"],
    "report": ["IN", "-o", "report", "--no-baselines"],
}


@pytest.mark.parametrize(
    ("option", "value", "words"),
    [("--max-output", "1k", "the output limit is 1024"), ("--max-memory", "9k", "the limit is 9216")],
)
@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_that_opens_a_file_takes_limits_and_names_the_option_that_raises_them(
    name: str,
    option: str,
    value: str,
    words: str,
    animation: Path,
    paper: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: Capture,
) -> None:
    monkeypatch.chdir(tmp_path)
    places = {"IN": str(animation), "PAPER": str(paper)}
    code = 4
    if (name, option) == ("decode", "--max-output"):
        code, words = (
            3,
            "--max-output allows 1.0 kB; choose --frames or --object",
        )  # the size of the selected frames, not of the whole file
    assert run([name, *(places.get(one, one) for one in COMMANDS[name]), option, value]) == code
    line = capsys.readouterr().err
    assert words in line
    assert code == 3 or line.endswith(f"; raise {option} if you trust the file\n")
    assert not [item for item in tmp_path.iterdir() if item.is_file()]


def test_a_file_that_is_read_in_a_process_of_its_own_keeps_the_limits(animation: Path, capsys: Capture) -> None:
    assert run(["info", "--isolate", str(animation), "--max-memory", "9k"]) == pdecodec.LimitError.exit_code
    line = capsys.readouterr().err
    assert "the limit is 9216" in line
    assert line.endswith("; raise --max-memory if you trust the file\n")


def test_groups_that_only_fit_in_memory_one_by_one_are_decoded() -> None:
    points = np.random.default_rng(0).normal(size=(64, 4000, 3))
    settings = EncodeSettings(max_error=1.5, group_frames=8, effort="fast")
    data = pdecodec.encode(pdecodec.ArraySequence(points), settings=settings).data or b""
    with pdecodec.open(data) as animation:
        expected = animation.sample(animation.times)
    # Residuals of one group take 1 MB; those of all eight groups exceed the limit.
    with pdecodec.open(data, limits=pdecodec.DecodeLimits(max_memory=6_500_000)) as animation:
        np.testing.assert_array_equal(animation.sample(animation.times), expected)


def test_limits_of_a_context_hold_for_whatever_opens_a_file_within_it(animation: Path) -> None:
    with usual_limits(pdecodec.DecodeLimits(max_memory=9000)):
        for opening in (pdecodec.open, pdecodec.open_sequence):
            with pytest.raises(pdecodec.LimitError, match="the limit is 9000"):
                opening(animation)
        with pdecodec.open(animation, limits=pdecodec.DecodeLimits()) as own:
            assert own.frame_count == 12
    with pdecodec.open(animation) as after:
        assert after.frame_count == 12


@pytest.mark.parametrize(("vertices", "frames"), [(1000, 512), (20_000, 400), (150_000, 70)])
def test_a_plan_keeps_within_its_memory_and_is_the_usual_one_where_that_fits(vertices: int, frames: int) -> None:
    usual, most = memory_plan(vertices, frames, EncodeSettings()), encoding_bytes(frames, vertices, EncodeSettings())
    assert memory_plan(vertices, frames, EncodeSettings(max_memory=most)) == usual
    for limit in (most // 2, 2 * most // 3, most - 1):
        plan = memory_plan(vertices, frames, EncodeSettings(max_memory=limit))
        assert plan.group_frames <= usual.group_frames
        assert plan.smooth_group_frames <= usual.smooth_group_frames
        assert 16 <= plan.functions <= usual.functions
        assert plan != usual
        shorter = EncodeSettings(group_frames=plan.group_frames)
        saved = 8 * vertices * (usual.functions - plan.functions)
        assert encoding_bytes(frames, vertices, shorter) - saved <= limit


def test_an_encode_that_exceeds_a_limit_reports_how_much_it_takes(tmp_path: Path, capsys: Capture) -> None:
    source = tmp_path / "clip.npz"
    np.savez(source, points=np.zeros((3, 1000, 3), np.float32))
    assert run(["encode", str(source), str(tmp_path / "out.pdeanim"), "--max-memory", "1M"]) == 2
    line = capsys.readouterr().err
    assert "--max-memory must be 76" in line
    assert "for 1000 vertices, not 1048576" in line
    with pytest.raises(pdecodec.SettingsError, match="max_memory is a setting of the profile auto"):
        pdecodec.EncodeSettings(max_memory=2**30, profile="paper")


MEASURED = """
import sys
import numpy as np
import pdecodec

random = np.random.default_rng(0)
points = np.zeros((180, 6000, 3), np.float32)
points[:] = random.uniform(size=(6000, 3))
points += random.normal(0, 0.01, points.shape).astype(np.float32)
limit = int(sys.argv[1]) or None
report = pdecodec.encode(pdecodec.ArraySequence(points), tolerance=1e-2, effort="fast", max_memory=limit)
assert report.max_error <= report.bound
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(int(status["VmHWM"].split()[0]) * 1024, report.groups)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is counted in kilobytes on Linux alone")
def test_an_encode_stays_within_the_memory_that_it_is_given() -> None:
    def measured(limit: int) -> tuple[int, int]:
        command = [sys.executable, "-c", MEASURED, str(limit)]
        done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=ROOT)
        peak, groups = done.stdout.split()
        return int(peak), int(groups)

    limit = 144 * 2**20
    free, groups = measured(0)
    peak, more_groups = measured(limit)
    assert peak < limit < free < encoding_bytes(180, 6000, EncodeSettings(effort="fast"))
    assert groups < more_groups


FEW_VERTICES = """
import numpy as np
import pdecodec

points = np.random.default_rng(0).normal(size=(512, 128, 3))
pdecodec.encode(pdecodec.ArraySequence(points), tolerance=1e-5, effort="fast")
status = dict(line.split(":", 1) for line in open("/proc/self/status"))
print(int(status["VmHWM"].split()[0]) * 1024)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="peak memory is counted in kilobytes on Linux alone")
def test_few_vertices_over_many_frames_take_no_more_memory_than_is_estimated() -> None:
    done = subprocess.run([sys.executable, "-c", FEW_VERTICES], capture_output=True, text=True, check=True, cwd=ROOT)
    estimate = encoding_bytes(512, 128, EncodeSettings(effort="fast"))
    assert 0.5 * estimate < int(done.stdout) <= estimate
