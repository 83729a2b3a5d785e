"""Write `example.glb`: a flag that waves (a motion, cut at a seam of its UVs), on a ball that bounces (a node)."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from pdecodec import ArraySequence, EncodeSettings
from pdecodec.formats import write_sequence
from pdecodec.formats.base.attribute_roles import MATERIAL
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject

COLUMNS, ROWS, FRAMES, RATE = 9, 4, 36, 24.0

PATH = Path(__file__).with_name("example.glb")


def example() -> ArraySequence:
    """Return the scene: Y-up, in metres, one second and a half long."""
    time = np.arange(FRAMES) / RATE
    u, v = (one.reshape(-1) for one in np.meshgrid(np.linspace(0, 1, COLUMNS), np.linspace(0, 0.5, ROWS)))
    flag = np.zeros((FRAMES, u.size, 3), np.float32)
    flag[..., 0], flag[..., 1] = u, v + 1
    flag[..., 2] = 0.2 * u * np.sin(9 * u - 8 * time[:, None])
    corner = np.arange(COLUMNS * (ROWS - 1)).reshape(ROWS - 1, COLUMNS)[:, :-1].reshape(-1)
    quads = corner[:, None] + [0, 1, COLUMNS + 1, COLUMNS]
    faces = Connectivity(u.size, np.full(len(quads), 4, np.int32), quads.reshape(-1).astype(np.int32))
    # The right half has the texture once more: a seam in the middle.
    repeated = np.where(u[quads].mean(axis=1, keepdims=True) > 0.5, 0.5, 0)
    uvs = np.stack([2 * (u[quads] - repeated), 2 * v[quads]], axis=-1).reshape(-1, 2).astype(np.float32)
    cloth = Attribute(MATERIAL, "face", np.zeros(len(quads), np.int32), labels=("cloth",))
    tetrahedron = 0.2 * np.array([[1, 1, 1], [1, -1, -1], [-1, 1, -1], [-1, -1, 1]], np.float32)
    ball = np.repeat(tetrahedron[None], FRAMES, axis=0)
    ball[..., 1] += np.abs(np.sin(6 * time))[:, None]
    sides = np.array([0, 1, 2, 0, 3, 1, 0, 2, 3, 1, 3, 2], np.int32)
    objects = (
        MeshObject("flag", faces, (Attribute("uv", "corner", uvs), cloth)),
        MeshObject("ball", Connectivity(4, np.full(4, 3, np.int32), sides)),
    )
    metadata = {"up_axis": "Y", "unit": "m"}
    return ArraySequence(np.concatenate([flag, ball], axis=1), objects=objects, times=time, metadata=metadata)


def write(path: Path) -> None:
    write_sequence(example(), path, motion=EncodeSettings(tolerance=1e-3), overwrite=True)


if __name__ == "__main__":
    write(PATH)
