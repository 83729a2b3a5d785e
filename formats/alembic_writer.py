"""Alembic scenes out: one shape an object, in the tree that names say, with velocities where there are any.

The same sequence gives the same bytes: the date that Alembic's own helper notes is left out. What Alembic has no
place for stands in properties that begin with ``pdecodec_``: the frame rate of irregular times, metadata, lines beside
faces, and which vertex each point of a curve is where curves share them.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import imath
import numpy as np
from alembic3d import Abc, AbcCoreAbstract, AbcGeom

from pdecodec.errors import InputError
from pdecodec.formats.alembic import FPS_PROPERTY, METADATA_PROPERTY
from pdecodec.formats.alembic_arrays import int_array, matrix_of, vector_array
from pdecodec.formats.alembic_attribute_writer import AttributeWriter, uv_sample
from pdecodec.formats.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    SUBDIVISION,
    UV,
    label_of,
    reversed_corners,
    source_name,
    uv_sets,
)
from pdecodec.formats.object_tree import Drawn, drawn_as, tree_paths
from pdecodec.formats.sample_times import regular_times
from pdecodec.formats.transforms import apply_matrices, matrices_at, transform_of
from pdecodec.sequence import Attribute, Float32Array, Float64Array, MeshObject, MeshSequence, Progress
from pdecodec.whole_output import whole_file

_BASES = {
    "bezier": AbcGeom.BasisType.kBezierBasis,
    "bspline": AbcGeom.BasisType.kBsplineBasis,
    "catmullrom": AbcGeom.BasisType.kCatmullromBasis,
    "hermite": AbcGeom.BasisType.kHermiteBasis,
    "power": AbcGeom.BasisType.kPowerBasis,
}


def write_alembic(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    velocities: MeshSequence | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as an Ogawa file.

    Parameters
    ----------
    sequence : MeshSequence
    path : pathlib.Path
    overwrite : bool
    fps : float, optional
    velocities : MeshSequence, optional
        [scene units / s]; stored as ``.velocities``.
    progress : callable, optional

    Returns
    -------
    tuple of str
        What Alembic could not hold.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to.
    """
    rate = sequence.fps if fps is None else fps
    with whole_file(path, overwrite=overwrite) as partial:
        try:
            notices = _write(sequence, partial, rate, velocities, progress)
        except RuntimeError as error:
            raise InputError(f"Alembic cannot write this ({error}); check the folder and the free space") from error
    return notices


def _write(
    sequence: MeshSequence, path: Path, rate: float, velocities: MeshSequence | None, progress: Progress | None
) -> tuple[str, ...]:
    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(_time_sampling(sequence.times, rate))
    top = archive.getTop()
    Abc.ODoubleProperty(top.getProperties(), FPS_PROPERTY).setValue(rate)
    if sequence.metadata:
        text = json.dumps(dict(sequence.metadata), sort_keys=True)
        Abc.OStringProperty(top.getProperties(), METADATA_PROPERTY).setValue(text)
    tree = tree_paths(sequence.objects)
    branches = _Branches(sequence, tree.paths, top, sampling)
    first = 0
    shapes: list[_ShapeWriter] = []
    for item, steps in zip(sequence.objects, tree.paths, strict=True):
        place = slice(first, first + item.vertex_count)
        shapes.append(_ShapeWriter(item, place, branches.parent(steps), steps[-1], sampling, branches.baked(steps)))
        first = place.stop
    for start, block in sequence.blocks():
        speeds = None if velocities is None else velocities.read_frames(start, start + len(block))
        branches.write(sequence.times[start : start + len(block)])
        for shape in shapes:
            shape.write(block, speeds, sequence.times[start : start + len(block)])
        if progress is not None:
            progress(start + len(block), sequence.frame_count, "writing Alembic")
    notices = dict.fromkeys(notice for shape in shapes for notice in shape.notices)
    return (*tree.notices, *branches.notices, *notices)


def _time_sampling(times: Float64Array, rate: float) -> Any:
    if times.size == 1:
        return AbcCoreAbstract.TimeSampling(1.0 / rate, float(times[0]))
    rule = regular_times(times, rate)
    if rule is not None:
        return AbcCoreAbstract.TimeSampling(1.0 / rule.rate, rule.start)
    stored = AbcCoreAbstract.TimeVector()
    stored.extend(times.tolist())
    kind = AbcCoreAbstract.TimeSamplingType(AbcCoreAbstract.AcyclicFlag.kAcyclic)
    return AbcCoreAbstract.TimeSampling(kind, stored)


class _Branches:
    """Transforms above shapes: one for each step of a path but the last.

    A kept transform goes to the step right above its shape, and does not inherit from those above that. Shapes under
    one step that were moved apart, and shapes at the top, have theirs applied to their points instead.
    """

    def __init__(self, sequence: MeshSequence, paths: tuple[tuple[str, ...], ...], top: Any, sampling: int) -> None:
        self._nodes: dict[tuple[str, ...], Any] = {(): top}
        self._moved: dict[tuple[str, ...], Attribute | None] = {}
        self._unlike: set[tuple[str, ...]] = set()
        self._baked: dict[tuple[str, ...], Attribute] = {}
        self.notices: tuple[str, ...] = ()
        transforms = [transform_of(item) for item in sequence.objects]
        for steps, transform in zip(paths, transforms, strict=True):
            above = steps[:-1]
            if above in self._moved and not _same(self._moved[above], transform):
                self._unlike.add(above)
            self._moved.setdefault(above, transform)
        apart = []
        for item, steps, transform in zip(sequence.objects, paths, transforms, strict=True):
            if transform is not None and (not steps[:-1] or steps[:-1] in self._unlike):
                self._baked[steps] = transform
                apart.append(item.name)
        if apart:
            self.notices = (f"transforms applied to positions, as there is no place for them: {', '.join(apart)}",)
        self._absolute = any(transform is not None for transform in transforms)
        self._sampling = sampling

    def parent(self, steps: tuple[str, ...]) -> Any:
        """The step above a shape, made where it is not there yet: readers list a step's children in this order."""
        for length in range(1, len(steps)):
            branch = steps[:length]
            if branch not in self._nodes:
                self._nodes[branch] = AbcGeom.OXform(self._nodes[branch[:-1]], branch[-1], self._sampling)
                still = branch in self._moved and (self._moved[branch] is None or branch in self._unlike)
                if self._absolute and still:
                    self._set(branch, np.eye(4))
        return self._nodes[steps[:-1]]

    def baked(self, steps: tuple[str, ...]) -> Attribute | None:
        return self._baked.get(steps)

    def write(self, times: Float64Array) -> None:
        for branch, transform in self._moved.items():
            if transform is not None and branch and branch not in self._unlike:
                for matrix in matrices_at(transform, times):
                    self._set(branch, matrix)

    def _set(self, branch: tuple[str, ...], matrix: Float64Array) -> None:
        sample = AbcGeom.XformSample()
        sample.setMatrix(matrix_of(matrix))
        sample.setInheritsXforms(False)
        self._nodes[branch].getSchema().set(sample)


def _same(a: Attribute | None, b: Attribute | None) -> bool:
    return (a is None) == (b is None) and (a is None or b is None or np.array_equal(a.values, b.values))


class _ShapeWriter:
    """One object: its shape, and samples as frames come."""

    def __init__(
        self, item: MeshObject, place: slice, parent: Any, name: str, sampling: int, baked: Attribute | None
    ) -> None:
        self._item, self._place, self._baked = item, place, baked
        self._drawn: Drawn = drawn_as(item.connectivity)
        self._scheme = label_of(item, SUBDIVISION) if self._drawn.kind == "mesh" else None
        kinds = {"curves": AbcGeom.OCurves, "points": AbcGeom.OPoints}
        kind = AbcGeom.OSubD if self._scheme else kinds.get(self._drawn.kind, AbcGeom.OPolyMesh)
        self._handle = kind(parent, name, sampling)
        self._schema = self._handle.getSchema()
        self._ids = None
        self._started = False
        self._previous: Float32Array | None = None
        self.notices: list[str] = []
        if self._drawn.hidden_lines:
            self.notices.append(f"lines of object {item.name!r} show in pdecodec alone: Alembic's curves are apart")

    def write(self, block: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        """Samples of a block of frames."""
        points = block[:, self._place]
        moving = None if speeds is None else speeds[:, self._place]
        if self._baked is not None:
            matrices = matrices_at(self._baked, times)
            points = apply_matrices(points, matrices)
        if self._drawn.gather is not None:
            points = points[:, self._drawn.gather]
            moving = None if moving is None else moving[:, self._drawn.gather]
        for frame in range(len(points)):
            self._sample(points[frame], None if moving is None else moving[frame])

    def _sample(self, points: Float32Array, speeds: Float32Array | None) -> None:
        if self._started and speeds is None and self._previous is not None and np.array_equal(points, self._previous):
            self._schema.setFromPrevious()
            return
        sample = self._next() if self._started else self._first()
        sample.setPositions(vector_array(points))
        if speeds is not None:
            sample.setVelocities(vector_array(speeds))
        if self._drawn.kind == "points":
            sample.setIds(self._ids)
        self._schema.set(sample)
        if not self._started:
            self._started = True
            writer = AttributeWriter(self._item, self._drawn, self._handle)
            writer.write()
            self.notices += writer.notices
        self._previous = points.copy()

    def _next(self) -> Any:
        """A sample of positions alone: the rest is that of the first."""
        if self._scheme:
            return AbcGeom.OSubDSchemaSample()
        kinds = {"curves": AbcGeom.OCurvesSchemaSample, "points": AbcGeom.OPointsSchemaSample}
        return kinds.get(self._drawn.kind, AbcGeom.OPolyMeshSchemaSample)()

    def _first(self) -> Any:
        connectivity = self._item.connectivity
        sample = self._next()
        if self._drawn.kind == "mesh":
            order = reversed_corners(connectivity.face_counts)
            sample.setFaceCounts(int_array(connectivity.face_counts))
            sample.setFaceIndices(int_array(connectivity.face_indices[order]))
            sets = uv_sets(self._item)
            if sets:
                if sets[0].name != UV:
                    self._schema.setUVSourceName(source_name(sets[0], UV, UV))
                sample.setUVs(uv_sample(sets[0], connectivity, order))
            if self._scheme:
                sample.setSubdivisionScheme(self._scheme)
        elif self._drawn.kind == "curves":
            self._describe_curves(sample)
        else:
            self._ids = imath.IntArray(0)
        return sample

    def _describe_curves(self, sample: Any) -> None:
        sample.setCurvesNumVertices(int_array(self._item.connectivity.line_counts))
        basis = label_of(self._item, CURVE_BASIS) or "linear"
        cubic = basis.removeprefix("cubic ")
        if basis.startswith("cubic ") and cubic in _BASES:
            sample.setType(AbcGeom.CurveType.kCubic)
            sample.setBasis(_BASES[cubic])
        else:
            sample.setType(AbcGeom.CurveType.kLinear)
            sample.setBasis(AbcGeom.BasisType.kNoBasis)
            if basis != "linear":
                self.notices.append(f"curves of object {self._item.name!r} are written as lines, not as {basis}")
        periodic = label_of(self._item, CURVE_WRAP) == "periodic"
        wrap = AbcGeom.CurvePeriodicity
        sample.setWrap(wrap.kPeriodic if periodic else wrap.kNonPeriodic)
