"""Frame patterns and folders: which files are the frames of a sequence, and which numbers they carry."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from fileseq.constants import PAD_STYLE_HASH1
from fileseq.exceptions import FileSeqException
from fileseq.filesequence import FileSequence

from pdecodec.errors import InputError

FRAME_FIELD = re.compile(r"#+|@+|%0?\d*d|\$F\d*")
"""Where a name carries its frame number: hashes, at signs, printf's and Houdini's notation."""

FOLDER_PADDING = "####"
"""Digits of frame numbers in a folder we name ourselves: what render farms and players expect."""


@dataclass(frozen=True)
class FrameFiles:
    """The files of a sequence, in order.

    Parameters
    ----------
    paths : tuple of pathlib.Path
    numbers : tuple of int, or None
        Frame number of each path; None for a single file given by its own name.
    """

    paths: tuple[Path, ...]
    numbers: tuple[int, ...] | None


def is_frame_pattern(path: Path) -> bool:
    """Whether the file name has a field for the frame number."""
    return FRAME_FIELD.search(path.name) is not None


def find_frames(path: Path, extension: str) -> FrameFiles:
    """The frames that a file, a pattern or a folder stands for.

    Parameters
    ----------
    path : pathlib.Path
        ``name.obj``, ``name.####.obj``, ``name.%04d.obj``, ``name.@@@@.obj``, ``name.$F4.obj``, the same with a
        range (``name.1-100x2####.obj``), or a folder of numbered files.
    extension : str
        Of the files wanted in a folder, lower case with the dot.

    Raises
    ------
    InputError
        If nothing matches, several sequences do, or a frame inside the range is missing.
    """
    if path.is_file():
        return FrameFiles((path,), None)
    if path.is_dir():
        sequence = _only_sequence(_numbered_and_single(path, extension), path)
        return _checked(sequence, path, wanted=None)
    if not is_frame_pattern(path):
        raise InputError("there is no such file; check the name", path=path)
    pattern = parse_pattern(path)
    if not path.parent.is_dir():
        raise InputError("this folder does not exist; check the name", path=path.parent)
    same_name = [
        found
        for found in _numbered_and_single(path.parent, extension)
        if found.basename() == pattern.basename() and found.extension() == pattern.extension() and found.frameSet()
    ]
    # Where several paddings stand side by side the pattern's own decides; alone, any padding will do.
    same_padding = [found for found in same_name if found.zfill() == pattern.zfill()]
    sequence = _only_sequence(same_padding or same_name, path)
    return _checked(sequence, path, wanted=pattern.frameSet())


def frames_there(pattern: Path) -> list[Path]:
    """Files that a reader of the pattern would take for its frames, in any padding: what a writer would replace."""
    parsed = parse_pattern(pattern)
    start, end = parsed.basename(), parsed.extension()
    if not pattern.parent.is_dir():
        return []
    found = []
    for item in pattern.parent.iterdir():
        number = item.name.removeprefix(start).removesuffix(end)
        if item.name == f"{start}{number}{end}" and number.removeprefix("-").isdecimal():
            found.append(item)
    return sorted(found)


def parse_pattern(path: Path) -> Any:
    """The pattern as a ``fileseq.FileSequence``: one digit a hash or at sign."""
    try:
        return FileSequence(str(path), pad_style=PAD_STYLE_HASH1)
    except FileSeqException as error:
        raise InputError(f"is not a frame pattern ({error}); use name.####{path.suffix}", path=path) from error


def _numbered_and_single(folder: Path, extension: str) -> list[Any]:
    try:
        found = FileSequence.findSequencesOnDisk(str(folder), pad_style=PAD_STYLE_HASH1)
    except (OSError, FileSeqException) as error:
        raise InputError(f"its frames cannot be listed ({error}); check the folder", path=folder) from error
    return sorted((item for item in found if item.extension().lower() == extension), key=str)


def _only_sequence(found: list[Any], path: Path) -> Any:
    if not found:
        raise InputError("no frame matches; check the name and the folder", path=path)
    if len(found) > 1:
        names = ", ".join(f"{item.basename()}{item.padding()}{item.extension()}" for item in found)
        raise InputError(f"several sequences are here ({names}); name one of them", path=path)
    return found[0]


def _checked(sequence: Any, path: Path, *, wanted: Any) -> FrameFiles:
    if not sequence.frameSet():
        return FrameFiles((Path(sequence[0]),), None)
    there = np.unique(np.fromiter(sequence.frameSet(), np.int64))
    if wanted:
        numbers = np.unique(np.fromiter(wanted, np.int64))
        missing = np.setdiff1d(numbers, there)
    else:
        numbers = there
        before_gap = np.flatnonzero(np.diff(there) > 1)
        missing = there[before_gap] + 1
    if missing.size:
        raise InputError(
            f"frame number {missing[0]} is missing; restore the file, "
            f"or give the range that is there in the pattern, as name.1-9x2####{sequence.extension()}",
            path=path,
        )
    return FrameFiles(
        tuple(Path(sequence.frame(int(number))) for number in numbers), tuple(int(number) for number in numbers)
    )
