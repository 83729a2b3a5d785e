"""Measure what each tuned constant of the encoder does: ``python -m pdecodec.research.ablation FOLDER``.

Every number of :class:`pdecodec.codec.encode.tuning.Tuning` is halved and doubled alone (of a ratio its excess over
one); all clips of a folder are encoded with it. The table has bytes and processor time over those of the usual tuning.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields, replace
from pathlib import Path
from typing import Any

from pdecodec import open_sequence
from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.encoding import encode
from pdecodec.mesh.sequence import MeshSequence

TOLERANCE = 1e-3
"""Bound of all encodes, over the diagonal."""


@contextmanager
def tuned(tuning: Tuning) -> Iterator[None]:
    """Encode with a tuning at default effort until the block ends."""
    usual = TUNINGS["default"]
    TUNINGS["default"] = tuning
    try:
        yield
    finally:
        TUNINGS["default"] = usual


def variants(tuning: Tuning) -> Iterator[tuple[str, str, Tuning]]:
    """Return name, change and tuning for each number that is halved or doubled."""
    for item in fields(Tuning):
        value = getattr(tuning, item.name)
        if isinstance(value, bool) or not isinstance(value, int | float) or value in (0, float("inf")):
            continue
        for factor, change in ((0.5, "half"), (2.0, "double")):
            # Of a ratio, what it is above one: below one nothing would be left.
            changed = 1.0 + factor * (value - 1.0) if item.name.endswith("_ratio") else type(value)(value * factor)
            changes: dict[str, Any] = {item.name: changed}
            yield item.name, change, replace(tuning, **changes)


def measure(clips: Sequence[MeshSequence]) -> tuple[list[int], float]:
    """Return the bytes of each clip and the processor time of all [s]."""
    started = time.process_time()
    sizes = [encode(clip, tolerance=TOLERANCE).file_bytes for clip in clips]
    return sizes, time.process_time() - started


def rows(clips: Sequence[MeshSequence]) -> Iterator[str]:
    """Return the lines of the table, as Markdown."""
    measure(clips)  # warms up
    usual, seconds = measure(clips)
    yield f"| constant | change | bytes of {len(clips)} clips | worst clip | time |"
    yield "|---|---|---|---|---|"
    for name, change, tuning in variants(TUNINGS["default"]):
        with tuned(tuning):
            sizes, taken = measure(clips)
        worst = max(new / old for new, old in zip(sizes, usual, strict=True))
        yield f"| {name} | {change} | {sum(sizes) / sum(usual):.4f} | {worst:.4f} | {taken / seconds:.2f} |"


if __name__ == "__main__":
    for row in rows([open_sequence(path) for path in sorted(Path(sys.argv[1]).iterdir()) if path.is_file()]):
        print(row, flush=True)
