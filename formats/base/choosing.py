"""Frames and objects of a sequence as users name them: the notations of ``--frames`` and ``--object``."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from fnmatch import fnmatchcase
from typing import Any

import numpy as np

from pdecodec.errors import SettingsError, naming_file
from pdecodec.mesh.selection import ObjectSelection, select
from pdecodec.mesh.sequence import MeshSequence

FRAME_SLICE = re.compile(r"(-?\d*):(-?\d*)(?::(\d*))?")
"""``A:B:STEP``, each part optional, as Python writes a slice."""


def select_objects(sequence: MeshSequence, names: Sequence[str], source: str) -> MeshSequence:
    """The objects that `--object` asks for; all of them where it does not.

    Raises
    ------
    InputError
        If there is no object of one of the names in `source`.
    """
    if not names:
        return sequence
    if len(sequence.runs) > 1:
        raise SettingsError("--object is for sequences whose connectivity is constant, and this one's changes")
    known = [item.name for item in sequence.objects]
    # A name that nothing matches goes on as it is: the selection says which names there are.
    chosen = [full for name in names for full in _matching(name.strip("/"), known) or [name]]
    with naming_file(source):
        return ObjectSelection(sequence, chosen)


def _matching(name: str, known: Sequence[str]) -> list[str]:
    """Names that one of the command line stands for: exactly, else as the end of paths, a branch, or a pattern."""
    exact = [full for full in known if full == name]
    return exact or [
        full for full in known if full.endswith(f"/{name}") or full.startswith(f"{name}/") or fnmatchcase(full, name)
    ]


def select_frames(sequence: MeshSequence, text: str | None) -> MeshSequence:
    """The frames that `--frames` asks for.

    Raises
    ------
    SettingsError
        If the text is neither notation, goes backwards, a frame number does not exist, or nothing is left.
    """
    if text is None:
        return sequence
    found = FRAME_SLICE.fullmatch(text.strip())
    if found is None:
        return select(sequence, _positions_of_numbers(sequence, text))
    start, stop, step = (int(part) if part else None for part in found.groups())
    if step == 0:
        raise SettingsError(f"--frames {text}: the step must be at least 1")
    chosen = range(sequence.frame_count)[start:stop:step]
    if not chosen:
        raise SettingsError(f"--frames {text}: none of the {sequence.frame_count} frames is left")
    return select(sequence, chosen)


def _frame_numbers(text: str) -> Iterable[Any]:
    """Numbers of a frame range, as fileseq has them."""
    if text.strip().isdecimal():
        return (int(text),)  # fileseq takes longer to load than such a frame to decode
    from fileseq.exceptions import FileSeqException
    from fileseq.frameset import FrameSet

    try:
        numbers = FrameSet(text)
    except FileSeqException as error:
        raise SettingsError("write positions as A:B:STEP or frame numbers as 1-100x2") from error
    if numbers[0] > numbers[-1]:
        raise SettingsError(f"{numbers} goes backwards, and frames are taken as time goes; the lower number first")
    return numbers


def _positions_of_numbers(sequence: MeshSequence, text: str) -> list[int]:
    try:
        ranges = [_frame_numbers(part) for part in text.split(",") if part.strip()]
    except SettingsError as error:
        raise SettingsError(f"--frames {text}: {error}") from error
    wanted = sorted(set().union(*ranges))
    if not wanted:
        raise SettingsError(
            f"--frames {text!r} names no frame; write positions as A:B:STEP or frame numbers as 1-100x2"
        )
    numbers = np.rint(sequence.times * sequence.fps).astype(np.int64).tolist()
    position_of = dict(zip(numbers, range(len(numbers)), strict=True))
    missing = [number for number in wanted if number not in position_of]
    if missing:
        raise SettingsError(
            f"--frames {text}: there is no frame number {missing[0]}; they run from {numbers[0]} to {numbers[-1]}"
        )
    return [position_of[number] for number in wanted]
