"""Every constraint type: its gradient against differences, its compiled sweep against the equations in plain numpy."""

from __future__ import annotations

import math

import numpy as np
import pytest

from pdecodec.errors import SettingsError
from pdecodec.xpbd.attachment import AttachmentConstraints
from pdecodec.xpbd.bending import IsometricBendingConstraints
from pdecodec.xpbd.chain import ChainConstraints
from pdecodec.xpbd.constraints import Constraints, Method
from pdecodec.xpbd.distance import DistanceConstraints
from pdecodec.xpbd.meshing import bending_stencils, grid_quads, lattice_tetrahedra, triangulate
from pdecodec.xpbd.neo_hookean import NeoHookeanConstraints
from pdecodec.xpbd.reference import solve_reference
from pdecodec.xpbd.volume import VolumeConstraints
from pdecodec.xpbd.wind import AIR_DENSITY, Wind

TYPES = ["distance", "chain", "bending", "volume", "neo-hookean", "stiff neo-hookean", "attachment"]


def make(kind: str, *, damping: float = 0.0, stiffness: float = 0.3) -> tuple[Constraints, np.ndarray]:
    """A small batch and its rest positions."""
    x, y = np.meshgrid(np.arange(4.0), np.arange(3.0))
    sheet = np.stack([x.ravel(), y.ravel() + 0.1 * x.ravel(), np.zeros(12)], axis=1)
    cube = np.stack(np.meshgrid(*[np.arange(3.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    common = {"damping": damping, "stiffness": stiffness}
    match kind:
        case "distance":
            pairs = [[0, 1], [1, 2], [2, 3], [4, 9], [0, 5], [1, 0]]
            return DistanceConstraints.from_positions(sheet, pairs, compliance=0.02, **common), sheet
        case "chain":
            chains = [[0, 1, 2, 3, 7], [8, 4, 5, 6, 10]]
            return ChainConstraints.from_positions(sheet, chains, compliance=0.02, **common), sheet
        case "bending":
            stencils = bending_stencils(triangulate(grid_quads(4, 3)))
            return IsometricBendingConstraints.from_positions(sheet, stencils, rigidity=30.0, **common), sheet
        case "volume":
            cells = lattice_tetrahedra(2)
            return VolumeConstraints.from_positions(cube, cells, compliance=0.02, **common), cube
        case "neo-hookean" | "stiff neo-hookean":
            cells = lattice_tetrahedra(2)
            young = 50.0 if kind == "neo-hookean" else 1e5
            return NeoHookeanConstraints.from_positions(cube, cells, young=young, poisson=0.3, **common), cube
        case _:
            particles = np.array([[1], [5], [8]], np.int32)

            def path(time: float) -> np.ndarray:
                return sheet[[1, 5, 8]] + time * np.array([0.1, 0.2, 0.3])

            return AttachmentConstraints(particles=particles, path=path, compliance=0.02, **common), sheet


@pytest.mark.parametrize("method", ["xpbd", "pbd"])
@pytest.mark.parametrize("kind", TYPES)
def test_gradient_is_the_derivative_of_the_constraint(kind: str, method: Method) -> None:
    batch, rest = make(kind)
    positions = rest + 0.1 * np.random.default_rng(1).normal(size=rest.shape)
    step = 1e-6
    for index in range(batch.count):
        _, gradient = batch.evaluate(index, positions, time=0.5, method=method)
        for corner, particle in enumerate(batch.particles[index]):
            for axis in range(3):
                ends = []
                for sign in (1, -1):
                    moved = positions.copy()
                    moved[particle, axis] += sign * step
                    ends.append(batch.evaluate(index, moved, time=0.5, method=method)[0])
                difference = (ends[0] - ends[1]) / (2 * step)
                np.testing.assert_allclose(gradient[:, corner, axis], difference, atol=2e-8)


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
    for solve in (batch.solve, lambda *state, **step: solve_reference(batch, *state, **step)):
        positions = previous + 0.05 * np.random.default_rng(3).normal(size=rest.shape)
        multipliers = batch.new_multipliers()
        for _ in range(3):
            solve(positions, previous, inverse_masses, multipliers, time=0.5, substep=0.05, method=method)
        results.append((positions, multipliers))
    np.testing.assert_allclose(results[0][0], results[1][0], rtol=0, atol=1e-12)
    if method == "xpbd":
        np.testing.assert_allclose(results[0][1], results[1][1], rtol=1e-9, atol=1e-12)
    assert np.abs(results[0][0] - previous).max() > 0.01


@pytest.mark.parametrize("kind", TYPES)
def test_values_of_a_batch_are_those_of_its_constraints(kind: str) -> None:
    batch, rest = make(kind)
    positions = rest + 0.1 * np.random.default_rng(4).normal(size=rest.shape)
    each = [batch.evaluate(index, positions, time=0.5)[0] for index in range(batch.count)]
    np.testing.assert_allclose(batch.values(positions, time=0.5), each, atol=1e-13)


@pytest.mark.parametrize("kind", TYPES)
def test_energy_is_half_the_squared_constraint_over_the_compliance(kind: str) -> None:
    batch, rest = make(kind)
    positions = rest + 0.1 * np.random.default_rng(5).normal(size=rest.shape)
    values, compliances = batch.values(positions, time=0.5), batch.compliances
    offset = 0.0
    if "neo-hookean" in kind:
        offset = 0.5 * (batch.values(rest, time=0.5) ** 2 / compliances).sum()
    expected = 0.5 * (values**2 / compliances).sum() - offset
    assert batch.energy(positions, time=0.5) == pytest.approx(expected, rel=1e-10)


@pytest.mark.parametrize("kind", ["distance", "chain", "bending", "volume", "neo-hookean"])
def test_a_rigid_motion_stores_no_energy(kind: str) -> None:
    batch, rest = make(kind)
    angle = 0.7
    turn = np.array([[math.cos(angle), -math.sin(angle), 0], [math.sin(angle), math.cos(angle), 0], [0, 0, 1.0]])
    tilt = np.array([[1.0, 0, 0], [0, math.cos(1.1), -math.sin(1.1)], [0, math.sin(1.1), math.cos(1.1)]])
    moved = rest @ (turn @ tilt).T + np.array([3.0, -2.0, 1.0])
    assert abs(batch.energy(moved, time=0.0)) < 1e-10
    assert batch.energy(rest * 1.1 + 0.2 * np.sin(rest[:, [1, 2, 0]]), time=0.0) > 1e-4


def test_a_sweep_leaves_held_and_coinciding_particles_alone() -> None:
    positions = np.array([[0.0, 0, 0], [2, 0, 0], [5, 5, 5], [5, 5, 5]])
    start = positions.copy()
    batch = DistanceConstraints(particles=np.array([[0, 1], [2, 3]]), lengths=np.ones(2))
    chains = ChainConstraints(particles=np.array([[0, 1], [2, 3]]), lengths=np.ones((2, 1)))
    for item in (batch, chains):
        item.solve(
            positions, start, np.array([0.0, 0, 1, 1]), item.new_multipliers(), time=0.1, substep=0.1, method="xpbd"
        )
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
        batch.solve(positions, stretched, inverse_masses, batch.new_multipliers(), time=0.1, substep=0.1, method="xpbd")
        left_over.append(abs(positions[-1, 0] - rest[-1, 0]))
    assert left_over[0] < 1e-10
    assert left_over[1] > 1.0


def test_a_straight_rigid_chain_held_at_both_ends_is_left_in_peace() -> None:
    rest = np.stack([np.arange(5.0), np.zeros(5), np.zeros(5)], axis=1)
    chain = ChainConstraints.from_positions(rest, [[0, 1, 2, 3, 4]])
    positions = rest.copy()
    positions[2, 0] += 0.1
    weights = np.array([0.0, 1, 1, 1, 0])
    chain.solve(positions, rest, weights, chain.new_multipliers(), time=0.1, substep=0.1, method="xpbd")
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
    along, beside = cosine * flat[:, 0] + sine * flat[:, 1], cosine * flat[:, 1] - sine * flat[:, 0]
    bent = np.stack([radius * np.sin(along / radius), beside, radius * (1 - np.cos(along / radius))], axis=1)
    expected = 0.5 * rigidity / radius**2 * math.sqrt(0.75)
    # Edges of the border bend nothing; their share of the area falls with the resolution.
    assert batch.energy(bent, time=0.0) == pytest.approx(expected, rel=1.2 / resolution)
    assert batch.energy(flat, time=0.0) < 1e-20


def test_neo_hookean_energy_is_that_of_youngs_modulus_at_small_strain() -> None:
    cube = np.stack(np.meshgrid(*[np.linspace(0, 1, 3)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    young, poisson, strain = 3e4, 0.35, 1e-4
    batch = NeoHookeanConstraints.from_positions(cube, lattice_tetrahedra(2), young=young, poisson=poisson)
    pulled = cube * (1 + strain * np.array([1, -poisson, -poisson]))
    assert batch.energy(pulled, time=0.0) == pytest.approx(0.5 * young * strain**2, rel=1e-3)
    sheared = cube + strain * cube[:, [1]] * np.array([1.0, 0, 0])
    shear = young / (2 * (1 + poisson))
    assert batch.energy(sheared, time=0.0) == pytest.approx(0.5 * shear * strain**2, rel=1e-3)


def test_wind_on_a_plate_presses_with_the_dynamic_pressure() -> None:
    plate = np.array([[0.0, 0, 0], [0, 2, 0], [0, 2, 3], [0, 0, 3]])
    triangles = np.array([[0, 1, 2], [0, 2, 3]])
    wind = Wind(triangles=triangles, velocity=np.array([5.0, 0, 0]), drag=1.1)
    still = np.zeros_like(plate)
    total = wind.forces(plate, still, time=0.0).sum(axis=0)
    np.testing.assert_allclose(total, [0.5 * AIR_DENSITY * 1.1 * 6.0 * 25, 0, 0], atol=1e-12)
    np.testing.assert_array_equal(wind.forces(plate, still + wind.velocity, time=0.0), 0)
    edge_on = Wind(triangles=triangles, velocity=np.array([0.0, 5, 0]))
    np.testing.assert_array_equal(edge_on.forces(plate, still, time=0.0), 0)


def test_compiled_wind_equals_the_plain_form() -> None:
    random = np.random.default_rng(6)
    positions, velocities = random.normal(size=(2, 30, 3))
    triangles = random.permuted(np.tile(np.arange(30), (40, 1)), axis=1)[:, :3]
    triangles[7] = triangles[7, 0]  # no area
    wind = Wind(triangles=triangles, velocity=np.array([3.0, 1.0, -2.0]), gusts=0.4)
    expected = wind.forces_reference(positions, velocities, time=1.3)
    np.testing.assert_allclose(wind.forces(positions, velocities, time=1.3), expected, atol=1e-12)
    assert np.abs(expected).max() > 0.1


def test_gusts_travel_with_the_wind() -> None:
    wind = Wind(triangles=np.zeros((0, 3)), velocity=np.array([4.0, 0, 3.0]), gusts=0.5)
    here = np.array([[0.3, 0.2, 0.1]])
    later = wind.air_velocity(here + 0.7 * wind.velocity, time=0.9 + 0.7)
    np.testing.assert_allclose(later, wind.air_velocity(here, time=0.9), atol=1e-12)
    assert np.abs(later - wind.velocity).max() > 0.1


PAIR = np.array([[0, 1]])


@pytest.mark.parametrize(
    ("make_wrong", "message"),
    [
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(1), compliance=-1), "compliance must be 0 or"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(1), compliance=math.nan), "compliance must be"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(1), damping=0.1), "cannot be damped"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(1), damping=-0.1), "damping must be"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(1), stiffness=1.5), "between 0 and 1"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.ones(2)), "lengths must have shape"),
        (lambda: DistanceConstraints(particles=PAIR, lengths=np.array([math.inf])), "finite"),
        (lambda: DistanceConstraints(particles=np.array([[0, 1, 2]]), lengths=np.ones(1)), "must have shape"),
        (lambda: DistanceConstraints(particles=np.array([0, 1]), lengths=np.ones(2)), "must have shape"),
        (lambda: ChainConstraints(particles=np.array([[0]]), lengths=np.ones((1, 0))), "2 points or more"),
        (lambda: ChainConstraints(particles=np.array([[0, 1, 0]]), lengths=np.ones((1, 2))), "particle twice"),
        (lambda: AttachmentConstraints(particles=PAIR, path=lambda time: np.zeros((1, 3))), "holds one particle"),
        (lambda: IsometricBendingConstraints.from_positions(np.eye(4, 3), [[0, 1, 2, 3]], rigidity=0.0), "more than 0"),
        (
            lambda: IsometricBendingConstraints.from_positions(np.zeros((4, 3)), [[0, 1, 2, 3]], rigidity=1),
            "no|without",
        ),
        (
            lambda: NeoHookeanConstraints.from_positions(np.eye(4, 3), [[0, 1, 2, 3]], young=0, poisson=0.3),
            "Young's modulus",
        ),
        (
            lambda: NeoHookeanConstraints.from_positions(np.eye(4, 3), [[0, 1, 2, 3]], young=1, poisson=0.5),
            "Poisson's ratio",
        ),
        (
            lambda: NeoHookeanConstraints.from_positions(np.eye(4, 3), [[0, 1, 2, 3]], young=1, poisson=0.3),
            "no positive volume",
        ),
        (lambda: Wind(triangles=np.zeros((0, 3)), velocity=np.zeros(3), drag=-1), "drag must be"),
    ],
)
def test_a_material_that_cannot_be_is_refused_in_one_line(make_wrong, message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        make_wrong()
    assert "\n" not in str(caught.value)
