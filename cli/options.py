"""Options that several commands share, and the checks of their values."""

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
"""A decorator that adds one option or several to a command."""


def parse_bytes(context: click.Context, parameter: click.Parameter, value: str | None) -> int | None:
    """Click callback: parse a number of bytes with :func:`pdecodec.codec.settings.parse_byte_count`."""
    if value is None:
        return None
    from pdecodec.codec.settings import parse_byte_count

    try:
        return parse_byte_count(value)
    except ValueError as error:
        raise click.BadParameter(str(error), context, parameter) from error


def parse_fields(context: click.Context, parameter: click.Parameter, given: tuple[str, ...]) -> dict[str, float | str]:
    """Click callback: parse ``NAME=X`` with :func:`pdecodec.codec.settings.parse_named_field_setting`."""
    from pdecodec.codec.settings import parse_named_field_setting

    found = []
    for text in given:
        try:
            found.append(parse_named_field_setting(text))
        except ValueError as error:
            raise click.BadParameter(f"{text!r}: {error}", context, parameter) from error
    return dict(found)


def option_group(*options: Decorator) -> Decorator:
    """Return a decorator that gives a command several options, shown in this order."""

    def decorate(command: Callable[..., None]) -> Callable[..., None]:
        for option in reversed(options):
            command = option(command)
        return command

    return decorate


def parse_share(context: click.Context, parameter: click.Parameter, value: str | None) -> float | None:
    """Click callback: parse a percentage, ``5%`` or ``5``, as 0.05."""
    if value is None:
        return None
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*%?", value.strip())
    if found is None:
        raise click.BadParameter(f"{value!r} is not a percentage such as 5%", context, parameter)
    return float(found[1]) / 100.0


def fraction(text: str) -> float:
    """Parse an option that is a number or a percentage, ``0.001`` or ``0.1%``."""
    from pdecodec.codec.settings import parse_fraction

    try:
        return parse_fraction(text)
    except ValueError as error:
        raise click.BadParameter(f"{text!r} is not a number such as 0.001, or a percentage such as 0.1%") from error


output_option = click.option(
    "-o",
    "--output",
    required=True,
    metavar="OUT",
    help="File, folder or pattern to write; the extension sets the format.",
)
overwrite_option = click.option("-y", "--overwrite", is_flag=True, help="Replace OUT if it exists.")


def _set_loudness(context: click.Context, parameter: click.Parameter, value: bool) -> None:
    if value:
        set_loudness(-1 if parameter.name == "quiet" else 1)


loudness_options = option_group(
    *(
        click.option(f"-{name[0]}", f"--{name}", is_flag=True, expose_value=False, callback=_set_loudness, help=text)
        for name, text in (("quiet", "Print errors only."), ("verbose", "Also print what is being done."))
    )
)
"""``-q`` and ``-v``."""

json_option = click.option("--json", "as_json", is_flag=True, help="Print the result as JSON on standard output.")
page_option = click.option(
    "-o", "--output", required=True, metavar="DIR", help="Folder for the page, its charts and their data."
)


def effort_option(help_text: str) -> Decorator:
    """Return ``--effort`` with the help text of one command."""
    efforts = click.Choice(["fast", "default", "best"])
    return click.option("--effort", type=efforts, default="default", show_default=True, help=help_text)


def growth_options(compare: str, fail: str) -> Decorator:
    """Return ``--compare`` and ``--fail-if-larger`` with the help texts of one command; see :func:`check_growth`."""
    return option_group(
        click.option("--compare", metavar="OLD.json", help=compare),
        click.option("--fail-if-larger", callback=parse_share, metavar="P%", help=fail),
    )


fps_option = click.option(
    "--fps",
    type=float,
    metavar="F",
    help="Frames per second of IN, if IN does not state them (otherwise 24). Alembic, USD and glTF are sampled at "
    "this rate.",
)
frames_option = click.option(
    "--frames",
    metavar="A:B:STEP|1-100x2",
    help="Take only these frames: positions counted from 0, B excluded, as in a Python slice (10:, ::2); or frame "
    "numbers (time x fps, rounded), both ends included (1-100x2,120).",
)


objects_option = click.option(
    "--object",
    "objects",
    multiple=True,
    metavar="NAME",
    help="Take only this object; may be repeated. NAME may be a name, a path in the scene tree, the end of a path, a "
    "branch, or a pattern ('BoneShape', 'Bone/BoneShape', 'Bone', '*Shape').",
)

velocities_option = click.option(
    "--velocities",
    is_flag=True,
    help="Also write velocities, in units per second; they go into OUT if its format holds them.",
)


def _allow_folders(context: click.Context, parameter: click.Parameter, value: tuple[str, ...]) -> tuple[str, ...]:
    """Click callback: until the command ends, let files that are read refer to files in these folders."""
    folders = tuple(map(os.path.abspath, value))
    if folders:
        from pdecodec.system.reading import asset_folders_allowed

        context.with_resource(asset_folders_allowed(folders))
    return folders


def assets_option(**keywords: Any) -> Decorator:
    """Return ``--assets``; by default the command receives the folders as an argument."""
    return click.option(
        "--assets",
        "asset_folders",
        multiple=True,
        metavar="DIR",
        callback=_allow_folders,
        help="Let files that are read refer to files in this folder (buffers, layers, heavy data), in addition to "
        "their own folder. May be repeated; PDECODEC_ASSET_FOLDERS lists more folders.",
        **keywords,
    )


read_options = option_group(
    fps_option,
    click.option("--mesh", metavar="FILE", help="File with the faces and names for a point cache (MDD, PC2)."),
    click.option(
        "--clip", metavar="NAME", help="Animation of IN to read, if it has several (glTF).  [default: the first]"
    ),
    click.option(
        "--displacement",
        metavar="NAME|none",
        help="Vectors of IN to add to its geometry (VTK, XDMF, Exodus).  [default: those that the format defines]",
    ),
    click.option(
        "--solids",
        type=click.Choice(["surface", "keep"]),
        help="Solid elements of IN (VTK, XDMF, Exodus). surface: read their surface alone. keep: keep all elements as "
        "cells, with their data, and all nodes.  [default: surface]",
    ),
    click.option(
        "--transforms",
        type=click.Choice(["bake", "keep"]),
        default="bake",
        show_default=True,
        help="bake: apply the transforms above objects (Alembic, USD) to positions. keep: store them separately, "
        "unless the output format has no transforms.",
    ),
    click.option(
        "--skip-unsupported",
        is_flag=True,
        help="Skip objects of IN that cannot be read, instead of refusing the input.",
    ),
    click.option(
        "--isolate", is_flag=True, help="Read IN in a subprocess, so that a malicious file cannot crash pdecodec."
    ),
    assets_option(),
)
"""How to read the input: fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""

max_output_option = click.option(
    "--max-output",
    callback=parse_bytes,
    metavar="BYTES",
    help="Refuse .pdeanim files that declare more bytes of positions than this, such as 10GB.",
)

limit_options = option_group(
    click.option(
        "--max-memory",
        callback=parse_bytes,
        metavar="BYTES",
        help="Refuse .pdeanim files that need more memory than this, such as 2G.  [default: 4G]",
    ),
    max_output_option,
)
"""Limits on a file, `max_memory` and `max_output`, for :func:`decode_limits`."""

place_options = option_group(
    click.option(
        "--up-axis",
        type=click.Choice(["X", "Y", "Z"], case_sensitive=False),
        help="Rotate the scene so that this axis points up. If IN does not state its up axis, record this one instead.",
    ),
    click.option("--scale", type=float, default=1.0, metavar="X", help="Multiply positions by X, and adapt the unit."),
    click.option("--unit", metavar="UNIT", help="Length of one unit of IN, if IN does not state it: cm, m, '2.5 m'."),
)
"""How to rotate and scale the scene: fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""

input_options = option_group(frames_option, objects_option, read_options, place_options)
"""All fields of :class:`pdecodec.formats.base.choosing.InputOptions`."""


def motion_options(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--motion`` and its bound, as one argument `motion`: settings of the encoder, or None."""

    @functools.wraps(command)
    def settled(
        *arguments: Any, motion: bool, tolerance: float | None, max_error: float | None, effort: str, **options: Any
    ) -> None:
        from pdecodec.codec.settings import EncodeSettings

        if not motion and (tolerance is not None or max_error is not None):
            name = "--max-error" if tolerance is None else "--tolerance"
            raise SettingsError(f"{name} is for --motion or a .pdeanim OUT; leave it out")
        if motion and (options.get("rigid") or options.get("straight")):
            told = (
                "--rigid moves nodes, and --motion vertices" if options["rigid"] else "--motion has no --straight lines"
            )
            raise SettingsError(f"{told}; leave one out", code="conflicting-settings")
        chosen = EncodeSettings(tolerance=tolerance, max_error=max_error, effort=effort) if motion else None  # type: ignore[arg-type]
        command(*arguments, motion=chosen, **options)

    return option_group(
        click.option(
            "--motion",
            is_flag=True,
            help="glTF: store a .pdeanim file that moves the meshes (extension PDECODEC_mesh_motion) instead of morph "
            "targets. Viewers without the extension show the first frame. A whole .pdeanim IN is not encoded again, "
            "unless an error is given.",
        ),
        click.option(
            "--tolerance",
            type=fraction,
            metavar="X|P%",
            help="With --motion: largest error of a vertex, as a fraction of the diagonal of frame 0's bounding box.  "
            "[default: 0.001]",
        ),
        click.option(
            "--max-error",
            type=float,
            metavar="X",
            help="With --motion: largest error of a vertex in scene units, instead of --tolerance.",
        ),
        effort_option("With --motion: how many ways to encode are compared."),
    )(settled)


write_options = option_group(
    velocities_option,
    click.option(
        "--scene",
        type=click.Choice(["keep", "drop"]),
        default="keep",
        show_default=True,
        help="keep: if IN, a .pdeanim file, carries the scene around its motion in the format of OUT, write that scene "
        "with the motion, as --onto does. drop: write the meshes alone.",
    ),
    click.option(
        "--web", is_flag=True, help="glTF: write the smallest file; the same as --quantize --meshopt --rigid."
    ),
    click.option(
        "--quantize",
        is_flag=True,
        help="glTF: store positions and weights in 16 bits, normals in 8; a note gives the error.",
    ),
    click.option(
        "--meshopt", is_flag=True, help="glTF: compress without loss, for viewers that support meshoptimizer."
    ),
    click.option(
        "--straight",
        is_flag=True,
        help="glTF: interpolate linearly between frames, as most scenes do, instead of along the splines of a .pdeanim "
        "file.",
    ),
    click.option(
        "--rigid/--no-rigid",
        default=None,
        help="glTF, Alembic, USD: write objects of a .pdeanim file that move rigidly, within its error bound, as "
        "moving nodes. In glTF, objects of several rigid parts become skins. A note gives the error.  "
        "[default: on for glTF and Alembic]",
    ),
    motion_options,
)
"""Options of :func:`pdecodec.formats.write_sequence`: data in addition to positions, and compact files."""


def is_gltf(path: str) -> bool:
    """Return whether a path names a glTF output, which has options of its own."""
    from pdecodec.formats.base.registry import format_to_write

    return format_to_write(path).name == "gltf"


def say_larger(name: str, path: str, before: int, after: int, is_small: bool) -> None:
    """Print a note if a glTF output is larger than its input, and which options make it smaller."""
    if after > before > 0 and is_gltf(path):
        less = (
            ""
            if is_small
            else "; --web makes it smaller (--quantize, --meshopt and --rigid); --web and --scene drop leave out scenes"
        )
        say(f"note: {name} is {after / before:.3g} times as large as IN ({byte_size(after - before)} more){less}")


def check_growth(compare: str | None, fail_if_larger: float | None) -> None:
    """Refuse ``--fail-if-larger`` without ``--compare``."""
    if fail_if_larger is not None and compare is None:
        raise SettingsError("--fail-if-larger needs --compare; pass the file with the earlier sizes")


def rigid_bound(
    source: MeshSequence, scale: float, output: str, asked: bool | None, *, with_scene: bool, has_motion: bool
) -> float | None:
    """Return the bound for ``--rigid``: that of the decoded file, scaled as its positions are [scene units].

    With ``--motion`` it is 0 if rigid objects are not to be nodes, else None.
    """
    from pdecodec.codec.decoder import Animation
    from pdecodec.formats.base.opening import carries_scene_of
    from pdecodec.formats.base.registry import format_to_write

    entry = format_to_write(output)
    is_unasked = (
        asked is None
        and not has_motion
        and entry.finds_rigid_parts
        and not (with_scene and carries_scene_of(source, entry))
    )
    if not (asked or is_unasked):
        return 0.0 if asked is False else None
    from pdecodec.codec.stored_choices import bound_of  # loads the encoder, which other outputs do not need

    is_animation = isinstance(source, Animation) and len(source.runs) == 1
    bound = bound_of(source) if isinstance(source, Animation) and is_animation else None
    if bound is None and asked:
        needed = "needs a bound, and the file was encoded without one"
        other = "needs a .pdeanim file of one connectivity as its input"
        raise SettingsError(f"--rigid {needed if is_animation else other}; leave it out")
    return None if bound is None else scale * bound


def within_limits(command: Callable[..., None]) -> Callable[..., None]:
    """Add ``--max-memory`` and ``--max-output`` for every `.pdeanim` file that a command opens."""

    @functools.wraps(command)
    def limited(*arguments: Any, max_memory: int | None, max_output: int | None, **options: Any) -> None:
        from pdecodec.codec.source import usual_limits

        with usual_limits(decode_limits(max_memory, max_output)):
            command(*arguments, **options)

    return limit_options(limited)


def decode_limits(max_memory: int | None, max_output: int | None) -> DecodeLimits:
    """Return the limits that the options set, with the default for an option that is absent."""
    from pdecodec.codec.source import DecodeLimits

    usual = DecodeLimits()
    return DecodeLimits(max_memory=usual.max_memory if max_memory is None else max_memory, max_output=max_output)


def refuse_pdeanim(output: str, instead: str) -> None:
    """Raise SettingsError with the advice `instead` if a command that does not encode is to write a `.pdeanim` file."""
    if output.lower().endswith(".pdeanim"):
        raise SettingsError(f"only pdecodec encode writes .pdeanim files; {instead}", path=output)


def check_output(output: str, *, overwrite: bool) -> None:
    """Refuse an output that cannot be written, before any work on it starts.

    Raises
    ------
    SettingsError
        If the output is ``-``, or names neither a format nor a folder.
    InputError
        If it exists and may not be replaced, or its folder is missing or not writable.
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
        raise SettingsError("-o -: this command cannot write to standard output; name a file, folder/ or pattern")
    if not Path(output).suffix and not output.endswith("/") and not Path(output).is_dir():
        known = extensions_of(lambda entry: entry.writes)
        raise SettingsError(
            f"has no extension; write {output}/ for a folder of frames, or add one of {known}", path=output
        )


def check_apart(sources: Iterable[str | None], outputs: Iterable[str]) -> None:
    """Refuse outputs that would replace an input or a file that an input refers to.

    Raises
    ------
    SettingsError
        If an output would replace a file of an input, by whatever name or link.
    """
    from pdecodec.formats.base.companions import input_files, output_files

    inputs = {os.path.realpath(file) for source in sources if source is not None for file in input_files(source)}
    for output in outputs:
        shared = [file for file in output_files(output) if os.path.realpath(file) in inputs]
        if shared:
            raise SettingsError(
                f"{output}: would replace {shared[0]}, which is an input; choose another name", code="overwrites-input"
            )


def stored_bytes(files: Iterable[Path]) -> int:
    """Return the total size of files on disk [bytes]."""
    return sum(file.stat().st_size for file in files)


def bytes_of(place: str, files: Iterable[Path]) -> int:
    """Return the size of an input or output [bytes]: of its local files, or of the remote file."""
    return RemoteFile(place).size() if is_address(place) else stored_bytes(files)
