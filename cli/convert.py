"""`pdecodec convert`: a mesh sequence from one format to another, streamed by blocks of frames."""

from __future__ import annotations

import time
from typing import Any

import click

from pdecodec.cli.console import extent, print_json, progress_bar, say, say_notices
from pdecodec.cli.options import (
    check_apart,
    check_output,
    frames_option,
    json_option,
    objects_option,
    overwrite_option,
    place_options,
    read_options,
    refuse_pdeanim,
    select_frames,
    select_objects,
    write_options,
)
from pdecodec.errors import SettingsError


@click.command()
@click.argument("source", metavar="IN")
@click.argument("target", metavar="[OUT]", required=False)
@click.option("-o", "--output", metavar="OUT", help="File, folder or pattern to write; format by extension.")
@frames_option
@objects_option
@read_options
@place_options
@write_options
@overwrite_option
@json_option
def convert(
    *,
    source: str,
    target: str | None,
    output: str | None,
    frames: str | None,
    objects: tuple[str, ...],
    up_axis: str | None,
    scale: float,
    unit: str | None,
    velocities: bool,
    quantize: bool,
    meshopt: bool,
    overwrite: bool,
    as_json: bool,
    **reading: Any,
) -> None:
    """Convert a mesh sequence to another format.

    Frames are kept as they are; what OUT's format cannot hold is said. IN may be a .pdeanim file, which is decoded at
    its frames; OUT may not: encoding has settings of its own, so it is `pdecodec encode`. Velocities are a .pdeanim
    file's own, else central differences.
    """
    from pdecodec.formats import open_sequence, write_sequence
    from pdecodec.formats.scene_space import place, velocities_of

    started = time.perf_counter()
    if (target is None) == (output is None):
        raise SettingsError("name one output: pdecodec convert IN OUT, or with -o OUT")
    written = target or output or ""
    refuse_pdeanim(written, f"use pdecodec encode {source} -o {written}")
    check_output(written, overwrite=overwrite)
    check_apart(source, [written])
    with open_sequence(source, **reading) as whole:
        sequence = place(select_objects(select_frames(whole, frames), objects), up_axis=up_axis, scale=scale, unit=unit)
        say_notices(sequence)
        with progress_bar() as progress:
            notices = write_sequence(
                sequence,
                written,
                overwrite=overwrite,
                velocities=velocities_of(sequence) if velocities else None,
                progress=progress,
                quantize=quantize,
                meshopt=meshopt,
            )
        counts = {"frames": sequence.frame_count, "vertices": sequence.vertex_count}
    for notice in notices:
        say(f"note: {notice}")
    seconds = time.perf_counter() - started
    if as_json:
        print_json({"output": written, **counts, "seconds": seconds, "notices": list(notices)})
    say(f"{written}: {extent(**counts)}, {seconds:.1f} s")
