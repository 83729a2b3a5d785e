"""The vectors that every decoder must read: sequences of every kind, and files that are unusual but valid.

The encoder's choices that depend on size are forced here, so that small clips contain what their names say.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass, field, replace
from typing import Any
from unittest.mock import patch

import numpy as np

from pdecodec import (
    ArraySequence,
    Attribute,
    ChangingSequence,
    Connectivity,
    EncodeSettings,
    Field,
    MeshObject,
    PaperSettings,
    encode,
)
from pdecodec._core import Residuals
from pdecodec.codec.encode.fit import GroupFitter
from pdecodec.codec.encode.search import GroupSearch
from pdecodec.codec.encode.temporal import TimeFunctions
from pdecodec.codec.encode.tuning import TUNINGS
from pdecodec.codec.sections.residuals import encode_residuals
from pdecodec.codec.sections.scene import Carrier, encode_scene
from pdecodec.codec.sections.space_basis import SpaceKind
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import MeshSequence
from spec.sealing import Part, compressed, content, run_of, seal, take_apart, with_first_group, with_section

Points = Float64Array


def connectivity(vertices: int, faces: Any = (), lines: Any = ()) -> Connectivity:
    """Build the connectivity from faces and lines given as lists of vertices."""
    return Connectivity(
        vertices,
        face_counts=np.array([len(face) for face in faces], np.int32),
        face_indices=np.array([corner for face in faces for corner in face], np.int32),
        line_counts=np.array([len(line) for line in lines], np.int32),
        line_indices=np.array([point for line in lines for point in line], np.int32),
    )


def grid(rows: int, columns: int, *, closed: bool = False) -> Connectivity:
    """Return a sheet of quads, or a tube whose rows run lengthwise."""
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
    """Return a sheet of triangles, plus a third face on an inner edge (non-manifold) and a degenerate face."""
    quads = grid(rows, columns).face_indices.reshape(-1, 4)
    faces = [tuple(quad[list(corners)]) for quad in quads for corners in ((0, 1, 2), (0, 2, 3))]
    return connectivity(rows * columns, [*faces, (0, columns + 1, 2 * columns), (1, 1, 2)])


def wave(frames: int, rows: int, columns: int) -> Points:
    """Return a waving sheet, (frames, rows * columns, 3)."""
    x, y = np.meshgrid(np.arange(rows), np.arange(columns), indexing="ij")
    t = np.arange(frames)[:, None, None] / 24
    height = np.sin(0.8 * x + 5 * t) * np.cos(0.5 * y - 3 * t)
    flat = np.broadcast_to(np.stack([x, y], axis=-1), (frames, rows, columns, 2))
    return np.concatenate([flat, height[..., None]], axis=-1).reshape(frames, -1, 3)


def tube(frames: int, rows: int, columns: int) -> Points:
    """Return a bending tube, (frames, rows * columns, 3)."""
    t = np.arange(frames)[:, None, None] / 24
    angle, along = 2 * np.pi * np.arange(rows)[:, None] / rows, np.arange(columns) / 2
    bend = 0.3 * np.sin(4 * t) * along
    shape = np.broadcast_arrays(np.cos(angle) + bend * along, np.sin(angle) + 0 * bend, along - 0.1 * bend * along)
    return np.stack(shape, axis=-1).reshape(frames, -1, 3)


def turning(frames: int, points: Points) -> Points:
    """Return a body that rotates about the third axis while it moves away."""
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


def solids(frames: int = 3) -> ArraySequence:
    """Two hexahedra, a pyramid on them, two tetrahedra of which one is quadratic, a wedge, and a line; heat in each."""
    cells = [
        (8, [0, 1, 4, 3, 6, 7, 10, 9]),
        (8, [1, 2, 5, 4, 7, 8, 11, 10]),
        (6, [6, 7, 10, 9, 12]),
        (5, [7, 8, 10, 12]),
        (5, [8, 11, 10, 12, 13, 14, 15, 16, 17, 18]),
        (7, [0, 3, 9, 1, 4, 10]),
        (0, [12, 0]),
    ]
    part = Connectivity(
        19,
        np.full(2, 4, np.int32),
        np.array([0, 3, 4, 1, 1, 4, 5, 2], np.int32),
        np.array([2], np.int32),
        np.array([12, 0], np.int32),
        np.array([shape for shape, _ in cells], np.uint8),
        np.array([len(nodes) for _, nodes in cells], np.int32),
        np.concatenate([nodes for _, nodes in cells]).astype(np.int32),
    )
    block = Attribute("block", "cell", np.array([0, 0, 1, 1, 1, 0, 2], np.int32), labels=("a", "b", "c"))
    objects = [MeshObject("solid", part, (block,)), MeshObject("flat", grid(2, 2))]
    heat = np.round(noise(frames, 7), 1).astype(np.float32)
    points = noise(1, 23, 3) + 0.1 * noise(frames, 1, 3, seed=1)
    return ArraySequence(points, objects=objects, fields=[(Field("heat", "cell"), heat)])


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


def mapped() -> ArraySequence:
    """A tube with UVs that have a seam, UVs of arbitrary floats, colours of corners, hard edges and sets of faces."""
    rows, columns = 5, 8
    corners = np.array([(0, 0), (0, 1), (1, 1), (1, 0)])
    quads = np.array([(row, column) for row in range(rows) for column in range(columns - 1)])
    places = (quads[:, None] + corners).reshape(-1, 2)
    uv = (places / [8, 16]).astype(np.float32)
    turned = (np.sin(places[:, :1]) + places @ [[0.0, 0.31], [0.77, 0.0]]).astype(np.float32)
    rows_of_uv, indices = np.unique(uv, axis=0, return_inverse=True)
    shade = np.stack([places[:, 0] * 40, places[:, 1] * 30, places[:, 1] * 30], axis=1).astype(np.uint8)
    attributes = (
        Attribute("uv", "corner", rows_of_uv, indices.astype(np.int32)),
        Attribute("uv:turned", "corner", turned),
        Attribute("color", "corner", shade),
        Attribute("normal_group", "corner", np.tile(np.array([0, 0, 1, 1], np.int32), len(quads))),
        Attribute("material", "face", (quads[:, 0] // 2).astype(np.int32), labels=("skin", "wool", "Gold")),
        Attribute("group:left", "face", (quads[:, 1] < 3).astype(np.uint8)),
    )
    part = grid(rows, columns, closed=True)
    return ArraySequence(tube(3, rows, columns), objects=[MeshObject("mapped", part, attributes)])


def jumping(**options: Any) -> ArraySequence:
    """A waving sheet with discontinuities: early, in quick succession, and at the end."""
    points = wave(16, 4, 6)
    for jump in (2, 5, 8, 15):
        points[jump:] += 40.0 * np.array([jump % 2, 1, -jump])
    return clip(points, grid(4, 6), **options)


def runs_that_jump() -> ChangingSequence:
    """Runs of a sheet with discontinuities within the runs and between them."""
    whole, other = jumping(), jumping(times=1.0 + np.arange(16) / 24)
    return ChangingSequence([whole, other])


def shuffled() -> ArraySequence:
    """A sheet whose vertices and faces are in random order."""
    random = np.random.default_rng(2)
    name = random.permutation(24)
    faces = name[grid(4, 6).face_indices.reshape(-1, 4)][random.permutation(15)]
    return clip(wave(6, 4, 6)[:, np.argsort(name)], connectivity(24, faces))


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


@dataclass(frozen=True, kw_only=True)
class Choices:
    """The choices that the encoder is made to make: its settings, and decisions that otherwise depend on size."""

    time: TimeFunctions = "trajectories"
    space: tuple[SpaceKind, int] = ("patch", 64)
    longest_group: int = 512
    settings: dict[str, Any] = field(default_factory=dict)


def encoded(sequence: MeshSequence, choices: Choices) -> bytes:
    """Encode a sequence with forced choices."""
    with ExitStack() as held:
        first = vars(GroupFitter)["first_choice"].fget
        with_time = property(lambda fitter: replace(first(fitter), time=choices.time))
        held.enter_context(patch.object(GroupFitter, "first_choice", with_time))
        held.enter_context(patch.object(GroupSearch, "candidates", lambda search, first: [first]))
        fast = replace(
            TUNINGS["fast"],
            spatial_bases=(choices.space,),
            small_mesh_spatial_bases=(),
            longest_group=choices.longest_group,
        )
        held.enter_context(patch.dict(TUNINGS, {"fast": fast}))
        settings = EncodeSettings(**{"effort": "fast", **choices.settings})
        data = encode(sequence, settings=settings).data
    assert data is not None  # None only if a path is given
    return data


def paper(tolerance: float | None = None, **options: Any) -> Choices:
    """Choices of profile paper: functions of time and of space in closed form."""
    return Choices(settings={"profile": "paper", "paper": PaperSettings(**options), "tolerance": tolerance})


def soup(frames: int = 6, rows: int = 4, columns: int = 5) -> ArraySequence:
    """Quads at shared positions, each with its own vertices."""
    corners = grid(rows, columns).face_indices
    faces = np.arange(corners.size).reshape(-1, 4).tolist()
    return clip(wave(frames, rows, columns)[:, corners], connectivity(corners.size, faces))


def partly_tied() -> ArraySequence:
    """A soup of two objects and of loose points. Later, two quads leave the soup, one of them together with the
    vertices that lie on it.
    """
    soup_points, points = soup(7, 4, 6).points, np.zeros((7, 5, 3))
    own = soup(7, 4, 6).objects[0].connectivity
    points[:, [0, 3]], points[:, 1:3] = soup_points[:, [0]], 9.0
    joined = np.concatenate([soup_points, points, soup_points[:, 20:28]], axis=1)
    end = own.vertex_count
    joined[3:, 8:12] += [0, 0, 0.5]
    joined[4:, [20, 21, end + 5, end + 6]] += [0.3, 0, 0]
    joined[2:, end + 4] -= 1.0
    last = connectivity(8, [(0, 1, 2, 3), (4, 5, 6, 7)])
    objects = [MeshObject("soup", own), MeshObject("points", connectivity(5)), MeshObject("copy", last)]
    return ArraySequence(joined, objects=objects)


def two_sheets() -> ArraySequence:
    """Two separate sheets, one of them still, and a vertex without faces."""
    moving = wave(7, 4, 9)
    still = np.repeat(wave(1, 3, 5), 7, axis=0) + np.array([12.0, 0.0, 1.0])
    sheets = [MeshObject("moving", grid(4, 9)), MeshObject("still", grid(3, 5)), MeshObject("", connectivity(1))]
    return ArraySequence(np.concatenate([moving, still, np.ones((7, 1, 3))], axis=1), objects=sheets)


def standing() -> ArraySequence:
    """A sheet whose first two rows stand still, a moving soup, a soup that stands still, and two loose points."""
    sheet, swing = wave(7, 5, 9), soup(7, 3, 5).points
    sheet[:, :18] = sheet[:1, :18]
    still = np.repeat(swing[:1], 7, axis=0) + np.array([9.0, 0.0, 1.0])
    points = np.stack([np.ones((7, 3)), np.outer(np.arange(7), [0.1, 0.0, 0.3])], axis=1)
    item = soup(7, 3, 5).objects[0].connectivity
    objects = [MeshObject("sheet", grid(5, 9)), MeshObject("moving", item), MeshObject("still", item)]
    joined = np.concatenate([sheet, swing - [9.0, 0.0, 0.0], still, points], axis=1)
    return ArraySequence(joined, objects=[*objects, MeshObject("points", connectivity(2))])


def rough(frames: int, rows: int, columns: int) -> ArraySequence:
    """A waving sheet with noise, most of which the residuals must store."""
    return clip(wave(frames, rows, columns) + 0.03 * noise(frames, rows * columns, 3), grid(rows, columns))


def in_cosines(frames: int) -> ArraySequence:
    """A sheet whose motion is exactly a sum of two cosines of a clip of this length, so all other coefficients
    are zero.
    """
    phase = np.pi * (np.arange(frames)[:, None] + 0.5) / frames
    swing = np.cos(3 * phase) * wave(1, 4, 6)[0, :, 2] + np.cos(7 * phase) * np.arange(24) / 24
    points = np.repeat(wave(1, 4, 6), frames, axis=0)
    points[:, :, 2] = swing
    return clip(points, grid(4, 6))


def keyframed() -> ArraySequence:
    """A sheet that moves linearly from pose to pose."""
    along = np.interp(np.arange(40), [0, 11, 12, 30, 39], [0.0, 3.0, 3.0, -1.0, 2.0])[:, None]
    points = np.repeat(wave(1, 4, 6), 40, axis=0)
    points[:, :, 2] += along * np.linspace(0.2, 1, 24)
    return clip(points, grid(4, 6))


def runs() -> ChangingSequence:
    """Runs of faces, lines and points with different names, attributes and motions, and irregular times."""
    quads = MeshObject("quads", grid(3, 4))
    marked = Attribute("group", "face", np.array([0, 1] * 4, np.int32), labels=("a", "b"))
    strands = connectivity(12, lines=[range(7), range(7, 12)])
    parts = [
        (wave(5, 3, 4), [quads]),
        (wave(1, 5, 3), [MeshObject("quads", grid(5, 3), (marked,))]),
        (wave(1, 5, 3) + 1, [MeshObject("quads", grid(5, 3), (marked,))]),
        (wave(3, 5, 6), [MeshObject("sheet", triangles(3, 6)), MeshObject("strands", strands)]),
        (noise(2, 9, 3), [MeshObject("points", connectivity(9))]),
    ]
    ends = np.cumsum([len(points) for points, _ in parts])
    times = np.cumsum(np.linspace(0.03, 0.05, int(ends[-1])))
    clips = [
        ArraySequence(points, objects=objects, times=times[end - len(points) : end], fps=25)
        for (points, objects), end in zip(parts, ends, strict=True)
    ]
    return ChangingSequence(clips, metadata={"up_axis": "Z"})


def runs_of_one_frame() -> ChangingSequence:
    """A sheet that is remeshed in every frame."""
    sizes = [(3, 4), (4, 4), (4, 4), (5, 3), (2, 9)]
    clips = [
        clip(wave(frame + 1, *size)[-1:], grid(*size), times=[(frame + 10) / 24]) for frame, size in enumerate(sizes)
    ]
    return ChangingSequence(clips, fps=24)


def sheet(frames: int = 8, **options: Any) -> ArraySequence:
    return clip(wave(frames, 4, 6), grid(4, 6), **options)


def solids_in_runs() -> MeshSequence:
    """Return runs of solids, of the same solids again, and of faces alone."""
    solid, flat = MeshObject("s", solids().objects[0].connectivity), MeshObject("f", grid(2, 2))
    runs = (([solid], 19), ([solid], 19), ([flat], 4))
    return ChangingSequence(
        [ArraySequence(noise(1, size, 3, seed=k), objects=own, times=[k / 24]) for k, (own, size) in enumerate(runs)]
    )


IRREGULAR = [-2, -1.5, -1, 0, 0.1, 0.11, 5, 5.5, 7.25]

SEQUENCES: dict[str, tuple[Callable[[], MeshSequence], Choices]] = {
    "trajectories_predicted": (lambda: sheet(12), Choices()),
    "trajectories_transformed": (lambda: in_cosines(40), Choices(settings={"tolerance": 1e-4})),
    "trajectories_in_straight_runs": (keyframed, Choices()),
    "cosines": (lambda: sheet(12), Choices(time="cosines")),
    "shapes_predicted": (lambda: sheet(12), Choices(time="shapes")),
    "shapes_transformed": (lambda: in_cosines(40), Choices(time="shapes", settings={"tolerance": 1e-4})),
    "shapes_in_double": (lambda: sheet(6), Choices(time="shapes", settings={"tolerance": 1e-6})),
    "groups_of_shapes": (lambda: sheet(11), Choices(time="shapes", longest_group=4)),
    "groups": (lambda: sheet(11), Choices(longest_group=4)),
    "groups_of_cosines": (lambda: sheet(11), Choices(time="cosines", longest_group=4)),
    "groups_of_one_frame": (lambda: sheet(3), Choices(longest_group=1)),
    "groups_in_double": (lambda: sheet(6), Choices(longest_group=3, settings={"tolerance": 1e-6})),
    "cosines_in_double": (lambda: sheet(6), Choices(time="cosines", settings={"tolerance": 1e-6})),
    "still": (standing, Choices(space=("patch", 8))),
    "still_on_curves": (standing, Choices(space=("curve", 8))),
    "many_patches": (two_sheets, Choices(space=("patch", 8))),
    "many_pieces": (lambda: clip(tube(8, 5, 20), grid(5, 20, closed=True)), Choices(space=("curve", 8))),
    "triangles": (lambda: clip(wave(8, 5, 6), triangles(5, 6)), Choices(space=("patch", 16))),
    "polygons_attributes": (with_attributes, Choices()),
    "mapped": (mapped, Choices()),
    "mapped_to_a_tolerance": (mapped, Choices(settings={"uv_tolerance": 1 / 256})),
    "order_kept": (shuffled, Choices()),
    "order_free": (shuffled, Choices(settings={"order": "free"})),
    "several_objects": (several_objects, Choices(space=("patch", 16))),
    "lines": (lambda: clip(wave(8, 3, 7), connectivity(21, lines=LINES)), Choices(space=("patch", 8))),
    "points": (lambda: clip(noise(1, 40, 3) + 0.1 * noise(7, 40, 3, seed=1)), Choices()),
    "one_vertex": (lambda: clip(noise(9, 1, 3)), Choices()),
    "welded": (soup, Choices()),
    "smoothed": (lambda: clip(wave(5, 9, 12), grid(9, 12)), Choices(settings={"tolerance": 0.02})),
    "smoothed_across_welds": (lambda: soup(4, 8, 9), Choices(settings={"tolerance": 0.02})),
    "tied": (lambda: soup(9, 5, 6), Choices(space=("patch", 16), settings={"tolerance": 1e-3})),
    "tied_in_part": (partly_tied, Choices(space=("patch", 8))),
    "closed_form_of_ties": (partly_tied, paper(tolerance=0.01)),
    "solids": (solids, Choices()),
    "one_frame": (lambda: sheet(1, times=[1.5]), Choices()),
    "two_frames": (lambda: sheet(2), Choices()),
    "static": (lambda: clip(np.repeat(wave(1, 5, 7), 5, axis=0), grid(5, 7)), Choices()),
    "rigid": (lambda: clip(turning(12, tube(1, 5, 8)[0]), grid(5, 8, closed=True)), Choices()),
    "residuals": (lambda: rough(6, 3, 6), Choices(settings={"tolerance": 3e-3})),
    "raw_vertices": (lambda: clip(wave(6, 3, 5) + 1e20 * np.eye(6, 1, -3)[:, :, None], grid(3, 5)), Choices()),
    "irregular_times": (lambda: sheet(9, times=IRREGULAR), Choices()),
    "times_at_another_rate": (lambda: sheet(9, times=np.arange(9) / 25, fps=24), Choices()),
    "times_by_period": (lambda: sheet(9, times=np.arange(9) * (1 / 24), fps=24), Choices()),
    "jumps": (jumping, Choices()),
    "jumps_between_groups": (jumping, Choices(longest_group=4)),
    "jumps_at_irregular_times": (lambda: jumping(times=np.cumsum(np.linspace(0.01, 0.3, 16) ** 2)), Choices()),
    "runs_that_jump": (runs_that_jump, Choices()),
    "closed_form": (lambda: clip(tube(12, 4, 12), grid(4, 12, closed=True)), paper()),
    "closed_form_on_pieces": (lambda: clip(tube(9, 3, 20), grid(3, 20)), paper(piece_points=6, segment_frames=4)),
    "closed_form_of_lines": (lambda: clip(wave(8, 3, 7), connectivity(21, lines=LINES)), paper(alpha=2.5, r=3.0)),
    "closed_form_and_residuals": (lambda: rough(6, 3, 6), paper(tolerance=0.01)),
    "closed_form_of_one_frame": (lambda: sheet(1), paper()),
    "closed_form_at_irregular_times": (lambda: sheet(7, times=IRREGULAR[:7]), paper(segment_frames=3)),
    "runs": (runs, Choices()),
    "runs_of_one_frame": (runs_of_one_frame, Choices()),
    "solids_in_runs": (solids_in_runs, Choices()),
    "runs_in_closed_form": (runs, paper(tolerance=0.02)),
    "long_clip": (lambda: clip(wave(120, 2, 2), grid(2, 2)), Choices(longest_group=40)),
}


def of_field(quantised: np.ndarray[Any, np.dtype[np.int64]]) -> Residuals:
    """Convert an array (frames, vertices, 3) to residuals, leaving out rows of zeros; no raw vertices."""
    frames, places = np.nonzero(quantised.any(axis=2))
    starts = np.searchsorted(frames, np.arange(len(quantised) + 1)).astype(np.int64)
    none, raw = np.zeros(0, np.int32), np.zeros((0, 3), np.float32)
    return Residuals(starts, places.astype(np.int32), quantised[frames, places], np.zeros_like(starts), none, raw)


def residuals_by_hand() -> Iterator[tuple[str, Residuals]]:
    """Yield residuals for eight frames of 24 vertices in one patch."""
    random = np.random.default_rng(0)
    turn = random.integers(-40, 40, (3, 24, 3)) * (random.random((3, 24, 1)) < 0.4)
    yield "residuals_in_a_cycle", of_field(turn[np.arange(8) % 3])
    drift = np.cumsum(np.cumsum(random.integers(-3, 4, (8, 24, 3)), axis=0), axis=0) * 20
    yield "residuals_predicted", of_field(drift)
    huge = np.zeros((8, 24, 3), np.int64)
    huge[1, 5], huge[2, 5], huge[2, 23] = (2**40, -(2**40), 1), (-(2**40), 2**40, -1), (0, 0, 7)
    yield "residuals_from_end_to_end", of_field(huge)


def of_another_minor_version(parts: list[Part]) -> Iterator[tuple[str, bytes]]:
    """Yield files of a minor version 1 that does not exist, with everything that it may add (21)."""
    remarks = {"generator": "another", "provenance": {"take": 3, "scans": [None, 1.5]}, "metadata": {"lens": "50 mm"}}
    files = {"cuts": b'{"root":"files/a.step","tessellation":[1]}', "files/a.step": b"ISO-10303-21;", "history/1": b""}
    scene = Carrier.of("step", [("tolerance", 3), ("", 0)], ["../a b.stp"], files)
    added = [
        Part("META", compressed(json.dumps(remarks).encode()), 0b0010),
        Part("SCEN", encode_scene(scene), 0b0100),
        Part("PREV", b"a section of version 1.1", 0b1110),
        Part("a_pp", bytes(range(256)), 0b1000),
    ]
    flagged = [replace(part, flags=part.flags | 0b1110) for part in parts]
    yield "minor_version_1", seal([*added[:2], *flagged, *added[2:]], minor=1)
    of_runs = [part for part in take_apart(encoded(runs_of_one_frame(), Choices())) if part.kind != "META"]
    yield "runs_of_minor_version_1", seal([*added, *of_runs], minor=1)


def accepted() -> Iterator[tuple[str, bytes]]:
    """Yield the name and bytes of every file that decoders must read."""
    lifted = np.repeat(wave(1, 2, 2) * [1, 1, 0], 3, axis=0)
    lifted[:, 3, 2] = 0, 0.5, 1
    small = encoded(clip(lifted, grid(2, 2)), Choices(settings={"tolerance": 0.04}))
    yield "example", seal([part for part in take_apart(small) if part.kind != "META"])
    for name, (make, choices) in SEQUENCES.items():
        yield name, encoded(make(), choices)
    still = take_apart(encoded(clip(np.repeat(wave(1, 4, 6), 8, axis=0), grid(4, 6)), Choices()))
    for name, residuals in residuals_by_hand():
        chunk = encode_residuals(residuals, np.array([0, 24]))
        yield name, seal(with_first_group(still, "CORR", chunk))
    parts = take_apart(encoded(sheet(), Choices(longest_group=4)))
    unknown = [Part("XYZW", b"anything", 0), *parts, Part("\xff\x00ab", b"", 0x0E)]
    flagged = [replace(part, flags=part.flags | 0x08) for part in unknown]
    yield "unknown_ignorable_sections", seal(flagged, minor=7)
    odd = [replace(part, flags=15 if part.kind == "META" else 14, length_bytes=8) for part in parts]
    yield "flags_of_another_minor_version", seal([Part("XYZW", b"", 14), *odd, Part("xyzw", b"?", 14)], minor=65535)
    values = {
        "another member": [1e308, -0.0, 2**1023, None, True, "\ud83d\ude00\0"],
        "": json.loads("[" * 31 + "]" * 31),
    }
    remarks = json.dumps({**values, "generator": "x"}).encode()
    yield (
        "remarks_at_the_limits",
        seal([*(part for part in parts if part.kind != "META"), Part("META", compressed(remarks), 0)]),
    )
    yield "sections_in_another_order", seal(parts[::-1])
    scene = Carrier.of("gltf", [("camera", 2)], ["wood.png"], {"cuts": b"{}", "files/a/b.gltf": b"{}", "files/c": b""})
    yield "scene", seal([*parts, Part("SCEN", encode_scene(scene), 0)])
    known = [*parts, Part("SCEN", encode_scene(scene)), Part("FLDS", b"\0"), Part("FDAT", b"")]
    yield "known_sections_marked_as_required", seal(known, minor=1)
    absent = [Part(kind, b"", 0) for kind in ("META", "ORDR", "SOLD", "ATTR", "FLDS", "SCEN")]
    kept = [part for part in parts if part.kind not in ("META", "ORDR", "ATTR")]
    yield "optional_sections_without_bytes", seal([*kept, *absent])
    bare = [part for part in parts if part.kind != "META"]
    yield "without_remarks", seal(bare)
    largest = int(1.7976931348623157e308) + 2**969  # just below the middle between it and 2^1024
    yield "remarks_at_the_largest_number", seal([*bare, Part("META", compressed(b'{"a":-%d}' % largest), 0)])
    longer = b"\x81" + 7 * b"\x80" + b"\0" + content(parts, "SEQN")[1:]
    yield "count_of_nine_bytes", seal(with_section(bare, "SEQN", longer))
    yield from of_another_minor_version(bare)
    # A file of runs may hold a single run.
    sequence_head, names = content(parts, "SEQN")[:-1], content(parts, "SEQN")[-1:]
    runs = run_of(parts, names, 24)
    odd = [Part("RDAT", runs.data), Part("SEQN", sequence_head), Part("RUNS", runs.row())]
    unread = [Part("FLDS", b"?", 0), Part("FDAT", b"?", 0)]
    yield (
        "fields_of_no_run",
        seal([Part("RDAT", runs.data), Part("SEQN", sequence_head), Part("RUNS", runs.row()), *unread]),
    )
    yield "chunks_of_no_fields", seal([*bare, unread[1]])
    yield "runs_with_sections_without_bytes", seal([*odd, *(Part(kind, b"", 0) for kind in ("META", "SOLD", "SCEN"))])
    yield "file_of_one_run", seal([Part("RDAT", runs.data), Part("SEQN", sequence_head), Part("RUNS", runs.row())])
    # Without bytes, the functions of time are all zero: nothing moves, whatever the coefficients are.
    yield "functions_of_length_zero", seal(with_first_group(parts, "TIME", b""))
