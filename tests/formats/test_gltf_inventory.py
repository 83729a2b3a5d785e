"""Inventories of glTF files: everything that their JSON lists must be kept, or named as not kept."""

from __future__ import annotations

import json
import struct
from collections import Counter
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.attribute_roles import MATERIAL, face_sets
from pdecodec.mesh.sequence import ArraySequence

READ = ("POSITION", "NORMAL", "TEXCOORD_", "COLOR_", "JOINTS_", "WEIGHTS_")
"""Beginnings of the names of attributes that are read."""

APPLIED = {"KHR_draco_mesh_compression", "EXT_meshopt_compression", "KHR_mesh_quantization", "EXT_mesh_gpu_instancing"}
APPLIED |= {"KHR_animation_pointer", "KHR_node_visibility"}
"""Extensions that affect where vertices are."""

KINDS = ("texture", "camera", "tangents", "extras of", "nodes without meshes", "copyright", "animations,", "KHR_lights")
"""Words of notices, each of which must occur exactly if the file has such a thing."""


def json_of(path: Path) -> dict[str, Any]:
    """Return the JSON of a .gltf or .glb file."""
    data = path.read_bytes()
    if data[:4] == b"glTF":
        (size,) = struct.unpack_from("<I", data, 12)
        data = data[20 : 20 + size]
    found: dict[str, Any] = json.loads(data)
    return found


def objects_in(value: Any) -> Iterator[dict[str, Any]]:
    """Yield every object in a JSON value."""
    if isinstance(value, dict):
        yield value
    for one in value.values() if isinstance(value, dict) else value if isinstance(value, list) else ():
        yield from objects_in(one)


def named(entries: list[dict[str, Any]], kind: str) -> list[str]:
    """Return the names of entries, or the names of their files."""
    found = []
    for number, one in enumerate(entries):
        uri = one.get("uri", "data:")
        found.append(one.get("name") or (f"{kind}_{number}" if uri.startswith("data:") else Path(uri).name))
    return found


def shown_nodes(root: dict[str, Any]) -> list[int]:
    """Return the nodes of the default scene, descendants included."""
    waiting = list(root["scenes"][root.get("scene", 0)]["nodes"]) if "scenes" in root else [*range(len(root["nodes"]))]
    found = []
    while waiting:
        found.append(waiting.pop())
        waiting += root["nodes"][found[-1]].get("children", []) if "scenes" in root else []
    return found


def listing(root: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield everything in a file except moving meshes: a kind of :data:`KINDS` if it has one, and a name."""
    for kind in ("image", "camera"):
        for name in named(root.get(f"{kind}s", []), kind):
            yield ("texture" if kind == "image" else kind), name
    if root.get("textures"):
        count = len(root["textures"])
        yield "texture", f"{count} texture{'s' * (count > 1)}"
    if len(root.get("animations", [])) > 1:
        yield from (("animations,", name) for name in named(root["animations"], "animation"))
    for mesh in root["meshes"]:
        for primitive in mesh["primitives"]:
            for name in primitive["attributes"]:
                if not name.startswith(READ):
                    yield ("tangents", "tangents") if name == "TANGENT" else ("", name)
    for name in root.get("extensionsUsed", []):
        if name not in APPLIED and not name.startswith("KHR_texture"):
            yield ("KHR_lights" if name.startswith("KHR_lights") else ""), name
    for one in objects_in({key: value for key, value in root.items() if key != "materials"}):
        if isinstance(one.get("extras"), dict):
            yield from (("extras of", key) for key in one["extras"])
    if root["asset"].get("copyright"):
        yield "copyright", "asset.copyright"
    joints = {joint for skin in root.get("skins", []) for joint in skin["joints"]}
    parents = {child: node for node, one in enumerate(root["nodes"]) for child in one.get("children", [])}
    moving = {node for node, one in enumerate(root["nodes"]) if "mesh" in one} | joints
    for node in list(moving):
        while node in parents:
            node = parents[node]
            moving.add(node)
    for number, one in enumerate(root["nodes"]):
        if number not in moving and "camera" not in one:
            yield "nodes without meshes", one.get("name", f"node_{number}")


def kinds_in(root: dict[str, Any]) -> Counter[str]:
    """Count the entries of each list of a file, and each attribute, extension and extra."""
    found = Counter({kind: len(entries) for kind, entries in root.items() if isinstance(entries, list)})
    for kind in ("extensionsUsed", "extensionsRequired"):
        del found[kind]
    for animation in root.get("animations", []):
        found["samplers"] += len(animation["samplers"])
        found["channels"] += len(animation["channels"])
    for primitive in (one for mesh in root["meshes"] for one in mesh["primitives"]):
        found["primitives"] += 1
        found.update(primitive["attributes"].keys())
        found.update(f"morphed {name}" for target in primitive.get("targets", []) for name in target)
    for one in objects_in(root):
        found.update(one.get("extensions", {}).keys())
        found.update(f"extras.{name}" for name in one.get("extras", {}))
    return found


def test_every_shared_file_has_what_a_plain_listing_of_it_has(shared_data: Path) -> None:
    paths = [path for part in ("interop", "files") for path in sorted((shared_data / part / "gltf").rglob("*.gl[bt]*"))]
    assert len(paths) >= 20
    for path in paths:
        root = json_of(path)
        with open_sequence(path) as read:
            told, items, whole = " ".join(read.notices), read.objects, read.connectivity
            contents = read.contents
        counts = Counter(one.kind for one in contents)
        assert {kind: counts[kind] for kind in kinds_in(root)} == kinds_in(root), path.name
        for one in contents:
            if one.fate == "dropped" and one.kind.isupper() and not one.kind.startswith("TANGENT"):
                assert one.kind in told, (path.name, one)
        kinds = set()
        for kind, name in listing(root):
            kinds.add(kind)
            assert name in told, (path.name, kind, name)
        assert not [one for one in KINDS if one in told and one not in kinds], path.name
        accessors, materials = root["accessors"], named(root.get("materials", []), "material")
        objects = rows = triangles = 0
        used = set()
        for node in (root["nodes"][number] for number in shown_nodes(root)):
            primitives = root["meshes"][node["mesh"]]["primitives"] if "mesh" in node else []
            instances = node.get("extensions", {}).get("EXT_mesh_gpu_instancing", {}).get("attributes", {})
            copies = max((accessors[one]["count"] for one in instances.values()), default=1)
            blocks = {json.dumps([one["attributes"], one.get("targets")], sort_keys=True): one for one in primitives}
            objects += copies * ("mesh" in node)
            rows += copies * sum(accessors[one["attributes"]["POSITION"]]["count"] for one in blocks.values())
            corners = [accessors[one.get("indices", one["attributes"]["POSITION"])]["count"] for one in primitives]
            triangles += copies * sum(corners) // 3
            used |= {materials[one["material"]] for one in primitives if "material" in one}
        assert (len(items), whole.vertex_count, whole.face_count) == (objects, rows, triangles), path.name
        assert {label for item in items for label, _ in face_sets(item, MATERIAL)} == used, path.name


def test_a_key_that_gltf_does_not_define_may_hold_anything(tmp_path: Path) -> None:
    points = np.zeros((2, 3, 3)) + np.eye(3)
    points[1, 0] += 0.5
    write_sequence(ArraySequence(points, faces=[[0, 1, 2]]), tmp_path / "a.gltf")
    root = json.loads((tmp_path / "a.gltf").read_text())
    root["animations"][0]["samplers"][0]["target"] = 4
    (tmp_path / "a.gltf").write_text(json.dumps(root))
    with open_sequence(tmp_path / "a.gltf") as sequence:
        assert np.array_equal(sequence.read_frames(0, 2), points.astype(np.float32))
