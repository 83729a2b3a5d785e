"""Code that readers of scenes share: shapes under transforms, their data, and objects that cannot be read."""

from __future__ import annotations

import dataclasses
from abc import abstractmethod
from collections import Counter
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import (
    GROUP,
    MATERIAL,
    UV,
    direction_role,
    face_groups,
    reversed_corners,
    unique_name,
    vertex_slices,
)
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.frame_meshes import runs_of_frames
from pdecodec.formats.base.stored_normals import StoredNormals, read_normals, turned_notices
from pdecodec.formats.base.times import SAME_TIME, Timing
from pdecodec.formats.base.transforms import (
    apply_matrices,
    mirrors,
    reverse_faces,
    transform_attribute,
    transform_directions,
)
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.fields import Field, missing_value, rows_of_domain
from pdecodec.mesh.sequence import (
    Attribute,
    AttributeDomain,
    Connectivity,
    MeshObject,
    MeshSequence,
    Unsupported,
    check_frame_range,
)
from pdecodec.mesh.times import check_times

MAX_LISTED_NAMES = 8
"""Number of names that a notice lists; further names are only counted."""

MIN_FACE_CORNERS = 3
"""Fewest corners of a face."""

MAX_INSTANCED_VERTICES = 2**25
"""Largest number of vertices that instances may expand to, 400 MB per frame."""


class Refusals:
    """Policy of a reader for objects that it cannot read: refuse the file, or leave the objects out.

    Parameters
    ----------
    skip : bool
        Whether to leave them out.
    """

    def __init__(self, *, skip: bool) -> None:
        self._skip = skip
        self.found: list[Unsupported] = []
        self.others: Counter[str] = Counter()
        """Number of things in the file that are not geometry, by kind."""
        self.tessellated: Counter[str] = Counter()
        """Number of shapes without vertices that became polygons, by kind."""

    def refuse(self, name: str, feature: str, frame: int | None = None) -> None:
        """Note an object that cannot be read; raise InputError unless such objects are left out."""
        if not self._skip:
            raise InputError(
                f"has {feature}",
                code="unsupported-feature",
                object=name,
                frame=frame,
                setting="skip_unsupported",
                purpose="to go on without it",
            )
        self.found.append(Unsupported(name, feature, frame))

    def check(self, shapes: Sequence[Shape]) -> None:
        """Raise InputError if no shape is left."""
        if not shapes and self.found:
            first, more = self.found[0], len(self.found) - 1
            others = f", and {more} more object{'s' * (more > 1)} cannot be read either" if more else ""
            raise InputError(
                f"holds nothing that can be read: object {first.name!r} has {first.feature}{others}",
                code="unsupported-feature",
                frame=first.frame,
            )
        if not shapes:
            verb = "are" if next(iter(self.others.values()), 0) > 1 else "is"
            message = f"holds no mesh, curve or point animation: there {verb} {self._others or 'nothing at all'}"
            raise InputError(message, code="no-vertices")

    @property
    def _others(self) -> str:
        return ", ".join(f"{count} {kind}{'s' * (count != 1)}" for kind, count in self.others.items())

    def notices(self, shapes: Sequence[Shape], left_out: Iterable[str] = ()) -> tuple[str, ...]:
        """Return notices: one for each object left out, one for things that are not geometry, and one for data not
        kept.

        The last one names the data that shapes lose, and the things in `left_out`.

        Raises
        ------
        InputError
            If no shape is left.
        """
        self.check(shapes)
        notices = []
        for item in self.found:
            at = "" if item.frame is None else f" at frame {item.frame}"
            notices.append(f"object {item.name!r} is left out: it has {item.feature}{at}")
        notices += [f"not read: {self._others}"] if self._others else []
        if self.tessellated:
            kinds = ", ".join(f"{count} {kind}" for kind, count in self.tessellated.items())
            notices.append(f"shapes without vertices became polygons: {kinds}")
        names = not_kept((*(name for shape in shapes for name in shape.left_out), *left_out))
        turned = turned_notices([shape.turned for shape in shapes])
        return (*notices, *names, *turned, *hidden_notices(shapes))


def fault_of_faces(counts: NDArray[np.integer], indices: NDArray[np.integer]) -> str | None:
    """Return what is wrong with faces, for :meth:`Refusals.refuse`; None if they are valid.

    Parameters
    ----------
    counts : (faces,) integers
        Number of corners of each face.
    indices : (corners,) integers
        Their vertices, face after face.
    """
    if (counts < MIN_FACE_CORNERS).any():
        face = int(np.argmax(counts < MIN_FACE_CORNERS))
        corners = int(counts[face])
        of = f"{corners} corner{'s' * (corners != 1)}"
        return f"a face of {of} (number {face}, from 0), and a face needs {MIN_FACE_CORNERS} or more"
    total = int(counts.sum(dtype=np.int64))
    if total != indices.size:
        return f"faces with {total} corners in all, and vertices for {indices.size} corners"
    return None


class SceneWalk:
    """State of a walk through a scene that collects the shapes that can be read, as they are at a time or initially.

    Parameters
    ----------
    refusals : Refusals
    at : float, optional
        The time at which connectivity that changes is read, in the time unit of the format. Default: the first.
    changes : dict of str to sequence of float, optional
        When the connectivity of each shape changes, by its path, as found by an earlier walk.
    """

    def __init__(
        self, refusals: Refusals, at: float | None = None, changes: dict[str, Sequence[float]] | None = None
    ) -> None:
        self.refusals, self.at = refusals, at
        self.changes: dict[str, Sequence[float]] = {} if changes is None else changes
        self.is_first = changes is None


def hidden_notices(shapes: Sequence[Shape]) -> tuple[str, ...]:
    """Return a notice that names the shapes that the file hides; pdecodec always shows them."""
    names = [shape.name for shape in shapes if shape.hidden]
    return (f"hidden in the file, always or at times, but always visible here: {listed(names)}",) if names else ()


def listed(names: Sequence[str]) -> str:
    """Return the first few names for a notice, and how many more there are."""
    more = [f"{len(names) - MAX_LISTED_NAMES} more"] if len(names) > MAX_LISTED_NAMES else []
    return ", ".join([*map(repr, names[:MAX_LISTED_NAMES]), *more])


def lost_textures(count: int, names: Sequence[str]) -> tuple[str, ...]:
    """Return a notice about textures, or images, that are not kept; empty if there are none."""
    if not names and not count:
        return ()
    textures = f"{count} texture{'s' * (count != 1)}" if count else "images"
    named = f" of {listed(names)}" if names else ""
    return not_kept([f"{textures}{named}"], "not kept: {}; writing the motion onto this file keeps them")


@dataclass(frozen=True, eq=False)
class ShapeField:
    """Values of one shape that change in time.

    Attributes
    ----------
    field : Field
    read_at : callable
        Returns the values (rows of the file[, components]) at a time of the format; None if there are none then.
    times : sequence of float
        When the values are sampled; empty if they are one value that stays.
    rows : int
        Number of rows in the file.
    order : (rows,) int64 or None
        Row of the file for each row, unless they stand in the same order.
    place : str
        Where the format stores the values; empty if they cannot be stored there again.
    rows_at : callable or None
        Returns the row of what is stored for each row of `read_at` at a time, unless they are the same.
    """

    field: Field
    read_at: Callable[[float], NDArray[Any] | None]
    times: Sequence[float]
    rows: int
    order: Int64Array | None = None
    place: str = ""
    rows_at: Callable[[float], Int64Array] | None = None

    def at(self, time: float) -> NDArray[Any]:
        """Return the values (rows, components) at a time; NaN if the file has no values then.

        Raises
        ------
        InputError
            If the file has no values then and they are whole numbers, which cannot mark missing values.
        """
        found, width = self.read_at(time), self.field.components
        if found is None or found.size != self.rows * width:
            if self.field.is_exact:
                raise InputError(
                    f"field {self.field.name!r} has no values that fit the mesh at time {time:g} of the file; write "
                    "them there, or drop the field",
                    code="invalid-field",
                )
            count = self.rows if self.order is None else len(self.order)
            return np.full((count, width), np.nan, self.field.dtype)
        values = found.reshape(-1, width)
        return (values if self.order is None else values[self.order]).astype(self.field.dtype, copy=False)


def first_sample(read_at: Callable[[float], NDArray[Any] | None], times: Sequence[float]) -> NDArray[Any] | None:
    """Return the first sample of a :class:`ShapeField` that is not empty; None if all are empty."""
    return next((found for time in times or (0.0,) if (found := read_at(time)) is not None and found.size), None)


def gathered_rows(values: NDArray[Any], rows: NDArray[np.integer]) -> NDArray[Any] | None:
    """Return the row of `values` (n, ...) of each element, NaN or 0 for elements without one; None if n is 0."""
    if not len(values):
        return None
    missing = (rows < 0) | (rows >= len(values))
    found = values[np.where(missing, 0, rows)]
    found[missing] = missing_value(found.dtype)
    return found


def fields_of_shapes(shapes: Sequence[Shape]) -> tuple[tuple[Field, ...], dict[str, dict[int, ShapeField]]]:
    """Return the fields of several shapes, and for each field name the values of each shape, by the shape's index.

    Fields of the same name that differ in domain, type or number of components become several fields, with numbers
    appended to the name.
    """
    found: dict[Field, dict[int, ShapeField]] = {}
    for index, shape in enumerate(shapes):
        for one in shape.fields:
            found.setdefault(one.field, {})[index] = one
    fields: list[Field] = []
    sources: dict[str, dict[int, ShapeField]] = {}
    for like, of_shapes in found.items():
        name = unique_name(like.name, set(sources))
        everywhere = len(of_shapes) == len(shapes)
        fields.append(dataclasses.replace(like, name=name, objects=None if everywhere else tuple(of_shapes)))
        sources[name] = of_shapes
    return tuple(fields), sources


@dataclass(kw_only=True, eq=False)
class Shape:
    """A shape of a scene that can be read.

    Attributes
    ----------
    name : str
        Names from the root, without a leading slash.
    connectivity : Connectivity
    attributes : list of Attribute
    gather : (vertices,) int64 or None
        The file's points that are its vertices, unless these are all points in order.
    left_out : list of str
        Names of data that is not kept.
    hidden : bool
        Whether the file hides it, always or at times.
    fields : list of ShapeField
    turned : (corners,) float64
        Angles [degrees] between stored normals and those computed from faces, NaN if there is none.
    """

    name: str
    connectivity: Connectivity
    attributes: Sequence[Attribute]
    fields: Sequence[ShapeField] = ()
    gather: Int64Array | None = None
    left_out: Sequence[str] = ()
    hidden: bool = False
    turned: Float64Array = field(default_factory=lambda: np.zeros(0))

    def fitted(self, points: Float32Array, path: Path, frame: int) -> Float32Array:
        """Return the vertices (vertices, 3) float32 from the file's points at a frame."""
        if self.gather is not None and len(points) > int(self.gather.max(initial=-1)):
            points = points[self.gather]
        if len(points) != self.connectivity.vertex_count:
            raise InputError(
                f"has {len(points)} points, but the first frame has {self.connectivity.vertex_count}; every frame must "
                "have the connectivity of the first",
                code="connectivity-changes",
                object=self.name,
                path=path,
                frame=frame,
            )
        return points


def runs_of_scene(
    times: Float64Array,
    changes: Sequence[ArrayLike],
    timing: Timing,
    open_run: Callable[[int, Timing], MeshSequence],
    vertices_from: Callable[[int], int] | None = None,
) -> MeshSequence:
    """Open a scene whose frames are at times [s]; as several runs if connectivity changes between two of them.

    Parameters
    ----------
    times : (frames,) float64 [s]
    changes : sequence of array of float [s]
        When the connectivity of each object changes.
    timing : Timing
        Timing of all frames.
    open_run : callable
        Returns the run that begins at a frame, given its timing.
    vertices_from : callable, optional
        Returns the vertex count of the run that begins at a frame. Default: open the run.

    Raises
    ------
    InputError
        If times are not finite, do not increase, or are too far from 0.
    """
    check_times(times.size, times, None)
    edges = np.unique(np.concatenate([np.zeros(0), *map(np.asarray, changes)]))
    numbers = np.searchsorted(edges, times + SAME_TIME, side="right")
    firsts = np.flatnonzero(np.diff(numbers, prepend=numbers[0] - 1)).tolist()
    if len(firsts) == 1:
        return open_run(0, timing)
    ends = [*firsts[1:], times.size]

    def own(first: int, end: int) -> MeshSequence:
        return open_run(first, (times[first:end], timing[1], timing[2]))

    if vertices_from is None:
        vertices = [own(first, end).vertex_count for first, end in zip(firsts, ends, strict=True)]
    else:
        vertices = [vertices_from(first) for first in firsts]
    return runs_of_frames([*zip(firsts, vertices, strict=True)], timing, open_run)


@dataclass(frozen=True, kw_only=True)
class SceneFacts:
    """Facts that all runs of a scene share.

    Attributes
    ----------
    path : pathlib.Path
    transforms : {"bake", "keep"}
    metadata : mapping of str to str
    unsupported : tuple of Unsupported
    """

    path: Path
    transforms: str
    metadata: Mapping[str, str]
    unsupported: tuple[Unsupported, ...]


class SceneSequence(MeshSequence):
    """Shapes of a scene under transforms, which are applied to positions or kept as attributes."""

    _shapes: Sequence[Any]
    _keep: bool
    _path: Path
    _first_frame = 0
    """Index of the run's first frame in the whole sequence, because errors name frames of the whole sequence."""

    @abstractmethod
    def _read(self, shape: Any, start: int, stop: int, out: Float32Array) -> None:
        """Read positions of frames in the shape's own space into `out`, (stop - start, vertices, 3)."""

    @abstractmethod
    def _matrices(self, shape: Any, start: int, stop: int) -> Float64Array | None:
        """Return the matrices (stop - start, 4, 4) from the shape's space to the scene's, for points as rows;
        None if the shape has no transform.
        """

    def _field_times(self, start: int, stop: int) -> Sequence[float]:
        """Return the times of frames as :meth:`ShapeField.at` takes them."""
        return [float(time) for time in self.times[start:stop]]

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        times = self._field_times(start, stop)
        values = np.empty((stop - start, field.row_count(self.objects), field.components), field.dtype)
        slices = field.slices(self.objects)
        for index, source in self._field_sources[field.name].items() if times else ():
            shape, own = self._shapes[index], slices[index]
            found = np.stack([source.at(time) for time in (times if len(source.times) else times[:1])])
            if field.domain == "corner" and self.objects[index].connectivity is not shape.connectivity:
                found = found[:, reversed_corners(shape.connectivity.face_counts)]
            matrices = self._matrices(shape, start, stop) if self._turns(field) else None
            values[:, own] = found if matrices is None else transform_directions(field, found, matrices)
        return values if field.components > 1 else values[:, :, 0]

    def _turns(self, field: Field) -> bool:
        return not self._keep and direction_role(field) is not None

    def field_matrix(self, field: Field, shape: Any, frame: int) -> Float64Array | None:
        """Return the matrix (1, 4, 4) by which a shape's values of a field are turned at a frame; None if by none."""
        return self._matrices(shape, frame, frame + 1) if self._turns(field) else None

    @property
    def format_times(self) -> Sequence[float]:
        """Times of all frames as the format has them."""
        return self._field_times(0, self.frame_count)

    @property
    def field_sources(self) -> Mapping[str, Mapping[int, ShapeField]]:
        """What the shapes store of each field, by its name and the number of the shape."""
        return self._field_sources

    @property
    def shapes(self) -> Sequence[Any]:
        """The file's shape of each object."""
        return self._shapes

    def _begin(self, facts: SceneFacts, shapes: Sequence[Any], timing: Timing, first_frame: int) -> None:
        """Make shapes the objects of a run of frames that begins at `first_frame`."""
        self._path, self._first_frame = facts.path, first_frame
        self.times, self.fps, self.notices = timing
        self.metadata, self.unsupported = facts.metadata, facts.unsupported
        self._take(shapes, facts.transforms)

    def _take(self, shapes: Sequence[Any], transforms: str) -> None:
        """Make shapes the objects, once times are known; `transforms` is ``bake`` or ``keep``."""
        self._shapes, self._keep = shapes, transforms == "keep"
        self.objects = tuple(self._object(shape) for shape in shapes)
        self.fields, self._field_sources = fields_of_shapes(shapes)

    def _object(self, shape: Shape) -> MeshObject:
        item = MeshObject(shape.name, shape.connectivity, tuple(shape.attributes))
        if self._keep:
            matrices = self._matrices(shape, 0, self.frame_count)
            if matrices is not None and not np.array_equal(matrices, np.broadcast_to(np.eye(4), matrices.shape)):
                transform = transform_attribute(self.times, matrices)
                item = dataclasses.replace(item, attributes=(*item.attributes, transform))
        elif shape.connectivity.face_count:
            # The first matrix that does not flatten decides, as in bake_transforms.
            frames = (0, self.frame_count - 1, *range(self.frame_count))
            found = (self._matrices(shape, frame, frame + 1) for frame in frames)
            if mirrors(one[0] for one in found if one is not None):
                item = reverse_faces(item)
        return item

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        for shape, place in zip(self._shapes, vertex_slices(self.objects), strict=True) if start < stop else ():
            own = points[:, place]
            self._read(shape, start, stop, own)
            matrices = None if self._keep else self._matrices(shape, start, stop)
            if matrices is not None:
                own[:] = apply_matrices(own, matrices)
        return points


@dataclass
class Extras:
    """Data that a shape carries in addition to positions, while it is read.

    Attributes
    ----------
    connectivity : Connectivity
        Faces as they are kept.
    order : (corners,) int64
        Corner of the file for each corner of `connectivity`.
    attributes : list of Attribute
    fields : list of ShapeField
    own : dict
        Arrays that only pdecodec's writers store.
    left_out : list of str
        Names of data that is not kept.
    turned : (corners,) float64
        Angles [degrees] between stored normals and those computed from faces, NaN if there is none.
    """

    connectivity: Connectivity
    order: Int64Array = field(default_factory=lambda: np.zeros(0, np.int64))
    attributes: list[Attribute] = field(default_factory=list)
    fields: list[ShapeField] = field(default_factory=list)
    own: dict[str, NDArray[Any]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)
    turned: Float64Array = field(default_factory=lambda: np.zeros(0))

    def fits(self, domain: AttributeDomain, values: NDArray[Any], indices: Int32Array | None) -> bool:
        """Return whether a file has as many rows as the domain has elements, and their indices are in range."""
        rows = {
            "vertex": self.connectivity.vertex_count,
            "face": self.connectivity.face_count,
            "corner": self.connectivity.face_indices.size,
        }.get(domain)
        if indices is not None and indices.size and not -1 <= indices.min() <= indices.max() < len(values):
            return False
        return rows is None or rows == (len(values) if indices is None else indices.size)

    def add(
        self,
        name: str,
        domain: AttributeDomain,
        values: NDArray[Any],
        indices: Int32Array | None,
        labels: tuple[str, ...] = (),
    ) -> None:
        """Add an attribute with its rows in the order of the file; leave it out if it does not fit the shape."""
        if not self.fits(domain, values, indices):
            self.left_out.append(name)
            return
        if domain == "corner":
            values, indices = (values[self.order], None) if indices is None else (values, indices[self.order])
        if indices is not None and (labels or domain == "object"):
            # The values themselves number the labels.
            values, indices = values[indices], None
        if domain == "vertex" and name.partition(":")[0] == UV and self.connectivity.face_count:
            rows = np.arange(len(values), dtype=np.int32) if indices is None else indices
            domain, indices = "corner", rows[self.connectivity.face_indices]
        self.attributes.append(Attribute(name, domain, values, indices, labels))

    def add_field(
        self,
        field: Field,
        read_at: Callable[[float], NDArray[Any] | None],
        times: Sequence[float],
        place: str = "",
        rows_at: Callable[[float], Int64Array] | None = None,
    ) -> None:
        """Add values that change, with the components of the first sample that is not empty; add nothing if all are
        empty.

        The values are left out if that sample does not fit the shape. Later samples that do not fit count as
        missing.
        """
        first = first_sample(read_at, times)
        if first is None:
            return
        rows = rows_of_domain(MeshObject("", self.connectivity), field.domain)
        if not rows or (len(first) != rows and field.domain != "object"):
            self.left_out.append(f"{field.name} (it does not fit the mesh)")
            return
        taken = {one.field.name for one in self.fields} | {one.name for one in self.attributes}
        like = dataclasses.replace(field, name=unique_name(field.name, taken), components=first.size // rows)
        order = self.order if field.domain == "corner" else None
        self.fields.append(ShapeField(like, read_at, times, rows, order, place, rows_at))

    def gathered_fields(self, gather: Int64Array | None) -> list[ShapeField]:
        """Return the fields of a shape whose vertices are some of the file's points (:attr:`Shape.gather`)."""
        if gather is None:
            return self.fields
        return [dataclasses.replace(one, order=gather) if one.field.domain == "vertex" else one for one in self.fields]

    def add_normals(
        self,
        stored: StoredNormals,
        points: NDArray[Any],
        later: Iterable[tuple[NDArray[Any], StoredNormals | None]],
        *,
        has_shared: bool,
    ) -> None:
        """Record which corners share a normal, and which coincident vertices; leave normals out if they do not fit.

        Parameters
        ----------
        stored : StoredNormals
        points : (vertices, 3) array
            Positions that `stored` belongs to.
        later : iterable of (array, StoredNormals or None)
            Positions at other times, and the normals then, unless the same ones are stored.
        has_shared : bool
            Whether the file itself says which vertices share a normal.
        """

        def fits(one: StoredNormals) -> bool:
            return one.values.ndim == 2 and one.values.shape[1] == 3 and self.fits(*one)

        if not fits(stored):
            self.left_out.append("normals")
        elif self.connectivity.face_count:
            mesh, order = self.connectivity, self.order

            def at_corners(one: StoredNormals | None) -> Float32Array | None:
                return one.at_corners(mesh, order) if one is not None and fits(one) else None

            poses = ((at, partial(at_corners, one)) for at, one in later)
            found, self.turned = read_normals(mesh, order, stored, points, None if has_shared else poses)
            self.attributes += found

    def add_face_sets(self, found: Sequence[tuple[str, str, NDArray[np.integer]]]) -> None:
        """Add named sets of faces: role (group or material), label, and member faces."""
        for role in (GROUP, MATERIAL):
            sets = [(label, members) for kind, label, members in found if kind == role]
            self.attributes += face_groups(role, sets, self.connectivity.face_count)

    def own_lines(self, counts: str, indices: str) -> Connectivity:
        """Return the connectivity with the lines that pdecodec's writer stored under these names next to faces
        or points.
        """
        whole, none = self.connectivity, np.zeros(0, np.int32)
        lines = self.own.get(counts, none), self.own.get(indices, none)
        return Connectivity(whole.vertex_count, whole.face_counts, whole.face_indices, *lines)

    def curves(self, counts: Int32Array) -> tuple[Connectivity, Int64Array | None]:
        """Return the connectivity of curves with these point counts, and the points that are vertices if curves
        share points.
        """
        points = self.connectivity.vertex_count
        indices = self.own.get("vertex", np.zeros(0, np.int32)).astype(np.int32)
        if indices.size != points:
            return Connectivity(points, line_counts=counts, line_indices=np.arange(points, dtype=np.int32)), None
        _, gather = np.unique(indices, return_index=True)
        return Connectivity(gather.size, line_counts=counts, line_indices=indices), gather
