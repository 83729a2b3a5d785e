"""Write a report: one HTML page that works offline and prints well, and files for each figure next to it.

Each figure gets a PNG (charts an SVG too) and a CSV; each table on the page a Markdown file for documents that quote
it; the report gets one JSON of everything.
"""

from __future__ import annotations

import base64
import csv
import importlib.metadata
import io
import json
import math
import platform
from collections.abc import Iterable, Mapping
from html import escape
from pathlib import Path
from typing import Any
from urllib.parse import quote

from pdecodec import __version__
from pdecodec.batch.summary import markdown_text
from pdecodec.report.charts.figure import Figure, Report, Section, Table, Value
from pdecodec.report.charts.vegalite import as_png, as_svg, for_page, page_script, require_drawing
from pdecodec.system.whole_output import whole_file

PAGE = "index.html"
RECORD = "report.json"

LIBRARIES = ("numpy", "scipy", "vl-convert-python")
"""Libraries that compute and draw; their versions are recorded."""

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
@media screen and (max-width: 48rem) { figure img, .chart svg { min-width: 44rem; }
  table:not(.words) td:not(.number) { min-width: 8rem; }
  .words thead { display: none; } .words tr { display: block; border-bottom: 1px solid var(--rule); padding: .5rem 0; }
  .words td { display: block; border: 0; padding: .15rem 0; } .words td.number { text-align: left; }
  .words td::before { content: attr(data-name) ": "; color: var(--quiet); } }
@media print { body { margin: 0; max-width: none; font-size: 10.5pt; } section, tr { break-inside: avoid; }
  h2, h3 { break-after: avoid; } a { color: inherit; text-decoration: none; } .table, figure { overflow: visible; }
  table { font-size: 8pt; } }
"""

LONG_TEXT = 60
"""Length in characters from which a table entry counts as a sentence."""

WORD_CLASSES = {"reproduced": "good", "reproduced with a condition": "partly", "not reproduced": "bad"}
"""Values with these words are emphasised by weight and colour; colour is never the only sign."""


def write_report(report: Report, directory: Path, *, record: Mapping[str, Any] | None = None) -> list[Path]:
    """Write everything into `directory`, which exists; replace each file of the same name as a whole.

    `record` is added to the JSON. Returns the written paths, the page first. Raises MissingExtraError if charts
    cannot be drawn.
    """
    require_drawing()
    made_with = versions()
    pictures: dict[str, bytes] = {}
    files: dict[str, bytes | str] = {}
    for figure in report.figures:
        if figure.picture is not None:
            files[f"{figure.name}.png"] = pictures[figure.name] = as_png(figure.picture())
        if figure.chart is not None:
            drawn = as_svg(figure.chart)
            files[f"{figure.name}.svg"] = pictures[figure.name] = drawn.encode()
            files[f"{figure.name}.png"] = as_png(drawn)
        files[f"{figure.name}.csv"] = as_csv(figure.table)
        if figure.shows_table:
            files[f"{figure.name}.md"] = as_markdown(figure.table)
    files |= dict(report.pages)
    files[RECORD] = as_json(report, made_with, record or {})
    files[PAGE] = render_page(report, pictures, made_with)
    for name, content in files.items():
        with whole_file(directory / name, overwrite=True) as partial:
            partial.write_bytes(content.encode() if isinstance(content, str) else content)
    return [directory / PAGE, *(directory / name for name in files if name != PAGE)]


def versions() -> dict[str, str]:
    """Return the versions of pdecodec, of Python and of the libraries that compute, and the machine's architecture."""
    found = {"pdecodec": __version__, "Python": platform.python_version()}
    found |= {name: importlib.metadata.version(name) for name in LIBRARIES}
    return {**found, "machine": platform.machine()}


def as_csv(table: Table) -> str:
    """Return a table as CSV with all digits; missing values are empty."""
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    writer.writerow(table.columns)
    writer.writerows([["" if value is None else value for value in row] for row in table.rows])
    return text.getvalue()


def as_markdown(table: Table) -> str:
    """Return a table as Markdown, with values as the page shows them."""

    def line(values: Iterable[Value]) -> str:
        return "| " + " | ".join(markdown_text(value_text(value)) for value in values) + " |"

    return "\n".join([line(table.columns), "|---" * len(table.columns) + "|", *map(line, table.rows)]) + "\n"


def as_json(report: Report, made_with: Mapping[str, str], more: Mapping[str, Any]) -> str:
    """Return every value of a report with the settings and versions behind it; values that are not finite are null."""

    def finite(value: Value) -> Value:
        return None if isinstance(value, float) and not math.isfinite(value) else value

    record = {
        "title": report.title,
        "summary": report.summary,
        "settings": report.settings,
        "versions": made_with,
        "figures": {
            figure.name: {
                "title": figure.title,
                "lesson": figure.lesson,
                "consequence": figure.consequence,
                "columns": figure.table.columns,
                "rows": [[finite(value) for value in row] for row in figure.table.rows],
            }
            for figure in report.figures
        },
        **more,
    }
    return json.dumps(record, indent=1, allow_nan=False) + "\n"


def render_page(report: Report, pictures: Mapping[str, bytes], made_with: Mapping[str, str]) -> str:
    """Return the page. `pictures` are PNGs of pictures, and SVGs of charts for browsers without scripts."""
    body = [f"<h1>{escape(report.title)}</h1>", _paragraphs(report.summary)]
    if report.links:
        links = ", ".join(f'<a href="{quote(to)}">{escape(name)}</a>' for name, to in report.links)
        body.append(f"<p>{links}</p>")
    body += [_section(section, pictures) for section in report.sections]
    body += ["<h2>How this was made</h2>", _definitions({**report.settings, **made_with})]
    if any(figure.chart is not None for figure in report.figures):
        body.append(f"<script>{page_script()}</script>")
    return (
        '<!DOCTYPE html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
        '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
        f"<title>{escape(report.title)}</title>\n<style>{STYLE}</style>\n</head>\n<body>\n"
        + "\n".join(body)
        + "\n</body>\n</html>\n"
    )


def _section(section: Section, pictures: Mapping[str, bytes]) -> str:
    parts = [f"<h2>{escape(section.title)}</h2>", _paragraphs(section.introduction)]
    return "\n".join(parts + [_figure(figure, pictures.get(figure.name)) for figure in section.figures])


def _figure(figure: Figure, picture: bytes | None) -> str:
    parts = [f'<section id="{figure.name}">', f"<h3>{escape(figure.title)}</h3>", _paragraphs(figure.lesson)]
    files = [f"{figure.name}.csv"]
    if figure.chart is not None and picture is not None:
        image = _image(figure.title, picture, "svg+xml")
        parts.append(f'<figure><script type="application/json">{for_page(figure.chart)}</script>')
        parts.append(f'<div class="chart" id="{figure.name}-chart"></div><noscript>{image}</noscript></figure>')
        files[:0] = [f"{figure.name}.svg", f"{figure.name}.png"]
    elif picture is not None:
        parts.append(f"<figure>{_image(figure.title, picture, 'png')}</figure>")
        files.insert(0, f"{figure.name}.png")
    if figure.shows_table and figure.table.rows:
        parts.append(_table(figure.table))
    if figure.consequence:
        parts.append(f'<p class="consequence"><b>What pdecodec does:</b> {escape(figure.consequence)}</p>')
    links = ", ".join(f'<a href="{name}">{name}</a>' for name in files)
    return "\n".join([*parts, f'<p class="files">{links}</p>', "</section>"])


def _image(title: str, data: bytes, kind: str) -> str:
    return f'<img alt="{escape(title)}" src="data:image/{kind};base64,{base64.b64encode(data).decode("ascii")}">'


def _table(table: Table) -> str:
    """Return a table as HTML. If it holds sentences, every cell names its column: on a phone cells stack."""
    has_words = any(isinstance(value, str) and len(value) > LONG_TEXT for row in table.rows for value in row)
    classes = [
        ' class="number"' * all((isinstance(v, int | float) and not isinstance(v, bool)) or v is None for v in column)
        for column in zip(*table.rows, strict=True)
    ]

    def line(values: Iterable[Value], tag: str) -> str:
        names = [f' data-name="{escape(name)}"' * (has_words and tag == "td") for name in table.columns]
        marked = [
            f"<{tag}{kind}{name}>{_marked(value)}</{tag}>"
            for value, kind, name in zip(values, classes, names, strict=True)
        ]
        return f"<tr>{''.join(marked)}</tr>"

    body = "\n".join(line(row, "td") for row in table.rows)
    words = ' class="words"' if has_words else ""
    return (
        f'<div class="table"><table{words}>\n<thead>{line(table.columns, "th")}</thead>\n'
        f"<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _marked(value: Value) -> str:
    text = escape(value_text(value))
    kind = WORD_CLASSES.get(value) if isinstance(value, str) else None
    return text if kind is None else f'<span class="{kind}">{text}</span>'


def value_text(value: Value) -> str:
    """Format a value for people: four significant digits, separated thousands, ``-`` if there is none."""
    if value is None:
        return "-"
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, int):
        return f"{value:,}"
    if isinstance(value, float):
        if not math.isfinite(value):
            return "not finite"
        return f"{value:.4g}" if value == 0 or 1e-4 <= abs(value) < 1e6 else f"{value:.2e}"
    return value


def _definitions(values: Mapping[str, Value | list[Value]]) -> str:
    texts = {
        key: ", ".join(map(value_text, value)) if isinstance(value, list) else value_text(value)
        for key, value in values.items()
    }
    return f"<dl>{''.join(f'<dt>{escape(key)}</dt><dd>{escape(text)}</dd>' for key, text in texts.items())}</dl>"


def _paragraphs(text: str) -> str:
    return "\n".join(f"<p>{escape(paragraph)}</p>" for paragraph in text.split("\n\n") if paragraph)
