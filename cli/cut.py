"""`pdecodec cut` and `pdecodec join`: cut and join `.pdeanim` files without coding their frames again."""

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
    from pdecodec.codec.edited_file import CutReport
    from pdecodec.codec.settings import EffortName
    from pdecodec.mesh.sequence import MeshSequence

SPAN = re.compile(r"\s*(?P<begin>[^:]*?)\s*:\s*(?P<end>[^:]*?)\s*")
"""``A:B``, each part optional."""

Number = TypeVar("Number", int, float)

coded_effort_option = effort_option("Effort for frames that are coded again or added.")

part_options = option_group(within_limits, overwrite_option, loudness_options, json_option)


@click.command()
@click.argument("source", metavar="FILE")
@output_option
@click.option(
    "--frames", metavar="A:B", help="Cut out these frames: positions counted from 0, B excluded, as in a Python slice."
)
@click.option("--times", metavar="A:B", help="Cut out the frames from time A to time B, both included [s].")
@click.option(
    "--recode",
    is_flag=True,
    help="If the cut goes through a group of frames, code its frames again; their error may reach twice the bound.",
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
    """Write consecutive frames of a .pdeanim file to a new file, without coding them again.

    Frames are coded in groups, and cuts fall between groups. A cut elsewhere is refused, and the message names the
    nearest possible ones. With --recode the frames of a group that is cut through are decoded and coded again within
    the bound of the file, so they may differ from the original input by up to twice that bound. All other frames decode
    to exactly the same positions. Between frames, positions follow a spline through all frames of a file; near a cut
    this spline changes.
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
@click.option(
    "--shift",
    is_flag=True,
    help="Shift the times of each B so that it starts one frame after the frames before it.",
)
@click.option(
    "--recode",
    is_flag=True,
    help="If a .pdeanim B has another model, code its frames again; their error may reach the sum of both bounds.",
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
    """Append sequences to A, a .pdeanim file, and write the result to a new file.

    If B is a .pdeanim file that was cut from the same file as A, its groups of frames are copied without coding them
    again. If B is a sequence of another format with the same mesh, its frames are coded with the reference frame, the
    spatial basis and the bound of A. All frames of A decode to exactly the same positions.
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
        raise SettingsError("the output is a .pdeanim file here; for other formats use pdecodec decode", path=output)
    check_apart(sources, [output])


def _span(option: str, text: str, convert: Callable[[str], Number], remark: str) -> tuple[Number | None, Number | None]:
    """Return both ends of A:B, None for one that is left out."""
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
        raise SettingsError(f"--frames {text}: selects none of the {animation.frame_count} frames; choose others")
    return chosen.start, chosen.stop


def _frames_at(animation: Animation, text: str) -> tuple[int, int]:
    import numpy as np

    times = animation.times
    begin, end = _span("--times", text, float, "seconds")
    first = 0 if begin is None else int(np.searchsorted(times, begin, "left"))
    stop = len(times) if end is None else int(np.searchsorted(times, end, "right"))
    if not first < stop:
        raise SettingsError(
            f"--times {text}: there is no frame in this interval; frames run from {times[0]:g} to {times[-1]:g} s"
        )
    return first, stop


def _tell(report: CutReport, output: str, *, as_json: bool) -> None:
    from pdecodec.codec.container import notices_of_unknown

    if as_json:
        print_json({"output": output, **vars(report)}, outputs_are_written=True)
    again = f"; {counted(report.coded_again, 'frame')} coded" if report.coded_again else ""
    say(
        f"{Path(output).name}: {counted(report.frames, 'frame')} in {counted(report.groups, 'group')}, "
        f"{report.first_time:g} to {report.last_time:g} s, {byte_size(report.file_bytes)}{again}"
    )
    if report.lost_fields:
        say(f"note: fields not kept: {', '.join(report.lost_fields)}; only some of the files have them")
    say_notices(notices_of_unknown(report.lost_sections))
