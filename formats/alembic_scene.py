"""The tree of an Alembic archive: which geometry it holds, under which transforms, and when each is sampled.

The binding takes a sample selector's integer for a time, silently: samples are always asked for by their time here.
"""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
from alembic3d import Abc, AbcGeom

from pdecodec.formats.alembic_arrays import matrix_rows
from pdecodec.formats.sample_times import SAME_TIME
from pdecodec.formats.unsupported import Refusals
from pdecodec.sequence import Float64Array

MOST_LEVELS = 256
"""Depth of the tree; deeper ones are instances that hold themselves."""

_GEOMETRY = {
    "mesh": AbcGeom.IPolyMesh,
    "subdivision": AbcGeom.ISubD,
    "curves": AbcGeom.ICurves,
    "points": AbcGeom.IPoints,
}

_NAMES_OF_OTHERS = {"Camera": "camera", "Light": "light", "Material": "material", "GeomBase": "shape"}
"""What schemas that hold no geometry of ours are called in messages."""


def select(time: float) -> Any:
    """A selector of the sample at a time."""
    return Abc.ISampleSelector(float(time))


def sample_times(prop: Any) -> Float64Array:
    """Times [s] of the samples of a property or schema, at least one."""
    sampling = prop.getTimeSampling()
    return np.array([sampling.getSampleTime(index) for index in range(max(1, prop.getNumSamples()))], np.float64)


@dataclass(frozen=True)
class Samples:
    """Which samples make a value at a time: one, or two and the share of the second."""

    first: int
    second: int
    share: float


def samples_at(times: Float64Array, time: float) -> Samples:
    """The samples at or around a time; before the first and after the last, that one."""
    index = int(np.searchsorted(times, time + SAME_TIME, side="right")) - 1
    if index < 0 or index == times.size - 1 or time - times[index] <= SAME_TIME:
        index = max(index, 0)
        return Samples(index, index, 0.0)
    return Samples(index, index + 1, float((time - times[index]) / (times[index + 1] - times[index])))


class Transform:
    """A transform of the tree and its samples."""

    def __init__(self, handle: Any) -> None:
        self._schema = handle.getSchema()
        # Identity transforms may have no sample at all.
        self.samples = self._schema.getNumSamples()
        self.sampling = self._schema.getTimeSampling()
        self.times = sample_times(self._schema) if self.samples else np.zeros(1)
        self.moves = self.samples > 1 and not self._schema.isConstant()
        self.inherits = not self.samples or self._schema.getInheritsXforms(select(self.times[0]))

    @cached_property
    def matrices(self) -> Float64Array:
        """(samples, 4, 4) float64, for points that are rows."""
        if not self.samples:
            return np.eye(4)[None]
        times = self.times if self.moves else self.times[:1]
        return np.stack([matrix_rows(self._schema.getValue(select(time)).getMatrix()) for time in times])

    def at(self, times: Float64Array) -> Float64Array:
        """(times, 4, 4) float64: the matrices at times [s]."""
        if not self.moves:
            return np.broadcast_to(self.matrices[0], (times.size, 4, 4))
        around = [samples_at(self.times, float(time)) for time in times]
        share = np.array([where.share for where in around])[:, None, None]
        first = self.matrices[[where.first for where in around]]
        second = self.matrices[[where.second for where in around]]
        matrices: Float64Array = np.where(share == 0, first, (1 - share) * first + share * second)
        return matrices


@dataclass(frozen=True)
class Geometry:
    """A shape of the tree.

    Attributes
    ----------
    path : str
        Names from the top, without the leading slash.
    kind : {"mesh", "subdivision", "curves", "points"}
    schema, node : object
        Of the binding: what the shape is, and its place in the tree.
    chain : tuple of Transform
        From the one above the shape up to the top.
    """

    path: str
    kind: str
    schema: Any
    node: Any
    chain: tuple[Transform, ...]

    @property
    def is_placed(self) -> bool:
        """Whether a transform above the shape does anything."""
        return any(one.moves or not np.array_equal(one.matrices[0], np.eye(4)) for one in self.chain)

    def matrices_at(self, times: Float64Array) -> Float64Array:
        """(times, 4, 4) float64: from the shape's space to the scene's."""
        matrices = np.broadcast_to(np.eye(4), (times.size, 4, 4))
        for transform in self.chain:
            matrices = matrices @ transform.at(times)
        return matrices


@dataclass
class Scene:
    """What an archive holds: shapes in the order of the tree, and what else there is by kind."""

    shapes: list[Geometry] = field(default_factory=list)
    others: Counter[str] = field(default_factory=Counter)


def read_scene(archive: Any, refusals: Refusals) -> Scene:
    """Walk the tree.

    Raises
    ------
    InputError
        By `refusals`, for shapes and instances that cannot be read.
    """
    scene = Scene()
    _walk(archive.getTop(), "", (), scene, refusals, 0)
    return scene


def _walk(node: Any, path: str, chain: tuple[Transform, ...], scene: Scene, refusals: Refusals, level: int) -> None:
    if level > MOST_LEVELS:
        refusals.refuse(path, f"more than {MOST_LEVELS} levels of objects above it")
        return
    for index in range(node.getNumChildren()):
        name = node.getChildHeader(index).getName()
        inner = f"{path}/{name}" if path else name
        try:
            child = node.getChild(index)
            header = child.getHeader()
            _visit(child, header, inner, chain, scene, refusals, level)
        except RuntimeError as error:
            refusals.refuse(inner, f"an instance or a shape that Alembic cannot open ({_first_line(error)})")


def _visit(
    child: Any, header: Any, path: str, chain: tuple[Transform, ...], scene: Scene, refusals: Refusals, level: int
) -> None:
    wrap = Abc.WrapExistingFlag.kWrapExisting
    if AbcGeom.IXform.matches(header):
        transform = Transform(AbcGeom.IXform(child, wrap))
        above = chain if transform.inherits else ()
        _walk(child, path, (transform, *above), scene, refusals, level + 1)
        return
    for kind, shape in _GEOMETRY.items():
        if shape.matches(header):
            scene.shapes.append(Geometry(path, kind, shape(child, wrap).getSchema(), child, chain))
            break
    else:
        if AbcGeom.INuPatch.matches(header):
            refusals.refuse(path, "a NURBS surface; convert it to polygons")
        elif not AbcGeom.IFaceSet.matches(header):
            schema = header.getMetaData().get("schema").removeprefix("AbcGeom_").partition("_")[0]
            scene.others[_NAMES_OF_OTHERS.get(schema, "other object")] += 1
    _walk(child, path, chain, scene, refusals, level + 1)


def _first_line(error: Exception) -> str:
    return (str(error).strip().splitlines() or [type(error).__name__])[0]
