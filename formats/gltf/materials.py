"""Copy materials of a glTF file into another one, with their textures and images."""

from __future__ import annotations

import copy
import os
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import quote, unquote

import numpy as np

from pdecodec.errors import damaged
from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.file import GltfFile
from pdecodec.formats.gltf.inventory import WRITTEN_MATERIAL

Entry = dict[str, Any]


class Materials:
    """Materials by name, each written once.

    Parameters
    ----------
    builder : GltfBuilder
        Builds the file that is written.
    source : GltfFile or None
        File whose materials of the same names are copied.
    old, new : pathlib.Path
        Folders of the two files, which the URIs of images are relative to.
    """

    def __init__(self, builder: GltfBuilder, source: GltfFile | None, old: Path, new: Path) -> None:
        self._builder, self._source, self._folders = builder, source, (old, new)
        self._known: dict[tuple[str, int | str], int] = {}
        self._there: dict[str, Mapping[str, Any]] = {}
        for number, entry in enumerate([] if source is None else source.listed("materials")):
            self._there.setdefault(material_name(entry, number), entry)

    def index(self, label: str) -> int:
        """Return the index of the material with this name; InputError if the source lacks something that the
        material uses.
        """
        try:
            return self._once("materials", label, lambda: self._material(label))
        except (AttributeError, IndexError, KeyError, TypeError, ValueError) as error:
            raise damaged(f"material {label!r} is damaged ({error}); export the file again") from error

    def _once(self, kind: str, key: int | str, make: Any) -> int:
        if (kind, key) not in self._known:
            self._known[kind, key] = self._builder.add(kind, make())
        return self._known[kind, key]

    def _material(self, label: str) -> Entry:
        if label not in self._there:
            return {"name": label, **WRITTEN_MATERIAL}
        found = {**copy.deepcopy(dict(self._there[label])), "name": label}
        for reference in _textures_in(found):
            number = reference["index"]
            reference["index"] = self._once("textures", number, lambda number=number: self._texture(number))
        self._use_extensions(found)
        return found

    def _entry(self, kind: str, number: int) -> Entry:
        assert self._source is not None
        if number < 0:
            raise IndexError(f"{kind} {number}")
        return copy.deepcopy(dict(self._source.listed(kind)[number]))

    def _texture(self, number: int) -> Entry:
        found = self._entry("textures", number)
        for holder in (found, *found.get("extensions", {}).values()):
            if "source" in holder:
                image = holder["source"]
                holder["source"] = self._once("images", image, lambda image=image: self._image(image))
        if "sampler" in found:
            sampler = found["sampler"]
            found["sampler"] = self._once("samplers", sampler, lambda: self._entry("samplers", sampler))
        self._use_extensions(found)
        return found

    def _image(self, number: int) -> Entry:
        assert self._source is not None
        found = self._entry("images", number)
        if "bufferView" in found:
            data = np.frombuffer(self._source.view_bytes(found["bufferView"]), np.uint8)
            found["bufferView"] = self._builder.view(data)
        elif "uri" in found:
            found["uri"] = image_from(found["uri"], *self._folders)
        return found

    def _use_extensions(self, entry: Any) -> None:
        """Declare the extensions of an entry as the source declares them."""
        assert self._source is not None
        required = self._source.root.get("extensionsRequired", ())
        for holder in _dicts(entry):
            for name in holder.get("extensions", {}):
                self._builder.use(name, is_required=name in required)


def _dicts(entry: Any) -> Iterator[Entry]:
    """Yield an object and all objects in it."""
    if isinstance(entry, dict):
        yield entry
    for one in entry.values() if isinstance(entry, dict) else entry if isinstance(entry, list) else ():
        yield from _dicts(one)


def _textures_in(material: Entry) -> Iterator[Entry]:
    """Yield the references to textures in a material and its extensions."""
    for holder in list(_dicts(material)):
        for key, value in holder.items():
            if key.endswith("Texture") and isinstance(value, dict) and isinstance(value.get("index"), int):
                yield value


def material_name(entry: Mapping[str, Any], number: int) -> str:
    """Return the name of a material, or a default with its number."""
    return str(entry.get("name") or f"material_{number}")


def image_from(uri: str, old: Path, new: Path) -> str:
    """Return the URI of an image relative to the folder `new` instead of `old`."""
    if uri.startswith("data:") or "://" in uri or old.resolve() == new.resolve():
        return uri
    return quote(Path(os.path.relpath(old / unquote(uri), new)).as_posix())
