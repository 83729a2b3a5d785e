"""A report as one HTML page that works offline and prints well: styles and pictures are inside it."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from html import escape

from pdecodec.experiments.exhibit import Cell, Chapter, Exhibit, Report, Table

STYLE = """
:root { color-scheme: light; }
body { font: 16px/1.5 system-ui, sans-serif; color: #1a1a1a; max-width: 62rem; margin: 2rem auto; padding: 0 1rem; }
h1 { font-size: 1.7rem; line-height: 1.2; } h2 { font-size: 1.35rem; margin-top: 3rem; } h3 { margin: 2.2rem 0 .3rem; }
figure { margin: .6rem 0; } img { max-width: 100%; height: auto; display: block; }
.consequence { border-left: 4px solid #0072b2; padding: .1rem 0 .1rem .8rem; margin: .6rem 0; }
.files { color: #555; font-size: .85rem; margin: .2rem 0; }
table { border-collapse: collapse; font-size: .88rem; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .3rem .7rem .3rem 0; border-bottom: 1px solid #d0d0d0; }
th { border-bottom: 2px solid #1a1a1a; } td.number, th.number { text-align: right; }
.good { color: #005a43; font-weight: 600; } .partly { color: #7a4b00; font-weight: 600; }
.bad { color: #a13b00; font-weight: 600; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 0 1rem; font-size: .88rem; } dd { margin: 0; }
@media print { body { margin: 0; max-width: none; font-size: 10.5pt; } section, tr { break-inside: avoid; }
  h2 { break-before: page; } a { color: inherit; text-decoration: none; } }
"""

WORD_CLASSES = {"reproduced": "good", "reproduced with a condition": "partly", "not reproduced": "bad"}
"""Cells of these words are set off by weight and colour; the words say it, the colour only helps."""


def render_page(report: Report, pictures: Mapping[str, bytes], made_with: Mapping[str, str]) -> str:
    """The page.

    Parameters
    ----------
    report : Report
    pictures : mapping from str to bytes
        PNG of each exhibit that has a chart, by the exhibit's name.
    made_with : mapping from str to str
        Versions that made it.
    """
    body = [f"<h1>{escape(report.title)}</h1>", _paragraphs(report.summary)]
    body += [_chapter(chapter, pictures) for chapter in report.chapters]
    body += ["<h2>How this was made</h2>", _definitions({**report.settings, **made_with})]
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(report.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _chapter(chapter: Chapter, pictures: Mapping[str, bytes]) -> str:
    parts = [f"<h2>{escape(chapter.title)}</h2>", _paragraphs(chapter.introduction)]
    return "\n".join(parts + [_exhibit(exhibit, pictures.get(exhibit.name)) for exhibit in chapter.exhibits])


def _exhibit(exhibit: Exhibit, picture: bytes | None) -> str:
    parts = [f'<section id="{exhibit.name}">', f"<h3>{escape(exhibit.title)}</h3>", _paragraphs(exhibit.lesson)]
    files = [f"{exhibit.name}.csv"]
    if picture is not None:
        data = base64.b64encode(picture).decode("ascii")
        parts.append(f'<figure><img alt="{escape(exhibit.title)}" src="data:image/png;base64,{data}"></figure>')
        files.insert(0, f"{exhibit.name}.png")
    if exhibit.shows_table:
        parts.append(_table(exhibit.table))
    if exhibit.consequence:
        parts.append(f'<p class="consequence"><b>What pdecodec does:</b> {escape(exhibit.consequence)}</p>')
    links = ", ".join(f'<a href="{name}">{name}</a>' for name in files)
    return "\n".join([*parts, f'<p class="files">{links}</p>', "</section>"])


def _table(table: Table) -> str:
    numeric = [
        all((isinstance(cell, int | float) and not isinstance(cell, bool)) or cell is None for cell in column)
        for column in zip(*table.rows, strict=True)
    ]
    head = "".join(
        f"<th{_number_class(is_number)}>{escape(name)}</th>"
        for name, is_number in zip(table.columns, numeric, strict=True)
    )
    rows = ["".join(_cell(cell, is_number) for cell, is_number in zip(row, numeric, strict=True)) for row in table.rows]
    body = "\n".join(f"<tr>{row}</tr>" for row in rows)
    return f"<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table>"


def _number_class(is_number: bool) -> str:
    return ' class="number"' if is_number else ""


def _cell(cell: Cell, is_number: bool) -> str:
    text = escape(cell_text(cell))
    if isinstance(cell, str) and cell in WORD_CLASSES:
        return f'<td><span class="{WORD_CLASSES[cell]}">{text}</span></td>'
    return f"<td{_number_class(is_number)}>{text}</td>"


def cell_text(cell: Cell) -> str:
    """A cell for people: four significant digits, thousands separated, ``-`` where there is nothing."""
    if cell is None:
        return "-"
    if isinstance(cell, bool):
        return "yes" if cell else "no"
    if isinstance(cell, int):
        return f"{cell:,}"
    if isinstance(cell, float):
        if not math.isfinite(cell):
            return "not finite"
        return f"{cell:.4g}" if cell == 0 or 1e-4 <= abs(cell) < 1e6 else f"{cell:.2e}"
    return cell


def _definitions(values: Mapping[str, Cell | list[Cell]]) -> str:
    def text(value: Cell | list[Cell]) -> str:
        return ", ".join(map(cell_text, value)) if isinstance(value, list) else cell_text(value)

    return (
        "<dl>"
        + "".join(f"<dt>{escape(key)}</dt><dd>{escape(text(value))}</dd>" for key, value in values.items())
        + ("</dl>")
    )


def _paragraphs(text: str) -> str:
    return "\n".join(f"<p>{escape(paragraph)}</p>" for paragraph in text.split("\n\n") if paragraph)
