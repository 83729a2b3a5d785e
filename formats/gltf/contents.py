"""List everything that a glTF file holds, by its place in the JSON, and what happens to it."""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from pdecodec.formats.gltf.animation import Nodes, find_channel_targets
from pdecodec.formats.gltf.file import (
    READABLE_EXTENSIONS,
    TRIANGLE_FAN,
    TRIANGLE_STRIP,
    TRIANGLES,
    GltfFile,
)
from pdecodec.formats.gltf.inventory import OWN_EXTRAS, is_as_written
from pdecodec.mesh.sequence import Content, Fate

_CONTAINERS = ("accessors", "bufferViews", "buffers")
"""Lists whose entries only hold data for other entries."""

_SURFACE = (TRIANGLES, TRIANGLE_STRIP, TRIANGLE_FAN)


class Contents:
    """Everything that a glTF file holds.

    Parameters
    ----------
    file, nodes
    clip_number : int
        The animation that is read.
    moving : collection of int
        Nodes that move meshes that are read: those with the meshes, their ancestors, and joints.
    left_out : mapping of int to sequence of str
        For each node with a mesh that is read, names of what is not kept.
    """

    def __init__(
        self,
        file: GltfFile,
        nodes: Nodes,
        clip_number: int,
        moving: Collection[int],
        left_out: Mapping[int, Sequence[str]],
    ) -> None:
        self._file, self._moving = file, moving
        self._words: dict[int, list[str]] = {}
        self._skins = {nodes.entries[node].get("skin") for node in left_out}
        self._skinned = set[int]()
        for node, words in left_out.items():
            mesh = nodes.entries[node]["mesh"]
            self._words.setdefault(mesh, []).extend(words)
            self._skinned |= {mesh} if "skin" in nodes.entries[node] else set()
        self._read = {
            "scenes": {file.root.get("scene", 0)},
            "nodes": set(moving),
            "meshes": set(self._words),
            "skins": self._skins,
            "animations": {clip_number},
            "materials": {
                one.get("material")
                for number in self._words
                for one in file.listed("meshes")[number]["primitives"]
                if one.get("mode", TRIANGLES) in _SURFACE
            },
        }

    def list(self) -> tuple[Content, ...]:
        """Return the entries of all lists, the parts of meshes, animations and materials, extensions and extras."""
        return tuple(self._all())

    def _all(self) -> Iterator[Content]:
        root = self._file.root
        asset = root.get("asset", {})
        for key in asset:
            if key not in ("extras", "extensions"):
                yield Content(f"/asset/{key}", f"asset.{key}", "dropped" if key == "copyright" else "implied")
        yield from self._additions("/asset", "asset", asset)
        yield from self._additions("", "the file", root)
        for kind, entries in root.items():
            for number, entry in enumerate(entries if isinstance(entries, list) else ()):
                if isinstance(entry, dict):
                    yield from self._entry(kind, number, entry)

    def _entry(self, kind: str, number: int, entry: Mapping[str, Any]) -> Iterator[Content]:
        is_read = number in self._read.get(kind, ())
        path, fate = f"/{kind}/{number}", _fate(is_read)
        yield Content(path, kind, "implied" if kind in _CONTAINERS else fate)
        if kind == "materials":
            yield from self._properties(path, entry, is_read=is_read)
        yield from self._additions(path, kind, entry, is_read=is_read or kind in _CONTAINERS)
        for one, primitive in enumerate(entry.get("primitives", ()) if kind == "meshes" else ()):
            inner = f"{path}/primitives/{one}"
            yield Content(inner, "primitives", fate)
            yield from self._attributes(inner, number, primitive)
            yield from self._additions(inner, kind, primitive, is_read=is_read)
        for one, channel in enumerate(entry.get("channels", ()) if kind == "animations" else ()):
            inner = f"{path}/channels/{one}"
            moved = (
                {node for node, _ in find_channel_targets(self._file, channel["target"]) or ()} if is_read else set()
            )
            yield Content(inner, "channels", _fate(not moved.isdisjoint(self._moving)))
            yield from self._additions(inner, kind, channel, is_read=is_read)
            yield from self._additions(f"{inner}/target", kind, channel.get("target", {}), is_read=is_read)
        for one, sampler in enumerate(entry.get("samplers", ()) if kind == "animations" else ()):
            yield Content(f"{path}/samplers/{one}", "samplers", "implied")
            yield from self._additions(f"{path}/samplers/{one}", kind, sampler, is_read=is_read)

    def _attributes(self, path: str, mesh: int, primitive: Mapping[str, Any]) -> Iterator[Content]:
        """List the attributes of a primitive and of its morph targets."""
        is_surface = primitive.get("mode", TRIANGLES) in _SURFACE
        for name in primitive.get("attributes", ()):
            yield Content(f"{path}/attributes/{name}", name, self._attribute(name, mesh, is_surface=is_surface))
        for number, target in enumerate(primitive.get("targets", ())):
            for name in target:
                fate = self._attribute(name, mesh, is_surface=is_surface)
                if name == "NORMAL" and fate == "coded":
                    # Normals follow from the shape.
                    fate = "implied"
                yield Content(f"{path}/targets/{number}/{name}", f"morphed {name}", fate)

    def _attribute(self, name: str, mesh: int, *, is_surface: bool) -> Fate:
        if mesh not in self._words:
            return "dropped"
        if name.startswith(("JOINTS_", "WEIGHTS_")):
            # Joints and weights have no effect without a skin.
            return "coded" if mesh in self._skinned else "implied"
        if name == "NORMAL" or name.startswith("TEXCOORD_"):
            return _fate(is_surface and name not in self._words[mesh])
        return _fate(name == "POSITION" or (name.startswith("COLOR_") and name not in self._words[mesh]))

    def _additions(self, path: str, kind: str, entry: Mapping[str, Any], *, is_read: bool = True) -> Iterator[Content]:
        """List the extensions and the extras of an object, and those of the objects in its extensions."""
        extensions = entry.get("extensions")
        for name, value in extensions.items() if isinstance(extensions, dict) else ():
            yield Content(f"{path}/extensions/{name}", name, _fate(is_read and name in READABLE_EXTENSIONS))
            for key, inner in value.items() if isinstance(value, dict) else ():
                if isinstance(inner, dict):
                    yield from self._additions(f"{path}/extensions/{name}/{key}", name, inner, is_read=is_read)
        extras = entry.get("extras")
        for name in extras if isinstance(extras, dict) else ():
            fate = _fate(is_read and name in OWN_EXTRAS.get(kind, ()))
            yield Content(f"{path}/extras/{name}", f"extras.{name}", fate)
        if extras is not None and not isinstance(extras, dict):
            yield Content(f"{path}/extras", "extras", "dropped")

    def _properties(self, path: str, material: Mapping[str, Any], *, is_read: bool) -> Iterator[Content]:
        """List the properties of a material, and the extensions and extras of its references to textures."""
        for key, value in material.items():
            if key == "pbrMetallicRoughness":
                yield from self._properties(f"{path}/{key}", value, is_read=is_read)
            elif key == "name":
                yield Content(f"{path}/name", "name", _fate(is_read))
            elif key not in ("extensions", "extras"):
                is_usual = is_read and is_as_written(key, value)
                yield Content(f"{path}/{key}", key, "implied" if is_usual else "dropped")
                if isinstance(value, dict):
                    yield from self._additions(f"{path}/{key}", "textures", value)


def _fate(is_kept: bool) -> Fate:
    return "coded" if is_kept else "dropped"
