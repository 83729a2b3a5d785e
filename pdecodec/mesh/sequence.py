"""Mesh sequences: named objects of constant connectivity whose vertices move.

Every source of frames is a :class:`MeshSequence`: an array in memory, a reader that holds a file open, the decoder
of a `.pdeanim` file. Everything that takes frames asks for them by blocks, so that a sequence longer than memory
passes through.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import zip_longest
from types import TracebackType
from typing import Any, Literal, NamedTuple, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.fields import Field, FieldArrays, fields_in_memory
from pdecodec.mesh.rounding import note_rounding, rounding_noticed, to_float32
from pdecodec.mesh.times import check_times
from pdecodec.system.arguments import shown

Progress = Callable[[int, int, str], None]
"""Called as ``progress(frames done, total frames, current activity)``."""

AttributeDomain = Literal["vertex", "face", "corner", "object", "cell"]

BLOCK_BYTES = 64 * 2**20
"""Raw float32 bytes of one block of frames; this bounds memory while frames pass through."""

MAX_INDEX = int(np.iinfo(np.int32).max)
"""Largest vertex index: indices are int32 everywhere, here and in the file."""


def _int32(values: ArrayLike, what: str) -> Int32Array:
    array = np.asarray(values)
    if array.size == 0:
        return np.zeros(0, np.int32)
    if array.ndim != 1 or array.dtype.kind not in "iu":
        raise InputError(f"{what} must be a one-dimensional integer array, not {array.dtype} {array.shape}")
    if int(array.max()) > MAX_INDEX or int(array.min()) < -MAX_INDEX:
        raise InputError(
            f"{what} hold a number beyond 32 bits ({int(array.max())}); indices are int32", code="too-large"
        )
    return np.ascontiguousarray(array, dtype=np.int32)


CELL_SHAPES = ("polyline", "line", "polygon", "triangle", "quad", "tetra", "pyramid", "wedge", "hexahedron")
"""Shapes of cells, by their numbers in the file."""

FEWEST_NODES = np.array([1, 1, 3, 3, 4, 4, 5, 6, 8], np.int32)
"""Fewest nodes of a cell of each shape."""

_INDEX_ARRAYS = ("face_counts", "face_indices", "line_counts", "line_indices", "cell_counts", "cell_indices")


@dataclass(frozen=True, eq=False)
class Connectivity:
    """Faces and lines over `vertex_count` vertices, in the order of the source; with cells if solids are kept.

    Cells are the elements of the source, including solids. Faces and lines are then the visible sides and edges of
    the cells.

    Parameters
    ----------
    vertex_count : int
        Number of vertices; indices run from 0 to ``vertex_count - 1``.
    face_counts : (faces,) int32
        Corners of each face, 3 or more.
    face_indices : (sum of face_counts,) int32
        Vertex of each corner, face after face.
    line_counts : (lines,) int32
        Points of each polyline, 1 or more (1 is a point element).
    line_indices : (sum of line_counts,) int32
        Vertex of each polyline point, line after line.
    cell_shapes : (cells,) uint8
        Index of each cell's shape in :data:`CELL_SHAPES`.
    cell_counts : (cells,) int32
        Nodes of each cell. Shape and number of nodes give its kind: a tetrahedron of 10 nodes is quadratic.
    cell_indices : (sum of cell_counts,) int32
        Vertex of each node, cell after cell: corners, then nodes on edges, then others, as VTK orders them.

    Raises
    ------
    InputError
        If counts and indices do not fit together or an index is out of range.
    """

    vertex_count: int
    face_counts: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    face_indices: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    line_counts: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    line_indices: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    cell_shapes: NDArray[np.uint8] = field(default_factory=lambda: np.zeros(0, np.uint8))
    cell_counts: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))
    cell_indices: Int32Array = field(default_factory=lambda: np.zeros(0, np.int32))

    def __post_init__(self) -> None:
        for name in _INDEX_ARRAYS:
            object.__setattr__(self, name, _int32(getattr(self, name), name))
        shapes = _int32(self.cell_shapes, "cell_shapes")
        if shapes.size != self.cell_count or (shapes.size and not 0 <= shapes.min() <= shapes.max() < len(CELL_SHAPES)):
            raise InputError("each cell needs a shape, an index of CELL_SHAPES", code="invalid-faces")
        object.__setattr__(self, "cell_shapes", shapes.astype(np.uint8))
        self._check("face", self.face_counts, self.face_indices, smallest=3)
        self._check("line", self.line_counts, self.line_indices, smallest=1)
        self._check("cell", self.cell_counts, self.cell_indices, smallest=FEWEST_NODES[shapes])

    def _check(self, what: str, counts: Int32Array, indices: Int32Array, *, smallest: int | Int32Array) -> None:
        small = np.flatnonzero(counts < smallest)
        if small.size:
            needed = np.broadcast_to(smallest, counts.shape)[small[0]]
            raise InputError(
                f"{what} {int(small[0])} has {int(counts[small[0]])} points, but needs {int(needed)}",
                code="invalid-faces",
            )
        if int(counts.sum(dtype=np.int64)) != indices.size:
            raise InputError(
                f"{what} counts add up to {int(counts.sum(dtype=np.int64))}, indices are {indices.size}",
                code="invalid-faces",
            )
        outside = np.flatnonzero((indices < 0) | (indices >= self.vertex_count))
        if outside.size:
            owner = int(np.searchsorted(np.cumsum(counts), outside[0], side="right"))
            raise InputError(
                f"{what} {owner} refers to vertex {int(indices[outside[0]])}, "
                f"but there are {self.vertex_count} vertices (numbered from 0)",
                code="invalid-faces",
            )

    @classmethod
    def from_padded(cls, vertex_count: int, faces: ArrayLike | Sequence[Sequence[int]]) -> Connectivity:
        """Make connectivity from an index array padded with -1; rows of one or two vertices become lines.

        Parameters
        ----------
        vertex_count : int
        faces : (rows, width) integer, or a sequence of sequences of them
            Vertex indices, each row padded with -1 at its end. Sequences may have different lengths.
        """
        try:
            padded = np.asarray(faces)
        except ValueError:  # Raised if lengths differ.
            padded = np.array([*zip_longest(*faces, fillvalue=-1)]).T  # type: ignore[misc]  # no number
        if padded.size == 0:
            return cls(vertex_count)
        if padded.ndim != 2 or padded.dtype.kind not in "iu":
            raise InputError(f"faces must be a two-dimensional integer array, not {padded.dtype} {padded.shape}")
        used = padded != -1
        counts = used.sum(axis=1)
        if not np.array_equal(used, np.arange(padded.shape[1]) < counts[:, None]):
            raise InputError(
                "faces are padded with -1 before their end; -1 may only follow the last index", code="invalid-faces"
            )
        if counts.min() < 1:
            raise InputError(f"face {int(counts.argmin())} has no vertices", code="no-vertices")
        is_face = counts >= 3
        return cls(
            vertex_count,
            face_counts=counts[is_face].astype(np.int32),
            face_indices=padded[is_face][used[is_face]],
            line_counts=counts[~is_face].astype(np.int32),
            line_indices=padded[~is_face][used[~is_face]],
        )

    @property
    def face_count(self) -> int:
        return int(self.face_counts.size)

    @property
    def line_count(self) -> int:
        return int(self.line_counts.size)

    @property
    def cell_count(self) -> int:
        return int(self.cell_counts.size)

    def without_cells(self) -> Connectivity:
        """Return the faces and lines alone."""
        return Connectivity(self.vertex_count, self.face_counts, self.face_indices, self.line_counts, self.line_indices)

    def with_own_cells(self) -> Connectivity:
        """Return this connectivity with its faces and lines, in this order, as cells."""
        faces = np.select([self.face_counts == 3, self.face_counts == 4], [3, 4], 2)
        return replace(
            self,
            cell_shapes=np.append(faces, np.zeros(self.line_count)).astype(np.uint8),
            cell_counts=np.concatenate([self.face_counts, self.line_counts]),
            cell_indices=np.concatenate([self.face_indices, self.line_indices]),
        )

    def same_as(self, other: Connectivity) -> bool:
        """Return whether both have the same vertices, faces, lines and cells in the same order."""
        return self.vertex_count == other.vertex_count and all(
            np.array_equal(getattr(self, name), getattr(other, name)) for name in ("cell_shapes", *_INDEX_ARRAYS)
        )


def joined_connectivity(parts: Sequence[Connectivity]) -> Connectivity:
    """Return several parts as one, with indices shifted by the vertices before each part."""
    if len(parts) == 1:
        return parts[0]
    shifts = np.cumsum([0, *(part.vertex_count for part in parts)])
    arrays = {
        name: np.concatenate([
            getattr(part, name) + (np.int32(shift) if name.endswith("_indices") else np.int32(0))
            for part, shift in zip(parts, shifts, strict=False)
        ])
        for name in _INDEX_ARRAYS
    }  # fmt: skip
    return Connectivity(int(shifts[-1]), **arrays, cell_shapes=np.concatenate([part.cell_shapes for part in parts]))


@dataclass(frozen=True, eq=False)
class Attribute:
    """Constant data that travels with an object unchanged: UVs, colours, groups, materials.

    Parameters
    ----------
    name : str
        ``"uv"``, ``"color"``, ``"group"``, ``"material"``, or the source's own name.
    domain : {"vertex", "face", "corner", "object", "cell"}
        The elements that `values` (or `indices`, if present) has one row for each.
    values : (n,) or (n, k) array
        float32, float64, int32 or uint8.
    indices : (rows of the domain,) int32, optional
        Row of `values` for each element of the domain; -1 for none. Keeps UV seams as they were.
    labels : tuple of str
        Names that integer `values` refer to (group and material names).
    """

    name: str
    domain: AttributeDomain
    values: NDArray[Any]
    indices: Int32Array | None = None
    labels: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class MeshObject:
    """One named object, with its data that are constant over frames.

    Parameters
    ----------
    name : str
        In a tree of objects its path, ``"Bone/BoneShape"``.
    connectivity : Connectivity
    attributes : tuple of Attribute

    Raises
    ------
    InputError
        If an attribute does not have one row per element of its domain, or refers to rows that do not exist.
    """

    name: str
    connectivity: Connectivity
    attributes: tuple[Attribute, ...] = ()

    def __post_init__(self) -> None:
        rows = {
            "vertex": self.connectivity.vertex_count,
            "face": self.connectivity.face_count,
            "corner": int(self.connectivity.face_indices.size),
            "cell": self.connectivity.cell_count,
        }
        for attribute in self.attributes:
            if attribute.domain != "object":
                if attribute.domain not in rows:
                    known = ", ".join((*rows, "object"))
                    raise InputError(
                        f"attribute {attribute.name!r} of object {self.name!r} has the unknown domain "
                        f"'{attribute.domain}'; use {known}",
                        code="invalid-attribute",
                    )
                self._check(attribute, rows[attribute.domain])

    def _check(self, attribute: Attribute, rows: int) -> None:
        what = f"attribute {attribute.name!r} of object {self.name!r}"
        indices = attribute.indices
        given = len(attribute.values) if indices is None else len(indices)
        if given != rows:
            raise InputError(
                f"{what} has {given} rows, but there are {rows} of its domain, {attribute.domain}",
                code="invalid-attribute",
            )
        if indices is not None and indices.size and not -1 <= indices.min() <= indices.max() < len(attribute.values):
            raise InputError(
                f"{what} refers to rows outside its {len(attribute.values)} values", code="invalid-attribute"
            )

    @property
    def vertex_count(self) -> int:
        return self.connectivity.vertex_count


@dataclass(frozen=True)
class Unsupported:
    """An object of a file that was left out because it cannot be read.

    Parameters
    ----------
    name : str
        The object's name with its path.
    feature : str
        The feature of the object that is not supported.
    frame : int, optional
        First frame at which its connectivity changes.
    """

    name: str
    feature: str
    frame: int | None = None


Fate = Literal["coded", "implied", "dropped"]
"""Whether an item of a file is kept, is repeated by a kept item, or is not kept."""


class Content(NamedTuple):
    """An item of a file, and what happens to it.

    Parameters
    ----------
    path : str
        Its place in the file.
    kind : str
        Its kind, in the format's own words.
    fate : {"coded", "implied", "dropped"}
    """

    path: str
    kind: str
    fate: Fate


class SceneSource(Protocol):
    """The scene around the motion of a sequence (cameras, materials, custom data): a file, or a scene that a `.pdeanim`
    file carries.

    Attributes
    ----------
    family : str or None
        Format of a scene that a `.pdeanim` file carries.
    """

    @property
    def family(self) -> str | None: ...

    def carrier(self, sequence: MeshSequence, *, exact_uvs: bool, fields: Collection[str]) -> Any:
        """Return the scene that a `.pdeanim` file of `sequence` will carry; None if there is none.

        `sequence` comes from this source; `exact_uvs` says whether the file keeps texture coordinates to the last
        bit, `fields` which fields it keeps.
        """

    def of_some_objects(self) -> SceneSource | None:
        """Return the source for a selection of its objects; None if it needs all of them."""


class MeshSequence(ABC):
    """Named objects and their vertex positions at a list of times.

    In `read_frames`, the vertices of all objects follow each other, object by object.

    Attributes
    ----------
    objects : tuple of MeshObject
        At least one.
    times : (frames,) float64 [s]
        Strictly increasing.
    fps : float [1/s]
        Nominal frame rate, for formats that count frames.
    metadata : mapping of str to str
        Other facts that the source states (``up_axis``, ``unit``, ``source``...).
    notices : tuple of str
        Messages for people (an assumed frame rate, data left out); the command line prints them.
    unsupported : tuple of Unsupported
        Objects that are not supported, and that a reader left out as requested.
    fields : tuple of Field
        Values on vertices, faces, corners or objects that change in time; :meth:`read_field` reads them.
    carried : SceneSource or None
        The scene around the motion, if a `.pdeanim` file can carry it.
    list_contents : callable
        Returns :attr:`contents` on request, for formats whose readers list them.
    """

    objects: tuple[MeshObject, ...]
    times: Float64Array
    fps: float
    metadata: Mapping[str, str]
    notices: tuple[str, ...]
    unsupported: tuple[Unsupported, ...] = ()
    fields: tuple[Field, ...] = ()
    carried: SceneSource | None = None
    list_contents: Callable[[], tuple[Content, ...]] = tuple

    @cached_property
    def contents(self) -> tuple[Content, ...]:
        """Everything that the file holds, for formats whose readers list it."""
        return self.list_contents()

    @abstractmethod
    def read_frames(self, start: int, stop: int) -> Float32Array:
        """Return positions of frames ``start`` to ``stop - 1``.

        Returns
        -------
        (stop - start, vertices, 3) float32 [scene units]

        Raises
        ------
        InputError
            If a frame is missing, unreadable, or has another connectivity.
        IndexError
            If ``0 <= start <= stop <= frame_count`` does not hold.
        """

    def read_field(self, name: str, start: int, stop: int) -> NDArray[Any]:
        """Return the values of a field at frames ``start`` to ``stop - 1``.

        Returns
        -------
        (stop - start, rows) or (stop - start, rows, components) array
            Of the type of the field; rows stand object after object (:class:`pdecodec.Field`).

        Raises
        ------
        InputError
            If there is no such field, or a frame cannot be read.
        IndexError
            If ``0 <= start <= stop <= frame_count`` does not hold.
        """
        field = self.field_named(name)
        check_frame_range(self, start, stop)
        return self._field_values(field, start, stop)

    def field_blocks(self, name: str) -> Iterator[tuple[int, NDArray[Any]]]:
        """Yield blocks of consecutive frames of a field, ``(first frame, values)``."""
        field = self.field_named(name)
        row = field.frame_bytes(self.objects)
        size = max(1, BLOCK_BYTES // max(1, row))
        for start in range(0, self.frame_count, size):
            yield start, self.read_field(name, start, min(start + size, self.frame_count))

    def field_facts(self) -> list[dict[str, Any]]:
        """Return the facts about each field as JSON objects."""
        return [{**vars(field), "dtype": str(field.dtype)} for field in self.fields]

    def field_named(self, name: str) -> Field:
        """Return the field of a name; raise InputError if there is none."""
        found = next((one for one in self.fields if one.name == name), None)
        if found is None:
            known = ", ".join(repr(one.name) for one in self.fields) or "none"
            raise InputError(f"there is no field {shown(name)}; there are {known}", code="unknown-name")
        return found

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        """Return values of one of :attr:`fields` at existing frames. Sequences with fields override this method."""
        raise NotImplementedError

    def __repr__(self) -> str:
        runs = len(self.runs)
        what = f"{runs:,} runs" if runs > 1 else f"{self._object_count:,} object{'s' * (self._object_count != 1)}"
        vertices = (
            f"{'at most ' * (runs > 1)}{self.most_vertices:,} {'vertex' if self.most_vertices == 1 else 'vertices'}"
        )
        frames = f"{self.frame_count:,} frame{'s' * (self.frame_count != 1)}"
        return f"<{type(self).__name__}: {what}, {vertices}, {frames}, {float(self.times[-1] - self.times[0]):.4g} s>"

    @property
    def _object_count(self) -> int:
        return len(self.objects)

    def close(self) -> None:  # noqa: B027 - a hook, not a duty: most sequences hold nothing open
        """Close open files. Does nothing by default."""

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def frame_count(self) -> int:
        return int(self.times.size)

    @property
    def vertex_count(self) -> int:
        return sum(item.vertex_count for item in self.objects)

    @property
    def position_count(self) -> int:
        """Number of vertices of all frames together."""
        return self.frame_count * self.vertex_count

    @property
    def most_vertices(self) -> int:
        """Number of vertices of the frame that has most."""
        return self.vertex_count

    @property
    def run_starts(self) -> Int64Array:
        """First frame of each run."""
        return np.zeros(1, np.int64)

    @property
    def runs(self) -> Sequence[MeshSequence]:
        """Runs of frames of constant connectivity, in order: the sequence itself, except for
        :class:`pdecodec.ChangingSequence`.
        """
        return (self,)

    def run_number_at(self, time: float) -> int:
        """Return the number of the run at a time [s]; between two runs the earlier one."""
        return 0

    def run_number_of(self, frame: int) -> int:
        """Return the number of the run that contains a frame."""
        return 0

    def run_at(self, time: float) -> MeshSequence:
        """Return the run at a time [s]; its objects are those of that time."""
        return self.runs[self.run_number_at(time)]

    @cached_property
    def connectivity(self) -> Connectivity:
        """All objects as one connectivity, with indices shifted by the vertices before each object."""
        return joined_connectivity([item.connectivity for item in self.objects])

    @property
    def frames_per_block(self) -> int:
        """Number of frames that fit in :data:`BLOCK_BYTES`, at least one."""
        return max(1, BLOCK_BYTES // max(1, 12 * self.vertex_count))

    def blocks(self, frames: int | None = None) -> Iterator[tuple[int, Float32Array]]:
        """Yield blocks of consecutive frames, ``(first frame, positions)``, of at most `frames` frames."""
        size = frames or self.frames_per_block
        for start in range(0, self.frame_count, size):
            yield start, self.read_frames(start, min(start + size, self.frame_count))

    def to_array(self) -> ArraySequence:
        """Return the whole sequence in memory."""
        return ArraySequence(
            self.read_frames(0, self.frame_count),
            objects=self.objects,
            times=self.times,
            fps=self.fps,
            metadata=self.metadata,
            notices=self.notices,
            fields=[(one, self.read_field(one.name, 0, self.frame_count)) for one in self.fields],
        )


class ArraySequence(MeshSequence):
    """A mesh sequence in memory.

    Parameters
    ----------
    points : (frames, vertices, 3) array [scene units]
        Converted to float32 (other types are rounded).
    objects : sequence of MeshObject, optional
        Objects whose vertices, one after the other, are `points`. Default: one object, of `faces`.
    faces : (faces, 3) or (faces, 4) integer, or a sequence of sequences of vertex indices, optional
        Polygons of a single object; shorter rows of an array end in -1. Default: points alone.
    times : (frames,) array [s], optional
        Strictly increasing. Default: frames at `fps` from 0.
    fps : float, optional
        Nominal frame rate. Default: from `times`, else 24.
    fields : mapping of str to array, or sequence of (Field, array), optional
        Values that change in time, (frames, rows) or (frames, rows, components). For an array without a
        :class:`pdecodec.Field`, the number of rows determines the domain, with vertices first.

    Raises
    ------
    InputError
        If shapes disagree, there is no frame or no vertex, or times do not increase.
    """

    def __init__(
        self,
        points: ArrayLike,
        *,
        objects: Sequence[MeshObject] | None = None,
        faces: ArrayLike | Sequence[Sequence[int]] | None = None,
        times: ArrayLike | None = None,
        fps: float | None = None,
        metadata: Mapping[str, str] | None = None,
        notices: Sequence[str] = (),
        fields: FieldArrays = (),
    ) -> None:
        array = np.asarray(points)
        if array.ndim != 3 or array.shape[2] != 3 or array.dtype.kind not in "fiu":
            raise InputError(f"points must be numbers of shape (frames, vertices, 3), not {array.dtype} {array.shape}")
        with rounding_noticed() as rounding:
            self.points: Float32Array = to_float32(array)
        self._rounding = rounding.largest
        frames, vertices = array.shape[:2]
        polygons = Connectivity(vertices) if faces is None else Connectivity.from_padded(vertices, faces)
        if objects is not None and not (
            isinstance(objects, Sequence) and all(isinstance(one, MeshObject) for one in objects)
        ):
            raise InputError(f"objects must be a list of MeshObject, not {shown(objects)}")
        if objects and faces is not None:
            raise InputError("objects have their own faces; give either objects or faces")
        if metadata is not None and not isinstance(metadata, Mapping):
            raise InputError(f"metadata must be a mapping of names to texts, not {shown(metadata)}")
        self.objects = tuple(objects) if objects else (MeshObject("mesh", polygons),)
        if self.vertex_count != vertices:
            raise InputError(f"objects have {self.vertex_count} vertices, but points have {vertices}")
        self.times, self.fps = check_times(frames, times, fps)
        if vertices == 0:
            raise InputError("there are no vertices; give at least one", code="no-vertices")
        self.metadata = dict(metadata or {})
        self.notices = tuple(notices)
        self.fields, self._values = fields_in_memory(fields, frames, self.objects)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._values[field.name][start:stop]

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        note_rounding(self._rounding)
        return self.points[start:stop]


def check_frame_range(sequence: MeshSequence, start: int, stop: int) -> None:
    """Raise IndexError unless ``0 <= start <= stop <= frame_count``."""
    if not 0 <= start <= stop <= sequence.frame_count:
        raise IndexError(f"frames {start} to {stop} of a sequence of {sequence.frame_count}")
