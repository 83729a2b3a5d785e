"""Make glTF files by hand, and return what viewers see in files."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.formats.gltf.builder import GltfBuilder
from pdecodec.formats.gltf.file import read_gltf
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import ArraySequence, MeshObject
from tests.support.mesh_cases import grid
from tests.support.scene_cases import (
    SPACE,
)
from tests.support.three_player import PlayedMesh, play


def few_functions() -> ArraySequence:
    """Return a grid whose motion consists of three functions of time."""
    rng = np.random.default_rng(5)
    time = np.arange(40) / 24
    curves = np.stack([np.sin((1 + k) * time) for k in range(3)], axis=1)
    points = 3 * rng.normal(size=(36, 3)) + np.tensordot(curves, rng.normal(size=(3, 36, 3)), 1)
    return ArraySequence(points, objects=[MeshObject("sheet", grid(6, 6))], times=time, fps=24)


def even_at_first() -> ArraySequence:
    """Return a sheet that is flat only at the first frame."""
    flat = np.stack([*np.divmod(np.arange(64), 8), np.zeros(64)], axis=1)
    points = flat + np.random.default_rng(6).normal(size=(9, 64, 3)) * np.arange(9)[:, None, None] / 20
    return ArraySequence(points, objects=[MeshObject("sheet", grid(8, 8))], fps=24, metadata=SPACE)


def played(path: Path, times: Float64Array) -> list[PlayedMesh]:
    """Return what three.js draws of a file at times [s]."""
    (found,) = play([(path, times.tolist())], path.parent / "profile", draw=True)
    assert not isinstance(found, str), found
    return found


def targets_of(path: Path) -> list[Any]:
    """Return the morph targets of the first primitive."""
    found: list[Any] = read_gltf(path).root["meshes"][0]["primitives"][0]["targets"]
    return found


class Scene:
    """A glTF file made by hand."""

    def __init__(self) -> None:
        self.builder = GltfBuilder()

    def mesh(self, points: Any, **primitive: Any) -> int:
        position = self.builder.floats(points, bounds=True)
        return self.builder.add("meshes", {"primitives": [{"attributes": {"POSITION": position}, **primitive}]})

    def animate(self, node: int, path: str, times: Any, values: Any, interpolation: str = "LINEAR") -> None:
        entry = self.builder.root.setdefault("animations", [{"channels": [], "samplers": []}])[-1]
        keys, output = self.builder.floats(times, bounds=True), self.builder.floats(values)
        entry["samplers"].append({"input": keys, "output": output, "interpolation": interpolation})
        entry["channels"].append({"sampler": len(entry["samplers"]) - 1, "target": {"node": node, "path": path}})

    def save(self, path: Path) -> Path:
        self.builder.save(path)
        return path


TRIANGLE = [[0, 0, 0], [1, 0, 0], [0, 1, 0]]


def triangle() -> tuple[Scene, int]:
    """Make a file of one triangle; return it and the triangle's node."""
    made = Scene()
    return made, made.builder.add("nodes", {"mesh": made.mesh(TRIANGLE)})


def lifted() -> tuple[Scene, int]:
    """Make a triangle with a morph target that lifts it."""
    made = Scene()
    target = made.builder.floats([[0, 0, 1]] * 3, bounds=True)
    return made, made.builder.add("nodes", {"mesh": made.mesh(TRIANGLE, targets=[{"POSITION": target}])})


def gltf_scene(path: Path) -> Path:
    """Write a skinned triangle under a rotated node, a camera, and a triangle under a moving node."""
    made = Scene()
    root = made.builder.root
    mesh = made.mesh(TRIANGLE, material=0, extras={"of": "primitive"})
    root["meshes"][mesh]["extras"] = {"mine": 1, "targetNames": []}
    names = root["meshes"][mesh]["primitives"][0]["attributes"]
    names["JOINTS_0"] = made.builder.integers(np.zeros(0))
    root["accessors"].pop()
    root["bufferViews"].pop()
    names["JOINTS_0"] = made.builder.add(
        "accessors",
        {"componentType": 5121, "count": 3, "type": "VEC4", "bufferView": made.builder.view(np.zeros((3, 4), "u1"))},
    )
    names["WEIGHTS_0"] = made.builder.floats([[1, 0, 0, 0]] * 3)
    names["TANGENT"] = made.builder.floats([[1, 0, 0, 1]] * 3)
    names["NORMAL"] = made.builder.floats([[0, 0, 1]] * 3)
    names["TEXCOORD_0"] = made.builder.floats([[0, 0], [1, 0], [0, 1]])
    names["_HEAT"] = made.builder.floats([1, 2, 3])
    root["materials"] = [{"name": "glass", "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}}}]
    root["textures"] = [{"source": 0}]
    root["images"] = [{"uri": "my%20image.png"}]
    root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1.0, "znear": 0.1}}]
    joint = made.builder.add("nodes", {"name": "joint"})
    root["skins"] = [{"joints": [joint]}]
    shown = made.builder.add(
        "nodes", {"name": "shown", "mesh": mesh, "skin": 0, "rotation": [0, 0.6, 0, 0.8], "extras": {"tag": "kept"}}
    )
    camera = made.builder.add("nodes", {"name": "camera", "camera": 0, "translation": [0, 0, 5]})
    carried = made.builder.add("nodes", {"name": "carried", "mesh": made.mesh(TRIANGLE)})
    carrier = made.builder.add("nodes", {"name": "carrier", "children": [carried]})
    root["scenes"] = [{"nodes": [joint, shown, camera, carrier], "extras": {"scene": True}}]
    for node, far in ((carrier, 9), (joint, 5), (camera, 7)):
        made.animate(node, "translation", [1 / 24, 4 / 24], [[0, 0, 0], [far, 0, 0]])
    root["animations"][0]["name"] = "walk"
    return made.save(path)
