"""`pdecodec decode`: a `.pdeanim` file into any other format, at its frames or at any other times."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import byte_size, counted, extent, print_json, progress_bar, say, say_notices
from pdecodec.cli.jobs import STREAM, Job, job_options, jobs, say_plan, say_start, streamed
from pdecodec.cli.options import (
    bytes_of,
    decode_limits,
    frames_option,
    json_option,
    limit_options,
    loudness_options,
    objects_option,
    overwrite_option,
    place_options,
    refuse_pdeanim,
    rigid_bound,
    write_options,
)
from pdecodec.errors import InputError, PdecodecError, SettingsError

if TYPE_CHECKING:
    from pdecodec.decoder import Animation, DecodeLimits
    from pdecodec.resample import Outside
    from pdecodec.salvaging import Salvage
    from pdecodec.sequence import MeshSequence

MUCH_OUTPUT = 10 * 10**9
"""Bytes of positions from which on a line is worth it: longer than most disks have room for, or a person waits for."""


@click.command()
@job_options
@click.option("--at", multiple=True, type=float, metavar="T", help="Decode at this time in seconds; may be repeated.")
@click.option("--times", metavar="FILE", help="Decode at the times in seconds that a text file lists.")
@click.option("--fps", type=float, metavar="F", help="Decode at a new frame rate, from the first time to the last.")
@frames_option
@objects_option
@click.option(
    "--outside",
    type=click.Choice(["refuse", "clamp", "loop"]),
    default="refuse",
    show_default=True,
    help="What a time before the first frame or after the last one means.",
)
@click.option(
    "--onto",
    metavar="ORIGINAL",
    help="Write ORIGINAL again, with all that it has (materials, textures, cameras, skeletons, custom attributes), and "
    "this motion in the place of its own: Alembic, USD, glTF and OBJ, OUT of the same format.",
)
@click.option("--clip", metavar="NAME", help="Which animation of ORIGINAL the motion replaces (glTF); the first.")
@click.option("--layer", is_flag=True, help="USD: write only a layer over ORIGINAL: points, normals and velocities.")
@write_options
@place_options
@click.option(
    "--salvage",
    is_flag=True,
    help="Of a damaged file, decode every frame that is not, and say which ones are missing.",
)
@limit_options
@overwrite_option
@loudness_options
@json_option
@click.pass_context
def decode(
    context: click.Context,
    /,
    *,
    paths: tuple[str, ...],
    output: str | None,
    extension: str | None,
    as_json: bool,
    **options: Any,
) -> None:
    """Decode .pdeanim files at their frames, or at any time.

    Velocities go into OUT where its format holds them (Alembic, USD), else to a second file, OUT with '.velocities'.
    Times are taken in increasing order, each once. One frame may go to a single .obj file, several go to a folder,
    a pattern (out.####.obj) or a file that holds them all. Several IN go
    to a folder: -o folder/ --to glb.

    With --salvage the exit code is 1 where a file was decoded and something of it is missing, 4 where nothing could be
    saved. Frames come at their own times; files numbered by frame count up from the first.
    """
    if output == STREAM and as_json:
        raise SettingsError("-o - and --json both want standard output; leave out one")
    whole = True
    for job in jobs(paths, output, extension=extension, dry_run=options["dry_run"]):
        with streamed(job, extension=extension or "", dry_run=options["dry_run"]) as one:
            whole &= _decode(one, as_json=as_json, **options)
    if not whole:
        context.exit(PdecodecError.exit_code)


def _decode(
    job: Job,
    *,
    at: tuple[float, ...],
    times: str | None,
    fps: float | None,
    frames: str | None,
    objects: tuple[str, ...],
    outside: Outside,
    velocities: bool,
    quantize: bool,
    meshopt: bool,
    rigid: bool,
    up_axis: str | None,
    scale: float,
    unit: str | None,
    max_memory: int | None,
    max_output: int | None,
    onto: str | None,
    clip: str | None,
    layer: bool,
    salvage: bool,
    dry_run: bool,
    overwrite: bool,
    as_json: bool,
) -> bool:
    """Do one job; returns whether nothing is missing."""
    from pdecodec.decoder import Animation
    from pdecodec.formats import write_onto, write_sequence
    from pdecodec.formats.choosing import select_objects
    from pdecodec.formats.companions import output_files
    from pdecodec.formats.scene_space import place
    from pdecodec.resample import sampled

    started = time.perf_counter()
    source, output = job.source, job.output
    given = [name for name, value in (("--at", at), ("--times", times), ("--fps", fps), ("--frames", frames)) if value]
    if len(given) > 1:
        raise SettingsError(f"{' and '.join(given)} exclude each other; give one of them")
    if outside != "refuse" and not (at or times):
        raise SettingsError(f"--outside {outside} is for times given with --at or --times; give them, or leave it out")
    refuse_pdeanim(output, "decode writes meshes; name another format")
    together = velocities and _holds_velocities(output)
    outputs = [output, _velocity_path(output)] if velocities and not together else [output]
    if onto is None and (layer or clip):
        raise SettingsError(f"{'--layer' if layer else '--clip'} is for --onto; leave it out")
    if onto is not None and quantize:
        raise SettingsError("--quantize would move the nodes of the original; leave it out, or --onto")
    if rigid and (onto is not None or velocities):
        raise SettingsError(f"--rigid moves nodes of its own; leave it out, or {'--onto' if onto else '--velocities'}")
    job.check(outputs, [times, onto], overwrite=overwrite, dry_run=dry_run)
    if Path(source).is_dir():
        raise InputError("is a folder; decode takes a .pdeanim file", path=source)
    if salvage and (given or velocities):
        raise SettingsError(f"--salvage gives frames as they are; leave out {given[0] if given else '--velocities'}")
    # What is decoded is compared with --max-output, not all of the file.
    limits = decode_limits(max_memory, None)
    with _opened(source, limits, is_damaged=salvage) as (animation, saved):
        chosen = animation
        if isinstance(animation, Animation):
            chosen = _chosen(animation, at=at, times=times, fps=fps, frames=frames, outside=outside)
        positions = place(select_objects(chosen, objects, job.source_name), up_axis=up_axis, scale=scale, unit=unit)
        bound = rigid_bound(animation, scale) if rigid else None
        sequences = [positions]
        speeds: MeshSequence | None = None
        if velocities:
            assert isinstance(animation, Animation)
            speeds = sampled(animation, chosen.times, quantity="velocities", outside=outside)
            speeds = place(select_objects(speeds, objects, job.source_name), up_axis=up_axis, scale=scale, unit=unit)
            sequences.append(speeds)
        _check_output(sequences, max_output, source)
        say_notices(positions)
        say_start(job, positions)

        def write(some: MeshSequence, path: str, **options: Any) -> tuple[str, ...]:
            if onto is not None:
                return write_onto(some, onto, path, clip=clip, layer=layer, meshopt=meshopt, **options)
            return write_sequence(some, path, quantize=quantize, meshopt=meshopt, rigid=bound, **options)

        if dry_run:
            say_plan(job, positions, write, files=1, size=bytes_of(source, [Path(source)]))
            return saved is None or saved.is_whole
        notices: dict[str, None] = {}
        for path, sequence in zip(outputs, sequences, strict=False):
            with progress_bar() as progress:
                inside = speeds if together else None
                found = write(sequence, path, overwrite=overwrite, velocities=inside, progress=progress)
            notices.update(dict.fromkeys(found))
        for notice in notices:
            say(f"note: {notice}")
        size = extent(positions)
        result: dict[str, Any] = {
            "outputs": outputs,
            "frames": positions.frame_count,
            "vertices": positions.most_vertices,
            "runs": len(positions.runs),
            "raw_bytes": 12 * positions.position_count,
            "seconds": time.perf_counter() - started,
        }
        if saved is not None:
            result |= {"missing_frames": saved.missing, "lost": saved.lost}
            _say_missing(saved, source)
    if as_json:
        print_json(result)
    written = sum(bytes_of(path, output_files(path)) for path in outputs)
    values = "positions and velocities" if velocities else "positions"
    say(
        f"{' and '.join([job.output_name, *outputs[1:]])}: "
        f"in {byte_size(bytes_of(source, [Path(source)]))} -> out {byte_size(written)} "
        f"({byte_size(result['raw_bytes'] * len(outputs))} of {values}), "
        f"{size}, {result['seconds']:.1f} s"
    )
    return saved is None or saved.is_whole


@contextmanager
def _opened(source: str, limits: DecodeLimits, *, is_damaged: bool) -> Iterator[tuple[MeshSequence, Salvage | None]]:
    """The animation; or what is undamaged of it, and what is missing."""
    if is_damaged:
        from pdecodec.salvaging import salvage

        with salvage(source, limits=limits) as saved:
            yield saved.sequence, saved
        return
    from pdecodec.decoder import open_animation

    with open_animation(source, limits=limits) as animation:
        yield animation, None


def _say_missing(saved: Salvage, source: str) -> None:
    count = sum(end - first for first, end in saved.missing)
    if count:
        ranges = ", ".join(f"{first}" if end == first + 1 else f"{first} to {end - 1}" for first, end in saved.missing)
        say(f"{source}: {count:,} of {counted(saved.frame_count, 'frame')} missing, counted from 0: {ranges}")
    for what in saved.lost:
        say(f"{source}: lost: {what}")
    if saved.is_whole:
        say(f"{source}: nothing is missing")


def _check_output(sequences: Sequence[MeshSequence], most: int | None, path: str) -> None:
    """Refuse what is more than is wanted; without a limit, say before it begins that it is a lot."""
    size = sum(12 * sequence.position_count for sequence in sequences)
    what = f"{extent(sequences[0])}, {byte_size(size)}"
    if most is not None and size > most:
        raise InputError(
            f"declares {what}, and --max-output allows {byte_size(most)}; choose --frames or --object, or raise it",
            path=path,
        )
    if most is None and size > MUCH_OUTPUT:
        say(f"note: {path} declares {what} to be decoded; --max-output refuses files that declare more than you expect")


def _holds_velocities(output: str) -> bool:
    from pdecodec.formats import list_formats

    suffix = Path(output).suffix.lower()
    return any(entry.holds_velocities and suffix in entry.extensions for entry in list_formats())


def _velocity_path(output: str) -> str:
    from pdecodec.formats import list_formats

    path = Path(output)
    holds_all_frames = [
        extension
        for entry in list_formats()
        if entry.writes and not entry.frame_per_file
        for extension in entry.extensions
    ]
    if path.suffix.lower() not in holds_all_frames:
        raise SettingsError(f"{output}: --velocities are written as {', '.join(holds_all_frames)}; name such a file")
    return str(path.with_name(f"{path.stem}.velocities{path.suffix}"))


def _chosen(
    animation: Animation,
    *,
    at: tuple[float, ...],
    times: str | None,
    fps: float | None,
    frames: str | None,
    outside: Outside,
) -> MeshSequence:
    """The animation at the times or frames asked for."""
    from pdecodec.formats.choosing import select_frames
    from pdecodec.resample import sampled, times_at_rate

    if fps is not None:
        return sampled(animation, times_at_rate(float(animation.times[0]), float(animation.times[-1]), fps))
    for time_asked in at:
        if not math.isfinite(time_asked):
            raise SettingsError(f"--at {time_asked}: is no time; give seconds")
    wanted = list(at) if times is None else _read_times(times)
    if wanted:
        return sampled(animation, sorted(set(wanted)), outside=outside)
    return select_frames(animation, frames)


def _read_times(path: str) -> list[float]:
    """Times of a text file: numbers apart by blanks, commas or line ends."""
    try:
        words = Path(path).read_text(encoding="utf-8").replace(",", " ").split()
    except UnicodeDecodeError as error:
        raise InputError("this is not a text file of times in seconds", path=path) from error
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise InputError(f"{error}; list times in seconds, apart by blanks or line ends", path=path) from error
    if not numbers:
        raise InputError("there is no time in it; list times in seconds", path=path)
    for number in numbers:
        if not math.isfinite(number):
            raise InputError(f"{number} is no time; list times in seconds", path=path)
    return numbers
