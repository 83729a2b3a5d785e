"""Every type of constraint: its gradient compared with differences, its compiled sweep with the equations in
plain numpy.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

import numpy as np
import pytest

from pdecodec.errors import SettingsError
from pdecodec.simulate.bending import IsometricBendingConstraints
from pdecodec.simulate.constraints import Constraints, Method, State
from pdecodec.simulate.distance import ChainConstraints, DistanceConstraints
from pdecodec.simulate.meshing import bending_stencils, grid_quads, lattice_tetrahedra, triangulate
from pdecodec.simulate.scenes import build
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.surroundings import AIR_DENSITY, Ground, Pins, Sphere, Wind
from pdecodec.simulate.system import System
from pdecodec.simulate.tetrahedra import NeoHookeanConstraints, VolumeConstraints
from tests.simulate.plain_constraints import evaluate, solve_plainly

ONCE = {"substep": 0.1, "method": "xpbd"}

COLUMN, ROW = np.tile(np.arange(4.0), 3), np.repeat(np.arange(3.0), 4)
SHEET = np.stack([COLUMN, ROW + 0.1 * COLUMN, np.zeros(12)], axis=1)
CUBE, CELLS = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3), lattice_tetrahedra(2)
PAIRS = [[0, 1], [1, 2], [2, 3], [4, 9], [0, 5], [1, 0]]
CHAINS = [[0, 1, 2, 3, 7], [8, 4, 5, 6, 10]]
STENCILS = bending_stencils(triangulate(grid_quads(4, 3)))

TYPES: dict[str, Callable[..., Constraints]] = {
    "distance": partial(DistanceConstraints.from_positions, SHEET, PAIRS, compliance=0.02),
    "chain": partial(ChainConstraints.from_positions, SHEET, CHAINS, compliance=0.02),
    "bending": partial(IsometricBendingConstraints.from_positions, SHEET, STENCILS, rigidity=30.0),
    "volume": partial(VolumeConstraints.from_positions, CUBE, CELLS, compliance=0.02),
    "neo-hookean": partial(NeoHookeanConstraints.from_positions, CUBE, CELLS, young=50.0, poisson=0.3),
    "stiff neo-hookean": partial(NeoHookeanConstraints.from_positions, CUBE, CELLS, young=1e5, poisson=0.3),
}


def make(kind: str, *, damping: float = 0.0) -> tuple[Constraints, np.ndarray]:
    """Return a small batch and its positions at rest."""
    rest = SHEET if kind in ("distance", "chain", "bending") else CUBE
    return TYPES[kind](damping=damping, stiffness=0.3), rest


@pytest.mark.parametrize("method", ["xpbd", "pbd"])
@pytest.mark.parametrize("kind", TYPES)
def test_gradient_is_the_derivative_of_the_constraint(kind: str, method: Method) -> None:
    batch, rest = make(kind)
    positions = rest + 0.1 * np.random.default_rng(1).normal(size=rest.shape)
    for index in range(batch.count):
        _, gradient = evaluate(batch, index, positions, method)
        for (corner, particle), axis in product(enumerate(batch.particles[index]), range(3)):
            step = np.zeros_like(positions)
            step[particle, axis] = 1e-6
            ahead, behind = (evaluate(batch, index, positions + s, method)[0] for s in (step, -step))
            np.testing.assert_allclose(gradient[:, corner, axis], (ahead - behind) / 2e-6, atol=2e-8)


@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("method", ["xpbd", "pbd"])
@pytest.mark.parametrize("kind", TYPES)
def test_compiled_sweeps_equal_the_plain_form(kind: str, method: Method, damping: float) -> None:
    batch, rest = make(kind, damping=damping)
    random = np.random.default_rng(2)
    previous = rest + 0.05 * random.normal(size=rest.shape)
    inverse_masses = random.uniform(0.5, 2, size=len(rest))
    inverse_masses[[0, 4]] = 0
    results = []
    for is_plain in (False, True):
        positions = previous + 0.05 * np.random.default_rng(3).normal(size=rest.shape)
        multipliers = batch.new_multipliers()
        for _ in range(3):
            state = State(positions, previous, inverse_masses)
            if is_plain:
                solve_plainly(batch, state, multipliers, 0.05, method)
            else:
                batch.solve(state, multipliers, substep=0.05, method=method)
        results.append((positions, multipliers))
    np.testing.assert_allclose(results[0][0], results[1][0], rtol=0, atol=1e-12)
    if method == "xpbd":
        np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-9, atol=1e-12)
    assert np.abs(results[0][0] - previous).max() > 0.01


@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("kind", ["distance", "chain", "bending"])
def test_constraints_that_are_taken_at_once_give_the_bits_of_one_after_another(kind: str, damping: float) -> None:
    random = np.random.default_rng(7)
    count, each = 60, {"distance": 2, "chain": 5, "bending": 4}[kind]
    rest = random.normal(size=(count, 3))
    # Some constraints share particles with the previous constraint, others with none of the recent ones.
    particles = np.stack([random.choice(20 if i % 3 else count, each, replace=False) for i in range(150)])
    make_batch = {
        "distance": partial(DistanceConstraints.from_positions, compliance=0.02),
        "chain": partial(ChainConstraints.from_positions, compliance=0.02),
        "bending": partial(IsometricBendingConstraints.from_positions, rigidity=30.0),
    }[kind]
    inverse_masses = random.uniform(0.5, 2, size=count)
    inverse_masses[::7] = 0
    start = rest + 0.01 * random.normal(size=rest.shape)
    found = []
    for divided in ([particles], particles[:, None]):
        positions = start.copy()
        batches = [make_batch(rest, part, damping=damping) for part in divided]
        multipliers = [batch.new_multipliers() for batch in batches]
        for _ in range(2):
            for batch, own in zip(batches, multipliers, strict=True):
                batch.solve(State(positions, rest, inverse_masses), own, **ONCE)
        found.append((positions, np.concatenate(multipliers)))
    np.testing.assert_array_equal(found[0][0], found[1][0])
    np.testing.assert_array_equal(found[0][1], found[1][1])
    assert np.abs(found[0][0] - start).max() > 1e-4


@pytest.mark.parametrize("kind", TYPES)
def test_values_are_those_of_each_constraint_and_energy_is_half_their_square_over_the_compliance(kind: str) -> None:
    batch, rest = make(kind)
    positions = rest + 0.1 * np.random.default_rng(4).normal(size=rest.shape)
    values = batch.values(positions)
    each = [evaluate(batch, index, positions)[0] for index in range(batch.count)]
    np.testing.assert_allclose(values, each, atol=1e-13)
    expected = 0.5 * (values**2 / batch.compliances).sum()
    if "neo-hookean" in kind:
        expected -= 0.5 * (batch.values(rest) ** 2 / batch.compliances).sum()
    assert batch.energy(positions) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("kind", ["distance", "chain", "bending", "volume", "neo-hookean"])
def test_a_rigid_motion_stores_no_energy(kind: str) -> None:
    batch, rest = make(kind)
    turn = np.linalg.qr(np.random.default_rng(5).normal(size=(3, 3)))[0]
    moved = rest @ (turn * np.linalg.det(turn)) + np.array([3.0, -2.0, 1.0])
    assert abs(batch.energy(moved)) < 1e-10
    assert batch.energy(rest * 1.1 + 0.2 * np.sin(rest[:, [1, 2, 0]])) > 1e-4


def test_a_sweep_leaves_held_and_coinciding_particles_alone() -> None:
    positions = np.array([[0.0, 0, 0], [2, 0, 0], [5, 5, 5], [5, 5, 5]])
    start = positions.copy()
    batch = DistanceConstraints(particles=np.array([[0, 1], [2, 3]]), lengths=np.ones(2))
    chains = ChainConstraints(particles=np.array([[0, 1], [2, 3]]), lengths=np.ones((2, 1)))
    for item in (batch, chains):
        item.solve(State(positions, start, np.array([0.0, 0, 1, 1])), item.new_multipliers(), **ONCE)
        np.testing.assert_array_equal(positions, start)


def test_a_rigid_chain_is_solved_at_once_where_single_links_need_many_sweeps() -> None:
    count = 200
    rest = np.stack([np.arange(count, dtype=float), np.zeros(count), np.zeros(count)], axis=1)
    stretched = rest * 1.01
    inverse_masses = np.r_[0.0, np.ones(count - 1)]
    links = np.stack([np.arange(count - 1), np.arange(1, count)], axis=1)
    left_over = []
    for batch in (
        ChainConstraints.from_positions(rest, np.arange(count)[None, :]),
        DistanceConstraints.from_positions(rest, links),
    ):
        positions = stretched.copy()
        batch.solve(State(positions, stretched, inverse_masses), batch.new_multipliers(), **ONCE)
        left_over.append(abs(positions[-1, 0] - rest[-1, 0]))
    assert left_over[0] < 1e-10
    assert left_over[1] > 1.0


def test_a_straight_rigid_chain_held_at_both_ends_is_left_in_peace() -> None:
    rest = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
    chain = ChainConstraints.from_positions(rest, [[0, 1, 2, 3, 4]])
    positions = rest.copy()
    positions[2, 0] += 0.1
    chain.solve(State(positions, rest, np.array([0.0, 1, 1, 1, 0])), chain.new_multipliers(), **ONCE)
    np.testing.assert_allclose(positions, rest, atol=1e-12)


@pytest.mark.parametrize("degrees", [0, 20, 45, 90])
@pytest.mark.parametrize("resolution", [20, 80])
def test_bending_energy_of_a_cylinder_is_half_rigidity_times_squared_curvature(resolution: int, degrees: int) -> None:
    radius, rigidity = 2.0, 0.7
    x, y = np.meshgrid(np.linspace(0, 1, resolution + 1), np.linspace(0, 1, resolution + 1))
    flat = np.stack([(x + y / 2).ravel(), math.sqrt(0.75) * y.ravel(), np.zeros(x.size)], axis=1)
    quads = grid_quads(resolution + 1, resolution + 1)
    stencils = bending_stencils(np.concatenate([quads[:, [0, 1, 3]], quads[:, [1, 2, 3]]]))
    batch = IsometricBendingConstraints.from_positions(flat, stencils, rigidity=rigidity)
    cosine, sine = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    along, across = cosine * flat[:, 0] + sine * flat[:, 1], cosine * flat[:, 1] - sine * flat[:, 0]
    bent = np.stack([radius * np.sin(along / radius), across, radius * (1 - np.cos(along / radius))], axis=1)
    expected = 0.5 * rigidity / radius**2 * math.sqrt(0.75)
    # Edges on the border have no bending energy; their share of the area falls with the resolution.
    assert batch.energy(bent) == pytest.approx(expected, rel=1.2 / resolution)
    assert batch.energy(flat) < 1e-20


def test_neo_hookean_energy_is_that_of_youngs_modulus_at_small_strain() -> None:
    cube = np.stack(np.meshgrid(*[np.linspace(0, 1, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    young, poisson, strain = 3e4, 0.35, 1e-4
    batch = NeoHookeanConstraints.from_positions(cube, lattice_tetrahedra(2), young=young, poisson=poisson)
    pulled = cube * (1 + strain * np.array([1, -poisson, -poisson]))
    assert batch.energy(pulled) == pytest.approx(0.5 * young * strain**2, rel=1e-3)
    sheared = cube + strain * cube[:, [1]] * np.array([1.0, 0, 0])
    shear = young / (2 * (1 + poisson))
    assert batch.energy(sheared) == pytest.approx(0.5 * shear * strain**2, rel=1e-3)


def test_wind_on_a_plate_presses_with_the_dynamic_pressure() -> None:
    plate = np.array([[0.0, 0, 0], [0, 2, 0], [0, 2, 3], [0, 0, 3]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    wind = Wind(triangles=triangles, velocity=np.array([5.0, 0, 0]), drag=1.1)
    still = np.zeros_like(plate)
    total = wind.forces(plate, still, time=0.0).sum(axis=0)
    np.testing.assert_allclose(total, [0.5 * AIR_DENSITY * 1.1 * 6.0 * 25, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(wind.forces(plate, still + wind.velocity, time=0.0), 0)
    edge_on = Wind(triangles=triangles, velocity=np.array([0.0, 5, 0])).forces(plate, still, time=0.0)
    np.testing.assert_array_equal(edge_on, 0)


def test_compiled_wind_equals_the_plain_form() -> None:
    random = np.random.default_rng(6)
    positions, velocities = random.normal(size=(2, 30, 3))
    triangles = random.permuted(np.tile(np.arange(30), (40, 1)), axis=1)[:, :3]
    triangles[7] = triangles[7, 0]  # a triangle without area
    wind = Wind(triangles=triangles, velocity=np.array([3.0, 1.0, -2.0]), gusts=0.4)
    corners = positions[triangles]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    double_area = np.linalg.norm(across, axis=1, keepdims=True)
    normal = np.divide(across, double_area, out=np.zeros_like(across), where=double_area > 0)
    past = (wind.air_velocity(positions, time=1.3) - velocities)[triangles].mean(axis=1)
    speed = (past * normal).sum(axis=1, keepdims=True)
    on_triangle = 0.5 * AIR_DENSITY * wind.drag * 0.5 * double_area * np.abs(speed) * speed * normal
    expected = np.zeros_like(positions)
    np.add.at(expected, triangles, on_triangle[:, None, :] / 3)
    np.testing.assert_allclose(wind.forces(positions, velocities, time=1.3), expected, atol=1e-12)
    assert np.abs(expected).max() > 0.1


def test_gusts_travel_with_the_wind() -> None:
    wind = Wind(triangles=np.zeros((0, 3)), velocity=np.array([4.0, 0, 3.0]), gusts=0.5)
    here = np.array([[0.3, 0.2, 0.1]])
    later = wind.air_velocity(here + 0.7 * wind.velocity, time=0.9 + 0.7)
    np.testing.assert_allclose(later, wind.air_velocity(here, time=0.9), atol=1e-12)
    assert np.abs(later - wind.velocity).max() > 0.1


def test_a_sweep_refuses_particles_that_are_not_there_and_arrays_that_it_cannot_change() -> None:
    positions, masses = np.zeros((3, 3)), np.ones(3)
    batch = DistanceConstraints(particles=PAIR, lengths=np.ones(1))
    for particles in ([[0, 3]], [[-1, 0]]):
        with pytest.raises(IndexError, match="a particle number is out of range"):
            DistanceConstraints(particles=np.array(particles), lengths=np.ones(1)).solve(
                State(positions, positions, masses), batch.new_multipliers(), **ONCE
            )
    for wrong in (State(positions, positions, masses[:2]), State(positions, positions[:2], masses)):
        with pytest.raises(ValueError, match="do not fit"):
            batch.solve(wrong, batch.new_multipliers(), **ONCE)
    with pytest.raises(ValueError, match="do not fit"):
        batch.solve(State(positions, positions, masses), np.zeros((2, 1)), **ONCE)
    for unchangeable in (positions.astype(np.float32), np.zeros((6, 3))[::2]):
        with pytest.raises(TypeError, match="incompatible"):
            batch.solve(State(unchangeable, positions, masses), batch.new_multipliers(), **ONCE)


PAIR = np.array([[0, 1]])
ONE = {"particles": PAIR, "lengths": np.ones(1)}
TETRAHEDRON = (np.eye(4, 3), [[0, 1, 2, 3]])


def system(**change: Any) -> System:
    return System(**{"positions": np.zeros((2, 3)), "inverse_masses": np.ones(2), **change})


def solver(**change: Any) -> Solver:
    return Solver(system(), **{"substep": 0.01, **change})


@pytest.mark.parametrize(
    ("make_wrong", "message"),
    [
        (lambda: solver(substep=0.0), "substep must be a positive"),
        (lambda: solver(substep=math.nan), "substep must be a positive"),
        (lambda: solver(iterations=0), "iterations must be 1 to"),
        (lambda: solver(iterations=10**9), "iterations must be 1 to"),
        (lambda: solver(method="euler"), "method must be 'xpbd' or 'pbd'"),
        (lambda: system(positions=np.zeros((2, 2))), "positions must have shape"),
        (lambda: system(positions=np.full((2, 3), np.nan)), "positions must be finite"),
        (lambda: system(inverse_masses=np.array([1.0, -1.0])), "inverse mass 1 is negative"),
        (lambda: system(inverse_masses=np.ones(3)), "inverse_masses must have shape"),
        (lambda: system(velocities=np.zeros((1, 3))), "velocities must have shape"),
        (lambda: system(drag=-1.0), "drag must be"),
        (lambda: system(gravity=math.inf), "gravity must be"),
        (lambda: system(constraints=(DistanceConstraints(particles=PAIR + 1, lengths=np.ones(1)),)), "outside 0 to 1"),
        (lambda: system(pins=(Pins(particles=PAIR[0], path=np.zeros),)), "pinned particle has mass"),
        (lambda: DistanceConstraints(**ONE, compliance=-1), "compliance must be 0 or"),
        (lambda: DistanceConstraints(**ONE, compliance=math.nan), "compliance must be"),
        (lambda: DistanceConstraints(**ONE, damping=0.1), "cannot be damped"),
        (lambda: DistanceConstraints(**ONE, damping=-0.1), "damping must be"),
        (lambda: DistanceConstraints(**ONE, stiffness=1.5), "between 0 and 1"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(2)), "lengths must have shape"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.array([math.inf])), "finite"),
        (lambda: DistanceConstraints(particles=np.array([[0, 1, 2]]), lengths=np.ones(1)), "must have shape"),
        (lambda: DistanceConstraints(particles=np.array([0, 1]), lengths=np.ones(2)), "must have shape"),
        (lambda: ChainConstraints(particles=np.array([[0]]), lengths=np.ones((1, 0))), "2 points or more"),
        (lambda: ChainConstraints(particles=np.array([[0, 1, 0]]), lengths=np.ones((1, 2))), "particle twice"),
        (lambda: IsometricBendingConstraints.from_positions(*TETRAHEDRON, rigidity=0.0), "more than 0"),
        (lambda: IsometricBendingConstraints.from_positions(np.zeros((4, 3)), [[0, 1, 2, 3]], rigidity=1), "without"),
        (lambda: NeoHookeanConstraints.from_positions(*TETRAHEDRON, young=0, poisson=0.3), "Young's modulus"),
        (lambda: NeoHookeanConstraints.from_positions(*TETRAHEDRON, young=1, poisson=0.5), "Poisson's ratio"),
        (lambda: NeoHookeanConstraints.from_positions(*TETRAHEDRON, young=1, poisson=0.3), "no positive volume"),
        (lambda: Wind(triangles=np.zeros((0, 3)), velocity=np.zeros(3), drag=-1), "drag must be"),
        (lambda: Ground(friction=-1.0), "friction must be"),
        (lambda: Ground(thickness=math.nan), "thickness must be"),
        (lambda: Sphere(center=(0.0, 0.0, 0.0), radius=0.0), "radius must be more than 0"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(make_wrong, message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        make_wrong()
    assert "\n" not in str(caught.value)


def in_halves(particles: np.ndarray, middle: int) -> list[int]:
    """Return the order of constraints in a system in halves: those within the halves, then those across, in
    rounds without shared particles.
    """
    second = particles >= middle
    order = [i for half in (0, 1) for i in range(len(particles)) if (second[i] == half).all()]
    left = [i for i in range(len(particles)) if i not in order]
    while left:
        moved: set[int] = set()
        now = [i for i in left if not moved & {*particles[i].tolist()} and not moved.update(particles[i].tolist())]
        order += now
        left = [i for i in left if i not in now]
    return order


@pytest.mark.parametrize("damping", [0.0, 0.02])
@pytest.mark.parametrize("kind", ["distance", "chain along", "chain across", "bending"])
def test_halves_are_taken_first_and_what_is_across_the_middle_after_them(kind: str, damping: float) -> None:
    columns, rows, middle = 7, 9, 28
    random = np.random.default_rng(11)
    grid = np.arange(columns * rows, dtype=np.int32).reshape(rows, columns)
    rest = np.stack([grid % columns, grid // columns, 0 * grid], axis=-1).reshape(-1, 3).astype(float)
    triangles = triangulate(grid_quads(columns, rows))
    make_batch, particles = {
        "distance": (
            partial(DistanceConstraints.from_positions, compliance=0.02),
            np.concatenate([triangles[:, :2], triangles[:, 1:]]),
        ),
        "chain along": (partial(ChainConstraints.from_positions, compliance=0.02), grid),
        "chain across": (partial(ChainConstraints.from_positions, compliance=0.02), grid.T),
        "bending": (
            partial(IsometricBendingConstraints.from_positions, rigidity=30.0),
            bending_stencils(triangles),
        ),
    }[kind]
    order = in_halves(particles, middle)
    inverse_masses = random.uniform(0.5, 2, size=len(rest))
    inverse_masses[::13] = 0
    start = rest + 0.05 * random.normal(size=rest.shape)
    batch, plain = make_batch(rest, particles, damping=damping), make_batch(rest, particles[order], damping=damping)
    scene = System(positions=start, inverse_masses=inverse_masses, constraints=(batch,), middle=middle, gravity=0.0)
    solver = Solver(scene, substep=0.05, iterations=3)
    solver.advance(1)
    expected, multipliers = start.copy(), plain.new_multipliers()
    for _ in range(3):
        solve_plainly(plain, State(expected, start, inverse_masses), multipliers, 0.05, "xpbd")
    np.testing.assert_allclose(solver.positions, expected, rtol=0, atol=1e-12)
    np.testing.assert_allclose(solver.multipliers[0][order], multipliers, rtol=1e-9, atol=1e-12)
    assert np.abs(expected - start).max() > 0.01


def test_a_middle_that_is_no_particle_or_that_chains_cross_twice_is_refused() -> None:
    with pytest.raises(SettingsError, match="the middle must be one of the 12 particles, not 13"):
        System(positions=SHEET, inverse_masses=np.ones(12), middle=13)
    for chains in ([[0, 6, 1]], [[6, 1]]):
        batch = ChainConstraints.from_positions(SHEET, chains)
        scene = System(positions=SHEET, inverse_masses=np.ones(12), constraints=(batch,), middle=6)
        with pytest.raises(ValueError, match="cross the middle of a sheet once, at the same link"):
            Solver(scene, substep=0.05).advance(1)


def test_two_threads_give_the_bits_of_one(monkeypatch: pytest.MonkeyPatch) -> None:
    scene = build("cloth", columns=64, rows=65)
    assert 0 < scene.system.middle < len(scene.system.positions)
    found = []
    for threads in ("1", "2"):
        monkeypatch.setenv("PDECODEC_THREADS", threads)
        solver = Solver(scene.system, substep=1e-3, iterations=2)
        solver.advance(45)
        found.append((solver.positions.copy(), solver.velocities.copy(), *solver.multipliers))
    for one, two in zip(*found, strict=True):
        np.testing.assert_array_equal(one, two)
    assert np.abs(found[0][0] - scene.system.positions).max() > 0.005
