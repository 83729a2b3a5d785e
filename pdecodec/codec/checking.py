"""List everything that is wrong with a `.pdeanim` file, each fault with a code that scripts can rely on."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any, BinaryIO

from pdecodec.codec.container import CHUNK_SECTIONS
from pdecodec.codec.decoder import Animation
from pdecodec.codec.mending import Finding, damaged_sections, mended
from pdecodec.codec.opening import open_animation
from pdecodec.codec.source import DecodeLimits, chosen_limits
from pdecodec.errors import CorruptFileError, ErrorCode, unreadable
from pdecodec.system.reading import open_regular

GROUP_FAULTS = (ErrorCode.GROUP_CHECKSUM, ErrorCode.GROUP_CONTENT)
"""Codes of faults of a single group of frames."""


@dataclass(frozen=True)
class FileCheck:
    """Result of :func:`check_file`.

    Attributes
    ----------
    path : str
    findings : tuple of Finding
        In the order of the file.
    frames, runs, groups : int
        Of the file, as far as known.
    is_deep : bool
        Whether everything was decoded.
    """

    path: str
    findings: tuple[Finding, ...]
    frames: int
    runs: int
    groups: int
    is_deep: bool

    @property
    def is_sound(self) -> bool:
        """Whether there are only notes, no faults."""
        return all(finding.severity == "note" for finding in self.findings)


def check_file(path: str | os.PathLike[str], *, deep: bool = False, limits: DecodeLimits | None = None) -> FileCheck:
    """Check the structure, checksums and ranges of a file.

    Parameters
    ----------
    path : path-like
    deep : bool
        Decode everything as well: names, faces, the reference frame, attributes, remarks, every group of frames.
    limits : DecodeLimits, optional
        What it may cost.

    Raises
    ------
    InputError
        If the file cannot be opened or read.
    """
    limits = chosen_limits(limits)
    try:
        with open_regular(path) as file:
            return _Check(os.fspath(path), file, deep=deep, limits=limits).run()
    except OSError as error:
        raise unreadable(error, path) from error


class _Check:
    """The state of a check."""

    def __init__(self, path: str, file: BinaryIO, *, deep: bool, limits: DecodeLimits) -> None:
        self.path, self.file, self.deep, self.limits = path, file, deep, limits
        self.findings: list[Finding] = []
        self.frames = self.runs = self.groups = 0

    def run(self) -> FileCheck:
        try:
            view, sections, found = mended(self.file, self.path, self.limits.max_memory)
        except CorruptFileError as error:
            self.findings.append(Finding(error.code, error.message, section=error.section, offset=error.offset))
        else:
            self.findings += [*found, *damaged_sections(self.file, sections)]
            with self._noting():
                self._look_inside(open_animation(view, limits=DecodeLimits(max_memory=self.limits.max_memory)))
        return FileCheck(self.path, tuple(self.findings), self.frames, self.runs, self.groups, self.deep)

    def _look_inside(self, animation: Animation) -> None:
        self.frames, self.runs = animation.frame_count, len(animation.runs)
        most, size = self.limits.max_output, 12 * animation.position_count
        if most is not None and size > most:
            message = f"declares {size} bytes of positions; the limit is {most}"
            self.findings.append(Finding(ErrorCode.OUTPUT_LIMIT, message))
            return
        if self.deep:
            with self._noting():
                _ = animation.metadata
        with self._noting():
            if (scene := animation.carried) is not None and self.deep:
                scene.files(self.limits.max_memory)
        ends = [*animation.run_starts.tolist()[1:], self.frames]
        for number, (first, end) in enumerate(zip(animation.run_starts.tolist(), ends, strict=True)):
            run, frames = (number, (first, end)) if self.runs > 1 else (None, None)
            with self._noting(run=run, frames=frames):
                own = animation.runs[number]
                assert isinstance(own, Animation)
                self._look_at_run(own, first, run, frames)

    def _look_at_run(self, own: Animation, first: int, run: int | None, frames: tuple[int, int] | None) -> None:
        # A file with a single run has these sections in its own table, which was checked before.
        for kind in own.sections if run is not None else ("REST",):
            if kind not in ("container", "FDAT", *CHUNK_SECTIONS):
                with self._noting(run=run, frames=frames):
                    own.check_section(kind)
        for decode in own.part_decoders if self.deep else ():
            with self._noting(run=run, frames=frames):
                decode()
        for group, (begin, end) in enumerate(own.group_frames):
            self.groups += 1
            place: dict[str, Any] = {"run": run, "group": group, "frames": (first + begin, first + end)}
            with self._noting(**place):
                own.check_group(group)
                if self.deep:
                    own.positions(float(own.times[begin]))
        with self._noting(run=run, frames=frames):
            for number, field in enumerate(own.stored_fields):
                for index, part in enumerate(field.groups):
                    begin, end = part.first, part.first + part.frames
                    with self._noting(run=run, frames=(first + begin, first + end), about=f"field {field.name!r}"):
                        own.check_field_group(number, index, deep=self.deep)

    @contextmanager
    def _noting(self, *, run: int | None = None, about: str = "", **place: Any) -> Iterator[None]:
        """Record faults that are raised in this context and continue; skip a fault that only follows from a
        recorded one.
        """
        try:
            yield
        except CorruptFileError as error:
            if "group" in place and error.code not in (*GROUP_FAULTS, ErrorCode.MEMORY_LIMIT):
                place = {}
            message = f"{about}: {error.message}" if about else error.message
            self._note(Finding(error.code, message, section=error.section, run=run, offset=error.offset, **place))

    def _note(self, finding: Finding) -> None:
        if not any(_subject(known) == _subject(finding) for known in self.findings):
            self.findings.append(finding)


def _subject(finding: Finding) -> tuple[object, ...]:
    """Return the subject of a finding; of two findings on one subject, the second only follows from the first."""
    # Groups of fields have no number of their own: their messages name the field and its frames.
    group = (finding.group, finding.message) if finding.code in GROUP_FAULTS else None
    return finding.severity, finding.run, group, finding.section or finding.code
