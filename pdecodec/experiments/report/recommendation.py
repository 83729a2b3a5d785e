"""What to use for this shot: in words, from the run's own figures."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.cell import Cell, best_peer
from pdecodec.experiments.report.coderstyle import label


@dataclass(frozen=True)
class Use:
    """A use of a clip, and how exact it must be.

    Attributes
    ----------
    name : str
    pixels : int
        That the diagonal of the clip's first frame spans on screen; no vertex may be off by more than one pixel.
    """

    name: str
    pixels: int

    @property
    def needed(self) -> float:
        """Largest error, over the diagonal."""
        return 1.0 / self.pixels


USES = (Use("background", 300), Use("hero", 3000), Use("archive", 10_000))
"""A figure in the crowd; one that fills a 4K frame; one that may be seen closer than anybody plans."""


@dataclass(frozen=True)
class Advice:
    """What to take for one use.

    Attributes
    ----------
    use : Use
    cell : Cell or None
        The smallest measured file of a profile that is exact enough; None: none is.
    rival : Cell or None
        The smallest of the peers that is exact enough.
    """

    use: Use
    cell: Cell | None
    rival: Cell | None

    @property
    def text(self) -> str:
        """A few sentences."""
        limit = f"no vertex off by more than a pixel where the clip spans {self.use.pixels:,}"
        title = self.use.name.capitalize()
        if self.cell is None:
            needed = f"run it with --tolerance {self.use.needed:g}"
            return f"{title} ({limit}): nothing that was measured is exact enough; {needed}."
        cell = self.cell
        stored = (cell.size or 0) + cell.constant_size
        parts = [
            f"{title} ({limit}): --tolerance {cell.tolerance:g} --profile {cell.coder}, {_size(stored)} of "
            f"{_size(cell.raw_size)} ({cell.ratio:.0f}:1). It costs {_seconds(cell.encode_seconds)} to encode and "
            f"{_seconds(cell.decode_seconds)} to decode"
        ]
        if self.rival is not None and self.rival.size and cell.size:
            other = cell.raw_size - self.rival.raw_size + self.rival.size + self.rival.constant_size
            times = self.rival.size / cell.size
            if times >= 1:
                parts.append(
                    f"and saves {_size(other - stored)} beside the smallest other method ({self.rival.coder}, "
                    f"{times:.1f} times the bytes)"
                )
            else:
                parts.append(
                    f"but {self.rival.coder} takes {times:.2f} times its bytes: where size alone counts, and nobody "
                    "asks for times between frames, take that"
                )
        return f"{' '.join(parts)}."


def recommend(cells: Sequence[Cell]) -> list[Advice]:
    """Advice for every use, from what was measured."""
    return [Advice(use, _smallest(cells, use), _rival(cells, use)) for use in USES]


def _smallest(cells: Sequence[Cell], use: Use) -> Cell | None:
    # What is exact by chance at a coarser tolerance is not promised: the bound counts.
    able = [cell for cell in cells if cell.kind == "profile" and cell.reached and cell.tolerance <= use.needed]
    return min(able, key=lambda cell: (cell.size or 0, cell.tolerance), default=None)


def _rival(cells: Sequence[Cell], use: Use) -> Cell | None:
    tolerances = {cell.tolerance for cell in cells if cell.tolerance <= use.needed}
    best = [best_peer(cells, tolerance) for tolerance in sorted(tolerances)]
    return min((cell for cell in best if cell is not None), key=lambda cell: cell.size or 0, default=None)


def recommendation_exhibit(advice: Sequence[Advice]) -> Exhibit:
    """The advice with its figures in a table."""
    rows = []
    for item in advice:
        cell, rival = item.cell, item.rival
        rows.append(
            (
                item.use.name,
                None if cell is None else label(cell.coder),
                None if cell is None else cell.tolerance,
                None if cell is None else (cell.size or 0) + cell.constant_size,
                None if cell is None else cell.ratio,
                None if cell is None or cell.max_error is None else cell.max_error * item.use.pixels,
                None if cell is None else cell.encode_seconds,
                None if cell is None else cell.decode_seconds,
                None if rival is None else rival.coder,
                None if rival is None or cell is None or not rival.size or not cell.size else rival.size / cell.size,
            )
        )
    return Exhibit(
        name="recommendation",
        title="Background, hero, archive",
        lesson="\n\n".join(item.text for item in advice),
        table=Table(
            (
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
            ),
            tuple(rows),
        ),
        shows_table=True,
    )


def _size(count: int) -> str:
    if count < 100_000:
        return f"{count / 1e3:.1f} kB"
    return f"{count / 1e6:.3g} MB"


def _seconds(value: float | None) -> str:
    if value is None:
        return "-"
    return f"{value:.2g} s" if value < 10 else f"{value:.0f} s"
