"""`pdecodec encode`: a mesh sequence into a `.pdeanim` file."""

from __future__ import annotations

from dataclasses import fields
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import byte_size, print_json, progress_bar, ratio, say, say_alternatives, say_notices
from pdecodec.cli.jobs import SAMPLES, Job, for_each_job, job_options, say_plan, say_sizes, say_start
from pdecodec.cli.options import (
    bytes_of,
    decode_limits,
    effort_option,
    fraction,
    input_options,
    json_option,
    loudness_options,
    max_output_option,
    overwrite_option,
    parse_bytes,
)
from pdecodec.errors import SettingsError, naming_file

if TYPE_CHECKING:
    from pdecodec.codec.encode.report import EncodeReport
    from pdecodec.codec.settings import EncodeSettings
    from pdecodec.mesh.sequence import MeshSequence

SAMPLED_POSITIONS = 2**20
"""A clip of no more is encoded for --dry-run, in a second or two, to tell how large its file becomes; of a longer one
so much, for the file to grow on evenly: of its first few frames hardly anything follows."""


@click.command()
@job_options
@click.option(
    "--tolerance",
    type=fraction,
    metavar="X|P%",
    help="Largest vertex distance allowed, as a fraction of the diagonal of frame 0's bounding box, or in percent of "
    "it. Default 0.001 (0.1%); none under --profile paper.",
)
@click.option("--max-error", type=float, metavar="X", help="The same in scene units, instead of --tolerance.")
@click.option(
    "--rms",
    type=fraction,
    metavar="X|P%",
    help="Root mean square vertex distance allowed, as a fraction of the same diagonal, instead of --tolerance; "
    "encodes several times.",
)
@click.option(
    "--size",
    callback=parse_bytes,
    metavar="BYTES",
    help="Largest file, such as 200kB or 1.5MiB, as accurate as fits, instead of --tolerance; encodes several times.",
)
@click.option(
    "--profile",
    type=click.Choice(["auto", "paper"]),
    default="auto",
    show_default=True,
    help="auto: what costs least at the asked accuracy. paper: the functions of Fang et al. 2024 in closed form, "
    "32 coefficients per curve, axis and segment of time.",
)
@click.option("--segment-frames", type=int, metavar="N", help="Frames of a time segment, 11 by default. Profile paper.")
@click.option(
    "--piece-points", type=int, metavar="N", help="Points of a curve piece, whole curves by default. Profile paper."
)
@click.option(
    "--alpha", type=float, metavar="X", help="Rate of the time functions (Eq. 12); chosen by error. Profile paper."
)
@click.option(
    "--r", type=float, metavar="X", help="Rate of the space functions (Eqs. 14, 16); chosen by error. Profile paper."
)
@click.option(
    "--group-frames",
    type=int,
    metavar="N",
    help="Frames of a group at most: a file that is streamed from afar, or cut, is read by whole groups. Profile auto.",
)
@click.option(
    "--uv-tolerance",
    type=float,
    metavar="X",
    help="How far texture coordinates may be off, such as 1e-4 (of the texture); they are kept exactly by default.",
)
@click.option(
    "--order",
    type=click.Choice(["keep", "free"]),
    default="keep",
    show_default=True,
    help="keep: vertices and faces come back in the order they have. free: in one that costs no bytes.",
)
@effort_option("fast: no search on large clips, for previews. best: all bases, for archives. Profile auto.")
@click.option(
    "--why",
    is_flag=True,
    help="Tell what else was tried and what it would have cost, and keep that in the file for pdecodec info --why. "
    "Takes no more time.",
)
@click.option(
    "--max-memory",
    callback=parse_bytes,
    metavar="BYTES",
    help="Memory to encode within, about, such as 1G: groups of frames become shorter, which costs bytes; and what a "
    ".pdeanim IN may ask for.",
)
@max_output_option
@input_options
@overwrite_option
@loudness_options
@json_option
def encode(*, extension: str | None, max_output: int | None, **options: Any) -> None:
    """Encode mesh sequences into .pdeanim files.

    The error bound holds for every vertex at every frame of IN, in the float32 positions that decoding returns. Of
    float64 positions those that they are rounded to count, and a warning says where that moves them beyond the bound.
    Several IN go to a folder: -o folder/.
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
    **options: Any,
) -> None:
    """Do one job; `options` are fields of the two classes of settings and of InputOptions."""
    from pdecodec.codec.encoding import encode as encode_sequence
    from pdecodec.codec.settings import EncodeSettings, PaperSettings
    from pdecodec.formats.base.choosing import InputOptions, open_clip
    from pdecodec.formats.base.companions import input_files

    source, output = job.source, job.output
    settings, paper = (
        {item.name: options.pop(item.name) for item in fields(kind) if item.name in options}
        for kind in (EncodeSettings, PaperSettings)
    )
    if sum(value is not None for value in (settings["tolerance"], settings["max_error"], rms, size)) > 1:
        raise SettingsError(
            "give one of --tolerance, --max-error, --rms and --size, not several", code="conflicting-settings"
        )
    given: dict[str, Any] = {name: value for name, value in paper.items() if value is not None}
    checked = EncodeSettings(**settings, paper=PaperSettings(**given))
    if not output.lower().endswith(".pdeanim"):
        raise SettingsError(f"{output}: encode writes .pdeanim files; for other formats use pdecodec convert")
    asked = InputOptions(**options)
    job.check([output], [asked.mesh], overwrite=overwrite, dry_run=dry_run)
    with open_clip(source, asked, name=job.source_name) as sequence:
        say_notices(sequence.notices)
        say_start(job, sequence)
        files = input_files(source)
        source_bytes = bytes_of(source, files)
        if dry_run:
            if size is not None:
                say_sizes(job, sequence, f"at most {byte_size(size)}", files=len(files), size=source_bytes)
                return

            def write(some: MeshSequence, path: str) -> object:
                return encode_sequence(some, path, checked, rms=rms)

            count = max(SAMPLES[-1], SAMPLED_POSITIONS // sequence.most_vertices)
            say_plan(job, sequence, write, files=len(files), size=source_bytes, samples=(count // 2, count))
            return
        with progress_bar() as progress, naming_file(source):
            report = encode_sequence(
                sequence, output, checked, rms=rms, size=size, overwrite=overwrite, progress=progress
            )
        if as_json:
            print_json(_as_json(report, output, source_bytes, checked), outputs_are_written=True)
    say(report.summary)
    say_alternatives(report.alternatives)
    if report.bound is not None and (rms is not None or size is not None):
        say(f"tolerance {report.bound / report.scale:.4g} taken, rms error {report.rms_error / report.scale:.3g}")
    bound = "no bound" if report.bound is None else f"bound {report.bound:.3g}"
    say(
        f"in {byte_size(source_bytes)} ({byte_size(report.raw_bytes)} of positions) -> "
        f"out {byte_size(report.file_bytes)} "
        f"({ratio(report.raw_bytes, report.file_bytes)}), "
        f"max error {report.max_error:.3g} scene units ({bound}), {report.seconds:.1f} s"
    )
    for warning in report.warnings:
        say(f"warning: {warning}")


def _as_json(report: EncodeReport, output: str, input_size: int, settings: EncodeSettings) -> dict[str, Any]:
    """The report with the names and ratios that scripts want."""
    from pdecodec.codec.container import CONSTANT_SECTIONS
    from pdecodec.codec.encode.report import to_json
    from pdecodec.mesh.metrics import bits_per_vertex_frame

    constant = sum(report.sections.get(name, 0) for name in CONSTANT_SECTIONS)
    same = (
        "frames", "vertices", "raw_bytes", "runs", "bound", "max_error", "rms_error", "rounding", "seconds", "groups",
        "patches", "functions_of_space", "coefficients", "residuals", "sections", "summary", "jumps",
    )  # fmt: skip
    return {
        "output": output,
        "input_bytes": input_size,
        "output_bytes": report.file_bytes,
        "ratio": report.raw_bytes / report.file_bytes,
        "bpvf": bits_per_vertex_frame(report.file_bytes - constant, vertices=report.raw_bytes // 12, frames=1),
        "diagonal": report.scale,
        "profile": settings.profile,
        **{name: getattr(report, name) for name in same},
        "alternatives": to_json(report.alternatives),
    }
