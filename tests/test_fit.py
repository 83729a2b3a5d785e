"""The fit against a dense least squares over the paper's 32 functions, and against motions it must give exactly."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from pdecodec.alignment import POSE_NUMBERS
from pdecodec.basis import TIME_FUNCTIONS, paper_coefficients, paper_functions, series_functions
from pdecodec.coefficients import dequantise_segment
from pdecodec.curves import Curves
from pdecodec.elements import WHOLE_CURVE, arc_length_parameter
from pdecodec.fit import ALPHAS, RATES, choose_alpha, fit_levels, fit_segment
from pdecodec.kernels.orthonormal import orthonormalise_reference
from pdecodec.model import Model, ModelAlignment, SegmentCoefficients, build_model
from pdecodec.restshape import quantise_rest
from pdecodec.sampling import Window
from pdecodec.segments import Segment, Term

Float32Array = NDArray[np.float32]
Float64Array = NDArray[np.float64]

TIMES = np.cumsum(np.random.default_rng(1).uniform(0.5, 1.5, 13)) / 24
"""Irregular times [s] of a segment of 13 frames."""

LENGTHS = (40, 9, 3, 1, 25)
"""Points of the curves; three and one are fewer than the functions."""


def rest_points() -> Float64Array:
    steps = np.random.default_rng(2).normal(size=(sum(LENGTHS), 3))
    return np.cumsum(steps, axis=0)


def scene(alignment: ModelAlignment = "none", *, r: float = 3.0, level: int = WHOLE_CURVE) -> Model:
    """Five curves whose vertices stand in no order."""
    order = np.random.default_rng(3).permutation(sum(LENGTHS)).astype(np.int32)
    scattered = np.empty((order.size, 3), np.float32)
    scattered[order] = rest_points()
    curves = Curves(order, np.cumsum([0, *LENGTHS]))
    return build_model(curves, np.full(len(LENGTHS), level), quantise_rest(scattered, 1e-6), r=r, alignment=alignment)


def in_mesh_order(model: Model, along: Float64Array) -> Float32Array:
    """(frames, vertices, 3) in curve order, put in the order of the mesh."""
    points = np.empty(along.shape, np.float32)
    points[:, model.elements.order] = along
    return points


def random_motion(model: Model, seed: int = 4) -> Float64Array:
    """(frames, vertices, 3) float64 in curve order, exactly as float32 holds it."""
    moved = model.rest + 0.3 * np.random.default_rng(seed).normal(size=(len(TIMES), *model.rest.shape))
    return moved.astype(np.float32).astype(np.float64)


def evaluate(model: Model, segment: Segment, found: SegmentCoefficients) -> Float64Array:
    """(frames, vertices, 3) in curve order: what the decoder makes of coefficients at the segment's frames."""
    terms = [Term(0, slice(0, segment.frames), segment.weights(segment.times))]
    out = np.empty((segment.frames, len(model.rest), 3), np.float32)
    model.evaluate(terms, lambda _: found, out)
    return out[:, model.elements.order].astype(np.float64)


def functions_of(model: Model, element: int) -> Float64Array:
    elements = model.elements
    begin, end = elements.basis_starts[element : element + 2]
    return elements.basis[begin:end].reshape(int(elements.ranks[element]), -1)


def places(model: Model, element: int) -> slice:
    return slice(*model.elements.starts[element : element + 2].tolist())


@pytest.mark.parametrize("alignment", ["none", "affine"])
@pytest.mark.parametrize(("alpha", "r"), [(0.0, 0.0), (2.5, 3.0), (10.0, 8.0)])
def test_what_the_fit_leaves_is_orthogonal_to_every_function(alignment: ModelAlignment, alpha: float, r: float) -> None:
    model, segment = scene(alignment, r=r), Segment(0, TIMES, alpha)
    moved = random_motion(model)
    found = fit_segment(in_mesh_order(model, moved), model, segment)
    assert found.poses.shape == (0, POSE_NUMBERS * 4)
    for element in range(model.elements.count):
        inside, functions = places(model, element), functions_of(model, element)
        columns = slice(*model.elements.column_starts[element : element + 2].tolist())
        coefficients = found.shape[columns].reshape(-1, TIME_FUNCTIONS, 3)
        fitted = np.einsum("at,bi,bac->tic", segment.rows, functions, coefficients)
        left = moved[:, inside] - model.rest[inside] - fitted
        normal = np.einsum("at,bi,tic->abc", segment.rows, functions, left)  # Eq. 25
        np.testing.assert_allclose(normal, 0, atol=1e-12)


@pytest.mark.parametrize(("alpha", "r"), [(2.5, 3.0), (5.0, 5.0), (3.5, 8.0)])
def test_the_fit_equals_a_dense_least_squares_over_the_32_functions_of_the_paper(alpha: float, r: float) -> None:
    model, segment = scene(r=r), Segment(0, TIMES, alpha)
    moved = random_motion(model)
    found = fit_segment(in_mesh_order(model, moved), model, segment)
    inside = places(model, 0)
    rest = model.rest[inside]
    u = arc_length_parameter(rest, np.array([0, len(rest)]))
    t = (2 * TIMES - TIMES[0] - TIMES[-1]) / (TIMES[-1] - TIMES[0])
    dense = paper_functions(u[None, :], t[:, None], alpha, r).reshape(-1, 32)
    displacement = (moved[:, inside] - rest).reshape(-1, 3)
    solution = np.linalg.lstsq(dense, displacement)[0]  # Eq. 25, (32, 3)

    coefficients = np.moveaxis(found.shape[:8].reshape(8, TIME_FUNCTIONS, 3), -1, 0).swapaxes(1, 2)
    fitted = np.einsum("at,bi,cab->tic", segment.rows, functions_of(model, 0), coefficients)
    np.testing.assert_allclose(fitted.reshape(-1, 3), dense @ solution, rtol=0, atol=1e-7)

    _, space_triangle, _ = orthonormalise_reference(series_functions(u, r, 8), 0.0)
    converted = paper_coefficients(
        coefficients, alpha=alpha, r=r, time_triangle=segment.triangle, space_triangle=space_triangle
    )
    expected = solution.T.reshape(3, 4, 8)
    np.testing.assert_allclose(converted.coefficients, expected, rtol=0, atol=1e-4 * np.abs(expected).max())


@pytest.mark.parametrize("alignment", ["none", "affine"])
def test_a_motion_inside_the_space_is_found_exactly(alignment: ModelAlignment) -> None:
    model, segment = scene(alignment, level=2), Segment(5, TIMES, 3.5)
    wanted = np.random.default_rng(6).normal(size=(model.elements.columns, 12))
    motion = evaluate(model, segment, SegmentCoefficients(wanted, np.zeros((0, 28))))
    found = fit_segment(in_mesh_order(model, motion), model, segment)
    np.testing.assert_allclose(found.shape, wanted, rtol=0, atol=1e-5)  # float32 positions


@pytest.mark.parametrize("frames", [1, 2, 3, 4])
def test_points_that_a_segment_and_its_elements_can_name_one_by_one_are_found_exactly(frames: int) -> None:
    model = scene(level=0, r=1.5)  # pieces of about four points: as many functions as points
    segment = Segment(0, TIMES[:frames], 2.5)
    moved = random_motion(model)[:frames]
    found = fit_segment(in_mesh_order(model, moved), model, segment)
    assert found.shape.shape == (sum(LENGTHS), 3 * frames)
    np.testing.assert_allclose(evaluate(model, segment, found), moved, rtol=0, atol=2e-6)


def test_affine_alignment_carries_a_shear_that_grows_with_time() -> None:
    model, segment = scene("affine"), Segment(0, TIMES, 0.0)
    shear = np.array([[0, 0.3, -0.2], [0.1, 0, 0.5], [0, 0.4, 0.2]])
    moved = model.rest + TIMES[:, None, None] * (model.rest @ shear + [1.0, 2.0, -1.0])
    found = fit_segment(in_mesh_order(model, moved), model, segment)
    np.testing.assert_allclose(evaluate(model, segment, found), moved, rtol=0, atol=2e-5)
    beyond_affine = model.elements.kept >= 4
    np.testing.assert_allclose(found.shape[beyond_affine], 0, atol=1e-3 * np.abs(found.shape).max())


def test_an_even_turn_needs_no_coefficient_but_those_of_the_moving_frames() -> None:
    # Its quaternion is cos and sin of half the angle: two of the four functions, where alpha is their rate.
    alpha = 2.5
    model, segment = scene("rotation"), Segment(0, TIMES, alpha)
    x = (2 * TIMES - TIMES[0] - TIMES[-1]) / (TIMES[-1] - TIMES[0])
    turns = Rotation.from_rotvec(2 * alpha * (x - x[0])[:, None] * [0.6, 0, 0.8]).as_matrix()
    shifts = np.sin(alpha * x)[:, None, None] * [3.0, -1.0, 0.5]
    moved = np.empty((len(TIMES), *model.rest.shape))
    for element in range(model.elements.count):
        inside = places(model, element)
        centre = model.rest[inside][0]
        moved[:, inside] = np.einsum("fij,nj->fni", turns, model.rest[inside] - centre) + centre + shifts
    found = fit_segment(in_mesh_order(model, moved), model, segment)
    assert found.poses.shape == (len(LENGTHS), 4 * POSE_NUMBERS)
    assert np.abs(found.shape).max() < 1e-4
    np.testing.assert_allclose(evaluate(model, segment, found), moved, rtol=0, atol=2e-5)


def test_moving_frames_are_undone_before_the_fit_and_come_back_after_it() -> None:
    # Elements of at most eight points: the fit leaves nothing in space, only in time.
    model, segment = scene("rotation", level=1, r=0.0), Segment(0, TIMES[:4], 1.5)
    moved = random_motion(model)[:4]
    found = fit_segment(in_mesh_order(model, moved), model, segment)
    np.testing.assert_allclose(evaluate(model, segment, found), moved, rtol=0, atol=1e-5)


def oscillation(model: Model, alpha: float) -> Float64Array:
    """A motion whose every point follows sin and cos of alpha over half the segment, or a cubic for alpha 0."""
    x = (2 * TIMES - TIMES[0] - TIMES[-1]) / (TIMES[-1] - TIMES[0])
    courses = [np.sin(alpha * x), np.cos(alpha * x)] if alpha else [x**2, x**3]
    amplitudes = np.random.default_rng(7).normal(size=(2, *model.rest.shape))
    return model.rest + np.einsum("at,aic->tic", np.stack(courses), amplitudes)


@pytest.mark.parametrize("alpha", ALPHAS)
def test_the_alpha_of_an_oscillation_is_found(alpha: float) -> None:
    model = scene()
    points = in_mesh_order(model, oscillation(model, alpha))
    assert choose_alpha(Window(0, points, TIMES), model) == alpha


def test_of_alphas_that_do_as_well_the_first_is_taken() -> None:
    model = scene()
    few = Window(0, in_mesh_order(model, random_motion(model)[:4]), TIMES[:4])
    assert choose_alpha(few, model) == ALPHAS[0]  # four frames: every alpha fits exactly
    still = Window(0, in_mesh_order(model, np.repeat(model.rest[None], 13, axis=0)), TIMES)
    assert choose_alpha(still, model) == ALPHAS[0]
    assert choose_alpha(still, model, [7.0]) == 7.0


def test_the_rate_chosen_leaves_less_than_any_other() -> None:
    model = scene()
    moved = oscillation(model, 4.1)
    points = in_mesh_order(model, moved)

    def left(alpha: float) -> float:
        segment = Segment(0, TIMES, alpha)
        displacement = (points[:, model.elements.order] - model.rest).reshape(len(TIMES), -1)
        return float(((displacement - segment.rows.T @ (segment.rows @ displacement)) ** 2).sum())

    assert choose_alpha(Window(0, points, TIMES), model) == min(ALPHAS, key=left)


@pytest.mark.parametrize("alignment", ["none", "affine", "rotation"])
def test_quantised_coefficients_are_within_a_step_of_the_fit(alignment: ModelAlignment) -> None:
    model, segment, step = scene(alignment), Segment(0, TIMES, 2.5), 1e-3
    points = in_mesh_order(model, random_motion(model))
    levels = fit_levels(points, model, segment, step)
    assert levels.exponent == 0
    found, fitted = dequantise_segment(levels, model, step), fit_segment(points, model, segment)
    assert found.shape.shape == fitted.shape.shape
    if alignment == "rotation":
        np.testing.assert_allclose(found.poses, fitted.poses, rtol=0, atol=step)
        # What rounding the frames displaces is refitted: the whole is as near as without rounding.
        moved = points[:, model.elements.order]
        errors = [((evaluate(model, segment, item) - moved) ** 2).sum() for item in (found, fitted)]
        assert errors[0] == pytest.approx(errors[1], rel=1e-4)
    else:
        np.testing.assert_allclose(found.shape, fitted.shape, rtol=0, atol=0.6 * step * (1 + 1e-9))


def test_candidates_begin_with_the_polynomials() -> None:
    assert ALPHAS[0] == RATES[0] == 0.0
    assert list(ALPHAS) == sorted(ALPHAS)
    assert list(RATES) == sorted(RATES)
