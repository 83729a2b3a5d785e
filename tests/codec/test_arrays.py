"""Evaluation by other array libraries, through fields, weights and corrections of groups."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import ArrayEvaluator, SettingsError, encode
from pdecodec import open as open_clip
from pdecodec.codec.array_evaluator import QUANTITIES
from pdecodec.codec.decoder import Animation
from pdecodec.codec.opening import open_animation
from spec.vector_files import accepted_files
from tests.codec.test_storage import RATE, long_clip

LIBRARIES = ("numpy", "array_api_strict", "torch", "jax.numpy", "cupy")
NAMES = (
    "closed_form_and_residuals", "groups_of_cosines", "groups_of_shapes", "groups_of_one_frame", "groups_in_double",
    "irregular_times", "points", "raw_vertices", "residuals_in_a_cycle", "runs", "jumps_between_groups",
    "one_vertex", "static", "two_frames",
)  # fmt: skip
"""Files with every kind of functions of time, with and without corrections."""
SINGLE = float(np.finfo(np.float32).eps)


@pytest.fixture(params=LIBRARIES)
def library(request: pytest.FixtureRequest) -> Any:
    """Import an array library; if it is not installed, skip the test with its name."""
    return pytest.importorskip(request.param, exc_type=ImportError)


def here(array: Any) -> np.ndarray:
    """Convert any array to numpy."""
    return np.asarray(array.get() if hasattr(array, "get") else array)


def times_of(animation: Animation) -> np.ndarray:
    """Return times of frames, between them, and before and after all, in no order."""
    frames = animation.times
    between = frames[:-1] + 0.3 * np.diff(frames)
    found = [frames[0] - 1, *frames[:9], *between[:9], *frames[-3:], *between[-3:], frames[-1] + 1]
    return np.random.default_rng(0).permutation(found)


def margin(animation: Animation, quantity: str, times: np.ndarray) -> float:
    """Return the rounding error that float32 allows for the sums at any of the times."""
    evaluator, largest = ArrayEvaluator(animation, np), 0.0
    groups = range(len(animation.group_edges) - 1)
    fields = [np.abs(evaluator.fields(group)) for group in groups]
    for time in times:
        for group in groups:
            weights = np.abs(evaluator.weights(time, group, quantity=quantity))
            largest = max(largest, float((fields[group] * weights[:, None]).sum(axis=0).max(initial=0)))
    offset = max(float(np.abs(evaluator.corrections(group).offsets).max(initial=0)) for group in groups)
    steps = np.diff(animation.times)
    largest += 2 * offset / (steps.min() if quantity == "velocities" and steps.size else 1)
    return 4 * SINGLE * (largest + float(np.abs(animation.positions(times)).max()))


@pytest.mark.parametrize("name", NAMES)
def test_every_library_gives_what_the_animation_does(library: Any, name: str) -> None:
    with open_animation(accepted_files()[name]) as whole:
        for animation in whole.runs:
            assert isinstance(animation, Animation)
            device = "cpu" if library.__name__ == "torch" else None
            evaluator, times = ArrayEvaluator(animation, library, device=device), times_of(animation)
            for quantity in QUANTITIES:
                expected = getattr(animation, quantity)(times)
                found = getattr(evaluator, quantity)(times)
                assert found.dtype == library.float32
                assert np.abs(here(found) - expected).max() <= margin(animation, quantity, times), quantity
            assert here(evaluator.positions(float(times[0]))).shape == (animation.vertex_count, 3)
            assert tuple(evaluator.positions([]).shape) == (0, animation.vertex_count, 3)


def test_fields_and_weights_are_the_motion(tmp_path: Path) -> None:
    encode(long_clip(), tmp_path / "a.pdeanim", effort="fast", group_frames=RATE)
    with open_clip(tmp_path / "a.pdeanim") as animation:
        evaluator = ArrayEvaluator(animation, np)
        frame = int(evaluator.corrections(1).frames[0])
        fields, weights = evaluator.fields(1), evaluator.weights(animation.times[frame], 1)
        assert fields.shape[:2] == (len(weights), animation.vertex_count)
        assert {fields.shape[2], weights.shape[1]} == {1, 3}
        points = animation.reference_and_space()[0].points + (fields * weights[:, None]).sum(axis=0)
        rows = evaluator.corrections(1)
        own = rows.frames == frame
        points[rows.vertices[own]] += rows.offsets[own]
        assert own.any()
        assert np.abs(points - animation.positions(animation.times[frame])).max() < 1e-6
        assert not evaluator.weights(animation.times[frame], 3).any()
        looped = animation.positions(animation.times[-1] + 2, outside="loop")
        assert np.abs(evaluator.positions(animation.times[-1] + 2, outside="loop") - looped).max() < 1e-6


def test_invalid_groups_and_files_of_runs_are_refused() -> None:
    with (
        open_animation(accepted_files()["runs"]) as several,
        pytest.raises(SettingsError, match="one of its runs"),
    ):
        ArrayEvaluator(several, np)
    with open_animation(accepted_files()["groups"]) as animation:
        evaluator, count = ArrayEvaluator(animation, np), len(animation.group_edges) - 1
        for call in (evaluator.fields, evaluator.corrections, lambda group: evaluator.weights(0.0, group)):
            for group in (-1, count):
                with pytest.raises(SettingsError, match=f"there is no group {group}; the file has {count}"):
                    call(group)
        with pytest.raises(SettingsError, match="quantity must be one of positions"):
            evaluator.weights(0.0, 0, quantity="normals")  # type: ignore[arg-type]
        for nothing in (lambda: evaluator.positions(np.nan), lambda: evaluator.weights(np.nan, 0)):
            with pytest.raises(SettingsError, match="times must be"):
                nothing()
        with pytest.raises(SettingsError, match="is outside the clip"):
            evaluator.positions(-1.0, outside="refuse")
