"""Copy an Alembic archive with another motion: all objects and properties stay, positions and normals are replaced.

The library cannot change a file, so a new one is written, property by property. Transforms stay; positions are
converted to the space of their shapes.
"""

from __future__ import annotations

import itertools
import json
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import imath
from alembic3d import Abc, AbcGeom

from pdecodec.formats.alembic.attributes import FPS_PROPERTY, METADATA_PROPERTY
from pdecodec.formats.alembic.ogawa import read_info, replace_info
from pdecodec.formats.alembic.reader import AlembicSequence
from pdecodec.formats.alembic.values import SCOPES, Keep, normal_sample, to_numpy, unsigned_array, vector_array
from pdecodec.formats.alembic.writer import OBJECT_BYTES, SAMPLE_BYTES, archive_file, time_sampling
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.normals import normal_rows
from pdecodec.formats.base.onto import Fitted, ShapeOver, ShapePlacement, corner_order, write_over
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.scene_writing import find_shape_form
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshObject, MeshSequence
from pdecodec.system.whole_output import ReservedRoom

_GEOMETRY, _POSITIONS, _VELOCITIES, _NORMALS, _BOUNDS = ".geom", "P", ".velocities", "N", ".selfBnds"
"""Names of a shape's properties that depend on its positions."""

_CHILD_BOUNDS = ".childBnds"
"""Bounds of the objects below an object. They are dropped, because they belong to the original's motion."""

_WRITTEN = (_POSITIONS, _VELOCITIES, _NORMALS, _BOUNDS)

_CONSTANT = (".faceIndices", ".faceCounts", "nVertices", ".pointIds")
"""Properties with as many samples as positions, but equal ones."""


def write_alembic_onto(
    sequence: MeshSequence, original: AlembicSequence, fits: Sequence[Fitted], source: Path, output: Output
) -> tuple[str, ...]:
    """Write a copy of the original in which its shapes move as in a sequence."""
    with archive_file(output) as path:
        notices = _Copy(sequence, original, fits, source, output, path).write()
        if output.is_filled:
            replace_info(path, read_info(source))
        return notices


def _archive_like(original: AlembicSequence, path: Path) -> Any:
    """Open an archive for writing that says which program wrote the original, and its description."""
    told = Abc.GetArchiveInfo(original.top.getArchive())
    # The library ends the process if it is to write separators of its own record.
    program, description = (re.sub("[;=]", " ", told[key]) for key in ("appName", "userDescription"))
    return Abc.CreateArchiveWithInfo(str(path), program, description)


def moved_shapes(original: AlembicSequence, fits: Sequence[Fitted], *, keeps_instances: bool) -> dict[str, Fitted]:
    """Return the objects that a motion replaces, by path. `keeps_instances` leaves out instances, and what they are
    instances of: a carried scene holds these as they were.
    """
    paths = {original.shapes[one.index].node.getFullName(): one for one in fits}
    kept = {path for pair in _instances(original.top) for path in pair} if keeps_instances else set()
    return {path: one for path, one in paths.items() if not any(above in kept for above in _branch(path))}


def _instances(top: Any) -> Iterator[tuple[str, str]]:
    """Yield the path of each instance, and that of the object that it is an instance of."""
    left = [top]
    while left:
        item = left.pop()
        for child in map(item.getChild, range(item.getNumChildren())):
            if child.isInstanceRoot():
                yield child.getFullName(), child.instanceSourcePath()
            else:
                left.append(child)


def _branch(path: str) -> Iterator[str]:
    """Yield the paths of an object and of all above it."""
    return itertools.accumulate(path.split("/"), "{}/{}".format)


class _Copy:
    """An archive that is being written."""

    def __init__(
        self,
        sequence: MeshSequence,
        original: AlembicSequence,
        fits: Sequence[Fitted],
        source: Path,
        output: Output,
        path: Path,
    ) -> None:
        self._sequence, self._original, self._output = sequence, original, output
        self._moved = moved_shapes(original, fits, keeps_instances=output.is_filled)
        self._archive = _archive_like(original, path)
        self._room = ReservedRoom(path)
        # Alembic ends the process if there is no room for its last bytes, so room is reserved before anything is
        # written.
        described = 2 * source.stat().st_size + OBJECT_BYTES * len(fits)
        self._room.reserve(described + sequence.frame_count * 64 * len(fits))
        stored = original.top.getArchive()
        # The library takes one that is nearly equal for the same: those of the original come first.
        for number in range(stored.getNumTimeSamplings()):
            self._archive.addTimeSampling(stored.getTimeSampling(number))
        self._sampling = self._archive.addTimeSampling(time_sampling(sequence.times, output.rate))
        self._shapes: list[_ShapeOver] = []
        self._copies: dict[str, Any] = {}
        self._instances: list[tuple[Any, Any]] = []
        self._lost: dict[str, None] = {}

    def write(self) -> tuple[str, ...]:
        top = self._archive.getTop()
        self._copy_object(self._original.top, top)
        for parent, child in self._instances:
            parent.addChildInstance(self._copies[child.instanceSourcePath()], child.getName())
        own, is_filled = self._original.top.getProperties(), self._output.is_filled
        if own.getPropertyHeader(FPS_PROPERTY) is None and not is_filled:
            Abc.ODoubleProperty(top.getProperties(), FPS_PROPERTY).setValue(self._output.rate)
        if own.getPropertyHeader(METADATA_PROPERTY) is None and self._original.metadata and not is_filled:
            # For an archive itself, the library writes nothing but its own version.
            text = json.dumps(dict(self._original.metadata), sort_keys=True)
            Abc.OStringProperty(top.getProperties(), METADATA_PROPERTY).setValue(text)
        frame_bytes = sum(shape.frame_bytes for shape in self._shapes)
        for _ in write_over(
            self._shapes,
            self._sequence,
            self._output,
            "Alembic",
            lambda frames: self._room.reserve(frames * frame_bytes),
        ):
            pass
        return not_kept(self._lost)

    def _copy_object(self, old: Any, new: Any) -> None:
        path = old.getFullName()
        self._copies[path] = new
        self._copy_properties(old.getProperties(), new.getProperties(), path)
        for index in range(old.getNumChildren()):
            child = old.getChild(index)
            if child.isInstanceRoot() and not self._has_moved(child.getFullName(), child.instanceSourcePath()):
                self._instances.append((new, child))
            else:
                self._copy_object(child, Abc.OObject(new, child.getName(), child.getMetaData()))

    def _has_moved(self, *paths: str) -> bool:
        """Return whether one of the moved shapes is at or below one of these paths."""
        return any(moved == path or moved.startswith(f"{path}/") for moved in self._moved for path in paths)

    def _copy_properties(self, old: Any, new: Any, path: str, fit: Fitted | None = None) -> None:
        """Copy the properties of an object. For a moved shape, `fit`, leave out those that are written anew."""
        headers = [old.getPropertyHeader(index) for index in range(old.getNumProperties())]
        # A scene that was carried has the bounds and velocities of the same motion.
        is_filled, has_others = self._output.is_filled, self._output.velocities is None
        for header in headers:
            name = header.getName()
            if name == _CHILD_BOUNDS and not is_filled:
                self._lost["bounds of children"] = None
            elif name == _VELOCITIES and fit is not None and has_others and not is_filled:
                self._lost["velocities, which change with the motion, and are written on request"] = None
            elif fit is not None and name in _WRITTEN and not (name == _VELOCITIES and has_others):
                continue
            elif header.isCompound():
                inner = Abc.OCompoundProperty(new, name, header.getMetaData())
                moving = self._moved.get(path) if name == _GEOMETRY else None
                self._copy_properties(Abc.ICompoundProperty(old, name), inner, path, moving)
            else:
                try:
                    self._copy_samples(old, new, header, most=1 if fit is not None and name in _CONSTANT else None)
                except RuntimeError:
                    # Numbers that the Python binding has no type for.
                    self._lost[f"{path}/{name}"] = None
        if fit is not None:
            there = {header.getName(): header for header in headers}
            shape = self._original.shapes[fit.index]
            # No reference cycle may include the archive: it is complete once it is closed, which happens when it is
            # released.
            placed = ShapePlacement(partial(self._original.shape_matrices, shape), self._sequence.times, fit.item.name)
            # Normals hold nothing in a scene that was carried: which corners share one is in the attributes.
            item = fit.item if is_filled else self._original.objects[fit.index]
            self._shapes.append(_ShapeOver(new, old, there, fit.own, item, placed, self._sampling, self._output))

    def _copy_samples(self, old: Any, new: Any, header: Any, most: int | None) -> None:
        reader, writer = Abc.IArrayProperty, Abc.OArrayProperty
        if header.isScalar():
            reader, writer = Abc.IScalarProperty, Abc.OScalarProperty
        stored = reader(old, header.getName())
        sampling, samples = stored.getTimeSampling(), stored.getNumSamples()
        values = [stored.getValue(Abc.ISampleSelector(float(sampling.getSampleTime(0))))] if samples else []
        number = self._archive.addTimeSampling(sampling)
        copy = writer(new, header.getName(), header.getDataType(), header.getMetaData(), number)
        for index in range(samples if most is None else min(most, samples)):
            value = values[0] if not index else stored.getValue(Abc.ISampleSelector(sampling.getSampleTime(index)))
            copy.setValue(value)


class _ShapeOver(ShapeOver):
    """Positions, bounds, normals and velocities of a shape whose other properties were copied."""

    def __init__(
        self,
        new: Any,
        old: Any,
        headers: Mapping[str, Any],
        own: slice,
        item: MeshObject,
        placed: ShapePlacement,
        sampling: int,
        output: Output,
    ) -> None:
        rows = normal_rows(item) if _NORMALS in headers and item.connectivity.face_count else None
        super().__init__(
            own,
            placed,
            rows,
            None if find_shape_form(item.connectivity).gather is None else item.connectivity.line_indices,
        )
        position = headers[_POSITIONS]
        self._points = Abc.OArrayProperty(new, _POSITIONS, position.getDataType(), position.getMetaData(), sampling)
        self._bounds = Abc.OBox3dProperty(new, _BOUNDS, headers[_BOUNDS].getMetaData(), sampling)
        self._speeds = None if output.velocities is None else Abc.OV3fArrayProperty(new, _VELOCITIES, sampling)
        self._corner_rows: Any = None
        if rows is not None:
            stored = to_numpy(Abc.IInt32ArrayProperty(old, ".faceIndices").getValue())
            order = corner_order(stored, item.connectivity)
            smooth = rows.is_smooth
            self._corner_rows = None if smooth else unsigned_array(rows.corner_rows[order])
            scope = SCOPES["vertex" if smooth else "corner"]
            self._normals = AbcGeom.ON3fGeomParam(new, _NORMALS, not smooth, scope, 1, sampling)

    @property
    def frame_bytes(self) -> int:
        """Largest size of a sample [bytes]."""
        normals = 0 if self._rows is None else self._rows.count + len(self._rows.corner_rows)
        points = self._own.stop - self._own.start if self._gather is None else len(self._gather)
        return 4 * SAMPLE_BYTES + 12 * (points * (1 if self._speeds is None else 2) + normals)

    def _sample(
        self, frame: int, points: Float32Array, speeds: Float32Array | None, normals: Float32Array | None
    ) -> None:
        self._points.setValue(vector_array(points))
        low, high = (imath.V3d(*end.tolist()) for end in (points.min(axis=0), points.max(axis=0)))
        self._bounds.setValue(imath.Box3d(low, high))
        if normals is not None:
            keep = Keep()
            self._normals.set(normal_sample(normals, self._corner_rows, keep))
        if self._speeds is not None and speeds is not None:
            self._speeds.setValue(vector_array(speeds))
