"""`pdecodec convert`: convert mesh sequences between formats, streamed in blocks of frames."""

from __future__ import annotations

import time
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import extent, print_json, progress_bar, say, say_notices, say_rounding
from pdecodec.cli.jobs import Job, for_each_job, job_options, say_plan, say_start
from pdecodec.cli.options import (
    bytes_of,
    input_options,
    is_gltf,
    json_option,
    loudness_options,
    overwrite_option,
    rigid_bound,
    say_larger,
    within_limits,
    write_options,
)

if TYPE_CHECKING:
    from pdecodec.codec.settings import EncodeSettings
    from pdecodec.mesh.sequence import MeshSequence


@click.command()
@job_options
@input_options
@write_options
@within_limits
@overwrite_option
@loudness_options
@json_option
def convert(**options: Any) -> None:
    """Convert mesh sequences to another format.

    Frames are kept as they are; notes list what OUT's format cannot store. A .pdeanim IN is decoded at its frames; a
    .pdeanim OUT is encoded as by `pdecodec encode`, with the options of that command. Several IN go to a folder: -o
    folder/ --to glb. Frames that a shell lists (walk.*.obj) are one sequence. Velocities come from a .pdeanim IN
    itself; for other formats they are central differences.
    """
    for_each_job(_convert)(**options)


def _convert(
    job: Job,
    *,
    velocities: bool,
    web: bool,
    quantize: bool,
    meshopt: bool,
    straight: bool,
    rigid: bool | None,
    motion: EncodeSettings | None,
    scene: str,
    dry_run: bool,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Do one job; `options` are fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""
    from pdecodec.formats import write_sequence
    from pdecodec.formats.base.choosing import InputOptions, choose, open_whole
    from pdecodec.formats.base.companions import input_files, output_files
    from pdecodec.formats.base.scene_space import velocities_of
    from pdecodec.mesh.metrics import frame_scale
    from pdecodec.mesh.rounding import rounding_noticed

    started = time.perf_counter()
    source = job.source
    asked = InputOptions(**options)
    job.check([job.output], [asked.mesh], overwrite=overwrite, dry_run=dry_run)
    with open_whole(source, asked) as whole:
        sequence = choose(whole, asked, job.source_name)
        job = job.with_frames(sequence, dry_run=dry_run)
        bound = (
            None
            if velocities and not rigid
            else rigid_bound(
                whole, asked.scale, job.output, rigid, with_scene=scene == "keep", has_motion=motion is not None
            )
        )
        # Notices about materials and textures do not apply if OUT, a glTF file, keeps them.
        kept = getattr(whole, "notices_with_looks", whole.notices) if is_gltf(job.output) else whole.notices
        own = [one for one in sequence.notices if one not in whole.notices]
        say_notices([*kept, *own])
        say_start(job, sequence)

        def write(chosen: MeshSequence, path: str, **more: Any) -> tuple[str, ...]:
            speeds = velocities_of(chosen) if velocities else None
            more |= {"web": web, "quantize": quantize, "meshopt": meshopt, "straight": straight, "rigid": bound}
            more |= {"scene": scene, "motion": motion, "isolate": asked.isolate}
            more |= {"looks_of": whole} if is_gltf(path) else {}
            return write_sequence(chosen, path, velocities=speeds, **more)

        if dry_run:
            files = input_files(source)
            say_plan(job, sequence, write, files=len(files), size=bytes_of(source, files))
            return
        with progress_bar() as progress, rounding_noticed() as rounding:
            notices = write(sequence, job.output, overwrite=overwrite, progress=progress)
        before, after = (
            bytes_of(place, files(place)) for place, files in ((source, input_files), (job.output, output_files))
        )
        if rounding.largest:
            say_rounding(rounding.largest, frame_scale(sequence.read_frames(0, 1)[0]))
        counts = {"frames": sequence.frame_count, "vertices": sequence.most_vertices, "runs": len(sequence.runs)}
        size = extent(sequence)
    say_notices(notices)
    seconds = time.perf_counter() - started
    if as_json:
        print_json(
            {"output": job.output, **counts, "seconds": seconds, "notices": list(notices)}, outputs_are_written=True
        )
    say_larger(job.output_name, job.output, before, after, web or (quantize and meshopt))
    say(f"{job.output_name}: {size}, {seconds:.1f} s")
