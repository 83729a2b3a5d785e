"""Alembic scenes: polygon meshes, subdivision surfaces, curves and points, read sample by sample when asked for.

Alembic's faces run clockwise seen from outside; they are turned around on reading and back on writing, corners and
what belongs to them alike: corner ``n - 1 - k`` of a face becomes corner ``k``.

Frames stand at every time at which something of the scene is sampled, positions or a transform above them. What is
not sampled there is a straight line between its own samples, as Alembic has it.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from alembic3d import Abc
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.alembic_arrays import to_numpy
from pdecodec.formats.alembic_attributes import Extras, read_extras
from pdecodec.formats.alembic_scene import Geometry, Scene, read_scene, sample_times, samples_at, select
from pdecodec.formats.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    SUBDIVISION,
    label_attribute,
    reversed_corners,
)
from pdecodec.formats.registry import Transforms
from pdecodec.formats.sample_times import merged_times, rate_or_default, round_rate, snapped_times
from pdecodec.formats.transforms import apply_matrices, transform_attribute
from pdecodec.formats.unsupported import Refusals
from pdecodec.sequence import (
    Attribute,
    Connectivity,
    Float32Array,
    Float64Array,
    MeshObject,
    MeshSequence,
    check_frame_range,
)

FPS_PROPERTY, METADATA_PROPERTY = "pdecodec_fps", "pdecodec_metadata"
"""Properties of the top object that our writer leaves: Alembic has no place for either."""

HDF5_IDENTIFIER = b"\x89HDF\r\n\x1a\n"


def open_alembic(
    path: Path, *, fps: float | None, transforms: Transforms = "bake", skip_unsupported: bool = False
) -> MeshSequence:
    """Open an Alembic file of the Ogawa kind.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        Nominal rate; the file stores its times.
    transforms : {"bake", "keep"}
    skip_unsupported : bool
        See :func:`pdecodec.formats.open_sequence`.

    Raises
    ------
    InputError
        If it is no such file, holds no geometry, or an object changes its connectivity.
    """
    return AlembicSequence(path, fps=fps, transforms=transforms, skip_unsupported=skip_unsupported)


class AlembicSequence(MeshSequence):
    """The geometry of an Alembic file, which stays open until :meth:`close`.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
    transforms : {"bake", "keep"}
    skip_unsupported : bool
    """

    def __init__(
        self,
        path: Path,
        *,
        fps: float | None = None,
        transforms: Transforms = "bake",
        skip_unsupported: bool = False,
    ) -> None:
        self._path = path
        self._archive = _open_archive(path)
        refusals = Refusals(skip=skip_unsupported)
        scene = read_scene(self._archive, refusals)
        shapes = [found for shape in scene.shapes if (found := _open_shape(shape, refusals)) is not None]
        refusals.check_left(len(shapes), _counted(scene))
        self._shapes: list[_Shape] = shapes
        self.times, self.fps, notices = self._find_times(fps)
        self._keep = transforms == "keep"
        self.objects = tuple(self._object(shape) for shape in shapes)
        self.metadata = _metadata(self._archive)
        self.unsupported = tuple(refusals.found)
        self.notices = (*notices, *refusals.notices, *_left_out(scene, shapes))

    def _find_times(self, fps: float | None) -> tuple[Float64Array, float, tuple[str, ...]]:
        moving: list[Any] = [shape.times for shape in self._shapes if shape.times.size > 1]
        samplings = [shape.positions.getTimeSampling() for shape in self._shapes if shape.times.size > 1]
        for shape in self._shapes:
            for transform in shape.geometry.chain:
                if transform.moves:
                    moving.append(transform.times)
                    samplings.append(transform.sampling)
        stored = _stored_rate(self._archive, samplings)
        rate, notices = rate_or_default(stored, fps)
        if not moving:
            # Nothing moves, but may have been sampled all the same.
            still = max((sample_times(shape.positions) for shape in self._shapes), key=len)
            return snapped_times(still, stored or rate), rate, notices if still.size > 1 else ()
        times = merged_times(moving)
        return snapped_times(times, stored or rate), rate, notices

    def _object(self, shape: _Shape) -> MeshObject:
        attributes = shape.attributes
        if self._keep and shape.geometry.is_placed:
            attributes = (*attributes, transform_attribute(self.times, shape.geometry.matrices_at(self.times)))
        return MeshObject(shape.geometry.path, shape.connectivity, attributes)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        first = 0
        for shape in self._shapes:
            own = points[:, first : first + shape.connectivity.vertex_count]
            shape.read(self.times[start:stop], own, self._path, start)
            if not self._keep and shape.geometry.is_placed:
                own[:] = apply_matrices(own, shape.geometry.matrices_at(self.times[start:stop]))
            first += shape.connectivity.vertex_count
        return points

    def close(self) -> None:
        # The archive closes when nothing refers to it any more.
        self._shapes = []
        self._archive = None


class _Shape:
    """A shape that can be read: its connectivity, what it carries, and where its positions are."""

    def __init__(
        self,
        geometry: Geometry,
        connectivity: Connectivity,
        attributes: Sequence[Attribute],
        gather: NDArray[np.int64] | None,
        left_out: Sequence[str],
    ) -> None:
        self.geometry = geometry
        self.connectivity = connectivity
        self.attributes = tuple(attributes)
        self.left_out = left_out
        self.positions = geometry.schema.getPositionsProperty()
        every = sample_times(self.positions)
        self.times = every if self.positions.getNumSamples() > 1 and not self.positions.isConstant() else every[:1]
        self._gather = gather

    def read(self, times: Float64Array, out: Float32Array, path: Path, first_frame: int) -> None:
        """Positions at times into `out`, (times, vertices, 3)."""
        for row, time in enumerate(times):
            where = samples_at(self.times, float(time))
            if where.share == 0 and row and where == samples_at(self.times, float(times[row - 1])):
                out[row] = out[row - 1]
                continue
            points = self._sample(where.first, path, first_frame + row)
            if where.share:
                after = self._sample(where.second, path, first_frame + row).astype(np.float64)
                points = (points + where.share * (after - points)).astype(np.float32)
            out[row] = points

    def _sample(self, index: int, path: Path, frame: int) -> Float32Array:
        array = self.positions.getValue(select(self.times[index]))
        points: Float32Array = np.asarray(array).reshape(-1, 3)
        if self._gather is not None and points.shape[0] > int(self._gather.max(initial=-1)):
            points = points[self._gather]
        if points.shape[0] != self.connectivity.vertex_count:
            raise InputError(
                f"object {self.geometry.path!r} has {points.shape[0]} points, its first frame has "
                f"{self.connectivity.vertex_count}; every frame must have the connectivity of the first",
                path=path,
                frame=frame,
            )
        return points.copy()


def _open_archive(path: Path) -> Any:
    try:
        with path.open("rb") as file:
            head = file.read(len(HDF5_IDENTIFIER))
    except OSError as error:
        raise InputError(f"cannot be read ({error.strerror}); check the file", path=path) from error
    if head == HDF5_IDENTIFIER:
        raise InputError("is an HDF5-backed Alembic file; convert it to Ogawa first (abcconvert -toOgawa)", path=path)
    try:
        archive = Abc.IArchive(str(path))
    except RuntimeError as error:
        raise InputError(f"is no Alembic file, or a damaged one ({error}); export it again", path=path) from error
    return archive


def _open_shape(geometry: Geometry, refusals: Refusals) -> _Shape | None:
    if geometry.schema.getPositionsProperty().getNumSamples() == 0:
        return None
    opened = {"curves": _open_curves, "points": _open_points}.get(geometry.kind, _open_mesh)(geometry, refusals)
    if opened is not None and opened.connectivity.vertex_count == 0:
        return None
    return opened


def _vertex_count(geometry: Geometry) -> int:
    positions = geometry.schema.getPositionsProperty()
    return len(positions.getValue(select(sample_times(positions)[0])))


def _first_change(props: Sequence[Any]) -> int | None:
    """First sample at which one of several array properties is not what it was."""
    changes = []
    for prop in props:
        if prop.getNumSamples() <= 1 or prop.isConstant():
            continue
        times = sample_times(prop)
        first = to_numpy(prop.getValue(select(times[0])))
        for index, time in enumerate(times[1:], 1):
            if not np.array_equal(to_numpy(prop.getValue(select(time))), first):
                changes.append(index)
                break
    return min(changes, default=None)


def _open_mesh(geometry: Geometry, refusals: Refusals) -> _Shape | None:
    schema = geometry.schema
    changed = _first_change([schema.getFaceCountsProperty(), schema.getFaceIndicesProperty()])
    if changed is not None:
        refusals.refuse(geometry.path, "faces that change (heterogeneous topology)", changed)
        return None
    counts = to_numpy(schema.getFaceCountsProperty().getValue()).astype(np.int32)
    indices = to_numpy(schema.getFaceIndicesProperty().getValue()).astype(np.int32)
    if int(counts.sum(dtype=np.int64)) != indices.size or (counts < 3).any():
        smallest = int(counts.min(initial=3))
        refusals.refuse(geometry.path, f"faces of {smallest} corners, or counts that do not fit the indices")
        return None
    order = reversed_corners(counts)
    faces = Connectivity(_vertex_count(geometry), face_counts=counts, face_indices=indices[order])
    extras = read_extras(geometry, faces, order)
    attributes = list(extras.attributes)
    if geometry.kind == "subdivision":
        sample = schema.getValue()
        attributes.append(label_attribute(SUBDIVISION, sample.getSubdivisionScheme() or "catmull-clark"))
        if any(prop.valid() for prop in (schema.getCreaseIndicesProperty(), schema.getCornerIndicesProperty())):
            extras.left_out.append("creases and corners")
    lines = _own_lines(extras)
    connectivity = Connectivity(faces.vertex_count, faces.face_counts, faces.face_indices, *lines)
    return _Shape(geometry, connectivity, attributes, None, extras.left_out)


def _open_curves(geometry: Geometry, refusals: Refusals) -> _Shape | None:
    schema = geometry.schema
    changed = _first_change([schema.getNumVerticesProperty()])
    if changed is not None:
        refusals.refuse(geometry.path, "curves whose numbers of points change", changed)
        return None
    counts = to_numpy(schema.getNumVerticesProperty().getValue()).astype(np.int32)
    points = _vertex_count(geometry)
    if int(counts.sum(dtype=np.int64)) != points or (counts < 1).any():
        refusals.refuse(geometry.path, "curves whose numbers of points do not add up")
        return None
    extras = read_extras(geometry, Connectivity(points), np.zeros(0, np.int64))
    attributes = list(extras.attributes)
    sample = schema.getValue()
    kind = _curve_basis(str(sample.getType()), str(sample.getBasis()))
    if kind != "linear":
        attributes.append(label_attribute(CURVE_BASIS, kind))
    if str(sample.getWrap()) == "kPeriodic":
        attributes.append(label_attribute(CURVE_WRAP, "periodic"))
    if kind == "variable order":
        extras.left_out.append("knots and orders of curves")
    gather, indices = None, np.arange(points, dtype=np.int32)
    if "vertex" in extras.own and extras.own["vertex"].size == points:
        indices = extras.own["vertex"].astype(np.int32)
        _, gather = np.unique(indices, return_index=True)
    connectivity = Connectivity(points if gather is None else gather.size, line_counts=counts, line_indices=indices)
    return _Shape(geometry, connectivity, attributes, gather, extras.left_out)


def _curve_basis(kind: str, basis: str) -> str:
    """``linear``, ``cubic bspline``, ``variable order``..."""
    if kind == "kLinear":
        return "linear"
    if kind == "kVariableOrder":
        return "variable order"
    return f"cubic {basis.removeprefix('k').removesuffix('Basis').lower()}"


def _open_points(geometry: Geometry, refusals: Refusals) -> _Shape | None:
    changed = _first_change([geometry.schema.getIdsProperty()])
    if changed is not None:
        refusals.refuse(geometry.path, "points that come, go or change places (their ids change)", changed)
        return None
    points = _vertex_count(geometry)
    extras = read_extras(geometry, Connectivity(points), np.zeros(0, np.int64))
    connectivity = Connectivity(points, np.zeros(0, np.int32), np.zeros(0, np.int32), *_own_lines(extras))
    return _Shape(geometry, connectivity, extras.attributes, None, extras.left_out)


def _own_lines(extras: Extras) -> tuple[NDArray[Any], NDArray[Any]]:
    """Lines that our writer left beside faces or points."""
    none = np.zeros(0, np.int32)
    return extras.own.get("line_counts", none), extras.own.get("line_indices", none)


def _stored_rate(archive: Any, samplings: Sequence[Any]) -> float | None:
    """Frames per second: ours, or the sampling's, or the hint of the program that wrote the file."""
    top = archive.getTop().getProperties()
    if top.getPropertyHeader(FPS_PROPERTY) is not None:
        return float(Abc.IDoubleProperty(top, FPS_PROPERTY).getValue())
    for sampling in samplings:
        kind = sampling.getTimeSamplingType()
        if not kind.isAcyclic():
            return round_rate(1.0 / kind.getTimePerCycle())
    hint = float(Abc.GetArchiveInfo(archive).get("dccFPS", 0.0))
    return hint if hint > 0 else None


def _metadata(archive: Any) -> dict[str, str]:
    top = archive.getTop().getProperties()
    if top.getPropertyHeader(METADATA_PROPERTY) is not None:
        try:
            found = json.loads(Abc.IStringProperty(top, METADATA_PROPERTY).getValue())
        except ValueError:
            found = None
        if isinstance(found, dict):
            return {str(key): str(value) for key, value in found.items()}
    application = Abc.GetArchiveInfo(archive).get("appName", "")
    return {"source": application} if application else {}


def _counted(scene: Scene) -> str:
    return ", ".join(f"{count} {kind}{'s' * (count != 1)}" for kind, count in scene.others.items())


def _left_out(scene: Scene, shapes: Sequence[_Shape]) -> tuple[str, ...]:
    names = dict.fromkeys(name for shape in shapes for name in shape.left_out)
    notices = [f"not read: {_counted(scene)}"] if scene.others else []
    if names:
        notices.append(f"not kept: {', '.join(names)}")
    return tuple(notices)
