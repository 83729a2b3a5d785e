"""A decoder with other arithmetic reads the same data, and decodes positions to within the margin that the
encoder leaves below the bound.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import (
    ArraySequence,
    Connectivity,
    MeshObject,
)
from pdecodec.codec.sections import space_basis as spacebasis
from pdecodec.codec.sections.groups import DOUBLE_MARGIN, SINGLE_MARGIN
from pdecodec.codec.sections.space_basis import SpaceBasis, build_space_basis, decode_space_basis
from pdecodec.mesh.metrics import frame_scale
from spec.accepted import Choices, encoded
from spec.decoder import space as plain
from tests.support.mesh_cases import grid
from tests.support.shaken_arithmetic import decoder, shaker, trace


def sheet(frames: int, rows: int, columns: int, *, tilt: float = 0.0) -> ArraySequence:
    """Return a waving square sheet; at rest it is flat and as wide as long, so its two principal axes are equal."""
    x, y = np.meshgrid(np.arange(rows) - rows / 2, np.arange(columns) - columns / 2, indexing="ij")
    t = np.arange(frames)[:, None, None]
    z = np.sin(0.9 * x + 0.4 * t) * np.cos(0.7 * y - 0.3 * t) * np.minimum(t, 3) / 3
    x, y = np.cos(tilt) * x - np.sin(tilt) * y, np.sin(tilt) * x + np.cos(tilt) * y
    points = np.stack(np.broadcast_arrays(x, y + tilt * z, z + tilt * y), axis=-1).reshape(frames, -1, 3)
    return ArraySequence(points.astype(np.float32), objects=[MeshObject("sheet", grid(rows, columns))])


def scattered(frames: int, points: int) -> ArraySequence:
    """Return points without faces, some of them coincident, that tremble while they drift."""
    random = np.random.default_rng(4)
    first = random.normal(size=(points, 3))
    first[: points // 4] = first[0]
    moved = first + np.arange(frames)[:, None, None] * 0.3 + 0.02 * random.normal(size=(frames, points, 3))
    return ArraySequence(moved.astype(np.float32), objects=[MeshObject("points", Connectivity(points))])


def held(tolerance: float = 3e-3, **choices: Any) -> Choices:
    return Choices(settings={"tolerance": tolerance}, **choices)


CASES: dict[str, tuple[Callable[[], ArraySequence], Choices]] = {
    "square": (lambda: sheet(7, 6, 6), held()),
    "square, tilted": (lambda: sheet(7, 7, 7, tilt=0.6), held(space=("patch", 16))),
    "shapes": (lambda: sheet(6, 4, 9), held(time="shapes")),
    "cosines in double": (lambda: sheet(5, 4, 5), held(1e-5, time="cosines")),
    "trajectories in double": (lambda: sheet(9, 4, 5), held(1e-5)),
    "pieces of curves": (lambda: sheet(6, 4, 11, tilt=0.3), held(space=("curve", 8))),
    "points": (lambda: scattered(6, 40), held(space=("patch", 16))),
    "bound below the spacing of float32": (lambda: scattered(4, 24), held(1e-8)),
    "three groups": (lambda: sheet(11, 3, 6), held(longest_group=4)),
}


@pytest.fixture(params=CASES)
def case(request: pytest.FixtureRequest) -> tuple[ArraySequence, Choices, bytes]:
    make, choices = CASES[request.param]
    sequence = make()
    return sequence, choices, encoded(sequence, choices)


def test_a_decoder_that_rounds_otherwise_reads_the_same_bits(case: tuple[ArraySequence, Choices, bytes]) -> None:
    _, _, data = case
    read = []
    for seed in range(3):
        with decoder(shaker(seed) if seed else None, exempt=set()) as modules:
            read.append(trace(modules))
            animation = modules["animation"].decode(data)
            for group in range(len(animation.motion.groups)):
                animation.motion.group(group)
    assert len(read[0]) > 500
    assert read[1] == read[0]
    assert read[2] == read[0]


def test_a_decoder_that_rounds_otherwise_keeps_the_bound_and_the_margin(
    case: tuple[ArraySequence, Choices, bytes],
) -> None:
    sequence, choices, data = case
    points = sequence.read_frames(0, sequence.frame_count)
    bound = choices.settings["tolerance"] * frame_scale(points[0])
    found = []
    for seed in range(3):
        with decoder(shaker(seed) if seed else None) as modules:
            animation = modules["animation"].decode(data)
            between = [0.5 * (a + b) for a, b in zip(animation.times, animation.times[1:], strict=False)]
            found.append(np.array([animation.positions(time) for time in [*animation.times, *between]]))
            step = animation.motion.step
            margins = [DOUBLE_MARGIN if group.is_precise else SINGLE_MARGIN for group in animation.motion.groups]
    spacing = float(np.spacing(np.abs(points).max()))
    for other in found:
        off = np.linalg.norm(other[: len(points)].astype(np.float64) - points, axis=2)
        assert off.max() <= bound * (1 + 1e-15)
        assert np.abs(other.astype(np.float64) - found[0]).max() <= 2 * max(margins) * step + 2 * spacing


def element_of(coordinates: list[tuple[int, int, int]]) -> SpaceBasis:
    """Return a basis with the affine functions of one element that has these points."""
    item = MeshObject("points", Connectivity(len(coordinates)))
    return build_space_basis("patch", [item], np.array(coordinates), points=len(coordinates), functions=4)


def local_count(basis: SpaceBasis) -> int:
    """Return the number of local coordinates of a single element that are more than rounding errors."""
    _, kinds, _ = basis.subbands
    return -2 - int(kinds[-1])


@settings(max_examples=200)
@given(
    st.sampled_from([1, 3, 50, 2**20, 2**40 - 1]).flatmap(
        lambda most: st.lists(st.tuples(*[st.integers(0, most)] * 3), min_size=1, max_size=60)
    )
)
def test_local_coordinates_are_the_same_for_everyone(coordinates: list[tuple[int, int, int]]) -> None:
    basis = element_of(coordinates)
    (functions,) = basis.functions_of_elements()
    orthonormal = plain.Functions(len(coordinates), len(functions))
    local = plain.local_coordinates(np.array(coordinates)[basis.order]).astype(np.float64)
    for column in [np.ones(len(coordinates)), *local][: 1 + local_count(basis)]:
        orthonormal.add(column)
    np.testing.assert_allclose(functions[: len(orthonormal.rows)], orthonormal.rows, rtol=0, atol=1e-12)


def test_local_coordinates_are_uncorrelated_by_falling_width() -> None:
    random = np.random.default_rng(3)
    turn, _ = np.linalg.qr(random.normal(size=(3, 3)))
    flat = random.normal(size=(200, 3)) * [900.0, 5000.0, 40.0]
    points = [tuple(point) for point in np.rint(flat @ turn + 1e6).astype(int).tolist()]
    whole = plain.local_coordinates(np.array(points))
    correlation = np.corrcoef(whole.astype(np.float64))
    assert local_count(element_of(points)) == 3
    assert np.abs(correlation - np.eye(3)).max() < 2.0**-4
    assert (np.diff((whole.astype(np.float64) ** 2).sum(axis=1)) < 0).all()
    assert abs(np.corrcoef(whole[0], flat[:, 1])[0, 1]) > 0.99
    assert abs(np.corrcoef(whole[2], flat[:, 2])[0, 1]) > 0.99


@pytest.mark.parametrize("side", [2, 5, 16])
def test_a_square_keeps_the_axes_of_the_mesh(side: int) -> None:
    square = [(97 * i, 97 * j, 0) for i in range(side) for j in range(side)]
    whole = plain.local_coordinates(np.array(square))
    assert local_count(element_of(square)) == 2
    assert (np.unique(whole[0]).size, np.unique(whole[1]).size) == (side, side)


@pytest.mark.parametrize(
    ("coordinates", "count"),
    [
        ([(5, 5, 5)] * 3, 0),
        ([(0, 0, 0), (3, 1, 2)], 1),
        ([(10 * i, 30 * i, -70 * i) for i in range(9)], 1),
        ([(10 * i, 30 * j, 7 * i + 11 * j) for i in range(5) for j in range(5)], 2),
        ([(0, 0, 0), (1, 0, 0), (0, 1, 0), (0, 0, 1)], 3),
    ],
)
def test_a_direction_without_width_is_no_coordinate(coordinates: list[tuple[int, int, int]], count: int) -> None:
    assert local_count(element_of(coordinates)) == count


def test_another_threshold_is_used_if_a_column_is_near_the_first(monkeypatch: pytest.MonkeyPatch) -> None:
    sequence = sheet(1, 9, 9, tilt=0.2)
    rest = np.rint(300 * sequence.read_frames(0, 1)[0]).astype(np.int64)
    usual = build_space_basis("patch", sequence.objects, rest, points=81, functions=128)
    nearest = usual.nearest
    assert (usual.form.threshold, usual.is_clear) == (0, True)
    monkeypatch.setattr(spacebasis, "MIN_THRESHOLD_DISTANCE", nearest)
    other = build_space_basis("patch", sequence.objects, rest, points=81, functions=128)
    assert other.form.threshold > 0
    assert other.nearest > nearest
    again = decode_space_basis(other.form, other.layout, sequence.objects, rest)
    for made, expected in zip(again.functions_of_elements(), other.functions_of_elements(), strict=True):
        assert np.array_equal(made, expected)
