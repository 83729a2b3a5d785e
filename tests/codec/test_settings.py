"""Settings of an encode: they are checked, and JSON restores them."""

from __future__ import annotations

import json
from fractions import Fraction
from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import pdecodec
from pdecodec import ArraySequence, EncodeSettings, PaperSettings, SettingsError, encode
from pdecodec.codec.sections.closed_form import MAX_RATE
from pdecodec.codec.settings import DEFAULT_TOLERANCE, MAX_SEGMENT_FRAMES, EffortName, EncodeOptions

RATES = st.none() | st.floats(1e-300, MAX_RATE)
PAPER = st.builds(
    PaperSettings,
    segment_frames=st.integers(2, MAX_SEGMENT_FRAMES),
    piece_points=st.none() | st.integers(2, 10**6),
    alpha=RATES,
    r=RATES,
)
POSITIVE = st.floats(1e-300, 1e300)


@settings(max_examples=60)
@given(
    st.just({}) | st.builds(lambda paper: {"profile": "paper", "paper": paper}, PAPER),
    st.just({}) | st.builds(lambda x: {"tolerance": x}, POSITIVE) | st.builds(lambda x: {"max_error": x}, POSITIVE),
    st.sampled_from(get_args(EffortName)),
)
def test_settings_and_what_was_changed_come_back_equal_from_json(
    profile: dict[str, Any], bound: dict[str, float], effort: Any
) -> None:
    wanted = EncodeSettings(**profile, **bound, effort=effort)
    for values in (wanted.to_json(), wanted.changed()):
        assert EncodeSettings.from_json(json.loads(json.dumps(values))) == wanted


def test_editors_complete_every_setting() -> None:
    assert get_type_hints(EncodeOptions) == get_type_hints(EncodeSettings)


def test_numbers_of_other_libraries_become_pythons_own_and_are_recorded() -> None:
    given = {
        "tolerance": np.float32(0.01),
        "uv_tolerance": Fraction(1, 3),
        "group_frames": np.int64(8),
        "max_memory": np.uint32(2**30),
        "why": np.bool_(False),
    }
    wanted = {"tolerance": float(np.float32(0.01)), "uv_tolerance": 1 / 3, "group_frames": 8, "max_memory": 2**30}
    found = EncodeSettings(**given)
    assert found == EncodeSettings(**wanted)
    assert {type(value) for value in found.to_json().values()} == {float, int, bool, str, dict, type(None)}
    report = encode(ArraySequence(np.zeros((3, 4, 3))), settings=found)
    with pdecodec.open(report.data or b"") as animation:
        assert animation.info()["settings"] == wanted
    paper = PaperSettings(segment_frames=np.int16(5), piece_points=np.int64(9), alpha=np.float64(2), r=Fraction(3, 2))
    assert json.loads(json.dumps(EncodeSettings(profile="paper", paper=paper).changed()))["paper"] == {
        "segment_frames": 5,
        "piece_points": 9,
        "alpha": 2.0,
        "r": 1.5,
    }


def test_changed_settings_leave_out_defaults() -> None:
    assert EncodeSettings(tolerance=1e-4, effort="best").changed() == {"tolerance": 1e-4, "effort": "best"}
    assert EncodeSettings().changed() == {}


def test_names_of_later_versions_are_passed_over() -> None:
    values = EncodeSettings(effort="best").to_json()
    later = {**values, "colour": "blue", "paper": {**values["paper"], "beta": 3.0}}
    assert EncodeSettings.from_json(later) == EncodeSettings(effort="best")


@pytest.mark.parametrize(
    ("chosen", "bound"),
    [
        ({}, DEFAULT_TOLERANCE * 8),
        ({"tolerance": 0.25}, 2.0),
        ({"max_error": 0.25}, 0.25),
        ({"profile": "paper"}, None),
        ({"profile": "paper", "tolerance": 0.5}, 4.0),
        ({"profile": "paper", "max_error": 1e-30}, 1e-30),
    ],
)
def test_the_bound_follows_from_tolerance_profile_and_scale(chosen: dict[str, Any], bound: float | None) -> None:
    assert EncodeSettings(**chosen).bound(8.0) == bound


@pytest.mark.parametrize(
    ("kind", "chosen", "message"),
    [
        (EncodeSettings, {"tolerance": 1e-3, "max_error": 1.0}, "tolerance and max_error exclude each other"),
        (EncodeSettings, {"tolerance": 0.0}, "tolerance must be a positive number, not 0.0"),
        (EncodeSettings, {"tolerance": float("nan")}, "tolerance must be a positive number, not nan"),
        (EncodeSettings, {"tolerance": "small"}, "tolerance must be a number"),
        (EncodeSettings, {"tolerance": 10**400}, "tolerance must be below 2"),
        (EncodeSettings, {"why": "no"}, "why must be True or False, not 'no'"),
        (EncodeSettings, {"max_error": float("inf")}, "max_error must be a positive number, not inf"),
        (EncodeSettings, {"profile": "best"}, "profile must be one of auto, paper, not 'best'"),
        (EncodeSettings, {"effort": "slow"}, "effort must be one of fast, default, best, not 'slow'"),
        (EncodeSettings, {"effort": 5}, "effort must be one of fast, default, best, not 5"),
        (EncodeSettings, {"order": "any"}, "order must be one of keep, free, not 'any'"),
        (EncodeSettings, {"paper": {"alpha": 1.0}}, "paper must be PaperSettings"),
        (
            EncodeSettings,
            {"paper": PaperSettings(segment_frames=5)},
            "settings of the profile paper; choose that profile",
        ),
        (PaperSettings, {"segment_frames": 1}, "segment_frames must be from 2 to 64, not 1"),
        (PaperSettings, {"segment_frames": 5.0}, "segment_frames must be a whole number"),
        (PaperSettings, {"piece_points": 1}, "piece_points must be at least 2, not 1"),
        (PaperSettings, {"alpha": 0.0}, "alpha must be above 0 and at most 12"),
        (PaperSettings, {"r": 12.1}, "r must be above 0 and at most 12"),
        (PaperSettings, {"r": float("nan")}, "r must be above 0 and at most 12, not nan"),
    ],
)
def test_settings_out_of_range_are_named(kind: type[Any], chosen: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        kind(**chosen)
    assert "\n" not in str(caught.value)


def test_an_unknown_option_is_refused_with_a_list_of_settings() -> None:
    with pytest.raises(SettingsError, match="there are effort, field_tolerance, fields, group_frames, max_error"):
        encode(ArraySequence([[[0, 0, 0]]]), quality=3)
