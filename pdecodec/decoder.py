"""The decoder: a `.pdeanim` file as a mesh sequence that can be asked for any time."""

from __future__ import annotations

import io
import os
from collections import OrderedDict
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.coefficients import decode_segment, dequantise_segment
from pdecodec.connectivity import decode_connectivity
from pdecodec.container import ContainerReader
from pdecodec.corrections import FrameCorrections, add_corrections, decode_corrections
from pdecodec.curves import Curves, extract_curves, order_lonely_points
from pdecodec.description import decode_attributes, decode_remarks, decode_sequence_description
from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError
from pdecodec.model import Model, ModelDescription, SegmentCoefficients, build_model
from pdecodec.paperform import PaperForm, paper_form
from pdecodec.resample import Outside, times_inside
from pdecodec.restshape import RestShape, decode_rest
from pdecodec.segments import Segment, SegmentTable, read_segment_table, terms_at
from pdecodec.sequence import MeshObject, MeshSequence, check_frame_range

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

KNOWN_SECTIONS = frozenset({"META", "SEQN", "CONN", "REST", "MODL", "SEGM", "COEF", "CORR", "ATTR"})

DEFAULT_MAX_MEMORY = 4 * 2**30
"""Bytes a file may ask for while it is opened and decoded: some five million vertices."""

BYTES_PER_VERTEX = 600
"""Peak memory of opening a file, per vertex: curves, rest shape, and twelve float64 functions each, twice."""

BYTES_PER_CORNER = 80
"""Peak memory of opening a file, per face corner: connectivity, and the edges that curves are found on."""

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


@dataclass(frozen=True, eq=False)
class _DecodedSegment:
    coefficients: SegmentCoefficients
    corrections: list[FrameCorrections]

    @cached_property
    def nbytes(self) -> int:
        return self.coefficients.nbytes + sum(frame.nbytes for frame in self.corrections)


class Animation(MeshSequence):
    """A `.pdeanim` file: a mesh sequence, and a mesh at any time between its first and its last frame.

    Made by :func:`open_animation`. At the time of a frame every method gives the same bits.
    """

    def __init__(self, file: BinaryIO, path: str, limits: DecodeLimits) -> None:
        self.path = path
        self.notices = ()
        self._file = file
        self._limits = limits
        with self._naming_the_file():
            self._container = ContainerReader(file, path)
            self._container.check_known(KNOWN_SECTIONS)
            self._open()
        self._cache: OrderedDict[int, _DecodedSegment] = OrderedDict()
        self._cached_bytes = 0

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
        self._table: SegmentTable = read_segment_table(container.read("SEGM"))
        description = decode_sequence_description(container.read("SEQN"), self._table.frames)
        vertices = sum(description.vertex_counts)
        self._check_memory(BYTES_PER_VERTEX * vertices, f"{vertices} vertices")
        left = most - BYTES_PER_VERTEX * vertices
        parts = decode_connectivity(container.read("CONN"), description.vertex_counts, left // BYTES_PER_CORNER)
        left -= BYTES_PER_CORNER * sum(part.face_indices.size + part.line_indices.size for part in parts)
        objects = [MeshObject(name, part) for name, part in zip(description.names, parts, strict=True)]
        if "ATTR" in container.entries:
            objects = decode_attributes(container.read("ATTR"), objects, left)
        self.objects = tuple(objects)
        self.times, self.fps = description.times, description.fps
        self._segments: Sequence[Segment] = self._table.segments(self.times)
        curves = extract_curves(self.objects)
        rest = decode_rest(container.read("REST"), curves)
        curves = order_lonely_points(curves, rest.levels)
        self._description = ModelDescription.from_bytes(container.read("MODL"))
        self._model = self._build_model(curves, rest)
        self._left = left - BYTES_PER_COEFFICIENT * self._model.coefficients
        self._check_memory(most - self._left, f"{self._model.coefficients} coefficients a segment")
        self._remarks = decode_remarks(container.read("META")) if "META" in container.entries else {}
        metadata = self._remarks.get("metadata", {})
        self.metadata = {str(key): str(value) for key, value in metadata.items()} if isinstance(metadata, dict) else {}
        for name, lengths in (("COEF", self._table.coefficient_bytes), ("CORR", self._table.correction_bytes)):
            if int(lengths.sum()) != container.entry(name).length:
                raise CorruptFileError(f"section {name} has another length than the segments say")

    def _build_model(self, curves: Curves, rest: RestShape) -> Model:
        description = self._description
        levels = description.piece_levels(curves.count)
        model = build_model(curves, levels, rest, r=description.r, alignment=description.alignment)
        if model.elements.columns != description.columns:
            raise CorruptFileError(
                f"its elements have {model.elements.columns} functions where section MODL says {description.columns}"
            )
        return model

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
            Written and returned.
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
        with self._naming_the_file():
            found = self._evaluate(inside[order])
            self._add_corrections(found, inside[order])
        if out is None and np.array_equal(order, np.arange(order.size)):
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
        at = np.array([time])
        terms = [terms_at(self._segments, at, part) for part in range(3)]
        found = self._model.derivative(order, terms, self._coefficients)
        if order == 1:
            frame = min(int(np.searchsorted(self.times, time, side="right")), self.frame_count - 1)
            step = float(self.times[frame] - self.times[frame - 1])
            found += (self._correction(frame) - self._correction(frame - 1)) / step
        return found

    def _correction(self, frame: int) -> Float64Array:
        """(vertices, 3) float64: what the corrections of a frame add to its positions."""
        index = self._table.segment_of(frame)
        corrections = self._segment(index).corrections[frame - self._segments[index].first]
        added = np.zeros((self.vertex_count, 3))
        added[corrections.vertices] = corrections.levels * self._description.correction_step
        if corrections.literal_vertices.size:
            base = self._evaluate(self.times[frame : frame + 1])[0]
            at = corrections.literal_vertices
            added[at] = corrections.literals.astype(np.float64) - base[at]
        return added

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
        if not 0 <= segment < len(self._segments):
            raise IndexError(f"segment {segment} of {len(self._segments)}")
        with self._naming_the_file():
            return paper_form(self._model, self._segments[segment], self._coefficients(segment), self._description.r)

    def _inside(self, times: ArrayLike, outside: Outside) -> Float64Array:
        asked = np.asarray(times, dtype=np.float64)
        if asked.ndim != 1 or np.isnan(asked).any():
            raise SettingsError("times must be a number or a list of numbers")
        return times_inside(asked, float(self.times[0]), float(self.times[-1]), outside)

    def _evaluate(self, times: Float64Array) -> Float32Array:
        terms = terms_at(self._segments, times)
        return self._model.evaluate(terms, times.size, self._coefficients)

    def _coefficients(self, index: int) -> SegmentCoefficients:
        return self._segment(index).coefficients

    def _add_corrections(self, out: Float32Array, times: Float64Array) -> None:
        left = np.searchsorted(self.times, times, side="right") - 1
        for row, frame in enumerate(left.tolist()):
            if times[row] == self.times[frame]:
                self._add_frame_corrections(out[row], frame, 1.0)
                continue
            share = (times[row] - self.times[frame]) / (self.times[frame + 1] - self.times[frame])
            self._add_frame_corrections(out[row], frame, 1.0 - share)
            self._add_frame_corrections(out[row], frame + 1, share)

    def _add_frame_corrections(self, out: Float32Array, frame: int, weight: float) -> None:
        index = self._table.segment_of(frame)
        corrections = self._segment(index).corrections[frame - self._segments[index].first]
        base = None
        if corrections.literal_vertices.size and weight < 1.0:
            base = self._evaluate(self.times[frame : frame + 1])[0]
        add_corrections(out, corrections, self._description.correction_step, weight, base)

    def _segment(self, index: int) -> _DecodedSegment:
        if index in self._cache:
            self._cache.move_to_end(index)
            return self._cache[index]
        segment, description = self._segments[index], self._description
        chunk, corrected = self._table.read_chunks(self._container, index)
        levels = decode_segment(chunk, self._model, segment.functions, int(self._table.exponents[index]))
        decoded = _DecodedSegment(
            dequantise_segment(levels, self._model, description.step),
            decode_corrections(corrected, segment.frames, self.vertex_count, self._left),
        )
        self._cache[index] = decoded
        self._cached_bytes += decoded.nbytes
        while self._cached_bytes > CACHE_BYTES and len(self._cache) > 1:
            self._cached_bytes -= self._cache.popitem(last=False)[1].nbytes
        return decoded

    @property
    def sections(self) -> dict[str, int]:
        """Bytes of each section, and of header and table as ``"container"``; the sum is the file."""
        sizes = {name: entry.length for name, entry in self._container.entries.items()}
        return {"container": self._container.file_bytes - sum(sizes.values()), **sizes}

    def info(self) -> dict[str, Any]:
        """What the file holds, as a JSON object: sections, model, settings, and why this model."""
        frames = [segment.frames for segment in self._segments]
        return {
            "file_bytes": self._container.file_bytes,
            "ratio": 12 * self.frame_count * self.vertex_count / self._container.file_bytes,
            "sections": self.sections,
            "summary": str(self._remarks.get("summary", "")),
            "generator": str(self._remarks.get("generator", "")),
            "settings": self._remarks.get("settings", {}),
            "alignment": self._description.alignment,
            "r": self._description.r,
            "step": self._description.step,
            "curves": len(set(self._model.elements.curve_of.tolist())),
            "elements": self._model.elements.count,
            "coefficients_per_element_and_axis": int(self._model.elements.ranks.max())
            * max(segment.functions for segment in self._segments),
            "segments": len(frames),
            "segment_frames": [min(frames), max(frames)],
        }

    def verify(self) -> None:
        """Check every byte of the file, and that every segment decodes.

        Raises
        ------
        CorruptFileError
            If one does not.
        """
        self._container.verify()
        for index, segment in enumerate(self._segments):
            try:
                self._segment(index)
            except CorruptFileError as error:
                raise type(error)(error.message, path=self.path, frame=segment.first) from error
