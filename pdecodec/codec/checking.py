"""Everything that is wrong with a `.pdeanim` file, each fault with a code that scripts can rely on."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

from pdecodec.codec.container import CHUNK_SECTIONS
from pdecodec.codec.decoder import Animation
from pdecodec.codec.mending import Finding, UnreadableError, damaged_sections, mended
from pdecodec.codec.opening import open_animation
from pdecodec.codec.source import DecodeLimits, chosen_limits
from pdecodec.errors import CorruptFileError, InputError, LimitError

CODES = {
    "identifier": "The first bytes are not those of a .pdeanim file.",
    "version": "The file is of a later major version of the format.",
    "header-checksum": "The header is damaged.",
    "table": "The table of sections cannot be read.",
    "table-checksum": "The table of sections is damaged.",
    "truncated": "The file ends before its last section does.",
    "trailing-bytes": "There are bytes after the last section.",
    "section-unknown": "A section of a later minor version, which may be passed over: a note.",
    "section-unknown-required": "A section of a later version, without which the file must not be read.",
    "section-checksum": "The bytes of a section are not those that were written.",
    "section-content": "A section breaks the format, or is missing: counts, ranges, what must agree with others.",
    "group-checksum": "The bytes of a group of frames are not those that were written.",
    "group-content": "A group of frames cannot be decoded (--deep).",
    "memory-limit": "More memory is needed than --max-memory allows: what is behind was not looked at.",
    "output-limit": "The file declares more positions than --max-output allows.",
}
"""Codes of findings, and what each means. They stay; later versions may add some."""

_SECTION = re.compile(r"\bsection ([A-Z]{4})\b")


@dataclass(frozen=True)
class FileCheck:
    """What :func:`check_file` found.

    Attributes
    ----------
    path : str
    findings : tuple of Finding
        In the order of the file.
    frames, runs, groups : int
        That the file has, as far as could be told.
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
        """Whether there is nothing but notes."""
        return all(finding.severity == "note" for finding in self.findings)


def check_file(path: str | os.PathLike[str], *, deep: bool = False, limits: DecodeLimits | None = None) -> FileCheck:
    """Look for everything that is wrong with a file: structure, checksums, ranges.

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
        with Path(path).open("rb") as file:
            return _Check(os.fspath(path), file, deep=deep, limits=limits).run()
    except (OSError, ValueError) as error:  # ValueError: a character that no path can have
        reason = error.strerror if isinstance(error, OSError) else error
        raise InputError(f"cannot be read ({reason})", path=path) from error


class _Check:
    """A check under way."""

    def __init__(self, path: str, file: BinaryIO, *, deep: bool, limits: DecodeLimits) -> None:
        self.path, self.file, self.deep, self.limits = path, file, deep, limits
        self.findings: list[Finding] = []
        self.frames = self.runs = self.groups = 0

    def run(self) -> FileCheck:
        try:
            view, sections, found = mended(self.file, self.path, self.limits.max_memory)
        except UnreadableError as error:
            self.findings.append(Finding(error.code, error.message, offset=error.offset))
        except LimitError as error:
            self.findings.append(Finding("memory-limit", error.message))
        else:
            self.findings += [*found, *damaged_sections(self.file, sections)]
            with self._noting("section-content"):
                self._look_inside(open_animation(view, limits=DecodeLimits(max_memory=self.limits.max_memory)))
        return FileCheck(self.path, tuple(self.findings), self.frames, self.runs, self.groups, self.deep)

    def _look_inside(self, animation: Animation) -> None:
        self.frames, self.runs = animation.frame_count, len(animation.runs)
        most, size = self.limits.max_output, 12 * animation.position_count
        if most is not None and size > most:
            self.findings.append(Finding("output-limit", f"declares {size} bytes of positions; the limit is {most}"))
            return
        if self.deep:
            with self._noting("section-content"):
                _ = animation.metadata
        ends = [*animation.run_starts.tolist()[1:], self.frames]
        for number, (first, end) in enumerate(zip(animation.run_starts.tolist(), ends, strict=True)):
            run, frames = (number, (first, end)) if self.runs > 1 else (None, None)
            with self._noting("section-content", run=run, frames=frames):
                own = animation.runs[number]
                assert isinstance(own, Animation)
                self._look_at_run(own, first, run, frames)

    def _look_at_run(self, own: Animation, first: int, run: int | None, frames: tuple[int, int] | None) -> None:
        # Those of a file of one run are in the table of the file and were looked at with it, if they are there.
        for kind in own.sections if run is not None else ("REST",):
            if kind != "container" and kind not in CHUNK_SECTIONS:
                with self._noting("section-content", run=run, frames=frames):
                    own.check_section(kind)
        for decode in own.part_decoders if self.deep else ():
            with self._noting("section-content", run=run, frames=frames):
                decode()
        for group, (begin, end) in enumerate(own.group_frames):
            self.groups += 1
            place = {"run": run, "group": group, "frames": (first + begin, first + end)}
            with self._noting("group-checksum", **place):
                own.check_group(group)
                if self.deep:
                    with self._noting("group-content", **place):
                        own.positions(float(own.times[begin]))

    @contextmanager
    def _noting(self, code: str, **place: Any) -> Iterator[None]:
        """Within, a fault ends what is done and is noted, unless it stands on one that is noted already."""
        try:
            yield
        except LimitError as error:
            self._note(Finding("memory-limit", error.message, **place))
        except CorruptFileError as error:
            found = _SECTION.search(error.message)
            section = None if found is None else found[1]
            if error.message.startswith(f"section {section} is damaged"):
                code = "section-checksum"
            elif section is not None and section not in CHUNK_SECTIONS:
                code = "section-content"
            if code.startswith("section") and "group" in place:
                place = {"run": place["run"]}
            self._note(Finding(code, error.message, section=section, offset=error.offset, **place))

    def _note(self, finding: Finding) -> None:
        section = None if finding.section in CHUNK_SECTIONS else finding.section
        for known in self.findings:
            is_known = known.message == finding.message or (section is not None and known.section == section)
            if is_known and known.run == finding.run and known.severity == finding.severity:
                return
        self.findings.append(finding)
