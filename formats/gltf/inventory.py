"""List what a glTF file contains that is not kept, in the format's own terms.

Meshes of the default scene are kept with everything that moves them; of materials only the names are kept.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from typing import Any

from pdecodec.formats.base.scene_reading import listed, lost_textures
from pdecodec.formats.gltf.animation import Clip, Nodes
from pdecodec.formats.gltf.file import READABLE_EXTENSIONS, GltfFile

GROUPS = "groups"
"""Key in ``extras``: of a primitive, the face sets that its faces belong to; of a mesh, the faces of each set."""

WRITTEN_MATERIAL: Mapping[str, Any] = {"doubleSided": True, "pbrMetallicRoughness": {"metallicFactor": 0.0}}
"""Properties, besides the name, of the material that is written if only the name is known."""

_DEFAULTS: Mapping[str, Any] = {
    "alphaCutoff": 0.5,
    "alphaMode": "OPAQUE",
    "baseColorFactor": [1.0] * 4,
    "doubleSided": False,
    "emissiveFactor": [0.0] * 3,
    "metallicFactor": 1.0,
    "roughnessFactor": 1.0,
}
"""Values that glTF gives to properties that a material does not set."""

_INNER_LISTS = {"meshes": ("primitives",), "animations": ("channels", "samplers")}
"""Lists of objects inside the entries of lists of the root."""

OWN_EXTRAS = {"asset": {"pdecodec"}, "meshes": {"pdecodec", GROUPS}, "animations": {"pdecodec"}}
"""Keys of ``extras`` that our writer adds, by the list they are in."""


def textures_of(file: GltfFile) -> tuple[str, ...]:
    """Return the notice that names textures or images that are not kept, if there are any."""
    images = [_name(one, "image", number) for number, one in enumerate(file.listed("images"))]
    return lost_textures(len(file.listed("textures")), images)


def left_out_of_materials(file: GltfFile) -> tuple[str, ...]:
    """Return the names of material properties that are not kept; textures are named separately."""
    return tuple(_material_properties(file.listed("materials")))


def left_out_of_file(file: GltfFile, nodes: Nodes, clip: Clip | None, moving: Collection[int]) -> Iterator[str]:
    """Yield the names of all other data that are not kept; meshes and the clip report their own losses.

    Parameters
    ----------
    file, nodes, clip
    moving : collection of int
        Nodes that hold meshes that are read, joints of their skins, and the ancestors of both.
    """
    for kind in ("cameras", "scenes"):
        shown = file.root.get("scene", 0) if kind == "scenes" else None
        others = [_name(one, kind[:-1], k) for k, one in enumerate(file.listed(kind)) if k != shown]
        if others:
            yield f"{'other ' * (kind == 'scenes')}{kind} {listed(others)}"
    users: dict[int, list[int]] = {}
    for number, node in enumerate(nodes.entries):
        if "mesh" in node:
            users.setdefault(node["mesh"], []).append(number)
    meshes = enumerate(file.listed("meshes"))
    unused = [_name(one, "mesh", k) for k, one in meshes if not any(map(nodes.is_shown, users.get(k, ())))]
    if unused:
        yield f"meshes {listed(unused)}, which the scene does not show"
    used = {one.get("material") for mesh in file.listed("meshes") for one in mesh.get("primitives", ())}
    unused = [_name(one, "material", k) for k, one in enumerate(file.listed("materials")) if k not in used]
    if unused:
        yield f"materials {listed(unused)}, which no mesh uses"
    bare = {k for k, one in enumerate(nodes.entries) if k not in moving and not {"mesh", "camera"} & one.keys()}
    animated = {node for node, _ in clip.samplers if node < len(nodes.entries)} - set(moving) if clip else set()
    for word, numbers in (("nodes without meshes", bare), ("animation of nodes without meshes", animated)):
        if numbers:
            yield f"{word} {listed([_name(nodes.entries[k], 'node', k) for k in sorted(numbers)])}"
    yield from _unread_extensions_and_extras(file.root)
    if file.root.get("asset", {}).get("copyright"):
        yield "asset.copyright"


def _name(entry: Mapping[str, Any], kind: str, number: int) -> str:
    uri = entry.get("uri")
    file_name = uri.rpartition("/")[2] if isinstance(uri, str) and not uri.startswith("data:") else None
    return str(entry.get("name") or file_name or f"{kind}_{number}")


def _material_properties(materials: Sequence[Mapping[str, Any]]) -> Iterator[str]:
    """Yield the names of material properties that differ from `WRITTEN_MATERIAL`; textures are named separately."""
    differing: dict[str, None] = {}
    for entry in materials:
        own = {**_DEFAULTS, **_flatten_material(entry)}
        changed = [key for key in own if not is_as_written(key, own[key])]
        differing |= dict.fromkeys(key for key in changed if not key.endswith("Texture"))
    if differing:
        yield f"properties of materials ({', '.join(differing)})"


def is_as_written(key: str, value: Any) -> bool:
    """Return whether a property of a material has the value that our writer gives it."""
    return bool({**_DEFAULTS, **_flatten_material(WRITTEN_MATERIAL)}.get(key) == value)


def _flatten_material(material: Mapping[str, Any]) -> dict[str, Any]:
    """Return the properties of a material in one mapping, without name and extras."""
    flat = {key: value for key, value in material.items() if key not in ("name", "extras")}
    return {**flat.pop("pbrMetallicRoughness", {}), **flat.pop("extensions", {}), **flat}


def _holders(root: Mapping[str, Any]) -> Iterator[tuple[str, Mapping[str, Any]]]:
    """Yield every object of the file that may have extensions and extras, with the list of the root that it is in."""
    yield "the file", root
    yield "asset", root.get("asset", {})
    for kind, entries in root.items():
        for entry in entries if isinstance(entries, list) else ():
            if isinstance(entry, dict):
                inner = [one for key in _INNER_LISTS.get(kind, ()) for one in entry.get(key, ())]
                targets = [one["target"] for one in inner if isinstance(one.get("target"), dict)]
                yield from ((kind, one) for one in (entry, *inner, *targets))


def _unread_extensions_and_extras(root: Mapping[str, Any]) -> Iterator[str]:
    """Yield extensions that are not read, and extras, anywhere in the file."""
    extensions: dict[str, None] = {}
    extras: dict[str, dict[str, None]] = {}
    for kind, holder in _holders(root):
        if kind != "materials" and isinstance(holder.get("extensions"), dict):
            extensions |= dict.fromkeys(holder["extensions"])
        found = holder.get("extras")
        keys = [str(key) for key in found if key not in OWN_EXTRAS.get(kind, ())] if isinstance(found, dict) else []
        if keys or (found is not None and not isinstance(found, dict)):
            extras.setdefault(kind, {}).update(dict.fromkeys(keys))
    yield from (name for name in extensions if name not in READABLE_EXTENSIONS)
    for kind, names in extras.items():
        yield f"extras of {kind}" + (f" ({', '.join(names)})" if names else "")
