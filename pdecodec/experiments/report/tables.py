"""The tables that a report is cited by: every figure of merit a row, and means over a corpus."""

from __future__ import annotations

import math
import statistics
from collections.abc import Callable, Sequence

from pdecodec.experiments.exhibit import Cell as TableCell
from pdecodec.experiments.exhibit import Table
from pdecodec.experiments.report.cell import DERIVED, Cell, best_peer
from pdecodec.experiments.report.coderstyle import label

MERITS: dict[str, Callable[[Cell], float | None]] = {
    "ratio": lambda cell: cell.ratio,
    "bpvf": lambda cell: cell.bpvf,
    "max / bound": lambda cell: None if cell.max_error is None else cell.max_error / cell.tolerance,
    "p99": lambda cell: cell.p99_error,
    "rms": lambda cell: cell.rms_error,
    "KG %": lambda cell: cell.kg_error,
    "within %": lambda cell: None if cell.within is None else 100.0 * cell.within,
    "encode MB/s": lambda cell: cell.encode_rate,
    "decode / copy": lambda cell: cell.decode_multiple,
    "random ms": lambda cell: None if cell.random_seconds is None else 1e3 * cell.random_seconds,
}
"""Columns of one coder's table."""

BESIDE = ("best other method", "its bpvf", "ours / its", "ours / best as published")


def merit_table(cells: Sequence[Cell], *, coder: str, tolerances: Sequence[float], means: bool) -> Table:
    """One coder's figures, a row for each clip and tolerance, beside the best of the peers.

    Parameters
    ----------
    cells : sequence of Cell
        Of all coders and clips.
    coder : str
    tolerances : sequence of float
        Rows of others are left out.
    means : bool
        Whether medians and geometric means follow, for each tolerance.
    """
    rows: list[tuple[TableCell, ...]] = []
    has_peers = any(cell.kind == "peer" for cell in cells)
    for tolerance in tolerances:
        chosen = [cell for cell in cells if cell.coder == coder and cell.tolerance == tolerance]
        found = [_merits(cell, cells, has_peers=has_peers) for cell in chosen]
        rows += [(cell.clip, tolerance, *row) for cell, row in zip(chosen, found, strict=True)]
        if means and len(found) > 1:
            columns = list(zip(*found, strict=True))
            rows.append(("median", tolerance, *(_mean(column, statistics.median) for column in columns)))
            rows.append(("geometric mean", tolerance, *(_mean(column, geometric_mean) for column in columns)))
    return Table(("clip", "tolerance", *MERITS, *(BESIDE if has_peers else ())), tuple(rows))


def _merits(cell: Cell, cells: Sequence[Cell], *, has_peers: bool) -> tuple[TableCell, ...]:
    own = tuple(merit(cell) for merit in MERITS.values())
    if not has_peers:
        return own
    same = [other for other in cells if other.clip == cell.clip]
    best, published = (best_peer(same, cell.tolerance, published=only) for only in (False, True))
    if best is None:
        return (*own, "none keeps the bound", None, None, None)
    return (*own, best.coder, best.bpvf, size_ratio(cell, best), size_ratio(cell, published))


def size_ratio(cell: Cell, other: Cell | None) -> float | None:
    """Bytes of one over those of another, connectivity left out."""
    return None if other is None or not other.size or cell.size is None else cell.size / other.size


def _mean(column: Sequence[TableCell], mean: Callable[[Sequence[float]], float]) -> TableCell:
    numbers = [float(value) for value in column if isinstance(value, int | float)]
    if any(isinstance(value, str) for value in column) or not numbers:
        return None
    return mean(numbers)


def geometric_mean(values: Sequence[float]) -> float:
    """The geometric mean; zero where a value is."""
    return math.exp(statistics.fmean(map(math.log, values))) if min(values) > 0 else 0.0


def point_table(cells: Sequence[Cell]) -> Table:
    """Every measured point, every figure of it."""
    names = [name for name in cells[0].to_dict() if name != "sections"]
    assert set(DERIVED) <= set(names)
    rows = []
    for cell in cells:
        values = cell.to_dict()
        rows.append(tuple(label(values[name]) if name == "coder" else values[name] for name in names))
    return Table(tuple(names), tuple(rows))
