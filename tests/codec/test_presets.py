"""Presets: names for a tolerance with an effort, and the search for a tolerance by normals."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pdecodec import (
    ArraySequence,
    Attribute,
    ChangingSequence,
    Connectivity,
    EncodeReport,
    EncodeSettings,
    MeshObject,
    SettingsError,
    encode,
    open_animation,
)
from pdecodec.codec.presets import HERO_CLOSE, PRESETS
from pdecodec.errors import Notice
from pdecodec.formats.base.normals import NORMAL_GROUP
from pdecodec.mesh.surface_metrics import measure_corner_normals
from tests.support.mesh_cases import grid

SIDE, EDGE = 16, 0.02


def waving_sheet(frames: int = 4, rows: int = SIDE) -> ArraySequence:
    """Return a small wavy sheet and a point so far away that 0.001 of the diagonal is a tenth of an edge."""
    x, y = np.meshgrid(EDGE * np.arange(SIDE), EDGE * np.arange(rows))
    points = np.stack([np.stack([x, y, 0.02 * np.sin(20 * x + 9 * y + 0.4 * t)], axis=-1) for t in range(frames)])
    points += 1e-3 * np.random.default_rng(1).standard_normal(points.shape)
    sheet = MeshObject("sheet", grid(rows, SIDE))
    far = np.full((frames, 1, 3), (2.0, 0.0, 0.0))
    times = (np.arange(frames) + 100 * (rows < SIDE)) / 24
    objects = [sheet, MeshObject("far", Connectivity(1))]
    return ArraySequence(np.concatenate([points.reshape(frames, -1, 3), far], axis=1), objects=objects, times=times)


SHEET = waving_sheet()


def recorded(report: EncodeReport) -> dict[str, Any]:
    with open_animation(report.data or b"") as animation:
        found: dict[str, Any] = animation.info()["settings"]
    return found


@pytest.mark.parametrize("name", ["preview", "default", "archive"])
def test_a_preset_gives_the_file_of_its_tolerance_and_effort(name: Any) -> None:
    preset = PRESETS[name]
    report = encode(SHEET, preset=name)
    assert report.preset == name
    assert report.data == encode(SHEET, tolerance=preset.tolerance, effort=preset.effort).data


def test_an_effort_that_is_given_wins_over_that_of_the_preset() -> None:
    for given in ({"effort": "fast"}, {"settings": EncodeSettings(effort="fast")}):
        assert recorded(encode(SHEET, preset="archive", **given)) == {"tolerance": 1e-5, "effort": "fast"}
    assert recorded(encode(SHEET, preset="preview", effort="default")) == {"tolerance": 5e-3}


@pytest.mark.parametrize("order", ["keep", "free"])
def test_hero_finds_the_tolerance_that_keeps_the_normals_of_the_decoded_bytes(order: Any) -> None:
    report = encode(SHEET, preset="hero", effort="fast", order=order)
    assert report.normal_p99 is not None
    assert (1 - 3 * HERO_CLOSE) * 2.0 < report.normal_p99 <= 2.0
    assert report.data is not None
    if order == "keep":
        with open_animation(report.data) as animation:
            assert measure_corner_normals(SHEET, animation) == report.normal_p99
    tolerance = recorded(report)["tolerance"]
    assert tolerance < 1e-3
    assert encode(SHEET, tolerance=tolerance, effort="fast", order=order).data == report.data


def test_hero_is_never_coarser_than_usual() -> None:
    flat = ArraySequence(SHEET.points * np.array([1, 1, 0], np.float32), objects=SHEET.objects)
    assert recorded(encode(flat, preset="hero")) == {"tolerance": 1e-3}


def test_hero_measures_all_runs_of_faces() -> None:
    runs = ChangingSequence([waving_sheet(2), waving_sheet(3, rows=9)])
    report = encode(runs, preset="hero", effort="fast")
    assert report.normal_p99 is not None
    assert report.data is not None
    assert report.normal_p99 <= 2.0
    with open_animation(report.data) as animation:
        each = [measure_corner_normals(source, own) for source, own in zip(runs.runs, animation.runs, strict=True)]
    assert min(each) < report.normal_p99 < max(each)  # type: ignore[type-var]


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"tolerance": 1e-3}, "preset and tolerance exclude each other"),
        ({"settings": EncodeSettings(max_error=1.0)}, "preset and max_error exclude each other"),
        ({"rms": 1e-3}, "preset and rms exclude each other"),
        ({"size": 100}, "preset and size exclude each other"),
        ({"preset": "final"}, "preset must be one of preview, default, hero, archive, not 'final'"),
        ({"profile": "paper"}, "preset is a setting of the profile auto, not of paper"),
        ({"sequence": SHEET.points}, "this clip has no faces; give a tolerance instead"),
    ],
)
def test_settings_that_exclude_a_preset_are_named(options: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingsError, match=words):
        encode(**{"sequence": SHEET, "preset": "hero", **options})


@pytest.mark.parametrize(("is_hard", "angle"), [(True, 0.0), (False, np.degrees(np.arctan(3.0)) - 45.0)])
def test_corners_are_compared_by_the_normals_that_they_share(is_hard: bool, angle: float) -> None:
    """A square tube is stretched to three times its width: only smooth normals turn, towards the larger faces."""
    square = np.array([[x, y, z] for z in (0, 1) for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))], np.float32)
    quads = np.array([[k, (k + 1) % 4, 4 + (k + 1) % 4, 4 + k] for k in range(4)], np.int32)
    groups = Attribute(NORMAL_GROUP, "corner", np.tile(np.array([0, 1, 1, 0], np.int32), 4))
    tube = MeshObject("tube", Connectivity(8, np.full(4, 4), quads.ravel()), (groups,) if is_hard else ())
    first, second = (
        ArraySequence(square[None] * np.array([width, 1, 1], np.float32), objects=[tube], times=[0.0])
        for width in (1, 3)
    )
    assert measure_corner_normals(first, second) == pytest.approx(angle, rel=0.007)


def test_a_bound_above_half_a_median_edge_is_noted_with_the_preset_that_helps() -> None:
    rough, fine = (encode(SHEET, max_error=share * EDGE, effort="fast") for share in (0.7, 0.4))
    assert rough.median_edge == pytest.approx(EDGE, rel=0.3)
    [line] = rough.warnings
    assert isinstance(line, Notice)
    assert (line.setting, line.value) == ("preset", "hero")
    assert "the surface will look rough: the bound is 0." in line
    assert not fine.warnings
    assert encode(SHEET.points, max_error=EDGE).median_edge is None
