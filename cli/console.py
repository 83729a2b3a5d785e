"""Output for people on standard error, data on standard output."""

from __future__ import annotations

import io
import json
import os
import sys
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, nullcontext, suppress
from typing import TYPE_CHECKING, Any

import click

from pdecodec.errors import Notice, PdecodecError, unreadable

if TYPE_CHECKING:
    from pdecodec.codec.encode.report import Question
    from pdecodec.mesh.sequence import MeshSequence, Progress

PIPE_WIDTH = 200
"""Width of a table that goes to a file or a pipe [columns]."""


STANDARD_OUTPUT = "standard output"
"""The name of standard output in errors."""


class PartlyDoneError(Exception):
    """A command was interrupted after part of its work; the message replaces the usual one."""


class ReportLostError(PdecodecError):
    """The outputs are written, but their results could not be printed on standard output."""

    exit_code = 6


class _NamedOutput(io.FileIO):
    """Standard output that names itself in errors."""

    def write(self, data: Any) -> int | None:  # type: ignore[override]
        try:
            return super().write(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, STANDARD_OUTPUT) from None


def open_streams() -> None:
    """Open closed standard streams on the null device, and give standard output its name in errors.

    Otherwise the next file to be opened takes the number of a closed stream, and gets whatever is written to it. The
    null device is opened for the opposite direction of input and output, so that reading and writing fail and no result
    is lost without an error. Text for a closed standard error is dropped.
    """
    if sys.stdin is None:
        sys.stdin = os.fdopen(_open_null(os.O_WRONLY), "r", closefd=False)
    if sys.stdout is None or not sys.stdout.isatty():
        number = _open_null(os.O_RDONLY) if sys.stdout is None else sys.stdout.fileno()
        encoding, errors = (None, None) if sys.stdout is None else (sys.stdout.encoding, sys.stdout.errors)
        data = io.BufferedWriter(_NamedOutput(number, "w", closefd=False))
        sys.stdout = io.TextIOWrapper(data, encoding, errors)
    if sys.stderr is None:
        sys.stderr = os.fdopen(_open_null(os.O_WRONLY), "w", closefd=False)


def _open_null(flags: int) -> int:
    """Return the number of a new stream: the lowest that is free, which is that of the closed one."""
    number = os.open(os.devnull, flags)
    os.set_inheritable(number, True)
    return number


def drop_unwritten() -> None:
    """Drop text that standard streams could not take: at exit Python would try again, and change the exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(_open_null(os.O_WRONLY), stream.fileno())


def unwritable_output(error: OSError) -> PdecodecError:
    """Return the error for standard output that cannot be written to."""
    return unreadable(error, STANDARD_OUTPUT, "check where it goes", doing="written")


_loudness = 0


def set_loudness(level: int) -> None:
    """Set how much is printed: -1 errors only, 0 results and notes, 1 progress messages too."""
    global _loudness
    _loudness = level


def visible(text: str) -> str:
    """Return text that cannot control a terminal: control and bidirectional characters become escapes.

    Names in files and parts of messages come from strangers: a terminal would obey an escape sequence in them.
    """
    kept = (one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode() for one in text)
    return "".join(kept)


def say(text: str, *, level: int = 0, nl: bool = True) -> None:
    """Print a line on standard error unless it is silenced; drop it if standard error cannot be written to."""
    if level <= _loudness:
        with suppress(OSError):
            click.echo(visible(text), err=True, nl=nl)


def in_options(line: PdecodecError | Notice, parameters: Iterable[click.Parameter]) -> str:
    """Return the message of an error or a notice, with the command's option in place of the setting or limit.

    Options are named like the settings of the library that they set, so the parameters serve as the table.
    """
    wanted = line.limit or line.setting
    for option in parameters:
        if isinstance(option, click.Option) and option.name == wanted:
            name = max(option.opts, key=len)
            value = line.value if line.value is not None else option.metavar
            return line.worded(name, f"pass {name}" if value is None else f"pass {name} {value}")
    return str(line)


def say_notices(notices: Iterable[str]) -> None:
    """Print the notices of a reader or a writer, one per line."""
    for notice in notices:
        parameters = click.get_current_context().command.params
        say(f"note: {in_options(notice, parameters) if isinstance(notice, Notice) else notice}")


def say_rounding(distance: float, scale: float) -> None:
    """Print a note if rounding moves positions noticeably, compared with the diagonal of the scene."""
    from pdecodec.mesh.rounding import REPORTED_ROUNDING, rounding_words

    if distance > REPORTED_ROUNDING * scale:
        say(f"note: {rounding_words(distance)}; float32 has too few digits this far from the origin")


def put(text: str = "", *, nl: bool = True) -> None:
    """Print text on standard output, as it is."""
    click.echo(text, nl=nl)


@contextmanager
def outputs_written() -> Iterator[None]:
    """Raise ReportLostError if standard output does not take the report on outputs that are written."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        message = f"cannot be written ({error.strerror}), but the output files are complete; check where it goes"
        raise ReportLostError(message, code="output-unwritable", path=STANDARD_OUTPUT) from error


def print_json(data: Mapping[str, Any], *, outputs_are_written: bool = False) -> None:
    """Print one JSON object on standard output: the result of a command, or a report on outputs that are written."""
    with outputs_written() if outputs_are_written else nullcontext():
        put(json.dumps(data, indent=2, allow_nan=False))


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[str]], *, title: str | None = None, show_lines: bool = False
) -> None:
    """Print a table on standard output, framed if it has a title or lines; narrow in a file or a pipe."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns, title=title, title_justify="left", show_lines=show_lines)
    if title is None and not show_lines:
        table.box = None
    for row in rows:
        table.add_row(*row)
    # Names in files may contain square brackets, which are not markup.
    if sys.stdout.isatty():
        Console(file=sys.stdout, markup=False).print(table)
        return
    text = io.StringIO()
    Console(file=text, markup=False, width=PIPE_WIDTH).print(table)
    put("\n".join(line.rstrip() for line in text.getvalue().splitlines()))


def print_rows(rows: Sequence[Sequence[str]]) -> None:
    """Print rows of texts on standard output, in columns as wide as their contents."""
    rows = [[visible(text).replace("\n", "\\n").replace("\t", "\\t") for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        put("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def alternatives_in_rows(questions: Sequence[Question]) -> list[tuple[str, str, str]]:
    """Return one row for each decision of the encoder: the choice, its cost, and the cost of the alternatives."""
    rows = []
    for question in questions:
        taken = [f"{item.way}: {item.size:,}" for item in question.ways if item.chosen]
        others = [f"{item.way}: {item.size:,}" for item in question.ways if not item.chosen]
        what = f"{question.what}, {counted(question.frames, 'frame')}"
        rows.append((what, "; ".join(taken), "; ".join(others) or "nothing else"))
    return rows


def print_alternatives(questions: Sequence[Question]) -> None:
    """Print :func:`alternatives_in_rows` on standard output."""
    if questions:
        print_rows([("choice", "chosen, in bytes", "instead of"), *alternatives_in_rows(questions)])


def say_alternatives(questions: Sequence[Question]) -> None:
    """Print each decision of the encoder in a line on standard error."""
    if questions:
        say("choices of the encoder, and the bytes of each alternative with all other choices unchanged:")
    for question in questions:
        taken = " and ".join(f"{item.way} ({item.size:,} bytes)" for item in question.ways if item.chosen)
        *others, last = [f"{item.way} ({item.size:,})" for item in question.ways if not item.chosen] or [
            "anything else"
        ]
        refused = f"{', '.join(others)} or {last}" if others else last
        say(f"  {question.what}, {counted(question.frames, 'frame')}: {taken}, not {refused}")


@contextmanager
def progress_bar() -> Iterator[Progress | None]:
    """Yield a progress callback that draws a bar on standard error, or None if that is not a terminal."""
    if not sys.stderr.isatty() or _loudness < 0:
        yield None
        return
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), TimeRemainingColumn())
    with Progress(*columns, console=Console(stderr=True), transient=True) as bar:
        task = bar.add_task("", total=None)
        yield lambda done, total, what: bar.update(task, completed=done, total=total, description=visible(what))


def counted(count: int, noun: str) -> str:
    """Return a count with its noun: ``1 quad``, ``1,200 quads``."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


MOST_THINGS = 5
"""Kinds of things that a line lists."""


def things(contents: Iterable[tuple[str, int]]) -> str:
    """Return kinds of things with their counts: ``2 cameras, 1 texture and 3 other kinds``."""
    known = [counted(count, kind) for kind, count in contents]
    if len(known) > MOST_THINGS + 1:
        known = [*known[: MOST_THINGS - 1], f"{known[MOST_THINGS - 1]} and {len(known) - MOST_THINGS} other kinds"]
    return ", ".join(known) or "custom data"


def byte_size(count: int) -> str:
    """Return a byte count in decimal units: ``812 bytes``, ``35.8 kB``, ``0.31 MB``, ``42.0 MB``."""
    if count < 1000:
        return counted(count, "byte")
    if count < 100_000:
        return f"{count / 1e3:.1f} kB"
    return f"{count / 1e6:.3g} MB" if count < 1_000_000 else f"{count / 1e6:,.1f} MB"


def ratio(raw: int, coded: int) -> str:
    """Return a ratio such as ``135:1``, with one decimal below ten and two digits below one."""
    value = raw / max(1, coded)
    digits = f"{value:.0f}" if value >= 10 else f"{value:.1f}" if value >= 1 else f"{value:.2g}"
    return f"{digits}:1"


def extent(sequence: MeshSequence) -> str:
    """Return the size of a clip: ``60 frames of 19,968 vertices``, ``60 frames of at most 300 vertices in 12 runs``."""
    frames, vertices, runs = sequence.frame_count, sequence.most_vertices, len(sequence.runs)
    most, of_runs = ("at most ", f" in {runs:,} runs") if runs > 1 else ("", "")
    return f"{counted(frames, 'frame')} of {most}{vertices:,} {'vertex' if vertices == 1 else 'vertices'}{of_runs}"
