"""The model is chosen by what it costs: no larger than the scene needs, and as the settings fix it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_cases import grid
from numpy.typing import NDArray

from pdecodec.cost import estimate_bits
from pdecodec.curves import extract_curves
from pdecodec.decoder import Animation, open_animation
from pdecodec.elements import PIECE_POINTS, WHOLE_CURVE
from pdecodec.encoder import EncodeReport, encode
from pdecodec.kernels.estimate import (
    BITS_OF_LEVEL,
    BITS_OF_ZERO,
    BITS_PER_DOUBLING,
    add_correction_bits,
    add_correction_bits_reference,
    add_level_bits,
    add_level_bits_reference,
    level_bits,
)
from pdecodec.model import build_model
from pdecodec.plan import choose_levels, make_plan
from pdecodec.restshape import quantise_rest
from pdecodec.sampling import Window, read_windows, take_sample
from pdecodec.segments import Segment
from pdecodec.sequence import ArraySequence, MeshObject
from pdecodec.settings import EncodeSettings

Float64Array = NDArray[np.float64]

ROWS, COLUMNS = 12, 40


def quad_grid(rows: int = ROWS, columns: int = COLUMNS) -> tuple[Float64Array, MeshObject]:
    y, x = np.meshgrid(np.linspace(0, 0.3, rows), np.linspace(0, 1, columns), indexing="ij")
    return np.stack([x, y, 0 * x], axis=-1).reshape(-1, 3), MeshObject("grid", grid(rows, columns))


def clip(displacement: Float64Array, fps: float = 24.0) -> ArraySequence:
    rest, sheet = quad_grid()
    return ArraySequence(rest + displacement, objects=[sheet], fps=fps)


def encoded(sequence: ArraySequence, tmp_path: Path, **settings: object) -> tuple[EncodeReport, Animation]:
    path = tmp_path / "clip.pdeanim"
    chosen = EncodeSettings(**{"profile": "segments", **settings})  # type: ignore[arg-type]
    report = encode(sequence, path, chosen, overwrite=True)
    return report, open_animation(path)


def frames_of_segments(animation: Animation) -> list[int]:
    with animation:
        return [segment.frames for segment in animation._segments]


def bending(times: Float64Array, rate: Float64Array | float) -> Float64Array:
    x = quad_grid()[0][:, 0]
    offset = np.zeros((times.size, x.size, 3))
    offset[..., 2] = 0.2 * np.sin(rate * times)[:, None] * np.sin(2 * x)
    return offset


def test_a_still_clip_costs_its_rest_shape_and_no_coefficient(tmp_path: Path) -> None:
    report, animation = encoded(clip(np.zeros((50, ROWS * COLUMNS, 3))), tmp_path)
    animation.close()
    assert report.sections["COEF"] == 0
    assert report.sections["CORR"] == 0
    assert report.max_error <= report.bound  # type: ignore[operator]


def test_segments_are_long_where_motion_is_slow_and_short_where_it_is_fast(tmp_path: Path) -> None:
    times = np.arange(160) / 24.0
    phase = np.where(times < times[80], times, times[80] + 12 * (times - times[80]))
    report, animation = encoded(clip(bending(phase, 1.0)), tmp_path)
    frames = frames_of_segments(animation)
    ends = np.cumsum(frames)
    slow = [count for count, end in zip(frames, ends, strict=True) if end <= 80]
    fast = [count for count, end in zip(frames, ends, strict=True) if end - count >= 80]
    assert np.mean(slow) > 1.5 * np.mean(fast)
    assert report.max_error <= report.bound  # type: ignore[operator]


def test_no_segment_of_a_longer_clip_is_left_with_one_frame(tmp_path: Path) -> None:
    for frames in range(2, 26):
        _, animation = encoded(clip(bending(np.arange(frames) / 24.0, 9.0)), tmp_path, segment_frames=4)
        counts = frames_of_segments(animation)
        assert sum(counts) == frames
        assert min(counts) >= 2


def test_an_oscillation_is_carried_by_longer_segments_with_an_alpha_than_without(tmp_path: Path) -> None:
    motion = clip(bending(np.arange(120) / 24.0, 14.0))
    free, first = encoded(motion, tmp_path, tolerance=3e-3)
    alphas = [segment.alpha for segment in first._segments]
    first.close()
    cubic, second = encoded(motion, tmp_path, tolerance=3e-3, alpha=0.0)
    second.close()
    assert max(alphas) > 0
    assert free.file_bytes < cubic.file_bytes


def test_curves_whose_motion_is_finer_get_shorter_pieces() -> None:
    rest, sheet = quad_grid(ROWS, 200)
    rough = np.zeros((8, ROWS, 200, 3))
    wave = np.sin(np.linspace(0, 60, 200))
    rough[:, ROWS - 2 :, :, 2] = 0.02 * np.linspace(0, 1, 8)[:, None, None] * wave
    sequence = ArraySequence(rest + rough.reshape(8, -1, 3), objects=[sheet])
    bound = 1e-3
    curves = extract_curves(sequence.objects)
    shape = quantise_rest(sequence.points[0], 0.5 * bound)
    settings = EncodeSettings(profile="segments", max_error=bound)
    plan = make_plan(sequence, curves, shape, settings, bound=bound)
    levels = choose_levels(sequence, curves, shape, plan, settings, bound=bound)
    is_rough = np.array([curves.order[a] >= (ROWS - 2) * 200 for a in curves.starts[:-1]])
    assert levels[is_rough].mean() < levels[~is_rough].mean()


def test_the_plan_keeps_to_what_the_settings_fix() -> None:
    sequence = clip(bending(np.arange(40) / 24.0, 5.0))
    curves = extract_curves(sequence.objects)
    shape = quantise_rest(sequence.points[0], 5e-4)
    settings = EncodeSettings(profile="segments", alignment="rotation", segment_frames=7, piece_points=20, r=2.5)
    plan = make_plan(sequence, curves, shape, settings, bound=1e-3)
    assert (plan.alignment, plan.frames, plan.r) == ("rotation", 7, 2.5)
    assert PIECE_POINTS[plan.level] == 24  # the next length the format knows
    levels = choose_levels(sequence, curves, shape, plan, settings, bound=1e-3)
    assert (levels == plan.level).all()


@pytest.mark.parametrize("alignment", ["none", "rotation"])
def test_the_paper_profile_has_32_coefficients_per_curve_axis_and_segment(tmp_path: Path, alignment: str) -> None:
    sequence = clip(bending(np.arange(22) / 24.0, 5.0))
    report, animation = encoded(sequence, tmp_path, profile="paper", alignment=alignment)
    with animation:
        assert [segment.frames for segment in animation._segments] == [11, 11]
        assert report.elements == ROWS  # whole curves
        for index in range(2):
            assert animation._coefficients(index).shape.size == 32 * 3 * ROWS


def test_without_a_bound_there_are_no_corrections_and_the_error_is_measured(tmp_path: Path) -> None:
    sequence = clip(bending(np.arange(30) / 24.0, 25.0))
    report, animation = encoded(sequence, tmp_path, profile="paper")
    with animation:
        decoded = animation.read_frames(0, 30).astype(np.float64)
    off = np.sqrt(((decoded - sequence.points) ** 2).sum(axis=2))
    assert report.bound is None
    assert report.corrections == 0
    assert report.max_error == pytest.approx(off.max(), rel=1e-12)
    assert report.rms_error == pytest.approx(np.sqrt((off**2).mean()), rel=1e-12)


def test_more_effort_does_not_cost_more_bytes_on_a_waving_sheet(tmp_path: Path) -> None:
    motion = clip(bending(np.arange(60) / 24.0, 9.0))
    sizes = []
    for effort in (1, 9):
        report, animation = encoded(motion, tmp_path, effort=effort)
        animation.close()
        sizes.append(report.file_bytes)
    assert sizes[1] <= 1.02 * sizes[0]


def test_a_sample_is_of_whole_stretches_spread_over_the_mesh() -> None:
    rest, sheet = quad_grid(50, 60)
    curves = extract_curves([sheet])
    sample = take_sample(curves, quantise_rest(rest.astype(np.float32), 1e-3), 600, run=30)
    assert np.unique(sample.vertices).size == sample.vertices.size
    assert 400 <= sample.vertices.size <= 800
    assert set(sample.curves.lengths.tolist()) == {30}
    rows = np.unique(sample.vertices // 60)
    assert rows[0] < 10
    assert rows[-1] >= 40


def test_windows_cover_the_beginning_the_middle_and_the_end() -> None:
    sequence = clip(np.zeros((100, ROWS * COLUMNS, 3)))
    every = np.arange(5, dtype=np.int32)
    assert [window.first for window in read_windows(sequence, every, 10)] == [0, 45, 90]
    assert [window.first for window in read_windows(sequence, every, 10, most=1)] == [45]
    assert [window.first for window in read_windows(sequence, every, 200)] == [0]


def test_the_estimate_charges_zeros_levels_and_doublings() -> None:
    assert level_bits(0.0) == BITS_OF_ZERO
    assert level_bits(1.0) == pytest.approx(BITS_OF_ZERO + BITS_OF_LEVEL)
    assert level_bits(8.0) == pytest.approx(BITS_OF_ZERO + BITS_OF_LEVEL + 3 * BITS_PER_DOUBLING)


def test_compiled_estimates_agree_with_plain_numpy() -> None:
    random = np.random.default_rng(5)
    levels = random.integers(-20, 21, (30, 12))
    starts = np.array([0, 4, 5, 17, 30])
    compiled, plain = np.ones(4), np.ones(4)
    add_level_bits(levels, starts, compiled)
    add_level_bits_reference(levels, starts, plain)
    np.testing.assert_allclose(compiled, plain, rtol=1e-12)
    points = random.normal(size=(5, 30, 3)).astype(np.float32)
    decoded = points + random.normal(scale=0.01, size=points.shape).astype(np.float32)
    order = random.permutation(30).astype(np.int32)
    add_correction_bits(points, decoded, order, starts, 0.005, 0.015, compiled)
    add_correction_bits_reference(points, decoded, order, starts, 0.005, 0.015, plain)
    np.testing.assert_allclose(compiled, plain, rtol=1e-12)
    assert compiled.min() > 10.0


def test_an_exact_model_is_charged_for_its_coefficients_only() -> None:
    rest, sheet = quad_grid()
    curves = extract_curves([sheet])
    shape = quantise_rest(rest.astype(np.float32), 1e-4)
    model = build_model(curves, np.full(curves.count, WHOLE_CURVE), shape, r=0.0, alignment="affine")
    still = np.repeat(shape.points[None].astype(np.float32), 6, axis=0)
    window = Window(0, still, np.arange(6) / 24.0)
    bits, alpha = estimate_bits(window, model, 2e-3, 1e-3)
    assert alpha == 0.0
    functions = Segment(0, window.times, 0.0).functions
    np.testing.assert_allclose(bits, model.elements.ranks * 3 * functions * BITS_OF_ZERO)
