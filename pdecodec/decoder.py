"""The decoder: a `.pdeanim` file as a mesh sequence that can be asked for any time."""

from __future__ import annotations

import io
import os
from abc import abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.container import ContainerReader
from pdecodec.description import decode_attributes, decode_remarks, decode_sequence_description
from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError
from pdecodec.paperform import PaperForm
from pdecodec.resample import Outside, times_inside
from pdecodec.sequence import Connectivity, MeshObject, MeshSequence, check_frame_range

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

DEFAULT_MAX_MEMORY = 4 * 2**30
"""Bytes a file may ask for while it is opened and decoded: some five million vertices."""

BYTES_PER_VERTEX = 600
"""Peak memory of opening a file, per vertex: curves, rest shape, and twelve float64 functions each, twice."""

BYTES_PER_COEFFICIENT = 64
"""Peak memory of a segment, per coefficient: a float64 in each segment kept, unpacked through four int64."""

CACHE_BYTES = 64 * 2**20
"""Memory for decoded segments: all of most clips, so that scrubbing does not decode one twice."""


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
        Close it, or use it in a ``with`` statement: segments are read from the file when they are asked for.

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
        return _open_file(io.BytesIO(source), "bytes in memory", limits or DecodeLimits())
    try:
        file = Path(source).open("rb")  # noqa: SIM115 - the animation keeps it open until it is closed
    except OSError as error:
        raise InputError(f"cannot be opened ({error.strerror})", path=source) from error
    try:
        return _open_file(file, os.fspath(source), limits or DecodeLimits())
    except BaseException:
        file.close()
        raise


def _open_file(file: BinaryIO, path: str, limits: DecodeLimits) -> Animation:
    container = ContainerReader(file, path)
    if container.major_version == 1:
        from pdecodec.segmentanimation import SegmentAnimation

        return SegmentAnimation(container, file, limits)
    from pdecodec.groupanimation import GroupAnimation

    return GroupAnimation(container, file, limits)


class Animation(MeshSequence):
    """A `.pdeanim` file: a mesh sequence, and a mesh at any time between its first and its last frame.

    Made by :func:`open_animation`. At the time of a frame every method gives the same bits.
    """

    KNOWN_SECTIONS: ClassVar[frozenset[str]]
    """Those of its major version."""

    BYTES_PER_CORNER: ClassVar[int]
    """Peak memory of opening a file, per face corner and line point."""

    def __init__(self, container: ContainerReader, file: BinaryIO, limits: DecodeLimits) -> None:
        self.path = container.path
        self.notices = ()
        self._file = file
        self._limits = limits
        with self._naming_the_file():
            self._container = container
            container.check_known(self.KNOWN_SECTIONS)
            self._open()

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

    def _open(self) -> None:
        container, most = self._container, self._limits.max_memory
        description = decode_sequence_description(
            container.read("SEQN"), self._open_table(), major=container.major_version
        )
        vertices = sum(description.vertex_counts)
        self._check_memory(BYTES_PER_VERTEX * vertices, f"{vertices} vertices")
        left = most - BYTES_PER_VERTEX * vertices
        parts = self._decode_connectivity(description.vertex_counts, left // self.BYTES_PER_CORNER)
        left -= self.BYTES_PER_CORNER * sum(part.face_indices.size + part.line_indices.size for part in parts)
        objects = [MeshObject(name, part) for name, part in zip(description.names, parts, strict=True)]
        if "ATTR" in container.entries:
            objects = decode_attributes(container.read("ATTR"), objects, left)
        self.objects = tuple(objects)
        self.times, self.fps = description.times, description.fps
        self._remarks = decode_remarks(container.read("META")) if "META" in container.entries else {}
        metadata = self._remarks.get("metadata", {})
        self.metadata = {str(key): str(value) for key, value in metadata.items()} if isinstance(metadata, dict) else {}
        self._open_motion(left)

    @abstractmethod
    def _open_table(self) -> int:
        """Read the table of segments or groups; the number of frames."""

    @abstractmethod
    def _decode_connectivity(self, vertex_counts: Sequence[int], most_corners: int) -> list[Connectivity]:
        """The faces and lines of each object; LimitError for more than `most_corners` corners of all objects."""

    @abstractmethod
    def _open_motion(self, left: int) -> None:
        """Read the rest shape and the model; `left` bytes of memory are still free."""

    @abstractmethod
    def _evaluate(self, times: Float64Array, out: Float32Array) -> None:
        """Write positions at increasing times inside the clip, without corrections; `out` is contiguous."""

    def _model_at_frame(self, frame: int) -> Float32Array:
        """Positions (vertices, 3) at a frame, without corrections."""
        out: Float32Array = np.empty((1, self.vertex_count, 3), np.float32)
        self._evaluate(self.times[frame : frame + 1], out)
        return out.reshape(-1, 3)

    @abstractmethod
    def _add_frame_corrections(self, out: Float32Array, frame: int, weight: float) -> None:
        """Add one frame's corrections, in place."""

    @abstractmethod
    def _correction(self, frame: int) -> Float64Array:
        """(vertices, 3) float64: what the corrections of a frame add to its positions."""

    @abstractmethod
    def _model_derivative(self, order: int, time: float) -> Float64Array:
        """(vertices, 3) float64: derivative of the positions without corrections."""

    @abstractmethod
    def coefficients(self, segment: int) -> PaperForm:
        """The coefficients of one time segment as the paper writes them (Eqs. 17 and 18), with their conditioning.

        Parameters
        ----------
        segment : int
            0 to ``info()["segments"] - 1``.

        Raises
        ------
        SettingsError
            If the file was encoded with functions that are not the paper's 32.
        """

    @abstractmethod
    def model_info(self) -> dict[str, Any]:
        """What :meth:`info` says of the model."""

    @abstractmethod
    def _decode_everything(self) -> None:
        """Decode every segment or group; CorruptFileError with its first frame where one does not."""

    def _check_memory(self, needed: int, what: str) -> None:
        if needed > self._limits.max_memory:
            message = f"declares {what}, about {needed} bytes to decode; the limit is {self._limits.max_memory}"
            raise LimitError(f"{message}; raise it if you trust the file")

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
            If a segment that is needed is damaged.
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
        with self._naming_the_file():
            self._evaluate(inside[order], found)
            self._add_corrections(found, inside[order])
        if is_direct or (is_in_order and out is None):
            return found
        result = np.empty_like(found) if out is None else out
        result[order] = found
        return result

    def velocities(self, times: ArrayLike, *, outside: Outside = "clamp") -> Float32Array:
        """Velocity of every vertex at one time or at several: the exact derivative of the positions.

        Corrections change at constant speed from one frame to the next; at a frame the speed to the next
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
        """As :meth:`velocities`, the second derivative [scene units / s^2]; corrections have none."""
        return self._derivatives(2, times, outside)

    def _derivatives(self, order: int, times: ArrayLike, outside: Outside) -> Float32Array:
        asked = np.atleast_1d(np.asarray(times, dtype=np.float64))
        inside = self._inside(asked, outside)
        moving = (outside == "loop") | ((asked >= self.times[0]) & (asked <= self.times[-1]))
        out = np.zeros((asked.size, self.vertex_count, 3), np.float32)
        with self._naming_the_file():
            for row in np.flatnonzero(moving):
                out[row] = self._derivative(order, inside[row])
        return out if np.ndim(times) else out[0]

    def _derivative(self, order: int, time: float) -> Float64Array:
        if self.frame_count == 1:
            return np.zeros((self.vertex_count, 3))
        found = self._model_derivative(order, time)
        if order == 1:
            frame = min(int(np.searchsorted(self.times, time, side="right")), self.frame_count - 1)
            step = float(self.times[frame] - self.times[frame - 1])
            found += (self._correction(frame) - self._correction(frame - 1)) / step
        return found

    def _inside(self, times: ArrayLike, outside: Outside) -> Float64Array:
        asked = np.asarray(times, dtype=np.float64)
        if asked.ndim != 1 or np.isnan(asked).any():
            raise SettingsError("times must be a number or a list of numbers")
        return times_inside(asked, float(self.times[0]), float(self.times[-1]), outside)

    def _add_corrections(self, out: Float32Array, times: Float64Array) -> None:
        left = np.searchsorted(self.times, times, side="right") - 1
        for row, frame in enumerate(left.tolist()):
            if times[row] == self.times[frame]:
                self._add_frame_corrections(out[row], frame, 1.0)
                continue
            share = (times[row] - self.times[frame]) / (self.times[frame + 1] - self.times[frame])
            self._add_frame_corrections(out[row], frame, 1.0 - share)
            self._add_frame_corrections(out[row], frame + 1, share)

    @property
    def sections(self) -> dict[str, int]:
        """Bytes of each section, and of header and table as ``"container"``; the sum is the file."""
        sizes = {name: entry.length for name, entry in self._container.entries.items()}
        return {"container": self._container.file_bytes - sum(sizes.values()), **sizes}

    def info(self) -> dict[str, Any]:
        """What the file holds, as a JSON object: sections, model, settings, and why this model."""
        return {
            "file_bytes": self._container.file_bytes,
            "ratio": 12 * self.frame_count * self.vertex_count / self._container.file_bytes,
            "sections": self.sections,
            "summary": str(self._remarks.get("summary", "")),
            "generator": str(self._remarks.get("generator", "")),
            "settings": self._remarks.get("settings", {}),
            **self.model_info(),
        }

    def verify(self) -> None:
        """Check every byte of the file, and that every segment decodes.

        Raises
        ------
        CorruptFileError
            If one does not.
        """
        self._container.verify()
        with self._naming_the_file():
            self._decode_everything()
