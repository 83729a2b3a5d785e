"""Public functions accept any argument of a caller or refuse it with a one-line error of the library."""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Callable
from fractions import Fraction
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec import (
    ArraySequence,
    DecodeLimits,
    EncodeSettings,
    InputError,
    PaperSettings,
    PdecodecError,
    SettingsError,
)
from pdecodec.batch.records import read_record, record_place
from pdecodec.formats import open_sequence, write_sequence

POINTS = np.random.default_rng(0).normal(size=(6, 30, 3)).astype(np.float32)

ODD = [
    *("24", "x", "\0", "a\0b", "\ud800", b"x", bytearray(b"xx"), 10**400, -(10**400), 10**5000, 2**70, -1, 0, True),
    *(None, [], [[]], [None], [1, "a"], [10**400], {}, object(), float("nan"), float("inf"), 1 + 2j),
    *(np.array(["a"]), np.array([1 + 2j]), np.zeros((2, 2)), np.datetime64("2026-01-01")),
]
"""Texts, huge and tiny numbers, and values that are not numbers."""


@pytest.fixture(scope="module")
def files(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("arguments")
    clip = ArraySequence(POINTS, fps=24)
    write_sequence(clip, folder / "frames")
    pdecodec.encode(clip, folder / "a.pdeanim")
    pdecodec.encode(clip, folder / "paper.pdeanim", profile="paper")
    return folder


def animation(files: Path, call: Callable[[Any], Any], name: str = "a.pdeanim") -> Any:
    with pdecodec.open(files / name) as opened:
        return call(opened)


Call = Callable[[Path, Any], Any]

CALLS: dict[str, Call] = {
    "open": lambda files, odd: pdecodec.open(odd).close(),
    **{
        f"open {name}": lambda files, odd, name=name: pdecodec.open(  # type: ignore[misc]
            files / "a.pdeanim", limits=DecodeLimits(**{name: odd})
        ).close()
        for name in DecodeLimits.__dataclass_fields__
    },
    "open max_output": lambda files, odd: pdecodec.open(
        files / "a.pdeanim", limits=DecodeLimits(max_output=odd)
    ).close(),
    "open max_kept": lambda files, odd: pdecodec.open(files / "a.pdeanim", limits=DecodeLimits(max_kept=odd)).close(),
    "open_sequence": lambda files, odd: open_sequence(odd),
    "open_sequence fps": lambda files, odd: open_sequence(files / "frames", fps=odd),
    "open_sequence mesh": lambda files, odd: open_sequence(files / "frames", mesh=odd),
    "open_sequence clip": lambda files, odd: open_sequence(files / "frames", clip=odd),
    "open_sequence asset_folders": lambda files, odd: open_sequence(files / "frames", asset_folders=odd),
    "write_sequence": lambda files, odd: write_sequence(odd, files / "x.npz", overwrite=True),
    "write_sequence path": lambda files, odd: write_sequence(ArraySequence(POINTS), odd, overwrite=True),
    "write_sequence fps": lambda files, odd: write_sequence(
        ArraySequence(POINTS), files / "x.glb", fps=odd, overwrite=True
    ),
    "write_sequence rigid": lambda files, odd: write_sequence(
        ArraySequence(POINTS), files / "x.glb", rigid=odd, overwrite=True
    ),
    "encode": lambda files, odd: pdecodec.encode(odd),
    "encode path": lambda files, odd: None if odd is None else pdecodec.encode(POINTS[:1], odd, overwrite=True),
    "encode rms": lambda files, odd: pdecodec.encode(POINTS[:1], rms=odd),
    "encode size": lambda files, odd: pdecodec.encode(POINTS[:1], size=odd),
    "positions": lambda files, odd: animation(files, lambda opened: opened.positions(odd)),
    "positions out": lambda files, odd: animation(files, lambda opened: opened.positions(0.0, out=odd)),
    "velocities": lambda files, odd: animation(files, lambda opened: opened.velocities(odd)),
    "velocities outside": lambda files, odd: animation(files, lambda opened: opened.velocities(0.0, outside=odd)),
    "accelerations": lambda files, odd: animation(files, lambda opened: opened.accelerations(odd)),
    "sample": lambda files, odd: animation(files, lambda opened: opened.sample(odd)),
    "sample outside": lambda files, odd: animation(files, lambda opened: opened.sample([0.0], outside=odd)),
    "coefficients": lambda files, odd: animation(files, lambda opened: opened.coefficients(odd), "paper.pdeanim"),
    "ArraySequence": lambda files, odd: ArraySequence(odd),
    "ArraySequence times": lambda files, odd: ArraySequence(POINTS, times=odd),
    "ArraySequence fps": lambda files, odd: ArraySequence(POINTS, fps=odd),
    "ArraySequence faces": lambda files, odd: ArraySequence(POINTS, faces=odd),
    "ArraySequence objects": lambda files, odd: ArraySequence(POINTS, objects=odd),
    "ArraySequence metadata": lambda files, odd: ArraySequence(POINTS, metadata=odd),
    "FrameSelection": lambda files, odd: pdecodec.FrameSelection(ArraySequence(POINTS), odd),
    "ObjectSelection": lambda files, odd: pdecodec.ObjectSelection(ArraySequence(POINTS), odd),
    "check_file": lambda files, odd: pdecodec.check_file(odd),
    "salvage": lambda files, odd: pdecodec.salvage(odd).__enter__(),
    **{
        f"EncodeSettings {name}": lambda files, odd, name=name: EncodeSettings(**{name: odd})  # type: ignore[misc]
        for name in EncodeSettings.__dataclass_fields__
    },
    **{
        f"PaperSettings {name}": lambda files, odd, name=name: PaperSettings(**{name: odd})  # type: ignore[misc]
        for name in PaperSettings.__dataclass_fields__
    },
}


@pytest.mark.parametrize("name", CALLS)
def test_any_argument_is_accepted_or_refused_in_one_line(
    name: str, files: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)  # some of these values are valid names of files
    refused: list[PdecodecError] = []
    for odd in ODD:
        try:
            CALLS[name](files, odd)
        except PdecodecError as error:
            refused.append(error)
    assert not [str(error) for error in refused if "\n" in str(error) or len(error.message) > 400]
    assert len(refused) > len(ODD) // 4 or name == "open_sequence asset_folders"


@pytest.mark.parametrize(
    ("call", "words"),
    [
        (lambda: ArraySequence(POINTS, fps="24"), "frames per second must be a number, not '24'"),  # type: ignore[arg-type]
        (lambda: ArraySequence(POINTS, times="abc"), "times must be a number or a list of numbers, not 'abc'"),
        (lambda: ArraySequence(POINTS, times=[10**400] * 6), "times must be a number or a list of numbers, not [1000"),
        (lambda: DecodeLimits(max_memory="2G"), "max_memory must be a whole number, not '2G'"),  # type: ignore[arg-type]
        (lambda: pdecodec.open(5), "source must be a path, bytes or a binary file, not 5"),  # type: ignore[arg-type]
        (lambda: open_sequence("a.obj", fps=10**400), "fps must be below 2^1024"),
        (lambda: EncodeSettings(tolerance=np.zeros((1, 2))), "tolerance must be a number, not array([[0., 0.]])"),  # type: ignore[arg-type]
    ],
)  # fmt: skip
def test_an_error_names_the_value_given_and_the_values_allowed(call: Callable[[], Any], words: str) -> None:
    with pytest.raises((InputError, SettingsError)) as caught:
        call()
    assert str(caught.value).startswith(words)


def test_bytes_of_every_kind_and_numbers_of_every_library_are_taken(files: Path) -> None:
    data = (files / "a.pdeanim").read_bytes()
    for given in (data, bytearray(data), memoryview(data), memoryview(bytearray(data))):
        with pdecodec.open(given) as opened:
            assert opened.positions(0.0).shape == (30, 3)
            same = [opened.positions(time) for time in (0, 0.0, np.float32(0), np.int8(0), np.array(0), Fraction(0))]
            assert all(np.array_equal(one, same[0]) for one in same)
    rates = (24, 24.0, np.float32(24), np.array(24), Fraction(24))
    assert {ArraySequence(POINTS, fps=rate).fps for rate in rates} == {24.0}  # type: ignore[arg-type]
    with open_sequence(str(files / "frames").encode()) as frames:  # type: ignore[arg-type]
        assert frames.frame_count == 6


def test_a_single_folder_is_one_and_not_its_letters(files: Path) -> None:
    """If a path were taken for a list of paths, its first letter "/" would be the root folder."""
    from pdecodec.system.reading import allowed_folders, asset_folders_allowed

    for given in (str(files), files, [str(files)]):
        with asset_folders_allowed(given):
            assert allowed_folders() == (str(files.resolve()),)


def test_memory_that_runs_out_in_a_product_is_a_memory_error() -> None:
    """The core would copy a matrix whose columns are not contiguous."""
    code = """
import resource
import numpy as np
from pdecodec.codec.linear_algebra import product
right = np.zeros((3000, 3000)).T
product(np.zeros((1, 10)), np.zeros((10, 10)))
with open("/proc/self/statm") as file:
    taken = int(file.read().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (taken + 2**25, resource.RLIM_INFINITY))
try:
    product(np.zeros((1, 3000)), right)
except MemoryError as error:
    print("no memory", "\\n" in str(error))
"""
    if not Path("/proc/self/statm").exists():
        pytest.skip("needs /proc")
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "no memory False\n", done.stderr


def test_a_record_of_nested_lists_counts_as_no_record(tmp_path: Path) -> None:
    place = record_place(str(tmp_path), "a.pdeanim")
    assert isinstance(place, Path)
    place.parent.mkdir(parents=True)
    place.write_text("[" * 10**5)
    assert read_record(str(tmp_path), "a.pdeanim") is None
    place.write_text(json.dumps([]))
    assert read_record(str(tmp_path), "a.pdeanim") is None
