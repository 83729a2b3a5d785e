"""Find the readable shapes of an Alembic archive, and the transforms above them.

Alembic's faces run clockwise seen from outside. Reading and writing reverse them, and with them all data of corners:
corner ``n - 1 - k`` of a face becomes corner ``k``. The binding silently takes an integer in a sample selector for a
time, so samples are always selected by time.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from alembic3d import Abc, AbcGeom
from scipy.spatial.transform import Rotation

from pdecodec.formats.alembic.attributes import (
    ADDED_KEY,
    AlembicExtras,
    find_own_properties,
    read_extras,
    value_at,
)
from pdecodec.formats.alembic.values import (
    change_times,
    matrix_rows,
    sample_times,
    samples_at,
    select,
    times_within,
    to_numpy,
)
from pdecodec.formats.base.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    ID,
    SUBDIVISION,
    label_attribute,
    reversed_corners,
)
from pdecodec.formats.base.scene_reading import SceneWalk, Shape, fault_of_faces
from pdecodec.formats.base.times import SAME_TIME
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import MAX_INDEX, Connectivity

MAX_LEVELS = 256
"""Largest depth of the tree; only instances that contain themselves are deeper."""


_GEOMETRY = {
    "mesh": AbcGeom.IPolyMesh,
    "subdivision": AbcGeom.ISubD,
    "curves": AbcGeom.ICurves,
    "points": AbcGeom.IPoints,
}


_NAMES_OF_OTHERS = {"Camera": "camera", "Light": "light", "Material": "material", "GeomBase": "shape"}
"""Names in messages for schemas without geometry that can be read."""


@dataclass(kw_only=True, eq=False)
class AlembicShape(Shape):
    """Object, positions and their times [s] of a shape, and its transforms, from the one right above it to the top.

    `samplings` are the times and time samplings of its fields.
    """

    node: Any
    kind: str
    fates: Mapping[str, tuple[bool, str]]
    positions: Any
    times: Float64Array
    chain: tuple[Transform, ...]
    samplings: Sequence[tuple[Float64Array, Any]]


class Transform:
    """A transform of the tree, and its samples."""

    def __init__(self, handle: Any) -> None:
        self._schema = handle.getSchema()
        # Identity transforms may have no samples.
        self._samples = self._schema.getNumSamples()
        self.sampling = self._schema.getTimeSampling()
        self.times = sample_times(self._schema) if self._samples else np.zeros(1)
        self.moves = self._samples > 1 and not self._schema.isConstant()
        self.inherits = not self._samples or self._schema.getInheritsXforms(select(self.times[0]))

    @cached_property
    def matrices(self) -> Float64Array:
        """Matrices of the samples, (samples, 4, 4) float64, for points that are rows."""
        if not self._samples:
            return np.eye(4)[None]
        times = self.times if self.moves else self.times[:1]
        return np.stack([matrix_rows(self._schema.getValue(select(time)).getMatrix()) for time in times])

    def at(self, times: Float64Array) -> Float64Array:
        """Return the matrices at times [s], (times, 4, 4) float64."""
        if not self.moves:
            return np.broadcast_to(self.matrices[0], (times.size, 4, 4))
        firsts, seconds, shares = zip(*(samples_at(self.times, float(time)) for time in times), strict=True)
        return interpolate_matrices(self.matrices[list(firsts)], self.matrices[list(seconds)], np.array(shares))


def interpolate_matrices(first: Float64Array, second: Float64Array, shares: Float64Array) -> Float64Array:
    """Interpolate between matrices: rotations turn, stretches and translations change linearly.

    Each matrix is decomposed into a rotation and a symmetric stretch, which holds scale and shear (Shoemake and Duff
    1992, "Matrix animation and polar decomposition"). So a wheel keeps its radius between two samples. If one matrix
    mirrors and the other does not, there is no rotation between them, and their elements are interpolated linearly.

    Parameters
    ----------
    first, second : (n, 4, 4) float64
        For points that are rows.
    shares : (n,) float64
        Weights of `second`, 0 to 1; the ends return `first` and `second` exactly.

    Returns
    -------
    (n, 4, 4) float64
    """
    share = shares[:, None, None]
    straight = np.where(share == 1, second, np.where(share == 0, first, (1 - share) * first + share * second))
    linear = np.stack([first[:, :3, :3], second[:, :3, :3]])
    sizes = np.linalg.det(linear)
    turns = (shares > 0) & (shares < 1) & (np.prod(sizes, axis=0) > 0) & (linear[0] != linear[1]).any(axis=(1, 2))
    if not turns.any():
        return straight
    u, _, vt = np.linalg.svd(linear[:, turns])
    # A matrix that mirrors is the product of a rotation and a stretch that mirrors.
    rotations = u @ vt * np.sign(sizes[:, turns])[..., None, None]
    stretches = linear[:, turns] @ rotations.swapaxes(-1, -2)
    from_first = Rotation.from_matrix(rotations[0].swapaxes(-1, -2) @ rotations[1]).as_rotvec()
    turned = rotations[0] @ Rotation.from_rotvec(from_first * shares[turns, None]).as_matrix()
    stretch = (1 - share[turns]) * stretches[0] + share[turns] * stretches[1]
    straight[turns, :3, :3] = stretch @ turned
    return straight


class ShapeScan(SceneWalk):
    """A walk through an archive, in seconds."""

    def shapes(self, archive: Any) -> list[AlembicShape]:
        """Return the readable shapes of an archive."""
        self.found: list[AlembicShape] = []
        _walk(archive.getTop(), "", (), False, self)
        return self.found

    def look(self, path: str, props: Sequence[Any], times: Float64Array) -> tuple[Any, Float64Array]:
        """Return where to read array properties that may change, and the times [s] at which they have the same
        values.

        The first value is a selector, or None if the properties are constant; the second is a part of `times`.
        """
        if self.is_first and (changed := sorted(set(change_times(props)))):
            self.changes[path] = changed
        if path not in self.changes:
            return None, times
        if self.at is None:
            return select(float(times[0])), times
        inside = times_within(times, self.span(path))
        own = inside if inside.size else times[:1]
        # Attributes may have changed at the first of these samples, together with something else of the shape.
        before = own[own <= self.at + SAME_TIME]
        return select(float(before[-1] if before.size else own[0])), own

    def span(self, path: str) -> tuple[float, float]:
        """Return the times [s] between which a shape has the connectivity that this walk reads."""
        edges = [-np.inf, *self.changes.get(path, ()), np.inf]
        number = 0 if self.at is None else int(np.searchsorted(edges, self.at + SAME_TIME, side="right")) - 1
        return edges[number], edges[number + 1]


def _walk(node: Any, path: str, chain: tuple[Transform, ...], hidden: bool, scan: ShapeScan) -> None:
    """Open the shapes below a node of the tree, in its order; count or refuse everything else.

    `hidden` says whether an object above them is hidden.
    """
    refusals = scan.refusals
    if path.count("/") >= MAX_LEVELS:
        refusals.refuse(path, f"more than {MAX_LEVELS} levels of objects above it")
        return
    for index in range(node.getNumChildren()):
        name = node.getChildHeader(index).getName()
        inner = f"{path}/{name}" if path else name
        try:
            child = node.getChild(index)
            _visit(child, child.getHeader(), inner, chain, hidden or is_ever_hidden(child), scan)
        except RuntimeError as error:
            reason = (str(error).strip().splitlines() or [type(error).__name__])[0]
            refusals.refuse(inner, f"an instance or a shape that Alembic cannot open ({reason})")


def is_ever_hidden(node: Any) -> bool:
    """Return whether a node is hidden at any sample of its visibility."""
    visibility = AbcGeom.GetVisibilityProperty(node)
    if not visibility.valid() or not visibility.getNumSamples():
        return False
    hidden = int(AbcGeom.ObjectVisibility.kVisibilityHidden)
    return any(int(visibility.getValue(select(time))) == hidden for time in sample_times(visibility))


def _visit(
    child: Any,
    header: Any,
    path: str,
    chain: tuple[Transform, ...],
    hidden: bool,
    scan: ShapeScan,
) -> None:
    refusals = scan.refusals
    wrap = Abc.WrapExistingFlag.kWrapExisting
    if AbcGeom.IXform.matches(header):
        transform = Transform(AbcGeom.IXform(child, wrap))
        if header.getMetaData().get(ADDED_KEY):
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
        # The counts are for messages about files without shapes; else the inventory names these objects.
        schema_name = header.getMetaData().get("schema").removeprefix("AbcGeom_").partition("_")[0]
        refusals.others[_NAMES_OF_OTHERS.get(schema_name, "other object")] += 1
    _walk(child, path, chain, hidden, scan)


def _open_shape(path: str, kind: str, schema: Any, node: Any, chain: tuple[Transform, ...], scan: ShapeScan) -> None:
    """Add a shape to those that can be read, unless it is refused or has no vertices."""
    refusals, positions = scan.refusals, schema.getPositionsProperty()
    props = {
        "curves": lambda: [schema.getNumVerticesProperty()],
        "points": lambda: [schema.getIdsProperty()],
    }.get(kind, lambda: [schema.getFaceCountsProperty(), schema.getFaceIndicesProperty()])()
    at, times = scan.look(path, [*props, *find_own_properties(schema)], sample_times(positions))
    points = Connectivity(len(positions.getValue(select(times[0]))))
    span = scan.span(path)
    gather = None
    if kind == "curves":
        counts = to_numpy(value_at(props[0].getValue, at)).astype(np.int32)
        if int(counts.sum(dtype=np.int64)) != points.vertex_count or (counts < 1).any():
            refusals.refuse(path, "curves whose numbers of points do not add up")
            return
        extras = AlembicExtras(points, np.zeros(0, np.int64), span)
        read_extras(kind, schema, node, extras, at)
        connectivity, gather = extras.curves(counts)
        _describe_curves(schema.getValue(), extras)
    elif kind == "points":
        extras = AlembicExtras(points, np.zeros(0, np.int64), span)
        read_extras(kind, schema, node, extras, at)
        connectivity = extras.own_lines("line_counts", "line_indices")
        ids = np.zeros(0, np.int64)
        if props[0].getNumSamples():
            ids = to_numpy(value_at(props[0].getValue, at)).astype(np.int64)
        # If points neither appear nor disappear, ids in ascending order from 0 hold no information.
        if at is not None or not np.array_equal(ids, np.arange(ids.size)):
            with extras.reading(".pointIds"):
                fits = not ids.size or np.abs(ids).max() <= MAX_INDEX
                extras.add(ID, "vertex", ids.astype(np.int32) if fits else ids, None)
    else:
        counts, indices = (to_numpy(value_at(prop.getValue, at)).astype(np.int32) for prop in props)
        if (fault := fault_of_faces(counts, indices)) is not None:
            refusals.refuse(path, fault)
            return
        order = reversed_corners(counts)
        whole = Connectivity(points.vertex_count, face_counts=counts, face_indices=indices[order])
        extras = AlembicExtras(whole, order, span)
        read_extras(kind, schema, node, extras, at)
        connectivity = extras.own_lines("line_counts", "line_indices")
        if kind == "subdivision":
            scheme = schema.getValue().getSubdivisionScheme() or "catmull-clark"
            extras.attributes.append(label_attribute(SUBDIVISION, scheme))
    # The first scan also keeps a shape without vertices if its connectivity changes: the frame times depend on it.
    if connectivity.vertex_count or (scan.is_first and path in scan.changes):
        moves = path in scan.changes or (positions.getNumSamples() > 1 and not positions.isConstant())
        scan.found.append(
            AlembicShape(
                name=path,
                connectivity=connectivity,
                attributes=extras.attributes,
                fields=extras.gathered_fields(gather),
                gather=gather,
                left_out=extras.left_out,
                turned=extras.turned,
                node=node,
                kind=kind,
                fates=extras.fates,
                samplings=extras.samplings,
                positions=positions,
                times=times if moves else times[:1],
                chain=chain,
            )
        )


def _describe_curves(sample: Any, extras: AlembicExtras) -> None:
    """Keep the type of curves as an attribute, such as ``cubic bspline`` or ``variable order``; none for linear
    ones.
    """
    kind, basis = str(sample.getType()), str(sample.getBasis()).removeprefix("k").removesuffix("Basis").lower()
    if kind != "kLinear":
        label = "variable order" if kind == "kVariableOrder" else f"cubic {basis}"
        extras.attributes.append(label_attribute(CURVE_BASIS, label))
    if str(sample.getWrap()) == "kPeriodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, "periodic"))
