"""The solver against mechanics worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipk

from pdecodec.errors import SettingsError
from pdecodec.xpbd.attachment import AttachmentConstraints, Pins
from pdecodec.xpbd.chain import ChainConstraints
from pdecodec.xpbd.contact import Ground, Sphere
from pdecodec.xpbd.distance import DistanceConstraints
from pdecodec.xpbd.measures import measure_energies, measure_momenta, measure_residuals, measure_stretch
from pdecodec.xpbd.meshing import lattice_tetrahedra
from pdecodec.xpbd.neo_hookean import NeoHookeanConstraints
from pdecodec.xpbd.solver import Solver
from pdecodec.xpbd.system import STANDARD_GRAVITY, System
from pdecodec.xpbd.volume import VolumeConstraints, tetrahedron_volumes
from pdecodec.xpbd.wind import AIR_DENSITY, Wind


def hung(count: int, *, compliance: float, stiffness: float = 1.0, damping: float = 0.0, drag: float = 0.0) -> System:
    """One kilogram after another, a metre apart, on springs below a held point at the origin."""
    positions = np.zeros((count + 1, 3))
    positions[:, 1] = -np.arange(count + 1)
    links = np.stack([np.arange(count), np.arange(1, count + 1)], axis=1)
    springs = DistanceConstraints.from_positions(
        positions, links, compliance=compliance, stiffness=stiffness, damping=damping
    )
    return System(positions=positions, inverse_masses=np.r_[0.0, np.ones(count)], constraints=(springs,), drag=drag)


def test_free_fall_is_exact_whatever_the_substep() -> None:
    start, velocity = np.array([[1.0, 2.0, 3.0]]), np.array([[0.5, 4.0, -1.0]])
    system = System(positions=start, velocities=velocity, inverse_masses=np.ones(1))
    for substeps in (1, 7, 100):
        solver = Solver(system, substep=2 / substeps)
        solver.advance(substeps)
        expected = start + 2 * velocity + 0.5 * 4 * np.array([0, -STANDARD_GRAVITY, 0])
        np.testing.assert_allclose(solver.positions, expected, atol=1e-12)
        assert solver.time == pytest.approx(2)


def test_drag_slows_at_its_rate() -> None:
    system = System(
        positions=np.zeros((1, 3)), velocities=[[3.0, 0, 0]], inverse_masses=np.ones(1), gravity=0.0, drag=0.7
    )
    solver = Solver(system, substep=0.01)
    solver.advance(200)
    assert solver.velocities[0, 0] == pytest.approx(3 * math.exp(-0.7 * 2), rel=1e-12)


def test_a_hanging_mass_stretches_a_spring_by_force_times_compliance() -> None:
    compliance = 2e-3
    solver = Solver(hung(1, compliance=compliance, drag=20.0), substep=1e-3)
    solver.advance(3000)
    assert -solver.positions[1, 1] - 1 == pytest.approx(STANDARD_GRAVITY * compliance, rel=1e-9)
    # Eq. 5: the multiplier over the squared substep is the force in the spring, pulling.
    assert solver.multipliers[0][0, 0] / solver.substep**2 == pytest.approx(-STANDARD_GRAVITY, rel=1e-9)
    assert measure_residuals(solver)[0] < 1e-12
    assert measure_stretch(solver)[0] == pytest.approx(STANDARD_GRAVITY * compliance, rel=1e-9)


@pytest.mark.parametrize("amplitude", [0.02, 1.0, 2.5])
def test_a_pendulum_has_its_period(amplitude: float) -> None:
    length = 0.8
    bob = length * np.array([math.sin(amplitude), -math.cos(amplitude), 0])
    rod = DistanceConstraints(particles=np.array([[0, 1]]), lengths=np.array([length]))
    system = System(positions=[np.zeros(3), bob], inverse_masses=np.array([0.0, 1.0]), constraints=(rod,))
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
    # The way back up and down is shorter by what the solver has lost of the swing, which matters for wide ones.
    assert 2 * (crossings[1] - crossings[0]) == pytest.approx(period, rel=3e-3 if amplitude < 2 else 2e-2)


def test_a_small_swing_has_the_period_of_the_textbook() -> None:
    assert 4 * math.sqrt(0.8 / 9.80665) * ellipk(math.sin(0.01) ** 2) == pytest.approx(
        2 * math.pi * math.sqrt(0.8 / 9.80665), rel=1e-4
    )


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_linear_momentum_is_kept_to_rounding_by_every_constraint(seed: int) -> None:
    random = np.random.default_rng(seed)
    cube = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = lattice_tetrahedra(2)
    system = System(
        positions=cube + 0.1 * random.normal(size=cube.shape),
        velocities=random.normal(size=cube.shape),
        inverse_masses=random.uniform(0.5, 2, size=len(cube)),
        constraints=(
            DistanceConstraints.from_positions(cube, [[0, 26], [3, 9], [14, 2]], compliance=1e-3, damping=1e-2),
            ChainConstraints.from_positions(cube, np.arange(27).reshape(9, 3), compliance=1e-3),
            VolumeConstraints.from_positions(cube, cells, compliance=1e-3),
            NeoHookeanConstraints.from_positions(cube, cells, young=100.0, poisson=0.3),
        ),
        gravity=0.0,
    )
    solver = Solver(system, substep=0.005, iterations=2)
    before, _ = measure_momenta(solver)
    solver.advance(50)
    after, _ = measure_momenta(solver)
    np.testing.assert_allclose(after, before, atol=1e-10)


def test_angular_momentum_is_kept_the_better_the_shorter_the_substep() -> None:
    random = np.random.default_rng(8)
    positions = random.normal(size=(6, 3))
    pairs = [[i, j] for i in range(6) for j in range(i)]
    system = System(
        positions=positions,
        velocities=np.cross([0.3, 1.0, -0.5], positions),
        inverse_masses=random.uniform(0.5, 2, size=6),
        constraints=(DistanceConstraints.from_positions(positions, pairs, compliance=1e-3),),
        gravity=0.0,
    )
    lost = []
    for substeps in (200, 400, 800):
        solver = Solver(system, substep=1 / substeps, iterations=20)
        _, before = measure_momenta(solver)
        solver.advance(substeps)
        _, after = measure_momenta(solver)
        lost.append(np.linalg.norm(after - before) / np.linalg.norm(before))
    assert lost[0] < 0.02
    assert lost[1] == pytest.approx(lost[0] / 2, rel=0.2)
    assert lost[2] == pytest.approx(lost[1] / 2, rel=0.2)


COUNT = 5
COMPLIANCE = 4e-4


@pytest.mark.parametrize(("substep", "iterations"), [(4e-3, 50), (2e-3, 20), (2e-3, 80), (5e-4, 5), (5e-4, 20)])
def test_stiffness_under_xpbd_depends_on_neither_step_nor_iterations(substep: float, iterations: int) -> None:
    solver = Solver(hung(COUNT, compliance=COMPLIANCE, drag=8.0), substep=substep, iterations=iterations)
    solver.advance(round(4 / substep))
    stretch = -solver.positions[-1, 1] - COUNT
    expected = COMPLIANCE * STANDARD_GRAVITY * COUNT * (COUNT + 1) / 2
    assert stretch == pytest.approx(expected, rel=1e-3)


def test_stiffness_under_pbd_depends_on_both() -> None:
    def stretch(substep: float, iterations: int) -> float:
        system = hung(COUNT, compliance=COMPLIANCE, stiffness=0.05, drag=8.0)
        solver = Solver(system, substep=substep, iterations=iterations, method="pbd")
        solver.advance(round(4 / substep))
        return float(-solver.positions[-1, 1] - COUNT)

    base = stretch(2e-3, 20)
    # A quarter of the step is sixteen times as stiff, four times the iterations about four times.
    assert stretch(5e-4, 20) < base / 10
    assert stretch(2e-3, 80) < base / 3
    assert base > 5e-4


def test_rayleigh_damping_decays_at_half_the_damping_time_times_the_squared_frequency() -> None:
    compliance, damping = 1e-2, 0.01
    square = 1 / compliance
    system = System(
        positions=[[0.0, 0, 0], [1.2, 0, 0]],
        inverse_masses=np.array([0.0, 1.0]),
        constraints=(
            DistanceConstraints(
                particles=np.array([[0, 1]]), lengths=np.ones(1), compliance=compliance, damping=damping
            ),
        ),
        gravity=0.0,
    )
    solver = Solver(system, substep=1e-5)
    solver.advance(round(1.0 / solver.substep))
    rate = 0.5 * damping * square
    swing = math.sqrt(square - rate**2)
    expected = 0.2 * math.exp(-rate) * (math.cos(swing) + rate / swing * math.sin(swing))
    assert solver.positions[1, 0] - 1 == pytest.approx(expected, abs=2e-4)
    assert abs(expected) > 0.05


@pytest.mark.parametrize("damping", [0.0, 0.005])
@pytest.mark.parametrize("drag", [0.0, 0.5])
def test_energy_never_rises_and_damping_takes_more_of_it(drag: float, damping: float) -> None:
    def energies(drag: float, damping: float) -> np.ndarray:
        system = System(
            positions=[[0.0, 0, 0], [1.3, 0, 0]],
            velocities=[[0.0, 0, 0], [-0.5, 0, 0]],
            inverse_masses=np.array([0.0, 2.0]),
            constraints=(
                DistanceConstraints(particles=np.array([[0, 1]]), lengths=np.ones(1), compliance=5e-3, damping=damping),
            ),
            gravity=0.0,
            drag=drag,
        )
        solver = Solver(system, substep=1e-3)
        totals = []
        for _ in range(1000):
            totals.append(measure_energies(solver).total)
            solver.advance()
        return np.array(totals)

    totals = energies(drag, damping)
    assert (np.diff(totals) <= 1e-12).all()
    assert totals[-1] < 0.7 * totals[0]
    if drag or damping:
        assert totals[-1] < 0.9 * energies(0.0, 0.0)[-1]


def test_volume_constraints_bring_a_squeezed_body_back_to_its_volume() -> None:
    cube = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = lattice_tetrahedra(2)
    system = System(
        positions=cube * np.array([1.0, 0.6, 1.0]),
        inverse_masses=np.ones(27),
        constraints=(VolumeConstraints.from_positions(cube, cells),),
        gravity=0.0,
    )
    solver = Solver(system, substep=0.01, iterations=200)
    solver.advance()
    assert tetrahedron_volumes(solver.positions, cells).sum() == pytest.approx(8, rel=1e-6)
    assert measure_residuals(solver)[0] < 1e-4


def test_a_hanging_neo_hookean_bar_stretches_by_its_youngs_modulus() -> None:
    # A bar of length L under its own weight grows by rho g L^2 / (2 E).
    cells, young, density = 3, 1e6, 1000.0
    cube = np.stack(np.meshgrid(*[np.arange(cells + 1.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cube *= np.array([0.1, 0.3, 0.1]) / cells
    tetrahedra = lattice_tetrahedra(cells)
    masses = np.bincount(
        tetrahedra.ravel(), np.repeat(density * tetrahedron_volumes(cube, tetrahedra) / 4, 4), len(cube)
    )
    inverse_masses = 1 / masses
    inverse_masses[cube[:, 1] > 0.299] = 0
    system = System(
        positions=cube,
        inverse_masses=inverse_masses,
        # No sideways contraction, which the clamp would hinder.
        constraints=(NeoHookeanConstraints.from_positions(cube, tetrahedra, young=young, poisson=0.0),),
        drag=20.0,
    )
    solver = Solver(system, substep=5e-4, iterations=5)
    solver.advance(2000)
    fallen = -solver.positions[cube[:, 1] == 0, 1].mean()
    assert fallen == pytest.approx(density * STANDARD_GRAVITY * 0.3**2 / (2 * young), rel=0.02)


@pytest.mark.parametrize("young", [1e2, 1e5, 1e9])
@pytest.mark.parametrize("substep", [1e-3, 4e-2])
def test_a_neo_hookean_body_at_rest_stays_at_rest_however_stiff(young: float, substep: float) -> None:
    cube = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    solid = NeoHookeanConstraints.from_positions(cube, lattice_tetrahedra(2), young=young, poisson=0.4)
    system = System(positions=cube, inverse_masses=np.ones(27), constraints=(solid,), gravity=0.0)
    solver = Solver(system, substep=substep)
    solver.advance(500)
    np.testing.assert_allclose(solver.positions, cube, atol=1e-9)


@pytest.mark.parametrize("young", [1e3, 1e6, 1e9])
def test_a_neo_hookean_body_that_is_thrown_comes_to_rest_in_its_shape_however_stiff(young: float) -> None:
    cube = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    cells = lattice_tetrahedra(2)
    solid = NeoHookeanConstraints.from_positions(cube, cells, young=young, poisson=0.4)
    system = System(
        positions=cube,
        velocities=2 * np.random.default_rng(10).normal(size=cube.shape),
        inverse_masses=np.ones(27),
        constraints=(solid,),
        colliders=(Ground(height=-0.5, friction=0.5),),
        drag=1.0,
    )
    solver = Solver(system, substep=5e-3, iterations=2)
    solver.advance(2000)
    lengths = np.linalg.norm(solver.positions[26] - solver.positions[0])
    assert lengths == pytest.approx(2 * math.sqrt(3), rel=0.2 if young < 1e4 else 0.01)
    assert tetrahedron_volumes(solver.positions, cells).min() > 0.1


def test_an_attachment_gives_way_by_force_times_compliance_and_follows_its_target() -> None:
    def path(time: float) -> np.ndarray:
        return np.array([[2.0 * min(time, 1.0), 0.0, 0.0]])

    hold = AttachmentConstraints(particles=np.array([[0]]), path=path, compliance=1e-3)
    system = System(positions=np.zeros((1, 3)), inverse_masses=np.ones(1), constraints=(hold,), drag=20.0)
    solver = Solver(system, substep=1e-3)
    solver.advance(3000)
    np.testing.assert_allclose(solver.positions[0], [2.0, -STANDARD_GRAVITY * 1e-3, 0], atol=1e-9)


def test_pins_carry_particles_along_their_path() -> None:
    def path(time: float) -> np.ndarray:
        return np.array([[math.sin(time), 0.0, 0.0]])

    system = System(
        positions=np.zeros((2, 3)),
        inverse_masses=np.array([0.0, 0.0]),
        pins=(Pins(particles=np.array([1], np.int32), path=path),),
    )
    solver = Solver(system, substep=0.01)
    solver.advance(50)
    np.testing.assert_array_equal(solver.positions, [[0, 0, 0], [math.sin(0.5), 0, 0]])
    assert solver.velocities[1, 0] == pytest.approx(math.cos(0.495), rel=1e-4)


def test_nothing_ends_a_substep_inside_the_ground_or_the_sphere() -> None:
    random = np.random.default_rng(9)
    positions = random.uniform(-1, 1, size=(300, 3)) + np.array([0, 3.0, 0])
    ball = Sphere(center=(0.0, 1.0, 0.0), radius=0.6, friction=0.3, thickness=0.05)
    links = np.stack([np.arange(299), np.arange(1, 300)], axis=1)
    system = System(
        positions=positions,
        velocities=random.normal(size=positions.shape),
        inverse_masses=np.ones(300),
        constraints=(DistanceConstraints.from_positions(positions, links, compliance=1e-2),),
        colliders=(ball, Ground(height=-0.5, friction=0.3, thickness=0.02)),
    )
    solver = Solver(system, substep=5e-3)
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
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    pairs = [[i, j] for i in range(4) for j in range(i)]
    system = System(
        positions=corners,
        velocities=np.tile([speed, 0.0, 0.0], (4, 1)),
        inverse_masses=np.ones(4),
        constraints=(DistanceConstraints.from_positions(corners, pairs),),
        colliders=(Ground(friction=friction),),
    )
    solver = Solver(system, substep=1e-3)
    solver.advance(1000)
    way = solver.positions - corners
    np.testing.assert_allclose(way[:, 0], speed**2 / (2 * friction * STANDARD_GRAVITY), rtol=5e-3)
    np.testing.assert_allclose(way[:, 1:], 0, atol=1e-9)
    stopped = solver.positions.copy()
    solver.advance(200)
    np.testing.assert_allclose(solver.positions, stopped, atol=1e-12)


def test_a_falling_plate_reaches_its_terminal_speed() -> None:
    corners = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 1], [0, 0, 1]])
    triangles = np.array([[0, 1, 2], [0, 2, 3], [0, 1, 3], [1, 2, 3]])  # both ways, so that corners share alike
    air = Wind(triangles=triangles, velocity=np.zeros(3), drag=1.0)
    pairs = [[i, j] for i in range(4) for j in range(i)]
    system = System(
        positions=corners,
        inverse_masses=np.full(4, 10.0),
        constraints=(DistanceConstraints.from_positions(corners, pairs),),
        winds=(air,),
    )
    solver = Solver(system, substep=2e-3)
    solver.advance(2000)
    expected = math.sqrt(0.4 * STANDARD_GRAVITY / (0.5 * AIR_DENSITY * 2.0))
    np.testing.assert_allclose(solver.velocities[:, 1], -expected, rtol=1e-3)


def test_the_same_system_gives_the_same_bits() -> None:
    system = hung(20, compliance=1e-4)
    runs = []
    for _ in range(2):
        solver = Solver(system, substep=1e-3, iterations=3)
        solver.advance(100)
        runs.append(solver.positions.tobytes())
    assert runs[0] == runs[1]
    np.testing.assert_array_equal(system.positions[:, 1], -np.arange(21))


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"substep": 0.0}, "substep must be a positive"),
        ({"substep": math.nan}, "substep must be a positive"),
        ({"iterations": 0}, "iterations must be 1 to"),
        ({"iterations": 10**9}, "iterations must be 1 to"),
        ({"method": "euler"}, "method must be 'xpbd' or 'pbd'"),
    ],
)
def test_a_solver_that_cannot_run_is_refused(change: dict, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        Solver(hung(1, compliance=0.0), **{"substep": 0.01, **change})


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"positions": np.zeros((2, 2))}, "positions must have shape"),
        ({"positions": np.full((2, 3), np.nan)}, "positions must be finite"),
        ({"inverse_masses": np.array([1.0, -1.0])}, "inverse mass 1 is negative"),
        ({"inverse_masses": np.ones(3)}, "inverse_masses must have shape"),
        ({"velocities": np.zeros((1, 3))}, "velocities must have shape"),
        ({"drag": -1.0}, "drag must be"),
        ({"gravity": math.inf}, "gravity must be"),
        (
            {"constraints": (DistanceConstraints(particles=np.array([[0, 2]]), lengths=np.ones(1)),)},
            "outside 0 to 1",
        ),
        (
            {"pins": (Pins(particles=np.array([0], np.int32), path=lambda time: np.zeros((1, 3))),)},
            "pinned particle has mass",
        ),
    ],
)
def test_a_system_that_cannot_be_is_refused(change: dict, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        System(**{"positions": np.zeros((2, 3)), "inverse_masses": np.ones(2), **change})


@pytest.mark.parametrize(
    ("make_wrong", "message"),
    [
        (lambda: Ground(friction=-1.0), "friction must be"),
        (lambda: Ground(thickness=math.nan), "thickness must be"),
        (lambda: Sphere(center=(0.0, 0.0, 0.0), radius=0.0), "radius must be more than 0"),
    ],
)
def test_a_collider_that_cannot_be_is_refused(make_wrong, message: str) -> None:
    with pytest.raises(SettingsError, match=message):
        make_wrong()
