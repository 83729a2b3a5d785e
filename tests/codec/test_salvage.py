"""Damaged files: every undamaged group of frames is saved, and the missing frames are named."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec.cli.main import run
from pdecodec.codec.container import stored_sections
from spec.sealing import take_apart
from spec.vector_files import accepted_vectors
from tests.codec.test_cutting import clip, paper, waves
from tests.codec.test_runs import fluid
from tests.support.damage import place_in_run

__all__ = ["clip", "paper"]
Capture = pytest.CaptureFixture[str]


@pytest.fixture(params=["clip", "paper"])
def file(request: pytest.FixtureRequest) -> Path:
    found: Path = request.getfixturevalue(request.param)
    return found


@pytest.fixture(scope="module")
def changing(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a file of three runs, of 40, 30 and 1 frames."""
    path = tmp_path_factory.mktemp("salvage") / "fluid.pdeanim"
    pdecodec.encode(fluid([(40, 0), (30, 1), (1, 2)]), path)
    return path


def place_of(path: Path, kind: str) -> tuple[int, int]:
    with path.open("rb") as opened:
        stored = dict(stored_sections(opened))[kind]
    return stored.offset, stored.length


def damaged(path: Path, folder: Path, *places: int, end: int | None = None) -> Path:
    """Copy a file with bytes changed at some places, cut off at `end`."""
    data = bytearray(path.read_bytes())
    for place in places:
        data[place] ^= 0x5A
    (folder / "damaged.pdeanim").write_bytes(data[:end])
    return folder / "damaged.pdeanim"


def chunk_of_group(path: Path, group: int) -> int:
    """Return the offset of a byte in the coefficients of a group."""
    with pdecodec.codec.coded_file.CodedFile(path) as coded:
        before = sum(entry.sizes[1] for entry in coded.entries[:group])
    return place_of(path, "COEF")[0] + before


def test_all_frames_but_those_of_damaged_groups_come_back_to_the_last_bit(file: Path, tmp_path: Path) -> None:
    with (
        pdecodec.open(file) as whole,
        pdecodec.salvage(damaged(file, tmp_path, chunk_of_group(file, 1), chunk_of_group(file, 2))) as saved,
    ):
        groups = whole.group_frames
        lost = np.arange(groups[1][0], groups[2][1])
        kept = np.setdiff1d(np.arange(whole.frame_count), lost)
        assert (saved.missing, saved.lost, saved.is_whole) == (((groups[1][0], groups[2][1]),), (), False)
        assert saved.frame_count == whole.frame_count
        assert (saved.sequence.times == whole.times[kept]).all()
        assert saved.sequence.fps == whole.fps
        assert saved.sequence.metadata == whole.metadata
        found = saved.sequence.read_frames(0, kept.size)
        assert (found == whole.read_frames(0, whole.frame_count)[kept]).all()
        assert [item.name for item in saved.sequence.objects] == [item.name for item in whole.objects]


def test_a_file_that_ends_early_gives_the_groups_before(clip: Path, tmp_path: Path) -> None:
    offset, length = place_of(clip, "CORR")
    size = clip.stat().st_size
    kinds = [part.kind for part in take_apart(clip.read_bytes())]
    assert kinds[-2:] == ["CORR", "ATTR"]
    with pdecodec.salvage(damaged(clip, tmp_path, end=offset + length // 2)) as saved:
        assert saved.lost[0].startswith("attributes")
        assert not saved.sequence.objects[0].attributes
        ((first, end),) = saved.missing
        assert 0 < first < end == saved.frame_count
        with pdecodec.open(clip) as whole:
            assert (saved.sequence.read_frames(0, first) == whole.read_frames(0, first)).all()
    # All groups precede the attributes in the file.
    with pdecodec.salvage(damaged(clip, tmp_path, end=size - 1)) as saved:
        assert (saved.missing, len(saved.lost)) == ((), 1)


def test_a_file_that_ends_among_coefficients_gives_groups_that_have_no_residuals(clip: Path, tmp_path: Path) -> None:
    unbounded = tmp_path / "unbounded.pdeanim"
    with pdecodec.open(clip) as whole:
        pdecodec.encode(whole, unbounded, profile="paper")
    cut = damaged(unbounded, tmp_path, end=chunk_of_group(unbounded, 2))
    with pdecodec.open(unbounded) as whole, pdecodec.salvage(cut) as saved:
        assert len(whole.group_frames) > 2
        (first, end) = whole.group_frames[2][0], whole.frame_count
        assert saved.missing == ((first, end),)
        assert (saved.sequence.read_frames(0, first) == whole.read_frames(0, first)).all()
    with (
        pytest.raises(pdecodec.CorruptFileError, match="nothing can be saved: group 0 is damaged"),
        pdecodec.salvage(damaged(clip, tmp_path, end=place_of(clip, "CORR")[0] - 1)),
    ):
        pass


def test_a_file_of_runs_that_ends_early_gives_the_runs_before(changing: Path, tmp_path: Path) -> None:
    with pdecodec.salvage(damaged(changing, tmp_path, end=changing.stat().st_size * 3 // 4)) as saved:
        ((first, end),) = saved.missing
        assert (first in (40, 70), end) == (True, 71)
        assert saved.sequence.frame_count == first


def test_a_damaged_header_or_table_or_more_bytes_at_the_end_lose_nothing(clip: Path, tmp_path: Path) -> None:
    for place in (14, 20, 24):
        with pdecodec.salvage(damaged(clip, tmp_path, place)) as saved:
            assert saved.is_whole
            assert saved.sequence.frame_count == saved.frame_count
    longer = tmp_path / "longer.pdeanim"
    longer.write_bytes(clip.read_bytes() + b"more")
    with pdecodec.salvage(longer) as saved, pdecodec.open(clip) as whole:
        assert saved.is_whole
        assert (saved.sequence.read_frames(5, 9) == whole.read_frames(5, 9)).all()


def test_the_scene_is_saved_and_sections_of_a_later_version_are_named(tmp_path: Path) -> None:
    for name in ("minor_version_1", "runs_of_minor_version_1"):
        path = tmp_path / f"{name}.pdeanim"
        path.write_bytes(accepted_vectors()[name])
        with pdecodec.salvage(damaged(path, tmp_path, 24)) as saved, pdecodec.open(path) as whole:
            assert saved.is_whole
            assert saved.sequence.notices == whole.notices != ()
            assert saved.sequence.carried == (None if "runs" in name else whole.carried)


def test_damaged_remarks_lose_the_metadata_alone(clip: Path, tmp_path: Path) -> None:
    with pdecodec.salvage(damaged(clip, tmp_path, place_of(clip, "META")[0] + 9)) as saved:
        assert (saved.missing, dict(saved.sequence.metadata)) == ((), {})
        assert saved.lost == ("metadata (section META is damaged; get the file again)",)


@pytest.mark.parametrize("kind", ["SEQN", "CONN", "REST", "MODL", "GRUP"])
def test_a_file_without_mesh_times_or_reference_cannot_be_saved_and_fails_with_one_line(
    kind: str, clip: Path, tmp_path: Path, capsys: Capture
) -> None:
    offset, length = place_of(clip, kind)
    path = damaged(clip, tmp_path, offset + length - 1)
    nothing = f"nothing can be saved: section {kind} is damaged; get"
    with pytest.raises(pdecodec.CorruptFileError, match=nothing), pdecodec.salvage(path):
        pass
    assert run(["decode", "--salvage", str(path), str(tmp_path / "out.npz")]) == 4
    shown = capsys.readouterr()
    assert shown.err.count("\n") == 1
    assert f"error: {path}, byte {offset}: nothing can be saved" in shown.err
    assert [item.name for item in tmp_path.iterdir()] == [path.name]


def test_no_byte_that_changes_keeps_sound_groups_from_being_saved_or_changes_them(tmp_path: Path) -> None:
    source = tmp_path / "small.pdeanim"
    pdecodec.encode(waves(36, side=3, faces=3), source, profile="paper", tolerance=1e-2)
    with pdecodec.open(source) as whole:
        frames, groups, times = whole.read_frames(0, 36), len(whole.group_frames), whole.times
    assert groups > 2
    nothing = 0
    for place in range(source.stat().st_size):
        try:
            with pdecodec.salvage(damaged(source, tmp_path, place)) as saved:
                missing = np.concatenate([[], *(np.arange(*pair) for pair in saved.missing)]).astype(int)
                kept = np.setdiff1d(np.arange(36), missing)
                assert (saved.sequence.times == times[kept]).all()
                assert (saved.sequence.read_frames(0, kept.size) == frames[kept]).all()
        except pdecodec.CorruptFileError:
            nothing += 1
    needed = sum(place_of(source, kind)[1] for kind in ("SEQN", "CONN", "REST", "MODL", "GRUP"))
    table = place_of(source, "META")[0]
    assert needed <= nothing <= needed + table


def test_a_damaged_run_does_not_lose_the_other_runs(changing: Path, tmp_path: Path, capsys: Capture) -> None:
    with pdecodec.open(changing) as whole:
        assert isinstance(whole, pdecodec.ChangingSequence)
        assert whole.run_frames.tolist() == [40, 30, 1]
        offset, length = place_in_run(changing.read_bytes(), 1, "REST")
        path = damaged(changing, tmp_path, offset + length - 1)
        with pdecodec.salvage(path) as saved:
            assert saved.missing == ((40, 70),)
            assert [one.frame_count for one in saved.sequence.runs] == [40, 1]
            for k, run_of in enumerate((0, 2)):
                end = int(whole.run_frames[run_of])
                expected = whole.runs[run_of].read_frames(0, end)
                assert (saved.sequence.runs[k].read_frames(0, end) == expected).all()
    assert run(["decode", "--salvage", "--json", str(path), str(tmp_path / "out.####.obj")]) == 1
    shown = capsys.readouterr()
    assert json.loads(shown.out)["missing_frames"] == [[40, 70]]
    assert "30 of 71 frames missing, counted from 0: 40 to 69" in shown.err
    assert len([*tmp_path.glob("out.*.obj")]) == 41


def test_the_command_saves_the_sound_parts_and_sets_its_exit_code(clip: Path, tmp_path: Path, capsys: Capture) -> None:
    output = tmp_path / "out.npz"
    assert run(["decode", "--salvage", str(clip), str(output)]) == 0
    assert "nothing is missing" in capsys.readouterr().err
    path = damaged(clip, tmp_path, chunk_of_group(clip, 0))
    assert run(["decode", str(path), "-y", str(output)]) == 4
    assert run(["decode", "--salvage", str(path), "-y", str(output)]) == 1
    with pdecodec.salvage(path) as saved, pdecodec.open_sequence(output) as written:
        assert (written.times == saved.sequence.times).all()
        assert (written.read_frames(0, 9) == saved.sequence.read_frames(0, 9)).all()
    for wrong in (["--at", "1"], ["--frames", "0:3"], ["--velocities"]):
        assert run(["decode", "--salvage", str(path), "-y", str(output), *wrong]) == 2
