"""`pdecodec check` finds every fault of a file, and reports it under a code that never changes."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest

from pdecodec import DecodeLimits, InputError, check_file, open_animation
from pdecodec.cli.main import run
from spec.sealing import seal, take_apart, take_rows, with_section
from spec.vector_files import accepted_files, refused_vectors, write_vectors
from tests.support.damage import place_in_run

ROOT = Path(__file__).resolve().parents[2]
SMALL = accepted_files()["groups_of_shapes"]
RUNS = accepted_files()["runs"]

CODES = {
    "identifier",
    "version",
    "header-checksum",
    "table",
    "table-checksum",
    "truncated",
    "trailing-bytes",
    "section-unknown",
    "section-unknown-required",
    "section-checksum",
    "section-content",
    "group-checksum",
    "group-content",
    "memory-limit",
    "output-limit",
}


def codes(path: Path, *, deep: bool = False) -> list[str]:
    return [finding.code for finding in check_file(path, deep=deep).findings]


def changed(source: Path, at: int, folder: Path) -> Path:
    """Copy a file with one byte changed."""
    data = bytearray(source.read_bytes())
    data[at] ^= 0x20
    (folder / "changed.pdeanim").write_bytes(data)
    return folder / "changed.pdeanim"


@pytest.mark.parametrize("path", accepted_files().values(), ids=lambda path: path.stem)
def test_sound_files_have_nothing_but_notes(path: Path) -> None:
    found = check_file(path, deep=True)
    with open_animation(path) as animation:
        assert (found.is_sound, found.frames, found.runs) == (True, animation.frame_count, len(animation.runs))
    assert {finding.code for finding in found.findings} <= {"section-unknown"}


@pytest.fixture(scope="module")
def refused(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    return write_vectors(tmp_path_factory.mktemp("refused"), "reject")


@pytest.mark.parametrize("name", refused_vectors())
def test_files_that_a_decoder_must_refuse_have_faults_of_known_codes(name: str, refused: dict[str, Path]) -> None:
    found = check_file(refused[name], deep=True)
    assert not found.is_sound
    assert {finding.code for finding in found.findings} <= CODES


def test_every_kind_of_fault_of_the_vectors_is_named(refused: dict[str, Path]) -> None:
    named = {code for path in (*accepted_files().values(), *refused.values()) for code in codes(path, deep=True)}
    assert named == CODES - {"output-limit"}


@pytest.mark.parametrize("source", [SMALL, RUNS], ids=lambda path: path.stem)
def test_a_byte_that_changed_is_found_without_decoding_wherever_it_is(source: Path, tmp_path: Path) -> None:
    for at in range(0, len(source.read_bytes()), 3):
        assert not check_file(changed(source, at, tmp_path)).is_sound, at


def test_a_truncated_file_is_reported_with_the_sections_behind_the_cut(tmp_path: Path) -> None:
    data, path = SMALL.read_bytes(), tmp_path / "cut.pdeanim"
    for size in range(0, len(data), 3):
        path.write_bytes(data[:size])
        assert set(codes(path)) & {"identifier", "table", "truncated"}, size
    path.write_bytes(data[:-1])
    assert codes(path)[:2] == ["truncated", "section-checksum"]


def test_all_faults_are_found_not_only_the_first(tmp_path: Path) -> None:
    parts = take_apart(SMALL.read_bytes())
    ends = np.cumsum([len(part.content) for part in parts]) + len(SMALL.read_bytes())
    ends -= ends[-1] - len(SMALL.read_bytes())
    last = {part.kind: int(end) - 1 for part, end in zip(parts, ends, strict=True)}
    data = bytearray(SMALL.read_bytes())
    for kind in ("META", "REST", "COEF"):
        data[last[kind]] ^= 1
    data[24] ^= 1
    (tmp_path / "several.pdeanim").write_bytes(data + b"more")
    found = check_file(tmp_path / "several.pdeanim", deep=True)
    groups = len(take_rows(next(part.content for part in parts if part.kind == "GRUP"))[0])
    assert [(one.code, one.section) for one in found.findings] == [
        ("header-checksum", None),
        ("trailing-bytes", None),
        ("section-checksum", "META"),
        ("section-checksum", "REST"),
        ("section-checksum", "COEF"),
        ("group-checksum", None),
    ]
    with open_animation(SMALL) as animation:
        first, end = animation.group_frames[-1]
    assert (found.findings[-1].group, found.findings[-1].frames) == (groups - 1, (first, end))


def test_damage_in_a_run_names_the_run_and_its_frames_in_the_whole(tmp_path: Path) -> None:
    with open_animation(RUNS) as animation:
        starts = animation.run_starts.tolist()
    offset, length = place_in_run(RUNS.read_bytes(), 2, "REST")
    found = check_file(changed(RUNS, offset + length - 1, tmp_path))
    inside = [one for one in found.findings if one.run is not None]
    assert [(one.code, one.section, one.run, one.frames) for one in inside] == [
        ("section-checksum", "REST", 2, (starts[2], starts[3]))
    ]


def test_limits_are_findings(tmp_path: Path) -> None:
    found = check_file(SMALL, limits=DecodeLimits(max_memory=3000))
    assert [one.code for one in found.findings] == ["memory-limit"]
    found = check_file(SMALL, limits=DecodeLimits(max_output=100))
    assert [one.code for one in found.findings] == ["output-limit"]
    # An intact table may declare more bytes than the file has.
    parts = take_apart(SMALL.read_bytes())
    long = seal(with_section(parts, "META", bytes(10**6)))
    (tmp_path / "cut.pdeanim").write_bytes(long[: -(10**6)])
    found = check_file(tmp_path / "cut.pdeanim", limits=DecodeLimits(max_memory=10**5))
    assert [one.code for one in found.findings] == ["memory-limit"]


def test_the_command_prints_a_line_for_each_finding_or_json(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    bad = changed(SMALL, len(SMALL.read_bytes()) - 1, tmp_path)
    assert run(["check", str(SMALL), str(bad)]) == 4
    shown = capsys.readouterr()
    lines = shown.out.splitlines()
    assert lines
    assert all(re.fullmatch(rf"{re.escape(str(bad))}: ({'|'.join(CODES)}): .+", line) for line in lines)
    assert f"{SMALL}: sound" in shown.err
    assert run(["check", "--deep", "--json", str(SMALL)]) == 0
    (found,) = json.loads(capsys.readouterr().out)["files"]
    assert (found["sound"], found["deep"], found["findings"]) == (True, True, [])
    assert run(["check", "--json", "--max-memory", "3000", str(SMALL)]) == 4
    (found,) = json.loads(capsys.readouterr().out)["files"]
    assert found["findings"][0]["code"] == "memory-limit"


def test_an_unreadable_file_is_not_a_finding(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for path in (tmp_path / "nothing.pdeanim", tmp_path):
        assert run(["check", str(path)]) == 3
        assert str(path) in capsys.readouterr().err
    with pytest.raises(InputError, match=re.escape(str(tmp_path))):
        check_file(tmp_path / "nul\0.pdeanim")
