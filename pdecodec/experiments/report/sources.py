"""Which clips a report is of: files, frame patterns, folders of frames, and folders of any of these."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from pdecodec.errors import InputError


def find_clips(given: Sequence[Path], extensions: Sequence[str], frame_extensions: Sequence[str]) -> dict[str, Path]:
    """Every clip by a name of its own, in order.

    Parameters
    ----------
    given : sequence of Path
        A file, a pattern or a folder of frames is a clip; of another folder every file and every folder of frames in it
        is one.
    extensions : sequence of str
        Of files that hold a clip, lower case with the dot.
    frame_extensions : sequence of str
        Of files that hold a frame.

    Returns
    -------
    dict of str to Path
        Names are those of files without extension; where two are equal, with it, and then with their folder.

    Raises
    ------
    InputError
        If a folder holds no clip.
    """
    paths: list[Path] = []
    for path in given:
        paths += _inside(path, extensions, frame_extensions) if path.is_dir() else [path]
    paths = list(dict.fromkeys(paths))
    ways = (lambda path: path.stem or path.name, lambda path: path.name, lambda path: f"{path.parent.name}-{path.name}")
    named: dict[str, Path] = {}
    for path in paths:
        for way in ways:
            if Counter(way(other) for other in paths)[way(path)] == 1:
                named[way(path)] = path
                break
        else:
            named[f"{len(named) + 1}-{path.name}"] = path
    return named


def _inside(folder: Path, extensions: Sequence[str], frame_extensions: Sequence[str]) -> list[Path]:
    if _has_frames(folder, frame_extensions):
        return [folder]
    found = [
        path
        for path in sorted(folder.iterdir())
        if (path.is_file() and path.suffix.lower() in extensions)
        or (path.is_dir() and _has_frames(path, frame_extensions))
    ]
    if not found:
        raise InputError("there is no mesh sequence in this folder; name files or frame patterns", path=folder)
    return found


def _has_frames(folder: Path, frame_extensions: Sequence[str]) -> bool:
    return any(path.suffix.lower() in frame_extensions for path in folder.iterdir())
