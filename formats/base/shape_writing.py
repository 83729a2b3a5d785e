"""Shapes that writers of scenes write: what an object is drawn as, and its samples, run of frames by run.

A file has one shape for an object in all runs of frames. In runs that do not have the object the shape is empty.
"""

from __future__ import annotations

import dataclasses
from abc import ABC, abstractmethod
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

import numpy as np

from pdecodec.formats.base.attribute_roles import CURVE_BASIS, CURVE_WRAP, ID, SUBDIVISION, label_of
from pdecodec.formats.base.normals import NORMAL_GROUP, normal_rows
from pdecodec.formats.base.registry import Output
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence

Kind = Literal["mesh", "curves", "points"]


@dataclass(frozen=True)
class Drawn:
    """What an object is in formats where meshes, curves and points are things apart.

    Attributes
    ----------
    kind : {"mesh", "curves", "points"}
        Faces; lines alone, every vertex in one; else points.
    gather : (line points,) int32 or None
        Vertex of each point of its curves, where that is not all of them in order.
    hidden_lines : bool
        Whether it has lines that do not show: beside faces, or beside vertices that no line has.
    """

    kind: Kind
    gather: Int32Array | None = None
    hidden_lines: bool = False


def drawn_as(connectivity: Connectivity) -> Drawn:
    """What an object of this connectivity is drawn as."""
    if connectivity.face_count:
        return Drawn("mesh", hidden_lines=connectivity.line_count > 0)
    if not connectivity.line_count:
        return Drawn("points")
    indices = connectivity.line_indices
    if connectivity.line_counts.min() < 2 or np.unique(indices).size < connectivity.vertex_count:
        return Drawn("points", hidden_lines=True)
    in_order = np.array_equal(indices, np.arange(connectivity.vertex_count))
    return Drawn("curves", gather=None if in_order else indices)


@dataclass(frozen=True)
class ShapeKey:
    """What objects of several runs of frames have alike that are one shape.

    Attributes
    ----------
    name : str
    number : int
        From 0, of objects of one run that have the rest alike.
    kind : {"mesh", "curves", "points"}
    subdivision, curve_basis, curve_wrap : str or None
        Labels that formats have once for a shape.
    """

    name: str
    number: int
    kind: Kind
    subdivision: str | None
    curve_basis: str | None
    curve_wrap: str | None


def _keys_of(objects: Sequence[MeshObject]) -> list[ShapeKey]:
    counts: Counter[ShapeKey] = Counter()
    keys = []
    for item in objects:
        subdivision, basis, wrap = (label_of(item, name) for name in (SUBDIVISION, CURVE_BASIS, CURVE_WRAP))
        first = ShapeKey(item.name, 0, drawn_as(item.connectivity).kind, subdivision, basis, wrap)
        keys.append(dataclasses.replace(first, number=counts[first]))
        counts[first] += 1
    return keys


def shape_keys(sequence: MeshSequence) -> list[ShapeKey]:
    """The shapes of a file of the sequence, in the order of its objects.

    Of several runs each is looked at; objects without vertices are no shapes there.
    """
    if len(sequence.runs) == 1:
        return _keys_of(sequence.objects)
    return [*dict.fromkeys(key for run in sequence.runs for key in _keys_of(_there(run)))]


def _there(run: MeshSequence) -> list[MeshObject]:
    return [item for item in run.objects if item.vertex_count]


class ShapeWriter(ABC):
    """Writes one shape.

    Parameters
    ----------
    key : ShapeKey
    title : str
        Of the format.
    changes : bool
        Whether there are several runs of frames.

    Attributes
    ----------
    item : MeshObject
        The object of this run; one without vertices where the run has none.
    drawn : Drawn
    normals : NormalRows or None
    in_samples : list of str
        Names of attributes that samples hold.
    notices : list of str
    """

    def __init__(self, key: ShapeKey, title: str, *, changes: bool) -> None:
        self.key, self.title, self.changes = key, title, changes
        self.notices: list[str] = []

    def begin(self, item: MeshObject, times: Float64Array) -> None:
        """Go on to a run of frames at times [s], in which the object is this one."""
        self.item = item
        self.drawn = drawn_as(item.connectivity) if item.vertex_count else Drawn(self.key.kind)
        # A subdivision surface has no normals but its own.
        self.normals = None if self.key.subdivision else normal_rows(item)
        self.in_samples = [] if self.normals is None else [NORMAL_GROUP]
        if self.drawn.hidden_lines:
            self.notices.append(
                f"lines of object {item.name!r} show in pdecodec alone: {self.title}'s curves are apart"
            )

    def numbered_points(self, most: int) -> Int64Array | None:
        """Where there are several runs, (vertices,) ids of points, which tell those of one run from those of the next.

        They are those of the object, unless they are larger than the format can hold; else they count up from 0. None
        where this is no set of points, or there is one run.
        """
        if not self.changes or self.key.kind != "points":
            return None
        ids = next((one for one in self.item.attributes if one.name == ID and one.domain == "vertex"), None)
        if ids is None or ids.indices is not None or ids.values.ndim != 1 or ids.values.dtype.kind not in "iu":
            return np.arange(self.item.vertex_count)
        if ids.values.size and not -most <= ids.values.min() <= ids.values.max() <= most:
            return np.arange(self.item.vertex_count)
        self.in_samples.append(ID)
        return ids.values.astype(np.int64)

    def normals_at(self, points: Float32Array) -> Iterator[Float32Array | None]:
        """Rows of normals (rows, 3) at each of some positions (frames, vertices, 3); None where there are none."""
        return iter([None] * len(points)) if self.normals is None else self.normals.of_each(points)

    @abstractmethod
    def write(self, points: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        """Write samples of positions, and of velocities, at times [s], for the points that the object is drawn with."""


def write_shapes(
    sequence: MeshSequence,
    output: Output,
    title: str,
    shapes: Mapping[ShapeKey, ShapeWriter],
    before: Callable[[int], None] = lambda frames: None,
) -> Iterator[Float64Array]:
    """Write samples of all shapes block by block; the times [s] of each block, when it is written.

    `before` is called with the number of frames of a block that is about to be written.
    """
    places: dict[ShapeKey, Any] = {}
    for run, begin, start, block in output.blocks_of_runs(sequence, title):
        if start == begin:
            of_run = sequence.times[begin : begin + run.frame_count]
            places = _begin_run(shapes, run, of_run, every=len(sequence.runs) == 1)
        before(len(block))
        times = sequence.times[start : start + len(block)]
        moving = None if output.velocities is None else output.velocities.read_frames(start, start + len(block))
        for key, shape in shapes.items():
            own = places.get(key, slice(0))
            shape.write(block[:, own], None if moving is None else moving[:, own], times)
        yield times


def _begin_run(
    shapes: Mapping[ShapeKey, ShapeWriter], run: MeshSequence, times: Float64Array, *, every: bool
) -> dict[ShapeKey, Any]:
    """Let shapes go on to a run; which of its vertices each of them is drawn with."""
    objects = run.objects if every else _there(run)
    firsts = np.cumsum([item.vertex_count for item in objects]).tolist()
    found = dict(zip(_keys_of(objects), zip(objects, firsts, strict=True), strict=True))
    places: dict[ShapeKey, Any] = {}
    for key, shape in shapes.items():
        item, end = found.get(key, (MeshObject(key.name, Connectivity(0)), 0))
        shape.begin(item, times)
        first = end - item.vertex_count
        places[key] = slice(first, end) if shape.drawn.gather is None else first + shape.drawn.gather
    return places
