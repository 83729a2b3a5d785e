"""What a report is made of: tables of measured values, figures around them, sections of figures.

Plain data, so that whatever measures need not depend on how its figures are drawn, printed or stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Value = str | int | float | bool | None
"""One entry of a table; None where there is nothing to measure."""


@dataclass(frozen=True)
class Table:
    """Rows of values under named columns, as many each as there are columns; units stand in the names."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row has {len(row)} values, there are {len(self.columns)} columns")

    @classmethod
    def from_columns(cls, columns: Mapping[str, Iterable[Any]]) -> Table:
        """The table of equally long columns by name; numbers of numpy become plain ones."""
        plain = [
            [value.item() if isinstance(value, np.generic) else value for value in values]
            for values in columns.values()
        ]
        return cls(tuple(columns), tuple(zip(*plain, strict=True)))

    def column(self, name: str) -> list[Value]:
        """All values of one column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]


@dataclass(frozen=True)
class Figure:
    """One thing shown: a chart, what one learns from it, and its values.

    Attributes
    ----------
    name : str
        Of its files, words joined by hyphens: ``fit-condition`` gives fit-condition.png and fit-condition.csv.
    title : str
    lesson : str
        What one learns, in a sentence or two, with the values of this run.
    table : Table
        Every value of the chart.
    chart : mapping or None
        A Vega-Lite view (:mod:`pdecodec.report.charts.plots`), interactive in the page.
    picture : callable or None
        Instead of a chart: returns an SVG (:mod:`pdecodec.report.charts.pictures`). Called once, when the report is
        written.
    consequence : str
        What pdecodec does about it; empty where there is nothing to do.
    shows_table : bool
        Whether the table is part of the page too; otherwise it is in its CSV alone.
    """

    name: str
    title: str
    lesson: str
    table: Table
    chart: Mapping[str, Any] | None = None
    picture: Callable[[], str] | None = None
    consequence: str = ""
    shows_table: bool = False


@dataclass(frozen=True)
class Section:
    """Figures about one subject, after a paragraph that says what it is."""

    title: str
    introduction: str
    figures: tuple[Figure, ...]


@dataclass(frozen=True)
class Report:
    """A page and everything that lies beside it.

    Attributes
    ----------
    title : str
    summary : str
        A paragraph at the top.
    sections : tuple of Section
    settings : dict
        What the run was started with, ready for JSON.
    links : tuple of (str, str)
        Further pages: what they are of, and their address from this one.
    pages : tuple of (str, str)
        Pages that are written beside this one: their file's name, and their HTML.
    """

    title: str
    summary: str
    sections: tuple[Section, ...]
    settings: dict[str, Value | list[Value]]
    links: tuple[tuple[str, str], ...] = ()
    pages: tuple[tuple[str, str], ...] = ()

    @property
    def figures(self) -> tuple[Figure, ...]:
        return tuple(figure for section in self.sections for figure in section.figures)
