"""What a report is made of: tables of measured figures, exhibits around them, chapters of exhibits.

Plain data, so that whatever measures need not know how its figures are drawn, printed or stored.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Cell = str | int | float | bool | None
"""One entry of a table; None where there is nothing to measure."""


@dataclass(frozen=True)
class Table:
    """Rows of figures under named columns; units stand in the names.

    Attributes
    ----------
    columns : tuple of str
    rows : tuple of tuples of Cell
        As many cells each as there are columns.
    """

    columns: tuple[str, ...]
    rows: tuple[tuple[Cell, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row has {len(row)} cells, there are {len(self.columns)} columns")

    def column(self, name: str) -> list[Cell]:
        """All cells of one column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]


@dataclass(frozen=True)
class Exhibit:
    """One thing shown: a chart, what one learns from it, and its figures.

    Attributes
    ----------
    name : str
        Of its files, words joined by hyphens: ``fit-condition`` gives fit-condition.png and fit-condition.csv.
    title : str
    lesson : str
        What one learns, in a sentence or two, with the figures of this run.
    table : Table
        Every figure of the chart.
    draw : callable or None
        Draws the chart into an empty figure. Called once, when the report is written.
    size : tuple of float
        Width and height of the chart [inches].
    consequence : str
        What pdecodec does about it; empty where there is nothing to do.
    shows_table : bool
        Whether the table is part of the page too; otherwise it is in its CSV alone.
    chart : mapping or None
        Instead of `draw`: the chart as a Vega-Lite view (:mod:`pdecodec.experiments.vegalite`), interactive in the
        page.
    """

    name: str
    title: str
    lesson: str
    table: Table
    draw: Callable[[Figure], None] | None = None
    size: tuple[float, float] = (9.0, 4.5)
    consequence: str = ""
    shows_table: bool = False
    chart: Mapping[str, Any] | None = None


@dataclass(frozen=True)
class Chapter:
    """Exhibits about one subject, after a paragraph that says what it is."""

    title: str
    introduction: str
    exhibits: tuple[Exhibit, ...]


@dataclass(frozen=True)
class Report:
    """A page and everything that lies beside it.

    Attributes
    ----------
    title : str
    summary : str
        A paragraph at the top.
    chapters : tuple of Chapter
    settings : dict
        What the run was asked for, ready for JSON.
    links : tuple of (str, str)
        Further pages: what they are of, and their address from this one.
    """

    title: str
    summary: str
    chapters: tuple[Chapter, ...]
    settings: dict[str, Cell | list[Cell]]
    links: tuple[tuple[str, str], ...] = ()

    @property
    def exhibits(self) -> tuple[Exhibit, ...]:
        return tuple(exhibit for chapter in self.chapters for exhibit in chapter.exhibits)
