"""Read files in coded form: their sections and groups of frames, which can be copied or coded again."""

from __future__ import annotations

import os
import zlib
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any, BinaryIO

import numpy as np

from pdecodec import _core
from pdecodec.codec.appending import AppendingEncoder
from pdecodec.codec.container import CHUNK_SECTIONS, SECTION_KINDS, StoredSection, stored_sections
from pdecodec.codec.decoder import Animation
from pdecodec.codec.opening import open_animation
from pdecodec.codec.sections.groups import GroupEntry, read_group_table
from pdecodec.codec.settings import EffortName
from pdecodec.errors import CorruptFileError, InputError, SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.jumps import shifted
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.reading import open_regular

Coded = tuple[GroupEntry, tuple[bytes, bytes, bytes]]
"""A row of the table of groups, and its chunks."""


class CodedFile:
    """An open file, or one run of it, in coded form: its sections and its groups of frames.

    Parameters
    ----------
    path : path-like
    run : int, optional
        Number of the run, in a file of several.
    whole : Animation, optional
        The open file; it stays open.

    Raises
    ------
    InputError
        If it has several runs of frames, and none is given.
    """

    def __init__(self, path: str | os.PathLike[str], run: int | None = None, whole: Animation | None = None) -> None:
        self.path = os.fspath(path)
        with ExitStack() as stack:
            whole = whole or stack.enter_context(open_animation(path))
            self._file: BinaryIO = stack.enter_context(open_regular(path))
            self._sections = dict(stored_sections(self._file))
            self.unknown_sections = tuple(kind for kind in self._sections if kind not in SECTION_KINDS)
            if "RUNS" in self._sections:
                if run is None:
                    raise InputError(
                        "has several runs of frames; joining such files is not supported",
                        code="unsupported-feature",
                        path=path,
                    )
                one = whole.runs[run]
                assert isinstance(one, Animation)
                self.animation: Animation = one
                # Sections SOLD, FLDS and FDAT of the file hold the data of all runs.
                of_file = {kind.type for kind in SECTION_KINDS.values() if kind.of == "file"}
                self._sections = {
                    **{kind: stored for kind, stored in self._sections.items() if kind in of_file},
                    **{own.type: StoredSection(own.offset, own.length, None) for own in whole.sections_of_run(run)},
                }
            else:
                self.animation = whole
            self.entries = read_group_table(self.section("GRUP"), self.animation.frame_count)
            self._stack = stack.pop_all()

    def __enter__(self) -> CodedFile:
        return self

    def __exit__(self, *_: object) -> None:
        self._stack.close()

    @property
    def edges(self) -> list[int]:
        """First frame of every group, and the number of all frames."""
        return [0, *np.cumsum([entry.frames for entry in self.entries]).tolist()]

    def section(self, kind: str) -> bytes:
        """Return a section's checked bytes; empty if there is no such section."""
        stored = self._sections.get(kind)
        if stored is None:
            return b""
        data = self._read(stored.offset, stored.length)
        if stored.checksum is None:
            self.animation.check_section(kind)
        elif zlib.crc32(data) != stored.checksum:
            raise CorruptFileError(
                f"section {kind} is damaged; encode it again",
                code="section-checksum",
                path=self.path,
                section=kind,
                offset=stored.offset,
            )
        return data

    def coded(self, first: int, end: int) -> Iterator[Coded]:
        """Yield groups `first` to `end` - 1; raise CorruptFileError if one is damaged."""
        sizes = np.array([entry.sizes for entry in self.entries], np.int64).reshape(-1, 3)
        starts = np.cumsum(sizes, axis=0) - sizes + [self._sections[kind].offset for kind in CHUNK_SECTIONS]
        for index in range(first, end):
            entry = self.entries[index]
            time, coefficients, residuals = (
                self._read(int(at), size) for at, size in zip(starts[index], entry.sizes, strict=True)
            )
            if zlib.crc32(residuals, zlib.crc32(coefficients, zlib.crc32(time))) != entry.checksum:
                raise CorruptFileError(
                    "a group of frames is damaged; encode it again",
                    code="group-checksum",
                    path=self.path,
                    frame=self.edges[index],
                )
            yield entry, (time, coefficients, residuals)

    def field_chunk(self, group: _core.FieldGroup) -> bytes:
        """Return the checked chunk of one group of a field."""
        data = self._read(group.offset, group.size)
        if zlib.crc32(data) != group.checksum:
            raise CorruptFileError(
                "a group of frames of a field is damaged; encode it again",
                code="group-checksum",
                path=self.path,
                section="FDAT",
                frame=group.first,
            )
        return data

    def _read(self, offset: int, size: int) -> bytes:
        self._file.seek(offset)
        return self._file.read(size)

    def appending(self, sequence: MeshSequence, *, effort: EffortName, progress: Progress | None) -> AppendingEncoder:
        """Return an encoder that codes frames of a sequence with this file's mesh and model, to add them to the file.

        Raises
        ------
        InputError
            If the file is in closed form, which cannot be extended.
        """
        if self.entries[0].basis == "closed form":
            raise InputError(
                "profile paper: no frames can be added to it; decode it, and encode all frames",
                path=self.path,
                code="setting-unsupported",
            )
        step = self.animation.residual_step
        return AppendingEncoder(sequence, self.animation, self.entries[-1], step, effort=effort, progress=progress)


class Described(MeshSequence):
    """Times, names and discontinuities for the header of a file; a sequence without positions."""

    def __init__(self, head: Animation, times: Float64Array, jumps: list[int]) -> None:
        self.objects, self.times, self.fps, self.jumps = head.meshes, times, head.fps, jumps
        self.metadata, self.notices = {}, ()

    def read_frames(self, start: int, stop: int) -> Any:
        raise NotImplementedError  # Only a header is written, for which positions are never read.


@dataclass(frozen=True)
class CodedFrames:
    """Frames that are cut out of a run."""

    file: CodedFile
    first: int
    end: int
    effort: EffortName
    progress: Progress | None

    @property
    def described(self) -> Described:
        animation = self.file.animation
        times, jumps = animation.times[self.first : self.end], shifted(animation.jumps, self.first, self.end, 0)
        return Described(animation, times, jumps)

    @property
    def _whole(self) -> list[int]:
        """Edges of the groups that are copied."""
        return [edge for edge in self.file.edges if self.first <= edge <= self.end]

    @property
    def again(self) -> int:
        """Number of frames that are coded again."""
        return self.end - self.first - (self._whole[-1] - self._whole[0] if self._whole else 0)

    def check_edges(self, begin: int, times: Float64Array) -> None:
        """Raise SettingsError if a group would be cut through; `begin` is the first frame of the run within the
        file.
        """
        edges = self.file.edges
        through = [frame for frame in (self.first, self.end) if frame not in edges]
        if through:
            places = "; ".join(_nearest([begin + edge for edge in edges], begin + frame, times) for frame in through)
            raise SettingsError(
                f"groups of frames cannot be cut in two: {places}; cut between groups, or code their frames again",
                path=self.file.path,
            )

    def pieces(self) -> Iterator[Coded]:
        """Yield the groups; groups that are cut through are coded again."""
        edges, whole = self.file.edges, self._whole
        inner = (whole[0], whole[-1]) if whole else (self.end, self.end)
        if self.first < inner[0]:
            yield from self._again(self.first, inner[0])
        yield from self.file.coded(edges.index(inner[0]), edges.index(inner[1])) if whole else ()
        if inner[1] < self.end:
            yield from self._again(inner[1], self.end)

    def _again(self, begin: int, stop: int) -> Iterator[Coded]:
        frames = FrameSelection(self.file.animation, range(begin, stop))
        coder = self.file.appending(frames, effort=self.effort, progress=self.progress)
        return ((group.entry, group.chunks) for group in coder.coded())


def _nearest(edges: Sequence[int], frame: int, times: Float64Array) -> str:
    """Describe the group borders nearest to a frame, for messages."""
    at = int(np.searchsorted(edges, frame))
    near = [
        f"{edge} ({times[edge]:g} s)" if edge < times.size else f"{edge}, the end" for edge in edges[at - 1 : at + 1]
    ]
    return f"frame {frame} is inside one, which begins at {near[0]} and ends before {near[1]}"
