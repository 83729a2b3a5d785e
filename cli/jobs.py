"""Inputs and outputs of a command: several inputs, folders of outputs, standard input and output."""

from __future__ import annotations

import dataclasses
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import STANDARD_OUTPUT, ReportLostError, byte_size, extent, put, say, visible
from pdecodec.cli.options import check_apart, check_output, option_group
from pdecodec.errors import PdecodecError, SettingsError, unreadable
from pdecodec.system.storage import COPY_BYTES, RemoteFile, is_address, remote_output

if TYPE_CHECKING:
    from pdecodec.mesh.sequence import MeshSequence

STREAM = "-"
"""The argument that stands for standard input or output."""

STANDARD_INPUT = "standard input"
"""The name of standard input in errors."""

HERE = "./"
"""The output folder of a dry run that names no output."""

SAMPLES = (4, 12)
"""Numbers of frames that a dry run writes to extrapolate the size of a file, linearly."""


@dataclass(frozen=True)
class Job:
    """An input and its output: paths, and names for messages; `in_folder` if the folder may have to be created."""

    source: str
    output: str
    source_name: str
    output_name: str
    in_folder: bool = False

    def check(self, outputs: Iterable[str], sources: Iterable[str | None], *, overwrite: bool, dry_run: bool) -> None:
        """Refuse outputs that cannot be written or that would replace an input."""
        outputs = list(outputs)
        for path in outputs:
            if not (dry_run and self.in_folder and not Path(path).parent.exists()):
                check_output(path, overwrite=overwrite)
        check_apart([self.source, *sources], outputs)

    def with_frames(self, sequence: MeshSequence, *, dry_run: bool) -> Job:
        """Return the job with a new folder of frames as output if its format cannot hold several frames in a file."""
        from pdecodec.formats.base.frame_files import FOLDER_PADDING
        from pdecodec.formats.base.registry import known_extensions

        if not self.in_folder or sequence.frame_count == 1 or is_address(self.output):
            return self
        path = Path(self.output)
        if path.suffix.lower() not in known_extensions(lambda entry: entry.frame_per_file and entry.writes):
            return self
        path = path.with_suffix("") / f"{path.stem}.{FOLDER_PADDING}{path.suffix}"
        if not dry_run:
            _make_folder(path.parent)
        return dataclasses.replace(self, output=str(path), output_name=str(path))


job_options = option_group(
    click.argument("paths", metavar="IN... [OUT]", nargs=-1),
    click.option("-o", "--output", metavar="OUT", help="File, folder/ or pattern to write, or - for standard output."),
    click.option("--to", "extension", metavar="EXT", help="Format of OUT, if OUT is a folder or -: glb, abc, npz."),
    click.option(
        "--dry-run",
        is_flag=True,
        help="Print what would be read and written, and the approximate size; write nothing. OUT may be left out "
        "if its format is known.",
    ),
)
"""``IN... OUT``, ``-o``, ``--to`` and ``--dry-run``."""


def for_each_job(
    work: Callable[..., bool | None], *, default: str = "", only_animations: bool = False
) -> Callable[..., bool]:
    """Return the function of a command with :data:`job_options` that calls `work` for each of its jobs.

    Parameters
    ----------
    work : callable
        ``work(job, dry_run=..., as_json=..., **options)``, with files in place of streams.
    default : str
        Extension of outputs in a folder or on standard output, unless the user chooses one.
    only_animations : bool
        Whether inputs are `.pdeanim` files.

    Returns
    -------
    callable
        It returns whether no call of `work` returned False.
    """

    def command(
        *,
        paths: tuple[str, ...],
        output: str | None,
        extension: str | None,
        dry_run: bool,
        as_json: bool,
        **options: Any,
    ) -> bool:
        if output == STREAM and as_json:
            raise SettingsError("-o - and --json both need standard output; leave out one")
        is_whole, lost = True, None
        for job in jobs(paths, output, extension=extension, default=default, dry_run=dry_run):
            with streamed(job, extension=extension or default, dry_run=dry_run, only_animations=only_animations) as one:
                try:
                    is_whole &= work(one, dry_run=dry_run, as_json=as_json, **options) is not False
                except ReportLostError as error:
                    lost = error
        if lost is not None:
            raise lost
        return is_whole

    return command


def jobs(
    paths: Sequence[str], output: str | None, *, extension: str | None, default: str = "", dry_run: bool = False
) -> list[Job]:
    """Return the jobs of a command line, in order; frames of one sequence, as a shell lists them, are one input.

    A dry run needs no output: if none is named and the format is known, outputs are planned for the current folder.

    Parameters
    ----------
    paths : sequence of str
        Inputs, followed by the output if `output` is None.
    output : str or None
    extension : str or None
        Extension of outputs in a folder, or on standard output.
    default : str
        Extension if `extension` is None.
    dry_run : bool

    Raises
    ------
    click.UsageError
        If there is no input or output, or several inputs are to go to one file.
    SettingsError
        If two inputs would go to one output.
    """
    ending = (extension or default).lstrip(".")
    if output is None and dry_run and ending and paths and (len(paths) == 1 or _is_input(paths[-1], ending)):
        output = HERE
    if output is None:
        *paths, output = paths if len(paths) > 1 else (*paths, "")
    if not output or not paths:
        raise _usage_error("name an input and an output: IN OUT, or IN -o OUT")
    sources = _gathered(paths)
    to_folder = output.endswith("/") or Path(output).is_dir()
    if len(sources) > 1 and not to_folder:
        raise _usage_error(f"{len(sources)} inputs cannot go to one file, {output}; name a folder: -o folder/")
    if extension and not to_folder and output != STREAM:
        raise _usage_error(f"--to {extension} is for a folder or -, and {output} is a file; leave it out")
    if not to_folder or (len(sources) == 1 and not ending):
        return [Job(sources[0], output, sources[0], output)]
    found: dict[str, Job] = {}
    for source in sources:
        name = f"{_stem(source)}.{ending}" if ending else f"{_stem(source)}/"
        name = output + name if is_address(output) else str(Path(output) / name) + ("" if ending else "/")
        if name in found:
            raise SettingsError(
                f"{found[name].source} and {source} would both go to {name}; convert them one by one",
                code="overwrites-input",
            )
        found[name] = Job(source, name, source, name, in_folder=True)
    return list(found.values())


def _is_input(path: str, ending: str) -> bool:
    """Return whether a path that could be the output is an existing file of another format."""
    return Path(path).is_file() and not path.lower().endswith(f".{ending.lower()}")


def _usage_error(message: str) -> click.UsageError:
    return click.UsageError(message, click.get_current_context(silent=True))


def _gathered(paths: Sequence[str]) -> list[str]:
    """Return the inputs, with the frames of one sequence replaced by its pattern."""
    if len(paths) < 2:
        return list(paths)
    from pdecodec.formats.base.companions import frame_extensions
    from pdecodec.formats.base.frame_files import gather_frames

    return gather_frames(paths, frame_extensions())


def _stem(source: str) -> str:
    """Return the name, without extension, of an output in a folder."""
    from pdecodec.formats.base.frame_files import is_input_pattern, sequence_name

    path = Path(source)
    if source == STREAM:
        return "stdin"
    if is_input_pattern(path):
        return sequence_name(path)
    return path.resolve().name if path.is_dir() else path.stem


@contextmanager
def standard_input(source: str, *, only_animations: bool = False) -> Iterator[str]:
    """Yield the path of an input; for standard input that of a temporary copy, called "standard input" in errors.

    If the first bytes belong to no known format, or with `only_animations` to no `.pdeanim` file, reading stops there:
    the stream may be endless.
    """
    if source != STREAM:
        yield source
        return
    with tempfile.TemporaryDirectory(prefix="pdecodec-") as folder:
        path = Path(folder) / "stdin"
        from pdecodec.formats.base.registry import LONGEST_MAGIC, format_of_head

        with path.open("wb") as file:
            size = LONGEST_MAGIC
            while True:
                try:
                    piece = sys.stdin.buffer.read(size)
                except OSError as error:
                    raise unreadable(error, STANDARD_INPUT, "name a file instead of -") from error
                if not piece:
                    break
                try:
                    file.write(piece)
                    file.flush()
                except OSError as error:
                    raise unreadable(error, folder, "name a file instead of -", doing="written") from error
                is_known = size != LONGEST_MAGIC or _begins_animation(piece)
                if not is_known and (only_animations or format_of_head(piece) is None):
                    break
                size = COPY_BYTES
        with _named(str(path), STANDARD_INPUT):
            yield str(path)


def _begins_animation(head: bytes) -> bool:
    """Return whether the first bytes are those of a `.pdeanim` file, possibly damaged."""
    from pdecodec.codec.container import IDENTIFIER

    return sum(one == wanted for one, wanted in zip(head, IDENTIFIER, strict=False)) >= len(IDENTIFIER) // 2


@contextmanager
def local_input(source: str) -> Iterator[str]:
    """Yield the path of a `.pdeanim` file; for an address or standard input that of a copy, not named in errors."""
    if not is_address(source):
        with standard_input(source, only_animations=True) as path:
            yield path
        return
    file = RemoteFile(source)
    with tempfile.TemporaryDirectory(prefix="pdecodec-") as folder:
        copy = Path(folder, file.name)
        file.fetch(copy)
        with _named(str(copy), source):
            yield str(copy)


@contextmanager
def local_output(output: str, *, overwrite: bool) -> Iterator[Path]:
    """Yield the path of an output; for an address that of a file, uploaded when the block ends without an error."""
    if not is_address(output):
        yield Path(output)
        return
    with remote_output(output, overwrite=overwrite) as path, _named(str(path), output):
        yield path


@contextmanager
def _named(path: str, name: str) -> Iterator[None]:
    """Replace the path of a temporary file in errors by the name that the user knows."""
    try:
        yield
    except PdecodecError as error:
        if error.path != path:
            raise
        raise error.placed(path=name) from error


@contextmanager
def streamed(job: Job, *, extension: str, dry_run: bool = False, only_animations: bool = False) -> Iterator[Job]:
    """Yield the job with files in place of standard input and output, and create the folder of its output.

    Raises
    ------
    SettingsError
        If no format is given for standard output, or the output is more than one file.
    """
    with ExitStack() as stack:
        source, output = stack.enter_context(standard_input(job.source, only_animations=only_animations)), job.output
        if output == STREAM:
            if not extension:
                raise SettingsError("-o -: name the format for standard output, as in --to glb")
            if sys.stdout.isatty() and not dry_run:
                raise SettingsError("-o -: standard output is a terminal; name a file, or pipe the output to a program")
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="pdecodec-")))
            output = str(folder / f"stdout.{extension.lstrip('.')}")
            stack.enter_context(_named(output, STANDARD_OUTPUT))
        elif is_address(output):
            pass
        elif job.in_folder and not dry_run:
            _make_folder(Path(output).parent)
        yield dataclasses.replace(job, source=source, output=output)
        if job.output == STREAM and not dry_run:
            found = [one for one in folder.rglob("*") if one.is_file()]
            if len(found) != 1:
                raise SettingsError(f"-o -: {len(found)} files cannot go to standard output; name a folder")
            with found[0].open("rb") as written:
                shutil.copyfileobj(written, sys.stdout.buffer)
                sys.stdout.buffer.flush()


def _make_folder(folder: Path) -> None:
    """Create the folder of an output if it is missing and its parent exists."""
    if not folder.exists() and folder.parent.is_dir():
        folder.mkdir()


def say_plan(
    job: Job,
    sequence: MeshSequence,
    write: Callable[[MeshSequence, str], object],
    *,
    files: int,
    size: int,
    samples: Sequence[int] = SAMPLES,
) -> None:
    """Print the input of a job (`files` of `size` bytes in total), and the approximate size of its output.

    The size is extrapolated from the first frames, as many as `samples` says; a clip without more frames is written
    whole.
    """
    from pdecodec.mesh.selection import select

    counts = sorted({min(count, sequence.frame_count) for count in samples})
    if counts[-1] == sequence.frame_count:
        counts = counts[-1:]
    sizes = []
    for count in counts:
        with tempfile.TemporaryDirectory(prefix="pdecodec-") as folder:
            name = Path(job.output).name + ("/" if job.output.endswith("/") else "")
            write(select(sequence, range(count)), f"{folder}/{name}")
            sizes.append(sum(one.stat().st_size for one in Path(folder).rglob("*") if one.is_file()))
    growth = (sizes[-1] - sizes[0]) / max(1, counts[-1] - counts[0])
    about = sizes[-1] + growth * (sequence.frame_count - counts[-1])
    say_sizes(job, sequence, f"about {byte_size(max(0, round(about)))}", files=files, size=size)


def say_sizes(job: Job, sequence: MeshSequence, becomes: str, *, files: int, size: int) -> None:
    """Print the input of a job (`files` of `size` bytes in total) and its output."""
    there = f"{files} file{'s' * (files != 1)}, {byte_size(size)}"
    put(visible(f"read {job.source_name} ({there}): {extent(sequence)}"))
    put(visible(f"write {job.output_name}: {becomes}"))


def say_start(job: Job, sequence: MeshSequence) -> None:
    """Print the input and the output of a job, for ``-v``."""
    count = len(sequence.runs[0].objects)
    objects = f"{count} object{'s' * (count != 1)}"
    say(
        f"{job.source_name} -> {job.output_name}: {objects}, {extent(sequence)}, {sequence.fps:g} frames per second",
        level=1,
    )
