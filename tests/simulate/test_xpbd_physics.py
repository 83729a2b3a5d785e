"""The solver against mechanics worked out by hand."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipk

from pdecodec.simulate.constraints import Constraints, Method
from pdecodec.simulate.distance import ChainConstraints, DistanceConstraints
from pdecodec.simulate.meshing import lattice_tetrahedra
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.surroundings import AIR_DENSITY, Ground, Pins, Sphere, Wind
from pdecodec.simulate.system import STANDARD_GRAVITY, System
from pdecodec.simulate.tetrahedra import NeoHookeanConstraints, VolumeConstraints, tetrahedron_volumes

CUBE = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
CELLS = lattice_tetrahedra(2)
"""Tetrahedra of a lattice of 27 particles, a metre apart."""


PAIR = {"particles": np.array([[0, 1]]), "lengths": np.ones(1)}
PLATE = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])


def all_pairs(count: int) -> list[list[int]]:
    return [[i, j] for i in range(count) for j in range(i)]


def hung(count: int, *, drag: float = 0.0, **material: float) -> System:
    """Return masses of 1 kg, one metre apart, on springs below a fixed point at the origin."""
    positions = np.zeros((count + 1, 3))
    positions[:, 1] = -np.arange(count + 1)
    links = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    springs = DistanceConstraints.from_positions(positions, links, **material)
    return System(positions=positions, inverse_masses=np.r_[0.0, np.ones(count)], constraints=(springs,), drag=drag)


def floating(positions: Any, *constraints: Constraints, weights: Any = 1.0, **rest: Any) -> System:
    """Return a system; by default, particles weigh 1 kg and there is no gravity."""
    inverse_masses = np.broadcast_to(weights, len(positions))
    return System(
        positions=positions, inverse_masses=inverse_masses, constraints=constraints, **{"gravity": 0.0, **rest}
    )


def run(system: System, substeps: int, **options: Any) -> Solver:
    """Return the solver of a system after some substeps."""
    solver = Solver(system, **options)
    solver.advance(substeps)
    return solver


def residual_of(solver: Solver) -> float:
    """Return the largest ``|C + gamma/dt^2 lambda|`` of the first batch: 0 if Eq. 5 holds."""
    batch, multipliers = solver.system.constraints[0], solver.multipliers[0]
    return float(np.abs(batch.values(solver.positions) + batch.compliances / solver.substep**2 * multipliers).max())


def momenta_of(solver: Solver) -> tuple[np.ndarray, np.ndarray]:
    """Return linear [kg m/s] and angular [kg m^2/s] momentum. Positions are taken half a substep back, at the
    time of the velocities.
    """
    impulses = solver.velocities / solver.system.inverse_masses[:, None]
    middle = 0.5 * (solver.positions + solver.previous)
    return impulses.sum(axis=0), np.cross(middle, impulses).sum(axis=0)


def test_free_fall_is_exact_whatever_the_substep() -> None:
    start, velocity = np.array([[1.0, 2.0, 3.0]]), np.array([[0.5, 4.0, -1.0]])
    system = System(positions=start, velocities=velocity, inverse_masses=np.ones(1))
    for substeps in (1, 7, 100):
        solver = run(system, substeps, substep=2 / substeps)
        expected = start + 2 * velocity + 0.5 * 4 * np.array([0, -STANDARD_GRAVITY, 0])
        np.testing.assert_allclose(solver.positions, expected, atol=1e-12)
        assert solver.time == pytest.approx(2)


def test_drag_slows_at_its_rate() -> None:
    solver = run(floating(np.zeros((1, 3)), velocities=[[3.0, 0, 0]], drag=0.7), 200, substep=0.01)
    assert solver.velocities[0, 0] == pytest.approx(3 * math.exp(-0.7 * 2), rel=1e-12)


def test_a_hanging_mass_stretches_a_spring_by_force_times_compliance() -> None:
    compliance = 2e-3
    solver = run(hung(1, compliance=compliance, drag=20.0), 3000, substep=1e-3)
    assert -solver.positions[1, 1] - 1 == pytest.approx(STANDARD_GRAVITY * compliance, rel=1e-9)
    # Eq. 5: the multiplier divided by the squared substep is the tension of the spring.
    assert solver.multipliers[0][0, 0] / solver.substep**2 == pytest.approx(-STANDARD_GRAVITY, rel=1e-9)
    assert residual_of(solver) < 1e-12


@pytest.mark.parametrize("amplitude", [0.02, 1.0, 2.5])
def test_a_pendulum_has_its_period(amplitude: float) -> None:
    length = 0.8
    bob = length * np.array([math.sin(amplitude), -math.cos(amplitude), 0])
    rod = DistanceConstraints(particles=[[0, 1]], lengths=[length])
    system = floating([np.zeros(3), bob], rod, weights=[0.0, 1.0], gravity=STANDARD_GRAVITY)
    solver = Solver(system, substep=2e-4)
    crossings = []
    while len(crossings) < 2:
        before = solver.positions[1, 0]
        solver.advance()
        after = solver.positions[1, 0]
        if before * after <= 0:
            crossings.append(solver.time - solver.substep * after / (after - before))
    period = 4 * math.sqrt(length / STANDARD_GRAVITY) * ellipk(math.sin(amplitude / 2) ** 2)
    assert 4 * crossings[0] == pytest.approx(period, rel=3e-3)
    # The swing back is shorter, because the solver loses some of the motion, which matters for wide swings.
    assert 2 * (crossings[1] - crossings[0]) == pytest.approx(period, rel=3e-3 if amplitude < 2 else 2e-2)


@settings(max_examples=10)
@given(seed=st.integers(0, 2**32 - 1))
def test_linear_momentum_is_kept_to_rounding_by_every_constraint(seed: int) -> None:
    random = np.random.default_rng(seed)
    system = floating(
        CUBE + 0.1 * random.normal(size=CUBE.shape),
        DistanceConstraints.from_positions(CUBE, [[0, 26], [3, 9], [14, 2]], compliance=1e-3, damping=1e-2),
        ChainConstraints.from_positions(CUBE, np.arange(27).reshape(9, 3), compliance=1e-3),
        VolumeConstraints.from_positions(CUBE, CELLS, compliance=1e-3),
        NeoHookeanConstraints.from_positions(CUBE, CELLS, young=100.0, poisson=0.3),
        velocities=random.normal(size=CUBE.shape),
        weights=random.uniform(0.5, 2, size=len(CUBE)),
    )
    before, after = (momenta_of(run(system, n, substep=0.005, iterations=2))[0] for n in (0, 50))
    np.testing.assert_allclose(after, before, atol=1e-10)


def test_angular_momentum_is_kept_the_better_the_shorter_the_substep() -> None:
    random = np.random.default_rng(8)
    positions = random.normal(size=(6, 3))
    springs = DistanceConstraints.from_positions(positions, all_pairs(6), compliance=1e-3)
    weights, velocities = random.uniform(0.5, 2, size=6), np.cross([0.3, 1.0, -0.5], positions)
    system = floating(positions, springs, weights=weights, velocities=velocities)
    lost = []
    for substeps in (200, 400, 800):
        steps = {"substep": 1 / substeps, "iterations": 20}
        before, after = (momenta_of(run(system, n, **steps))[1] for n in (0, substeps))
        lost.append(np.linalg.norm(after - before) / np.linalg.norm(before))
    assert lost[0] < 0.02
    assert lost[1] == pytest.approx(lost[0] / 2, rel=0.2)
    assert lost[2] == pytest.approx(lost[1] / 2, rel=0.2)


def hanging_stretch(substep: float, iterations: int, method: Method, **material: float) -> float:
    """Return how far springs of 0.4 mm per newton are stretched by five kilograms after four seconds."""
    system = hung(5, compliance=4e-4, drag=8.0, **material)
    solver = run(system, round(4 / substep), substep=substep, iterations=iterations, method=method)
    return float(-solver.positions[-1, 1] - 5)


@pytest.mark.parametrize(("substep", "iterations"), [(4e-3, 50), (2e-3, 20), (2e-3, 80), (5e-4, 5), (5e-4, 20)])
def test_stiffness_under_xpbd_depends_on_neither_step_nor_iterations(substep: float, iterations: int) -> None:
    expected = 4e-4 * STANDARD_GRAVITY * 5 * 6 / 2
    assert hanging_stretch(substep, iterations, "xpbd") == pytest.approx(expected, rel=1e-3)


def test_stiffness_under_pbd_depends_on_both() -> None:
    base = hanging_stretch(2e-3, 20, "pbd", stiffness=0.05)
    # A quarter of the step makes PBD 16 times as stiff, four times as many iterations about 4 times.
    assert hanging_stretch(5e-4, 20, "pbd", stiffness=0.05) < base / 10
    assert hanging_stretch(2e-3, 80, "pbd", stiffness=0.05) < base / 3
    assert base > 5e-4


def test_rayleigh_damping_decays_at_half_the_damping_time_times_the_squared_frequency() -> None:
    compliance, damping = 1e-2, 0.01
    square = 1 / compliance
    spring = DistanceConstraints(**PAIR, compliance=compliance, damping=damping)
    solver = run(floating([[0.0, 0, 0], [1.2, 0, 0]], spring, weights=[0.0, 1.0]), 100_000, substep=1e-5)
    rate = 0.5 * damping * square
    swing = math.sqrt(square - rate**2)
    expected = 0.2 * math.exp(-rate) * (math.cos(swing) + rate / swing * math.sin(swing))
    assert solver.positions[1, 0] - 1 == pytest.approx(expected, abs=2e-4)
    assert abs(expected) > 0.05


@pytest.mark.parametrize("damping", [0.0, 0.005])
@pytest.mark.parametrize("drag", [0.0, 0.5])
def test_energy_never_rises_and_damping_takes_more_of_it(drag: float, damping: float) -> None:
    def energies(drag: float, damping: float) -> np.ndarray:
        spring = DistanceConstraints(**PAIR, compliance=5e-3, damping=damping)
        start = {"velocities": [[0.0, 0, 0], [-0.5, 0, 0]], "weights": [0.0, 2.0], "drag": drag}
        solver = Solver(floating([[0.0, 0, 0], [1.3, 0, 0]], spring, **start), substep=1e-3)
        found = []
        for _ in range(1000):
            found.append(spring.energy(solver.positions) + 0.5 * 0.5 * (solver.velocities**2).sum())
            solver.advance()
        return np.array(found)

    totals = energies(drag, damping)
    assert (np.diff(totals) <= 1e-12).all()
    assert totals[-1] < 0.7 * totals[0]
    if drag or damping:
        assert totals[-1] < 0.9 * energies(0.0, 0.0)[-1]


def test_volume_constraints_bring_a_squeezed_body_back_to_its_volume() -> None:
    system = floating(CUBE * np.array([1.0, 0.6, 1.0]), VolumeConstraints.from_positions(CUBE, CELLS))
    solver = run(system, 1, substep=0.01, iterations=200)
    assert tetrahedron_volumes(solver.positions, CELLS).sum() == pytest.approx(8, rel=1e-6)
    assert residual_of(solver) < 1e-4


def test_a_hanging_neo_hookean_bar_stretches_by_its_youngs_modulus() -> None:
    # A bar of length L under its own weight grows by rho g L^2 / (2 E).
    cells, young, density = 3, 1e6, 1000.0
    cube = np.stack(np.meshgrid(*[np.arange(cells + 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cube *= np.array([0.1, 0.3, 0.1]) / cells
    tetrahedra = lattice_tetrahedra(cells)
    shares = np.repeat(density * tetrahedron_volumes(cube, tetrahedra) / 4, 4)
    weights = 1 / np.bincount(tetrahedra.ravel(), shares, len(cube))
    weights[cube[:, 1] > 0.299] = 0
    # Poisson's ratio of zero: no sideways contraction, which the clamp would hinder.
    solid = NeoHookeanConstraints.from_positions(cube, tetrahedra, young=young, poisson=0.0)
    system = floating(cube, solid, weights=weights, gravity=STANDARD_GRAVITY, drag=20.0)
    solver = run(system, 2000, substep=5e-4, iterations=5)
    fallen = -solver.positions[cube[:, 1] == 0, 1].mean()
    assert fallen == pytest.approx(density * STANDARD_GRAVITY * 0.3**2 / (2 * young), rel=0.02)


@pytest.mark.parametrize("young", [1e2, 1e5, 1e9])
@pytest.mark.parametrize("substep", [1e-3, 4e-2])
def test_a_neo_hookean_body_at_rest_stays_at_rest_however_stiff(young: float, substep: float) -> None:
    solid = NeoHookeanConstraints.from_positions(CUBE, CELLS, young=young, poisson=0.4)
    solver = run(floating(CUBE, solid), 500, substep=substep)
    np.testing.assert_allclose(solver.positions, CUBE, atol=1e-9)


@pytest.mark.parametrize("young", [1e3, 1e6, 1e9])
def test_a_neo_hookean_body_that_is_thrown_comes_to_rest_in_its_shape_however_stiff(young: float) -> None:
    solid = NeoHookeanConstraints.from_positions(CUBE, CELLS, young=young, poisson=0.4)
    thrown = {"velocities": 2 * np.random.default_rng(10).normal(size=CUBE.shape), "gravity": STANDARD_GRAVITY}
    system = floating(CUBE, solid, colliders=(Ground(height=-0.5, friction=0.5),), drag=1.0, **thrown)
    solver = run(system, 2000, substep=5e-3, iterations=2)
    lengths = np.linalg.norm(solver.positions[26] - solver.positions[0])
    assert lengths == pytest.approx(2 * math.sqrt(3), rel=0.2 if young < 1e4 else 0.01)
    assert tetrahedron_volumes(solver.positions, CELLS).min() > 0.1


def test_pins_carry_particles_along_their_path() -> None:
    pins = Pins(particles=np.array([1], np.int32), path=lambda time: np.array([[math.sin(time), 0.0, 0.0]]))
    solver = run(floating(np.zeros((2, 3)), weights=0.0, pins=(pins,)), 50, substep=0.01)
    np.testing.assert_array_equal(solver.positions, [[0, 0, 0], [math.sin(0.5), 0, 0]])
    assert solver.velocities[1, 0] == pytest.approx(math.cos(0.495), rel=1e-4)


def test_nothing_ends_a_substep_inside_the_ground_or_the_sphere() -> None:
    random = np.random.default_rng(9)
    positions = random.uniform(-1, 1, size=(300, 3)) + np.array([0, 3.0, 0])
    ball = Sphere(center=(0.0, 1.0, 0.0), radius=0.6, friction=0.3, thickness=0.05)
    links = np.stack([np.arange(299), np.arange(1, 300)], axis=1)
    springs = DistanceConstraints.from_positions(positions, links, compliance=1e-2)
    fall = {"velocities": random.normal(size=positions.shape), "gravity": STANDARD_GRAVITY}
    colliders = (ball, Ground(height=-0.5, friction=0.3, thickness=0.02))
    solver = Solver(floating(positions, springs, colliders=colliders, **fall), substep=5e-3)
    touched = 0
    for _ in range(300):
        solver.advance()
        distances = np.linalg.norm(solver.positions - np.array(ball.center), axis=1)
        assert distances.min() > 0.65 - 1e-9
        assert solver.positions[:, 1].min() >= -0.48
        touched = max(touched, int((distances < 0.651).sum()))
    assert touched > 3


def test_friction_stops_a_sliding_plate_after_the_squared_speed_over_twice_friction_and_gravity() -> None:
    speed, friction = 2.0, 0.35
    rods = DistanceConstraints.from_positions(PLATE, all_pairs(4))
    sliding = {"velocities": np.tile([speed, 0.0, 0.0], (4, 1)), "gravity": STANDARD_GRAVITY}
    system = floating(PLATE, rods, colliders=(Ground(friction=friction),), **sliding)
    solver = run(system, 1000, substep=1e-3)
    way = solver.positions - PLATE
    np.testing.assert_allclose(way[:, 0], speed**2 / (2 * friction * STANDARD_GRAVITY), rtol=5e-3)
    np.testing.assert_allclose(way[:, 1:], 0, atol=1e-9)
    stopped = solver.positions.copy()
    solver.advance(200)
    np.testing.assert_allclose(solver.positions, stopped, atol=1e-12)


def test_a_falling_plate_reaches_its_terminal_speed() -> None:
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]])  # both diagonals, so that corners share equally
    air = Wind(triangles=triangles, velocity=np.zeros(3), drag=1.0)
    rods = DistanceConstraints.from_positions(PLATE, all_pairs(4))
    system = floating(PLATE, rods, weights=10.0, winds=(air,), gravity=STANDARD_GRAVITY)
    solver = run(system, 2000, substep=2e-3)
    expected = math.sqrt(0.4 * STANDARD_GRAVITY / (0.5 * AIR_DENSITY * 2.0))
    np.testing.assert_allclose(solver.velocities[:, 1], -expected, rtol=1e-3)
