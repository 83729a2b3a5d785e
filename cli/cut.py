"""`pdecodec cut` and `pdecodec join`: parts of files, and files one after the other, as they are coded."""

from __future__ import annotations

import re
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeVar

import click

from pdecodec.cli.console import byte_size, counted, print_json, progress_bar, say, say_notices
from pdecodec.cli.jobs import local_input, local_output
from pdecodec.cli.options import (
    check_apart,
    effort_option,
    json_option,
    loudness_options,
    option_group,
    output_option,
    overwrite_option,
    read_options,
    within_limits,
)
from pdecodec.errors import SettingsError

if TYPE_CHECKING:
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.editing import CutReport
    from pdecodec.codec.settings import EffortName
    from pdecodec.mesh.sequence import MeshSequence

SPAN = re.compile(r"\s*(?P<begin>[^:]*?)\s*:\s*(?P<end>[^:]*?)\s*")
"""``A:B``, each part optional."""

Number = TypeVar("Number", int, float)

coded_effort_option = effort_option("Of frames that are coded.")

part_options = option_group(within_limits, overwrite_option, loudness_options, json_option)


@click.command()
@click.argument("source", metavar="FILE")
@output_option
@click.option("--frames", metavar="A:B", help="These frames, counted from 0, B excluded, as a Python slice.")
@click.option("--times", metavar="A:B", help="Frames at these times and between [s].")
@click.option(
    "--recode",
    is_flag=True,
    help="Where a group of frames is cut through, code its frames again; the bounds add up for them.",
)
@coded_effort_option
@part_options
def cut(
    *,
    source: str,
    output: str,
    frames: str | None,
    times: str | None,
    recode: bool,
    effort: EffortName,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Write some consecutive frames of a .pdeanim file as a file of their own, as they are coded.

    Frames are coded in groups, and cuts are made between them: elsewhere a cut is refused, and the nearest places are
    named; or with --recode the frames of a group that is cut through are coded again, from what they decode to, within
    the bound of the file: they are up to twice as far from what was encoded first. All other frames decode to the very
    same positions. Between frames positions follow a spline through all frames of the file: near a cut it is another
    one.
    """
    from pdecodec.codec.editing import cut_animation
    from pdecodec.codec.opening import open_animation

    if (frames is None) == (times is None):
        raise SettingsError("give either --frames or --times")
    _check_output(output, [source])
    with local_input(source) as path, local_output(output, overwrite=overwrite) as place:
        with open_animation(path) as animation:
            first, end = _frames(animation, frames or "") if times is None else _frames_at(animation, times)
        with progress_bar() as progress:
            report = cut_animation(
                path, place, first, end, recode=recode, effort=effort, overwrite=overwrite, progress=progress
            )
    _tell(report, output, as_json=as_json)


@click.command()
@click.argument("source", metavar="A")
@click.argument("others", metavar="B...", nargs=-1, required=True)
@output_option
@click.option("--shift", is_flag=True, help="Move the times of each B to one frame after what is before it.")
@click.option(
    "--recode", is_flag=True, help="Code frames of a .pdeanim of another model again; the bounds add up for them."
)
@coded_effort_option
@read_options
@part_options
def join(
    *,
    source: str,
    others: tuple[str, ...],
    output: str,
    shift: bool,
    recode: bool,
    effort: EffortName,
    overwrite: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Write A, a .pdeanim file, and what comes after it as one file.

    B may be a .pdeanim file that was cut from the same one as A: its groups of frames are taken as they are coded. Or
    it is a sequence of any other format, of the same mesh: its frames are coded with the reference frame, the functions
    of space and the bound of A, and nothing of A is coded again. All frames of A decode to the very same positions.
    """
    from contextlib import ExitStack

    from pdecodec.codec.editing import join_animations
    from pdecodec.formats.base.choosing import InputOptions, open_clip

    _check_output(output, [source, *others])
    with ExitStack() as stack:
        coming: list[str | MeshSequence] = []
        for other in others:
            if other.lower().endswith(".pdeanim"):
                coming.append(stack.enter_context(local_input(other)))
                continue
            sequence = stack.enter_context(open_clip(other, InputOptions(**reading)))
            say_notices(sequence.notices)
            coming.append(sequence)
        first = stack.enter_context(local_input(source))
        place = stack.enter_context(local_output(output, overwrite=overwrite))
        with progress_bar() as progress:
            report = join_animations(
                first,
                coming,
                place,
                shift=shift,
                recode=recode,
                effort=effort,
                overwrite=overwrite,
                progress=progress,
            )
    _tell(report, output, as_json=as_json)


def _check_output(output: str, sources: list[str]) -> None:
    if not output.lower().endswith(".pdeanim"):
        raise SettingsError("this writes .pdeanim files; for other formats use pdecodec decode", path=output)
    check_apart(sources, [output])


def _span(option: str, text: str, convert: Callable[[str], Number], remark: str) -> tuple[Number | None, Number | None]:
    """Both ends of A:B, None where one is left out."""
    found = SPAN.fullmatch(text)
    try:
        if found is None:
            raise ValueError
        begin, end = (convert(found[name]) if found[name] else None for name in ("begin", "end"))
    except ValueError as error:
        raise SettingsError(f"{option} {text}: write A:B, {remark}") from error
    return begin, end


def _frames(animation: Animation, text: str) -> tuple[int, int]:
    begin, end = _span("--frames", text, int, "positions counted from 0, B excluded")
    chosen = range(animation.frame_count)[begin:end]
    if not chosen:
        raise SettingsError(f"--frames {text}: none of the {animation.frame_count} frames is left")
    return chosen.start, chosen.stop


def _frames_at(animation: Animation, text: str) -> tuple[int, int]:
    import numpy as np

    times = animation.times
    begin, end = _span("--times", text, float, "seconds")
    first = 0 if begin is None else int(np.searchsorted(times, begin, "left"))
    stop = len(times) if end is None else int(np.searchsorted(times, end, "right"))
    if not first < stop:
        raise SettingsError(f"--times {text}: there is no frame; they run from {times[0]:g} to {times[-1]:g} s")
    return first, stop


def _tell(report: CutReport, output: str, *, as_json: bool) -> None:
    if as_json:
        print_json({"output": output, **vars(report)}, outputs_are_written=True)
    again = f"; {counted(report.coded_again, 'frame')} coded" if report.coded_again else ""
    say(
        f"{Path(output).name}: {counted(report.frames, 'frame')} in {counted(report.groups, 'group')}, "
        f"{report.first_time:g} to {report.last_time:g} s, {byte_size(report.file_bytes)}{again}"
    )
