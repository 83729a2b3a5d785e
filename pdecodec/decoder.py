"""The decoder: a `.pdeanim` file as a mesh sequence that gives positions at any time."""

from __future__ import annotations

import io
import os
import threading
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO, Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.attributes import decode_attributes
from pdecodec.connectivity import BYTES_PER_CORNER, decode_connectivity, decode_vertex_counts
from pdecodec.container import ContainerReader
from pdecodec.description import decode_remarks, decode_sequence_description
from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError
from pdecodec.groupmodel import GroupModelDescription
from pdecodec.groups import CHUNK_SECTIONS, GroupTable, read_group_table
from pdecodec.motion import Motion
from pdecodec.paperform import PaperForm, paper_form
from pdecodec.patches import early_patches
from pdecodec.reference import RestShape, decode_rest
from pdecodec.resample import Outside, times_inside
from pdecodec.sequence import MeshObject, MeshSequence, check_frame_range
from pdecodec.spacebasis import SpaceBasis, decode_space_basis

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

KNOWN_SECTIONS = frozenset({"META", "SEQN", "CONN", "ORDR", "REST", "MODL", "GRUP", *CHUNK_SECTIONS, "ATTR"})

DEFAULT_MAX_MEMORY = 4 * 2**30
"""Bytes a file may ask for while it is opened and decoded: some five million vertices."""

BYTES_PER_VERTEX = 600
"""Peak memory of a mesh, per vertex: curves, reference frame, and twelve float64 functions each, twice."""

BYTES_PER_FRAME = 96
"""Peak memory of opening a file, per frame: times, their spline, a row of the table of groups."""


@dataclass(frozen=True, kw_only=True)
class DecodeLimits:
    """What a file may cost.

    Parameters
    ----------
    max_memory : int [bytes]
        A file that declares more than fits is refused before memory is taken (LimitError).
    """

    max_memory: int = DEFAULT_MAX_MEMORY


def open_animation(source: str | os.PathLike[str] | bytes, *, limits: DecodeLimits | None = None) -> Animation:
    """Open a `.pdeanim` file; ``pdecodec.open`` is the same.

    Parameters
    ----------
    source : path-like or bytes
        The file's path, or the whole file in memory.
    limits : DecodeLimits, optional

    Returns
    -------
    Animation
        Close it, or use it in a ``with`` statement: each part is read from the file when it is needed.

    Raises
    ------
    InputError
        If the file cannot be opened.
    CorruptFileError
        If it is damaged, truncated, of another kind or a later major version.
    LimitError
        If it asks for more memory than `limits` allow.
    """
    if isinstance(source, bytes):
        return Animation(io.BytesIO(source), "bytes in memory", limits or DecodeLimits())
    try:
        file = Path(source).open("rb")  # noqa: SIM115 - the animation keeps it open until it is closed
    except OSError as error:
        raise InputError(f"cannot be opened ({error.strerror})", path=source) from error
    try:
        return Animation(file, os.fspath(source), limits or DecodeLimits())
    except BaseException:
        file.close()
        raise


class Animation(MeshSequence):
    """A `.pdeanim` file: a mesh sequence, and a mesh at any time between its first and its last frame.

    Made by :func:`open_animation`. Opening reads headers alone, and the vertex counts that the mesh begins with; the
    mesh, attributes and groups of frames are decoded when they are first needed. At the time of a frame every method
    gives the same bits. It may be used from several threads; they take turns.
    """

    def __init__(self, file: BinaryIO, path: str, limits: DecodeLimits) -> None:
        self.path, self.notices = path, ()
        self._file, self._limits, self._left = file, limits, limits.max_memory
        self._lock = threading.RLock()
        with self._naming_the_file():
            container = self._container = ContainerReader(file, path)
            container.check_known(KNOWN_SECTIONS)
            description = decode_sequence_description(container.read("SEQN"), limits.max_memory // BYTES_PER_FRAME)
            self._description = description
            self._vertex_counts, self._polygons = decode_vertex_counts(container.read("CONN"))
            self.times, self.fps = description.times, description.fps
            self._table: GroupTable = read_group_table(container.read("GRUP"), self.frame_count)
            self._table.check_sections(container)
            self._model = GroupModelDescription.from_bytes(container.read("MODL"))
            self._take(BYTES_PER_FRAME * self.frame_count, f"{self.frame_count} frames")
            self._take(BYTES_PER_VERTEX * self.vertex_count, f"{self.vertex_count} vertices")

    @contextmanager
    def _naming_the_file(self) -> Iterator[None]:
        # The parts below know their section, not the file. Numbers of a hostile file may overflow: no warnings.
        try:
            with np.errstate(all="ignore"):
                yield
        except CorruptFileError as error:
            if error.path is not None:
                raise
            raise type(error)(error.message, path=self.path, frame=error.frame, offset=error.offset) from error
        except MemoryError as error:
            raise LimitError("needs more memory than there is; lower the memory limit", path=self.path) from error

    def _take(self, needed: int, what: str) -> None:
        """Count what a file declares against the memory limit, before memory is taken."""
        if needed > self._left:
            most = self._limits.max_memory
            message = f"declares {what}, about {needed + most - self._left} bytes to decode; the limit is {most}"
            raise LimitError(f"{message}; raise it if you trust the file")
        self._left -= needed

    @property
    def vertex_count(self) -> int:
        return sum(self._vertex_counts)

    @property
    def objects(self) -> tuple[MeshObject, ...]:  # type: ignore[override]  # decoded when it is first needed
        with self._lock, self._naming_the_file():
            return self._objects

    @property
    def meshes(self) -> tuple[MeshObject, ...]:
        """The objects without their attributes, for which the reference frame need not be decoded."""
        with self._lock, self._naming_the_file():
            return self._meshes

    # What is cached is only taken with the lock held: Python 3.11 has one lock a cached property, taken after it.

    @cached_property
    def _objects(self) -> tuple[MeshObject, ...]:
        if "ATTR" not in self._container.entries:
            return self._meshes
        levels = self._reference.levels
        return tuple(decode_attributes(self._container.read("ATTR"), self._meshes, levels, self._left))

    @cached_property
    def _meshes(self) -> tuple[MeshObject, ...]:
        """Sections CONN and ORDR."""
        order = self._container.read("ORDR") if "ORDR" in self._container.entries else b""
        counts, most = self._vertex_counts, self._left // BYTES_PER_CORNER
        parts = decode_connectivity(counts, self._polygons, order, most)
        self._left -= BYTES_PER_CORNER * sum(part.face_indices.size + part.line_indices.size for part in parts)
        names = self._description.names(len(counts), lambda size: self._take(size, "names of objects"))
        return tuple(MeshObject(name, part) for name, part in zip(names, parts, strict=True))

    @cached_property
    def _reference(self) -> RestShape:
        return decode_rest(self._container.read("REST"), self._meshes)

    @cached_property
    def _reference_and_space(self) -> tuple[RestShape, SpaceBasis]:
        """Section REST, and the functions of space that MODL describes."""
        model, meshes = self._model, self._meshes
        # The patches of most meshes follow from connectivity alone: they are made while the reference is decoded.
        with ThreadPoolExecutor(1) as pool:
            found = pool.submit(early_patches, meshes, model.form.points) if model.form.kind == "patch" else None
            reference = self._reference
            early = found.result() if found else None
        return reference, decode_space_basis(model.form, model.masks, meshes, reference.levels, early)

    @cached_property
    def _motion(self) -> Motion:
        reference, space = self._reference_and_space
        return Motion(self._container, self._table, self._model, self.times, reference, space, self._left)

    @cached_property
    def _remarks(self) -> dict[str, Any]:
        return decode_remarks(self._container.read("META")) if "META" in self._container.entries else {}

    @property
    def metadata(self) -> dict[str, str]:  # type: ignore[override]  # read when it is first needed
        with self._lock, self._naming_the_file():
            found = self._remarks.get("metadata", {})
        return {str(key): str(value) for key, value in found.items()} if isinstance(found, dict) else {}

    def close(self) -> None:
        self._file.close()

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        return self.sample(self.times[start:stop])

    def positions(self, times: ArrayLike, *, outside: Outside = "clamp") -> Float32Array:
        """Positions at one time or at several.

        Parameters
        ----------
        times : float or (n,) array [s]
            In any order.
        outside : {"clamp", "loop", "refuse"}
            What holds before the first and after the last frame: that frame, the clip again, an error.

        Returns
        -------
        (vertices, 3) or (n, vertices, 3) float32 [scene units]

        Raises
        ------
        SettingsError
            If a time is not a number, or lies outside and that is refused.
        CorruptFileError
            If a group that is needed is damaged.
        """
        if np.ndim(times) == 0:
            single: Float32Array = self.sample(np.atleast_1d(times), outside=outside)[0]
            return single
        return self.sample(times, outside=outside)

    def sample(self, times: ArrayLike, *, out: Float32Array | None = None, outside: Outside = "clamp") -> Float32Array:
        """Positions at several times, into an array of the caller's if there is one.

        Parameters
        ----------
        times : (n,) array [s]
            In any order.
        out : (n, vertices, 3) float32, optional
            Written and returned; after an error it may hold anything.
        outside : {"clamp", "loop", "refuse"}
            As in :meth:`positions`.

        Returns
        -------
        (n, vertices, 3) float32 [scene units]
        """
        inside = self._inside(times, outside)
        shape = (inside.size, self.vertex_count, 3)
        if out is not None and (out.shape != shape or out.dtype != np.float32):
            raise SettingsError(f"the array to write to must be float32 {shape}, not {out.dtype} {out.shape}")
        order = np.argsort(inside, kind="stable")
        is_in_order = np.array_equal(order, np.arange(order.size))
        # Page by page, memory that is new costs as much as decoding into it: the caller's is taken where it can be.
        is_direct = is_in_order and out is not None and out.flags.c_contiguous
        found = out if is_direct and out is not None else np.empty(shape, np.float32)
        with self._lock, self._naming_the_file():
            self._motion.positions(inside[order], found)
        if is_direct or (is_in_order and out is None):
            return found
        result = np.empty_like(found) if out is None else out
        result[order] = found
        return result

    def velocities(self, times: ArrayLike, *, outside: Outside = "clamp") -> Float32Array:
        """Velocity of every vertex at one time or at several: the exact derivative of the positions.

        Residuals change at constant speed from one frame to the next; at a frame the speed to the next
        one counts. Where positions are held (clamped) outside the clip nothing moves.

        Parameters
        ----------
        times : float or (n,) array [s]
        outside : {"clamp", "loop", "refuse"}
            As in :meth:`positions`.

        Returns
        -------
        (vertices, 3) or (n, vertices, 3) float32 [scene units / s]
        """
        return self._derivatives(1, times, outside)

    def accelerations(self, times: ArrayLike, *, outside: Outside = "clamp") -> Float32Array:
        """As :meth:`velocities`, the second derivative [scene units / s^2]; residuals have none."""
        return self._derivatives(2, times, outside)

    def _derivatives(self, order: Literal[1, 2], times: ArrayLike, outside: Outside) -> Float32Array:
        asked = np.atleast_1d(np.asarray(times, dtype=np.float64))
        inside = self._inside(asked, outside)
        moving = (outside == "loop") | ((asked >= self.times[0]) & (asked <= self.times[-1]))
        out = np.zeros((asked.size, self.vertex_count, 3), np.float32)
        with self._lock, self._naming_the_file():
            for row in np.flatnonzero(moving):
                out[row] = self._motion.derivative(order, inside[row])
        return out if np.ndim(times) else out[0]

    def _inside(self, times: ArrayLike, outside: Outside) -> Float64Array:
        asked = np.asarray(times, dtype=np.float64)
        if asked.ndim != 1 or np.isnan(asked).any():
            raise SettingsError("times must be a number or a list of numbers")
        return times_inside(asked, float(self.times[0]), float(self.times[-1]), outside)

    def coefficients(self, group: int) -> PaperForm:
        """The coefficients of one group as the paper writes them (Eqs. 17 and 18), and all that they multiply.

        Parameters
        ----------
        group : int
            0 to ``info()["groups"] - 1``.

        Raises
        ------
        SettingsError
            If the file was encoded with functions that are not the paper's 32, or there is no such group.
        """
        if not 0 <= group < len(self._table.entries):
            raise SettingsError(f"there is no group {group}; the file has {len(self._table.entries)}, from 0 on")
        with self._lock, self._naming_the_file():
            reference, space = self._reference_and_space
            return paper_form(self._model, reference, space, self._motion, group, int(self._table.firsts[group]))

    @property
    def sections(self) -> dict[str, int]:
        """Bytes of each section, and of header and table as ``"container"``; the sum is the file."""
        sizes = {name: entry.length for name, entry in self._container.entries.items()}
        return {"container": self._container.file_bytes - sum(sizes.values()), **sizes}

    def info(self) -> dict[str, Any]:
        """What the headers say of the file, as a JSON object: sections, model, settings, and why this model."""
        entries = self._table.entries
        with self._lock, self._naming_the_file():
            remarks = self._remarks
        return {
            "file_bytes": self._container.file_bytes,
            "ratio": 12 * self.frame_count * self.vertex_count / self._container.file_bytes,
            "sections": self.sections,
            "summary": str(remarks.get("summary", "")),
            "generator": str(remarks.get("generator", "")),
            "settings": remarks.get("settings", {}),
            "time_bases": sorted({entry.basis for entry in entries}),
            "space_basis": self._model.form.kind,
            "functions_of_time": max(entry.functions for entry in entries),
            "groups": len(entries),
            "group_frames": [min(entry.frames for entry in entries), max(entry.frames for entry in entries)],
        }

    def verify(self) -> None:
        """Check every byte of the file, and that every part and every group decodes.

        Raises
        ------
        CorruptFileError
            If one does not.
        """
        with self._lock, self._naming_the_file():
            self._container.verify()
            _ = self._objects, self._remarks
            self._motion.decode_everything()
