"""Parts of a report: tables of measured values, figures around them, sections of figures.

They are plain data, so that code that measures does not depend on how figures are drawn, printed or stored.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

Value = str | int | float | bool | None
"""One entry of a table; None if there is nothing to measure."""


@dataclass(frozen=True)
class Table:
    """Rows of values, one per named column; units are part of the names."""

    columns: tuple[str, ...]
    rows: tuple[tuple[Value, ...], ...]

    def __post_init__(self) -> None:
        for row in self.rows:
            if len(row) != len(self.columns):
                raise ValueError(f"a row has {len(row)} values, there are {len(self.columns)} columns")

    @classmethod
    def from_columns(cls, columns: Mapping[str, Iterable[Any]]) -> Table:
        """Make a table from equally long columns by name; numpy numbers become plain ones."""
        plain = [
            [value.item() if isinstance(value, np.generic) else value for value in values]
            for values in columns.values()
        ]
        return cls(tuple(columns), tuple(zip(*plain, strict=True)))

    def column(self, name: str) -> list[Value]:
        """Return all values of one column."""
        at = self.columns.index(name)
        return [row[at] for row in self.rows]


@dataclass(frozen=True)
class Figure:
    """A chart or picture, what it teaches, and its values.

    Attributes
    ----------
    name : str
        Name of its files, words joined by hyphens: ``fit-condition`` gives fit-condition.png and fit-condition.csv.
    title : str
    lesson : str
        What the reader learns, in a sentence or two, with the values of this run.
    table : Table
        Every value of the chart.
    chart : mapping or None
        A Vega-Lite view (:mod:`pdecodec.report.charts.plots`), interactive in the page.
    picture : callable or None
        Instead of a chart: returns an SVG (:mod:`pdecodec.report.charts.pictures`). Called once, when
        the report is written.
    consequence : str
        What pdecodec does about it; may be empty.
    shows_table : bool
        Whether the page shows the table too; otherwise only its CSV has it.
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
    """Figures about one subject, after a paragraph that introduces it."""

    title: str
    introduction: str
    figures: tuple[Figure, ...]


@dataclass(frozen=True)
class Report:
    """A page and the files next to it.

    Attributes
    ----------
    title : str
    summary : str
        A paragraph at the top.
    sections : tuple of Section
    settings : dict
        Settings of the run, ready for JSON.
    links : tuple of (str, str)
        Further pages: their subject, and their address relative to this one.
    pages : tuple of (str, str)
        Pages that are written next to this one: file name and HTML.
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
