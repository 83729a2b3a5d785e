"""What a person sees: standard error for words and progress, standard output for data alone."""

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
"""Columns of a table that goes to a file or a pipe, where nobody counts them."""


STANDARD_OUTPUT = "standard output"
"""The name of standard output in errors."""


class PartlyDoneError(Exception):
    """A person ended a command, of which something is done: what it says takes the place of the usual words."""


class ReportLostError(PdecodecError):
    """The outputs of a command are written, but standard output did not take the report on them."""

    exit_code = 6


class _NamedOutput(io.FileIO):
    """Standard output that names itself in errors."""

    def write(self, data: Any) -> int | None:  # type: ignore[override]
        try:
            return super().write(data)
        except OSError as error:
            raise OSError(error.errno, error.strerror, STANDARD_OUTPUT) from None


def open_streams() -> None:
    """Put the null device in the place of closed standard streams, and give standard output its name in errors.

    Otherwise the next file to be opened takes the number of a closed stream, and gets whatever is written to it. The
    null device is opened the wrong way round for input and output: reading and writing fail, so that no result is lost
    without an error. What goes to a closed standard error is dropped.
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
    """Return the number of a new stream, the lowest that is free: that of the closed one."""
    number = os.open(os.devnull, flags)
    os.set_inheritable(number, True)
    return number


def drop_unwritten() -> None:
    """Drop what standard streams could not take: at its end Python would try again, and change the exit code."""
    for stream in (sys.stdout, sys.stderr):
        try:
            stream.flush()
        except OSError:
            os.dup2(_open_null(os.O_WRONLY), stream.fileno())


def unwritable_output(error: OSError) -> PdecodecError:
    """Return the error about standard output that cannot be written to."""
    return unreadable(error, STANDARD_OUTPUT, "check where it goes", doing="written")


_loudness = 0


def set_loudness(level: int) -> None:
    """How much is said: -1 nothing but errors, 0 results and notes, 1 what is done as well."""
    global _loudness
    _loudness = level


def visible(text: str) -> str:
    """Text that cannot steer a terminal: control characters, and those that turn its direction, as escapes.

    Names in files and parts of messages are what somebody wrote: an escape sequence would be obeyed.
    """
    kept = (one if one.isprintable() or one in "\n\t" else one.encode("unicode_escape").decode() for one in text)
    return "".join(kept)


def say(text: str, *, level: int = 0, nl: bool = True) -> None:
    """One line to standard error, unless less is to be said; lost where standard error cannot be written to."""
    if level <= _loudness:
        with suppress(OSError):
            click.echo(visible(text), err=True, nl=nl)


def in_options(line: PdecodecError | Notice, parameters: Iterable[click.Parameter]) -> str:
    """Return the line of an error or a notice, with the option that sets it in the place of a setting or a limit.

    The options of a command are called as the settings of the library that they set: they are the table.
    """
    wanted = line.limit or line.setting
    for option in parameters:
        if isinstance(option, click.Option) and option.name == wanted:
            name = max(option.opts, key=len)
            value = line.value if line.value is not None else option.metavar
            return line.worded(name, f"pass {name}" if value is None else f"pass {name} {value}")
    return str(line)


def say_notices(notices: Iterable[str]) -> None:
    """What a reader or a writer wants a person to know, a line each."""
    for notice in notices:
        parameters = click.get_current_context().command.params
        say(f"note: {in_options(notice, parameters) if isinstance(notice, Notice) else notice}")


def say_rounding(distance: float, scale: float) -> None:
    """A line where rounding moves positions noticeably, beside the diagonal of the scene."""
    from pdecodec.mesh.rounding import REPORTED_ROUNDING, rounding_words

    if distance > REPORTED_ROUNDING * scale:
        say(f"note: {rounding_words(distance)}; there are not enough digits so far from the origin")


def put(text: str = "", *, nl: bool = True) -> None:
    """Text to standard output, as it is."""
    click.echo(text, nl=nl)


@contextmanager
def outputs_written() -> Iterator[None]:
    """Raise ReportLostError where standard output does not take the report on outputs that are written."""
    try:
        yield
    except BrokenPipeError:
        raise
    except OSError as error:
        message = f"cannot be written ({error.strerror}), but the outputs are written; check where it goes"
        raise ReportLostError(message, code="output-unwritable", path=STANDARD_OUTPUT) from error


def print_json(data: Mapping[str, Any], *, outputs_are_written: bool = False) -> None:
    """One JSON object to standard output: the result of a command, or a report on outputs that are written."""
    with outputs_written() if outputs_are_written else nullcontext():
        put(json.dumps(data, indent=2, allow_nan=False))


def print_table(
    columns: Sequence[str], rows: Iterable[Sequence[str]], *, title: str | None = None, show_lines: bool = False
) -> None:
    """A table to standard output, framed if it has a title or lines; in a file or a pipe no wider than it need be."""
    from rich.console import Console
    from rich.table import Table

    table = Table(*columns, title=title, title_justify="left", show_lines=show_lines)
    if title is None and not show_lines:
        table.box = None
    for row in rows:
        table.add_row(*row)
    # Names in files may hold square brackets: they are no markup.
    if sys.stdout.isatty():
        Console(file=sys.stdout, markup=False).print(table)
        return
    text = io.StringIO()
    Console(file=text, markup=False, width=PIPE_WIDTH).print(table)
    put("\n".join(line.rstrip() for line in text.getvalue().splitlines()))


def print_rows(rows: Sequence[Sequence[str]]) -> None:
    """Rows of texts to standard output, in columns as wide as what they hold."""
    rows = [[visible(text).replace("\n", "\\n").replace("\t", "\\t") for text in row] for row in rows]
    widths = [max(map(len, column)) for column in zip(*rows, strict=True)]
    for row in rows:
        put("  ".join(text.ljust(width) for text, width in zip(row, widths, strict=True)).rstrip())


def alternatives_in_rows(questions: Sequence[Question]) -> list[tuple[str, str, str]]:
    """What was chosen, what that takes, and what else would have taken how much; a row for each choice."""
    rows = []
    for question in questions:
        taken = [f"{item.way}: {item.size:,}" for item in question.ways if item.chosen]
        others = [f"{item.way}: {item.size:,}" for item in question.ways if not item.chosen]
        what = f"{question.what}, {counted(question.frames, 'frame')}"
        rows.append((what, "; ".join(taken), "; ".join(others) or "nothing else"))
    return rows


def print_alternatives(questions: Sequence[Question]) -> None:
    """:func:`alternatives_in_rows` to standard output."""
    if questions:
        print_rows([("choice", "taken, in bytes", "instead of"), *alternatives_in_rows(questions)])


def say_alternatives(questions: Sequence[Question]) -> None:
    """The same to standard error."""
    for what, taken, others in alternatives_in_rows(questions):
        say(f"{what}: {taken} bytes; instead of {others}")


@contextmanager
def progress_bar() -> Iterator[Progress | None]:
    """A progress callable for the library that draws a bar on standard error; None when that is no terminal."""
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
    """``1 quad``, ``1,200 quads``."""
    return f"{count:,} {noun}{'s' * (count != 1)}"


def byte_size(count: int) -> str:
    """A byte count for people, decimal units: ``812 bytes``, ``35.8 kB``, ``0.31 MB``, ``42.0 MB``."""
    if count < 1000:
        return counted(count, "byte")
    if count < 100_000:
        return f"{count / 1e3:.1f} kB"
    return f"{count / 1e6:.3g} MB" if count < 1_000_000 else f"{count / 1e6:,.1f} MB"


def ratio(raw: int, coded: int) -> str:
    """``135:1``, with one decimal below ten and two digits below one."""
    value = raw / max(1, coded)
    digits = f"{value:.0f}" if value >= 10 else f"{value:.1f}" if value >= 1 else f"{value:.2g}"
    return f"{digits}:1"


def extent(sequence: MeshSequence) -> str:
    """``60 frames of 19,968 vertices``, ``1 frame of 1 vertex``, ``60 frames of at most 300 vertices in 12 runs``."""
    frames, vertices, runs = sequence.frame_count, sequence.most_vertices, len(sequence.runs)
    most, of_runs = ("at most ", f" in {runs:,} runs") if runs > 1 else ("", "")
    return f"{counted(frames, 'frame')} of {most}{vertices:,} {'vertex' if vertices == 1 else 'vertices'}{of_runs}"
