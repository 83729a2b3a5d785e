"""A report as one HTML page that works offline and prints well: styles and pictures are inside it."""

from __future__ import annotations

import base64
import math
from collections.abc import Mapping
from html import escape
from urllib.parse import quote

from pdecodec.experiments.exhibit import Cell, Chapter, Exhibit, Report, Table
from pdecodec.experiments.vegalite import for_page, page_script

STYLE = """
:root { color-scheme: light dark; --ink: #1a1a1a; --quiet: #555; --rule: #ddd; --paper: #fff; --mark: #0072b2;
  --good: #005a43; --partly: #7a4b00; --bad: #a13b00; }
@media (prefers-color-scheme: dark) { :root { --ink: #e8e8e8; --quiet: #a8a8a8; --rule: #3a3d42; --paper: #16181c;
  --mark: #56b4e9; --good: #5fd0a8; --partly: #f0b458; --bad: #ff9466; } }
@media print { :root { color-scheme: light; --ink: #000; --quiet: #444; --rule: #ccc; --paper: #fff; --mark: #0072b2;
  --good: #005a43; --partly: #7a4b00; --bad: #a13b00; } }
body { font: 16px/1.5 system-ui, sans-serif; color: var(--ink); background: var(--paper); max-width: 76rem;
  margin: 2rem auto; padding: 0 1rem; }
p, dl { max-width: 60rem; }
h1 { font-size: 1.7rem; line-height: 1.2; } h2 { font-size: 1.35rem; margin-top: 3rem; } h3 { margin: 2.2rem 0 .3rem; }
a { color: var(--mark); }
figure { margin: .6rem 0; overflow-x: auto; } img { max-width: 100%; height: auto; display: block; background: #fff; }
.chart svg { max-width: 100%; height: auto; }
.consequence { border-left: 4px solid var(--mark); padding: .1rem 0 .1rem .8rem; margin: .6rem 0; }
.files { color: var(--quiet); font-size: .85rem; margin: .2rem 0; }
.table { overflow-x: auto; }
table { border-collapse: collapse; font-size: .88rem; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { text-align: left; vertical-align: top; padding: .3rem .7rem .3rem 0; border-bottom: 1px solid var(--rule); }
th { border-bottom: 2px solid var(--ink); } td.number, th.number { text-align: right; }
.good { color: var(--good); font-weight: 600; } .partly { color: var(--partly); font-weight: 600; }
.bad { color: var(--bad); font-weight: 600; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 0 1rem; font-size: .88rem; } dd { margin: 0; }
@media print { body { margin: 0; max-width: none; font-size: 10.5pt; } section, tr { break-inside: avoid; }
  h2, h3 { break-after: avoid; } a { color: inherit; text-decoration: none; } .table, figure { overflow: visible; }
  table { font-size: 8pt; } }
"""

WORD_CLASSES = {"reproduced": "good", "reproduced with a condition": "partly", "not reproduced": "bad"}
"""Cells of these words are set off by weight and colour; the words say it, the colour only helps."""


def render_page(report: Report, pictures: Mapping[str, bytes], made_with: Mapping[str, str]) -> str:
    """The page.

    Parameters
    ----------
    report : Report
    pictures : mapping from str to bytes
        By the exhibit's name: PNG of drawn ones, SVG of interactive charts, for readers without scripts.
    made_with : mapping from str to str
        Versions that made it.
    """
    body = [f"<h1>{escape(report.title)}</h1>", _paragraphs(report.summary)]
    if report.links:
        links = ", ".join(f'<a href="{quote(to)}">{escape(name)}</a>' for name, to in report.links)
        body.append(f"<p>{links}</p>")
    body += [_chapter(chapter, pictures) for chapter in report.chapters]
    body += ["<h2>How this was made</h2>", _definitions({**report.settings, **made_with})]
    if any(exhibit.chart is not None for exhibit in report.exhibits):
        body.append(f"<script>{page_script()}</script>")
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
    if exhibit.chart is not None and picture is not None:
        image = _image(exhibit.title, picture, "svg+xml")
        parts.append(f'<figure><script type="application/json">{for_page(exhibit.chart)}</script>')
        parts.append(f'<div class="chart" id="{exhibit.name}-chart"></div><noscript>{image}</noscript></figure>')
        files[:0] = [f"{exhibit.name}.svg", f"{exhibit.name}.png"]
    elif picture is not None:
        parts.append(f"<figure>{_image(exhibit.title, picture, 'png')}</figure>")
        files.insert(0, f"{exhibit.name}.png")
    if exhibit.shows_table and exhibit.table.rows:
        parts.append(_table(exhibit.table))
    if exhibit.consequence:
        parts.append(f'<p class="consequence"><b>What pdecodec does:</b> {escape(exhibit.consequence)}</p>')
    links = ", ".join(f'<a href="{name}">{name}</a>' for name in files)
    return "\n".join([*parts, f'<p class="files">{links}</p>', "</section>"])


def _image(title: str, data: bytes, kind: str) -> str:
    return f'<img alt="{escape(title)}" src="data:image/{kind};base64,{base64.b64encode(data).decode("ascii")}">'


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
    return f'<div class="table"><table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table></div>'


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
