"""Profile paper: closed form in time, curves in space, and its coefficients as the paper writes them."""

from __future__ import annotations

import csv
from pathlib import Path

import numpy as np
import pytest

from pdecodec import ArraySequence, Connectivity, EncodeSettings, MeshObject, PaperSettings, encode, open_animation
from pdecodec.cli.main import run
from pdecodec.codec.paper_form import PaperForm
from pdecodec.codec.sections.closed_form import paper_space_functions, paper_time_functions
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array
from spec.accepted import LINES, clip, connectivity, grid, several_objects, sheet, triangles, tube, wave


def eq_18(form: PaperForm) -> Float64Array:
    """Return positions, (frames, vertices, 3), by Eq. 18 from the coefficients that the public function returns."""
    time = paper_time_functions((form.times - form.centre) / form.half_length, form.alpha)
    space = paper_space_functions(form.u, form.r)
    piece = np.repeat(np.arange(len(form.starts) - 1), np.diff(form.starts))
    along = form.reference + np.einsum("ta,vxab,vb->tvx", time, form.coefficients[piece], space)
    points = np.empty_like(along)
    points[:, form.order] = along
    return points


def decoded(data: bytes) -> tuple[Float32Array, list[PaperForm]]:
    with open_animation(data) as animation:
        forms = [animation.coefficients(group) for group in range(animation.info()["groups"])]
        return animation.read_frames(0, animation.frame_count), forms


def encoded(sequence: ArraySequence, **paper: float) -> bytes:
    data = encode(sequence, profile="paper", paper=PaperSettings(**paper)).data
    assert data is not None
    return data


CLIPS = {
    "tube": lambda: clip(tube(23, 5, 20), grid(5, 20, closed=True)),
    "triangles": lambda: clip(wave(8, 5, 6), triangles(5, 6)),
    "short_lines": lambda: clip(wave(8, 3, 7), connectivity(21, lines=LINES)),
    "several_objects": several_objects,
    "static": lambda: clip(wave(1, 5, 6).repeat(6, axis=0), grid(5, 6)),
    "two_frames": lambda: sheet(2),
    "one_frame": lambda: sheet(1),
}


@pytest.mark.parametrize("name", CLIPS)
def test_eq_18_of_the_coefficients_gives_the_decoded_positions_back(name: str) -> None:
    points, forms = decoded(encoded(CLIPS[name]()))
    again = np.concatenate([eq_18(form) for form in forms])
    digits_lost = max(form.condition.max() for form in forms) * np.finfo(np.float64).eps
    scale = np.abs(points).max()
    np.testing.assert_allclose(again, points, atol=scale * (1e-6 + 10.0 * digits_lost))


def test_motion_made_of_the_papers_functions_is_kept_to_the_digits_of_float32() -> None:
    u, t = np.linspace(-1, 1, 40), np.linspace(-1, 1, 11)
    swing = np.sin(2.5 * (t + 1))  # a function of Eq. 12 that is zero at frame 0
    moved = 1e-2 * swing[:, None] * paper_space_functions(u, 3.0).sum(axis=1)
    points = np.zeros((11, 40, 3))
    points[:, :, 0] = u
    points[:, :, 1] = moved
    line = Connectivity(40, line_counts=np.array([40]), line_indices=np.arange(40))
    sequence = ArraySequence(points, objects=[MeshObject("curve", line)])
    report = encode(sequence, profile="paper", paper=PaperSettings(alpha=2.5, r=3.0))
    assert report.max_error < 1e-4 * report.scale
    assert report.groups == 1
    assert report.functions_of_space == 8


def test_a_curve_has_32_coefficients_for_each_axis_and_segment() -> None:
    _, forms = decoded(encoded(CLIPS["tube"](), segment_frames=8))
    assert [form.coefficients.shape for form in forms] == [(5, 3, 4, 8)] * 3
    assert [form.first_frame for form in forms] == [0, 8, 16]


def test_curves_are_cut_into_pieces_of_the_length_that_is_set() -> None:
    _, forms = decoded(encoded(CLIPS["tube"](), piece_points=10))
    assert np.diff(forms[0].starts).tolist() == [10] * 10


def test_a_bound_holds_under_the_papers_profile_too() -> None:
    sequence = CLIPS["tube"]()
    report = encode(sequence, profile="paper", tolerance=1e-3)
    assert report.data is not None
    assert report.bound is not None
    points, _ = decoded(report.data)
    assert np.sqrt(((points.astype(np.float64) - sequence.points) ** 2).sum(axis=2)).max() <= report.bound


def test_velocities_are_continuous_between_groups() -> None:
    with open_animation(encoded(CLIPS["tube"](), segment_frames=6)) as animation:
        for joint in (5, 6):
            at = animation.times[joint]

            before, after = animation.velocities([at - 1e-9, at + 1e-9])
            np.testing.assert_allclose(before, after, rtol=1e-3, atol=1e-3)


def test_coefficients_of_another_profile_are_refused() -> None:
    data = encode(CLIPS["tube"]()).data
    assert data is not None
    with open_animation(data) as animation, pytest.raises(SettingsError, match="profile paper"):
        animation.coefficients(0)


def test_a_group_that_is_not_there_and_rates_too_small_to_convert_are_named() -> None:
    with open_animation(encoded(CLIPS["two_frames"]())) as animation, pytest.raises(SettingsError, match="no group 1"):
        animation.coefficients(1)
    with (
        open_animation(encoded(CLIPS["tube"](), r=1e-300)) as animation,
        pytest.raises(SettingsError, match="dependent"),
    ):
        animation.coefficients(0)


def test_the_command_writes_what_the_function_returns(tmp_path: Path) -> None:
    source = tmp_path / "tube.pdeanim"
    encode(CLIPS["tube"](), source, EncodeSettings(profile="paper"))
    assert run(["coefficients", str(source), "-o", str(tmp_path / "c.npz")]) == 0
    assert run(["coefficients", str(source), "-o", str(tmp_path / "c.csv")]) == 0
    _, forms = decoded(source.read_bytes())
    with np.load(tmp_path / "c.npz") as found:
        np.testing.assert_array_equal(found["coefficients"][1], forms[1].coefficients)
        np.testing.assert_array_equal(found["order"], forms[0].order)
    with (tmp_path / "c.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    assert len(rows) == len(forms) * 5 * 3
    assert float(rows[4]["c_w32"]) == forms[0].coefficients[1, 1, 3, 7]


def test_the_command_refuses_other_files_in_one_line(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "sheet.pdeanim"
    encode(sheet(4), source)
    assert run(["coefficients", str(source), "-o", str(tmp_path / "c.npz")]) == 2
    assert "profile paper" in capsys.readouterr().err
    assert not (tmp_path / "c.npz").exists()
