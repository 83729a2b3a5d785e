"""Fields of a simulated sequence, compared with statics worked out by hand and with sums over single constraints."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from plain_constraints import evaluate

from pdecodec.simulate.distance import ChainConstraints, DistanceConstraints
from pdecodec.simulate.scenes import build
from pdecodec.simulate.simulation import Scene
from pdecodec.simulate.system import STANDARD_GRAVITY, System
from pdecodec.simulate.tetrahedra import NeoHookeanConstraints

COMPLIANCE = 1e-4


@pytest.mark.parametrize("as_chain", [True, False])
def test_a_hanging_chain_states_its_energies_and_multipliers(as_chain: bool) -> None:
    loads = STANDARD_GRAVITY * np.array([2.0, 1.0])  # below a fixed particle hang two of 1 kg; pull of each link [N]
    heights = -np.r_[0.0, np.cumsum(1 + COMPLIANCE * loads)]
    positions = np.stack([0 * heights, heights, 0 * heights], axis=1)
    kind = ChainConstraints if as_chain else DistanceConstraints
    links = [[0, 1, 2]] if as_chain else [[0, 1], [1, 2]]
    lengths = np.ones((1, 2)) if as_chain else np.ones(2)
    springs = kind(particles=np.array(links, np.int32), lengths=lengths, compliance=COMPLIANCE)
    system = System(positions=positions, inverse_masses=np.array([0.0, 1, 1]), constraints=(springs,), drag=100.0)
    scene = Scene(name="chain", system=system, visible=np.arange(3, dtype=np.int32), faces=np.zeros((0, 3), np.int32))
    chain = scene.simulate(frames=5, substeps=50, iterations=20, fields=True)
    energies, multipliers, velocities = (
        chain.read_field(name, 4, 5)[0] for name in ("stretch_energy", "stretch_multiplier", "velocity")
    )
    shares = np.array([[0.5, 0], [0.5, 0.5], [0, 0.5]])
    np.testing.assert_allclose(energies, shares @ (0.5 * COMPLIANCE * loads**2), rtol=1e-3)
    np.testing.assert_allclose(multipliers, shares @ (-loads / (24 * 50) ** 2), rtol=1e-3)
    assert np.abs(velocities).max() < 1e-4


def test_free_fall_states_the_velocity_in_the_middle_of_the_last_substep() -> None:
    system = System(positions=np.zeros((1, 3)), inverse_masses=np.ones(1), velocities=np.array([[1.0, 2, 3]]))
    visible, faces = np.zeros(1, np.int32), np.zeros((0, 3), np.int32)
    scene = Scene(name="stone", system=system, visible=visible, faces=faces)
    stone = scene.simulate(frames=4, fps=10, substeps=5, fields=True)
    expected = np.tile(np.array([1.0, 2, 3]), (4, 1, 1))
    expected[:, 0, 1] -= STANDARD_GRAVITY * (np.arange(4) / 10 - 0.01)
    np.testing.assert_allclose(stone.read_field("velocity", 0, 4), expected, rtol=1e-6)


@pytest.mark.parametrize(
    ("name", "options", "kinds"),
    [
        ("cloth", {"columns": 5, "rows": 4}, {"bending": 3, "stretch": 1}),
        ("jelly", {"cells": 2}, {"strain": 2}),
        ("jelly", {"cells": 2, "material": "springs"}, {"stretch": 1, "volume": 1}),
    ],
)
def test_constraints_share_energies_and_multipliers_among_their_particles(
    name: str, options: dict[str, Any], kinds: dict[str, int]
) -> None:
    scene = build(name, **options)
    sequence = scene.simulate(frames=9, fields=True)
    points = sequence.read_frames(8, 9)[0]
    solver, system = sequence.solver, scene.system
    np.testing.assert_array_equal(points, solver.positions[scene.visible].astype(np.float32))
    energies = {kind: np.zeros(len(system.positions)) for kind in kinds}
    multipliers = {kind: np.zeros((len(system.positions), columns)) for kind, columns in kinds.items()}
    for batch, own in zip(system.constraints, solver.multipliers, strict=True):
        for index, members in enumerate(batch.particles):
            values, _ = evaluate(batch, index, solver.positions)
            stiffness = np.broadcast_to(batch.compliances, (batch.count, batch.rows))[index]
            energy = np.where(stiffness > 0, 0.5 * values**2 / np.where(stiffness > 0, stiffness, 1), 0)
            if isinstance(batch, NeoHookeanConstraints):
                at_rest = np.array([np.sqrt(3), 1 - batch.target])
                energy -= 0.5 * at_rest**2 / stiffness
            if isinstance(batch, ChainConstraints):
                for link in range(batch.rows):
                    for particle in members[link : link + 2]:
                        energies[batch.resists][particle] += energy[link] / 2
                        multipliers[batch.resists][particle] += own.reshape(batch.count, -1)[index, link] / 2
                continue
            for particle in members:
                energies[batch.resists][particle] += energy.sum() / len(members)
                multipliers[batch.resists][particle] += own[index] / len(members)
    fields = {field.name: field for field in sequence.fields}
    assert fields.keys() == {"velocity"} | {f"{kind}_multiplier" for kind in kinds} | {
        f"{kind}_energy"
        for kind in kinds
        if kind != "volume"  # constraints of constant volume are rigid, and store no energy
    }
    for name, field in fields.items():
        kind, _, quantity = name.partition("_")
        wanted = {"energy": energies, "multiplier": multipliers}.get(quantity, {kind: solver.velocities})[kind]
        found = sequence.read_field(name, 8, 9)[0]
        scale = np.abs(wanted).max()
        assert scale > 0
        np.testing.assert_allclose(
            found.reshape(len(found), -1), wanted[scene.visible].reshape(len(found), -1), rtol=1e-4, atol=1e-6 * scale
        )
        assert (field.domain, field.dtype) == ("vertex", np.float32)


def test_fields_are_the_same_bits_however_they_are_read() -> None:
    scene = build("cloth", columns=6, rows=5)
    whole = scene.simulate(frames=6, fields=True).to_array()
    np.testing.assert_array_equal(whole.read_frames(0, 6), scene.simulate(frames=6).read_frames(0, 6))
    later = scene.simulate(frames=6, fields=True)
    for start, stop in ((4, 6), (1, 3), (3, 4), (0, 1), (2, 2)):
        for field in later.fields:
            found, expected = (one.read_field(field.name, start, stop) for one in (later, whole))
            assert found.tobytes() == expected.tobytes()
    assert [field.name for field in scene.simulate(method="pbd", fields=True).fields] == [
        "velocity", "bending_energy", "stretch_energy"
    ]  # fmt: skip
