"""Recommend settings for a clip, in words, from the run's own figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.clips.coder_figures import label
from pdecodec.report.clips.measurement import Measurement, best_baseline, size_ratio


@dataclass(frozen=True)
class Use:
    """A use of a clip: its size on screen.

    The diagonal of the first frame spans this many pixels, and no vertex may be off by more than one pixel.
    """

    name: str
    pixels: int

    @property
    def needed(self) -> float:
        """Largest error allowed, over the diagonal."""
        return 1.0 / self.pixels


USES = (Use("background", 300), Use("hero", 3000), Use("archive", 10_000))
"""An extra in a crowd; a character that fills a 4K frame; one that may later be seen closer than planned."""


@dataclass(frozen=True)
class Advice:
    """Advice for one use: the smallest file of a profile that is exact enough, if any, and the smallest of the
    baselines.
    """

    use: Use
    point: Measurement | None
    rival: Measurement | None

    @property
    def text(self) -> str:
        """A few sentences."""
        limit = f"no vertex off by more than a pixel where the clip spans {self.use.pixels:,}"
        title = self.use.name.capitalize()
        if self.point is None:
            needed = f"run it with tolerance {self.use.needed:g}"
            return f"{title} ({limit}): nothing that was measured is exact enough; {needed}."
        point = self.point
        parts = [
            f"{title} ({limit}): tolerance {point.tolerance:g}, profile {point.coder}: {_size(point.whole_size)} of "
            f"{_size(point.raw_size)} ({point.ratio:.0f}:1). It costs {_seconds(point.encode_seconds)} to encode and "
            f"{_seconds(point.decode_seconds)} to decode"
        ]
        if self.rival is not None and self.rival.size and point.size:
            saved = self.rival.whole_size - point.whole_size
            times = self.rival.size / point.size
            if times >= 1:
                parts.append(
                    f"and saves {_size(saved)} compared with the smallest other method ({self.rival.coder}, "
                    f"{times:.1f} times the bytes)"
                )
            else:
                parts.append(
                    f"but {self.rival.coder} takes {times:.2f} times its bytes: where size alone counts, and no "
                    "times between frames are needed, take that"
                )
        return f"{' '.join(parts)}."


def recommend(points: Sequence[Measurement]) -> list[Advice]:
    """Return advice for every use, from the measurements."""
    return [Advice(use, _smallest(points, use), _rival(points, use)) for use in USES]


def _smallest(points: Sequence[Measurement], use: Use) -> Measurement | None:
    # A coarser tolerance may be exact enough by chance but promises nothing: the bound counts.
    able = [point for point in points if point.kind == "profile" and point.reached and point.tolerance <= use.needed]
    return min(able, key=lambda point: (point.size or 0, point.tolerance), default=None)


def _rival(points: Sequence[Measurement], use: Use) -> Measurement | None:
    tolerances = {point.tolerance for point in points if point.tolerance <= use.needed}
    best = [best_baseline(points, tolerance) for tolerance in sorted(tolerances)]
    return min((point for point in best if point is not None), key=lambda point: point.size or 0, default=None)


def recommendation_figure(advice: Sequence[Advice]) -> Figure:
    """Show the advice with its values in a table."""
    rows: list[tuple[Value, ...]] = []
    for item in advice:
        ours: tuple[Value, ...] = (None,) * 7
        if (point := item.point) is not None:
            pixels = None if point.max_error is None else point.max_error * item.use.pixels
            seconds = (point.encode_seconds, point.decode_seconds)
            ours = (label(point.coder), point.tolerance, point.whole_size, point.ratio, pixels, *seconds)
        rival = item.rival
        theirs = (None, None) if rival is None else (rival.coder, size_ratio(rival, point))
        rows.append((item.use.name, *ours, *theirs))
    return Figure(
        name="recommendation",
        title="Background, hero, archive",
        lesson="\n\n".join(item.text for item in advice),
        table=Table(COLUMNS, tuple(rows)),
        shows_table=True,
    )


COLUMNS = (
    "use",
    "take",
    "tolerance",
    "bytes, everything counted",
    "ratio",
    "maximum error [pixels]",
    "encode [s]",
    "decode [s]",
    "smallest other method",
    "its bytes over ours",
)


def _size(count: int) -> str:
    if count < 100_000:
        return f"{count / 1e3:.1f} kB"
    return f"{count / 1e6:.3g} MB"


def _seconds(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.2g} s" if value < 10 else f"{value:.0f} s"
