"""The report of an encode: file, size and error, and which alternatives were compared."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from pdecodec import __version__
from pdecodec.codec.container import BESIDE_MOTION, FIELD_SECTIONS, SECTION_KINDS
from pdecodec.codec.settings import DEFAULT_TOLERANCE
from pdecodec.errors import Notice
from pdecodec.mesh.rounding import REPORTED_ROUNDING, rounding_words

COARSE_TOLERANCE = 0.1
"""Tolerance above which a bound is probably a mistake: 1 stands for the whole scene, not for one percent."""

ROUGH_EDGE_SHARE = 0.5
"""Ratio of the bound to the median edge above which a surface looks rough."""

GENERATOR = "pdecodec "
"""Text before the version in the remarks of files that this package made."""

SECTION_TITLES = {"container": "header and table", **{kind.type: kind.title for kind in SECTION_KINDS.values()}}
"""Titles of the parts of a `.pdeanim` file."""


@dataclass(frozen=True)
class Alternative:
    """One alternative and its bytes.

    Attributes
    ----------
    way : str
        Name of the alternative.
    size : int [bytes]
        Bytes of the compared frames if they are encoded with it.
    chosen : bool
    """

    way: str
    size: int
    chosen: bool


@dataclass(frozen=True)
class Question:
    """One decision of the encoder and the alternatives that it compared.

    Attributes
    ----------
    what : str
        What was decided.
    frames : int
        Number of frames, from the first on, whose bytes were compared.
    ways : tuple of Alternative
    """

    what: str
    frames: int
    ways: tuple[Alternative, ...]


def ask(what: str, frames: int, bits: dict[str, float], chosen: str) -> Question | None:
    """Return a question, given the bits of each alternative; None if there was only one alternative."""
    ways = tuple(Alternative(way, round(taken / 8.0), way == chosen) for way, taken in bits.items())
    return Question(what, frames, ways) if len(ways) > 1 else None


def to_json(questions: Sequence[Question]) -> list[dict[str, Any]]:
    """Return questions as JSON for section META."""
    return [
        {
            "what": question.what,
            "frames": question.frames,
            "ways": [
                {"way": item.way, "bytes": item.size, **({"chosen": True} if item.chosen else {})}
                for item in question.ways
            ],
        }
        for question in questions
    ]


def from_json(record: Any) -> tuple[Question, ...]:
    """Return the questions of :func:`to_json`; empty if the record has another form."""
    try:
        return tuple(
            Question(
                str(question["what"]),
                int(question["frames"]),
                tuple(
                    Alternative(str(item["way"]), int(item["bytes"]), bool(item.get("chosen", False)))
                    for item in question["ways"]
                ),
            )
            for question in record
        )
    except (TypeError, KeyError, ValueError, AttributeError):
        return ()


@dataclass(frozen=True)
class FieldReport:
    """How a field was encoded.

    Attributes
    ----------
    name : str
    bytes : int
    values : int
        Number of values in all frames together.
    smallest, largest : float
        Range of the source.
    bound, max_error : float
        Largest error allowed (0: exact) and measured [units of the field].
    note : str
        Why it is not stored as requested; mostly empty.
    coding : str
        How it is stored or computed, and why.
    """

    name: str
    bytes: int
    values: int
    smallest: float
    largest: float
    bound: float
    max_error: float
    note: str = ""
    coding: str = ""

    @property
    def bits_per_value(self) -> float:
        """Bits of the file for each value."""
        return 8 * self.bytes / max(self.values, 1)


@dataclass(frozen=True)
class EncodeReport:
    """The result of an encode.

    Attributes
    ----------
    path : Path, str or None
        Path or address of the file.
    frames, vertices : int
        With several runs, the largest number of vertices of a run.
    sections : dict of str to int
        Bytes of each section; the sum is the file.
    max_error, rms_error : float [scene units]
        Largest Euclidean vertex distance at the input's frames, and the root of the mean square distance, of
        the float32 positions that the written bytes decode to.
    bound : float or None [scene units]
    scale : float [scene units]
        Length that tolerances are relative to.
    residuals : int
        Number of positions (vertices of single frames) that were corrected.
    groups, patches, functions_of_space : int
        Size of the model: groups of frames, patches or pieces of curves, and the total number of their functions.
    coefficients : int
        Numbers that make up the motion: coefficients other than zero, and all stored values of functions of time.
        The reference frame and residuals are not included.
    seconds : float
    summary : str
        The chosen model in a sentence.
    data : bytes or None
        The file itself if it was encoded without a path.
    runs : int
        Number of runs of frames of one connectivity.
    jumps : tuple of int
        Frames at discontinuities, where splines between frames end and begin.
    alternatives : tuple of Question
        If requested: the alternatives that were compared, with their bytes.
    positions : int or None
        Vertices of all frames together, if that is not vertices times frames.
    fields : tuple of FieldReport
        What became of each field that is kept.
    is_still : bool
        Whether all frames of the input that were read have the same positions.
    rounding : float [scene units]
        Largest distance of the float32 positions that were encoded, from which errors count, to the input's positions.
    size_limit : int or None [bytes]
        The requested size.
    median_edge : float or None [scene units]
        Median length of the edges of faces in the first frame; with several runs, the smallest of their medians.
    preset : str or None
        The requested preset.
    scene : tuple of (str, int)
        Kinds of things around the motion that the file carries, and how many of each.
    scene_note : str
        Why it does not carry the scene, although the source has one and it was asked for; mostly empty.
    normal_p99 : float or None [degrees]
        Angle that 99 % of all corners' normals are off by at most, at frames; measured under preset "hero" alone.
    """

    path: Path | str | None
    frames: int
    vertices: int
    sections: dict[str, int]
    max_error: float
    rms_error: float
    bound: float | None
    scale: float
    residuals: int
    groups: int
    patches: int
    functions_of_space: int
    coefficients: int
    seconds: float
    summary: str
    data: bytes | None = None
    runs: int = 1
    jumps: tuple[int, ...] = ()
    alternatives: tuple[Question, ...] = ()
    positions: int | None = None
    rounding: float = 0.0
    fields: tuple[FieldReport, ...] = ()
    size_limit: int | None = None
    median_edge: float | None = None
    preset: str | None = None
    normal_p99: float | None = None
    is_still: bool = False
    scene: tuple[tuple[str, int], ...] = ()
    scene_note: str = ""

    @property
    def raw_bytes(self) -> int:
        """Return the size of the input's positions in float32."""
        return 12 * (self.frames * self.vertices if self.positions is None else self.positions)

    @property
    def is_rough(self) -> bool:
        """Return whether the surface looks rough: errors may reach half a median edge, which tilts faces by 45
        degrees.
        """
        if self.bound is None or self.median_edge is None or self.normal_p99 is not None:
            return False
        return self.bound > ROUGH_EDGE_SHARE * self.median_edge

    @property
    def warnings(self) -> tuple[str, ...]:
        """Return warnings about probable mistakes: no motion, a coarse bound, a size limit that a lossless file does
        not reach, positions far from the origin.

        A warning about something that a setting changes is a :class:`pdecodec.errors.Notice`.
        """
        found: list[str] = []
        if self.frames == 1:
            found.append("there is one frame, so nothing moves; name a pattern or a folder for a sequence of files")
        elif self.is_still and not self.fields:
            found.append("nothing moves: all frames of the input are the same")
        elif self.runs == 1 and not self.is_still and not self.coefficients and not self.residuals:
            found.append(
                "nothing moves: every frame lies within the tolerance of one pose; a smaller tolerance keeps motion"
            )
        if self.bound is not None and self.bound > COARSE_TOLERANCE * self.scale:
            share = self.bound / self.scale
            found.append(
                f"the tolerance is {share:.3g} of the diagonal, which hides shapes; {DEFAULT_TOLERANCE} is usual"
            )
        elif self.is_rough:
            edges = (self.bound or 0.0) / (self.median_edge or 1.0)
            text = f"the surface will look rough: the bound is {edges:.2g} times the length of a median edge"
            found.append(Notice(text, setting="preset", value="hero", purpose="to keep normals"))
        if self.size_limit is not None and self.max_error == 0 and self.file_bytes < self.size_limit:
            found.append(f"the file is lossless and takes less than the {self.size_limit} bytes that are allowed")
        if self.rounding > (REPORTED_ROUNDING * self.scale if self.bound is None else self.bound):
            beyond = "" if self.bound is None else ", more than the bound, which counts from the rounded positions"
            found.append(f"{rounding_words(self.rounding)}{beyond}; move the scene nearer to its origin")
        found += [f"field {one.name!r} is {one.note}" for one in self.fields if one.note]
        if self.scene_note:
            found.append(f"the scene around the motion is not kept: {self.scene_note}")
        return tuple(found)

    @property
    def file_bytes(self) -> int:
        """Return the size of the whole file."""
        return sum(self.sections.values())

    @property
    def field_bytes(self) -> int:
        """Bytes of the fields, with their headers."""
        return sum(self.sections.get(name, 0) for name in FIELD_SECTIONS)

    @property
    def scene_bytes(self) -> int:
        """Bytes of the scene around the motion."""
        return self.sections.get("SCEN", 0)

    @property
    def motion_bytes(self) -> int:
        """Bytes of the file without fields and scene."""
        return self.file_bytes - sum(self.sections.get(name, 0) for name in BESIDE_MOTION)


def generator() -> str:
    """Return the name and version that the file records as its generator."""
    return f"{GENERATOR}{__version__}"


def counted(number: int, what: str, ending: str = "s", cut: int = 0) -> str:
    """Return a number with its noun; in the plural, the noun's last `cut` letters are replaced by `ending`."""
    return f"{number} {what}" if number == 1 else f"{number} {what[: len(what) - cut]}{ending}"


def total_reports(reports: Sequence[FieldReport]) -> list[FieldReport]:
    """Return one report for each field of several runs."""
    by_name: dict[str, list[FieldReport]] = {}
    for one in reports:
        by_name.setdefault(one.name, []).append(one)
    return [
        FieldReport(
            name,
            sum(one.bytes for one in own),
            sum(one.values for one in own),
            min(one.smallest for one in own),
            max(one.largest for one in own),
            max(one.bound for one in own),
            max(one.max_error for one in own),
            next((one.note for one in own if one.note), ""),
            " and ".join(dict.fromkeys(one.coding for one in own)),
        )
        for name, own in by_name.items()
    ]


def fields_to_json(reports: Sequence[FieldReport]) -> list[dict[str, Any]]:
    """Return reports as JSON objects, with the bits of each value."""
    return [{**vars(one), "bits_per_value": one.bits_per_value} for one in reports]
