"""PLY files out, binary and little-endian, one a frame: vertices, faces of any size, colours."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.attribute_roles import colors, indexed_rows, left_out
from pdecodec.formats.frame_writer import write_frames
from pdecodec.sequence import Attribute, Float32Array, MeshObject, MeshSequence, Progress


def write_ply(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as PLY files; objects are joined to one mesh.

    Raises
    ------
    InputError
        If the place is taken or not writable, or several frames are to go to one file.
    """
    rate = sequence.fps if fps is None else fps
    text = _PlyFile(sequence)
    write_frames(
        sequence,
        path,
        lambda points, time: text.of_frame(points),
        rate=rate,
        overwrite=overwrite,
        progress=progress,
        what="PLY",
    )
    notices = []
    if len(sequence.objects) > 1 or sequence.objects[0].name != "mesh":
        notices.append("PLY has no names: objects are one mesh")
    if sequence.connectivity.line_count:
        notices.append("lines are left out: readers of PLY take its edges for damage")
    notices += left_out(sequence, "PLY", lambda item, one: _held_color(item) is one)
    return (*notices, "PLY has no times: frames are numbered")


def _held_color(item: MeshObject) -> Attribute | None:
    return next((one for one in colors(item) if one.domain == "vertex"), None)


class _PlyFile:
    """What is the same in every frame."""

    def __init__(self, sequence: MeshSequence) -> None:
        connectivity = sequence.connectivity
        self._colors = _colors_of(sequence)
        channels = 0 if self._colors is None else self._colors.shape[1]
        names = ("red", "green", "blue", "alpha")[:channels]
        self._vertex = np.dtype([("position", "<f4", 3), ("color", "u1", channels)])
        faces = _polygons(connectivity.face_counts, connectivity.face_indices)
        head = ["ply", "format binary_little_endian 1.0", f"element vertex {sequence.vertex_count}"]
        head += [f"property float {axis}" for axis in "xyz"]
        head += [f"property uchar {name}" for name in names]
        if connectivity.face_count:
            size = "uchar" if connectivity.face_counts.max() < 256 else "int"
            head += [f"element face {connectivity.face_count}", f"property list {size} int vertex_indices"]
        self._head = ("\n".join([*head, "end_header"]) + "\n").encode("ascii")
        self._tail = faces

    def of_frame(self, points: Float32Array) -> bytes:
        rows = np.empty(len(points), self._vertex)
        rows["position"] = points
        if self._colors is not None:
            rows["color"] = self._colors
        return self._head + rows.tobytes() + self._tail


def _colors_of(sequence: MeshSequence) -> NDArray[np.uint8] | None:
    """Colours of every vertex as bytes; None unless every object has some."""
    found = [(item, _held_color(item)) for item in sequence.objects]
    if any(one is None for _, one in found):
        return None
    parts = []
    for item, one in found:
        if one is None:
            continue
        values, indices, _ = indexed_rows(one)
        every = values if indices is None else values[indices]
        parts.append(every if every.shape[1] == 4 else np.column_stack([every, np.ones(item.vertex_count)]))
    rows: NDArray[Any] = np.concatenate(parts)
    width = 3 if (rows[:, 3] == 1).all() else 4
    shades: NDArray[np.uint8] = np.rint(np.clip(rows[:, :width], 0, 1) * 255).astype(np.uint8)
    return shades


def _polygons(counts: NDArray[np.int32], indices: NDArray[np.int32]) -> bytes:
    """Faces as PLY's lists: a size of one byte, or of four where one is 256 or more, then indices."""
    if not counts.size:
        return b""
    size = 1 if counts.max() < 256 else 4
    starts = np.cumsum(size + 4 * counts.astype(np.int64)) - (size + 4 * counts)
    data = np.zeros(int(starts[-1] + size + 4 * int(counts[-1])), np.uint8)
    lengths = counts.astype("<i4").view(np.uint8).reshape(-1, 4)[:, :size]
    data[starts[:, None] + np.arange(size)] = lengths
    within = np.arange(indices.size) - np.repeat(np.cumsum(counts, dtype=np.int64) - counts, counts)
    places = np.repeat(starts + size, counts) + 4 * within
    data[places[:, None] + np.arange(4)] = indices.astype("<i4").view(np.uint8).reshape(-1, 4)
    return data.tobytes()
