"""Measure what carrying the scene costs: bytes of motion, of the carrier and of the original, file by file.

    python -m pdecodec.research.scene_sizes FILE...     prints a table in Markdown

Every file is encoded at the default tolerance, once; files that hold no mesh are named.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

from pdecodec.codec.encoding import encode
from pdecodec.errors import PdecodecError
from pdecodec.formats import open_sequence
from pdecodec.formats.base.companions import input_files

COLUMNS = ("file", "original", "motion", "fields", "scene", "whole", "original / whole")


def rows(paths: Sequence[str]) -> Iterator[tuple[str, ...]]:
    """Yield a row of the table for each file."""
    for path in paths:
        name = Path(path).name
        try:
            with open_sequence(path) as sequence:
                report = encode(sequence)
        except PdecodecError as error:
            yield (name, f"not read: {error.message}", *("",) * (len(COLUMNS) - 2))
            continue
        original = sum(file.stat().st_size for file in input_files(path))
        scene = f"{report.scene_bytes:,}" if report.scene_bytes else report.scene_note or "nothing to carry"
        sizes = (f"{original:,}", f"{report.motion_bytes:,}", f"{report.field_bytes:,}", scene)
        yield (name, *sizes, f"{report.file_bytes:,}", f"{original / report.file_bytes:.1f}")


def main(paths: Sequence[str]) -> None:
    print(f"| {' | '.join(COLUMNS)} |\n|---|{'--:|' * (len(COLUMNS) - 1)}")
    for row in rows(paths):
        print(f"| {' | '.join(row)} |", flush=True)


if __name__ == "__main__":
    main(sys.argv[1:])
