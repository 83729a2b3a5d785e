"""Write vertex animation textures: a mesh as glTF, and PNG files that OpenVAT's shaders read in game engines.

``name.vat`` is JSON and lists the files next to it: the mesh in its first frame, ``name.glb``, and for each part of the
motion that fits textures of :data:`MAX_SIDE` texels a side the offsets of positions from the mesh, ``name_vat.png``,
the normals, ``name_vnrm.png``, and the range of the offsets, ``name-remap_info.json``. Several parts are
called ``name_1``, ``name_2`` and so on; each but the first repeats the last frame of the part before, so that shaders
can interpolate up to it. All parts fit the same mesh.

A texel is a normal of a vertex: vertices at hard edges have several. The second UV set of the mesh points to its texel
in the first frame; that of frame k is k rows below. Texels hold 16 bits a channel and are in Blender's axes,
(x, -z, y) of glTF's, as OpenVAT prescribes (https://github.com/sharpen3d/openvat).
"""

from __future__ import annotations

import json
import struct
import zlib
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import POINT, UV, unique_name, uv_sets, vertex_slices
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.normals import NormalRows, normal_rows, smooth_rows
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.scene_space import place, up_axis_of
from pdecodec.formats.gltf.file import json_bytes
from pdecodec.formats.gltf.writer import write_gltf
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from pdecodec.system.whole_output import check_writable, partial_folder, publish, write_errors

MAX_SIDE = 4096
"""Largest width and height of a texture [texels]: OpenVAT advises against larger ones, and every device takes it."""

WIDTHS = (64, 128, 256, 512, 1024, 2048, MAX_SIDE)
"""Possible widths [texels]. Heights are powers of two as well, because engines resize other textures."""

LARGEST = np.iinfo(np.uint16).max

EVEN_RATIO = 1e-3
"""Deviation of times from even ones that no notice names, as a ratio to the time between frames."""


class Layout(NamedTuple):
    """Where texels are: a part has `stride` frames, each a line below the one before."""

    width: int
    height: int
    stride: int

    def texels(self, rows: Int64Array) -> tuple[Int64Array, Int64Array]:
        """Return the lines and columns of rows (n,) in the first frame."""
        return rows // self.width * self.stride, rows % self.width

    def uvs(self, rows: Int64Array) -> Float32Array:
        """Return the UVs (n, 2) of rows (n,) in the first frame, with the origin at the bottom."""
        down, right = self.texels(rows)
        return np.stack([(right + 0.5) / self.width, 1 - (down + 0.5) / self.height], axis=1).astype(np.float32)


def layout_of(rows: int, frames: int) -> Layout:
    """Return the layout with the fewest parts, and of these the smallest; InputError if a part has only one frame."""
    found = []
    for width in WIDTHS:
        wraps = -(-rows // width)
        # A part shares a frame with the part before.
        steps, most = frames - 1, MAX_SIDE // wraps - 1
        if most >= min(steps, 1):
            parts = max(1, -(-steps // max(1, most)))
            stride = 1 + -(-steps // parts)
            height = 1 << (wraps * stride - 1).bit_length()
            found.append((parts, width * height, max(width, height), Layout(width, height, stride)))
    if not found:
        text = f"two frames of {rows} vertices do not fit {MAX_SIDE} x {MAX_SIDE} texels; choose fewer objects"
        raise InputError(text, code="too-large")
    return min(found)[3]


class _Mesh:
    """The objects with faces of a sequence; their `vertices`, and the vertex of each row of their normals, `sources`,
    are numbered as in the sequence.
    """

    def __init__(self, sequence: MeshSequence) -> None:
        self.objects: list[MeshObject] = []
        self._normals: list[tuple[slice, NormalRows]] = []
        self.left_out: list[str] = []
        sources: list[Int64Array] = []
        vertices: list[Int64Array] = []
        for item, own in zip(sequence.objects, vertex_slices(sequence.objects), strict=True):
            whole, rows = item.connectivity, normal_rows(item) or smooth_rows(item)
            held = tuple(one for one in item.attributes if one.name != POINT)
            if whole.line_count or len(held) < len(item.attributes) or (rows is None and item.vertex_count):
                self.left_out.append(item.name)
            if rows is None:
                continue
            faces = Connectivity(whole.vertex_count, whole.face_counts, whole.face_indices)
            self.objects.append(replace(item, connectivity=faces, attributes=held))
            self._normals.append((own, rows))
            vertices.append(np.arange(own.start, own.stop))
            sources.append(np.arange(own.start, own.start + rows.count))
            sources[-1][rows.corner_rows] = own.start + whole.face_indices
        if not self.objects:
            raise InputError("no object has faces, which vertex animation textures move")
        self.vertices, self.sources = np.concatenate(vertices), np.concatenate(sources)

    def with_uvs(self, layout: Layout) -> list[MeshObject]:
        """Return the objects with the UVs of their texels as second set."""
        found, start = [], 0
        for item, (_, rows) in zip(self.objects, self._normals, strict=True):
            sets, corners = uv_sets(item), item.connectivity.face_indices.size
            texels = layout.uvs(np.arange(start, start + rows.count))
            name = unique_name(f"{UV}:VAT_UV", {one.name for one in item.attributes})
            empty = Attribute(UV, "corner", np.zeros((1, 2), np.float32), np.zeros(corners, np.int32))
            ordered = (*(sets[:1] or [empty]), Attribute(name, "corner", texels, rows.corner_rows), *sets[1:])
            others = (one for one in item.attributes if not any(one is uv for uv in sets))
            found.append(replace(item, attributes=(*others, *ordered)))
            start += rows.count
        return found

    def normals(self, points: Float32Array) -> Float32Array:
        """Return the normals (rows, 3) at positions (vertices, 3) of the sequence."""
        return np.concatenate([rows.of(points[None, own])[0] for own, rows in self._normals])


class _Part:
    """Textures that are being filled; they have `count` frames so far."""

    def __init__(self, layout: Layout, first: int) -> None:
        self.first, self.count, self._layout = first, 0, layout
        shape = layout.height, layout.width, 3
        self._offsets, self._normals = np.zeros(shape, np.float32), np.zeros(shape, np.uint16)
        self._low, self._high = np.full(3, np.inf), np.full(3, -np.inf)

    def add(self, offsets: Float32Array, normals: Float32Array) -> None:
        """Add a frame: offsets and normals (rows, 3), in glTF's axes."""
        offsets = _in_blender(offsets)
        self._low, self._high = np.minimum(self._low, offsets.min(axis=0)), np.maximum(self._high, offsets.max(axis=0))
        down, right = self._layout.texels(np.arange(len(offsets)))
        self._offsets[down + self.count, right] = offsets
        fractions = _in_blender(normals).astype(np.float64) / 2 + 0.5
        self._normals[down + self.count, right] = np.rint(fractions * LARGEST)
        self.count += 1

    def save(self, folder: Path, name: str, rate: float) -> dict[str, Any]:
        """Write the textures and the range of offsets; return the entry that lists them."""
        files = _names(name)
        scale = LARGEST / np.where(self._high > self._low, self._high - self._low, 1)
        positions = np.empty_like(self._normals)
        for texels, offsets in zip(positions, self._offsets, strict=True):
            # Unused texels are zero, which may be outside the range.
            texels[:] = np.clip(np.rint((offsets - self._low) * scale), 0, LARGEST)
        write_png(folder / files["positions"], positions)
        write_png(folder / files["normals"], self._normals)
        limits = {"Min": self._low.tolist(), "Max": self._high.tolist(), "Frames": self.count}
        clip = {"startFrame": 0, "endFrame": self.count - 1, "framerate": rate, "looping": False}
        (folder / files["remap"]).write_bytes(json_bytes({"os-remap": limits, "animations": {name: clip}}))
        step = float((self._high - self._low).max()) / LARGEST
        return {**files, "first": self.first, "frames": self.count, "step": step}


def write_vertex_textures(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write a mesh, its motion as textures, and the list of these files.

    Raises
    ------
    InputError
        If a file exists or cannot be written, no object has faces, or positions are not finite or too many.
    """
    path, mesh = output.path, _Mesh(sequence)
    old = named_files(path) if path.is_file() else []
    layout = layout_of(mesh.sources.size, sequence.frame_count)
    firsts = range(0, max(1, sequence.frame_count - 1), max(1, layout.stride - 1))
    names = [path.stem if len(firsts) == 1 else f"{path.stem}_{number}" for number in range(1, len(firsts) + 1)]
    new = [path.name, f"{path.stem}.glb", *(file for name in names for file in _names(name).values())]
    for name in new:
        check_writable(path.with_name(name), overwrite=output.overwrite)
    rate, notices = _rate_of(sequence, output.rate)
    with partial_folder(path) as folder, write_errors(path):
        first = sequence.read_frames(0, 1)[:, mesh.vertices]
        still = ArraySequence(first, objects=mesh.with_uvs(layout), times=[0.0], metadata=sequence.metadata)
        glb = _InFolder(path=path.with_suffix(".glb"), rate=output.rate, looks_of=output.looks_of, folder=folder)
        notices += write_gltf(still, glb)
        filled = zip(names, _parts(sequence, mesh, layout, output), strict=True)
        parts = [part.save(folder, name, rate) for name, part in filled]
        listed = {"mesh": new[1], "fps": rate, "start": float(sequence.times[0]), "parts": parts}
        (folder / path.name).write_bytes(json_bytes(listed))
        publish(folder, new, overwrite=output.overwrite, remove=[one.name for one in old if one.name not in new])
    notices.append(
        f"positions are rounded to 16 bits: up to {max(part['step'] for part in parts) / 2:.2g} off along an axis"
    )
    if len(parts) > 1:
        notices.append(f"the frames do not fit one texture: {len(parts)} parts of up to {layout.stride} frames")
    return (*notices, *not_kept(mesh.left_out, "lines and points are not kept: {}"))


def _parts(sequence: MeshSequence, mesh: _Mesh, layout: Layout, output: Output) -> Iterator[_Part]:
    """Yield the parts of the motion, one after the other."""
    turned = sequence if up_axis_of(sequence) is None else place(sequence, up_axis="Y")
    rest = turned.read_frames(0, 1)[0].astype(np.float64)
    part = _Part(layout, 0)
    for start, block in output.blocks(turned, "vertex animation textures"):
        for frame, points in enumerate(block, start):
            if not np.isfinite(points).all():
                vertex = np.argwhere(~np.isfinite(points))[0, 0]
                text = f"vertex {vertex} is not finite, which textures cannot store; repair the sequence"
                raise InputError(text, code="not-finite", frame=frame)
            texels = (points - rest)[mesh.sources].astype(np.float32), mesh.normals(points)
            part.add(*texels)
            if part.count == layout.stride and frame + 1 < sequence.frame_count:
                yield part
                part = _Part(layout, frame)
                part.add(*texels)
    yield part


def _rate_of(sequence: MeshSequence, rate: float) -> tuple[float, list[str]]:
    """Return the rate at which the frames play evenly [1/s], and a notice if their times are uneven."""
    times = sequence.times
    even = np.linspace(times[0], times[-1], times.size)
    if times.size > 1:
        rate = round(float((times.size - 1) / (times[-1] - times[0])), 6)
    if np.abs(times - even).max() * rate <= EVEN_RATIO:
        return rate, []
    return rate, [f"times are irregular: shaders play the frames evenly, at {rate:g} frames per second"]


def _in_blender(vectors: Float32Array) -> Float32Array:
    """Return vectors (n, 3) of glTF in Blender's axes."""
    return vectors[:, [0, 2, 1]] * np.array([1, -1, 1], np.float32)


def write_png(path: Path, pixels: NDArray[np.uint16]) -> None:
    """Write an RGB image (height, width, 3) of 16 bits a channel."""
    height, width = pixels.shape[:2]
    rows = pixels.astype(">u2").view(np.uint8).reshape(height, 6 * width)
    # Filter 2, "Up": each byte minus the byte above.
    rows[1:] -= rows[:-1].copy()
    data = zlib.compress(np.pad(rows, ((0, 0), (1, 0)), constant_values=2).tobytes())
    head = struct.pack(">IIBBBBB", width, height, 16, 2, 0, 0, 0)
    with path.open("wb") as file:
        file.write(b"\x89PNG\r\n\x1a\n")
        for kind, body in (b"IHDR", head), (b"IDAT", data), (b"IEND", b""):
            check = zlib.crc32(body, zlib.crc32(kind))
            file.write(struct.pack(">I", len(body)) + kind + body + struct.pack(">I", check))


def _names(name: str) -> dict[str, str]:
    """Return the names of the files of a part, as OpenVAT's importers expect them."""
    return {"positions": f"{name}_vat.png", "normals": f"{name}_vnrm.png", "remap": f"{name}-remap_info.json"}


def named_files(path: Path) -> list[Path]:
    """Return the files that a ``.vat`` file lists or, if there is no valid one, would list for one part."""
    names = [f"{path.stem}.glb", *_names(path.stem).values()]
    with suppress(OSError, ValueError, LookupError, TypeError, AttributeError):
        listed = json.loads(path.read_bytes())
        parts = [part[kind] for part in listed["parts"] for kind, end in _names("").items() if part[kind].endswith(end)]
        names[1:] = [name for name in parts if Path(name).name == name]
    return [path.with_name(name) for name in names]


@dataclass(frozen=True, kw_only=True)
class _InFolder(Output):
    """Output that is written to another folder than it will be in."""

    folder: Path

    def whole_file(self) -> AbstractContextManager[Path]:
        return nullcontext(self.folder / self.path.name)
