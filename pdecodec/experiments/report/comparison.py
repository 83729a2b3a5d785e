"""Two reports beside each other: what got better, what got worse, and whether it may pass."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pdecodec.errors import InputError
from pdecodec.experiments.exhibit import Exhibit, Table
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.report.coderstyle import label

WORTH_SAYING = 0.001
"""Change of bytes, as a share, from which on it is told: less is a byte here or there."""

SLOWER = 0.25
"""Change of speed, as a share, from which on it is told: less is what machines do by themselves."""


@dataclass(frozen=True)
class Change:
    """One point of an old report and the same one now.

    Attributes
    ----------
    old, new : Cell
        Of the same clip, coder and tolerance.
    """

    old: Cell
    new: Cell

    @property
    def growth(self) -> float | None:
        """Change of the whole file as a share: 0.05 is five per cent larger; None where one has no bytes."""
        if self.old.size is None or self.new.size is None:
            return None
        return (self.new.size + self.new.constant_size) / (self.old.size + self.old.constant_size) - 1.0

    @property
    def verdict(self) -> str:
        """In a word or two."""
        if self.growth is None:
            before, after = self.old.size is not None, self.new.size is not None
            return "no change" if before == after else "keeps the bound now" if after else "no longer keeps the bound"
        if abs(self.growth) >= WORTH_SAYING:
            return "larger" if self.growth > 0 else "smaller"
        return "no change"

    def __str__(self) -> str:
        grown = "" if self.growth is None else f" by {100 * self.growth:.2g} %"
        return f"{self.new.clip}, {label(self.new.coder)} at {self.new.tolerance:g}: {self.verdict}{grown}"


def read_cells(path: Path) -> list[Cell]:
    """The measured points of an earlier report's JSON.

    Raises
    ------
    InputError
        If there is no such file, or it is not a report.
    """
    try:
        points = json.loads(path.read_text(encoding="utf-8"))["points"]
        return [Cell.from_dict(point) for point in points]
    except OSError as error:
        raise InputError("cannot be read; name the report.json of an earlier report", path=path) from error
    except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise InputError("is not the report.json of an earlier report", path=path) from error
    except InputError as error:
        raise InputError(error.message, path=path) from error


def compare_cells(old: Sequence[Cell], new: Sequence[Cell]) -> list[Change]:
    """Points that both have, in the order of the new report."""
    before = {(cell.clip, cell.coder, cell.tolerance): cell for cell in old}
    pairs = [(before.get((cell.clip, cell.coder, cell.tolerance)), cell) for cell in new]
    return [Change(cell, now) for cell, now in pairs if cell is not None]


def too_large(changes: Sequence[Change], allowed: float) -> list[Change]:
    """Changes of pdecodec's own points that fail: larger by more than `allowed`, or the bound is kept no longer."""
    return [
        change
        for change in changes
        if change.new.kind == "profile"
        and ((change.growth is not None and change.growth > allowed) or (change.old.reached and not change.new.reached))
    ]


def comparison_exhibit(changes: Sequence[Change]) -> Exhibit:
    """The changes of pdecodec's own points, in a table."""
    own = [change for change in changes if change.new.kind == "profile"]
    rows = tuple(
        (
            change.new.clip,
            label(change.new.coder),
            change.new.tolerance,
            change.old.bpvf,
            change.new.bpvf,
            None if change.growth is None else 100.0 * change.growth,
            _share(change.new.encode_rate, change.old.encode_rate),
            _share(change.new.decode_rate, change.old.decode_rate),
            change.verdict,
        )
        for change in own
    )
    return Exhibit(
        name="comparison",
        title="Beside the earlier report",
        lesson=comparison_text(changes),
        table=Table(
            (
                "clip",
                "coder",
                "tolerance",
                "bits per vertex and frame before",
                "now",
                "file [%]",
                "encode speed [%]",
                "decode speed [%]",
                "verdict",
            ),
            rows,
        ),
        shows_table=True,
    )


def comparison_text(changes: Sequence[Change]) -> str:
    """In two sentences, what got better and what got worse."""
    own = [change for change in changes if change.new.kind == "profile"]
    if not own:
        return "The earlier report has no point in common with this one."
    counts = [
        f"{sum(change.verdict == verdict for change in own)} {verdict}"
        for verdict in dict.fromkeys(change.verdict for change in own)
    ]
    slower = [
        change for change in own if (_share(change.new.encode_rate, change.old.encode_rate) or 0.0) < -100 * SLOWER
    ]
    worst = max(own, key=lambda change: change.growth or 0.0)
    said = f"Of {len(own)} points of pdecodec: {', '.join(counts)}."
    if worst.growth is not None and worst.growth >= WORTH_SAYING:
        said += (
            f" Most grew {worst.new.clip} under {label(worst.new.coder)} at {worst.new.tolerance:g}, by "
            f"{100 * worst.growth:.2g} %."
        )
    if slower:
        said += f" {len(slower)} are encoded more than {100 * SLOWER:.0f} % slower."
    return said


def _share(new: float | None, old: float | None) -> float | None:
    return None if not new or not old else 100.0 * (new / old - 1.0)
