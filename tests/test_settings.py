"""Settings of an encode: checked, and the same after a journey through JSON."""

from __future__ import annotations

import dataclasses
import json
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.basis import MAX_RATE
from pdecodec.errors import SettingsError
from pdecodec.settings import DEFAULT_TOLERANCE, MAX_EFFORT, MAX_SEGMENT_FRAMES, EncodeSettings

POSITIVE = st.floats(1e-300, 1e300)


@settings(max_examples=60, deadline=None)
@given(
    st.fixed_dictionaries(
        {},
        optional={
            "profile": st.sampled_from(["segments", "paper"]),
            "alignment": st.sampled_from(["auto", "none", "rotation"]),
            "segment_frames": st.integers(2, MAX_SEGMENT_FRAMES),
            "piece_points": st.integers(2, 10**6),
            "alpha": st.floats(0, MAX_RATE),
            "r": st.floats(0, MAX_RATE),
            "effort": st.integers(1, MAX_EFFORT),
        },
    ),
    st.one_of(
        st.just({}), st.builds(lambda x: {"tolerance": x}, POSITIVE), st.builds(lambda x: {"max_error": x}, POSITIVE)
    ),
)
def test_settings_come_back_equal_from_json(chosen: dict[str, Any], bound: dict[str, float]) -> None:
    wanted = EncodeSettings(**{"profile": "segments", **chosen}, **bound)
    text = json.dumps(wanted.to_json())
    assert EncodeSettings.from_json(json.loads(text)) == wanted


@settings(max_examples=20, deadline=None)
@given(st.integers(1, MAX_EFFORT), POSITIVE)
def test_settings_of_profile_auto_come_back_equal_from_json(effort: int, tolerance: float) -> None:
    wanted = EncodeSettings(effort=effort, tolerance=tolerance)
    assert wanted.profile == "auto"
    assert EncodeSettings.from_json(json.loads(json.dumps(wanted.to_json()))) == wanted


def test_names_of_later_versions_are_passed_over() -> None:
    values = {**EncodeSettings(effort=7).to_json(), "colour": "blue"}
    assert EncodeSettings.from_json(values) == EncodeSettings(effort=7)


def test_settings_do_not_change() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        EncodeSettings().effort = 3  # type: ignore[misc]


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
    ("chosen", "message"),
    [
        ({"tolerance": 1e-3, "max_error": 1.0}, "not both"),
        ({"tolerance": 0.0}, "tolerance must be a positive number, not 0.0"),
        ({"tolerance": -1.0}, "tolerance must be a positive number"),
        ({"tolerance": float("nan")}, "tolerance must be a positive number, not nan"),
        ({"max_error": float("inf")}, "max_error must be a positive number, not inf"),
        ({"max_error": 0}, "max_error must be a positive number"),
        ({"profile": "best"}, "profile must be one of auto, segments, paper, not 'best'"),
        ({"alignment": "shear"}, "alignment must be one of auto, none, affine, rotation"),
        ({"segment_frames": 1}, "segment_frames must be from 2 to 64, not 1"),
        ({"segment_frames": 65}, "segment_frames must be from 2 to 64"),
        ({"piece_points": 1}, "piece_points must be at least 2, not 1"),
        ({"alpha": -0.1}, "alpha must be from 0 to 12"),
        ({"alpha": 12.1}, "alpha must be from 0 to 12"),
        ({"alpha": float("nan")}, "alpha must be from 0 to 12, not nan"),
        ({"r": -1e-9}, "r must be from 0 to 12"),
        ({"r": float("inf")}, "r must be from 0 to 12"),
        ({"effort": 0}, "effort must be from 1 to 9"),
        ({"effort": 10}, "effort must be from 1 to 9"),
        ({"segment_frames": 5}, "segment_frames is a setting of the profiles segments and paper"),
        ({"piece_points": 5}, "piece_points is a setting of the profiles segments and paper"),
        ({"alpha": 0.0}, "alpha is a setting of the profiles segments and paper"),
        ({"r": 0.0}, "r is a setting of the profiles segments and paper"),
        ({"alignment": "none"}, "alignment is a setting of the profiles segments and paper"),
        ({"profile": "paper", "alignment": "affine"}, "the paper's profile has no affine functions"),
    ],
)
def test_settings_out_of_range_are_named(chosen: dict[str, Any], message: str) -> None:
    with pytest.raises(SettingsError, match=message) as caught:
        EncodeSettings(**chosen)
    assert caught.value.exit_code == 2
    assert "\n" not in str(caught.value)


def test_the_ends_of_every_range_are_allowed() -> None:
    for chosen in (
        {"segment_frames": 2, "piece_points": 2, "alpha": 0.0, "r": 0.0, "effort": 1},
        {"segment_frames": MAX_SEGMENT_FRAMES, "alpha": MAX_RATE, "r": MAX_RATE, "effort": MAX_EFFORT},
    ):
        values = EncodeSettings(profile="segments", **chosen).to_json()
        assert {name: values[name] for name in chosen} == chosen


def test_what_was_changed_brings_the_settings_back() -> None:
    settings = EncodeSettings(tolerance=1e-4, effort=9)
    assert settings.changed() == {"tolerance": 1e-4, "effort": 9}
    assert EncodeSettings.from_json(settings.changed()) == settings
    assert EncodeSettings().changed() == {}
