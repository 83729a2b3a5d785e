"""Find what a glTF file refers to, drop accessors and buffer views that nothing refers to, and copy the others."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.gltf.compression import DRACO, MESHOPT_NAMES
from pdecodec.formats.gltf.file import POSITION_NEUTRAL_PREFIXES, READABLE_EXTENSIONS, GltfFile
from pdecodec.formats.gltf.types import INSTANCING, MESH_MOTION

Site = tuple[dict[str, Any], str]
"""An object of the JSON and the key under which it has an index."""

ALIGNMENT = 4
"""Rows of vertex attributes, and parts of a file, begin at multiples of this [bytes]."""


def drop_unused(root: dict[str, Any], file: GltfFile, place: Callable[..., dict[str, int]]) -> None:
    """Drop accessors and buffer views that nothing refers to, and number the others anew.

    Extensions that are not known may refer to any: entries up to the largest number that they hold keep their place.

    Parameters
    ----------
    root : dict
        The JSON, which began as that of `file`.
    file : GltfFile
    place : callable
        Adds rows with a target of buffer views, and returns the members of an accessor that say where the rows are.
    """
    for animation in root.get("animations", ()):
        _keep(animation, "samplers", [(one, "sampler") for one in animation.get("channels", ())], 0)
    accessors = root.get("accessors", [])
    most = max(len(accessors), len(root.get("bufferViews", ())))
    fixed = 1 + max((one for one in numbers_of_unknown(root) if one < most), default=-1)
    sites = list(_accessor_sites(root))
    used = {owner[key] for owner, key in sites} | set(range(fixed))
    shared = _partly_used(file, accessors, used, fixed)
    attributes = {one[key] for one in _attribute_owners(root) for key in one}
    for index in sorted(used.intersection(shared)):
        # What is damaged, and needed for no position, stays as it is.
        with suppress(KeyError, IndexError, TypeError, ValueError):
            found = place(*_rows(file, index, is_attribute=index in attributes))
            accessors[index].pop("byteOffset", None)
            accessors[index] |= found
    for index in range(min(fixed, len(accessors))):
        if index not in {owner[key] for owner, key in sites}:
            # The values of what was replaced may be gone.
            accessors[index].pop("min", None)
            accessors[index].pop("max", None)
    _keep(root, "accessors", sites, fixed)
    _keep(root, "bufferViews", list(_view_sites(root)), fixed)
    for kind in ("accessors", "bufferViews"):
        if not root.get(kind, True):
            del root[kind]


def copy_views(file: GltfFile, views: Sequence[dict[str, Any]], append: Callable[[bytes], int]) -> list[dict[str, Any]]:
    """Copy the bytes of buffer views of a file to buffer 0, and change their entries.

    `append` adds bytes and returns their offset. Returns the entries of buffers that have no data, for compressed views
    to name from 1 on.
    """
    parts: dict[int, list[dict[str, Any]]] = {}
    for view in views:
        packed = [view["extensions"][name] for name in MESHOPT_NAMES if name in view.get("extensions", {})]
        for entry in (view, *packed):
            # What is damaged, and was not needed to read the motion, stays as it is.
            if "byteLength" in entry and entry.get("buffer", len(file.buffers)) < len(file.buffers):
                parts.setdefault(entry["buffer"], []).append(entry)
    without_data: list[dict[str, Any]] = []
    for index, entries in sorted(parts.items()):
        data = file.buffers[index]
        if not data:
            without_data.append(file.root["buffers"][index])
            for entry in entries:
                entry["buffer"] = len(without_data)
            continue
        ranges: list[tuple[int, int, list[dict[str, Any]]]] = []
        for entry in sorted(entries, key=lambda one: int(one.get("byteOffset", 0))):
            first = int(entry.get("byteOffset", 0))
            end = first + int(entry["byteLength"])
            if ranges and first < ranges[-1][1]:
                start, last, members = ranges.pop()
                ranges.append((start, max(last, end), [*members, entry]))
            else:
                ranges.append((first - first % ALIGNMENT, end, [entry]))
        for start, end, members in ranges:
            shift = append(data[start:end]) - start
            for entry in members:
                entry |= {"buffer": 0, "byteOffset": int(entry.get("byteOffset", 0)) + shift}
    return without_data


def _keep(owner: dict[str, Any], kind: str, sites: list[Site], fixed: int) -> None:
    """Keep those entries of a list that are before `fixed`, or referred to, and number them anew.

    Numbers of missing entries, which nothing needed so far, stay.
    """
    entries = owner.get(kind, [])
    sites = [(one, key) for one, key in sites if one.get(key, len(entries)) < len(entries)]
    kept = sorted({one[key] for one, key in sites} | set(range(min(fixed, len(entries)))))
    number = {index: place for place, index in enumerate(kept)}
    # Primitives may share objects.
    for one, key in {(id(one), key): (one, key) for one, key in sites}.values():
        one[key] = number[one[key]]
    entries[:] = [entries[index] for index in kept]


def _partly_used(file: GltfFile, accessors: list[dict[str, Any]], used: set[int], fixed: int) -> list[int]:
    """Return the original's accessors in buffer views that others, which are no longer used, are in."""
    inside: dict[int, list[int]] = {}
    whole = {one[key] for one, key in _view_sites(dict(file.root)) if "componentType" not in one or "type" not in one}
    for index, entry in enumerate(file.listed("accessors")):
        if "bufferView" in entry:
            inside.setdefault(entry["bufferView"], []).append(index)
    return [
        index
        for view, members in inside.items()
        if view >= fixed and view not in whole and not used.issuperset(members)
        for index in members
        if index in used
        and accessors[index].get("bufferView") == view
        and not accessors[index].get("type", "M").startswith("M")
    ]


def _rows(file: GltfFile, index: int, *, is_attribute: bool) -> tuple[NDArray[Any], int | None]:
    """Return the stored rows of an accessor, and the target of their buffer view."""
    rows, target = file.stored_rows(index)
    if not is_attribute:
        return rows.reshape(-1), target
    size = rows.shape[1] * rows.itemsize
    padded = np.zeros((len(rows), size + -size % ALIGNMENT), np.uint8)
    padded[:, :size] = rows.view(np.uint8).reshape(len(rows), size)
    return padded, target


def _primitives(root: dict[str, Any]) -> Iterator[dict[str, Any]]:
    for mesh in root.get("meshes", ()):
        yield from mesh.get("primitives", ())


def _attribute_owners(root: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield the objects whose members are accessors of attributes."""
    for one in _primitives(root):
        yield from (one.get("attributes", {}), *one.get("targets", ()))
    for node in root.get("nodes", ()):
        if INSTANCING in node.get("extensions", {}):
            yield node["extensions"][INSTANCING].get("attributes", {})


def _accessor_sites(root: dict[str, Any]) -> Iterator[Site]:
    owners: list[tuple[dict[str, Any], tuple[str, ...]]] = [(one, tuple(one)) for one in _attribute_owners(root)]
    for one in _primitives(root):
        owners += [(one, ("indices",)), (one.get("extensions", {}).get(MESH_MOTION, {}), ("vertexMap",))]
    samplers = (one for animation in root.get("animations", ()) for one in animation.get("samplers", ()))
    owners += [(one, ("input", "output")) for one in samplers]
    owners += [(skin, ("inverseBindMatrices",)) for skin in root.get("skins", ())]
    yield from ((owner, key) for owner, keys in owners for key in keys if key in owner)


def _view_sites(root: dict[str, Any]) -> Iterator[Site]:
    owners = [*root.get("accessors", ()), *root.get("images", ())]
    owners += [
        one.get("sparse", {}).get(part, {}) for one in root.get("accessors", ()) for part in ("indices", "values")
    ]
    owners += [one.get("extensions", {}).get(DRACO, {}) for one in _primitives(root)]
    owners += root.get("extensions", {}).get(MESH_MOTION, {}).get("motions", ())
    yield from ((owner, "bufferView") for owner in owners if "bufferView" in owner)


def numbers_of_unknown(value: Any, *, inside: bool = False) -> Iterator[int]:
    """Yield the whole numbers in unknown extensions: any may be the index of an accessor or a buffer view."""
    if isinstance(value, dict):
        for key, one in value.items():
            if key == "extensions" and isinstance(one, dict):
                for name, extension in one.items():
                    # Profiles of lights (EXT_lights_ies) may be in buffer views.
                    is_neutral = name.startswith(POSITION_NEUTRAL_PREFIXES) and "bufferView" not in repr(extension)
                    is_known = name in READABLE_EXTENSIONS or is_neutral
                    yield from numbers_of_unknown(extension, inside=inside or not is_known)
            elif key != "extras":
                yield from numbers_of_unknown(one, inside=inside)
    elif isinstance(value, list):
        for one in value:
            yield from numbers_of_unknown(one, inside=inside)
    elif inside and isinstance(value, int):
        yield int(value)
