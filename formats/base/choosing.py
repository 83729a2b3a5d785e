"""Open clips as users ask for them: select frames and objects in the command line's notation, turn and scale.

Begin with :func:`open_clip`, which applies all fields of an :class:`InputOptions`.
"""

from __future__ import annotations

import os
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from fnmatch import fnmatchcase
from typing import Any, Literal

import numpy as np

from pdecodec.errors import SettingsError, naming_file
from pdecodec.formats.base.opening import open_sequence
from pdecodec.formats.base.registry import Transforms
from pdecodec.formats.base.scene_space import place
from pdecodec.mesh.selection import ObjectSelection, select
from pdecodec.mesh.sequence import MeshSequence

FRAME_SLICE = re.compile(r"(-?\d*):(-?\d*)(?::(\d*))?")
"""A slice as Python writes it, ``A:B:STEP``, each part optional."""


@dataclass(frozen=True, kw_only=True)
class InputOptions:
    """How a clip is read, what is selected from it, how it is turned and scaled; the names are those of the options.

    Attributes
    ----------
    fps, mesh, clip, displacement, solids, transforms, skip_unsupported, isolate, asset_folders
        See :func:`pdecodec.open_sequence`.
    frames : str or None
        Frames to take, see :func:`select_frames`.
    objects : tuple of str
        Objects to take, see :func:`select_objects`; all if empty.
    up_axis, scale, unit
        See :func:`pdecodec.formats.base.scene_space.place`.
    """

    fps: float | None = None
    mesh: str | None = None
    clip: str | None = None
    displacement: str | None = None
    solids: Literal["surface", "keep"] | None = None
    transforms: Transforms = "bake"
    skip_unsupported: bool = False
    isolate: bool = False
    asset_folders: tuple[str, ...] = ()
    frames: str | None = None
    objects: tuple[str, ...] = ()
    up_axis: str | None = None
    scale: float = 1.0
    unit: str | None = None


def open_clip(
    source: str | os.PathLike[str], options: InputOptions | None = None, *, name: str | None = None
) -> MeshSequence:
    """Open a clip, select frames and objects from it, turn and scale it.

    Parameters
    ----------
    source : path or address
    options : InputOptions, optional
    name : str, optional
        What errors call the source. Default: its path.

    Raises
    ------
    InputError, SettingsError, MissingExtraError
        As :func:`open_whole` and :func:`choose` do.
    """
    options = options or InputOptions()
    whole = open_whole(source, options)
    try:
        return choose(whole, options, name or os.fspath(source))
    except BaseException:
        whole.close()
        raise


def open_whole(source: str | os.PathLike[str], options: InputOptions) -> MeshSequence:
    """Open a whole clip, as :func:`pdecodec.open_sequence` does."""
    return open_sequence(
        source,
        fps=options.fps,
        mesh=options.mesh,
        clip=options.clip,
        displacement=options.displacement,
        solids=options.solids,
        transforms=options.transforms,
        skip_unsupported=options.skip_unsupported,
        isolate=options.isolate,
        asset_folders=options.asset_folders,
    )


def choose(whole: MeshSequence, options: InputOptions, name: str) -> MeshSequence:
    """Select frames and objects of an open clip, turn and scale it; errors call the clip `name`.

    Raises
    ------
    InputError, SettingsError
        As :func:`select_frames`, :func:`select_objects` and :func:`pdecodec.formats.base.scene_space.place` do.
    """
    chosen = select_objects(select_frames(whole, options.frames), options.objects, name)
    return place(chosen, up_axis=options.up_axis, scale=options.scale, unit=options.unit)


def rate_to_assume(source: str | os.PathLike[str], fps: float | None) -> float | None:
    """Return the `fps` to open one of several sources with: None for a .pdeanim file, which stores its times."""
    return None if os.fspath(source).lower().endswith(".pdeanim") else fps


def select_objects(sequence: MeshSequence, names: Sequence[str], source: str) -> MeshSequence:
    """Return a sequence of the objects with these names; all objects if there are no names.

    Raises
    ------
    InputError
        If there is no object of one of the names in `source`.
    """
    if not names:
        return sequence
    if len(sequence.runs) > 1:
        message = "needs constant connectivity, and that of this sequence changes; leave it out"
        raise SettingsError(message, code="connectivity-changes", setting="objects")
    known = [item.name for item in sequence.objects]
    # Pass on a name that matches nothing, so that the error lists the names that exist.
    chosen = [full for name in names for full in _matching(name.strip("/"), known) or [name]]
    with naming_file(source):
        return ObjectSelection(sequence, chosen)


def _matching(name: str, known: Sequence[str]) -> list[str]:
    """Return the names that a name of the command line matches: exactly, or else as the end of a path, a branch
    or a pattern.
    """
    exact = [full for full in known if full == name]
    return exact or [
        full for full in known if full.endswith(f"/{name}") or full.startswith(f"{name}/") or fnmatchcase(full, name)
    ]


def select_frames(sequence: MeshSequence, text: str | None) -> MeshSequence:
    """Return a sequence of the frames that `text` selects, a slice or a frame range; all frames if it is None.

    Raises
    ------
    SettingsError
        If the text is neither, goes backwards, selects no frame, or names a frame that does not exist.
    """
    if text is None:
        return sequence
    found = FRAME_SLICE.fullmatch(text.strip())
    if found is None:
        return select(sequence, _positions_of_numbers(sequence, text))
    start, stop, step = (int(part) if part else None for part in found.groups())
    if step == 0:
        raise SettingsError(f"{text}: the step must be at least 1", setting="frames")
    chosen = range(sequence.frame_count)[start:stop:step]
    if not chosen:
        message = f"{text}: selects none of the {sequence.frame_count} frames; widen the range"
        raise SettingsError(message, code="frame-out-of-range", setting="frames")
    return select(sequence, chosen)


def _frame_numbers(text: str) -> Iterable[Any]:
    """Return the numbers of a frame range, as fileseq parses it."""
    if text.strip().isdecimal():
        return (int(text),)  # loading fileseq takes longer than decoding such a frame
    from fileseq.exceptions import FileSeqException
    from fileseq.frameset import FrameSet

    try:
        numbers = FrameSet(text)
    except FileSeqException as error:
        raise SettingsError("write positions as A:B:STEP or frame numbers as 1-100x2") from error
    if numbers[0] > numbers[-1]:
        raise SettingsError(f"{numbers} goes backwards; write the lower number first")
    return numbers


def _positions_of_numbers(sequence: MeshSequence, text: str) -> list[int]:
    try:
        ranges = [_frame_numbers(part) for part in text.split(",") if part.strip()]
    except SettingsError as error:
        raise SettingsError(f"{text}: {error}", setting="frames") from error
    wanted = sorted(set().union(*ranges))
    if not wanted:
        raise SettingsError(
            f"{text!r} names no frame; write positions as A:B:STEP or frame numbers as 1-100x2", setting="frames"
        )
    numbers = np.rint(sequence.times * sequence.fps).astype(np.int64).tolist()
    position_of = dict(zip(numbers, range(len(numbers)), strict=True))
    missing = [number for number in wanted if number not in position_of]
    if missing:
        raise SettingsError(
            f"{text}: there is no frame number {missing[0]}; they run from {numbers[0]} to {numbers[-1]}",
            code="frame-out-of-range",
            setting="frames",
        )
    return [position_of[number] for number in wanted]
