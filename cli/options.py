"""Options that several commands share, and checks of what they say."""

from __future__ import annotations

import functools
import os
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from pdecodec.cli.console import byte_size, say, set_loudness
from pdecodec.errors import InputError, SettingsError
from pdecodec.system.storage import RemoteFile, is_address

if TYPE_CHECKING:
    from pdecodec.codec.source import DecodeLimits
    from pdecodec.mesh.sequence import MeshSequence

Decorator = Callable[[Callable[..., None]], Callable[..., None]]
"""What gives a command an option, or several."""


def parse_bytes(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Click callback: parse a number of bytes with :func:`pdecodec.codec.settings.parse_byte_count`."""
    if value is None:
        return None
    from pdecodec.codec.settings import parse_byte_count

    try:
        return parse_byte_count(value)
    except ValueError as error:
        raise click.BadParameter(str(error), context, parameter) from error


def option_group(*options: Decorator) -> Decorator:
    """Return a decorator that gives a command several options, shown in this order."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def parse_share(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Click callback: ``5%`` or ``5``, as 0.05."""
    if value is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*%?", value.strip())
    if found is None:
        raise click.BadParameter(f"{value!r} is not a share such as 5%", context, parameter)
    return float(found[1]) / 100.0


def fraction(text: str) -> float:
    """Type of an option: a number or a percentage, ``0.001`` or ``0.1%``."""
    from pdecodec.codec.settings import parse_fraction

    try:
        return parse_fraction(text)
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not a number such as 0.001, or a percentage such as 0.1%") from error


output_option = click.option(
    "-o", "--output", required=True, metavar="OUT", help="File, folder or pattern to write; format by extension."
)
overwrite_option = click.option("-y", "--overwrite", is_flag=True, help="Replace OUT when it exists.")


def _set_loudness(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        set_loudness(-1 if parameter.name == "quiet" else 1)


loudness_options = option_group(
    *(
        click.option(f"-{name[0]}", f"--{name}", is_flag=True, expose_value=False, callback=_set_loudness, help=text)
        for name, text in (("quiet", "Say nothing but errors."), ("verbose", "Say what is done as well."))
    )
)
"""``-q`` and ``-v``."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")
page_option = click.option(
    "-o", "--output", required=True, metavar="DIR", help="Folder for the page, its charts and its figures."
)


def effort_option(help_text: str) -> Decorator:
    """``--effort``, of which each command says what it is for."""
    efforts = click.Choice(["fast", "default", "best"])
    return click.option("--effort", type=efforts, default="default", show_default=True, help=help_text)


def growth_options(compare: str, fail: str) -> Decorator:
    """``--compare`` and ``--fail-if-larger``, of which each command says what grows: for :func:`check_growth`."""
    return option_group(
        click.option("--compare", metavar="OLD.json", help=compare),
        click.option("--fail-if-larger", callback=parse_share, metavar="P%", help=fail),
    )


fps_option = click.option(
    "--fps",
    type=float,
    metavar="F",
    help="Frames per second of IN where it does not say (else 24); Alembic, USD and glTF are sampled at it.",
)
frames_option = click.option(
    "--frames",
    metavar="A:B:STEP|1-100x2",
    help="Only these frames: positions counted from 0, B excluded, as a Python slice (10:, ::2); "
    "or frame numbers (time times fps, rounded), both ends included (1-100x2,120).",
)


objects_option = click.option(
    "--object",
    "objects",
    multiple=True,
    metavar="NAME",
    help="Only this object; may be given more than once. In a tree: its path, the end of one, a branch, or a pattern "
    "('Bone/BoneShape', 'BoneShape', 'Bone', '*Shape').",
)

velocities_option = click.option(
    "--velocities", is_flag=True, help="Also write velocities, units a second: in OUT where its format holds them."
)


def _allow_folders(context: click.Context, parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    """Click callback: files that are read until the command ends may name files in these folders."""
    folders = tuple(map(os.path.abspath, value))
    if folders:
        from pdecodec.system.reading import asset_folders_allowed

        context.with_resource(asset_folders_allowed(folders))
    return folders


def assets_option(**keywords: Any) -> Decorator:
    """``--assets``; the command gets it where it is told."""
    return click.option(
        "--assets",
        "asset_folders",
        multiple=True,
        metavar="DIR",
        callback=_allow_folders,
        help="Folder in which files that are read may name others, besides their own folder: buffers, layers, heavy "
        "data. May be given more than once; PDECODEC_ASSET_FOLDERS lists more.",
        **keywords,
    )


read_options = option_group(
    fps_option,
    click.option("--mesh", metavar="FILE", help="Where a point cache (MDD, PC2) has its faces and names from."),
    click.option("--clip", metavar="NAME", help="Which animation of IN, where it has several (glTF); the first."),
    click.option(
        "--displacement",
        metavar="NAME|none",
        help="Which vectors of IN are added to its geometry (VTK, XDMF, Exodus).  [default: those that the format "
        "defines]",
    ),
    click.option(
        "--transforms",
        type=click.Choice(["bake", "keep"]),
        default="bake",
        show_default=True,
        help="Transforms above objects (Alembic, USD): applied to positions, or kept apart from them; what is written "
        "to a format without transforms is baked then.",
    ),
    click.option(
        "--skip-unsupported", is_flag=True, help="Leave out objects of IN that cannot be read, instead of refusing it."
    ),
    click.option(
        "--isolate", is_flag=True, help="Read IN in a process of its own, which a file damaged on purpose may end."
    ),
    assets_option(),
)
"""How the input is read: fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""

max_output_option = click.option(
    "--max-output",
    callback=parse_bytes,
    metavar="BYTES",
    help="Refuse .pdeanim files that declare more positions, such as 10GB.",
)

limit_options = option_group(
    click.option(
        "--max-memory",
        callback=parse_bytes,
        metavar="BYTES",
        help="Refuse .pdeanim files that need more, such as 2G.  [default: 4G]",
    ),
    max_output_option,
)
"""What a file may cost: `max_memory` and `max_output`, for :func:`decode_limits`."""

place_options = option_group(
    click.option(
        "--up-axis",
        type=click.Choice(["X", "Y", "Z"], case_sensitive=False),
        help="Turn the scene so that this axis is up; where IN does not say which one is, record this one.",
    ),
    click.option("--scale", type=float, default=1.0, metavar="X", help="Multiply positions by this; the unit adapts."),
    click.option(
        "--unit", metavar="UNIT", help="The length of a unit of IN, where it does not say it: cm, m, '2.5 m'."
    ),
)
"""How the scene is turned and scaled: fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""

input_options = option_group(frames_option, objects_option, read_options, place_options)
"""All fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""

write_options = option_group(
    velocities_option,
    click.option("--web", is_flag=True, help="glTF: as small as may be, as by --quantize --meshopt --rigid."),
    click.option(
        "--quantize",
        is_flag=True,
        help="glTF: 16-bit positions and weights, 8-bit normals; how far off they are is told.",
    ),
    click.option("--meshopt", is_flag=True, help="glTF: compressed without loss, for viewers that know meshoptimizer."),
    click.option(
        "--straight",
        is_flag=True,
        help="glTF: straight lines from frame to frame, as most scenes move, in place of a .pdeanim file's splines.",
    ),
    click.option(
        "--rigid/--no-rigid",
        default=None,
        help="glTF, Alembic, USD: objects of a .pdeanim file that move rigidly, within the bound it was encoded with, "
        "become nodes that move, in glTF those of several such parts skins; how far off they are is told.  "
        "[default: in glTF and Alembic]",
    ),
)
"""What is written beside positions, and how small: options of :func:`pdecodec.formats.write_sequence`."""


def is_gltf(path: str) -> bool:
    """Whether a path names an output in glTF, for which there are options of its own."""
    from pdecodec.formats.base.registry import format_to_write

    return format_to_write(path).name == "gltf"


def say_larger(name: str, path: str, before: int, after: int, is_small: bool) -> None:
    """Say that a glTF file is larger than what it was made from, and what makes it smaller; nothing of other files."""
    if after > before > 0 and is_gltf(path):
        less = "" if is_small else "; --web makes it smaller (--quantize, --meshopt and --rigid)"
        say(f"note: {name} is {after / before:.3g} times as large as IN, {byte_size(after - before)} more{less}")


def check_growth(compare: str | None, fail_if_larger: float | None) -> None:
    """Refuse ``--fail-if-larger`` without ``--compare``."""
    if fail_if_larger is not None and compare is None:
        raise SettingsError("--fail-if-larger needs --compare, to know what files were before")


def rigid_bound(source: MeshSequence, scale: float, output: str, asked: bool | None) -> float | None:
    """What ``--rigid`` means: the bound of the file that is decoded, scaled as its positions are [scene units]."""
    from pdecodec.codec.decoder import Animation
    from pdecodec.codec.stored_choices import bound_of
    from pdecodec.formats.base.registry import format_to_write

    is_unasked = asked is None and format_to_write(output).finds_rigid_parts
    if not (asked or is_unasked):
        return 0.0 if asked is False else None
    is_animation = isinstance(source, Animation) and len(source.runs) == 1
    bound = bound_of(source) if isinstance(source, Animation) and is_animation else None
    if bound is None and asked:
        needed = "needs a bound, and the file was encoded without one"
        other = "is for a .pdeanim file of one connectivity, which knows its bound"
        raise SettingsError(f"--rigid {needed if is_animation else other}; leave it out")
    return None if bound is None else scale * bound


def within_limits(command: Callable[..., None]) -> Callable[..., None]:
    """``--max-memory`` and ``--max-output`` for every `.pdeanim` file that a command opens."""

    @functools.wraps(command)
    def limited(*arguments: Any, max_memory: int | None, max_output: int | None, **options: Any) -> None:
        from pdecodec.codec.source import usual_limits

        with usual_limits(decode_limits(max_memory, max_output)):
            command(*arguments, **options)

    return limit_options(limited)


def decode_limits(max_memory: int | None, max_output: int | None) -> DecodeLimits:
    """The limits that options give; those that are not given are the usual ones."""
    from pdecodec.codec.source import DecodeLimits

    usual = DecodeLimits()
    return DecodeLimits(max_memory=usual.max_memory if max_memory is None else max_memory, max_output=max_output)


def refuse_pdeanim(output: str, instead: str) -> None:
    """Raise SettingsError, ending in what to do instead, where the output of a command that does not encode is one."""
    if output.lower().endswith(".pdeanim"):
        raise SettingsError(f"only pdecodec encode writes .pdeanim files; {instead}", path=output)


def check_output(output: str, *, overwrite: bool) -> None:
    """Refuse an output that cannot be written, before the work for it starts.

    Raises
    ------
    SettingsError
        If it is ``-``, or says neither a format nor that it is a folder.
    InputError
        If it exists and may not be replaced, or the folder it goes into is missing or not writable.
    """
    path = Path(output)
    _check_name(output)
    if is_address(output):
        if not overwrite and RemoteFile(output).exists():
            raise InputError(
                "exists already; choose another name, or give --overwrite to replace it",
                code="output-exists",
                path=output,
            )
        return
    folder = path.parent
    if not folder.is_dir():
        raise InputError("this folder does not exist; make it first", code="file-missing", path=folder)
    if not os.access(folder, os.W_OK):
        raise InputError("this folder cannot be written to; choose another", code="output-unwritable", path=folder)
    if path.is_dir() and path.suffix and not output.endswith("/"):
        raise InputError("is a folder; name a file in it", code="output-unwritable", path=path)
    if overwrite:
        return
    from pdecodec.formats.base.companions import output_files

    taken = [path] if path.is_dir() and any(path.iterdir()) else output_files(output)
    if taken:
        raise InputError(
            "exists already; choose another name, or give --overwrite to replace it",
            code="output-exists",
            path=taken[0],
        )


def _check_name(output: str) -> None:
    from pdecodec.formats.base.registry import extensions_of

    if output == "-":
        raise SettingsError("-o -: this does not go to standard output; name a file, folder/ or pattern")
    if not Path(output).suffix and not output.endswith("/") and not Path(output).is_dir():
        known = extensions_of(lambda entry: entry.writes)
        raise SettingsError(
            f"has no extension; write {output}/ for a folder of frames, or add one of {known}", path=output
        )


def check_apart(sources: Iterable[str | None], outputs: Iterable[str]) -> None:
    """Refuse to write where an input lies, and those that it names: they would be lost.

    Raises
    ------
    SettingsError
        If a file of an input is one that an output would replace, by whatever name or link.
    """
    from pdecodec.formats.base.companions import input_files, output_files

    inputs = {os.path.realpath(file) for source in sources if source is not None for file in input_files(source)}
    for output in outputs:
        shared = [file for file in output_files(output) if os.path.realpath(file) in inputs]
        if shared:
            raise SettingsError(
                f"{output}: would replace {shared[0]}, which is read; choose another name", code="overwrites-input"
            )


def stored_bytes(files: Iterable[Path]) -> int:
    """Bytes that files take on disk, together."""
    return sum(file.stat().st_size for file in files)


def bytes_of(place: str, files: Iterable[Path]) -> int:
    """Bytes that an input or an output takes: the files that it stands for, or one elsewhere."""
    return RemoteFile(place).size() if is_address(place) else stored_bytes(files)
