"""Measure what each decision and each tuned constant of the encoder does, as the table in `docs/encoder.md` shows it.

``python -m pdecodec.research.ablation FOLDER > docs/ablation.csv`` encodes all clips of a folder without one decision
after another (:data:`DECISIONS`), then with each number of :class:`pdecodec.codec.encode.tuning.Tuning` halved and
doubled alone (of a ratio, its excess over 1). Every row is relative to the usual tuning: bytes of all clips, bytes of
the clip that grows most, processor time of encoding, and the geometric means over the clips of the error of normals
and of the spatio-temporal edge difference, both measured on decoded files. ``make docs`` then writes the page again.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, fields, replace
from pathlib import Path
from statistics import geometric_mean
from typing import Any

from pdecodec import open_animation, open_sequence
from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.encoding import encode
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.mesh.surface_metrics import measure_surfaces

TOLERANCE = 1e-3
"""Bound of all encodes, over the diagonal."""

HEADER = "name,change,bytes,worst_bytes,seconds,normals,sted"
"""Columns of the table; `change` is "without" for a decision, "half" or "double" for a constant."""

DECISIONS: Mapping[str, Mapping[str, Any]] = {
    "refinement": {"refining_passes": ()},
    "dead zone": {"dead_zones": ((0.5, 0.5),), "refining_passes": ()},
    "division into groups, close steps": {"is_thorough": False},
    "several spatial bases": {"spatial_bases": (("patch", 64),), "small_mesh_spatial_bases": ()},
    "reference frames finer than usual": {"finest_reference_step": 0.39},
    "early exit": {"early_exit_ratio": 2.0, "untuned_exit_ratio": 2.0},
    "estimate from a sample": {"small_mesh_vertices": 2**31},
}
"""For each decision, by its name in the table, the changes of the tuning that take it away; "dead zone" also
takes away the refinement.
"""


@dataclass(frozen=True)
class Measured:
    """Bytes of each clip, processor time of all [s], and error of normals [degrees] and edges of clips with faces."""

    sizes: list[int]
    seconds: float
    normals: list[float]
    edges: list[float]


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
    """Yield name, change and tuning for each decision taken away and each number that is halved or doubled."""
    yield from ((name, "without", replace(tuning, **changes)) for name, changes in DECISIONS.items())
    for item in fields(Tuning):
        value = getattr(tuning, item.name)
        if isinstance(value, bool) or not isinstance(value, int | float) or value in (0, float("inf")):
            continue
        for factor, change in ((0.5, "half"), (2.0, "double")):
            # Halve or double only the part of a ratio above 1: below 1 it would be meaningless.
            changed = 1.0 + factor * (value - 1.0) if item.name.endswith("_ratio") else type(value)(value * factor)
            yield item.name, change, replace(tuning, **{item.name: changed})  # type: ignore[arg-type]  # one of many


def measure(clips: Sequence[MeshSequence]) -> Measured:
    """Encode clips at the present tuning, decode them and measure both."""
    started = time.process_time()
    reports = [encode(clip, tolerance=TOLERANCE) for clip in clips]
    seconds = time.process_time() - started
    normals, edges = [], []
    for clip, report in zip(clips, reports, strict=True):
        with open_animation(report.data or b"") as decoded:
            found = measure_surfaces(clip, decoded, report.scale)
        normals += [found.normal_error] if found.normal_error else []
        edges += [found.sted] if found.sted else []
    return Measured([report.file_bytes for report in reports], seconds, normals, edges)


def rows(clips: Sequence[MeshSequence], tried: Iterable[tuple[str, str, Tuning]]) -> Iterator[str]:
    """Yield the lines of the table, as CSV, of some :func:`variants`."""
    measure(clips)  # fills caches
    usual = measure(clips)
    yield HEADER
    for name, change, tuning in tried:
        with tuned(tuning):
            found = measure(clips)
        figures = (
            sum(found.sizes) / sum(usual.sizes),
            max(new / old for new, old in zip(found.sizes, usual.sizes, strict=True)),
            found.seconds / usual.seconds,
            geometric_mean(found.normals) / geometric_mean(usual.normals),
            geometric_mean(found.edges) / geometric_mean(usual.edges),
        )
        yield ",".join([f'"{name}"', change, *(f"{figure:.4f}" for figure in figures)])


if __name__ == "__main__":
    sequences = [open_sequence(path) for path in sorted(Path(sys.argv[1]).iterdir()) if path.is_file()]
    for row in rows(sequences, variants(TUNINGS["default"])):
        print(row, flush=True)
