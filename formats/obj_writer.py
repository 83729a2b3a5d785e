"""OBJ sequences out: one file a frame, all of them or none.

The frames are written to a hidden folder beside their place. A folder that did not exist is then renamed into
place at once. Files of a pattern, or of a folder that exists, are moved in one by one after the last was written;
with `overwrite`, frames of the same pattern that the new sequence does not have are removed.

Positions are written with as few digits as read back to the same float32. Kept: objects, faces, lines, points,
``"uv"``, ``"color"``, ``"group"``, ``"material"``, ``"smoothing"`` and ``"object"`` attributes as
:mod:`pdecodec.formats.obj_objects` gives them, the ``mtllib`` of the metadata, and times, in a comment.
Of several UV sets or colours the main one is written. Other attributes have no place in OBJ: they are left out, and
the writer says so.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import left_out
from pdecodec.formats.frame_files import FOLDER_PADDING, frames_there, is_frame_pattern, parse_pattern
from pdecodec.formats.obj_statements import FrameText, main_uv, vertex_color
from pdecodec.formats.obj_time import time_comment
from pdecodec.sequence import Attribute, MeshObject, MeshSequence, Progress
from pdecodec.whole_output import partial_folder, whole_file, write_errors


def write_obj(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as OBJ files.

    Parameters
    ----------
    sequence : MeshSequence
    path : pathlib.Path
        A folder (``name`` or ``name/``: files ``name/name.0001.obj``), a pattern (``name.####.obj``), or for one
        frame a plain ``name.obj``.
    overwrite : bool
    fps : float, optional
        Frame rate that the files are numbered by and that they note. Default: the sequence's.
    progress : callable, optional

    Notes
    -----
    Files carry the frame numbers ``round(times * fps)`` where those follow each other without gaps, else they
    count up from the first; the exact times stand in each file's first line.

    Raises
    ------
    InputError
        If the place is taken or not writable, several frames are to go to one file, or a position is not finite.
    """
    rate = sequence.fps if fps is None else fps
    if is_frame_pattern(path):
        _write_frames(sequence, path, rate, overwrite=overwrite, progress=progress)
    elif path.suffix.lower() == ".obj" and not path.is_dir():
        _write_one(sequence, path, rate, overwrite=overwrite, progress=progress)
    else:
        _write_folder(sequence, path, rate, overwrite=overwrite, progress=progress)
    return left_out(sequence, "OBJ", _is_written, metadata=("mtllib",))


def _is_written(item: MeshObject, attribute: Attribute) -> bool:
    if attribute.domain == "face" and attribute.name in ("object", "group", "material", "smoothing"):
        return True
    return any(attribute is written for written in (main_uv(item), vertex_color(item)))


def _write_one(sequence: MeshSequence, path: Path, rate: float, *, overwrite: bool, progress: Progress | None) -> None:
    if sequence.frame_count > 1:
        pattern = f"{path.stem}.{FOLDER_PADDING}{path.suffix}"
        raise InputError(f"{sequence.frame_count} frames do not fit one OBJ file; name it {pattern}", path=path)
    with whole_file(path, overwrite=overwrite) as partial:
        _write_texts(sequence, [partial], rate, progress)


def _write_folder(
    sequence: MeshSequence, folder: Path, rate: float, *, overwrite: bool, progress: Progress | None
) -> None:
    pattern = folder / f"{folder.resolve().name}.{FOLDER_PADDING}.obj"
    if folder.exists():
        frames = set(frames_there(pattern))
        foreign = sorted(item.name for item in folder.glob("*.obj") if item not in frames)
        if foreign:
            raise InputError(
                f"this folder holds other OBJ files ({foreign[0]}); choose an empty one or a pattern", path=folder
            )
        _write_frames(sequence, pattern, rate, overwrite=overwrite, progress=progress)
        return
    names = _names(sequence, pattern, rate)
    with partial_folder(folder) as partial, write_errors(folder):
        _write_texts(sequence, [partial / name for name in names], rate, progress)
        os.replace(partial, folder)


def _write_frames(
    sequence: MeshSequence, pattern: Path, rate: float, *, overwrite: bool, progress: Progress | None
) -> None:
    old = frames_there(pattern)
    if old and not overwrite:
        raise InputError(
            f"frames are there already ({old[0].name}); choose another name, or overwrite them (--overwrite)",
            path=pattern,
        )
    names = _names(sequence, pattern, rate)
    with partial_folder(pattern) as partial, write_errors(pattern):
        _write_texts(sequence, [partial / name for name in names], rate, progress)
        for name in names:
            os.replace(partial / name, pattern.with_name(name))
        for path in old:
            if path.name not in names:
                path.unlink()


def _names(sequence: MeshSequence, pattern: Path, rate: float) -> list[str]:
    parsed: Any = parse_pattern(pattern)
    numbers = np.rint(sequence.times * rate)
    if not (np.diff(numbers) == 1).all():
        numbers = numbers[0] + np.arange(sequence.frame_count)
    return [Path(parsed.frame(int(number))).name for number in numbers]


def _write_texts(sequence: MeshSequence, paths: list[Path], rate: float, progress: Progress | None) -> None:
    text = FrameText(sequence)
    for start, block in sequence.blocks():
        for frame, points in enumerate(block, start):
            with paths[frame].open("wb") as file:
                file.write(time_comment(float(sequence.times[frame]), rate))
                for part in text.of_frame(points, frame):
                    file.write(part)
        if progress is not None:
            progress(start + len(block), sequence.frame_count, "writing OBJ")
