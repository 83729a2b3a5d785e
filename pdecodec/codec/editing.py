"""Cut and join files: whole groups of frames are copied without decoding them; other frames are encoded to fit
in next to them.

A position at a frame depends on its own group alone, so it stays the same to the last bit. Between frames it follows
the spline through all frames of the file, from one discontinuity to the next. Near a place where files were cut or
joined, the spline changes, by 0.27 as much with each frame further away; it stays continuous in position and
velocity, except at a discontinuity.
"""

from __future__ import annotations

import os
from collections.abc import Generator, Iterator, Sequence
from contextlib import ExitStack, closing
from itertools import pairwise
from pathlib import Path

import numpy as np

from pdecodec.codec.coded_file import Coded, CodedFile, CodedFrames, Described
from pdecodec.codec.container import SECTION_KINDS
from pdecodec.codec.edited_file import SHARED_SECTIONS, CutReport, FieldPart, write_file, write_runs
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EffortName
from pdecodec.codec.stored_choices import bound_of
from pdecodec.errors import InputError, SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.jumps import jumps_across
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.mesh.times import SHORTEST_TIME_STEP
from pdecodec.system.whole_output import check_writable

FRAME_ROUNDING = 1e-6
"""Largest distance of a time from a whole frame number at which it counts as that frame [frames]."""


def cut_animation(
    source: str | os.PathLike[str],
    path: str | os.PathLike[str],
    first: int,
    end: int,
    *,
    recode: bool = False,
    effort: EffortName = "default",
    overwrite: bool = False,
    progress: Progress | None = None,
) -> CutReport:
    """Write some consecutive frames of a file as a file of their own; they keep their times.

    Parameters
    ----------
    source, path : path-like
    first, end : int
        Frames from 0; `end` is excluded. Both must be where a group of frames begins or ends.
    recode : bool
        Code frames of groups that are cut through again. The file's bound then holds against its decoded frames: these
        frames are off their source by at most twice the bound.
    effort : {"fast", "default", "best"}
        For frames that are coded again.
    overwrite : bool
    progress : callable, optional

    Raises
    ------
    SettingsError
        If there are no such frames, or a group would be cut through; the message names the nearest group borders.
    InputError, CorruptFileError
        If a file cannot be read or written, or is damaged.
    """
    check_writable(Path(path), overwrite=overwrite)
    with ExitStack() as stack:
        whole = stack.enter_context(open_animation(source))
        run_frames = whole.run_frames if isinstance(whole, ChangingSequence) else [whole.frame_count]
        edges = [0, *np.cumsum(run_frames).tolist()]
        if not 0 <= first < end <= edges[-1]:
            raise SettingsError(
                f"there are no frames {first} to {end}; the file has {edges[-1]}",
                code="frame-out-of-range",
                path=source,
            )
        parts = [
            (number, max(first - begin, 0), min(end, stop) - begin)
            for number, (begin, stop) in enumerate(pairwise(edges))
            if begin < end and first < stop
        ]

        def opened() -> Generator[CodedFrames, None, None]:
            for number, begin, stop in parts:
                with CodedFile(source, number, whole) as file:
                    yield CodedFrames(file, begin, stop, effort, progress)

        if not recode:
            for part, (number, _, _) in zip(opened(), parts, strict=True):
                part.check_edges(edges[number], whole.times)
        summary = f"frames {first} to {end - 1} of {edges[-1]}"
        if len(parts) > 1:
            return write_runs(opened(), whole, first, summary, Path(path), overwrite)
        part = next(stack.enter_context(closing(opened())))
        fields = [(part.file, part.first, part.end)]
        return write_file(part.file, part.described, part.pieces(), fields, summary, part.again, Path(path), overwrite)


def join_animations(
    source: str | os.PathLike[str],
    others: Sequence[str | os.PathLike[str] | MeshSequence],
    path: str | os.PathLike[str],
    *,
    shift: bool = False,
    recode: bool = False,
    effort: EffortName = "default",
    overwrite: bool = False,
    progress: Progress | None = None,
) -> CutReport:
    """Write a file and further frames as one file.

    Parameters
    ----------
    source : path-like
        Its frames come first, as they are coded.
    others : sequence of path-like or MeshSequence
        Files with the same reference frame and model, as those cut from one file have, are copied. Sequences are coded
        with its model, within its bound.
    path : path-like
    shift : bool
        Move the times of each to one frame after the frames before it. Otherwise they must be later already.
    recode : bool
        Decode files of another model, and code them again within the bound: bounds add up.
    effort : {"fast", "default", "best"}
        For frames that are coded.
    overwrite : bool
    progress : callable, optional

    Raises
    ------
    SettingsError
        If a file has another model, or times do not follow one another.
    InputError, CorruptFileError
        If meshes differ, vertices that coincide in all frames of the file part in frames that are coded, or a file
        cannot be read or written, or is damaged.
    """
    check_writable(Path(path), overwrite=overwrite)
    with ExitStack() as stack:
        head = stack.enter_context(CodedFile(source))
        times, names, coded_again = [head.animation.times], [os.path.basename(head.path)], 0
        before: MeshSequence = head.animation
        is_closed = head.entries[0].basis == "closed form"
        jumps, bound = list(head.animation.jumps), bound_of(head.animation)
        coming: list[CodedFile | MeshSequence] = []
        fields: list[FieldPart] = [(head, 0, head.animation.frame_count)]
        for other in others:
            if isinstance(other, MeshSequence):
                sequence, name = other, "frames"
                _require_mesh_of(head, sequence, None)
                coming.append(other)
                fields.append((other, 0, other.frame_count))
            else:
                file = stack.enter_context(CodedFile(other))
                sequence, name = file.animation, os.path.basename(file.path)
                _require_mesh_of(head, sequence, other)
                differing = [kind for kind in SHARED_SECTIONS if file.section(kind) != head.section(kind)]
                if differing and not recode:
                    what = SECTION_KINDS[differing[0]].title
                    raise SettingsError(
                        f"differs from {head.path} in its {what}, so that its groups of frames do not fit there; "
                        "they can be coded again, and then bounds add up",
                        path=other,
                    )
                coming.append(sequence if differing else file)
                fields.append((file, 0, sequence.frame_count))
            where = None if isinstance(other, MeshSequence) else other
            times.append(_following(times[-1], sequence.times, head.animation.fps, shift=shift, path=where))
            coded_again += 0 if isinstance(coming[-1], CodedFile) else sequence.frame_count
            names.append(name)
            if not is_closed and bound is not None and jumps_across(before, sequence, bound):
                jumps.append(sum(part.size for part in times[:-1]))
            before = sequence

        def pieces() -> Iterator[Coded]:
            yield from head.coded(0, len(head.entries))
            starts = np.cumsum([part.size for part in times])
            for one, start in zip(coming, starts.tolist(), strict=False):
                if isinstance(one, CodedFile):
                    yield from one.coded(0, len(one.entries))
                    own: Sequence[int] = one.animation.jumps
                else:
                    coder = head.appending(one, effort=effort, progress=progress)
                    yield from ((group.entry, group.chunks) for group in coder.coded())
                    own = coder.jumps
                jumps.extend(start + frame for frame in own)

        summary = f"{' and '.join(names)} joined"
        described = Described(head.animation, np.concatenate(times), jumps)
        return write_file(head, described, pieces(), fields, summary, coded_again, Path(path), overwrite)


def _require_mesh_of(head: CodedFile, sequence: MeshSequence, path: str | os.PathLike[str] | None) -> None:
    """Refuse frames of another mesh, before any other difference is examined: coding them again would not help."""
    if not sequence.connectivity.same_as(head.animation.connectivity):
        raise InputError(
            f"is of another mesh than {head.path}: faces and lines differ", code="object-mismatch", path=path
        )


def _following(
    before: Float64Array, times: Float64Array, fps: float, *, shift: bool, path: str | os.PathLike[str] | None
) -> Float64Array:
    """Return the times of frames that follow other frames; raise SettingsError if they overlap and `shift` is off."""
    if not shift:
        if times[0] - before[-1] < SHORTEST_TIME_STEP:
            raise SettingsError(
                f"begins at {times[0]:g} s, but the frames before it end at {before[-1]:g} s; its times can be shifted",
                path=path,
            )
        return times
    moved: Float64Array
    last, numbers = np.rint(before[-1] * fps), np.rint(times * fps)
    if abs(before[-1] * fps - last) < FRAME_ROUNDING and np.abs(times * fps - numbers).max() < FRAME_ROUNDING:
        # Times that are frame numbers remain frame numbers, because these take no bytes in the file.
        moved = (numbers - numbers[0] + last + 1.0) / fps
        return moved
    moved = times - times[0] + before[-1] + 1.0 / fps
    return moved
