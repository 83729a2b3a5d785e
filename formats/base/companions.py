"""List the files that a path stands for: the files that are read with it, or replaced by writing to it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from pathlib import Path

from pdecodec.errors import InputError, MissingExtraError
from pdecodec.formats.base.frame_files import find_frames, frames_there, has_frames, is_input_pattern
from pdecodec.formats.base.registry import format_of_extension, known_extensions, load
from pdecodec.system.storage import is_address


def frame_extensions() -> set[str]:
    """Return the extensions of the formats that store one file per frame."""
    return set(known_extensions(lambda entry: entry.frame_per_file))


def input_files(source: str) -> tuple[Path, ...]:
    """Return the files of an input: the file and all files that it names, or all frames. Empty if it does not exist or
    is remote.

    Raises
    ------
    InputError
        If a folder or pattern does not stand for one whole sequence.
    """
    if is_address(source):
        return ()
    path = Path(source)
    if path.is_file():
        # A library may name the same file by another path than the user did: count each file once.
        found: dict[str, Path] = {}
        for file in (path, *_named_by(path)):
            found.setdefault(os.path.realpath(file), file)
        return tuple(found.values())
    suffixes = {file.suffix.lower() for file in path.iterdir()} if path.is_dir() else {path.suffix.lower()}
    return tuple(file for extension in suffixes & frame_extensions() for file in find_frames(path, extension).paths)


def check_exists(source: str) -> None:
    """Raise InputError unless a path is a file, a folder, or a pattern that has existing frames."""
    path = Path(source)
    if is_address(source) or path.exists() or (is_input_pattern(path) and has_frames(path)):
        return
    raise InputError("there is no such file; check the name", code="file-missing", path=path)


def output_files(output: str) -> list[Path]:
    """Return the existing files that writing to a file, pattern or folder would replace. Called after writing,
    return the files written.
    """
    path = Path(output)
    if path.is_dir():
        return sorted(file for file in path.iterdir() if file.suffix.lower() in frame_extensions())
    if is_input_pattern(path):
        return frames_there(path)
    entry = format_of_extension(path)
    companions: list[Path] = []
    if entry is not None and entry.written_beside is not None:
        companions = load(entry, entry.written_beside, "written", path)(path)
    # Broken links count, too.
    return [one for one in (path, *companions) if one.exists() or one.is_symlink()]


def _named_by(path: Path) -> Iterator[Path]:
    """Yield the existing files that a file names; none if the file is damaged, which its reader reports."""
    entry = format_of_extension(path)
    if entry is None or entry.companions is None:
        return
    try:
        for name in load(entry, entry.companions, "read", path)(path):
            found = name if isinstance(name, Path) else path.parent / name
            if "\0" not in str(name) and found.is_file():
                yield found
    except (InputError, MissingExtraError, OSError, ValueError, AttributeError, RecursionError, SyntaxError):
        return
