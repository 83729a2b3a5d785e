"""The ablation: one row for each decision and each number that is halved or doubled, relative to the usual tuning."""

from __future__ import annotations

import csv
from dataclasses import asdict

import numpy as np

from pdecodec import ArraySequence, MeshObject
from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.research.ablation import DECISIONS, rows, variants
from tests.support.mesh_cases import grid


def test_each_variant_changes_one_constant_or_those_of_one_decision() -> None:
    usual = asdict(Tuning())
    found = list(variants(Tuning()))
    for name, change, tuning in found:
        changed = {key for key, value in asdict(tuning).items() if value != usual[key]}
        assert changed == (set(DECISIONS[name]) if change == "without" else {name})
    assert len({(name, change) for name, change, _ in found}) == len(found) > 40


def test_the_table_compares_bytes_time_normals_and_edges_and_leaves_the_tuning_as_it_was() -> None:
    phase = np.linspace(0, 6, 5)[:, None, None]
    x, y = np.meshgrid(np.linspace(0, 1, 8), np.linspace(0, 1, 8))
    wave = np.stack(np.broadcast_arrays(x, y, 0.2 * np.sin(4 * x + 3 * y + phase)), axis=-1).reshape(5, -1, 3)
    usual = TUNINGS["default"]
    waves = {"waves": [ArraySequence(wave, objects=[MeshObject("wave", grid(8, 8))])]}
    found = list(csv.DictReader(rows(waves, ["refinement", "usual_step"])))
    assert TUNINGS["default"] is usual
    changed = [("refinement", "without"), ("usual_step", "half"), ("usual_step", "double")]
    groups = ("all", "waves")
    assert [(row["name"], row["change"], row["group"]) for row in found] == [
        (*one, group) for one in changed for group in groups
    ]
    for row in found:
        names = ("normals", "sted") if row["change"] == "without" else ()
        assert all(0.2 < float(row[name]) < 5 for name in ("bytes", "worst_bytes", *names))
    assert float(found[0]["bytes"]) >= 1.0
