"""Find the files of a sequence stored as one file per frame: by a pattern, a folder, a range of numbers."""

from __future__ import annotations

import os
import re
from collections.abc import Collection, Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.errors import InputError

FRAME_FIELD = re.compile(r"#+|@+|%0?\d*d|\$F\d*")
"""The frame number in a file name: hashes, at signs, printf's and Houdini's notation."""

_NUMBERED = re.compile(r"(?P<name>.*?)(?P<sign>-?)(?P<digits>\d+)(?P<end>\.[^.]*)", re.DOTALL)
"""A file name with a number: the part before it, the number, and the extension."""

_NUMBERS = r"-?\d+(?:--?\d+(?:[xy:]-?\d+)?)?"
_RANGE = re.compile(rf"{_NUMBERS}(?:,{_NUMBERS})*")
"""The range of frame numbers before the field of a pattern: ``1-100x2,120``."""

_NO_SIGN = "\0"
"""Separates a hyphen from the number that follows it; no file name contains it."""

FOLDER_PADDING = "####"
"""Padding of frame numbers in file names that pdecodec chooses: four digits, as render farms and players expect."""


@dataclass(frozen=True)
class FrameFiles:
    """The files of a sequence, in order, and their frame numbers: None for a single file given by its own name."""

    paths: tuple[Path, ...]
    numbers: tuple[int, ...] | None


def is_frame_pattern(path: Path) -> bool:
    """Return whether the file name has a field for the frame number."""
    return FRAME_FIELD.search(path.name) is not None


def is_input_pattern(path: Path) -> bool:
    """Return whether a path is no existing file and has a field for the frame number, or an asterisk."""
    return (is_frame_pattern(path) or "*" in path.name) and not path.exists()


def sequence_name(pattern: Path) -> str:
    """Return the common part of the names of a pattern's frames, as a name for one file that holds them all."""
    name = pattern.name.partition("*")[0] if "*" in pattern.name else str(parse_pattern(pattern).basename())
    return name.rstrip("._- ") or "frames"


def find_frames(path: Path, extension: str) -> FrameFiles:
    """Find the frames that a file, a pattern or a folder stands for.

    Parameters
    ----------
    path : pathlib.Path
        ``name.obj``, ``name.####.obj``, ``name.%04d.obj``, ``name.@@@@.obj``, ``name.$F4.obj``, any of these with a
        range (``name.1-100x2####.obj``), ``name.*.obj``, or a folder of numbered files.
    extension : str
        Extension of the files to take from a folder, lower case with the dot.

    Raises
    ------
    InputError
        If nothing matches, several sequences do, or a frame inside the range is missing.
    """
    if path.is_file():
        return FrameFiles((path,), None)
    if path.is_dir():
        sequence = _only_sequence(sequences_in(path, extension), path)
        return _check_frames(sequence, path, wanted=None)
    if not is_input_pattern(path):
        raise InputError("there is no such file; check the name", code="file-missing", path=path)
    if not path.parent.is_dir():
        raise InputError("this folder does not exist; check the name", code="file-missing", path=path.parent)
    if "*" in path.name:
        sequence = _only_sequence(sequences_in(path.parent, extension, frames_there(path)), path)
        return _check_frames(sequence, path, wanted=None)
    pattern = parse_pattern(path)
    readings = _read_pattern(path, pattern)
    for found, numbers in readings:
        pattern.setFrameRange(numbers)
        if set(pattern.frameSet() or ()) <= set(found[0].frameSet()):
            return _check_frames(_only_sequence(found, path), path, wanted=pattern.frameSet())
    sequence = _only_sequence(readings[0][0] if readings else [], path)
    pattern.setFrameRange(readings[0][1])
    return _check_frames(sequence, path, wanted=pattern.frameSet())


def has_frames(path: Path) -> bool:
    """Return whether a path that :func:`is_input_pattern` accepts has any frames."""
    if "*" in path.name:
        return bool(frames_there(path))
    return path.parent.is_dir() and bool(_read_pattern(path, parse_pattern(path)))


def _read_pattern(path: Path, pattern: Any) -> list[tuple[list[Any], str]]:
    """Return the existing sequences for each reading of a pattern, with the range of numbers of that reading."""
    numbered = _numbered_sequences(path.parent, pattern)
    return [
        (found, numbers) for name, numbers in _split_pattern(path) if (found := _with_name(numbered, name, pattern))
    ]


def frames_there(pattern: Path) -> list[Path]:
    """Return the files that a reader would take as frames of the pattern, and that a writer would replace."""
    if not pattern.parent.is_dir():
        return []
    if "*" in pattern.name:
        return sorted(one for one in pattern.parent.iterdir() if fnmatchcase(one.name, pattern.name) and one.is_file())
    parsed = parse_pattern(pattern)
    there = _with_name(_numbered_sequences(pattern.parent, parsed), parsed.basename(), parsed)
    return sorted(pattern.with_name(Path(name).name) for sequence in there for name in sequence)


def _numbered_sequences(folder: Path, pattern: Any) -> list[Any]:
    """Return the sequences of a folder that have the extension of a pattern (a ``fileseq.FileSequence``)."""
    found = sequences_in(folder, pattern.extension().lower())
    return [one for one in found if one.extension() == pattern.extension() and one.frameSet()]


def _with_name(numbered: list[Any], name: str, pattern: Any) -> list[Any]:
    """Return the sequences with this name: those with the padding of the pattern, or all if none has it."""
    same_name = [one for one in numbered if one.basename() == name]
    return [one for one in same_name if one.zfill() == pattern.zfill()] or same_name


def parse_pattern(path: Path) -> Any:
    """Return the pattern as a ``fileseq.FileSequence``: each hash or at sign is one digit."""
    from fileseq.constants import PAD_STYLE_HASH1
    from fileseq.exceptions import FileSeqException
    from fileseq.filesequence import FileSequence

    # fileseq takes numbers and hyphens of a name for a range, so it gets a plain name before the range.
    name, numbers = _split_pattern(path)[0]
    try:
        plain = path.with_name(f"_.{numbers}{path.name[len(name + numbers) :]}")
        pattern = FileSequence(str(plain), pad_style=PAD_STYLE_HASH1)
    except FileSeqException as error:
        raise InputError(
            f"is not a frame pattern ({error}); use name.####{path.suffix}", code="unknown-format", path=path
        ) from error
    pattern.setBasename(name)
    return pattern


def _split_pattern(pattern: Path) -> list[tuple[str, str]]:
    """Return the ways to split a pattern into name and range of numbers, longest range first; existing files decide.

    In ``name-1-9####`` the first hyphen may be part of the name or a minus sign; in ``shot2-9####`` the 2 may be
    part of the name or of the range.
    """
    before = pattern.name[: [*FRAME_FIELD.finditer(pattern.name)][-1].start()]
    starts = (at for at in range(len(before)) if not before[at - 1 : at].isdigit() and _RANGE.fullmatch(before, at))
    return [(before[:at], before[at:]) for at in starts] or [(before, "")]


def gather_frames(paths: Sequence[str], extensions: Collection[str]) -> list[str]:
    """Replace the frames of each sequence, as a shell lists them, by its pattern; keep the order, drop duplicates.

    Parameters
    ----------
    paths : sequence of str
        Files, and any other arguments, which stay unchanged.
    extensions : collection of str
        Extensions of the formats that store one file per frame, lower case with the dot.
    """
    frames = [Path(path) for path in paths if Path(path).suffix.lower() in extensions and Path(path).is_file()]
    patterns: dict[Path, str] = {}
    if len(frames) > 1:
        for folder, extension in dict.fromkeys((frame.parent, frame.suffix.lower()) for frame in frames):
            for found in sequences_in(folder, extension, frames):
                if len(found) > 1:
                    patterns.update((Path(frame), str(found)) for frame in found)
    return list(dict.fromkeys(patterns.get(Path(path), path) for path in paths))


def other_frames_notice(path: Path) -> tuple[str, ...]:
    """Return a notice if a file is one of several frames with the same name but another number, else nothing."""
    wanted = _NUMBERED.fullmatch(path.name)
    if wanted is None or not os.access(path.parent, os.R_OK):
        return ()
    numbered = [found for name in os.listdir(path.parent) if (found := _NUMBERED.fullmatch(name))]
    signs = [one["sign"] for one in numbered if (one["name"], one["end"]) == (wanted["name"], wanted["end"])]
    if len(signs) < 2:
        return ()
    pattern = f"{wanted['name']}{wanted['sign'] if len(set(signs)) == 1 else ''}*{wanted['end']}"
    return (
        f"{path.name} is one of {len(signs)} files that differ only in their number; pass '{pattern}' to read them all",
    )


def _is_file(entry: os.DirEntry[str]) -> bool:
    try:
        return entry.is_file()
    except OSError:  # A link to itself: the error comes from reading it, not from listing its folder.
        return True


def sequences_in(folder: Path, extension: str, files: Iterable[Path] | None = None) -> list[Any]:
    """Return the numbered sequences and single files with an extension in a folder (``fileseq.FileSequence``), in
    order.

    With `files`, only those are taken. All files of the folder decide whether a hyphen is a minus sign.

    Raises
    ------
    InputError
        If the folder cannot be listed.
    """
    from fileseq.constants import PAD_STYLE_HASH1
    from fileseq.exceptions import FileSeqException
    from fileseq.filesequence import FileSequence

    try:
        with os.scandir(folder) as entries:
            names = [item.name for item in entries if not item.name.startswith(".") and _is_file(item)]
        wanted = None if files is None else {file.name for file in files if file.parent == folder}
        marked = [
            str(folder / mark)
            for name, mark in zip(names, _mark_hyphens(names), strict=True)
            if wanted is None or name in wanted
        ]
        found = list(FileSequence.findSequencesInList(marked, pad_style=PAD_STYLE_HASH1))
    except (OSError, FileSeqException) as error:
        raise InputError(
            f"the files of this folder cannot be listed ({error}); check its permissions",
            code="unreadable",
            path=folder,
        ) from error
    for item in found:
        item.setBasename(item.basename().replace(_NO_SIGN, ""))
    return sorted((item for item in found if item.extension().lower() == extension), key=str)


def _mark_hyphens(names: Sequence[str]) -> list[str]:
    """Return file names, with a mark after each hyphen that is part of the name rather than a minus sign.

    ``wolf-1.obj`` is frame 1 of ``wolf-``, unless ``wolf0.obj`` or another number without a hyphen exists too. After
    a dot or an underscore, which already separates the number from the name, a hyphen is a minus sign.
    """
    numbered = [_NUMBERED.fullmatch(name) for name in names]
    unsigned = {(found["name"], found["end"]) for found in numbered if found and not found["sign"]}
    return [
        f"{found['name']}-{_NO_SIGN}{found['digits']}{found['end']}"
        if found and found["sign"] and found["name"][-1:].isalnum() and (found["name"], found["end"]) not in unsigned
        else name
        for name, found in zip(names, numbered, strict=True)
    ]


def _only_sequence(found: list[Any], path: Path) -> Any:
    if not found:
        raise InputError("no frame matches; check the name and the folder", code="no-frames", path=path)
    if len(found) > 1:
        names = ", ".join(f"{item.basename()}{item.padding()}{item.extension()}" for item in found)
        raise InputError(f"several sequences match ({names}); name one of them", code="ambiguous-input", path=path)
    return found[0]


def _check_frames(sequence: Any, path: Path, *, wanted: Any) -> FrameFiles:
    if not sequence.frameSet():
        return FrameFiles((Path(sequence[0]),), None)
    there = np.unique(np.fromiter(sequence.frameSet(), np.int64))
    if wanted:
        numbers = np.unique(np.fromiter(wanted, np.int64))
        missing = np.setdiff1d(numbers, there)
    else:
        numbers = there
        missing = there[np.flatnonzero(np.diff(there) > 1)] + 1
    if missing.size:
        raise InputError(
            f"frame number {missing[0]} is missing; restore the file, "
            f"or write the existing range into the pattern, as in name.1-9x2####{sequence.extension()}",
            code="frame-missing",
            path=path,
        )
    return FrameFiles(
        tuple(Path(sequence.frame(int(number))) for number in numbers), tuple(int(number) for number in numbers)
    )
