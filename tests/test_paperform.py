"""Coefficients in the file are the paper's: converted, they give the decoded motion through Eqs. 17 and 18."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_cases import grid

from pdecodec.basis import paper_functions
from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.errors import SettingsError
from pdecodec.sequence import ArraySequence, MeshObject
from pdecodec.settings import EncodeSettings

CURVES, POINTS, FRAMES = 3, 30, 11


def swinging_strip() -> ArraySequence:
    x = np.linspace(0, 2, POINTS)
    times = np.arange(FRAMES) / 24.0
    points = np.zeros((FRAMES, CURVES, POINTS, 3))
    points[..., 0] = x
    points[..., 1] = 0.1 * np.arange(CURVES)[:, None] + 0.2 * np.sin(6 * times)[:, None, None] * np.sin(3 * x)
    points[..., 2] = 0.1 * np.cos(9 * times)[:, None, None] * x**2
    return ArraySequence(points.reshape(FRAMES, -1, 3), objects=[MeshObject("strip", grid(CURVES, POINTS))])


def test_equation_17_with_the_converted_coefficients_gives_the_decoded_positions(tmp_path: Path) -> None:
    path = tmp_path / "strip.pdeanim"
    encode(swinging_strip(), path, EncodeSettings(profile="paper", alignment="none", alpha=3.0, r=4.0))
    with open_animation(path) as animation:
        form = animation.coefficients(0)
        assert form.coefficients.shape == (CURVES, 3, 4, 8)
        assert (form.alpha, form.r) == (3.0, 4.0)
        elements, rest = animation._model.elements, animation._model.rest
        for time in (0.0, 0.1, 0.33):
            decoded = animation.positions(time)[elements.order].astype(np.float64)
            argument = (time - form.time[0]) / form.time[1]
            for e in range(CURVES):
                inside = slice(elements.starts[e], elements.starts[e + 1])
                u = form.parameter[inside]
                functions = paper_functions(u, np.full(u.size, argument), form.alpha, form.r)  # Eq. 18
                displacement = functions @ form.coefficients[e].reshape(3, 32).T  # Eq. 17
                lost = form.condition[e] * 1e-16
                np.testing.assert_allclose(rest[inside] + displacement, decoded[inside], atol=1e-6 + 10 * lost)


def test_conversion_loses_more_digits_the_smaller_alpha_and_r_are(tmp_path: Path) -> None:
    conditions = []
    for rate in (2.0, 1.0, 0.5):
        path = tmp_path / f"{rate}.pdeanim"
        encode(swinging_strip(), path, EncodeSettings(profile="paper", alignment="none", alpha=rate, r=rate))
        with open_animation(path) as animation:
            conditions.append(animation.coefficients(0).condition.max())
    assert conditions[0] < conditions[1] / 10 < conditions[2] / 100


@pytest.mark.parametrize(
    ("settings", "reason"),
    [
        ({"profile": "segments", "alignment": "affine", "alpha": 3.0, "r": 3.0, "tolerance": 1e-2}, "affine"),
        ({"alignment": "none", "alpha": 0.0, "r": 3.0}, "alpha or r of 0"),
        ({"alignment": "none", "alpha": 3.0, "r": 0.0}, "alpha or r of 0"),
        ({"alignment": "none", "alpha": 3.0, "r": 3.0, "segment_frames": 3}, "4 frames"),
        ({"alignment": "none", "alpha": 3.0, "r": 3.0, "piece_points": 6}, "8 points"),
    ],
)
def test_files_without_the_papers_32_functions_are_told_apart(
    tmp_path: Path, settings: dict[str, object], reason: str
) -> None:
    path = tmp_path / "strip.pdeanim"
    encode(swinging_strip(), path, EncodeSettings(**{"profile": "paper", **settings}))  # type: ignore[arg-type]
    with open_animation(path) as animation, pytest.raises(SettingsError, match=reason):
        animation.coefficients(0)


def test_a_segment_that_is_not_there_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "strip.pdeanim"
    encode(swinging_strip(), path, EncodeSettings(profile="paper"))
    with open_animation(path) as animation, pytest.raises(IndexError):
        animation.coefficients(1)


@pytest.mark.parametrize("bound", [{}, {"tolerance": 1e-3}, {"max_error": 2e-3}])
def test_every_segment_of_a_paper_file_converts_with_a_bound_or_without(
    tmp_path: Path, bound: dict[str, float]
) -> None:
    path = tmp_path / "strip.pdeanim"
    long = swinging_strip().points[np.arange(25) % FRAMES]
    clip = ArraySequence(long, objects=swinging_strip().objects)
    report = encode(clip, path, EncodeSettings(profile="paper", **bound))
    with open_animation(path) as animation:
        assert animation.info()["segment_frames"] == [11, 14]  # three frames alone would be too few
        for segment in range(2):
            form = animation.coefficients(segment)
            assert form.coefficients.shape == (CURVES, 3, 4, 8)
            assert form.alpha > 0
            assert form.r > 0
    if report.bound is not None:
        assert report.max_error <= report.bound


def test_the_papers_profile_with_affine_functions_is_a_contradiction() -> None:
    with pytest.raises(SettingsError, match="affine"):
        EncodeSettings(profile="paper", alignment="affine")
