"""Run by a Python with bpy: record what Blender shows of files at certain frames. The argument is a JSON file
of jobs.
"""

import json
import sys
import traceback
from pathlib import Path

import bpy
import numpy as np

IMPORTERS = {
    "abc": lambda path: bpy.ops.wm.alembic_import(filepath=path),
    **dict.fromkeys(("usd", "usda", "usdc", "usdz"), lambda path: bpy.ops.wm.usd_import(filepath=path)),
    **dict.fromkeys(("glb", "gltf"), lambda path: bpy.ops.import_scene.gltf(filepath=path)),
}


def seen(job):
    """Return the points of every mesh at every frame; corners, normals, materials and UV sets."""
    bpy.ops.wm.read_factory_settings(use_empty=True)
    render = bpy.context.scene.render
    render.fps = max(1, round(job["fps"]))
    render.fps_base = render.fps / job["fps"]
    IMPORTERS[job["path"].rpartition(".")[2].lower()](job["path"])
    points, normals, corners, materials, uvs = [], [], [], set(), 0
    for frame in job["frames"]:
        bpy.context.scene.frame_set(int(frame // 1), subframe=frame % 1)
        graph = bpy.context.evaluated_depsgraph_get()
        here, turned, faces, first = [], [], [], 0
        for thing in bpy.context.scene.objects:
            if thing.type != "MESH":
                continue
            there = thing.evaluated_get(graph)
            mesh, place = there.to_mesh(), np.array(there.matrix_world)
            rows = np.zeros(3 * len(mesh.vertices), np.float32)
            mesh.vertices.foreach_get("co", rows)
            here.append(rows.reshape(-1, 3) @ place[:3, :3].T + place[:3, 3])
            found = np.zeros(3 * len(mesh.loops), np.float32)
            mesh.corner_normals.foreach_get("vector", found)
            turned.append(found.reshape(-1, 3) @ np.linalg.inv(place[:3, :3]))
            indices = np.zeros(len(mesh.loops), np.int32)
            mesh.loops.foreach_get("vertex_index", indices)
            faces.append(indices + first)
            first += len(mesh.vertices)
            materials |= {slot.material.name for slot in thing.material_slots if slot.material}
            uvs = max(uvs, len(mesh.uv_layers))
            there.to_mesh_clear()
        points.append(np.concatenate([np.zeros((0, 3)), *here]))
        normals.append(np.concatenate([np.zeros((0, 3)), *turned]))
        corners.append(np.concatenate([np.zeros(0, np.int32), *faces]))
    alike = {len(one) for one in points}
    if len(alike) > 1:
        raise ValueError(f"the number of points changes: {sorted(alike)}")
    return {
        "points": np.stack(points),
        "normals": np.stack(normals),
        "corners": corners[0],
        "materials": np.array(sorted(materials)),
        "uvs": np.array(uvs),
    }


for job in json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")):
    try:
        np.savez(job["out"], **seen(job))
    except Exception as error:
        np.savez(job["out"], failed=np.array(f"{type(error).__name__}: {error}".splitlines()[0]))
        traceback.print_exc()
