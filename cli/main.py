"""The `pdecodec` command: its group of commands, and how failures become one line and an exit code.

Exit codes: 0 done; 1 a check failed; 2 usage; 3 bad input or unwritable output; 4 corrupt file; 5 missing extra; 6
outputs are written, but their results could not be printed; 130 interrupted; 141 standard output was closed early.
"""

from __future__ import annotations

import importlib
import io
import os
import sys
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

import click

from pdecodec import __version__
from pdecodec.cli.console import (
    STANDARD_OUTPUT,
    PartlyDoneError,
    drop_unwritten,
    in_options,
    open_streams,
    say,
    set_loudness,
    unwritable_output,
)
from pdecodec.cli.interrupts import take_interrupt
from pdecodec.errors import InputError, PdecodecError, SettingsError

EXIT_INTERRUPTED = 130
"""128 + SIGINT, as shells report it."""

EXIT_UNREAD = 141
"""128 + SIGPIPE, as shells report it: neither success nor a failed check."""

TRACEBACK_VARIABLE = "PDECODEC_TRACEBACK"
"""Environment variable that, when set, shows the traceback of a bug instead of one line about it."""


MODULES = {
    "batch": "batch",
    "check": "check",
    "coefficients": "coefficients",
    "compare": "compare",
    "convert": "convert",
    "cut": "cut",
    "decode": "decode",
    "demo": "demo",
    "encode": "encode",
    "formats": "info",
    "info": "info",
    "join": "cut",
    "report": "report",
    "reproduce": "research",
    "serve": "view",
    "simulate": "simulate",
    "stability": "research",
    "view": "view",
}
"""The module of this package that defines each command."""

COMMANDS = tuple(MODULES)


class CommandsOnDemand(click.Group):
    """A group that imports each command only when it is needed, to start fast."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in COMMANDS:
            return None
        command: click.Command = getattr(importlib.import_module(f"pdecodec.cli.{MODULES[cmd_name]}"), cmd_name)
        return command

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Return the command; if the line begins with a path or `convert`, the command that fits the extensions."""
        bare = args[0] not in COMMANDS and (
            args[0] == "-" or "." in args[0] or "/" in args[0] or Path(args[0]).exists()
        )
        if bare or args[0] == "convert":
            rest = args if bare else args[1:]
            inputs, output = self._paths(ctx, rest)
            name = "encode" if output.endswith(".pdeanim") else "convert"
            if bare and name == "convert" and inputs and inputs[0].endswith(".pdeanim"):
                name = "decode"
            args = [name, *rest]
        return super().resolve_command(ctx, args)

    def invoke(self, ctx: click.Context) -> Any:
        """Run a command; report an error of the library in one line that names the command's options."""
        try:
            return super().invoke(ctx)
        except PdecodecError as error:
            if take_interrupt():
                raise KeyboardInterrupt from error
            command = self.get_command(ctx, ctx.invoked_subcommand or "")
            ctx.exit(_fail(in_options(error, [] if command is None else command.params), error.exit_code))

    def _paths(self, ctx: click.Context, args: list[str]) -> tuple[list[str], str]:
        """Return inputs and output of a command line, in lower case; none if they cannot be told apart yet."""
        for name in ("encode", "decode", "convert"):
            command = self.get_command(ctx, name)
            assert command is not None
            try:
                given, _, _ = command.make_parser(click.Context(command, parent=ctx)).parse_args(list(args))
            except click.UsageError:
                continue
            # click puts markers of its own in place of missing arguments.
            named = given.get("paths")
            paths = [path.lower() for path in named if isinstance(path, str)] if isinstance(named, tuple) else []
            output = str(given.get("output") or "").lower()
            if str(given.get("extension") or "").lower().lstrip(".") == "pdeanim":
                output = ".pdeanim"
            if not output and len(paths) > 1:
                output = paths.pop()
            return paths, output
        return [], ""


@click.group(cls=CommandsOnDemand, context_settings={"help_option_names": ["-h", "--help"], "max_content_width": 100})
@click.version_option(__version__, prog_name="pdecodec")
def pdecodec() -> None:
    """Encode deforming meshes into compact .pdeanim files, and decode them at any time.

    `pdecodec IN OUT` chooses the command by extension: it encodes to .pdeanim, decodes from .pdeanim, or converts.

    The extension sets the format; `pdecodec formats` lists all of them. A sequence of files is a folder or a pattern
    (name.####.obj, name.%04d.obj, name.$F4.obj, 'name.*.obj'). Data goes to standard output, everything else to
    standard error.

    Exit codes: 0 done, 1 a check failed, 2 usage, 3 bad input or unwritable output, 4 corrupt file, 5 missing extra, 6
    outputs are written but their results could not be printed, 130 interrupted, 141 standard output was closed early
    (`| head`).
    """


def run(arguments: Sequence[str]) -> int:
    """Run one command line.

    Parameters
    ----------
    arguments : sequence of str
        The arguments without the program's name.

    Returns
    -------
    int
        The exit code; a failure has been reported in one line on standard error.
    """
    set_loudness(0)
    try:
        return _run(arguments)
    except click.ClickException as error:
        shown = io.StringIO()
        error.show(shown)
        say(shown.getvalue(), level=-1, nl=False)
        return SettingsError.exit_code
    except SystemExit as error:
        # Outside its standalone mode click exits in two cases: it has answered a shell's completion, or the reader of
        # our output has closed it (`| head`).
        return EXIT_UNREAD if error.code == 1 else int(error.code or 0)
    except OSError as error:
        if error.filename == STANDARD_OUTPUT:
            return _fail(str(unwritable_output(error)), InputError.exit_code)
        place = f"{error.filename}: " if error.filename is not None else ""
        return _fail(f"{place}{error.strerror or error}", InputError.exit_code)
    except MemoryError:
        return _fail("not enough memory; read fewer frames with --frames", InputError.exit_code)
    except PartlyDoneError as error:
        return _fail(str(error), EXIT_INTERRUPTED)
    except (KeyboardInterrupt, click.Abort):
        return _fail("interrupted; no output was written", EXIT_INTERRUPTED)


def _run(arguments: Sequence[str]) -> int:
    """Run one command line; raise KeyboardInterrupt if a library turned an interrupt into another error."""
    try:
        return int(pdecodec.main(args=list(arguments), prog_name="pdecodec", standalone_mode=False) or 0)
    except Exception as error:
        if take_interrupt() and not isinstance(error, PartlyDoneError):
            raise KeyboardInterrupt from error
        raise


# Python allocates memory for the frames of functions in pieces of 16 KiB, and frees a piece when it is empty. If a
# loop or the import of numpy calls functions at the end of a piece, every call does both: 760 times at the start of
# `info`. This frame, half a MiB that nothing writes to, begins a piece of 1 MiB for everything that it calls.
_run.__code__ = _run.__code__.replace(co_stacksize=2**16)


def _fail(message: str, exit_code: int) -> int:
    say(f"error: {' '.join(message.split())}", level=-1)
    return exit_code


def _report_bug(kind: type[BaseException], error: BaseException, trace: TracebackType | None) -> None:
    say(
        f"error: a bug in pdecodec: {kind.__name__}: {' '.join(str(error).split())}; "
        f"please report it, with the output of the same command when {TRACEBACK_VARIABLE}=1 is set",
        level=-1,
    )
    drop_unwritten()


def main() -> None:
    """Entry point of the `pdecodec` script."""
    if not os.environ.get(TRACEBACK_VARIABLE):
        sys.excepthook = _report_bug
    open_streams()
    try:
        sys.exit(run(sys.argv[1:]))
    finally:
        take_interrupt()
        drop_unwritten()
