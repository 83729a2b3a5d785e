"""Finding functions of time of a motion: the fewest that represent it, or none if it needs too many."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from pdecodec.formats.gltf.functions import FIRST_SKETCH_RANK, PROBING_ROUNDS, Samples, find_functions
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array

BOUND = 1e-5


def motion_of_functions(count: int, samples: int = 300, vertices: int = 100) -> Float64Array:
    """Return positions (samples, vertices, 3): constant ones plus this many cosines of time times shapes."""
    rng = np.random.default_rng(5)
    cosines = np.cos(np.outer(np.linspace(0, np.pi, samples), np.arange(1, count + 1)))
    return rng.normal(size=(vertices, 3)) + np.tensordot(cosines, rng.normal(size=(count, vertices, 3)), 1)


@pytest.mark.parametrize(
    ("count", "samples"),
    [
        (1, 300),
        (FIRST_SKETCH_RANK - 1, 300),
        (2 * FIRST_SKETCH_RANK - 1, 300),
        (FIRST_SKETCH_RANK, 3 * FIRST_SKETCH_RANK),
    ],
)
def test_as_many_functions_are_found_as_a_motion_has(count: int, samples: int) -> None:
    points = motion_of_functions(count, samples)
    found = find_functions(Samples.of_frames(points), BOUND, most=400)
    assert found is not None
    functions, (rest, *shapes) = found
    assert functions.shape == (samples, count)
    assert functions.min() >= 0
    assert functions.max() <= 1
    assert np.abs(rest + np.tensordot(functions, np.array(shapes), 1) - points).max() <= BOUND


@pytest.mark.parametrize("count", [5, 40])
def test_a_motion_of_more_functions_than_allowed_has_none(count: int) -> None:
    assert find_functions(Samples.of_frames(motion_of_functions(count)), BOUND, most=count - 1) is None


@pytest.mark.parametrize("known", [0, 2])
def test_there_are_no_more_functions_than_samples(known: int) -> None:
    points = motion_of_functions(6, samples=5)
    given = np.cos(np.outer(np.arange(5), np.arange(1, 1 + known))) if known else None
    assert find_functions(Samples.of_frames(points), 1e-13, most=8, known=given) is None
    found = find_functions(Samples.of_frames(points), BOUND, most=8, known=given)
    assert found is not None
    assert found[0].shape == (5, 4)


def test_the_first_bound_that_the_allowed_functions_reach_is_used() -> None:
    points = motion_of_functions(3) + 0.01 * motion_of_functions(40)
    found = find_functions(Samples.of_frames(points), BOUND, 0.5, 5.0, most=8)
    assert found is not None
    functions, shapes = found
    errors = np.abs(shapes[0] + np.tensordot(functions, shapes[1:], 1) - points)
    assert BOUND < errors.max() <= 0.5


@pytest.mark.parametrize("movers", [1, 7])
def test_the_motion_of_a_few_among_many_vertices_is_found(movers: int) -> None:
    points = motion_of_functions(2, samples=50, vertices=20_000)
    alone = motion_of_functions(12, samples=50, vertices=movers)
    points[:, 777 : 777 + movers] = alone
    found = find_functions(Samples.of_frames(points), BOUND, most=48)
    assert found is not None
    functions, shapes = found
    assert functions.shape[1] <= 2 + min(3 * movers, 12)
    assert np.abs(shapes[0] + np.tensordot(functions, shapes[1:], 1) - points).max() <= BOUND


def test_a_motion_is_read_a_bounded_number_of_times() -> None:
    points, readings = motion_of_functions(5, samples=50, vertices=20_000), []
    samples = Samples.of_frames(points)

    def read() -> Iterator[tuple[Int64Array, Float32Array]]:
        readings.append(1)
        return samples.read()

    assert find_functions(Samples(samples.count, samples.columns, read), BOUND, most=48) is not None
    assert len(readings) <= 3 + 3 * PROBING_ROUNDS
