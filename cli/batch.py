"""`pdecodec batch`: every clip of a manifest, a pattern or a folder, resumable, several at once."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import (
    PartlyDoneError,
    byte_size,
    counted,
    in_options,
    print_json,
    progress_bar,
    put,
    ratio,
    say,
    visible,
)
from pdecodec.cli.encode import encode
from pdecodec.cli.options import (
    check_growth,
    growth_options,
    json_option,
    loudness_options,
    parse_bytes,
)
from pdecodec.errors import InputError, SettingsError
from pdecodec.system.storage import is_address

if TYPE_CHECKING:
    from pdecodec.batch.clips import Clip, ClipOptions
    from pdecodec.batch.work import Result, Work

SAID_EVERY = 30.0
"""Time between progress lines if standard error is not a terminal [s]."""

_OF_CLIPS = (
    "preset", "tolerance", "max_error", "rms", "size", "profile", "segment_frames", "piece_points", "alpha", "r",
    "group_frames", "uv_tolerance", "field_tolerance", "fields", "order", "scene", "effort", "frames", "objects",
    "fps", "mesh", "clip", "displacement", "solids", "transforms", "skip_unsupported", "isolate", "asset_folders",
    "up_axis", "scale", "unit",
)  # fmt: skip
"""Options of `encode` that apply to every clip whose manifest does not set them."""

PART = re.compile(r"(\d+)/(\d+)")


def _part(context: click.Context, parameter: click.Parameter, value: str | None) -> tuple[int, int] | None:
    """Click callback: parse ``3/40``."""
    if value is None:
        return None
    found = PART.fullmatch(value.strip())
    if found is None or not 1 <= int(found[1]) <= int(found[2]):
        raise click.BadParameter(f"{value!r} is not a part such as 3/40", context, parameter)
    return int(found[1]), int(found[2])


def _with_options_of_clips(command: click.Command) -> click.Command:
    at = next(index for index, one in enumerate(command.params) if one.name == "output") + 1
    command.params[at:at] = [one for one in encode.params if one.name in _OF_CLIPS]
    return command


@_with_options_of_clips
@click.command()
@click.argument("clips", metavar="MANIFEST|PATTERN|FOLDER|FILE...", nargs=-1, required=True)
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for the files; it is created if missing.")
@click.option(
    "--jobs", type=click.IntRange(1), metavar="N", help="Clips to encode at once.  [default: one per processor]"
)
@click.option(
    "--max-memory",
    callback=parse_bytes,
    metavar="BYTES",
    help="Estimated memory that clips encoded at once may take; other clips wait.  [default: most of the free memory]",
)
@click.option(
    "--dask",
    "scheduler",
    metavar="ADDRESS",
    help="Encode the clips on the workers of a Dask cluster: tcp://host:8786, or the path of its scheduler file.",
)
@click.option(
    "--part",
    callback=_part,
    metavar="K/N",
    help="Encode only every N-th clip, starting with the K-th; for render farms.",
)
@click.option("--verify", is_flag=True, help="Decode every file and measure its error against the source.")
@click.option(
    "--thorough",
    is_flag=True,
    help="Compare the contents of every source with those encoded before, even if its modification time is the same.",
)
@click.option("--dry-run", is_flag=True, help="Print what would be done with each clip; write nothing.")
@growth_options(
    "The summary.json of an earlier batch, for --fail-if-larger.",
    "With --compare: exit with code 1 if a file grew by more than this.",
)
@click.option("-y", "--overwrite", is_flag=True, help="Replace files in DIR that another batch or program wrote.")
@loudness_options
@json_option
@click.pass_context
def batch(
    context: click.Context,
    /,
    *,
    clips: tuple[str, ...],
    output: str,
    jobs: int | None,
    max_memory: int | None,
    scheduler: str | None,
    part: tuple[int, int] | None,
    verify: bool,
    thorough: bool,
    dry_run: bool,
    compare: str | None,
    fail_if_larger: float | None,
    overwrite: bool,
    as_json: bool,
    **options: Any,
) -> None:
    """Encode every clip of manifests, patterns, folders or lists of files.

    MANIFEST is a .csv, .json or .jsonl file. For each clip it has a source, and optionally an output and any option of
    a clip by its name here (tolerance, fps, up_axis); options on the command line apply to clips that do not set them.
    Quote a PATTERN ('shots/**/*.abc'). A FOLDER stands for every clip in it and its subfolders. Each FILE that a
    shell lists (shots/*.abc) is a clip, but the frames of a sequence (walk.*.obj) are one clip.

    An interrupted run resumes where it stopped: a clip is done if its file is complete and was made with the same
    options from the same source (DIR/.batch keeps the records). A clip that fails is reported in one line, and the
    others go on. The results are summarised in DIR: summary.csv, summary.json, summary.md.

    The exit code is 1 if a clip failed, or if a file grew (--fail-if-larger).
    """
    from pdecodec.batch.clips import clips_of
    from pdecodec.batch.summary import as_json as summary_json
    from pdecodec.batch.summary import grown, totals_of, write_summary
    from pdecodec.batch.work import Work

    check_growth(compare, fail_if_larger)
    if scheduler is not None and jobs is not None:
        raise SettingsError("--jobs is for this machine, and with --dask the workers' threads set it; leave out --jobs")
    chosen = clips_of(clips, _clip_options(options))
    if part is not None:
        chosen = chosen[part[0] - 1 :: part[1]]
    work = Work(folder=output, overwrite=overwrite, verify=verify, thorough=thorough)
    if dry_run:
        results = _planned(chosen, work)
    else:
        _make_folder(output)
        results = _done(chosen, work, jobs, max_memory, scheduler)
        if part is None:
            write_summary(results, output)
    failures = [in_options(one.error, context.command.params) for one in results if one.error is not None]
    failures += [] if fail_if_larger is None or compare is None else grown(results, Path(compare), fail_if_larger)
    for failure in failures:
        say(f"failed: {failure}", level=-1)
    totals = totals_of(results)
    states = ", ".join(f"{count:,} {state}" for state, count in sorted(totals.states.items()))
    sizes = f"in {byte_size(totals.source_bytes)} ({byte_size(totals.raw_bytes)} of positions) -> "
    sizes += f"out {byte_size(totals.bytes)} ({ratio(totals.raw_bytes, totals.motion_bytes)})"
    say(f"{counted(len(results), 'clip')}: {states}" + (f"; {sizes}" if totals.clips else ""))
    rounded = sum((item.figures.get("rounding") or 0) > (item.figures.get("bound") or math.inf) for item in results)
    if rounded:
        say(f"warning: rounding to float32 exceeds the bound of {counted(rounded, 'clip')}; -v lists them")
    if as_json:
        print_json(summary_json(results), outputs_are_written=not dry_run and not failures)
    if failures:
        context.exit(1)


def _clip_options(given: dict[str, Any]) -> ClipOptions:
    from pdecodec.batch.clips import ClipOptions

    return ClipOptions().with_values({name: value for name, value in given.items() if value is not None})


def _make_folder(folder: str) -> None:
    if is_address(folder):
        return
    try:
        Path(folder).mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"this folder cannot be created ({error.strerror or error})", code="output-unwritable", path=folder
        ) from error


def _planned(clips: Sequence[Clip], work: Work) -> list[Result]:
    """Return the state that each clip would have, and print it as soon as it is known."""
    from pdecodec.batch.work import plan_clip

    results = []
    for clip in clips:
        result = plan_clip(clip, work)
        what = {"planned": "encode", "kept": "keep"}.get(result.state, "fail")
        size = result.figures.get("source_bytes")
        put(visible(f"{what} {clip.source} -> {clip.output}" + (f" ({byte_size(size)})" if size else "")))
        results.append(result)
    return results


def _done(
    clips: Sequence[Clip], work: Work, jobs: int | None, max_memory: int | None, scheduler: str | None
) -> list[Result]:
    """Encode every clip; return the results in the order of the manifest."""
    from pdecodec.batch.cluster import run_on_cluster
    from pdecodec.batch.local import run_local

    found: dict[str, Result] = {}
    with _said(clips) as note, nullcontext() if scheduler is None else _logs_off():
        if scheduler is None:
            coming = run_local(clips, work, jobs=jobs, max_memory=max_memory)
        else:
            coming = run_on_cluster(clips, work, scheduler, max_memory=max_memory)
        try:
            for result in coming:
                found[result.output] = result
                note(result)
        except KeyboardInterrupt as error:
            through = f"{len(found):,} of {counted(len(clips), 'clip')}"
            raise PartlyDoneError(
                f"interrupted after {through}; their files are kept, and the same command resumes"
            ) from error
    return [found[clip.output] for clip in clips]


@contextmanager
def _logs_off() -> Iterator[None]:
    """Keep Dask's log off standard error: its tracebacks repeat errors that are reported in one line."""
    import logging

    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(logging.NOTSET)


@contextmanager
def _said(clips: Sequence[Clip]) -> Iterator[Callable[[Result], None]]:
    """Yield a function that reports progress: a bar on a terminal, otherwise a line now and then with the time left."""
    began = said = time.monotonic()
    done = kept = 0
    with progress_bar() as progress:

        def note(result: Result) -> None:
            nonlocal done, kept, said
            done, kept = done + 1, kept + (result.state == "kept")
            size = result.figures.get("bytes")
            what = result.message if result.state == "failed" else f"{byte_size(size or 0)}, {result.state}"
            say(f"{result.output}: {what}", level=1)
            for text in result.figures.get("notes") or ():
                say(f"{result.output}: note: {text}", level=1)
            if progress is not None:
                progress(done, len(clips), "clips")
            elif time.monotonic() - said >= SAID_EVERY:
                said = time.monotonic()
                # Clips that were kept are left out: they do not show how long a clip takes.
                left = (said - began) / max(1, done - kept) * (len(clips) - done)
                say(f"{done:,} of {counted(len(clips), 'clip')}, {left / 60:.0f} minutes left")

        yield note
