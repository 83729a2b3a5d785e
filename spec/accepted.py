"""The vectors that every decoder must read: sequences of every kind, and files that are unusual but sound."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import ArraySequence, Attribute, Connectivity, EncodeSettings, MeshObject, encode
from pdecodec.sequence import MeshSequence
from spec.sealing import (
    Part,
    content,
    seal,
    split_integers,
    streams,
    take_apart,
    unpacked,
    with_chunk,
    with_section,
    with_stream,
)

Points = NDArray[np.float64]


def connectivity(vertices: int, faces: Any = (), lines: Any = ()) -> Connectivity:
    """From faces and lines as lists of vertices."""
    return Connectivity(
        vertices,
        face_counts=np.array([len(face) for face in faces], np.int32),
        face_indices=np.array([corner for face in faces for corner in face], np.int32),
        line_counts=np.array([len(line) for line in lines], np.int32),
        line_indices=np.array([point for line in lines for point in line], np.int32),
    )


def grid(rows: int, columns: int, *, closed: bool = False) -> Connectivity:
    """A sheet of quads, or a tube whose rows run lengthwise."""
    return connectivity(
        rows * columns,
        [
            (
                row * columns + column,
                row * columns + column + 1,
                (row + 1) % rows * columns + column + 1,
                (row + 1) % rows * columns + column,
            )
            for row in range(rows if closed else rows - 1)
            for column in range(columns - 1)
        ],
    )


def triangles(rows: int, columns: int) -> Connectivity:
    """A sheet of triangles, one more face on an inner edge (not a manifold), and a face of two equal corners."""
    quads = grid(rows, columns).face_indices.reshape(-1, 4)
    faces = [tuple(quad[list(corners)]) for quad in quads for corners in ((0, 1, 2), (0, 2, 3))]
    return connectivity(rows * columns, [*faces, (0, columns + 1, 2 * columns), (1, 1, 2)])


def wave(frames: int, rows: int, columns: int) -> Points:
    """(frames, rows * columns, 3): a sheet that waves."""
    x, y = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    t = np.arange(frames)[:, None, None] / 24
    height = np.sin(0.8 * x + 5 * t) * np.cos(0.5 * y - 3 * t)
    flat = np.broadcast_to(np.stack([x, y], axis=-1), (frames, rows, columns, 2))
    return np.concatenate([flat, height[..., None]], axis=-1).reshape(frames, -1, 3)


def tube(frames: int, rows: int, columns: int) -> Points:
    """(frames, rows * columns, 3): a tube that bends."""
    t = np.arange(frames)[:, None, None] / 24
    angle, along = 2 * np.pi * np.arange(rows)[:, None] / rows, np.arange(columns) / 2
    bend = 0.3 * np.sin(4 * t) * along
    shape = np.broadcast_arrays(np.cos(angle) + bend * along, np.sin(angle) + 0 * bend, along - 0.1 * bend * along)
    return np.stack(shape, axis=-1).reshape(frames, -1, 3)


def turning(frames: int, points: Points) -> Points:
    """A body that turns about the third axis and moves on."""
    angle = np.arange(frames) / 6
    c, s, o = np.cos(angle), np.sin(angle), 0 * angle
    matrices = np.stack([np.stack([c, -s, o]), np.stack([s, c, o]), np.stack([o, o, o + 1])]).transpose(2, 0, 1)
    moved: Points = points @ matrices.transpose(0, 2, 1) + np.arange(frames)[:, None, None] * [0.1, 0, 0.02]
    return moved


def noise(*shape: int, seed: int = 0) -> Points:
    return np.random.default_rng(seed).normal(size=shape)


def clip(points: Points, part: Connectivity | None = None, **options: Any) -> ArraySequence:
    objects = [MeshObject("mesh", part)] if part else None
    return ArraySequence(points, objects=objects, **options)


def with_attributes() -> ArraySequence:
    faces = [(0, 1, 2, 3, 4), (4, 3, 5, 6), (6, 5, 7), (0, 4, 6, 8, 9, 10)]
    part = connectivity(11, faces, [(10, 9), (8,)])
    uv = Attribute(
        "uv", "corner", noise(7, 2).astype(np.float32), np.array([*range(7), -1, *range(6), 0, 3, 6, -1], np.int32)
    )
    attributes = (
        uv,
        Attribute("group", "face", np.array([0, 1, 1, 0], np.int32), labels=("arm", "linkes Bein ü", "空")),
        Attribute("color", "vertex", np.arange(33, dtype=np.uint8).reshape(11, 3)),
        Attribute("weight", "vertex", np.linspace(0, 1, 11)),
        Attribute("id", "object", np.array([2**40, -1], np.int64)),
        Attribute("nothing", "object", np.zeros((0, 3), np.float32)),
    )
    points = noise(1, 11, 3) + 0.1 * noise(6, 1, 3, seed=1)
    metadata = {"up_axis": "Y", "unit": "m"}
    return ArraySequence(points, objects=[MeshObject("polygons", part, attributes)], fps=25, metadata=metadata)


def several_objects() -> ArraySequence:
    parts = [
        ("tube", grid(4, 6, closed=True)),
        ("", connectivity(0)),
        ("Strähne 二", connectivity(8, lines=[range(8)])),
        ("tube", grid(3, 3)),
        ("points", connectivity(5)),
    ]
    objects = [MeshObject(name, part) for name, part in parts]
    vertices = sum(item.vertex_count for item in objects)
    return ArraySequence(wave(9, 2, 23)[:, :vertices], objects=objects)


LINES = [range(12), (12, 13), (13, 14, 15), (16,), (17, 17, 18), (3, 20, 3), (19, 18)]

SEQUENCES: dict[str, tuple[Callable[[], MeshSequence], dict[str, Any]]] = {
    "static": (lambda: clip(np.repeat(wave(1, 5, 7), 5, axis=0), grid(5, 7)), {}),
    "one_frame": (lambda: clip(wave(1, 4, 6), grid(4, 6), times=[1.5]), {}),
    "one_vertex": (lambda: clip(noise(9, 1, 3)), {}),
    "two_frames": (lambda: clip(wave(2, 3, 4), grid(3, 4)), {}),
    "points": (lambda: clip(noise(1, 70, 3) + 0.1 * noise(7, 70, 3, seed=1)), {}),
    "lines": (lambda: clip(wave(8, 3, 7), connectivity(21, lines=LINES)), {}),
    "triangles": (lambda: clip(wave(8, 5, 6), triangles(5, 6)), {}),
    "tube": (lambda: clip(tube(10, 8, 12), grid(8, 12, closed=True)), {}),
    "polygons_attributes": (with_attributes, {}),
    "several_objects": (several_objects, {}),
    "alignment_none": (lambda: clip(wave(12, 5, 6), grid(5, 6)), {"alignment": "none", "r": 3.25, "alpha": 2.7}),
    "alignment_affine": (lambda: clip(wave(12, 5, 6), grid(5, 6)), {"alignment": "affine", "piece_points": 12}),
    "alignment_rotation": (
        lambda: clip(turning(12, tube(1, 6, 10)[0]), grid(6, 10, closed=True)),
        {"alignment": "rotation", "segment_frames": 6},
    ),
    "paper": (lambda: clip(tube(23, 4, 24), grid(4, 24, closed=True)), {"profile": "paper"}),
    "many_segments": (
        lambda: clip(wave(20, 4, 6) + 0.05 * noise(20, 24, 3), grid(4, 6)),
        {"segment_frames": 3, "tolerance": 0.01},
    ),
    "irregular_times": (lambda: clip(wave(9, 4, 5), grid(4, 5), times=[-2, -1.5, -1, 0, 0.1, 0.11, 5, 5.5, 7.25]), {}),
    "stepped_times": (lambda: clip(wave(9, 4, 5), grid(4, 5), times=1 / 3 + np.arange(9) / 29.97), {}),
    "close_frames": (
        lambda: clip(wave(5, 3, 4), grid(3, 4), times=[0, 2.0**-53, 1, 1 + 2.0**-52, 3], fps=24),
        {"segment_frames": 5},
    ),
    "huge_coordinates": (lambda: clip(wave(6, 3, 5) * 1e30, grid(3, 5)), {}),
    "tiny_coordinates": (lambda: clip(wave(6, 3, 5) * 1e-40, grid(3, 5)), {}),
    "far_from_origin": (lambda: clip(wave(6, 3, 5) + 1e6, grid(3, 5)), {"tolerance": 1e-5}),
    "explosion": (lambda: clip(wave(6, 3, 5) + 1e20 * np.eye(6, 1, -3)[:, :, None], grid(3, 5)), {}),
}


def accepted(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Files that every decoder must read."""
    path = folder / "a.pdeanim"
    for name, (make, options) in SEQUENCES.items():
        encode(make(), path, EncodeSettings(**{"profile": "segments", **options}), overwrite=True)
        yield name, path.read_bytes()
    encode(
        SEQUENCES["alignment_rotation"][0](),
        path,
        EncodeSettings(profile="segments", alignment="rotation"),
        overwrite=True,
    )
    parts = take_apart(path.read_bytes())
    unknown = [Part("XYZW", b"anything", 0), *parts, Part("\xff\x00ab", b"", 0xFFFFFFFE)]
    yield "unknown_ignorable_sections", seal([replace(part, flags=part.flags | 0x100) for part in unknown], minor=7)
    yield "sections_in_another_order", seal(parts[::-1])
    yield "without_remarks", seal([part for part in parts if part.kind != "META"])
    yield "zero_quaternions", seal(with_chunk(parts, "COEF", b""))
    rest = content(parts, "REST")
    for stream in streams(rest)[::-1]:
        longer = [value[:-1] + bytes([value[-1] | 128, 0]) for value in split_integers(unpacked(rest, stream))]
        rest = with_stream(rest, stream, b"".join(longer))
    yield "integers_in_longer_forms", seal(with_section(parts, "REST", rest))
