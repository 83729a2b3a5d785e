"""Write motion onto an existing file: its objects move as a sequence says, and everything else stays.

Objects are matched by name (objects of the same name in order), or all in order if no name is shared. Their faces,
lines and vertices must be those of the original. Positions in the space of the scene are transformed into the space
of the original's shapes.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, SettingsError, naming_file
from pdecodec.formats.base.attribute_roles import reversed_corners, vertex_slices
from pdecodec.formats.base.companions import input_files, output_files
from pdecodec.formats.base.normals import NormalRows
from pdecodec.formats.base.opening import misplaced, open_sequence
from pdecodec.formats.base.registry import Output, format_to_read, format_to_write, list_formats, load
from pdecodec.formats.base.scene_reading import listed
from pdecodec.formats.base.scene_space import UNIT, UP_AXIS, metres_per_unit, up_axis_of
from pdecodec.formats.base.times import times_kept
from pdecodec.formats.base.transforms import bake_transforms
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence, Progress
from pdecodec.system.reading import asset_folders_allowed

if TYPE_CHECKING:
    from pdecodec.codec.settings import EncodeSettings

FLATTENED_TOLERANCE = 1e-5
"""Largest error that inverting a flattening transform may leave in positions, relative to the largest coordinate."""

SLOPE_HALF_SECONDS = 1e-4
"""Half of the interval [s] over which the velocity of a transform is measured."""

OntoWriter = Callable[..., tuple[str, ...]]
"""Type of a format's ``onto``: writes a sequence onto an open original that it fits; returns notices about losses.

It takes the sequence, the original, the :class:`Fitted` objects, the original's path and the :class:`Output`.
"""


@dataclass(frozen=True)
class Fitted:
    """An object of a sequence, the slice of its vertices in the sequence, and the index of the object in the
    original that it moves.
    """

    item: MeshObject
    own: slice
    index: int


def write_onto(
    sequence: MeshSequence,
    original: str | os.PathLike[str],
    path: str | os.PathLike[str],
    *,
    clip: str | None = None,
    displacement: str | None = None,
    solids: Literal["surface", "keep"] | None = None,
    layer: bool = False,
    overwrite: bool = False,
    fps: float | None = None,
    velocities: MeshSequence | None = None,
    progress: Progress | None = None,
    meshopt: bool = False,
    straight: bool = False,
    asset_folders: Iterable[str | os.PathLike[str]] = (),
    is_filled: bool = False,
    rigid: float | None = None,
    motion: EncodeSettings | None = None,
) -> tuple[str, ...]:
    """Write a copy of a file of the same format in which a sequence's motion replaces the original one.

    Parameters
    ----------
    sequence : MeshSequence
        In the space of the original's scene.
    original : path
        An Alembic, USD, glTF, OBJ or Exodus file; of OBJ sequences the first frame is taken.
    path : path
        Another file of that format, or for OBJ a pattern or a folder.
    clip : str, optional
        The animation of the original that the motion replaces, if it has several (glTF). Default: the first.
    displacement, solids
        Exodus: how the original is read, see :func:`pdecodec.open_sequence`. Default: its solids are cells if the
        sequence has cells.
    layer : bool
        USD: write only a layer over the original, which it refers to: points, normals and velocities.
    overwrite, fps, velocities, progress, meshopt, straight
        See :func:`pdecodec.formats.write_sequence`.
    asset_folders : iterable of path
        See :func:`pdecodec.open_sequence`; packages may refer only to files inside them.
    is_filled : bool
        The original's positions and normals hold nothing, as in a scene that a `.pdeanim` file carried.
    rigid : float, optional
        glTF, if `is_filled`: see :func:`pdecodec.formats.write_sequence`.
    motion : EncodeSettings, optional
        glTF: see :func:`pdecodec.formats.write_sequence`.

    Returns
    -------
    tuple of str
        A line for each thing that could not be kept.

    Raises
    ------
    InputError
        If the original cannot be read, objects do not fit it, or the output exists or cannot be written.
    SettingsError
        If the two are of different formats or the same file, or the format does not have an option.
    MissingExtraError
        If the format needs a package that is not installed.
    """
    source, where = Path(original), Path(path)
    entry, wanted = format_to_read(source), format_to_write(path)
    if entry is not wanted or entry.onto is None:
        kinds = ", ".join(one.title.partition(",")[0] for one in list_formats() if one.onto)
        message = f"needs two files of the same format ({kinds}), not {entry.title} and {wanted.title}"
        if entry is wanted:
            message = f"is for {kinds}, not for {entry.title}; leave it out"
        raise SettingsError(message, code="setting-unsupported", path=where, setting="onto")
    if layer and entry.name != "usd":
        raise misplaced("layer", "USD", where)
    asked: dict[str, Any] = {"meshopt": meshopt, "straight": straight, "motion": motion}
    for name in (name for name, value in asked.items() if value and name not in entry.write_options):
        raise misplaced(name, "glTF", where)
    reading: dict[str, Any] = {"clip": clip, "displacement": displacement, "solids": solids}
    for name in (name for name, value in reading.items() if value is not None and name not in entry.options):
        raise misplaced(name, "glTF" if name == "clip" else "Exodus", where)
    if solids is None and "solids" in entry.options and any(one.connectivity.cell_count for one in sequence.objects):
        reading["solids"] = "keep"
    if velocities is not None and not entry.holds_velocities:
        raise SettingsError(
            f"{entry.title} holds no velocities; leave them out, or write a separate file",
            code="setting-unsupported",
            path=where,
        )
    read, written = input_files(str(source)), output_files(str(where))
    shared = set(map(os.path.realpath, read)) & set(map(os.path.realpath, written))
    if shared:
        raise SettingsError(
            f"would replace {os.path.basename(shared.pop())}, which the original consists of",
            code="overwrites-input",
            path=where,
        )
    writer = load(entry, entry.onto, "written onto", where)
    placed = bake_transforms(sequence)
    speeds = None if velocities is None else bake_transforms(velocities)
    rate = sequence.fps if fps is None else fps
    output = Output(
        path=where,
        rate=rate,
        overwrite=overwrite,
        velocities=speeds,
        progress=progress,
        layer=layer,
        is_filled=is_filled,
        rigid=rigid,
        **asked,
    )
    with (
        asset_folders_allowed(asset_folders),
        open_sequence(source, **reading, skip_unsupported=True) as there,
        naming_file(where),
    ):
        _check_space(placed, there, source)
        matches, notices = match_objects(placed, there, source)
        if entry.times != "exact":
            notices += times_kept(sequence.times, entry.times, title=entry.title)
        # A carried scene already holds these fields without loss.
        if names := [] if is_filled else sorted({one.name for one in sequence.runs[0].fields}):
            notices += (f"fields not kept: {', '.join(names)}",)
        return (*notices, *writer(placed, there, matches, source, output))


def _check_space(sequence: MeshSequence, original: MeshSequence, source: Path) -> None:
    """Raise InputError if a sequence is known to have another up axis or unit than the original."""
    ours, theirs = up_axis_of(sequence), up_axis_of(original)
    if ours and theirs and ours != theirs:
        raise InputError(
            f"{UP_AXIS} is {ours}, and {theirs} in {source.name}",
            code="object-mismatch",
            setting="up_axis",
            value=theirs,
            purpose="to turn it",
        )
    mine, its = metres_per_unit(sequence), metres_per_unit(original)
    if mine and its and abs(mine - its) > 1e-6 * its:
        raise InputError(
            f"a {UNIT} is {mine:g} m, and {its:g} m in {source.name}",
            code="object-mismatch",
            setting="scale",
            value=f"{mine / its:g}",
            purpose="to convert it",
        )


def match_objects(
    sequence: MeshSequence, original: MeshSequence, source: Path
) -> tuple[tuple[Fitted, ...], tuple[str, ...]]:
    """Match each object of a sequence with the object of the original that it moves; return notices about other
    objects.

    Raises
    ------
    InputError
        If the original lacks an object, or its vertices, faces or lines differ.
    """
    theirs_by_name = _indices_by_name(original)
    notices: tuple[str, ...] = ()
    ours_by_name = _indices_by_name(sequence)
    if not theirs_by_name.keys() & ours_by_name.keys() and len(sequence.objects) == len(original.objects):
        theirs_by_name = ours_by_name
        notices = (f"no object name occurs in {source.name}: objects are matched in order",)
    for name, alike in ours_by_name.items():
        if name in theirs_by_name and len(alike) != len(theirs_by_name[name]):
            raise InputError(
                f"is ambiguous: {len(alike)} have this name, and {len(theirs_by_name[name])} in {source.name}; "
                "encode a clip of that file",
                code="ambiguous-input",
                object=name,
                setting="objects",
                purpose="to leave them out",
            )
    found = []
    next_of = {name: iter(alike) for name, alike in theirs_by_name.items()}
    for item, own in zip(sequence.objects, vertex_slices(sequence.objects), strict=True):
        if item.name not in theirs_by_name:
            known = listed([one.name for one in original.objects])
            message = f"is not in {source.name}, which has {known}; give it the same name"
            raise InputError(message, code="object-missing", object=item.name)
        index = next(next_of[item.name])
        theirs = original.objects[index]
        if item.vertex_count != theirs.vertex_count:
            raise InputError(
                f"has {item.vertex_count} vertices, and {theirs.vertex_count} in {source.name}; "
                "encode a clip of that file",
                code="object-mismatch",
                object=item.name,
            )
        if not item.connectivity.same_as(theirs.connectivity):
            raise InputError(
                f"has other faces or lines than in {source.name}, or vertices in another order (a free vertex order); "
                "encode a clip of that file",
                code="object-mismatch",
                object=item.name,
            )
        found.append(Fitted(item, own, index))
    moved = {one.index for one in found}
    left = [item.name for index, item in enumerate(original.objects) if index not in moved]
    if left:
        notices = (*notices, f"unchanged from {source.name}: {listed(left)}")
    return tuple(found), notices


def _indices_by_name(sequence: MeshSequence) -> dict[str, list[int]]:
    """Return the indices of a sequence's objects by name, in order; siblings in glTF may share a name."""
    by_name: dict[str, list[int]] = {}
    for index, item in enumerate(sequence.objects):
        by_name.setdefault(item.name, []).append(index)
    return by_name


def corner_order(stored: NDArray[np.integer], connectivity: Connectivity) -> Int64Array:
    """Return the object's corner for each corner of the file's faces, which may be reversed: (corners,) int64."""
    if np.array_equal(stored, connectivity.face_indices):
        return np.arange(stored.size)
    return reversed_corners(connectivity.face_counts)


class ShapePlacement:
    """Placement of a shape of the original in the scene, to bring data of the scene into the shape's own space.

    Parameters
    ----------
    at : callable
        Returns (n, 4, 4) float64 matrices from the shape's space to the scene's at times (n,) [s], for points as rows.
    times : (frames,) float64 [s]
    name : str
        Name of the object.
    """

    def __init__(self, at: Callable[[Float64Array], Float64Array], times: Float64Array, name: str) -> None:
        self._at, self._times, self._name = at, times, name
        self.matrices = at(times)
        self._is_identity = np.array_equal(self.matrices, np.broadcast_to(np.eye(4), self.matrices.shape))
        self._slopes: Float64Array | None = None

    @property
    def is_constant(self) -> bool:
        """Whether its transform is the same at every frame."""
        return bool((self.matrices == self.matrices[:1]).all())

    def points(self, scene: Float32Array, start: int) -> Float32Array:
        """Transform positions (frames, vertices, 3) of the frames from `start` on into the shape's space.

        A flattening transform has no inverse: of the points that it maps to a position, the one nearest to the
        origin is taken.

        Raises
        ------
        InputError
            If the transform flattens an object that is not flat.
        """
        if self._is_identity:
            return scene
        matrices = self.matrices[:1] if self.is_constant else self.matrices[start : start + len(scene)]
        turns, moves = matrices[:, :3, :3], matrices[:, None, 3, :3]
        own: Float32Array = ((scene - moves) @ np.linalg.pinv(turns)).astype(np.float32)
        off = np.abs(own @ turns + moves - scene).max(axis=(1, 2), initial=0)
        bad = np.flatnonzero(~(off <= FLATTENED_TOLERANCE * np.abs(scene).max(initial=0)))
        if bad.size:
            raise InputError(
                "is under a transform that flattens it, which no motion of its own can reproduce; leave it out",
                code="unsupported-feature",
                object=self._name,
                frame=start + int(bad[0]),
            )
        return own

    def normals(self, scene: Float32Array, frame: int) -> Float32Array:
        """Transform unit normals (rows, 3) of a frame into the shape's space."""
        if self._is_identity:
            return scene
        turned = scene @ self.matrices[frame, :3, :3].T
        lengths = np.linalg.norm(turned, axis=1, keepdims=True)
        return np.where(lengths > 0, turned / np.where(lengths > 0, lengths, 1), scene).astype(np.float32)

    def velocities(self, scene: Float32Array, own: Float32Array, start: int) -> Float32Array:
        """Return velocities (frames, vertices, 3) without the shape's own motion; `own` are positions in its space."""
        if self._is_identity:
            return scene
        if self._slopes is None:
            before, after = (
                np.clip(self._times + step, self._times[0], self._times[-1])
                for step in (-SLOPE_HALF_SECONDS, SLOPE_HALF_SECONDS)
            )
            steps = np.maximum(after - before, SLOPE_HALF_SECONDS)[:, None, None]
            self._slopes = (self._at(after) - self._at(before)) / steps
        slopes = self._slopes[start : start + len(scene)]
        carried = own @ slopes[:, :3, :3] + slopes[:, None, 3, :3]
        turns = self.matrices[start : start + len(scene), :3, :3]
        found: Float32Array = ((scene - carried) @ np.linalg.pinv(turns)).astype(np.float32)
        return found


class ShapeOver(ABC):
    """Writer that replaces the samples of one shape of the original.

    Parameters
    ----------
    own : slice
        The shape's vertices in the sequence.
    placed : ShapePlacement
    rows : NormalRows or None
        Rows of its normals, if it has any.
    gather : (points,) int32 or None
        Vertex of each point of its curves, unless these are all vertices in order.
    """

    def __init__(self, own: slice, placed: ShapePlacement, rows: NormalRows | None, gather: Int32Array | None) -> None:
        self._own, self._placed, self._rows, self._gather = own, placed, rows, gather

    def write(self, block: Float32Array, speeds: Float32Array | None, start: int) -> None:
        """Write samples of the frames from `start` on; positions and velocities are those of all objects."""
        self._write(
            block[:, self._own], None if speeds is None else speeds[:, self._own], range(start, start + len(block))
        )

    def _write(self, scene: Float32Array, speeds: Float32Array | None, frames: Sequence[int]) -> None:
        """Write samples of the shape at some frames, which follow one another unless its transform is constant."""
        points = self._placed.points(scene, frames[0])
        moving = None if speeds is None else self._placed.velocities(speeds, points, frames[0])
        normals = iter([None] * len(points)) if self._rows is None else self._rows.of_each(scene)
        if self._gather is not None:
            points = points[:, self._gather]
            moving = None if moving is None else moving[:, self._gather]
        for number, (frame, rows) in enumerate(zip(frames, normals, strict=False)):
            turned = None if rows is None else self._placed.normals(rows, frame)
            self._sample(frame, points[number], None if moving is None else moving[number], turned)

    @abstractmethod
    def _sample(
        self, frame: int, points: Float32Array, speeds: Float32Array | None, normals: Float32Array | None
    ) -> None:
        """Write the sample of a frame, in the shape's own space."""


def write_over(
    shapes: Sequence[ShapeOver],
    sequence: MeshSequence,
    output: Output,
    title: str,
    before: Callable[[int], None] = lambda frames: None,
) -> Iterator[range]:
    """Write samples of all shapes block by block, and yield the frames of each block.

    `before` is called with the frame count of each block before it is written.
    """
    for start, block in output.blocks(sequence, title):
        before(len(block))
        speeds = None if output.velocities is None else output.velocities.read_frames(start, start + len(block))
        for shape in shapes:
            shape.write(block, speeds, start)
        yield range(start, start + len(block))
