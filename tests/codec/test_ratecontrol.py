"""Rate control: the requested size or mean error is kept and used up, with few encodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import (
    ArraySequence,
    EncodeReport,
    EncodeSettings,
    InputError,
    MeshObject,
    SettingsError,
    encode,
    encode_to_rms,
    encode_to_size,
    open_animation,
)
from pdecodec.codec.rate_control import CLOSE, COARSEST, FINEST, MAX_ENCODES, search_tolerance
from pdecodec.mesh.metrics import measure_distortion
from tests.support.mesh_cases import grid

DIGITS = 1e-3
"""Largest relative change of a tolerance by rounding to four digits."""


def shaken_sheet() -> ArraySequence:
    """Return a sheet whose vertices move at random, so that every bit of accuracy costs bytes."""
    rng = np.random.default_rng(7)
    points = np.zeros((6, 5, 20, 3))
    points[..., 0] = np.linspace(0, 1, 20)
    points[..., 1] = 0.2 * np.arange(5)[:, None]
    points += 0.05 * rng.standard_normal(points.shape)
    return ArraySequence(points.reshape(6, -1, 3), objects=[MeshObject("sheet", grid(5, 20))], times=np.arange(6) / 24)


SHEET = shaken_sheet()


@settings(max_examples=100)
@given(st.floats(2 * FINEST, COARSEST / 2), st.floats(1e-8, 10.0), st.floats(0.2, 2.0), st.booleans())
def test_a_power_law_is_solved_to_a_hundredth_within_the_encodes_allowed(
    crossing: float, start: float, exponent: float, falls: bool
) -> None:
    tried = []

    def measure(tolerance: float) -> tuple[float, float]:
        tried.append(tolerance)
        return tolerance, (tolerance / crossing) ** (-exponent if falls else exponent)

    found = search_tolerance(measure, start=start, falls=falls)
    assert found is not None
    assert math.exp(-CLOSE * max(1.0, exponent)) - DIGITS <= measure(found)[1] <= 1.0
    assert len(tried) - 1 <= MAX_ENCODES
    assert FINEST <= min(tried) <= max(tried) <= COARSEST


@pytest.mark.parametrize("falls", [True, False])
@pytest.mark.parametrize("crossing", [1e-5, 3e-3, 0.7])
def test_a_value_that_jumps_at_one_tolerance_is_kept_on_the_right_side(falls: bool, crossing: float) -> None:
    def measure(tolerance: float) -> tuple[float, float]:
        is_large = tolerance < crossing if falls else tolerance > crossing
        return tolerance, 50.0 if is_large else 0.02

    found = search_tolerance(measure, start=1e-3, falls=falls)
    assert found is not None
    assert found >= crossing if falls else found <= crossing


@pytest.mark.parametrize(("falls", "end", "other"), [(True, FINEST, COARSEST), (False, COARSEST, FINEST)])
def test_the_end_of_the_range_is_tried_if_all_tolerances_or_none_keep_the_limit(
    falls: bool, end: float, other: float
) -> None:
    assert search_tolerance(lambda tolerance: (tolerance, 0.0), start=1e-3, falls=falls) == end
    tried: list[float] = []

    def measure(tolerance: float) -> tuple[float, float]:
        tried.append(tolerance)
        return tolerance, 2.0

    assert search_tolerance(measure, start=1e-3, falls=falls) is None
    assert tried[-1] == other


@pytest.mark.parametrize("profile", ["auto", "paper"])
def test_a_file_is_hardly_smaller_than_allowed_and_its_tolerance_reproduces_it(profile: Any) -> None:
    size = 2500
    report = encode_to_size(SHEET, size, profile=profile, effort="fast")
    assert report.data is not None
    assert report.bound is not None
    assert 0.95 * size <= len(report.data) == report.file_bytes <= size
    with open_animation(report.data) as animation:
        assert measure_distortion(SHEET, animation).max_error <= report.bound
    tolerance = float(f"{report.bound / report.scale:.4g}")
    assert encode(SHEET, tolerance=tolerance, profile=profile, effort="fast").data == report.data


def test_a_mean_error_is_hardly_smaller_than_allowed() -> None:
    rms = 2e-3
    report = encode_to_rms(SHEET, rms, effort="fast")
    assert report.data is not None
    with open_animation(report.data) as animation:
        found = measure_distortion(SHEET, animation)
    assert 0.9 * rms <= found.rms_error / found.scale <= rms
    assert report.rms_error == pytest.approx(found.rms_error, rel=1e-6)


def test_a_file_is_written_whole_and_progress_names_the_current_encode(tmp_path: Path) -> None:
    path, said = tmp_path / "sheet.pdeanim", list[str]()
    report = encode_to_size(SHEET, 1500, path, effort="fast", progress=lambda done, total, what: said.append(what))
    assert (report.path, report.data) == (path, None)
    assert path.stat().st_size == report.file_bytes
    assert path.read_bytes() == encode_to_size(SHEET, 1500, effort="fast").data
    assert list(tmp_path.iterdir()) == [path]
    attempts = sorted({int(what.removeprefix("encoding, attempt ")) for what in said})
    assert attempts == list(range(1, len(attempts) + 1))
    assert 2 <= len(attempts) <= MAX_ENCODES


@pytest.mark.parametrize(
    "control",
    [lambda *a, **k: encode_to_size(SHEET, 1500, *a, **k), lambda *a, **k: encode_to_rms(SHEET, 1e-3, *a, **k)],
)
def test_invalid_arguments_are_refused_before_anything_is_encoded(
    tmp_path: Path, control: Callable[..., EncodeReport]
) -> None:
    def encoding(*_: object) -> None:
        raise AssertionError("nothing is to be encoded")

    path = tmp_path / "sheet.pdeanim"
    path.write_bytes(b"kept")
    with pytest.raises(InputError, match="exists already"):
        control(path, progress=encoding)
    assert path.read_bytes() == b"kept"
    for bound in ({"tolerance": 1e-3}, {"settings": EncodeSettings(max_error=0.1)}):
        with pytest.raises(SettingsError, match="give one of"):
            control(**bound, progress=encoding)
    with pytest.raises(SettingsError, match="no setting named quality"):
        control(quality=3, progress=encoding)


def test_a_limit_too_small_names_the_smallest_reached_and_writes_nothing(
    tmp_path: Path,
) -> None:
    smallest = encode(SHEET, tolerance=COARSEST, effort="fast").file_bytes
    with pytest.raises(SettingsError, match=rf"file of 50 bytes: the smallest file takes {smallest}; allow as many"):
        encode_to_size(SHEET, 50, tmp_path / "sheet.pdeanim", effort="fast")
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("rms", [1e-8, 1e-10, 1e-15])
def test_a_mean_error_below_the_spacing_of_float32_is_found(rms: float) -> None:
    report = encode_to_rms(SHEET, rms, effort="fast")
    assert report.rms_error <= rms * report.scale


def test_a_file_that_may_be_as_large_as_it_likes_is_exact_and_no_finer_tolerance_is_tried() -> None:
    attempts = set[str]()
    report = encode_to_size(SHEET, 10**6, effort="fast", progress=lambda done, total, what: attempts.add(what))
    assert report.max_error == 0
    assert len(attempts) < MAX_ENCODES


@pytest.mark.parametrize("limit", [0, -1, 1.5, math.inf, math.nan, "1500", None])
def test_invalid_limits_are_refused(limit: Any) -> None:
    with pytest.raises(SettingsError, match="size must be a positive whole number of bytes"):
        encode_to_size(SHEET, limit)
    if limit != 1.5:
        with pytest.raises(SettingsError, match="rms must be a positive number"):
            encode_to_rms(SHEET, limit)
