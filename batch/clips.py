"""The clips of a batch, from a manifest, a pattern or a folder, each with its options."""

from __future__ import annotations

import csv
import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, fields, replace
from glob import escape, glob, has_magic
from pathlib import Path, PurePosixPath
from typing import Any

from pdecodec.batch.records import STATE_FOLDER
from pdecodec.codec.presets import PresetName, preset_named
from pdecodec.codec.settings import (
    EncodeSettings,
    PaperSettings,
    check_one_target,
    parse_byte_count,
    parse_fraction,
    parse_named_field_setting,
)
from pdecodec.errors import InputError, SettingsError, damaged, unreadable
from pdecodec.formats.base.choosing import InputOptions
from pdecodec.formats.base.companions import check_exists, frame_extensions, input_files
from pdecodec.formats.base.frame_files import gather_frames, is_frame_pattern, sequence_name, sequences_in
from pdecodec.formats.base.registry import known_extensions
from pdecodec.system.arguments import shown
from pdecodec.system.reading import read_regular
from pdecodec.system.storage import RemoteFile, is_address

MANIFESTS = (".csv", ".json", ".jsonl")
"""Extensions of manifests."""

LIST_SEPARATOR = ";"
"""Separator of object names in a cell of a CSV manifest."""

_PAPER = tuple(item.name for item in fields(PaperSettings))
_CODING = tuple(item.name for item in fields(EncodeSettings) if item.name != "paper")
_WORDS = {"true": True, "yes": True, "1": True, "false": False, "no": False, "0": False}


@dataclass(frozen=True, kw_only=True)
class ClipOptions(InputOptions):
    """Options to read, place and encode a clip, by the names of the options of ``pdecodec encode``.

    Attributes
    ----------
    settings : EncodeSettings
    rms : float or None
        Largest root mean square error, divided by the diagonal, instead of a tolerance.
    size : int or None
        Largest size of the file [bytes], instead of a tolerance.
    preset : str or None
        What the file is for, instead of a tolerance; `settings` have its effort, unless another one was given.
    """

    settings: EncodeSettings = field(default_factory=EncodeSettings)
    rms: float | None = None
    size: int | None = None
    preset: PresetName | None = None

    def __post_init__(self) -> None:
        bounds = {name: getattr(self.settings, name) for name in ("tolerance", "max_error")}
        check_one_target({"preset": self.preset, **bounds, "rms": self.rms, "size": self.size})
        preset_named(self.preset)

    def to_json(self) -> dict[str, Any]:
        """Return a JSON object for the record of a clip, without the folders in which files lie."""
        mesh = None if self.mesh is None else os.path.basename(self.mesh)
        values = {**asdict(self), "objects": list(self.objects), "mesh": mesh}
        del values["asset_folders"]
        if self.preset is None:
            del values["preset"]  # records from before there were presets lack it
        return values

    def with_values(self, values: Mapping[str, Any]) -> ClipOptions:
        """Return a copy with some options replaced, by name; text is converted to the type of the option.

        Raises
        ------
        SettingsError
            If there is no such option, or a value is not valid for it.
        """
        if not values:
            return self
        found = {name: _value(name, value) for name, value in values.items()}
        own = {name: value for name, value in found.items() if name not in (*_CODING, *_PAPER)}
        coding = {name: value for name, value in found.items() if name in _CODING}
        if {"preset", "tolerance", "max_error", "rms", "size"} & set(found):
            # A new bound replaces any other kind of bound, and the effort that came with a preset.
            coding = {"tolerance": None, "max_error": None, **coding}
            own = {"rms": None, "size": None, "preset": None, **own}
            if self.settings.effort == preset_named(self.preset).effort:
                coding = {"effort": preset_named(own["preset"]).effort, **coding}
        paper = {name: value for name, value in found.items() if name in _PAPER}
        settings = replace(self.settings, **coding, paper=replace(self.settings.paper, **paper))
        return replace(self, settings=settings, **own)


OPTION_NAMES = (*_CODING, *_PAPER, *(item.name for item in fields(ClipOptions) if item.name != "settings"))
"""Every option that a clip of a manifest may have."""

_KINDS: dict[str, type] = {
    **dict.fromkeys(
        ("tolerance", "max_error", "rms", "uv_tolerance", "field_tolerance", "alpha", "r", "fps", "scale"), float
    ),
    **dict.fromkeys(("size", "max_memory", "group_frames", "segment_frames", "piece_points"), int),
    **dict.fromkeys(("skip_unsupported", "isolate", "why"), bool),
    **dict.fromkeys(("objects", "asset_folders"), tuple),
    "fields": dict,
}
"""The types of options that are not text."""

_FRACTIONS = ("tolerance", "rms", "field_tolerance")
"""Options that may be given as 0.1%."""

_BYTES = ("size", "max_memory")
"""Options that may be given as 200kB."""


def _value(name: str, value: Any) -> Any:
    if name not in OPTION_NAMES:
        raise SettingsError(
            f"there is no option {name!r}; use source, output, {', '.join(OPTION_NAMES)}", code="unknown-name"
        )
    if value is None:
        return None
    kind = _KINDS.get(name, str)
    try:
        if isinstance(value, bool) and kind is not bool:
            raise ValueError
        if kind is tuple:
            return tuple(value.split(LIST_SEPARATOR) if isinstance(value, str) else map(str, value))
        if kind is dict and isinstance(value, str):
            return dict(map(parse_named_field_setting, value.split(LIST_SEPARATOR)))
        if kind is bool:
            return _WORDS[str(value).strip().lower()]
        if kind is str and not isinstance(value, str):
            raise ValueError
        if name in _FRACTIONS and isinstance(value, str):
            return parse_fraction(value)
        if name in _BYTES and isinstance(value, str):
            return parse_byte_count(value)
        if kind is int and isinstance(value, float) and not value.is_integer():
            raise ValueError
        return kind(value)
    except (KeyError, ValueError, TypeError, OverflowError) as error:
        what = {
            float: "a number",
            int: "a whole number",
            bool: "true or false",
            tuple: "a list of names",
            dict: "NAME=X;NAME=X",
        }
        wanted = "a number of bytes such as 200kB" if name in _BYTES else what.get(kind, "text")
        raise SettingsError(f"must be {wanted}, not {value!r}", setting=name) from error


@dataclass(frozen=True, kw_only=True)
class Clip:
    """One clip: its source, its output and its options.

    Attributes
    ----------
    source : str
        A file, a frame pattern or a folder of frames.
    output : str
        Path of its file in the folder of the batch, with slashes, ending in ``.pdeanim``.
    options : ClipOptions
    """

    source: str
    output: str
    options: ClipOptions = field(default_factory=ClipOptions)


def clips_of(
    given: str | os.PathLike[str] | Sequence[str | os.PathLike[str]], options: ClipOptions | None = None
) -> list[Clip]:
    """Return the clips of a manifest, a pattern or a folder, or of several of them.

    Parameters
    ----------
    given : path or sequence of paths
        A manifest: ``.csv`` with a header; ``.json``, a list of objects, or an object with ``defaults`` and ``clips``;
        ``.jsonl``, one object per line. It gives the ``source`` of each clip, optionally its ``output``, and options
        by name; relative paths start at the manifest's folder. A pattern with ``*``, ``?``, ``[]`` or ``**``. A
        folder: every clip in it and its subfolders, except ``.pdeanim`` files. Any other path is one clip. With
        several paths, as a shell lists them, frames of one sequence are one clip, and outputs are named relative to
        their common folder.
    options : ClipOptions, optional
        Options for clips whose manifest does not set them.

    Returns
    -------
    list of Clip
        In order; no two have the same output.

    Raises
    ------
    InputError
        If there is no clip, or the manifest cannot be read.
    SettingsError
        If an option of a clip is wrong, or two clips would go to one file.
    """
    options = options or ClipOptions()
    listed = [given] if isinstance(given, str | os.PathLike) else given
    paths = gather_frames([os.fspath(one) for one in listed], frame_extensions())
    manifests = [one for one in paths if Path(one).suffix.lower() in MANIFESTS]
    folders = [os.path.abspath(_fixed_part(one)) for one in paths if not is_address(one) and one not in manifests]
    root = os.path.commonpath(folders) if len(folders) > 1 else None
    clips: list[Clip] = []
    for manifest in manifests:
        rows = list(_of_manifest(Path(manifest), options))
        if not rows:
            raise InputError("this manifest lists no clip; write one row per clip", code="no-frames", path=manifest)
        clips += rows
    found = [place for one in paths if one not in manifests for place in _sources(one, root)]
    clips += _named(found, options)
    if not clips:
        raise InputError(
            "there is no mesh sequence; name a manifest, a pattern in quotes or a folder",
            code="no-frames",
            path=next(iter(paths), None),
        )
    _check_outputs(clips)
    return clips


def _sources(given: str, root: str | None) -> list[tuple[str, str]]:
    """Return clips of a file, pattern or folder, each with its path below `root` (default: the named folder)."""
    path = Path(given)
    if is_address(given):
        sources = [given]
    elif path.is_dir():
        sources, root = _in_folder(given), root or given
    elif has_magic(given) and not path.exists():
        sources = gather_frames(sorted(filter(_is_clip, _matches(given))), frame_extensions())
        root = root or _fixed_part(given)
    else:
        check_exists(given)
        sources = [given]
    return [(source, _below(source, str(path.parent) if root is None else root)) for source in sources]


def _of_manifest(path: Path, options: ClipOptions) -> Iterator[Clip]:
    rows = _rows(path)
    places: list[tuple[int, Clip]] = []
    unnamed: list[tuple[str, str]] = []
    for number, row in rows:
        try:
            if not isinstance(row, Mapping):
                raise SettingsError("is not an object with a source")
            values = {str(name): value for name, value in row.items() if value not in (None, "")}
            source, output = values.pop("source", None), values.pop("output", "")
            if not isinstance(source, str) or not isinstance(output, str):
                there = f" among {', '.join(values)}" if values else ""
                raise SettingsError(f"has no source{there}; name the file, pattern or folder of the clip")
            for name in (source, output, *(one for one in values.values() if isinstance(one, str))):
                if "\0" in name or not _is_encodable(name):
                    raise SettingsError(f"no file can be called {shown(name)}; give another name")
            own = options.with_values(values)
        except SettingsError as error:
            raise SettingsError(f"clip {number}: {error}", code=error.code, path=path) from error
        if own.mesh is not None and "mesh" in values:
            own = replace(own, mesh=_seen_from(path, own.mesh))
        if "asset_folders" in values:
            own = replace(own, asset_folders=tuple(_seen_from(path, folder) for folder in own.asset_folders))
        whole = _seen_from(path, source)
        unnamed.append((whole, _below(whole, str(path.parent))))
        places.append((number, Clip(source=whole, output=_checked_output(output, path, number), options=own)))
    for (_, clip), named in zip(places, _named(unnamed, options), strict=True):
        yield clip if clip.output else replace(clip, output=named.output)


def _is_encodable(name: str) -> bool:
    """Return whether the system can encode a name; it cannot encode half of a surrogate pair."""
    try:
        os.fsencode(name)
    except UnicodeEncodeError:
        return False
    return True


def _rows(path: Path) -> list[tuple[int, Any]]:
    """Return the rows of a manifest, numbered from 1; those of a JSON object include its defaults."""
    try:
        text = read_regular(path).decode("utf-8-sig")
        if path.suffix.lower() == ".csv":
            found: Any = list(csv.DictReader(text.splitlines(), restkey="a column without a name", strict=True))
        elif path.suffix.lower() == ".jsonl":
            found = [json.loads(line) for line in text.splitlines() if line.strip()]
        else:
            found = json.loads(text)
    except OSError as error:
        raise unreadable(error, path, "check the name") from error
    except (ValueError, csv.Error, RecursionError) as error:
        message = f"is not a manifest of clips ({error}); docs/pipelines.md shows one"
        raise damaged(message, path=path) from error
    if isinstance(found, Mapping):
        defaults, found = found.get("defaults", {}), found.get("clips")
        if isinstance(defaults, Mapping) and isinstance(found, list):
            found = [{**defaults, **row} if isinstance(row, Mapping) else row for row in found]
    if not isinstance(found, list):
        raise damaged("is not a manifest; write a list of clips, or an object with a list named clips", path=path)
    return list(enumerate(found, 1))


def _seen_from(manifest: Path, source: str) -> str:
    return source if is_address(source) else os.path.join(manifest.parent, source)


def _checked_output(output: str, path: Path, number: int) -> str:
    if not output:
        return ""
    place = PurePosixPath(output)
    if place.is_absolute() or ".." in place.parts or place.suffix.lower() != ".pdeanim":
        raise SettingsError(
            f"clip {number}: output {output!r} is not a .pdeanim file in the folder of the batch; name one", path=path
        )
    return str(place)


def _named(found: Sequence[tuple[str, str]], options: ClipOptions) -> list[Clip]:
    """Return clips named by path: ``.pdeanim`` replaces the extension, or follows it if names would collide."""
    short = [str(_stem(place)) for _, place in found]
    counts = Counter(short)
    return [
        Clip(source=source, output=f"{name if counts[name] == 1 else place}.pdeanim", options=options)
        for (source, place), name in zip(found, short, strict=True)
    ]


def _stem(place: str) -> PurePosixPath:
    path = PurePosixPath(place)
    if is_frame_pattern(Path(path.name)):
        return path.with_name(sequence_name(Path(path.name)))
    return path.with_suffix("") if path.suffix.lower() in known_extensions(lambda _: True) else path


def _below(source: str, root: str) -> str:
    """Return the path of a source relative to a folder, with slashes; only its name if it lies elsewhere."""
    if is_address(source):
        return RemoteFile(source).name
    place = Path(os.path.relpath(source, root or "."))
    if ".." in place.parts or place.is_absolute() or not place.name:
        return Path(os.path.abspath(source)).name
    return place.as_posix()


def _fixed_part(pattern: str) -> str:
    """Return the folders of a pattern before the first wildcard; for a path, its folder."""
    parts = Path(pattern).parts
    fixed = next((index for index, part in enumerate(parts) if has_magic(part)), len(parts) - 1)
    return str(Path(*parts[:fixed])) if fixed > 0 else "."


def _matches(pattern: str) -> Iterator[str]:
    """Yield the paths that a pattern matches; unlike :func:`glob.glob`, follow no link back to a parent."""
    steps = Path(pattern).parts
    if "**" not in steps:
        yield from glob(pattern)
        return
    at = steps.index("**")
    rest = Path(*steps[at + 1 :])
    for top in glob(str(Path(*steps[:at]))):
        for folder in _folders_under(top):
            if rest.parts:
                yield from _matches(str(Path(escape(folder), rest)))
            else:
                yield from (str(Path(folder)), *glob(str(Path(escape(folder), "*"))))


def _folders_under(folder: str, above: tuple[str, ...] = ()) -> Iterator[str]:
    """Yield a folder and its subfolders at any depth, except hidden ones."""
    real = os.path.realpath(folder)
    if real in above:
        return
    yield folder
    with suppress(OSError):  # a folder without permission to read counts as empty
        for name in sorted(os.listdir(folder)):
            if not name.startswith(".") and os.path.isdir(os.path.join(folder, name)):
                yield from _folders_under(os.path.join(folder, name), (*above, real))


def _is_clip(name: str) -> bool:
    """Return whether a path is a clip: a file of a known format, or a folder of frames."""
    path = Path(name)
    if path.is_dir():
        return bool(_frames_in(path))
    return path.suffix.lower() in known_extensions(lambda entry: entry.reads)


def _in_folder(folder: str) -> list[str]:
    """Return every clip in a folder and its subfolders: files with one clip each, and sequences of frames."""
    whole = known_extensions(lambda entry: entry.reads and not entry.frame_per_file and entry.name != "pdeanim")
    found: list[tuple[str, Path]] = []
    companions: set[str] = set()
    for name, folders, files in os.walk(folder):
        folders[:] = sorted(one for one in folders if not one.startswith("."))
        here = Path(name)
        for file in sorted(files):
            if not file.startswith(".") and Path(file).suffix.lower() in whole:
                found.append((str(here / file), here / file))
                companions.update(os.path.realpath(one) for one in input_files(str(here / file))[1:])
        found += _frames_in(here)
    return sorted(source for source, first in found if os.path.realpath(first) not in companions)


def _frames_in(folder: Path) -> list[tuple[str, Path]]:
    """Return the sequences of frames in a folder, each with its first file; for a single one, the folder itself."""
    found = [one for extension in sorted(frame_extensions()) for one in sequences_in(folder, extension)]
    return [(str(folder) if len(found) == 1 else str(one), Path(one[0])) for one in found]


def _check_outputs(clips: Iterable[Clip]) -> None:
    taken: dict[str, Clip] = {}
    for clip in clips:
        for name in (clip.source, clip.output):
            if len(name.splitlines()) > 1 or name != name.rstrip("\r\n"):
                raise SettingsError(f"{name!r} has a line break, which lists of clips cannot hold; rename it")
        if PurePosixPath(clip.output).parts[0].lower() == STATE_FOLDER:
            raise SettingsError(f"{clip.output}: {STATE_FOLDER} holds the records of the batch; name another output")
        # Some file systems do not distinguish upper and lower case.
        other = taken.setdefault(clip.output.lower(), clip)
        if other is not clip:
            raise SettingsError(
                f"{other.source} and {clip.source} would both go to {clip.output}; name outputs in a manifest",
                code="overwrites-input",
            )
