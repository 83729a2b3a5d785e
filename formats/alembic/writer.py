"""Write Alembic scenes: one shape per object, in the tree that object names describe, with velocities on request.

The same sequence gives the same bytes: the date that Alembic's own helper adds is left out. Data that Alembic has no
place for go into properties whose names begin with ``pdecodec_``: the frame rate of irregular times, metadata, lines
of meshes with faces, and, if curves share vertices, the vertex of each point of a curve.
"""

from __future__ import annotations

import dataclasses
import json
from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import imath
import numpy as np
from alembic3d import Abc, AbcCoreAbstract, AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.attributes import ADDED_KEY, FPS_PROPERTY, METADATA_PROPERTY
from pdecodec.formats.alembic.attributes_writer import ExtrasWriter, uv_sample
from pdecodec.formats.alembic.fields_writer import FieldsWriter, is_uv_set
from pdecodec.formats.alembic.values import (
    SCOPES,
    Keep,
    int_array,
    matrix_of,
    normal_sample,
    unsigned_array,
    vector_array,
)
from pdecodec.formats.base.attribute_roles import UV, direction_role, is_velocity, reversed_corners, uv_sets
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.rigid_motion import rigid_parts
from pdecodec.formats.base.scene_space import place, up_axis_of
from pdecodec.formats.base.scene_writing import ShapeKey, ShapeWriter, shape_keys, tree_paths, write_shapes
from pdecodec.formats.base.times import regular_rate
from pdecodec.formats.base.transforms import matrices_at, transform_of
from pdecodec.mesh.arrays import BoolArray, Float32Array, Float64Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MAX_INDEX, Attribute, MeshObject, MeshSequence
from pdecodec.system.whole_output import ReservedRoom, write_failure

OBJECT_BYTES, SAMPLE_BYTES = 2**16, 2**10
"""Upper bounds of what Alembic writes for an object and for a sample, in addition to their arrays [bytes]."""

_SHAPES = {
    "mesh": (AbcGeom.OPolyMesh, AbcGeom.OPolyMeshSchemaSample),
    "subdivision": (AbcGeom.OSubD, AbcGeom.OSubDSchemaSample),
    "curves": (AbcGeom.OCurves, AbcGeom.OCurvesSchemaSample),
    "points": (AbcGeom.OPoints, AbcGeom.OPointsSchemaSample),
}

_BASES = {
    "bezier": AbcGeom.BasisType.kBezierBasis,
    "bspline": AbcGeom.BasisType.kBsplineBasis,
    "catmullrom": AbcGeom.BasisType.kCatmullromBasis,
    "hermite": AbcGeom.BasisType.kHermiteBasis,
    "power": AbcGeom.BasisType.kPowerBasis,
}


def write_alembic(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write an Ogawa file; velocities are stored as ``.velocities``, other fields as parameters that change.

    Alembic does not record the up axis and programs assume Y, so a scene with another known up axis is turned.
    """
    turned: tuple[str, ...] = ()
    if up_axis_of(sequence) not in (None, "Y"):
        turned = (f"the scene is turned from {up_axis_of(sequence)}-up to Y-up, which programs assume for Alembic",)
        sequence = place(sequence, up_axis="Y")
        if output.velocities is not None:
            output = dataclasses.replace(output, velocities=place(output.velocities, up_axis="Y"))
    if output.velocities is None and len(sequence.runs) == 1 and not any(map(direction_role, sequence.fields)):
        sequence, moved = rigid_parts(sequence, output.rigid)
        turned += moved
    with archive_file(output) as partial:
        return (*turned, *_write(sequence, partial, output))


@contextmanager
def archive_file(output: Output) -> Iterator[Path]:
    """Give a path for an archive; when the block ends well, release its reserved room and make it the output file."""
    with output.whole_file() as partial:
        try:
            # An archive is closed in any case, and Alembic ends the process if there is no room for that.
            partial.touch()
            ReservedRoom(partial).reserve(0)
            yield partial
            ReservedRoom(partial).release()
        except RuntimeError as error:
            raise write_failure(output.path, partial, f"Alembic says {error}") from error


def _write(sequence: MeshSequence, path: Path, output: Output) -> tuple[str, ...]:
    archive = Abc.OArchive(str(path))
    room = ReservedRoom(path)
    # Alembic ends the process if there is no room for its last bytes, so room is reserved before anything is written.
    keys = shape_keys(sequence)
    room.reserve(OBJECT_BYTES * len(keys) + sequence.frame_count * 64 * len(keys))
    sampling = archive.addTimeSampling(time_sampling(sequence.times, output.rate))
    top = archive.getTop()
    Abc.ODoubleProperty(top.getProperties(), FPS_PROPERTY).setValue(output.rate)
    if sequence.metadata:
        text = json.dumps(dict(sequence.metadata), sort_keys=True)
        Abc.OStringProperty(top.getProperties(), METADATA_PROPERTY).setValue(text)
    paths, renamed = tree_paths([key.name for key in keys])
    branches = _Branches(sequence, paths, top, sampling)
    changes = len(sequence.runs) > 1
    shapes = {
        key: _ShapeWriter(key, branches.parent(steps), steps[-1], sampling, changes=changes)
        for key, steps in zip(keys, paths, strict=True)
    }

    def make_room(frames: int) -> None:
        speeds = output.velocities is not None
        room.reserve(sum(shape.block_bytes(frames, speeds=speeds) for shape in shapes.values()))

    for times in write_shapes(sequence, output, "Alembic", shapes, make_room):
        branches.write(times)
    notices = dict.fromkeys(notice for shape in shapes.values() for notice in shape.notices)
    return (*renamed, *notices)


def _described_bytes(item: MeshObject) -> int:
    """Return an upper bound of what is written for an object in a run of frames besides its samples [bytes]."""
    arrays = [item.connectivity.face_counts, item.connectivity.face_indices, item.connectivity.line_indices]
    arrays += [one for each in item.attributes for one in (each.values, each.indices) if one is not None]
    labels = sum(len(label) for each in item.attributes for label in each.labels)
    return OBJECT_BYTES + 2 * (sum(array.nbytes for array in arrays) + labels)


def time_sampling(times: Float64Array, rate: float) -> Any:
    """Return Alembic's time sampling for times [s]: regular, or a list of times."""
    found = rate if times.size == 1 else regular_rate(times, rate)
    if found is not None:
        return AbcCoreAbstract.TimeSampling(1.0 / found, float(times[0]))
    stored = AbcCoreAbstract.TimeVector()
    stored.extend(times.tolist())
    kind = AbcCoreAbstract.TimeSamplingType(AbcCoreAbstract.AcyclicFlag.kAcyclic)
    return AbcCoreAbstract.TimeSampling(kind, stored)


class _Branches:
    """Transforms above shapes: one for each step of a path but the last, and one right above each shape.

    Programs name an object by the transform right above its shape. If a step holds one shape and nothing else, it is
    this transform. Else one is added, which our reader leaves out of names. A kept transform goes there, or to the
    step above if all shapes of the step share it; it does not inherit from others that move.
    """

    def __init__(self, sequence: MeshSequence, paths: Sequence[tuple[str, ...]], top: Any, sampling: int) -> None:
        self._nodes: dict[tuple[str, ...], Any] = {(): top}
        self._sampling = sampling
        below = Counter(steps[:length] for steps in paths for length in range(1, len(steps)))
        self._above = {steps: steps[:-1] if below[steps[:-1]] == 1 else steps for steps in paths}
        """The transform right above each shape."""
        # If there are several runs of frames, their transforms are applied to positions.
        objects = sequence.objects if len(sequence.runs) == 1 else ()
        transforms = [transform_of(item) for item in objects] or [None] * len(paths)
        siblings: dict[tuple[str, ...], list[Attribute | None]] = {}
        for steps, transform in zip(paths, transforms, strict=True):
            siblings.setdefault(steps[:-1], []).append(transform)
        self._moved: dict[tuple[str, ...], Attribute] = {}
        for steps, transform in zip(paths, transforms, strict=True):
            shared = steps[:-1] and all(_same(transform, one) for one in siblings[steps[:-1]])
            if transform is not None:
                self._moved[steps[:-1] if shared else self._above[steps]] = transform

    def parent(self, steps: tuple[str, ...]) -> Any:
        """Return the transform above a shape, created if needed: readers list a step's children in the order of
        creation.
        """
        above = self._above[steps]
        for length in range(1, len(above) + 1):
            branch = above[:length]
            if branch not in self._nodes:
                mark = AbcCoreAbstract.MetaData()
                if branch == steps:
                    mark.set(ADDED_KEY, "1")
                self._nodes[branch] = AbcGeom.OXform(self._nodes[branch[:-1]], branch[-1], self._sampling, mark)
        moving = above in self._moved or (above == steps and steps[:-1] in self._moved)
        if not moving and not self._inherits(above):
            self._set(above, np.eye(4))
        return self._nodes[above]

    def write(self, times: Float64Array) -> None:
        for branch, transform in self._moved.items():
            for matrix in matrices_at(transform, times):
                self._set(branch, matrix)

    def _inherits(self, branch: tuple[str, ...]) -> bool:
        return not any(branch[:length] in self._moved for length in range(1, len(branch)))

    def _set(self, branch: tuple[str, ...], matrix: Float64Array) -> None:
        sample = AbcGeom.XformSample()
        sample.setMatrix(matrix_of(matrix))
        sample.setInheritsXforms(self._inherits(branch))
        self._nodes[branch].getSchema().set(sample)


def _same(a: Attribute | None, b: Attribute | None) -> bool:
    return (a is None) == (b is None) and (a is None or b is None or np.array_equal(a.values, b.values))


class _ShapeWriter(ShapeWriter):
    """One shape, whose samples are written as frames arrive."""

    def __init__(self, key: ShapeKey, parent: Any, name: str, sampling: int, *, changes: bool) -> None:
        super().__init__(key, "Alembic", changes=changes)
        shape, self._new_sample = _SHAPES["subdivision" if key.kind == "mesh" and key.subdivision else key.kind]
        self._handle = shape(parent, name, sampling)
        self._schema = self._handle.getSchema()
        taken: set[str] = set()
        self._extras = ExtrasWriter(self._handle, sampling if changes else None, taken)
        self._fields = FieldsWriter(self._handle, sampling, taken)
        self._previous: Float32Array | None = None
        """Positions of the previous frame, if it is of the same run."""
        self._has_uvs = self._has_normals = self._has_speeds = False

    def begin(self, item: MeshObject, times: Float64Array) -> None:
        super().begin(item, times)
        self._previous = None
        self._ids = imath.IntArray(0)
        numbers = self.numbered_points(MAX_INDEX)
        if numbers is not None:
            self._ids = int_array(numbers)
        self._corner_rows: Any = None
        # All runs must agree on whether normals are per vertex or per corner.
        if self.normals is not None and (self.changes or not self.normals.is_smooth):
            order = reversed_corners(item.connectivity.face_counts)
            self._corner_rows = unsigned_array(self.normals.corner_rows[order])
        self.in_samples += [uv.name for uv in uv_sets(item)[:1]]

    def block_bytes(self, frames: int, *, speeds: bool) -> int:
        """Return an upper bound of the size of the next `frames` samples [bytes]."""
        normals = 0 if self.normals is None else self.normals.count + len(self.normals.corner_rows)
        points = self.item.vertex_count if self.drawn.gather is None else len(self.drawn.gather)
        described = _described_bytes(self.item) if self._previous is None else 0
        # Small integers are written as Int32, and corners may have indices.
        fields = sum(SAMPLE_BYTES + 4 * int(values[0].nbytes) for _, values in self.fields)
        return described + frames * (SAMPLE_BYTES + 12 * (points * (2 if speeds else 1) + normals) + fields)

    def write(self, points: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        rest, uvs = [], None
        for field, values in self.fields:
            if is_velocity(field):
                speeds = values.astype(np.float32) if speeds is None else speeds
            elif uvs is None and self._takes_uvs(field):
                uvs = field, values
            else:
                rest.append((field, values))
        if speeds is None and self._has_speeds:
            speeds = np.zeros((len(points), 0, 3), np.float32)
        in_samples = speeds is not None or uvs is not None
        repeats = np.zeros(len(points), bool) if in_samples else self._find_repeats(points)
        normals = self.normals_at(points[~repeats])
        for frame in range(len(points)):
            if repeats[frame]:
                self._schema.setFromPrevious()
                self._extras.repeat()
            else:
                own = None if uvs is None else (uvs[0], uvs[1][frame])
                self._sample(points[frame], None if speeds is None else speeds[frame], next(normals), own)
        self._previous = points[-1].copy()
        self.notices += self._fields.write(rest, len(points), self.item.connectivity)

    def _takes_uvs(self, field: Field) -> bool:
        """Return whether the shape's own UVs hold a field: they are those of the first UV set that is constant, else of
        the first field that is one.
        """
        return self.key.kind == "mesh" and not uv_sets(self.item) and is_uv_set(field, changes=self.changes)

    def _find_repeats(self, points: Float32Array) -> BoolArray:
        """Return (frames,) bool, whether positions (frames, vertices, 3) equal those of the previous frame of
        the same run.
        """
        previous = self._previous
        found = np.zeros(len(points), bool)
        found[0] = previous is not None and np.array_equal(points[0], previous)
        # Most frames already differ in their first vertices.
        for frame in np.flatnonzero((points[1:, :4] == points[:-1, :4]).all(axis=(1, 2))) + 1:
            found[frame] = np.array_equal(points[frame], points[frame - 1])
        return found

    def _sample(
        self,
        points: Float32Array,
        speeds: Float32Array | None,
        normals: Float32Array | None,
        uvs: tuple[Field, NDArray[Any]] | None,
    ) -> None:
        first = self._previous is None
        self._previous = points
        # After the first sample of a run, samples hold only positions, and the rest stays.
        sample, keep = self._new_sample(), Keep()
        if first:
            self._describe(sample, keep)
        sample.setPositions(keep(vector_array(points)))
        if uvs is not None:
            self._name_uvs(uvs[0].name)
            sample.setUVs(self._fields.uv_sample(*uvs, self.item.connectivity, keep))
        if speeds is not None:
            sample.setVelocities(keep(vector_array(speeds)))
            self._has_speeds = True
        if normals is not None:
            sample.setNormals(normal_sample(normals, self._corner_rows, keep))
        elif first and self._has_normals:
            sample.setNormals(normal_sample(np.zeros((0, 3), np.float32), unsigned_array([]), keep))
        self._has_normals |= normals is not None
        if self.key.kind == "points":
            sample.setIds(self._ids)
        self._schema.set(sample)
        if first:
            self.notices += self._extras.write(self.item, self.drawn, self.in_samples)
        else:
            self._extras.repeat()

    def _describe(self, sample: Any, keep: Keep) -> None:
        """Add faces or curves and the main UV set to a sample."""
        connectivity = self.item.connectivity
        if self.key.kind == "mesh":
            order = reversed_corners(connectivity.face_counts)
            sample.setFaceCounts(keep(int_array(connectivity.face_counts)))
            sample.setFaceIndices(keep(int_array(connectivity.face_indices[order])))
            self._describe_uvs(sample, order, keep)
            if self.key.subdivision:
                sample.setSubdivisionScheme(self.key.subdivision)
        elif self.key.kind == "curves":
            self._describe_curves(sample, keep)

    def _describe_uvs(self, sample: Any, order: Int64Array, keep: Keep) -> None:
        for uv in uv_sets(self.item)[:1]:
            self._name_uvs(uv.name)
            sample.setUVs(uv_sample(uv, self.item.connectivity, order, keep, by_corner=self.changes))
            return
        if self._has_uvs:
            nothing, rows = keep(vector_array(np.zeros((0, 2)))), keep(unsigned_array([]))
            sample.setUVs(keep(AbcGeom.OV2fGeomParamSample(nothing, rows, SCOPES["corner"])))

    def _name_uvs(self, name: str) -> None:
        """Name the shape's own UVs, before its first sample that has some."""
        if name != UV and not self._has_uvs:
            self._schema.setUVSourceName(name.removeprefix(f"{UV}:"))
        self._has_uvs = True

    def _describe_curves(self, sample: Any, keep: Keep) -> None:
        sample.setCurvesNumVertices(keep(int_array(self.item.connectivity.line_counts)))
        basis = self.key.curve_basis or "linear"
        cubic = _BASES.get(basis.removeprefix("cubic ")) if basis.startswith("cubic ") else None
        sample.setType(AbcGeom.CurveType.kLinear if cubic is None else AbcGeom.CurveType.kCubic)
        sample.setBasis(AbcGeom.BasisType.kNoBasis if cubic is None else cubic)
        if cubic is None and basis != "linear":
            self.notices.append(f"curves of object {self.key.name!r} are written as lines, not as {basis}")
        wrap, periodic = AbcGeom.CurvePeriodicity, self.key.curve_wrap == "periodic"
        sample.setWrap(wrap.kPeriodic if periodic else wrap.kNonPeriodic)
