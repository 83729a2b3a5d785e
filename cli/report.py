"""`pdecodec report`: measure size, error and speed on your own data, compared with other methods."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pdecodec.cli.console import outputs_written, print_json, progress_bar, put, say, say_notices, visible
from pdecodec.cli.options import (
    assets_option,
    check_growth,
    effort_option,
    fps_option,
    fraction,
    growth_options,
    json_option,
    page_option,
    within_limits,
)
from pdecodec.errors import InputError
from pdecodec.system.storage import is_address

if TYPE_CHECKING:
    from pdecodec.codec.settings import EffortName
    from pdecodec.mesh.runs import ChangingSequence
    from pdecodec.mesh.sequence import ArraySequence

NAMED_PROFILES = ("auto", "paper")
"""The names of :data:`pdecodec.report.clips.measuring.PROFILES`, which a help page should not load."""


@click.command()
@click.argument("sources", metavar="IN...", nargs=-1, required=True)
@page_option
@click.option(
    "--tolerance",
    "tolerances",
    type=fraction,
    multiple=True,
    metavar="X|P%",
    help="Measure at this tolerance; may be repeated.  [default: 1e-2, 3e-3, 1e-3, 3e-4, 1e-4]",
)
@click.option(
    "--profile",
    "profiles",
    type=click.Choice(NAMED_PROFILES),
    multiple=True,
    help="Measure this profile; may be repeated.  [default: all]",
)
@click.option(
    "--baselines/--no-baselines", default=True, show_default=True, help="Also measure other methods, for comparison."
)
@effort_option("Effort of profile auto.")
@click.option(
    "--jobs",
    type=click.IntRange(1),
    default=2,
    show_default=True,
    metavar="N",
    help="Other methods measured at once; profiles are measured one at a time.",
)
@click.option(
    "--fresh", is_flag=True, help="Measure everything again, even if an earlier run into DIR has measured it."
)
@growth_options(
    "List what got better or worse since this report.json.",
    "With --compare: exit with code 1 if a file of pdecodec grew by more than this.",
)
@within_limits
@fps_option
@assets_option(expose_value=False)
@json_option
@click.pass_context
def report(
    context: click.Context,
    *,
    sources: tuple[str, ...],
    output: str,
    tolerances: tuple[float, ...],
    profiles: tuple[str, ...],
    baselines: bool,
    effort: EffortName,
    jobs: int,
    fresh: bool,
    compare: str | None,
    fail_if_larger: float | None,
    fps: float | None,
    as_json: bool,
) -> None:
    """Measure file size, error and speed for clips, and write a page of results.

    IN is a mesh sequence, or a folder of them. DIR receives one HTML page that works offline (index.html), its charts
    as PNG and SVG, their data as CSV, all results as JSON (report.json), and a summary in Markdown (summary.md), which
    is also printed. With several clips, each has a page in its own folder, and index.html covers all of them. All
    methods are compared at equal maximum error, on positions decoded from their bytes. Fields have a table of bits per
    value, compared in the same way.

    If the connectivity of a clip changes, the page gives the bytes per frame, faces included, compared with Draco.

    Measurements are kept in DIR (measurements.json): an interrupted run resumes where it stopped.
    """
    from pdecodec.codec.settings import EncodeSettings
    from pdecodec.formats.base.companions import check_exists
    from pdecodec.formats.base.registry import known_extensions
    from pdecodec.report.clips.comparison import read_measurements, too_large
    from pdecodec.report.clips.making import find_clips, make_report
    from pdecodec.report.clips.measuring import PROFILES, TOLERANCES, ReportPlan
    from pdecodec.research.baselines import available_baselines, face_baselines

    check_growth(compare, fail_if_larger)
    for tolerance in tolerances:
        EncodeSettings(tolerance=tolerance)
    old = None if compare is None else read_measurements(Path(compare))
    for source in filter(is_address, sources):
        message = "is an address, and report reads local files and folders; download it first"
        raise InputError(message, code="invalid-input", path=source)
    clips = find_clips(
        [Path(source) for source in sources],
        known_extensions(lambda entry: entry.reads),
        known_extensions(lambda entry: entry.reads and entry.frame_per_file),
    )
    for path in clips.values():
        check_exists(str(path))
    able, skipped = available_baselines() if baselines else ((), ())
    plan = ReportPlan(
        tolerances=tuple(sorted(set(tolerances or TOLERANCES), reverse=True)),
        profiles=tuple(profile for profile in PROFILES if profile in (profiles or PROFILES)),
        baselines=able,
        face_baselines=face_baselines() if baselines else (),
        effort=effort,
        jobs=jobs,
    )
    for reason in skipped:
        say(f"note: {reason}")
    with progress_bar() as progress:
        result = make_report(
            _opened(clips, fps),
            Path(output),
            plan,
            several=len(clips) > 1,
            skipped=skipped,
            old=old,
            fresh=fresh,
            progress=progress,
        )
    with outputs_written():
        if as_json:
            print_json(result.to_dict())
        else:
            put(visible(result.summary), nl=False)
    say(f"{result.page}: {result.measured} points measured, {result.kept} kept from an earlier run")
    failures = [
        f"{item.clip}, profile {item.coder}: the error exceeds the bound {item.tolerance:g}" for item in result.broken
    ]
    failures += [
        f"{item.clip}, field {item.field}: the error exceeds the bound" for item in result.fields if not item.within
    ]
    if fail_if_larger is not None:
        failures += [str(change) for change in too_large(result.changes, fail_if_larger)]
    for failure in failures:
        say(f"failed: {failure}")
    if failures:
        context.exit(1)


def _opened(clips: Mapping[str, Path], fps: float | None) -> Iterator[tuple[str, ArraySequence | ChangingSequence]]:
    """Yield the clips one after the other, in memory unless their connectivity changes."""
    from pdecodec.formats.base.choosing import InputOptions, open_clip, rate_to_assume
    from pdecodec.formats.base.transforms import bake_transforms
    from pdecodec.mesh.runs import ChangingSequence

    for name, path in clips.items():
        with open_clip(path, InputOptions(fps=rate_to_assume(path, fps))) as sequence:
            say_notices(sequence.notices)
            baked = bake_transforms(sequence)
            if isinstance(baked, ChangingSequence):
                yield name, baked
                continue
            whole = baked.to_array()
        yield name, whole
