"""`pdecodec decode`: decode a `.pdeanim` file to any other format, at its frames or at any other times."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, Self

import click

from pdecodec.cli.console import byte_size, counted, extent, print_json, progress_bar, say, say_notices
from pdecodec.cli.jobs import STREAM, Job, for_each_job, job_options, local_input, say_plan, say_start
from pdecodec.cli.options import (
    assets_option,
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
    say_larger,
    write_options,
)
from pdecodec.errors import InputError, PdecodecError, SettingsError

if TYPE_CHECKING:
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.salvaging import Salvage
    from pdecodec.codec.settings import EncodeSettings
    from pdecodec.codec.source import DecodeLimits
    from pdecodec.formats.base.choosing import InputOptions
    from pdecodec.mesh.sequence import MeshSequence
    from pdecodec.mesh.times import Outside

MUCH_OUTPUT = 10 * 10**9
"""Bytes of positions above which a note is printed: more than many disks have free, and a long wait."""


@click.command()
@job_options
@click.option("--at", multiple=True, type=float, metavar="T", help="Decode at this time [s]; may be repeated.")
@click.option("--times", metavar="FILE", help="Decode at the times that this text file lists [s].")
@click.option("--fps", type=float, metavar="F", help="Decode at this frame rate, from the first time to the last.")
@frames_option
@objects_option
@click.option(
    "--outside",
    type=click.Choice(["refuse", "clamp", "loop"]),
    default="refuse",
    show_default=True,
    help="What to do with a time before the first frame or after the last one.",
)
@click.option(
    "--onto",
    metavar="ORIGINAL",
    help="Write a copy of ORIGINAL with everything in it (materials, textures, cameras, skeletons, custom "
    "attributes), but with this motion instead of its own. For Alembic, USD, glTF, OBJ and Exodus; OUT has the "
    "same format.",
)
@click.option(
    "--clip", metavar="NAME", help="Animation of ORIGINAL that the motion replaces (glTF).  [default: the first]"
)
@click.option(
    "--layer", is_flag=True, help="USD: write only a layer over ORIGINAL with points, normals and velocities."
)
@assets_option(expose_value=False)
@write_options
@click.option(
    "--isolate",
    is_flag=True,
    help="Write the scene that IN carries in a subprocess, so that a malicious one cannot crash pdecodec.",
)
@place_options
@click.option(
    "--salvage",
    is_flag=True,
    help="Decode all undamaged frames of a damaged file, and list the missing ones.",
)
@limit_options
@overwrite_option
@loudness_options
@json_option
@click.pass_context
def decode(context: click.Context, /, **options: Any) -> None:
    """Decode .pdeanim files at their frames, or at any time.

    Velocities go into OUT if its format holds them (Alembic, USD), otherwise to a second file named OUT with
    '.velocities'. Times are sorted, and repeated times are dropped. One frame may go to a single .obj file; several
    frames go to a folder, a pattern (out.####.obj) or a file that holds them all. Several IN go to a folder: -o folder/
    --to glb.

    With --salvage the exit code is 1 if a file was decoded with parts missing, and 4 if nothing could be saved. Frames
    keep their own times; numbered files count up from the first frame.
    """
    if not for_each_job(_decode, only_animations=True)(**options):
        context.exit(PdecodecError.exit_code)


def _decode(
    job: Job,
    *,
    max_memory: int | None,
    max_output: int | None,
    salvage: bool,
    dry_run: bool,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> bool:
    """Do one job; return whether nothing is missing. `options` are fields of InputOptions and the classes below."""
    from pdecodec.formats.base.choosing import InputOptions

    started = time.perf_counter()
    source = job.source
    times, writing = _Times.taken(options), _Writing.taken(options)
    place = InputOptions(**{name: options[name] for name in ("objects", "up_axis", "scale", "unit")})
    times.check()
    refuse_pdeanim(job.output, "decode writes meshes; name another format")
    writing.check()
    outputs = writing.outputs(job.output)
    if len(outputs) > 1 and job.output_name == STREAM:
        raise SettingsError("-o -: this format puts velocities in a second file; name a file instead of -")
    job.check(outputs, [times.times, writing.onto], overwrite=overwrite, dry_run=dry_run)
    if Path(source).is_dir():
        raise InputError("is a folder; decode takes a .pdeanim file", code="invalid-input", path=source)
    if salvage and (times.given or writing.velocities):
        what = times.given[0] if times.given else "--velocities"
        raise SettingsError(f"--salvage decodes frames at their own times; leave out {what}")
    # --max-output limits the positions that are decoded, not the whole file.
    with _opened(source, decode_limits(max_memory, None), is_damaged=salvage) as (animation, saved):
        positions, speeds = _decoded(animation, times, place, job.source_name, with_speeds=writing.velocities)
        job = job.with_frames(positions, dry_run=dry_run)
        outputs[0] = job.output
        sequences = [positions] if speeds is None else [positions, speeds]
        _check_output(sequences, max_output, source)
        say_notices(positions.notices)
        if writing.leaves_scene_out(animation, positions, job.output):
            say("note: the scene of the file is left out, because objects are chosen, or turned or scaled")
        say_start(job, positions)
        bound = writing.rigid_bound(animation, place.scale, job.output)
        write = partial(writing.write, bound=bound)
        if dry_run:
            say_plan(job, positions, write, files=1, size=bytes_of(source, [Path(source)]))
            return saved is None or saved.is_whole
        inside = speeds if len(outputs) == 1 else None
        notices: dict[str, None] = {}
        for path, sequence in zip(outputs, sequences, strict=False):
            with progress_bar() as progress:
                found = write(sequence, path, overwrite=overwrite, velocities=inside, progress=progress)
            notices.update(dict.fromkeys(found))
        say_notices(notices)
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
            _say_missing(saved, job.source_name)
    if as_json:
        print_json(result, outputs_are_written=True)
    _say_written(job, result, size, writing)
    return saved is None or saved.is_whole


@dataclass(frozen=True)
class _Part:
    """A set of options that belong together."""

    @classmethod
    def taken(cls, options: Mapping[str, Any]) -> Self:
        return cls(**{item.name: options[item.name] for item in fields(cls)})


@dataclass(frozen=True)
class _Times(_Part):
    """The frames or the times to decode."""

    at: tuple[float, ...]
    times: str | None
    fps: float | None
    frames: str | None
    outside: Outside

    @property
    def given(self) -> list[str]:
        """Return the options that choose frames or times."""
        options = (("--at", self.at), ("--times", self.times), ("--fps", self.fps), ("--frames", self.frames))
        return [name for name, value in options if value]

    def check(self) -> None:
        if len(self.given) > 1:
            raise SettingsError(
                f"{' and '.join(self.given)} exclude each other; give one of them", code="conflicting-settings"
            )
        if self.outside != "refuse" and not (self.at or self.times):
            raise SettingsError(
                f"--outside {self.outside} is for times given with --at or --times; give them, or leave it out"
            )

    def of(self, animation: Animation) -> MeshSequence:
        """Return the animation at these times or frames."""
        from pdecodec.codec.resampling import sampled
        from pdecodec.formats.base.choosing import select_frames
        from pdecodec.mesh.times import times_at_rate

        if self.fps is not None:
            return sampled(animation, times_at_rate(float(animation.times[0]), float(animation.times[-1]), self.fps))
        for time_asked in self.at:
            if not math.isfinite(time_asked):
                raise SettingsError(f"--at {time_asked}: is not a time; give seconds")
        wanted = list(self.at) if self.times is None else _read_times(self.times)
        if wanted:
            return sampled(animation, sorted(set(wanted)), outside=self.outside)
        return select_frames(animation, self.frames)


@dataclass(frozen=True)
class _Writing(_Part):
    """How to write the decoded frames."""

    velocities: bool
    web: bool
    quantize: bool
    meshopt: bool
    straight: bool
    rigid: bool | None
    motion: EncodeSettings | None
    onto: str | None
    clip: str | None
    layer: bool
    scene: Literal["keep", "drop"]
    isolate: bool

    def check(self) -> None:
        if self.onto is None and (self.layer or self.clip):
            raise SettingsError(f"{'--layer' if self.layer else '--clip'} is for --onto; leave it out")
        if self.onto is not None and (self.quantize or self.web):
            name = "--web" if self.web else "--quantize"
            raise SettingsError(f"{name} would move the nodes of the original; leave it out, or --onto")
        if self.rigid and (self.onto is not None or self.velocities):
            other = "--onto" if self.onto else "--velocities"
            raise SettingsError(f"--rigid adds moving nodes; leave it out, or {other}")

    def leaves_scene_out(self, source: MeshSequence, chosen: MeshSequence, output: str) -> bool:
        """Return whether a scene would be written if the output had all objects, at their place."""
        from pdecodec.formats.base.opening import carries_scene_of
        from pdecodec.formats.base.registry import format_to_write

        entry = format_to_write(output)
        is_kept = self.scene == "keep" and self.onto is None
        return is_kept and carries_scene_of(source, entry) and not carries_scene_of(chosen, entry)

    def rigid_bound(self, source: MeshSequence, scale: float, output: str) -> float | None:
        """Return the bound within which objects count as rigid; None if rigid parts are not to be found."""
        if self.onto is not None or self.velocities:
            return None
        has_motion, with_scene = self.motion is not None, self.scene == "keep"
        return rigid_bound(source, scale, output, self.rigid, with_scene=with_scene, has_motion=has_motion)

    def outputs(self, output: str) -> list[str]:
        """Return the output for positions, and one for velocities if its format does not hold them."""
        return [output, _velocity_path(output)] if self.velocities and not _holds_velocities(output) else [output]

    def write(self, sequence: MeshSequence, path: str, *, bound: float | None, **options: Any) -> tuple[str, ...]:
        """Write a sequence, its rigid parts (within `bound`) as nodes; return notices about losses."""
        if self.onto is not None:
            from pdecodec.formats import write_onto

            return write_onto(
                sequence,
                self.onto,
                path,
                clip=self.clip,
                layer=self.layer,
                **self._settings("meshopt", "straight", "motion"),
                **options,
            )
        from pdecodec.formats import write_sequence

        settings = self._settings("web", "quantize", "meshopt", "straight", "motion", "isolate")
        return write_sequence(sequence, path, rigid=bound, scene=self.scene, **settings, **options)

    def _settings(self, *names: str) -> dict[str, Any]:
        return {name: getattr(self, name) for name in names}

    @property
    def is_small(self) -> bool:
        """Return whether every option is set that makes a glTF file smaller."""
        return self.web or (self.meshopt and (self.quantize or self.onto is not None))


def _decoded(
    animation: MeshSequence, times: _Times, place: InputOptions, name: str, *, with_speeds: bool
) -> tuple[MeshSequence, MeshSequence | None]:
    """Return the positions to write, and the velocities if requested. A salvaged sequence keeps its remaining
    frames.
    """
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.resampling import sampled
    from pdecodec.formats.base.choosing import choose

    chosen = times.of(animation) if isinstance(animation, Animation) else animation
    positions = choose(chosen, place, name)
    if not with_speeds:
        return positions, None
    assert isinstance(animation, Animation)
    speeds = sampled(animation, chosen.times, quantity="velocities", outside=times.outside)
    return positions, choose(speeds, place, name)


def _say_written(job: Job, result: Mapping[str, Any], size: str, writing: _Writing) -> None:
    from pdecodec.formats.base.companions import output_files

    outputs = result["outputs"]
    written = sum(bytes_of(path, output_files(path)) for path in outputs)
    before, raw = bytes_of(job.source, [Path(job.source)]), byte_size(result["raw_bytes"] * len(outputs))
    say_larger(job.output_name, job.output, before, written, writing.is_small)
    say(
        f"{' and '.join([job.output_name, *outputs[1:]])}: "
        f"in {byte_size(before)} -> out {byte_size(written)} "
        f"({raw} of {'positions and velocities' if writing.velocities else 'positions'}), "
        f"{size}, {result['seconds']:.1f} s"
    )


@contextmanager
def _opened(source: str, limits: DecodeLimits, *, is_damaged: bool) -> Iterator[tuple[MeshSequence, Salvage | None]]:
    """Yield the animation; for a damaged file its undamaged frames, and the list of missing parts."""
    if is_damaged:
        from pdecodec.codec.salvaging import salvage

        with local_input(source) as path, salvage(path, limits=limits) as saved:
            yield saved.sequence, saved
        return
    from pdecodec.codec.opening import open_animation

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
    """Refuse outputs above the limit `most` [bytes]; without a limit, print a note about a very large output."""
    size = sum(12 * sequence.position_count for sequence in sequences)
    what = f"{extent(sequences[0])}, {byte_size(size)}"
    if most is not None and size > most:
        message = f"declares {what}, and --max-output allows {byte_size(most)}"
        raise InputError(f"{message}; choose --frames or --object, or raise it", code="output-limit", path=path)
    if most is None and size > MUCH_OUTPUT:
        say(f"note: {path} declares {what} to be decoded; --max-output refuses files that declare more than you expect")


def _holds_velocities(output: str) -> bool:
    from pdecodec.formats.base.registry import known_extensions

    return Path(output).suffix.lower() in known_extensions(lambda entry: entry.holds_velocities)


def _velocity_path(output: str) -> str:
    from pdecodec.formats.base.registry import known_extensions

    path = Path(output)
    holds_all_frames = known_extensions(lambda entry: entry.writes and not entry.frame_per_file)
    if path.suffix.lower() not in holds_all_frames:
        raise SettingsError(f"--velocities are written as {', '.join(holds_all_frames)}; name such a file", path=output)
    return str(path.with_name(f"{path.stem}.velocities{path.suffix}"))


def _read_times(path: str) -> list[float]:
    """Return the times in a text file: numbers separated by blanks, commas or line ends."""
    try:
        words = Path(path).read_text(encoding="utf-8").replace(",", " ").split()
    except UnicodeDecodeError as error:
        raise InputError("this is not a text file of times in seconds", path=path, code="invalid-times") from error
    try:
        numbers = [float(word) for word in words]
    except ValueError as error:
        raise InputError(
            f"{error}; list times in seconds, separated by blanks or line ends", path=path, code="invalid-times"
        ) from error
    if not numbers:
        raise InputError("this file lists no times; list times in seconds", path=path, code="invalid-times")
    for number in numbers:
        if not math.isfinite(number):
            raise InputError(f"{number} is not a time; list times in seconds", path=path, code="invalid-times")
    return numbers
