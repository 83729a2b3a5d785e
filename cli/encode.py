"""`pdecodec encode`: encode mesh sequences into `.pdeanim` files."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import (
    byte_size,
    in_options,
    print_json,
    progress_bar,
    ratio,
    say,
    say_alternatives,
    say_notices,
    things,
)
from pdecodec.cli.jobs import SAMPLES, Job, for_each_job, job_options, say_plan, say_sizes, say_start
from pdecodec.cli.options import (
    bytes_of,
    decode_limits,
    fraction,
    input_options,
    json_option,
    loudness_options,
    max_output_option,
    overwrite_option,
    parse_bytes,
    parse_fields,
)
from pdecodec.errors import Notice, SettingsError, naming_file

if TYPE_CHECKING:
    from pdecodec.codec.encode.report import EncodeReport
    from pdecodec.codec.presets import PresetName
    from pdecodec.codec.settings import EncodeSettings
    from pdecodec.mesh.sequence import MeshSequence

SAMPLED_POSITIONS = 2**20
"""Positions that --dry-run encodes at most, in a second or two, to estimate the size of the file. The sample must be
this large for the file to grow linearly from there on: the first few frames predict little."""


@click.command()
@job_options
@click.option(
    "--preset",
    type=click.Choice(["preview", "default", "hero", "archive"]),
    help="What the file is for, instead of --tolerance. preview: tolerance 0.005, fast effort. default: tolerance "
    "0.001. hero: tolerance 0.001, or less if needed to keep 99 % of the normals within 2 degrees; encodes several "
    "times. archive: tolerance 0.00001, best effort, which is slow.",
)
@click.option(
    "--tolerance",
    type=fraction,
    metavar="X|P%",
    help="Largest error of a vertex, as a fraction of the diagonal of frame 0's bounding box, or in percent of it. "
    "Default 0.001 (0.1%); none with --profile paper.",
)
@click.option(
    "--max-error", type=float, metavar="X", help="Largest error of a vertex in scene units, instead of --tolerance."
)
@click.option(
    "--rms",
    type=fraction,
    metavar="X|P%",
    help="Largest root mean square error, as a fraction of the diagonal of frame 0's bounding box, instead of "
    "--tolerance; encodes several times.",
)
@click.option(
    "--size",
    callback=parse_bytes,
    metavar="BYTES",
    help="Largest size of the file, such as 200kB or 1.5MiB, with the smallest error that fits, instead of "
    "--tolerance; encodes several times.",
)
@click.option(
    "--profile",
    type=click.Choice(["auto", "paper"]),
    default="auto",
    show_default=True,
    help="auto: the smallest file at the requested accuracy. paper: the closed-form functions of Fang et al. 2024, 32 "
    "coefficients per curve, axis and time segment.",
)
@click.option("--segment-frames", type=int, metavar="N", help="Profile paper: frames per time segment.  [default: 11]")
@click.option(
    "--piece-points", type=int, metavar="N", help="Profile paper: points per piece of a curve.  [default: whole curves]"
)
@click.option(
    "--alpha",
    type=float,
    metavar="X",
    help="Profile paper: rate of the functions of time (Eq. 12).  [default: that of the smallest error]",
)
@click.option(
    "--r",
    type=float,
    metavar="X",
    help="Profile paper: rate of the functions of space (Eqs. 14, 16).  [default: that of the smallest error]",
)
@click.option(
    "--group-frames",
    type=int,
    metavar="N",
    help="Profile auto: largest number of frames per group. Streaming, random access and cutting work on whole groups.",
)
@click.option(
    "--uv-tolerance",
    type=float,
    metavar="X",
    help="Largest error of texture coordinates, such as 1e-4 (1 is the whole texture).  [default: lossless]",
)
@click.option(
    "--field-tolerance",
    type=fraction,
    default="0.001",
    show_default=True,
    metavar="X|P%",
    help="Largest error of values that change in time (stress, velocity, colours), as a fraction of the range of their "
    "field. Whole numbers and flags are exact.",
)
@click.option(
    "--field",
    "fields",
    multiple=True,
    callback=parse_fields,
    metavar="NAME=X",
    help="Largest error of one field: NAME=1e-4 of its range, NAME='0.5 units' of the field, NAME=exact, or NAME=drop "
    "to leave it out (UVs and colours stay as in the first frame). Repeatable.",
)
@click.option(
    "--order",
    type=click.Choice(["keep", "free"]),
    default="keep",
    show_default=True,
    help="keep: decode vertices and faces in their original order. free: decode them in an order that costs no bytes.",
)
@click.option(
    "--scene",
    type=click.Choice(["keep", "drop"]),
    default="keep",
    show_default=True,
    help="keep: the file also carries the scene around the motion in IN (cameras, materials, textures, custom data), "
    "for Alembic, USD, glTF, OBJ and Exodus; decoding to that format restores it. drop: encode the motion alone.",
)
@click.option(
    "--effort",
    type=click.Choice(["fast", "default", "best"]),
    help="Profile auto: fast skips the search on large clips; best tries all bases.  [default: that of --preset, "
    "otherwise default]",
)
@click.option(
    "--why",
    is_flag=True,
    help="Print which alternatives the encoder tried and what each would have cost, and keep that in the file for "
    "pdecodec info --why. Takes no extra time.",
)
@click.option(
    "--max-memory",
    callback=parse_bytes,
    metavar="BYTES",
    help="Approximate memory to encode within, such as 1G: groups of frames become shorter, which costs bytes. Also "
    "the limit for a .pdeanim IN.",
)
@max_output_option
@input_options
@overwrite_option
@loudness_options
@json_option
def encode(*, extension: str | None, max_output: int | None, **options: Any) -> None:
    """Encode mesh sequences into .pdeanim files.

    The error bound holds for every vertex at every frame of IN, in the float32 positions that decoding returns. Float64
    positions are rounded to float32 first; a warning tells if that alone exceeds the bound. Several IN go to a
    folder: -o folder/.
    """
    if extension is not None and extension.lstrip(".").lower() != "pdeanim":
        raise SettingsError(f"--to {extension}: encode writes .pdeanim files; for other formats use pdecodec convert")
    from pdecodec.codec.source import usual_limits

    limits = decode_limits(options["max_memory"], max_output)
    with usual_limits(limits):
        for_each_job(_encode, default="pdeanim")(extension=extension, **options)


def _encode(
    job: Job,
    *,
    dry_run: bool,
    overwrite: bool,
    as_json: bool,
    rms: float | None,
    size: int | None,
    preset: PresetName | None,
    **options: Any,
) -> None:
    """Do one job; `options` are fields of the two settings classes and of InputOptions."""
    from pdecodec.codec.encoding import encode as encode_sequence
    from pdecodec.codec.settings import EncodeSettings, PaperSettings, check_one_target
    from pdecodec.formats.base.choosing import InputOptions, open_clip
    from pdecodec.formats.base.companions import input_files
    from pdecodec.formats.base.frame_changes import is_about_loss

    source, output = job.source, job.output
    settings, paper = (
        {item.name: options.pop(item.name) for item in fields(kind) if item.name in options}
        for kind in (EncodeSettings, PaperSettings)
    )
    bounds = {f"--{name.replace('_', '-')}": settings[name] for name in ("tolerance", "max_error")}
    check_one_target({"--preset": preset, **bounds, "--rms": rms, "--size": size})
    given: dict[str, Any] = {name: value for name, value in paper.items() if value is not None}
    effort = settings.pop("effort")
    checked = EncodeSettings(**settings, paper=PaperSettings(**given))
    chosen: dict[str, Any] = {"rms": rms, "preset": preset, **({} if effort is None else {"effort": effort})}
    if not output.lower().endswith(".pdeanim"):
        raise SettingsError(f"{output}: encode writes .pdeanim files; for other formats use pdecodec convert")
    asked = InputOptions(**options)
    job.check([output], [asked.mesh], overwrite=overwrite, dry_run=dry_run)
    with open_clip(source, asked, name=job.source_name) as sequence:
        # Data that notices report as lost may be kept in the scene.
        lost = [one for one in sequence.notices if is_about_loss(one)]
        is_early = checked.scene == "drop" or sequence.carried is None
        say_notices(one for one in sequence.notices if is_early or one not in lost)
        say_start(job, sequence)
        files = input_files(source)
        source_bytes = bytes_of(source, files)
        if dry_run:
            if size is not None:
                say_sizes(job, sequence, f"at most {byte_size(size)}", files=len(files), size=source_bytes)
                return

            def write(some: MeshSequence, path: str) -> object:
                return encode_sequence(some, path, checked, **chosen)

            count = max(SAMPLES[-1], SAMPLED_POSITIONS // sequence.most_vertices)
            say_plan(job, sequence, write, files=len(files), size=source_bytes, samples=(count // 2, count))
            return
        with progress_bar() as progress, naming_file(source):
            report = encode_sequence(
                sequence, output, checked, size=size, overwrite=overwrite, progress=progress, **chosen
            )
        if as_json:
            print_json(_as_json(report, output, source_bytes, checked), outputs_are_written=True)
    if not (is_early or report.scene_bytes):
        say_notices(lost)
    say(report.summary)
    say_alternatives(report.alternatives)
    if report.bound is not None and (rms is not None or size is not None):
        say(f"tolerance {report.bound / report.scale:.4g} chosen, rms error {report.rms_error / report.scale:.3g}")
    if preset is not None and report.bound is not None:
        kept = "" if report.normal_p99 is None else f", 99 % of the normals within {report.normal_p99:.3g} degrees"
        say(f"preset {preset}: tolerance {report.bound / report.scale:.4g}{kept}")
    of_positions = ratio(report.raw_bytes, report.motion_bytes)
    apart = {"fields": report.field_bytes, "scene": report.scene_bytes}
    if any(apart.values()):
        others = " and ".join(f"{byte_size(size)} of {name}" for name, size in apart.items() if size)
        of_positions = (
            f"{others}; positions {byte_size(report.raw_bytes)} -> {byte_size(report.motion_bytes)}, {of_positions}"
        )
    bound = "no bound" if report.bound is None else f"bound {report.bound:.3g}"
    say(
        f"in {byte_size(source_bytes)} ({byte_size(report.raw_bytes)} of positions) -> "
        f"out {byte_size(report.file_bytes)} ({of_positions}), "
        f"max error {report.max_error:.3g} scene units ({bound}), {report.seconds:.1f} s"
    )
    if report.scene_bytes:
        say(
            f"scene: {things(report.scene)}: {byte_size(report.scene_bytes)} of {byte_size(report.file_bytes)}; "
            "--scene drop leaves it out"
        )
    for one in report.fields:
        kept = f"bound {one.bound:.3g}, max error {one.max_error:.3g}" if one.bound else "exact"
        how = f"; {one.coding}" if checked.why or not one.bytes else ""
        say(f"field {one.name}: {byte_size(one.bytes)}, range {one.smallest:.4g} to {one.largest:.4g}, {kept}{how}")
    for warning in report.warnings:
        parameters = click.get_current_context().command.params
        say(f"warning: {in_options(warning, parameters) if isinstance(warning, Notice) else warning}")


def _as_json(report: EncodeReport, output: str, input_size: int, settings: EncodeSettings) -> dict[str, Any]:
    """Return the report with the names and ratios that scripts expect."""
    from pdecodec.codec.container import CONSTANT_SECTIONS
    from pdecodec.codec.encode.report import fields_to_json, to_json
    from pdecodec.mesh.metrics import bits_per_vertex_frame

    constant = sum(report.sections.get(name, 0) for name in CONSTANT_SECTIONS)
    same = (
        "frames", "vertices", "raw_bytes", "runs", "bound", "max_error", "rms_error", "rounding", "seconds", "groups",
        "patches", "functions_of_space", "coefficients", "residuals", "sections", "summary", "jumps", "median_edge",
        "preset", "normal_p99",
    )  # fmt: skip
    return {
        "output": output,
        "input_bytes": input_size,
        "output_bytes": report.file_bytes,
        "ratio": report.raw_bytes / report.motion_bytes,
        "scene": {"bytes": report.scene_bytes, "contents": dict(report.scene)} if report.scene_bytes else None,
        "bpvf": bits_per_vertex_frame(report.file_bytes - constant, vertices=report.raw_bytes // 12, frames=1),
        "diagonal": report.scale,
        "profile": settings.profile,
        **{name: getattr(report, name) for name in same},
        "alternatives": to_json(report.alternatives),
        "fields": fields_to_json(report.fields),
    }
