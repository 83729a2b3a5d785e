"""Compare two reports: figures that got better or worse, and whether the change is acceptable."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from pdecodec.errors import InputError, damaged
from pdecodec.report.charts.figure import Figure, Table, Value
from pdecodec.report.clips.coder_figures import distinct, label
from pdecodec.report.clips.measurement import Measurement

MIN_GROWTH = 0.001
"""Smallest relative change of bytes that is reported."""

MIN_SLOWDOWN = 0.25
"""Smallest relative change of speed that is reported; smaller ones are noise of the machine."""


@dataclass(frozen=True)
class Change:
    """The same point (clip, coder and tolerance) in an old report and now."""

    old: Measurement
    new: Measurement

    @property
    def growth(self) -> float | None:
        """Relative change of the whole file: 0.05 is five per cent larger; None if one has no bytes."""
        if self.old.size is None or self.new.size is None:
            return None
        return self.new.whole_size / self.old.whole_size - 1.0

    @property
    def verdict(self) -> str:
        """Verdict in one or two words."""
        if self.growth is None:
            before, after = self.old.size is not None, self.new.size is not None
            return "no change" if before == after else "keeps the bound now" if after else "no longer keeps the bound"
        if abs(self.growth) >= MIN_GROWTH:
            return "larger" if self.growth > 0 else "smaller"
        return "no change"

    @property
    def failed(self) -> bool:
        """Whether a bound that was kept is no longer kept."""
        return self.old.reached and not self.new.reached

    def __str__(self) -> str:
        grown = "" if self.growth is None else f" by {100 * self.growth:.2g} %"
        return f"{self.new.clip}, {label(self.new.coder)} at {self.new.tolerance:g}: {self.verdict}{grown}"


def read_measurements(path: Path) -> list[Measurement]:
    """Read the measured points of an earlier report's JSON.

    Raises
    ------
    InputError
        If there is no such file, or it is not a report.
    """
    try:
        points = json.loads(path.read_text(encoding="utf-8"))["points"]
        return [Measurement.from_dict(point) for point in points]
    except OSError as error:
        raise InputError(
            "cannot be read; name the report.json of an earlier report", code="unreadable", path=path
        ) from error
    except (UnicodeDecodeError, json.JSONDecodeError, KeyError, TypeError, AttributeError, RecursionError) as error:
        raise damaged("is not the report.json of an earlier report", path=path) from error
    except InputError as error:
        raise error.placed(path=path) from error


def compare_measurements(old: Sequence[Measurement], new: Sequence[Measurement]) -> list[Change]:
    """Return the points that both reports have, in the order of the new one."""
    before = {(point.clip, point.coder, point.tolerance): point for point in old}
    pairs = [(before.get((point.clip, point.coder, point.tolerance)), point) for point in new]
    return [Change(point, now) for point, now in pairs if point is not None]


def too_large(changes: Sequence[Change], allowed: float) -> list[Change]:
    """Return pdecodec's own points that fail: larger by more than `allowed`, or with a bound no longer kept."""
    return [change for change in _own(changes) if change.failed or (change.growth or 0.0) > allowed]


def _own(changes: Sequence[Change]) -> list[Change]:
    return [change for change in changes if change.new.kind == "profile"]


def comparison_figure(changes: Sequence[Change]) -> Figure:
    """Tabulate the changes of pdecodec's own points."""
    own = _own(changes)
    columns: dict[str, list[Value]] = {
        "clip": [change.new.clip for change in own],
        "coder": [label(change.new.coder) for change in own],
        "tolerance": [change.new.tolerance for change in own],
        "bits per vertex and frame before": [change.old.bpvf for change in own],
        "now": [change.new.bpvf for change in own],
        "file [%]": [None if change.growth is None else 100.0 * change.growth for change in own],
        "encode speed [%]": [_share(change.new.encode_rate, change.old.encode_rate) for change in own],
        "decode speed [%]": [_share(change.new.decode_rate, change.old.decode_rate) for change in own],
        "verdict": [change.verdict for change in own],
    }
    return Figure(
        name="comparison",
        title="Compared with the earlier report",
        lesson=comparison_text(changes),
        table=Table.from_columns(columns),
        shows_table=True,
    )


def comparison_text(changes: Sequence[Change]) -> str:
    """Summarise in two sentences what got better and what got worse."""
    own = _own(changes)
    if not own:
        return "The earlier report has no point in common with this one."
    verdicts = [change.verdict for change in own]
    counts = [f"{verdicts.count(verdict)} {verdict}" for verdict in distinct(verdicts)]
    slower = [
        change for change in own if (_share(change.new.encode_rate, change.old.encode_rate) or 0) < -100 * MIN_SLOWDOWN
    ]
    worst = max(own, key=lambda change: change.growth or 0.0)
    said = f"Of {len(own)} points of pdecodec: {', '.join(counts)}."
    if worst.growth is not None and worst.growth >= MIN_GROWTH:
        name = f"{worst.new.clip} under {label(worst.new.coder)} at {worst.new.tolerance:g}"
        said += f" Most grew {name}, by {100 * worst.growth:.2g} %."
    if slower:
        said += f" {len(slower)} are encoded more than {100 * MIN_SLOWDOWN:.0f} % slower."
    return said


def _share(new: float | None, old: float | None) -> float | None:
    return None if not new or not old else 100.0 * (new / old - 1.0)
