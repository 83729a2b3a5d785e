"""Alembic scenes: polygon meshes, subdivision surfaces, curves and points, read sample by sample when asked for.

Alembic's faces run clockwise seen from outside; they are turned around on reading and back on writing, corners and
what belongs to them alike: corner ``n - 1 - k`` of a face becomes corner ``k``.

Frames stand at every time at which something of the scene is sampled, positions or a transform above them. What is
not sampled there is a straight line between its own samples, as Alembic has it. The binding takes a sample selector's
integer for a time, silently: samples are always asked for by their time here.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from alembic3d import Abc, AbcGeom

from pdecodec.errors import InputError
from pdecodec.formats.alembic.attributes import (
    ADDED,
    FPS_PROPERTY,
    METADATA_PROPERTY,
    matrix_rows,
    own_properties,
    read_extras,
    to_numpy,
    value_at,
)
from pdecodec.formats.base.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    ID,
    SUBDIVISION,
    label_attribute,
    reversed_corners,
)
from pdecodec.formats.base.registry import Transforms, read_errors
from pdecodec.formats.base.scene_reading import (
    Extras,
    Refusals,
    SceneSequence,
    SceneWalk,
    Shape,
    fault_of_faces,
    runs_of_scene,
)
from pdecodec.formats.base.times import (
    SAME_TIME,
    Timing,
    merged_times,
    rate_or_default,
    resampled,
    round_rate,
    snapped_times,
)
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import MAX_INDEX, Connectivity, MeshSequence, Unsupported, check_frame_range

HDF5_IDENTIFIER = b"\x89HDF\r\n\x1a\n"

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


_DAMAGE = (RuntimeError, ArithmeticError, LookupError, MemoryError, TypeError, ValueError)
"""What the library and NumPy raise on damaged files, text that is not UTF-8 among it."""


def open_alembic(
    path: Path, *, fps: float | None, transforms: Transforms = "bake", skip_unsupported: bool = False
) -> MeshSequence:
    """Open the geometry of an Alembic file of the Ogawa kind; runs of frames where faces or ids of points change.

    Where `fps` is given, frames stand at that rate from the first stored time to the last, instead of at stored times.

    Raises
    ------
    InputError
        If it is no such file, or holds no geometry.
    """
    with _archive_errors(path):
        archive = _open_archive(path)
        scan = _Scan(Refusals(skip=skip_unsupported))
        shapes = scan.shapes(archive)
        notices = scan.refusals.notices(shapes)
        times, rate, time_notices = _timing(archive, shapes, fps)
        metadata = _metadata(archive)
    unsupported, timing = tuple(scan.refusals.found), (times, rate, (*time_notices, *notices))

    def open_run(first: int, own: Timing) -> MeshSequence:
        with _archive_errors(path):
            walk = _Scan(Refusals(skip=skip_unsupported), float(times[first]), scan.changes)
            found = walk.shapes(archive) if scan.changes else shapes
            return AlembicSequence(path, archive, found, own, transforms, metadata, unsupported, first)

    return runs_of_scene(times, [*scan.changes.values()], timing, open_run)


class AlembicSequence(SceneSequence):
    """Frames of one connectivity of an Alembic file, which stays open until :meth:`close`."""

    def __init__(
        self,
        path: Path,
        archive: Any,
        shapes: Sequence[_Shape],
        timing: Timing,
        transforms: Transforms,
        metadata: Mapping[str, str],
        unsupported: tuple[Unsupported, ...],
        first_frame: int,
    ) -> None:
        self._path, self._archive, self._first_frame = path, archive, first_frame
        self.times, self.fps, self.notices = timing
        self.metadata, self.unsupported = metadata, unsupported
        with _archive_errors(path):
            self._take(shapes, transforms)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with _archive_errors(self._path):
            return super().read_frames(start, stop)

    def _matrices(self, shape: _Shape, start: int, stop: int) -> Float64Array | None:
        if not any(one.moves or not np.array_equal(one.matrices[0], np.eye(4)) for one in shape.chain):
            return None
        return self.shape_matrices(shape, self.times[start:stop])

    @property
    def top(self) -> Any:
        """The object above all others."""
        return self._archive.getTop()

    def shape_matrices(self, shape: _Shape, times: Float64Array) -> Float64Array:
        """(times, 4, 4) from a shape's space to the scene's at times [s], for points that are rows."""
        matrices = np.broadcast_to(np.eye(4), (times.size, 4, 4))
        for transform in shape.chain:
            matrices = matrices @ transform.at(times)
        return matrices

    def _read(self, shape: _Shape, start: int, stop: int, out: Float32Array) -> None:
        before: tuple[int, int, float] | None = None
        for row, time in enumerate(self.times[start:stop].tolist()):
            first, second, share = around = _samples_at(shape.times, time)
            if around == before and share == 0:
                out[row] = out[row - 1]
                continue
            out[row] = self._sample(shape, first, start + row)
            if share:
                out[row] += share * (self._sample(shape, second, start + row).astype(np.float64) - out[row])
            before = around

    def _sample(self, shape: _Shape, index: int, frame: int) -> Float32Array:
        array: Float32Array = np.asarray(shape.positions.getValue(_select(shape.times[index]))).reshape(-1, 3)
        return shape.fitted(array, self._path, self._first_frame + frame).copy()

    def close(self) -> None:
        # The archive closes when nothing refers to it any more.
        self._shapes = []
        self._archive = None


@dataclass(kw_only=True, eq=False)
class _Shape(Shape):
    """A shape's object, its positions and their times [s], and the transforms from the one above it up to the top."""

    node: Any
    positions: Any
    times: Float64Array
    chain: tuple[_Transform, ...]


def _samples_at(times: Float64Array, time: float) -> tuple[int, int, float]:
    """The samples at or around a time and the share of the second; before the first and after the last, that one."""
    index = int(np.searchsorted(times, time + SAME_TIME, side="right")) - 1
    if index < 0 or index == times.size - 1 or time - times[index] <= SAME_TIME:
        return max(index, 0), max(index, 0), 0.0
    return index, index + 1, float((time - times[index]) / (times[index + 1] - times[index]))


def _select(time: float) -> Any:
    """A selector of the sample at a time."""
    return Abc.ISampleSelector(float(time))


def _sample_times(prop: Any) -> Float64Array:
    """Times [s] of the samples of a property or schema, at least one."""
    sampling = prop.getTimeSampling()
    return np.array([sampling.getSampleTime(index) for index in range(max(1, prop.getNumSamples()))], np.float64)


class _Transform:
    """A transform of the tree and its samples."""

    def __init__(self, handle: Any) -> None:
        self._schema = handle.getSchema()
        # Identity transforms may have no sample at all.
        self._samples = self._schema.getNumSamples()
        self.sampling = self._schema.getTimeSampling()
        self.times = _sample_times(self._schema) if self._samples else np.zeros(1)
        self.moves = self._samples > 1 and not self._schema.isConstant()
        self.inherits = not self._samples or self._schema.getInheritsXforms(_select(self.times[0]))

    @cached_property
    def matrices(self) -> Float64Array:
        """(samples, 4, 4) float64, for points that are rows."""
        if not self._samples:
            return np.eye(4)[None]
        times = self.times if self.moves else self.times[:1]
        return np.stack([matrix_rows(self._schema.getValue(_select(time)).getMatrix()) for time in times])

    def at(self, times: Float64Array) -> Float64Array:
        """(times, 4, 4) float64: the matrices at times [s]."""
        if not self.moves:
            return np.broadcast_to(self.matrices[0], (times.size, 4, 4))
        firsts, seconds, shares = zip(*(_samples_at(self.times, float(time)) for time in times), strict=True)
        first, second, share = (
            self.matrices[list(firsts)],
            self.matrices[list(seconds)],
            np.array(shares)[:, None, None],
        )
        matrices: Float64Array = np.where(share == 0, first, (1 - share) * first + share * second)
        return matrices


@contextmanager
def _archive_errors(path: Path) -> Iterator[None]:
    """Turn what the library raises on damaged files into one line that names `path`."""
    try:
        yield
    except _DAMAGE as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise InputError(f"is no Alembic file, or a damaged one ({reason}); export it again", path=path) from error


def _open_archive(path: Path) -> Any:
    with read_errors(path), path.open("rb") as file:
        head = file.read(len(HDF5_IDENTIFIER))
    if head == HDF5_IDENTIFIER:
        raise InputError("is an HDF5-backed Alembic file; convert it to Ogawa first (abcconvert -toOgawa)", path=path)
    return Abc.IArchive(str(path))


class _Scan(SceneWalk):
    """A walk through an archive; its times are seconds."""

    def shapes(self, archive: Any) -> list[_Shape]:
        """The shapes of an archive."""
        self.found: list[_Shape] = []
        _walk(archive.getTop(), "", (), False, self)
        return self.found

    def look(self, path: str, props: Sequence[Any], times: Float64Array) -> tuple[Any, Float64Array]:
        """Where array properties that may change are to be read, a selector or None, and the times [s] of one's samples
        that are of the same values of them.
        """
        if self.is_first and (changed := _change_times(props)):
            self.changes[path] = changed
        if path not in self.changes:
            return None, times
        if self.at is None:
            return _select(float(times[0])), times
        edges = np.array([-np.inf, *self.changes[path], np.inf])
        number = int(np.searchsorted(edges, self.at + SAME_TIME, side="right")) - 1
        inside = (times >= edges[number] - SAME_TIME) & (times < edges[number + 1] - SAME_TIME)
        own = times[inside] if inside.any() else times[:1]
        # Attributes may be others than those of the first of these samples, where what else there is has changed.
        before = own[own <= self.at + SAME_TIME]
        return _select(float(before[-1] if before.size else own[0])), own


def _walk(node: Any, path: str, chain: tuple[_Transform, ...], hidden: bool, scan: _Scan) -> None:
    """Open the shapes below a node of the tree, in its order; what else there is, is counted or refused.

    `hidden` says whether one above them is hidden.
    """
    refusals = scan.refusals
    if path.count("/") >= MOST_LEVELS:
        refusals.refuse(path, f"more than {MOST_LEVELS} levels of objects above it")
        return
    for index in range(node.getNumChildren()):
        name = node.getChildHeader(index).getName()
        inner = f"{path}/{name}" if path else name
        try:
            child = node.getChild(index)
            _visit(child, child.getHeader(), inner, chain, hidden or _hides(child), scan)
        except RuntimeError as error:
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            refusals.refuse(inner, f"an instance or a shape that Alembic cannot open ({reason})")


def _hides(node: Any) -> bool:
    """Whether a node is hidden at any of the samples of its visibility."""
    visibility = AbcGeom.GetVisibilityProperty(node)
    if not visibility.valid() or not visibility.getNumSamples():
        return False
    hidden = int(AbcGeom.ObjectVisibility.kVisibilityHidden)
    return any(int(visibility.getValue(_select(time))) == hidden for time in _sample_times(visibility))


def _visit(
    child: Any,
    header: Any,
    path: str,
    chain: tuple[_Transform, ...],
    hidden: bool,
    scan: _Scan,
) -> None:
    refusals = scan.refusals
    wrap = Abc.WrapExistingFlag.kWrapExisting
    if AbcGeom.IXform.matches(header):
        transform = _Transform(AbcGeom.IXform(child, wrap))
        if header.getMetaData().get(ADDED):
            path = path.rpartition("/")[0]
        chain = (transform, *(chain if transform.inherits else ()))
    elif (kind := next((kind for kind, one in _GEOMETRY.items() if one.matches(header)), None)) is not None:
        schema = _GEOMETRY[kind](child, wrap).getSchema()
        if schema.getPositionsProperty().getNumSamples():
            before = len(scan.found)
            _open_shape(path, kind, schema, child, chain, scan)
            for shape in scan.found[before:]:
                shape.hidden = hidden
    elif AbcGeom.INuPatch.matches(header):
        refusals.refuse(path, "a NURBS surface; convert it to polygons")
    elif not AbcGeom.IFaceSet.matches(header):
        schema_name = header.getMetaData().get("schema").removeprefix("AbcGeom_").partition("_")[0]
        refusals.others[_NAMES_OF_OTHERS.get(schema_name, "other object")] += 1
    _walk(child, path, chain, hidden, scan)


def _open_shape(path: str, kind: str, schema: Any, node: Any, chain: tuple[_Transform, ...], scan: _Scan) -> None:
    """Add a shape to those that can be read, unless it is refused or has no vertices."""
    refusals, positions = scan.refusals, schema.getPositionsProperty()
    props = {
        "curves": lambda: [schema.getNumVerticesProperty()],
        "points": lambda: [schema.getIdsProperty()],
    }.get(kind, lambda: [schema.getFaceCountsProperty(), schema.getFaceIndicesProperty()])()
    at, times = scan.look(path, [*props, *own_properties(schema)], _sample_times(positions))
    points = Connectivity(len(positions.getValue(_select(times[0]))))
    gather = None
    if kind == "curves":
        counts = to_numpy(value_at(props[0].getValue, at)).astype(np.int32)
        if int(counts.sum(dtype=np.int64)) != points.vertex_count or (counts < 1).any():
            refusals.refuse(path, "curves whose numbers of points do not add up")
            return
        extras = read_extras(kind, schema, node, points, np.zeros(0, np.int64), at)
        connectivity, gather = extras.curves(counts)
        _describe_curves(schema.getValue(), extras)
    elif kind == "points":
        extras = read_extras(kind, schema, node, points, np.zeros(0, np.int64), at)
        connectivity = extras.own_lines("line_counts", "line_indices")
        if at is not None:
            ids = to_numpy(props[0].getValue(at)).astype(np.int64)
            extras.add(ID, "vertex", ids if ids.size and np.abs(ids).max() > MAX_INDEX else ids.astype(np.int32), None)
    else:
        counts, indices = (to_numpy(value_at(prop.getValue, at)).astype(np.int32) for prop in props)
        if (fault := fault_of_faces(counts, indices)) is not None:
            refusals.refuse(path, fault)
            return
        order = reversed_corners(counts)
        whole = Connectivity(points.vertex_count, face_counts=counts, face_indices=indices[order])
        extras = read_extras(kind, schema, node, whole, order, at)
        connectivity = extras.own_lines("line_counts", "line_indices")
        if kind == "subdivision":
            scheme = schema.getValue().getSubdivisionScheme() or "catmull-clark"
            extras.attributes.append(label_attribute(SUBDIVISION, scheme))
            if any(prop.valid() for prop in (schema.getCreaseIndicesProperty(), schema.getCornerIndicesProperty())):
                extras.left_out.append("creases and corners")
    # Times are of all that changes, be it there at first or not.
    if connectivity.vertex_count or (scan.is_first and path in scan.changes):
        moves = path in scan.changes or (positions.getNumSamples() > 1 and not positions.isConstant())
        scan.found.append(
            _Shape(
                name=path,
                connectivity=connectivity,
                attributes=extras.attributes,
                gather=gather,
                left_out=extras.left_out,
                node=node,
                positions=positions,
                times=times if moves else times[:1],
                chain=chain,
            )
        )


def _describe_curves(sample: Any, extras: Extras) -> None:
    """Note what the points of curves control: ``cubic bspline``, ``variable order``; nothing where they are linear."""
    kind, basis = str(sample.getType()), str(sample.getBasis()).removeprefix("k").removesuffix("Basis").lower()
    if kind != "kLinear":
        label = "variable order" if kind == "kVariableOrder" else f"cubic {basis}"
        extras.attributes.append(label_attribute(CURVE_BASIS, label))
    if kind == "kVariableOrder":
        extras.left_out.append("knots and orders of curves")
    if str(sample.getWrap()) == "kPeriodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, "periodic"))


def _change_times(props: Sequence[Any]) -> list[float]:
    """Times [s] from which on one of several array properties is not what it was before."""
    changed: list[float] = []
    for prop in props:
        if prop.getNumSamples() > 1 and not prop.isConstant():
            before = None
            for time in _sample_times(prop).tolist():
                now = to_numpy(prop.getValue(_select(time)))
                if before is not None and not np.array_equal(now, before):
                    changed.append(time)
                before = now
    return sorted(set(changed))


def _timing(archive: Any, shapes: Sequence[_Shape], fps: float | None) -> Timing:
    moving = [(shape.times, shape.positions.getTimeSampling()) for shape in shapes if shape.times.size > 1]
    moving += [(one.times, one.sampling) for shape in shapes for one in shape.chain if one.moves]
    stored = _stored_rate(archive, [sampling for _, sampling in moving])
    rate, notices = rate_or_default(stored, fps)
    if moving:
        times = snapped_times(merged_times([times for times, _ in moving]), stored or rate)
        if fps is not None:
            times, notices = resampled(times, fps)
        return times, rate, notices
    # Nothing moves, but may have been sampled all the same.
    still = max((_sample_times(shape.positions) for shape in shapes), key=len)
    return snapped_times(still, stored or rate), rate, notices if still.size > 1 else ()


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
