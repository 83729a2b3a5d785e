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
    tried = [one for one in variants(usual) if one[0] in ("refinement", "usual_step")]
    found = list(csv.DictReader(rows([ArraySequence(wave, objects=[MeshObject("wave", grid(8, 8))])], tried)))
    assert TUNINGS["default"] is usual
    assert [(row["name"], row["change"]) for row in found] == [one[:2] for one in tried]
    assert len(found) == 3
    for row in found:
        assert all(0.2 < float(row[name]) < 5 for name in ("bytes", "worst_bytes", "normals", "sted"))
    assert float(found[0]["bytes"]) >= 1.0
