"""Rate control: the size or the mean error asked for is kept and used up, in few encodes."""

from __future__ import annotations

import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from mesh_cases import grid

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.encodereport import EncodeReport
from pdecodec.errors import InputError, SettingsError
from pdecodec.metrics import measure_distortion
from pdecodec.ratecontrol import CLOSE, COARSEST, FINEST, MOST_ENCODES, encode_to_rms, encode_to_size, search_tolerance
from pdecodec.sequence import ArraySequence, MeshObject
from pdecodec.settings import EncodeSettings

DIGITS = 1e-3
"""How far rounding to four digits moves a tolerance, relatively, at most."""


def shaken_sheet() -> ArraySequence:
    """A sheet whose vertices move at random, so that every bit of accuracy costs bytes."""
    rng = np.random.default_rng(7)
    points = np.zeros((6, 5, 20, 3))
    points[..., 0] = np.linspace(0, 1, 20)
    points[..., 1] = 0.2 * np.arange(5)[:, None]
    points += 0.05 * rng.standard_normal(points.shape)
    return ArraySequence(points.reshape(6, -1, 3), objects=[MeshObject("sheet", grid(5, 20))], times=np.arange(6) / 24)


SHEET = shaken_sheet()


class PowerLaw:
    """Values that are a power of the tolerance, over the limit; counts how often it is asked."""

    def __init__(self, exponent: float, crossing: float) -> None:
        self.exponent, self.crossing, self.count = exponent, crossing, 0

    def __call__(self, tolerance: float) -> tuple[float, float]:
        self.count += 1
        assert FINEST <= tolerance <= COARSEST
        return tolerance, (tolerance / self.crossing) ** self.exponent


@settings(max_examples=100, deadline=None)
@given(st.floats(2 * FINEST, COARSEST / 2), st.floats(1e-8, 10.0), st.floats(0.2, 2.0), st.booleans())
def test_a_power_law_is_solved_to_a_hundredth_within_the_encodes_allowed(
    crossing: float, start: float, exponent: float, falls: bool
) -> None:
    measure = PowerLaw(-exponent if falls else exponent, crossing)
    found = search_tolerance(measure, start=start, falls=falls)
    assert found is not None
    share = measure(found)[1]
    assert share <= 1.0
    assert share >= math.exp(-CLOSE * max(1.0, exponent)) - DIGITS
    assert measure.count - 1 <= MOST_ENCODES


@pytest.mark.parametrize("falls", [True, False])
@pytest.mark.parametrize("crossing", [1e-5, 3e-3, 0.7])
def test_a_value_that_jumps_at_one_tolerance_is_kept_on_the_right_side(falls: bool, crossing: float) -> None:
    def measure(tolerance: float) -> tuple[float, float]:
        is_large = tolerance < crossing if falls else tolerance > crossing
        return tolerance, 50.0 if is_large else 0.02

    found = search_tolerance(measure, start=1e-3, falls=falls)
    assert found is not None
    assert found >= crossing if falls else found <= crossing


@pytest.mark.parametrize(("falls", "end"), [(True, FINEST), (False, COARSEST)])
def test_a_limit_that_nothing_reaches_takes_the_end_of_the_range(falls: bool, end: float) -> None:
    assert search_tolerance(lambda tolerance: (tolerance, 0.0), start=1e-3, falls=falls) == end


@pytest.mark.parametrize(("falls", "end"), [(True, COARSEST), (False, FINEST)])
def test_where_no_tolerance_keeps_the_limit_the_last_end_was_tried(falls: bool, end: float) -> None:
    tried: list[float] = []

    def measure(tolerance: float) -> tuple[float, float]:
        tried.append(tolerance)
        return tolerance, 2.0

    assert search_tolerance(measure, start=1e-3, falls=falls) is None
    assert tried[-1] == end


def test_a_file_is_as_large_as_allowed_and_hardly_smaller() -> None:
    size = 1800
    report = encode_to_size(SHEET, size, effort=1)
    assert report.data is not None
    assert 0.97 * size <= len(report.data) == report.file_bytes <= size
    with open_animation(report.data) as animation:
        assert measure_distortion(SHEET, animation).max_error <= report.bound


def test_a_mean_error_is_as_large_as_allowed_and_hardly_smaller() -> None:
    rms = 2e-3
    report = encode_to_rms(SHEET, rms, effort=1)
    assert report.data is not None
    with open_animation(report.data) as animation:
        found = measure_distortion(SHEET, animation)
    assert 0.9 * rms <= found.rms_error / found.scale <= rms
    assert report.rms_error == pytest.approx(found.rms_error, rel=1e-6)


def test_the_tolerance_found_gives_the_same_bytes_again() -> None:
    report = encode_to_size(SHEET, 1500, effort=1)
    assert report.bound is not None
    tolerance = float(f"{report.bound / report.scale:.4g}")
    assert encode(SHEET, tolerance=tolerance, effort=1).data == report.data


def test_the_closed_form_profile_is_held_to_a_size_too() -> None:
    report = encode_to_size(SHEET, 3000, settings=EncodeSettings(profile="segments", effort=1))
    assert 0.9 * 3000 <= report.file_bytes <= 3000


def test_a_file_is_written_whole_and_the_report_names_it(tmp_path: Path) -> None:
    path = tmp_path / "sheet.pdeanim"
    report = encode_to_size(SHEET, 1500, path, effort=1)
    assert (report.path, report.data) == (path, None)
    assert path.stat().st_size == report.file_bytes
    assert path.read_bytes() == encode_to_size(SHEET, 1500, effort=1).data
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize(
    "control",
    [lambda *a, **k: encode_to_size(SHEET, 1500, *a, **k), lambda *a, **k: encode_to_rms(SHEET, 1e-3, *a, **k)],
)
def test_an_existing_file_is_refused_before_anything_is_encoded(
    tmp_path: Path, control: Callable[..., EncodeReport], monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "sheet.pdeanim"
    path.write_bytes(b"kept")
    monkeypatch.setattr("pdecodec.ratecontrol.encode", None)
    with pytest.raises(InputError, match="exists already"):
        control(path)
    assert path.read_bytes() == b"kept"


def test_a_size_too_small_names_the_smallest_reached_and_writes_nothing(tmp_path: Path) -> None:
    smallest = encode(SHEET, tolerance=COARSEST, effort=1).file_bytes
    with pytest.raises(SettingsError, match=rf"file of 50 bytes: the smallest takes {smallest}; allow as many"):
        encode_to_size(SHEET, 50, tmp_path / "sheet.pdeanim", effort=1)
    assert not list(tmp_path.iterdir())


def test_an_error_too_small_names_the_smallest_reached() -> None:
    with pytest.raises(SettingsError, match=r"rms error of 1e-12 of the diagonal: the smallest is \d[.e\d-]+; allow"):
        encode_to_rms(SHEET, 1e-12, effort=1)


@pytest.mark.parametrize("size", [0, -1, 1.5, math.nan, "1500", None])
def test_sizes_that_are_no_byte_counts_are_refused(size: Any) -> None:
    with pytest.raises(SettingsError, match="size must be a positive whole number of bytes"):
        encode_to_size(SHEET, size)


@pytest.mark.parametrize("rms", [0, -1e-3, math.inf, math.nan, "small", None])
def test_mean_errors_that_are_none_are_refused(rms: Any) -> None:
    with pytest.raises(SettingsError, match="rms must be a positive number"):
        encode_to_rms(SHEET, rms)


@pytest.mark.parametrize("bound", [{"tolerance": 1e-3}, {"max_error": 0.1}])
def test_a_bound_beside_a_size_or_a_mean_error_is_refused(bound: dict[str, float]) -> None:
    with pytest.raises(SettingsError, match="give one of"):
        encode_to_size(SHEET, 1500, **bound)
    with pytest.raises(SettingsError, match="give one of"):
        encode_to_rms(SHEET, 1e-3, settings=EncodeSettings(**bound))


def test_unknown_options_are_refused_as_encode_refuses_them() -> None:
    with pytest.raises(SettingsError, match="no setting named quality"):
        encode_to_size(SHEET, 1500, quality=3)


def test_progress_says_which_encode_it_is() -> None:
    said: list[str] = []
    encode_to_size(SHEET, 1500, effort=1, progress=lambda done, total, what: said.append(what))
    attempts = sorted({int(what.removeprefix("encoding, attempt ")) for what in said})
    assert attempts == list(range(1, len(attempts) + 1))
    assert 2 <= len(attempts) <= MOST_ENCODES
