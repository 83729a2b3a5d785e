"""Run Blender in tests of how it shows files that we write; without Blender the tests are skipped."""

from __future__ import annotations

import json
import os
import subprocess
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

PATIENCE = 300
"""Time limit of Blender for one file [s]."""

_SCRIPT = """
import json, sys
import bpy

path, frames = sys.argv[1], json.loads(sys.argv[2])
bpy.ops.wm.read_factory_settings(use_empty=True)
bpy.context.scene.render.fps = 24
if path.endswith(".abc"):
    bpy.ops.wm.alembic_import(filepath=path)
elif ".usd" in path:
    bpy.ops.wm.usd_import(filepath=path)
else:
    bpy.ops.import_scene.gltf(filepath=path)
found = []
for frame in frames:
    bpy.context.scene.frame_set(int(frame), subframe=frame % 1)
    graph = bpy.context.evaluated_depsgraph_get()
    meshes = {}
    for thing in bpy.context.scene.objects:
        if thing.type == "MESH":
            there = thing.evaluated_get(graph)
            mesh, place = there.to_mesh(), there.matrix_world
            turn = place.to_3x3().inverted().transposed()
            meshes[thing.name] = {
                "points": [list(place @ vertex.co) for vertex in mesh.vertices],
                "corners": [corner.vertex_index for corner in mesh.loops],
                "sizes": [face.loop_total for face in mesh.polygons],
                "normals": [list((turn @ normal.vector).normalized()) for normal in mesh.corner_normals],
                "materials": [
                    getattr(thing.material_slots[face.material_index].material, "name", "")
                    for face in (mesh.polygons if thing.material_slots else ())
                ],
                "colors": {
                    one.name: [list(value.color_srgb) for value in one.data]
                    for one in mesh.color_attributes if one.domain == "CORNER"
                },
            }
            there.to_mesh_clear()
    found.append(meshes)
print("FOUND " + json.dumps(found))
"""


def seen_by_blender(path: Path, frames: Sequence[float]) -> list[dict[str, Any]]:
    """Return what Blender shows at frames of its timeline, at 24 per second.

    The result has points, corners, sizes, normals, materials of faces and colours of corners of each mesh.
    """
    python = os.environ.get("PDECODEC_BLENDER")
    if not python:
        pytest.skip("Blender is not here; set PDECODEC_BLENDER to a Python that has the package bpy")
    command = [python, "-c", _SCRIPT, str(path), json.dumps(list(frames))]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE)
    lines = [line for line in done.stdout.splitlines() if line.startswith("FOUND ")]
    assert lines, done.stderr[-2000:]
    found: list[dict[str, Any]] = json.loads(lines[0].removeprefix("FOUND "))
    return found
