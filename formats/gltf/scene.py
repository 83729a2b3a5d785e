"""Cut the motion out of a glTF file, and fill it again: JSON, buffers and images.

Bytes that only moved meshes use become zeros: positions, normals, tangents, joints, weights, morph targets. Indices
and UVs become their differences from the decoder's values, so they are zero or nearly so.
"""

from __future__ import annotations

import base64
import binascii
import copy
import json
import zlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import damaged
from pdecodec.formats.base.attribute_roles import COLOR, UV, expanded, is_role, reversed_corners, role_name
from pdecodec.formats.base.carried_fields import StoredFields
from pdecodec.formats.base.carrying import Stripped
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.gltf.compression import MESHOPT_NAMES
from pdecodec.formats.gltf.file import COMPONENTS, TRIANGLES, WIDTHS, GltfFile, flipped, json_bytes
from pdecodec.formats.gltf.reader import GltfSequence
from pdecodec.formats.gltf.references import numbers_of_unknown
from pdecodec.formats.gltf.stored_motion import drop_motions
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import MeshObject, MeshSequence

ROOT = "scene.gltf"
"""Name of the JSON in a carrier; buffers and images are numbered."""

_MOVED = ("POSITION", "NORMAL", "TANGENT", "JOINTS_", "WEIGHTS_")
"""Beginnings of names of attributes that the motion replaces."""

_LIGHTS = "KHR_lights_punctual"

ByteArray = NDArray[np.uint8]


class GltfFamily:
    """Cutting and filling of glTF files."""

    def strip(
        self, original: GltfSequence, source: Path, fits: Sequence[Fitted], *, exact_uvs: bool, fields: StoredFields
    ) -> Stripped:
        """Return the file's parts without coded arrays."""
        file = original.file
        root = copy.deepcopy(dict(file.root))
        # Buffers without data are placeholders of compressed views.
        buffers = {k: np.frombuffer(data, np.uint8).copy() for k, data in enumerate(file.buffers) if data}
        objects = [one.item for one in fits]
        cuts = [cut for k, one in enumerate(fits) for cut in _cuts(original, one, k, exact_uvs=exact_uvs)]
        # Primitives may share accessors: the first cut is enough.
        cuts = [*{cut["accessor"]: cut for cut in reversed(cuts)}.values()][::-1]
        _difference(buffers, root, cuts, objects)
        nodes = {original.shapes[one.index].node for one in fits}
        views = drop_motions(root, _moved_meshes(file, nodes))
        kept = {cut["accessor"] for cut in cuts}
        for index, zeros in _replaced_bytes(file, root, views, buffers, nodes, kept).items():
            buffers[index][zeros] = 0
        files: dict[str, bytes] = {}
        for index, data in buffers.items():
            files[f"{index}.bin"] = data.tobytes()
            root["buffers"][index]["uri"] = f"{index}.bin"
        outside, images = [], []
        for index, image in enumerate(root.get("images", [])):
            head, comma, text = image.get("uri", "").partition(",")
            if head.startswith("data:"):
                if comma and (picture := _decoded(text)) is not None:
                    files[f"image{index}"] = picture
                    images.append([index, head])
                    del image["uri"]
            elif head:
                outside.append(image["uri"])
        checks = {str(index): zlib.crc32(data.data) for index, data in _filled(buffers, root, cuts, objects)}
        files = {ROOT: json_bytes(root), **files}
        chosen = root["animations"][original.clip_number].get("name") if root.get("animations") else None
        clip = {"clip": chosen} if chosen and original.clip_number else {}
        notes = {"arrays": cuts, "images": images, "checks": checks, **clip}
        return Stripped(files, ROOT, notes, _contents(file), outside=tuple(dict.fromkeys(outside)))

    def fill(self, folder: Path, cuts: Mapping[str, Any], sequence: MeshSequence, suffix: str) -> None:
        """Fill the buffers and the JSON in a folder."""
        path = folder / ROOT
        root = json.loads(path.read_bytes())
        for index, head in cuts["images"]:
            picture = (folder / f"image{int(index)}").read_bytes()
            root["images"][index]["uri"] = f"{head},{base64.b64encode(picture).decode()}"
        buffers = {int(k): np.fromfile(folder / f"{int(k)}.bin", np.uint8) for k in cuts["checks"]}
        for index, data in _filled(buffers, root, cuts["arrays"], sequence.objects):
            if zlib.crc32(data.data) != cuts["checks"][str(index)]:
                raise damaged("the scene does not fit the meshes of the file")
            data.tofile(folder / f"{index}.bin")
        path.write_text(json.dumps(root), encoding="utf-8")


def _decoded(text: str) -> bytes | None:
    """Return the bytes of base64 text; None if encoding them again gives another text."""
    try:
        data = base64.b64decode(text, validate=True)
    except (ValueError, binascii.Error):
        return None
    return data if base64.b64encode(data).decode() == text else None


def _contents(file: GltfFile) -> dict[str, int]:
    lights = file.root.get("extensions", {}).get(_LIGHTS, {}).get("lights", [])
    kinds = {"cameras": "camera", "materials": "material", "images": "texture", "skins": "skeleton"}
    other = max(0, len(file.listed("animations")) - 1)
    return {
        **{noun: len(file.listed(kind)) for kind, noun in kinds.items()},
        "light": len(lights),
        "other animation": other,
    }


def _cuts(original: GltfSequence, one: Fitted, number: int, *, exact_uvs: bool) -> Iterator[dict[str, Any]]:
    """Yield the arrays of a moved mesh, object `number`, that the decoder restores: an accessor, and the
    array's place in the decoded object.
    """
    part = original.shapes[one.index]
    mesh, file = part.mesh, original.file
    corners = mesh.connectivity.face_indices
    if mesh.gather is not None or mesh.corner_rows is not corners or (mesh.connectivity.face_counts != 3).any():
        # The reader restored rows and faces from ``extras``, so they differ from the accessors' values.
        return
    turned = not one.item.connectivity.same_as(mesh.connectivity)
    place = {"object": number, **({"turned": True} if turned else {})}
    corner = 0
    entry = file.listed("meshes")[file.listed("nodes")[part.node]["mesh"]]
    colors = [attribute for attribute in one.item.attributes if is_role(attribute, COLOR)]
    widths = {attribute.name: attribute.values.shape[1] for attribute in colors if attribute.domain == "vertex"}
    uvs = {attribute.name for attribute in one.item.attributes if attribute.domain == "corner"}
    for primitive, start in zip(entry["primitives"], mesh.starts, strict=True):
        if primitive.get("mode", TRIANGLES) != TRIANGLES:
            return
        accessors = file.listed("accessors")
        indices, positions = primitive.get("indices"), accessors[primitive["attributes"]["POSITION"]]
        count = (positions if indices is None else accessors[indices])["count"]
        if corner + count > corners.size:
            return
        if indices is not None and _is_plain(file, indices):
            yield {"accessor": indices, **place, "first": corner, "start": start}
        corner += count
        for name, index in primitive["attributes"].items():
            known = role_name(UV, name, ("TEXCOORD_0",))
            if exact_uvs and name.startswith("TEXCOORD_") and known in uvs and _is_plain(file, index, "<f4"):
                yield {"accessor": index, **place, "uv": known, "start": start}
            shade = role_name(COLOR, name, ("COLOR_0",))
            is_color = name.startswith("COLOR_") and widths.get(shade) == WIDTHS[accessors[index]["type"]]
            if is_color and _is_plain(file, index, "<f4"):
                yield {"accessor": index, **place, "color": shade, "start": start}


def _is_plain(file: GltfFile, index: int, dtype: str | None = None) -> bool:
    """Return whether an accessor's bytes are stored in a buffer uncompressed."""
    entry = file.listed("accessors")[index]
    if "bufferView" not in entry or (dtype is not None and COMPONENTS[entry["componentType"]] != dtype):
        return False
    return not set(MESHOPT_NAMES) & set(file.listed("bufferViews")[entry["bufferView"]].get("extensions", {}))


def _places(
    root: Mapping[str, Any], index: int, buffers: Mapping[int, NDArray[Any]]
) -> tuple[int, Int64Array, np.dtype[Any]]:
    """Return the buffer of an accessor, the offset of each of its bytes there (rows, bytes), and its type."""
    entry = root["accessors"][index]
    view = root["bufferViews"][entry["bufferView"]]
    dtype = np.dtype(COMPONENTS[entry["componentType"]])
    size = WIDTHS[entry["type"]] * dtype.itemsize
    first = int(view.get("byteOffset", 0)) + int(entry.get("byteOffset", 0))
    count, stride = int(entry["count"]), int(view.get("byteStride", 0)) or size
    if min(first, count, stride - size) < 0 or first + (count - 1) * stride + size > len(buffers[view["buffer"]]):
        raise ValueError(f"accessor {index} ends after its buffer")
    rows = np.arange(count, dtype=np.int64) * stride
    return view["buffer"], first + rows[:, None] + np.arange(size), dtype


def _known(cut: Mapping[str, Any], objects: Sequence[MeshObject], rows: int, dtype: np.dtype[Any]) -> NDArray[Any]:
    """Return the values of an accessor as the decoder restores them."""
    item = objects[cut["object"]]
    faces = item.connectivity
    order = reversed_corners(faces.face_counts) if cut.get("turned") else slice(None)
    corners = faces.face_indices[order].astype(np.int64) - int(cut["start"])
    if "color" in cut:
        shades = expanded(next(one for one in item.attributes if one.name == cut["color"]))
        return shades[int(cut["start"]) :][:rows].astype(dtype)
    if "uv" not in cut:
        indices: NDArray[Any] = corners[cut["first"] : cut["first"] + rows].astype(dtype)
        return indices
    coded = next(one for one in item.attributes if one.name == cut["uv"])
    values = flipped(coded.values) if coded.indices is None else flipped(coded.values)[coded.indices]
    found = np.zeros((rows, 2), dtype)
    own = (corners >= 0) & (corners < rows)
    found[corners[own]] = values[order][own]
    return found


def _difference(
    buffers: Mapping[int, ByteArray],
    root: Mapping[str, Any],
    cuts: Sequence[Mapping[str, Any]],
    objects: Sequence[MeshObject],
) -> None:
    """Replace bytes of accessors by their differences (exclusive or) from the decoder's values, or restore them."""
    for cut in cuts:
        buffer, places, dtype = _places(root, cut["accessor"], buffers)
        known = np.ascontiguousarray(_known(cut, objects, len(places), dtype))
        buffers[buffer][places] ^= known.view(np.uint8).reshape(places.shape)


def _filled(
    buffers: Mapping[int, ByteArray],
    root: Mapping[str, Any],
    cuts: Sequence[Mapping[str, Any]],
    objects: Sequence[MeshObject],
) -> list[tuple[int, ByteArray]]:
    """Return the buffers with their arrays filled."""
    whole = {index: data.copy() for index, data in buffers.items()}
    _difference(whole, root, cuts, objects)
    return [*whole.items()]


def _moved_meshes(file: GltfFile, nodes: set[int]) -> set[int]:
    """Return the meshes that only moved nodes use."""
    users = [(entry["mesh"], index) for index, entry in enumerate(file.listed("nodes")) if "mesh" in entry]
    return {mesh for mesh, _ in users} - {mesh for mesh, index in users if index not in nodes}


def _replaced_bytes(
    file: GltfFile,
    root: Mapping[str, Any],
    views: Sequence[int],
    buffers: Mapping[int, ByteArray],
    nodes: set[int],
    kept: set[int],
) -> dict[int, NDArray[np.bool_]]:
    """Return which bytes of each buffer only the motion of moved nodes uses; `views` hold dropped motions."""
    moved = _moved_meshes(file, nodes)
    slots, others = set[int](), set(kept)
    for number, mesh in enumerate(file.listed("meshes")):
        for primitive in mesh["primitives"]:
            targets = (pair for one in primitive.get("targets", []) for pair in one.items())
            for name, index in (*primitive["attributes"].items(), *targets):
                (slots if number in moved and name.startswith(_MOVED) else others).add(index)
            others.add(primitive.get("indices", -1))
    others |= (set(range(len(file.listed("accessors")))) - slots) | slots.intersection(numbers_of_unknown(file.root))
    zeros = {index: np.zeros(len(data), bool) for index, data in buffers.items()}
    for one in (file.root["bufferViews"][view] for view in views):
        first = int(one.get("byteOffset", 0))
        zeros[one["buffer"]][first : first + int(one["byteLength"])] = True
    # What is kept wins over what is replaced, byte by byte.
    for accessors, is_replaced in ((slots - others, True), (others - {-1}, False)):
        for index in accessors:
            if _is_plain(file, index):
                buffer, places, _ = _places(root, index, buffers)
                zeros[buffer][places] = is_replaced
    for view in _views_of_others(root):
        entry = root["bufferViews"][view]
        packed = [entry["extensions"][name] for name in MESHOPT_NAMES if name in entry.get("extensions", {})]
        for one in packed or [entry]:
            first = int(one.get("byteOffset", 0))
            zeros[one["buffer"]][first : first + int(one["byteLength"])] = False
    return zeros


def _views_of_others(root: Mapping[str, Any]) -> set[int]:
    """Return the buffer views that are compressed, or that other entries than accessors use."""
    found = {
        number
        for number, view in enumerate(root.get("bufferViews", []))
        if set(MESHOPT_NAMES) & set(view.get("extensions", {}))
    }
    left: list[Any] = [{key: value for key, value in root.items() if key != "accessors"}]
    left += [{**one, "bufferView": None} for one in root.get("accessors", [])]
    while left:
        item = left.pop()
        if isinstance(item, dict):
            view = item.get("bufferView")
            found |= {view} if isinstance(view, int) and 0 <= view < len(root.get("bufferViews", [])) else set()
            left += item.values()
        elif isinstance(item, list):
            left += item
    return found
