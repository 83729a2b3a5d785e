"""Measure the effect of each decision and each tuned constant of the encoder, for the tables in `docs/encoder.md`.

``python -m pdecodec.research.ablation FOLDER > docs/ablation.csv`` takes a folder that has one folder of clips per
group ("small", "cloths" and so on). It encodes all clips with one decision (:data:`DECISIONS`) switched off at a
time, then with one number of :class:`pdecodec.codec.encode.tuning.Tuning` halved or doubled at a time. Ratios are at
least 1, so only their part above 1 is halved or doubled. Every row compares a group, or all clips, with the usual
tuning: bytes, bytes of the clip that grows most, and processor time of encoding. Rows of decisions also have the
geometric means over the clips of the error of normals and of the spatio-temporal edge difference, both measured on
decoded files. ``make docs`` then writes the page again.
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
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.mesh.surface_metrics import measure_surfaces

Case = tuple[EffortName, float]
"""Effort, and tolerance (the bound divided by the diagonal of the bounding box)."""

CASES: tuple[Case, ...] = (("default", 1e-3), ("fast", 1e-3))
"""Cases that every decision is measured in; constants are measured in the first one alone."""

HEADER = "name,change,effort,tolerance,group,bytes,worst_bytes,seconds,normals,sted"
"""Columns of the table; `change` is "without" for a decision, "half" or "double" for a constant."""

ALL = "all"
"""Group of all clips."""

DECISIONS: Mapping[str, Mapping[str, Any]] = {
    "refinement": {"refining_passes": ()},
    "dead zone": {"dead_zones": ((0.5, 0.5),), "refining_passes": ()},
    "division into groups, close steps": {"is_thorough": False},
    "several spatial bases": {"spatial_bases": (("patch", 64),), "small_mesh_spatial_bases": ()},
    "more spatial bases on small meshes": {"small_mesh_spatial_bases": ()},
    "reference frames finer than usual": {"finest_reference_step": 0.39},
    "limit of fine reference frames": {"finest_reference_step": 2.0**-9},
    "coarser step of smoothed reference frames": {"smoothed_reference_step": 0.4},
    "second search": {"restart_gain": 1.0},
    "early exit": {"early_exit_ratio": 2.0, "untuned_exit_ratio": 2.0},
    "a ratio of its own before steps are searched": {"untuned_exit_ratio": 1.02},
    "estimate from a sample": {"small_mesh_vertices": 2**31},
    "full search of small clips": {"small_clip_positions": 0},
    "smallest sample": {"sample_vertices": 1},
    "every other frame in a sample": {"sample_frames": 2**31},
    "dearer large patches": {"large_patch_gain": 0.0},
    "dead zone of lone coefficients": {"dead_zones": ((0.6, 0.6),)},
    "end of refinement without gain": {"refining_gain": 0.0},
    "longer groups of smooth motion": {"smooth_group_bytes": 3 * 2**25},
    "smooth motion undivided": {"smooth_bits": 0.0},
    "shortest group": {"shortest_group": 2},
    "coarsest step": {"coarsest_step": 1000.0},
    "more error where coefficients are dense": {"mean_error_of_dense": 0.0},
    "cosines by rule": {"dense_share": 2.0},
    "limit of groups that are searched": {"searched_groups": 2**31},
    "saving of memory": {"heavy_group_bytes": 2**62},
}
"""Changes of the tuning that switch a decision off, by its name in the table; "dead zone" switches the
refinement off too.
"""


@dataclass(frozen=True)
class Measured:
    """A clip's file, processor time [s], error of normals [degrees] and edge difference; the last two are 0 if
    not measured.
    """

    data: bytes
    seconds: float
    normals: float = 0.0
    edges: float = 0.0


Groups = Mapping[str, Sequence[MeshSequence]]
"""Clips of each group, by the group's name."""


@contextmanager
def tuned(effort: EffortName, tuning: Tuning) -> Iterator[None]:
    """Encode with a tuning at an effort until the block ends."""
    usual = TUNINGS[effort]
    TUNINGS[effort] = tuning
    try:
        yield
    finally:
        TUNINGS[effort] = usual


def variants(tuning: Tuning) -> Iterator[tuple[str, str, Tuning]]:
    """Yield name, change and tuning: one for each decision switched off, two for each number (halved, doubled)."""
    yield from ((name, "without", replace(tuning, **changes)) for name, changes in DECISIONS.items())
    for item in fields(Tuning):
        value = getattr(tuning, item.name)
        if isinstance(value, bool) or not isinstance(value, int | float) or value in (0, float("inf")):
            continue
        for factor, change in ((0.5, "half"), (2.0, "double")):
            # Halve or double only the part of a ratio above 1: below 1 it would be meaningless.
            changed = 1.0 + factor * (value - 1.0) if item.name.endswith("_ratio") else type(value)(value * factor)
            yield item.name, change, replace(tuning, **{item.name: changed})  # type: ignore[arg-type]  # one of many


def measure(groups: Groups, case: Case, known: Mapping[bytes, Measured] | None = None) -> dict[str, list[Measured]]:
    """Encode the clips of each group with the present tuning; if `known` is given, also decode files that are
    not in it and measure their surfaces.
    """
    effort, tolerance = case

    def measured(clip: MeshSequence) -> Measured:
        started = time.process_time()
        report = encode(clip, tolerance=tolerance, effort=effort)
        found = Measured(report.data or b"", time.process_time() - started)
        if known is None or found.data in known:
            return replace((known or {}).get(found.data, found), seconds=found.seconds)
        with open_animation(found.data) as decoded:
            surface = measure_surfaces(clip, decoded, report.scale)
        return replace(found, normals=surface.normal_error or 0.0, edges=surface.sted or 0.0)

    return {name: [measured(clip) for clip in clips] for name, clips in groups.items()}


def rows(groups: Groups, names: Iterable[str] | None = None, cases: Sequence[Case] = CASES) -> Iterator[str]:
    """Yield the lines of the table as CSV, for all decisions and constants or only those in `names`."""
    measure(groups, cases[0])  # warm caches up
    usual = {case: measure(groups, case, {} if case == cases[0] else None) for case in cases}
    known = {one.data: one for one in _of(usual[cases[0]], ALL)}
    yield HEADER
    wanted = None if names is None else set(names)
    tried = {effort: {one[:2]: one[2] for one in variants(TUNINGS[effort])} for effort, _ in cases}
    for name, change in tried[cases[0][0]]:
        if wanted is not None and name not in wanted:
            continue
        for case in cases if change == "without" else cases[:1]:
            tuning = tried[case[0]].get((name, change), TUNINGS[case[0]])
            if tuning == TUNINGS[case[0]]:
                continue
            measures_surfaces = change == "without" and case == cases[0]
            with tuned(case[0], tuning):
                found = measure(groups, case, known if measures_surfaces else None)
            for group in (ALL, *groups):
                figures = ",".join(
                    _compared(*(_of(each, group) for each in (found, usual[case])), measures_surfaces=measures_surfaces)
                )
                yield f'"{name}",{change},{case[0]},{case[1]:g},{group},{figures}'


def _of(measured: Mapping[str, list[Measured]], group: str) -> list[Measured]:
    return [one for name, clips in measured.items() if group in (name, ALL) for one in clips]


def _compared(found: Sequence[Measured], usual: Sequence[Measured], *, measures_surfaces: bool) -> Iterator[str]:
    """Yield the ratios of a row: `found` divided by `usual`."""
    pairs = list(zip(found, usual, strict=True))
    yield f"{sum(len(one.data) for one in found) / sum(len(one.data) for one in usual):.4f}"
    yield f"{max(len(new.data) / len(old.data) for new, old in pairs):.4f}"
    yield f"{sum(one.seconds for one in found) / sum(one.seconds for one in usual):.2f}"
    for name in ("normals", "edges"):
        ratios = [
            getattr(new, name) / getattr(old, name) for new, old in pairs if measures_surfaces and getattr(old, name)
        ]
        yield f"{geometric_mean(ratios):.4f}" if ratios else ""


if __name__ == "__main__":
    folders = sorted(path for path in Path(sys.argv[1]).iterdir() if path.is_dir())
    clips = {path.name: [open_sequence(file) for file in sorted(path.iterdir())] for path in folders}
    for row in rows(clips, sys.argv[2:] or None):
        print(row, flush=True)
