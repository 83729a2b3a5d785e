"""`pdecodec convert`: a mesh sequence from one format to another, streamed by blocks of frames."""

from __future__ import annotations

import time

import click

from pdecodec.cli.console import extent, print_json, progress_bar, say, say_notices
from pdecodec.cli.options import (
    check_apart,
    check_output,
    fps_option,
    frames_option,
    json_option,
    objects_option,
    output_option,
    overwrite_option,
    refuse_pdeanim,
    select_frames,
    select_objects,
)


@click.command()
@click.argument("source", metavar="IN")
@output_option
@frames_option
@objects_option
@fps_option
@overwrite_option
@json_option
def convert(
    *,
    source: str,
    output: str,
    frames: str | None,
    objects: tuple[str, ...],
    fps: float | None,
    overwrite: bool,
    as_json: bool,
) -> None:
    """Convert a mesh sequence to another format.

    Frames are kept as they are. IN may be a .pdeanim file, which is decoded at its frames; OUT may not: encoding has
    settings of its own, so it is `pdecodec encode`.
    """
    from pdecodec.formats import open_sequence, write_sequence

    started = time.perf_counter()
    refuse_pdeanim(output, f"use pdecodec encode {source} -o {output}")
    check_output(output, overwrite=overwrite)
    check_apart(source, [output])
    with open_sequence(source, fps=fps) as whole:
        say_notices(whole)
        sequence = select_objects(select_frames(whole, frames), objects)
        with progress_bar() as progress:
            write_sequence(sequence, output, overwrite=overwrite, progress=progress)
        counts = {"frames": sequence.frame_count, "vertices": sequence.vertex_count}
    seconds = time.perf_counter() - started
    if as_json:
        print_json({"output": output, **counts, "seconds": seconds})
    say(f"{output}: {extent(**counts)}, {seconds:.1f} s")
