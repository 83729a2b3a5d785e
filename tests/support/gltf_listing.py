"""List, with pygltflib, the content of a glTF file other than the motion of its meshes."""

from __future__ import annotations

import base64
import json
from pathlib import Path
from typing import Any
from urllib.parse import unquote

import numpy as np
import pygltflib

_OF_MOTION = ("POSITION", "NORMAL", "TANGENT", "JOINTS_", "WEIGHTS_")

_DTYPES = {5120: "<i1", 5121: "<u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
_WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

_WRITTEN_ANEW = {"accessors", "bufferViews", "buffers", "meshes", "nodes", "scenes", "animations", "images", "skins"}


class GltfListing:
    """An open file; `nodes` is the number of nodes of its source, and `moved` are the nodes whose meshes are
    replaced.
    """

    def __init__(self, path: Path) -> None:
        loaded = pygltflib.GLTF2().load(str(path))
        assert loaded is not None
        self.root: dict[str, Any] = json.loads(loaded.to_json())
        self._folder = path.parent
        self._buffers = [self._data(loaded, k) for k in range(len(loaded.buffers))]

    def _data(self, loaded: Any, number: int) -> bytes:
        uri = loaded.buffers[number].uri
        if uri is None:
            return bytes(loaded.binary_blob() or b"")
        head, _, text = uri.partition(",")
        return base64.b64decode(text) if head.startswith("data:") else (self._folder / unquote(uri)).read_bytes()

    def view(self, index: int) -> bytes:
        """Return the bytes of a buffer view."""
        entry = self.root["bufferViews"][index]
        first = entry.get("byteOffset") or 0
        return self._buffers[entry["buffer"]][first : first + entry["byteLength"]]

    def values(self, index: int) -> Any:
        """Return an accessor: its rows, or its entry if they are compressed or sparse."""
        entry = self.root["accessors"][index]
        if entry.get("bufferView") is None or entry.get("sparse"):
            return {key: entry[key] for key in ("count", "type", "componentType")}
        view = self.root["bufferViews"][entry["bufferView"]]
        if packed := (view.get("extensions") or {}).get("EXT_meshopt_compression"):
            first = packed.get("byteOffset") or 0
            return self._buffers[packed["buffer"]][first : first + packed["byteLength"]]
        size = np.dtype(_DTYPES[entry["componentType"]]).itemsize * _WIDTHS[entry["type"]]
        stride, data = view.get("byteStride") or size, self.view(entry["bufferView"])
        first = entry.get("byteOffset") or 0
        return [data[first + k * stride : first + k * stride + size] for k in range(entry["count"])]

    def rest(self, nodes: int, moved: set[int], chosen: int) -> dict[str, Any]:
        """Return everything except the motion of the moved nodes, including their morph weights in animation
        `chosen`.
        """
        found = {key: value for key, value in self.root.items() if key not in _WRITTEN_ANEW and value}
        for kind in ("extensionsUsed", "extensionsRequired"):
            of_geometry = {"KHR_draco_mesh_compression", "EXT_mesh_gpu_instancing"}
            found[kind] = sorted(set(found.get(kind, [])) - of_geometry)
        own = self.root.get("nodes") or []
        found["nodes"] = [self._node(own[k], is_moved=k in moved) for k in range(nodes)]
        meshes = {own[k]["mesh"] for k in range(nodes) if own[k].get("mesh") is not None and k not in moved}
        found["meshes"] = [self._mesh(self.root["meshes"][k]) for k in sorted(meshes)]
        found["images"] = [self._image(one) for one in self.root.get("images") or []]
        found["skins"] = [
            {**one, "inverseBindMatrices": self.values(one["inverseBindMatrices"])}
            if one.get("inverseBindMatrices") is not None
            else one
            for one in self.root.get("skins") or []
            if max(one["joints"]) < nodes
        ]
        others = [one for k, one in enumerate(self.root.get("animations") or []) if k != chosen]
        # The weights that animate a moved node belong to morph targets that were replaced, so their channels are gone.
        found["animations"] = [one for other in others if (one := self._animation(other, moved))["channels"]]
        return found

    @staticmethod
    def _node(entry: dict[str, Any], *, is_moved: bool) -> dict[str, Any]:
        without = {"mesh", "skin", "weights"} if is_moved else {"mesh"}
        found = {key: value for key, value in entry.items() if key not in without and value is not None}
        extensions = {k: v for k, v in (entry.get("extensions") or {}).items() if k != "EXT_mesh_gpu_instancing"}
        return {**{k: v for k, v in found.items() if k != "extensions"}, **({"ext": extensions} if extensions else {})}

    def _mesh(self, entry: dict[str, Any]) -> dict[str, Any]:
        return {**entry, "primitives": [self.primitive(one) for one in entry["primitives"]]}

    def primitive(self, entry: dict[str, Any]) -> dict[str, Any]:
        """Return a primitive's indices, attributes and settings, except its motion."""
        names = {k: v for k, v in (entry.get("attributes") or {}).items() if v is not None}
        own = {k: self.values(v) for k, v in names.items() if not k.startswith(_OF_MOTION)}
        indices = None if entry.get("indices") is None else self.values(entry["indices"])
        rest = {k: v for k, v in entry.items() if k not in ("attributes", "targets", "indices", "extensions") and v}
        return {**rest, "attributes": own, "indices": indices}

    def moved_primitives(self, number: int) -> list[dict[str, Any]]:
        """Return the primitives of a mesh."""
        return [self.primitive(one) for one in self.root["meshes"][number]["primitives"]]

    def _image(self, entry: dict[str, Any]) -> dict[str, Any]:
        if entry.get("bufferView") is not None:
            return {**entry, "bufferView": self.view(entry["bufferView"])}
        return entry

    def _animation(self, entry: dict[str, Any], moved: set[int]) -> dict[str, Any]:
        channels = [
            {**one, "sampler": None, "in": self.values(sampler["input"]), "out": self.values(sampler["output"])}
            for one in entry["channels"]
            if (one["target"].get("node") not in moved or one["target"].get("path") != "weights")
            for sampler in [entry["samplers"][one["sampler"]]]
        ]
        return {"name": entry.get("name"), "extras": entry.get("extras"), "channels": channels}
