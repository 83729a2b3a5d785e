"""Options that several commands share, and checks of what they say."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pdecodec.errors import InputError, SettingsError

if TYPE_CHECKING:
    from pdecodec.sequence import MeshSequence

FRAME_SLICE = re.compile(r"(-?\d*):(-?\d*)(?::(\d*))?")
"""``A:B:STEP``, each part optional, as Python writes a slice."""

BYTE_UNITS = {"": 1, "K": 2**10, "M": 2**20, "G": 2**30, "T": 2**40}


def parse_bytes(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Click callback: a number of bytes, ``800000000``, ``800M``, ``1.5G`` (binary units).

    Raises
    ------
    click.BadParameter
        If it is none.
    """
    if value is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)i?B?", value.strip(), re.IGNORECASE)
    if found is None:
        raise click.BadParameter(f"{value!r} is not a number of bytes such as 800M or 1.5G", context, parameter)
    return int(float(found[1]) * BYTE_UNITS[found[2].upper()])


output_option = click.option(
    "-o", "--output", required=True, metavar="OUT", help="File, folder or pattern to write; format by extension."
)
overwrite_option = click.option("--overwrite", is_flag=True, help="Replace OUT when it exists.")
json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")
fps_option = click.option(
    "--fps", type=float, metavar="F", help="Frames per second of IN where it does not say (24 when nobody does)."
)
frames_option = click.option(
    "--frames",
    metavar="A:B:STEP|1-100x2",
    help="Only these frames: positions counted from 0, B excluded, as a Python slice (10:, ::2); "
    "or frame numbers (time times fps, rounded), both ends included (1-100x2,120).",
)


def select_frames(sequence: MeshSequence, text: str | None) -> MeshSequence:
    """The frames that `--frames` asks for.

    Raises
    ------
    SettingsError
        If the text is neither notation, a frame number does not exist, or nothing is left.
    """
    from pdecodec.sequence import FrameSelection

    if text is None:
        return sequence
    found = FRAME_SLICE.fullmatch(text.strip())
    if found is None:
        return FrameSelection(sequence, _positions_of_numbers(sequence, text))
    start, stop, step = (int(part) if part else None for part in found.groups())
    if step == 0:
        raise SettingsError(f"--frames {text}: the step must be at least 1")
    chosen = range(sequence.frame_count)[start:stop:step]
    if not chosen:
        raise SettingsError(f"--frames {text}: none of the {sequence.frame_count} frames is left")
    return FrameSelection(sequence, chosen)


def _positions_of_numbers(sequence: MeshSequence, text: str) -> list[int]:
    import numpy as np
    from fileseq.exceptions import FileSeqException
    from fileseq.frameset import FrameSet

    try:
        wanted = sorted(set(FrameSet(text)))
    except FileSeqException as error:
        raise SettingsError(f"--frames {text}: write positions as A:B:STEP or frame numbers as 1-100x2") from error
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


def refuse_pdeanim(output: str, instead: str) -> None:
    """Raise SettingsError, ending in what to do instead, where the output of a command that does not encode is one."""
    if output.lower().endswith(".pdeanim"):
        raise SettingsError(f"{output}: only pdecodec encode writes .pdeanim files; {instead}")


def check_output(output: str, *, overwrite: bool) -> None:
    """Refuse an output that cannot be written, before the work for it starts.

    Raises
    ------
    InputError
        If it exists and may not be replaced, or the folder it goes into is missing or not writable.
    """
    from pdecodec.formats.frame_files import is_frame_pattern

    path = Path(output)
    folder = path.parent
    if not folder.is_dir():
        raise InputError("this folder does not exist; make it first", path=folder)
    if not os.access(folder, os.W_OK):
        raise InputError("this folder cannot be written to; choose another", path=folder)
    if path.is_dir() and path.suffix and not output.endswith("/"):
        raise InputError("is a folder; name a file in it", path=path)
    if overwrite:
        return
    taken = _first_frame_of(path) if is_frame_pattern(path) else path
    if taken is not None and taken.exists() and not (taken.is_dir() and not any(taken.iterdir())):
        raise InputError("exists already; choose another name, or give --overwrite to replace it", path=taken)


def _first_frame_of(pattern: Path) -> Path | None:
    """A file that a frame pattern stands for, if there is one."""
    from pdecodec.formats.frame_files import FRAME_FIELD

    fixed = [re.escape(part) for part in FRAME_FIELD.split(pattern.name)]
    numbered = re.compile(r"-?\d+".join(fixed))
    return min((file for file in pattern.parent.iterdir() if numbered.fullmatch(file.name)), default=None)


@contextmanager
def naming_file(source: str) -> Iterator[None]:
    """Name the input in errors of code that knows only its positions."""
    try:
        yield
    except InputError as error:
        if error.path is not None:
            raise
        raise InputError(error.message, path=source, frame=error.frame, offset=error.offset) from error


def input_bytes(source: str) -> int:
    """Bytes that an input takes on disk, all its frames together."""
    from pdecodec.formats import list_formats
    from pdecodec.formats.frame_files import find_frames

    path = Path(source)
    if path.is_file():
        return path.stat().st_size
    extensions = {extension for entry in list_formats() if entry.frame_per_file for extension in entry.extensions}
    found = {file.suffix.lower() for file in path.iterdir()} if path.is_dir() else {path.suffix.lower()}
    return sum(file.stat().st_size for extension in found & extensions for file in find_frames(path, extension).paths)
