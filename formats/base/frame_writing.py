"""Write a file for each frame: all of them or none."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from pathlib import Path

import numpy as np

from pdecodec.errors import InputError
from pdecodec.formats.base.frame_files import FOLDER_PADDING, frames_there, is_frame_pattern, parse_pattern
from pdecodec.formats.base.registry import Output
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.whole_output import partial_folder, publish, write_errors

FrameBytes = Callable[[Float32Array, int], Iterable[bytes]]
"""Return the parts of a file, given positions (vertices, 3) and the index of the frame in its run."""


def write_frames(
    sequence: MeshSequence,
    output: Output,
    what: str,
    frame_bytes: Callable[[MeshSequence, int], FrameBytes],
    *,
    new_folder: bool = False,
    index: tuple[Path, Callable[[Sequence[Path]], bytes]] | None = None,
) -> list[Path]:
    """Write a file for each frame, all of them or none; return their paths.

    The frames are written to a hidden folder next to their place, and moved after the last one is written. If the
    process is killed while it moves them, the next call completes the move. When frames are replaced, old frames
    without a new one are removed.

    Parameters
    ----------
    sequence : MeshSequence
    output : Output
        A pattern, ``name.####.ply``; for a single frame also a plain name.
    what : str
        The format.
    frame_bytes : callable
        Takes a run of the sequence and its first frame, and returns the function that makes the parts of its files.
    new_folder : bool
        Whether the pattern's folder is new, and appears at once when everything is written.
    index : tuple of a path and a callable, optional
        A file that is published together with the frames, and the function that makes its bytes from their paths.

    Raises
    ------
    InputError
        If the output exists or is not writable, or several frames would be written to one file.
    """
    pattern = output.path
    if not is_frame_pattern(pattern):
        if sequence.frame_count > 1:
            name = f"{pattern.stem}.{FOLDER_PADDING}{pattern.suffix}"
            raise InputError(
                f"{sequence.frame_count} frames do not fit in one {what} file; name it {name}",
                code="too-large",
                path=pattern,
            )
        with output.whole_file() as partial, partial.open("wb") as file:
            file.writelines(frame_bytes(sequence.runs[0], 0)(sequence.read_frames(0, 1)[0], 0))
        return [pattern]
    old = frames_there(pattern)
    if old and not output.overwrite:
        raise InputError(
            f"frames exist already ({old[0].name})",
            code="output-exists",
            path=pattern,
            setting="overwrite",
            purpose="to replace them",
        )
    parsed = parse_pattern(pattern)
    # Number frames by their times if these are consecutive, else count up from the first.
    numbers = np.rint(sequence.times * output.rate)
    if not (np.diff(numbers) == 1).all():
        numbers = numbers[0] + np.arange(sequence.frame_count)
    paths = [pattern.with_name(Path(parsed.frame(int(number))).name) for number in numbers]
    place = pattern.parent if new_folder else pattern
    with partial_folder(place) as partial, write_errors(place):
        for run, first, start, block in output.blocks_of_runs(sequence, what):
            if start == first:
                bytes_of = frame_bytes(run, first)
            for frame, points in enumerate(block, start):
                with (partial / paths[frame].name).open("wb") as file:
                    file.writelines(bytes_of(points, frame - first))
        if new_folder:
            os.replace(partial, place)
            return paths
        names = [path.name for path in paths]
        if index is not None:
            (partial / index[0].name).write_bytes(index[1](paths))
            names.append(index[0].name)
        gone = [path.name for path in set(old) - set(paths)]
        publish(partial, names, overwrite=output.overwrite, remove=gone)
    return paths
