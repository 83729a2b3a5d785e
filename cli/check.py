"""`pdecodec check`: report every fault of `.pdeanim` files."""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import byte_size, counted, print_json, put, say, visible
from pdecodec.cli.jobs import STREAM, local_input
from pdecodec.cli.options import decode_limits, json_option, limit_options, loudness_options
from pdecodec.errors import CorruptFileError, InputError, SettingsError

if TYPE_CHECKING:
    from pdecodec.codec.checking import FileCheck
    from pdecodec.codec.mending import Finding


@click.command()
@click.argument("sources", metavar="FILE|-...", nargs=-1, required=True)
@click.option("--deep", is_flag=True, help="Also decode everything, within the limits.")
@limit_options
@loudness_options
@json_option
@click.pass_context
def check(
    context: click.Context,
    *,
    sources: tuple[str, ...],
    deep: bool,
    max_memory: int | None,
    max_output: int | None,
    as_json: bool,
) -> None:
    """Check .pdeanim files for faults: structure, checksums and ranges; with --deep also by decoding everything.

    A FILE may be an address (https://...) or, once, - for standard input. Findings go to standard output, one per line,
    or as JSON; each begins with a stable code (see docs/errors.md). The exit code is 4 if any finding is more than a
    note.
    """
    from pdecodec.codec.checking import FileCheck, check_file

    for source in sources:
        if Path(source).is_dir():
            raise InputError("is a folder; check takes .pdeanim files", code="invalid-input", path=source)
    if sources.count(STREAM) > 1:
        raise SettingsError("standard input can be read only once; leave out one -")
    limits = decode_limits(max_memory, max_output)
    checked, sizes = list[FileCheck](), list[int]()
    for source in sources:
        with local_input(source) as path:
            checked.append(dataclasses.replace(check_file(path, deep=deep, limits=limits), path=source))
            sizes.append(Path(path).stat().st_size)
    if as_json:
        print_json({"files": [_as_json(one) for one in checked]})
    for one, size in zip(checked, sizes, strict=True):
        if not as_json:
            for finding in one.findings:
                put(visible(f"{one.path}: {_line(finding)}"))
        say(f"{one.path}: {_summary(one, size)}")
    if not all(one.is_sound for one in checked):
        context.exit(CorruptFileError.exit_code)


def _line(finding: Finding) -> str:
    place = "" if finding.run is None else f"run {finding.run}: "
    if finding.frames is not None:
        first, end = finding.frames
        place += f"frames {first} to {end - 1}: "
    if finding.offset is not None:
        place += f"byte {finding.offset}: "
    return f"{finding.code}: {place}{finding.message}"


def _summary(checked: FileCheck, size: int) -> str:
    errors = sum(finding.severity == "error" for finding in checked.findings)
    what = "decoded" if checked.is_deep else "checked"
    extent = f"{counted(checked.frames, 'frame')} in {counted(checked.groups, 'group')} {what}"
    return f"{'sound' if checked.is_sound else counted(errors, 'fault')}, {byte_size(size)}, {extent}"


def _as_json(checked: FileCheck) -> dict[str, Any]:
    return {
        "path": checked.path,
        "sound": checked.is_sound,
        "deep": checked.is_deep,
        "frames": checked.frames,
        "runs": checked.runs,
        "groups": checked.groups,
        "findings": [dataclasses.asdict(finding) for finding in checked.findings],
    }
