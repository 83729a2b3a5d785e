"""Write the specification as PDF: the file format, its rules with their vectors, and the extension of glTF.

    python docs/make_pdf.py FILE

Pandoc (the package pypandoc-binary) turns the Markdown of `spec/` into text for Typst (the package typst), which sets
the pages with fonts of its own. The same text and SOURCE_DATE_EPOCH give the same bytes.
"""

from __future__ import annotations

import os
import re
import sys
from datetime import UTC, datetime
from pathlib import Path

import pypandoc
import typst

SPEC = Path(__file__).resolve().parents[1] / "spec"

PARTS = ("pdeanim.md", "rules.md", "extension/README.md")

STYLE = """\
#set document(title: "The .pdeanim format, version 1.0", author: "The pdecodec maintainers", date: none)
#set page(paper: "a4", margin: (x: 18mm, y: 20mm), numbering: "1")
#set text(font: "Libertinus Serif", size: 10pt)
#set par(justify: true)
#set heading(bookmarked: true)
#show heading.where(level: 1): it => { pagebreak(weak: true); block(below: 1.2em, text(17pt, it.body)) }
#show heading.where(level: 2): set block(above: 1.8em, below: 0.9em)
#show link: set text(fill: rgb("#1c4f8c"))
// Lines of 120 characters, the longest, are as wide as the page.
#show raw.where(block: true): it => block(inset: (y: 2pt), text(6.7pt, it))
#show figure: set block(breakable: true)
#show table: set text(8.5pt)
#show table: set align(left)
#show table: set par(justify: false)
#show table.cell.where(y: 0): strong
#set table(stroke: (x, y) => (bottom: 0.3pt + luma(190)), inset: (x: 4pt, y: 3pt))
"""

TITLE = """\
#align(center + horizon, text(26pt)[The `.pdeanim` format \\ version 1.0])
#align(center)[The file format, the test vectors of its rules, and the extension of glTF \\ pdecodec, {date}]
#pagebreak()
#heading(level: 1, outlined: false)[Contents]
#set par(leading: 0.45em)
#columns(2, text(9pt, outline(title: none, depth: 3, indent: 1em)))
#set par(leading: 0.65em)
"""


def identifier(heading: str) -> str:
    """Return the name of a heading in links, as GitHub and Pandoc derive it."""
    return re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-")


def document() -> str:
    """Return the parts as one document of Markdown, in which links between them lead to headings."""
    texts = {name: (SPEC / name).read_text(encoding="utf-8") for name in PARTS}
    starts = {name: identifier(text.partition("\n")[0].removeprefix("# ")) for name, text in texts.items()}

    def link(found: re.Match[str]) -> str:
        label, path, heading = found.groups()
        name = Path(path).name
        return f"[{label}](#{heading or starts[name]})" if name in starts else label

    # Links to other files have no place to lead to: their labels stay.
    whole = "\n\n".join(texts.values())
    return re.sub(r"\[([^\]]*)\]\((?!https?:|#)([^)#]*)#?([^)]*)\)", link, whole)


def write(path: Path) -> None:
    """Write the pages, dated by SOURCE_DATE_EPOCH."""
    time = datetime.fromtimestamp(int(os.environ.get("SOURCE_DATE_EPOCH", "0")), UTC)
    body = pypandoc.convert_text(document(), "typst", format="gfm", extra_args=["--wrap=none"])
    pages = STYLE + TITLE.format(date=time.date()) + body
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(typst.compile(pages.encode(), ignore_system_fonts=True, timestamp=time))


if __name__ == "__main__":
    write(Path(sys.argv[1]))
