"""Compare fields with other coders at equal maximum error, measured on decoded values."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from statistics import geometric_mean
from typing import Any

import numpy as np
import zstandard
from numpy.typing import NDArray

from pdecodec.codec.encode.field.chunks import float_error, kinds_of
from pdecodec.codec.encode.report import FieldReport
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import ArraySequence, Connectivity
from pdecodec.report.charts.figure import Figure, Section, Table, Value
from pdecodec.report.clips.baseline import Baseline, UnreachableError
from pdecodec.report.clips.ratesearch import RateCurve

FIELD_TOLERANCES = (1e-3, 1e-5)
"""Largest errors that are measured, over the range of a field."""

WHOLE_BOUND = 0.49
"""Largest error with which other coders keep whole numbers and flags: rounding makes them exact again."""

MASK_LEVEL = 19
"""Level of zstandard for the places of values that are not finite, which other coders cannot hold."""

OURS = "pdecodec"

METHOD = """
Bits per value of every field. The largest error of a value is a fraction of the range of its field; whole numbers and
flags are exact. Each other method is given the coarsest setting found by search that keeps the same bound. It codes
each component after the other, without faces; values that are not finite are filled from the frame before, and their
places count as zstandard packs them. Descriptions of fields count, too, in equal shares. Of a field that a decoder
computes from the motion or another field, pdecodec stores nothing else; means leave such fields out.
"""


@dataclass(frozen=True)
class FieldPoint:
    """One field at one tolerance.

    Attributes
    ----------
    clip, field : str
    tolerance : float
        Largest error over the range; 0 if values are exact.
    values : int
        Numbers of all frames together.
    bits : mapping of str to float or None
        Bits per value by coder, pdecodec first; None if the coder cannot keep the bound.
    errors : mapping of str to float
        Largest error of decoded values over the bound, by coder; 0 where they are exact.
    is_stored : bool
        Whether pdecodec stores values; otherwise a decoder computes them.
    """

    clip: str
    field: str
    tolerance: float
    values: int
    bits: Mapping[str, float | None]
    errors: Mapping[str, float]
    is_stored: bool = True

    @property
    def within(self) -> bool:
        """Whether pdecodec keeps the bound."""
        return self.errors[OURS] <= 1.0

    @property
    def ratio(self) -> float | None:
        """Bits over those of the best other coder."""
        others = [bits for coder, bits in self.bits.items() if coder != OURS and bits]
        ours = self.bits[OURS]
        return None if ours is None or not others else ours / min(others)


def measure_fields(
    clip: str, sequence: ArraySequence, baselines: Sequence[Baseline], *, tolerance: float, effort: EffortName
) -> Iterator[FieldPoint]:
    """Measure every field at every tolerance, exact fields once; `tolerance` is that of the motion."""
    able = [baseline for baseline in baselines if baseline.codes_fields]
    for asked in FIELD_TOLERANCES if sequence.fields else ():
        report = encode(sequence, tolerance=tolerance, field_tolerance=asked, effort=effort, scene="drop")
        with open_animation(report.data or b"") as animation:
            share = report.sections.get("FLDS", 0) / max(len(report.fields), 1)
            for found in report.fields:
                is_exact = sequence.field_named(found.name).is_exact
                if found.values == 0 or (is_exact and asked != FIELD_TOLERANCES[0]):
                    continue
                values = sequence.read_field(found.name, 0, sequence.frame_count)
                decoded = animation.read_field(found.name, 0, sequence.frame_count)
                bits: dict[str, float | None] = {OURS: 8.0 * (found.bytes + share) / found.values}
                errors = {OURS: _over(float_error(values, decoded), found.bound)}
                if is_exact and not np.array_equal(values, decoded):
                    errors[OURS] = math.inf
                bound = WHOLE_BOUND if is_exact else found.bound
                for baseline in able:
                    bits[baseline.name] = None
                    reached = _reach(baseline, values, found, bound)
                    if reached is not None:
                        bits[baseline.name] = 8.0 * reached[0] / found.values
                        errors[baseline.name] = 0.0 if is_exact else reached[1] / bound
                yield FieldPoint(
                    clip, found.name, 0.0 if is_exact else asked, found.values, bits, errors, found.bytes > 0
                )


def _over(error: float, bound: float) -> float:
    """Return an error over its bound, which is 0 where values are exact."""
    return error / bound if bound else math.inf if error else 0.0


def _reach(baseline: Baseline, values: NDArray[Any], found: FieldReport, bound: float) -> tuple[int, float] | None:
    """Return the fewest bytes with which a baseline keeps a bound, and its largest error; None if it cannot."""
    filled = _filled(values.astype(np.float64), found.smallest)
    columns = np.moveaxis(filled.reshape(*values.shape[:2], -1), 2, 1).reshape(len(values), -1, 1)
    points = columns.astype(np.float32)
    curve = RateCurve(baseline, points, Connectivity(points.shape[1]))
    try:
        result = curve.reach(bound - float_error(columns, points))
    except UnreachableError:
        return None
    kinds = kinds_of(values)
    mask = b"" if kinds is None else zstandard.ZstdCompressor(level=MASK_LEVEL).compress(kinds.tobytes())
    return result.size + len(mask), float_error(columns, curve.decode(result))


def _filled(values: Float64Array, first: float) -> Float64Array:
    """Return values with those of the frame before where they are not finite; `first` in the first frame."""
    before = np.full_like(values[0], first)
    for frame in values:
        before = frame[...] = np.where(np.isfinite(frame), frame, before)
    return values


def fields_table(points: Sequence[FieldPoint]) -> Table:
    """Return a row for each field and tolerance, then geometric means over stored fields with bits of every coder.

    The mean at a tolerance has the exact fields, too.
    """
    coders = list(dict.fromkeys(coder for point in points for coder in point.bits))
    compared = len(coders) > 1
    rows: list[tuple[Value, ...]] = []
    for point in points:
        others = [error for coder, error in point.errors.items() if coder != OURS]
        own = (point.ratio, point.errors[OURS], max(others, default=None)) if compared else (point.errors[OURS],)
        place = (point.clip, point.field, point.tolerance or "exact", point.values)
        rows.append((*place, *(point.bits.get(coder) for coder in coders), *own))
    for tolerance in FIELD_TOLERANCES:
        complete = [
            row[4:]
            for point, row in zip(points, rows, strict=False)
            if point.tolerance in (tolerance, 0) and point.is_stored and None not in row[4 : 4 + len(coders)]
        ]
        if complete:
            columns: list[list[Any]] = [list(column) for column in zip(*complete, strict=True)]
            means = [geometric_mean(column) for column in columns[: len(coders) + compared]]
            worst = [max(column) for column in columns[len(coders) + compared :]]
            rows.append(("geometric mean", f"of {len(complete)}", tolerance, None, *means, *worst))
    ends = ("ours / best other", "error / bound", "others' error / bound") if compared else ("error / bound",)
    return Table(("clip", "field", "tolerance", "values", *coders, *ends), tuple(rows))


def fields_section(points: Sequence[FieldPoint]) -> tuple[Section, ...]:
    """Return the section of fields; none without fields."""
    figure = Figure(
        name="fields",
        title="Bits per value",
        lesson="Means are over stored fields whose bound every method keeps, with exact fields at each tolerance.",
        table=fields_table(points),
        shows_table=True,
    )
    return (Section("Fields", METHOD.strip(), (figure,)),) if points else ()
