"""The files that a path stands for: those that are read with it, and those that writing to it replaces."""

from __future__ import annotations

import json
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import unquote
from xml.etree import ElementTree

from pdecodec.errors import InputError
from pdecodec.formats.base.frame_files import find_frames, frames_there, is_frame_pattern
from pdecodec.formats.base.registry import format_of_extension, known_extensions, load
from pdecodec.system.storage import is_address

_XDMF = (".xdmf", ".xmf")

_USD = (".usd", ".usda", ".usdc")


def frame_extensions() -> set[str]:
    """Extensions of the formats that keep a frame per file."""
    return set(known_extensions(lambda entry: entry.frame_per_file))


def input_files(source: str) -> tuple[Path, ...]:
    """The files of an input: one and those that it names, or all its frames; none where there is no such file, and of
    one elsewhere.

    Raises
    ------
    InputError
        If a folder or pattern does not stand for one whole sequence.
    """
    if is_address(source):
        return ()
    path = Path(source)
    if path.is_file():
        # A library names a file by another path than the user did: one file counts once.
        found: dict[Path, Path] = {}
        for file in (path, *_named_by(path)):
            found.setdefault(file.resolve(), file)
        return tuple(found.values())
    suffixes = {file.suffix.lower() for file in path.iterdir()} if path.is_dir() else {path.suffix.lower()}
    return tuple(file for extension in suffixes & frame_extensions() for file in find_frames(path, extension).paths)


def check_there(source: str) -> None:
    """Raise InputError where a path is no file, no folder and no pattern of frames that are there."""
    path = Path(source)
    if is_address(source) or path.exists() or (is_frame_pattern(path) and frames_there(path)):
        return
    raise InputError("there is no such file; check the name", code="file-missing", path=path)


def output_files(output: str) -> list[Path]:
    """Files that writing to a file, pattern or folder would replace; after writing, what was written."""
    path = Path(output)
    if path.is_dir():
        return sorted(file for file in path.iterdir() if file.suffix.lower() in frame_extensions())
    if is_frame_pattern(path):
        return frames_there(path)
    beside: list[Path] = []
    if path.suffix.lower() in (".xdmf", ".xmf"):
        beside = [path.with_suffix(".h5")]
    elif path.suffix.lower() == ".pvd":
        beside = frames_there(path.with_name(f"{path.stem}.####.vtu"))
    # Links count where they lead nowhere, too.
    return [one for one in (path, *beside) if one.exists() or one.is_symlink()]


def _named_by(path: Path) -> Iterator[Path]:
    """Files that a file names and that are there; none where it is damaged: readers say so."""
    suffix, entry = path.suffix.lower(), format_of_extension(path)
    names: list[str] = []
    try:
        if suffix in _XDMF:
            for item in ElementTree.parse(path).getroot().iter():
                if item.get("Format", "").upper() in ("HDF", "BINARY"):
                    names.append((item.text or "").strip().partition(":")[0])
                elif str(item.tag).endswith("}include"):
                    names.append(item.get("href", ""))
        elif entry is not None and entry.companions is not None:
            yield from (file for file in load(entry, entry.companions, "read", path)(path) if file.is_file())
        elif suffix == ".gltf":
            buffers = json.loads(path.read_bytes()).get("buffers", [])
            names += [
                unquote(str(one.get("uri", ""))) for one in buffers if not str(one.get("uri")).startswith("data:")
            ]
        elif suffix in _USD:
            yield from _layers(path)
    except (OSError, ValueError, AttributeError, RecursionError, ElementTree.ParseError):
        return
    for name in filter(None, names):
        found = path.parent / name
        if "\0" not in name and found.is_file():
            yield found


def _layers(path: Path) -> Iterator[Path]:
    """Files of the layers that a USD stage is made of."""
    try:
        from pxr import Sdf, Tf
    except ModuleNotFoundError:
        return
    left, seen = [str(path)], set()
    while left:
        name = left.pop()
        if name in seen:
            continue
        seen.add(name)
        try:
            layer = Sdf.Layer.FindOrOpen(name)
        except Tf.ErrorException:
            continue
        if layer:
            yield Path(layer.realPath)
            left += [layer.ComputeAbsolutePath(one) for one in layer.GetCompositionAssetDependencies()]
