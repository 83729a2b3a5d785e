"""Files of frames out, all of them or none, for formats of one file a frame."""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.frame_files import FOLDER_PADDING, frames_there, is_frame_pattern, parse_pattern
from pdecodec.sequence import Float32Array, MeshSequence, Progress
from pdecodec.whole_output import partial_folder, whole_file, write_errors

FrameBytes = Callable[[Float32Array, float], bytes]
"""The bytes of a file: of positions (vertices, 3) and a time [s]."""


def write_frames(
    sequence: MeshSequence,
    path: Path,
    frame_bytes: FrameBytes,
    *,
    rate: float,
    overwrite: bool,
    progress: Progress | None,
    what: str,
) -> list[Path]:
    """Write a file for each frame; the paths.

    Parameters
    ----------
    path : pathlib.Path
        A pattern, ``name.####.ply``; for one frame also a plain name.

    Raises
    ------
    InputError
        If the place is taken or not writable, or several frames are to go to one file.
    """
    if not is_frame_pattern(path):
        if sequence.frame_count > 1:
            pattern = f"{path.stem}.{FOLDER_PADDING}{path.suffix}"
            raise InputError(f"{sequence.frame_count} frames do not fit one file; name it {pattern}", path=path)
        with whole_file(path, overwrite=overwrite) as partial:
            partial.write_bytes(frame_bytes(sequence.read_frames(0, 1)[0], float(sequence.times[0])))
        return [path]
    old = frames_there(path)
    if old and not overwrite:
        raise InputError(
            f"frames are there already ({old[0].name}); choose another name, or overwrite them (--overwrite)", path=path
        )
    parsed: Any = parse_pattern(path)
    numbers = np.rint(sequence.times * rate)
    if not (np.diff(numbers) == 1).all():
        numbers = numbers[0] + np.arange(sequence.frame_count)
    names = [Path(parsed.frame(int(number))).name for number in numbers]
    with partial_folder(path) as partial, write_errors(path):
        for start, block in sequence.blocks():
            for frame, points in enumerate(block, start):
                (partial / names[frame]).write_bytes(frame_bytes(points, float(sequence.times[frame])))
            if progress is not None:
                progress(start + len(block), sequence.frame_count, f"writing {what}")
        for name in names:
            os.replace(partial / name, path.with_name(name))
        for item in old:
            if item.name not in names:
                item.unlink()
    return [path.with_name(name) for name in names]
