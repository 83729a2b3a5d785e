"""Reports: measurements are made on decoded bytes, kept, compared and drawn; and clips of every kind get a report."""

from __future__ import annotations

import csv
import importlib.util
import json
import os
import re
import shutil
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from click.testing import CliRunner, Result

from pdecodec.cli.main import pdecodec, run
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.sections.bytestream import FieldReader
from pdecodec.errors import InputError, MissingExtraError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from pdecodec.report.charts.figure import Table
from pdecodec.report.charts.page import as_markdown
from pdecodec.report.charts.vegalite import for_page, require_drawing
from pdecodec.report.clips.between import (
    INTERPOLATIONS,
    PDECODEC,
    cubic_spline,
    measure_between,
    nearest_frame,
    straight_lines,
)
from pdecodec.report.clips.comparison import compare_measurements, comparison_text, read_measurements, too_large
from pdecodec.report.clips.errors import measure_field
from pdecodec.report.clips.fields import FIELD_TOLERANCES, FieldPoint, fields_table, measure_fields
from pdecodec.report.clips.making import find_clips
from pdecodec.report.clips.measurement import KeptMeasurements, Measurement, best_baseline, clip_digest, measurement_key
from pdecodec.report.clips.measuring import ReportPlan, measure_clip, measure_profile
from pdecodec.report.clips.pages import merit_table
from pdecodec.report.clips.ratesearch import RateCurve
from pdecodec.report.clips.recommendation import recommend
from pdecodec.research import baselines
from pdecodec.research.baselines.packages import DracoWithFaces
from pdecodec.research.baselines.quantised import QuantiseDelta, RawFloat16, RawFloat32
from tests.support.driven_browser import browsing
from tests.support.mesh_cases import connectivity_of, grid

BASELINES = (RawFloat32(), RawFloat16(), QuantiseDelta())

PLAN = ReportPlan(tolerances=(1e-2, 1e-3), profiles=("auto",), baselines=BASELINES, effort="fast", jobs=1)

POINT = Measurement(
    clip="a",
    coder="auto",
    kind="profile",
    tolerance=1e-3,
    frames=10,
    vertices=20,
    size=100,
    constant_size=20,
    max_error=9e-4,
    rms_error=3e-4,
    p99_error=8e-4,
    within=1.0,
    kg_error=0.1,
    encode_seconds=2.0,
    decode_seconds=0.5,
    copy_seconds=0.01,
    random_seconds=1e-3,
)


def wave_sequence(frames: int = 12, seed_height: float = 0.1) -> ArraySequence:
    u, times = np.linspace(0, 1, 20), np.arange(frames) / 24.0
    points = np.zeros((frames, 4, 20, 3))
    points[..., 0] = u
    points[..., 1] = 0.2 * np.arange(4)[:, None]
    points[..., 2] = seed_height * np.sin(5 * u - 6 * times[:, None])[:, None]
    return ArraySequence(points.reshape(frames, -1, 3), objects=[MeshObject("sheet", grid(4, 20))], times=times)


def baseline(name: str, size: int | None, **values: Any) -> Measurement:
    return replace(POINT, coder=name, kind="baseline", size=size, refusal=None if size else "too coarse", **values)


def test_derived_figures_of_a_measurement_follow_their_definitions() -> None:
    assert POINT.reached
    assert POINT.raw_size == 2400
    assert POINT.bpvf == 8 * 100 / 200
    assert POINT.ratio == 2400 / 120
    assert POINT.encode_rate == pytest.approx(0.0012)
    assert POINT.decode_rate == pytest.approx(0.0048)
    assert POINT.decode_multiple == pytest.approx(50)
    refused = baseline("p", None, max_error=None, encode_seconds=None, decode_seconds=None)
    assert not refused.reached
    assert (refused.bpvf, refused.ratio, refused.encode_rate, refused.decode_multiple) == (None,) * 4
    assert not replace(POINT, max_error=1.1e-3).reached


def test_the_best_baseline_is_the_smallest_that_keeps_the_bound() -> None:
    points = [
        POINT,
        baseline("coarse", None),
        baseline("plain", 500),
        baseline("better", 400, published=False),
        baseline("off", 1, max_error=1),
    ]
    found = [best_baseline(points, 1e-3, published=published) for published in (False, True)]
    assert [point and point.coder for point in found] == ["better", "plain"]
    assert best_baseline(points[:2], 1e-3) is None


def test_a_profile_is_measured_on_what_its_bytes_decode_to() -> None:
    sequence = wave_sequence()
    point = measure_profile("wave", sequence, profile="auto", tolerance=2e-3, effort="fast")
    written = encode(sequence, tolerance=2e-3, effort="fast")
    constant = written.sections["CONN"] + written.sections.get("ORDR", 0)
    assert (point.clip, point.frames, point.vertices) == ("wave", 12, 80)
    assert (point.size, point.constant_size) == (written.file_bytes - constant, constant)
    assert point.max_error == pytest.approx(written.max_error / written.scale)
    assert 0 < (point.rms_error or 0) < (point.p99_error or 0) <= (point.max_error or 0) <= 2e-3
    assert point.within == 1.0
    assert (point.coefficients or 0) > 0
    assert sum(point.sections.values()) == written.file_bytes


def test_every_coder_has_a_measurement_at_every_tolerance_and_baselines_keep_the_bound(tmp_path: Path) -> None:
    points = measure_clip("wave", wave_sequence(), PLAN, KeptMeasurements(tmp_path / "measurements.json"))
    assert [(point.coder, point.tolerance) for point in points] == [
        (coder, tolerance) for coder in ("auto", *(item.name for item in BASELINES)) for tolerance in (1e-2, 1e-3)
    ]
    assert all(point.reached for point in points)
    assert len({point.constant_size for point in points}) == 1


def test_measurements_are_measured_once_and_then_kept(tmp_path: Path) -> None:
    path, counts, found = tmp_path / "measurements.json", [], []
    for fresh in (False, False, True):
        kept = KeptMeasurements(path, fresh=fresh)
        found.append(measure_clip("wave", wave_sequence(), PLAN, kept))
        counts.append((kept.measured, kept.kept))
    assert counts == [(8, 0), (0, 8), (8, 0)]
    assert found[0] == found[1]
    assert [point.size for point in found[0]] == [point.size for point in found[2]]


def test_baselines_in_parallel_find_what_they_find_alone(tmp_path: Path) -> None:
    alone = measure_clip("wave", wave_sequence(), PLAN, KeptMeasurements(tmp_path / "one.json"))
    other = measure_clip("wave", wave_sequence(), replace(PLAN, jobs=2), KeptMeasurements(tmp_path / "two.json"))
    assert [(point.coder, point.size, point.max_error) for point in alone] == [
        (point.coder, point.size, point.max_error) for point in other
    ]


def test_measurements_of_runs_at_the_same_time_are_all_kept(tmp_path: Path) -> None:
    path = tmp_path / "measurements.json"
    first, second = KeptMeasurements(path), KeptMeasurements(path)
    first.keep(measurement_key("d", "v", 1e-2), POINT)
    second.keep(measurement_key("d", "v", 1e-3), POINT)
    third = KeptMeasurements(path)
    assert [third.find(measurement_key("d", "v", tolerance), "b") for tolerance in (1e-2, 1e-3)] == [
        replace(POINT, clip="b")
    ] * 2


def test_the_digest_sees_positions_times_faces_and_names() -> None:
    clip = wave_sequence()
    others = [
        ArraySequence(clip.points, objects=[MeshObject("sheet", grid(20, 4))], times=clip.times),
        ArraySequence(clip.points, objects=[MeshObject("shirt", grid(4, 20))], times=clip.times),
        ArraySequence(clip.points, objects=clip.objects, times=clip.times + 1),
        ArraySequence(np.nextafter(clip.points, np.float32(9)), objects=clip.objects, times=clip.times),
        wave_sequence(),
    ]
    assert len({clip_digest(item) for item in others}) == 5
    assert clip_digest(others[-1]) == clip_digest(clip)


@pytest.mark.parametrize("content", ["", "[1]", '{"a": 1}', '{"a": {"size": 1}}', "\x00", json.dumps({"a": {}})])
def test_a_file_that_holds_no_measurements_is_refused_by_name(tmp_path: Path, content: str) -> None:
    path = tmp_path / "measurements.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"measurements\.json.*delete it"):
        KeptMeasurements(path)


KNOTS, TIMES = np.array([0.0, 0.5, 0.8, 1.7, 2.0]), np.array([0.1, 0.7, 1.0, 1.9])


def test_the_spline_is_exact_on_cubic_motion_at_uneven_times() -> None:
    def motion(t: np.ndarray) -> np.ndarray:
        return np.stack([t**3 - t, 2 * t**2, 1 + t], axis=-1)[:, None, :]

    found = cubic_spline(KNOTS, motion(KNOTS).astype(np.float32), TIMES)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, motion(TIMES), atol=2e-6)


def test_straight_lines_are_exact_on_constant_speed_and_the_nearest_frame_is_one_of_the_kept() -> None:
    def motion(t: np.ndarray) -> np.ndarray:
        return np.stack([t, 2 * t, 1 + t], axis=-1)[:, None, :].astype(np.float32)

    np.testing.assert_allclose(straight_lines(KNOTS, motion(KNOTS), TIMES), motion(TIMES), atol=1e-6)
    found = nearest_frame(KNOTS, motion(KNOTS), TIMES)
    assert np.array_equal(found, motion(np.array([0.0, 0.8, 0.8, 2.0])))
    assert np.array_equal(nearest_frame(KNOTS, motion(KNOTS), np.array([0.25])), motion(KNOTS[:1]))


def test_between_frames_every_way_is_measured_at_the_frames_left_out() -> None:
    rows = list(measure_between("wave", wave_sequence(13), effort="fast"))
    assert [(row.stride, row.way) for row in rows] == [
        (stride, way) for stride in (2, 4) for way in (PDECODEC, *INTERPOLATIONS)
    ]
    assert [row.frames for row in rows] == [6] * 4 + [9] * 4
    assert all(0 < row.rms_error <= row.max_error for row in rows)
    by_way = {row.way: row.rms_error for row in rows if row.stride == 2}
    assert by_way[PDECODEC] < by_way["straight lines"] < by_way["nearest frame (Alembic's default)"]


def test_the_error_field_names_the_worst_frame_and_vertex() -> None:
    sequence = wave_sequence()
    field = measure_field(sequence, tolerance=2e-3, effort="fast")
    found = field.distortion
    assert field.maximum_by_frame.argmax() == found.worst_frame
    assert field.maximum_by_vertex.argmax() == field.at_worst_frame.argmax() == found.worst_vertex
    assert field.maximum_by_frame.max() == field.maximum_by_vertex.max() == found.max_error / found.scale
    assert field.average_by_frame.mean() == pytest.approx(found.e_a)


def test_a_missing_drawing_package_is_named_with_its_install_command(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingExtraError, match=r"charts need the package vl_convert; run: pip install 'pdecodec\[re"):
        require_drawing()


def test_a_chart_cannot_end_the_script_that_holds_it() -> None:
    assert "<" not in for_page({"title": "<!--<script></script><script>alert(1)</script>"})


def test_names_are_no_markdown() -> None:
    table = as_markdown(Table(("clip",), (("a|b\n<img src=x> [c](d) *e* _f_ `g` &lt;",),)))
    assert table.splitlines()[2] == r"| a\|b \<img src=x\> \[c\](d) \*e\* \_f\_ \`g\` \&lt; |"


def test_advice_takes_the_smallest_file_whose_bound_is_fine_enough() -> None:
    points = [
        replace(POINT, tolerance=tolerance, size=size, max_error=0.9 * tolerance, coder=coder)
        for coder, factor in (("auto", 1), ("paper", 3))
        for tolerance, size in ((1e-2, 10 * factor), (1e-3, 100 * factor), (3e-4, 300 * factor))
    ]
    points += [baseline("rival", 200), baseline("rival", 150, tolerance=3e-4, max_error=1e-4)]
    background, hero, archive = recommend(points)
    assert background.point is not None
    assert (background.point.coder, background.point.tolerance) == ("auto", 1e-3)
    assert hero.point is not None
    assert hero.point.tolerance == 3e-4
    assert "1.5 times the bytes" in background.text
    assert "but rival takes 0.50 times its bytes" in hero.text
    assert archive.point is None
    assert "run it with tolerance 0.0001" in archive.text


def test_changes_are_judged_by_the_whole_file_and_by_the_bound() -> None:
    old = [POINT, replace(POINT, coder="paper"), baseline("p", 10)]
    new = [
        replace(POINT, size=112),
        replace(POINT, coder="paper", max_error=2e-3),
        baseline("p", 100),
        replace(POINT, clip="b"),
    ]
    changes = compare_measurements(old, new)
    assert [(change.verdict, change.growth) for change in changes[:2]] == [
        ("larger", pytest.approx(0.1)),
        ("no change", 0),
    ]
    assert [change.new.coder for change in too_large(changes, 0.05)] == ["auto", "paper"]
    assert [change.new.coder for change in too_large(changes, 0.2)] == ["paper"]
    assert "1 larger, 1 no change. Most grew a under pdecodec auto at 0.001, by 10 %." in comparison_text(changes)
    assert "no point in common" in comparison_text([])


@pytest.mark.parametrize(
    "content", ["", "[]", "{}", '{"points": 3}', '{"points": [1]}', '{"points": [{}]}', "[" * 9999]
)
def test_a_file_that_is_not_an_earlier_report_is_refused_by_name(tmp_path: Path, content: str) -> None:
    path = tmp_path / "old.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r"old\.json"):
        read_measurements(path)
    with pytest.raises(InputError, match=r"none\.json: cannot be read"):
        read_measurements(tmp_path / "none.json")


def fields_clip() -> ArraySequence:
    clip = wave_sequence(8)
    heat = (300 + 20 * np.cos(9 * clip.points[..., :2] + clip.times[:, None, None])).astype(np.float32)
    heat[:, 7, 1], heat[3, 2, 0], heat[0, 1, 0] = np.nan, np.inf, -np.inf
    fields = {"heat": heat, "touches": clip.points[..., 2] < 0.01, "moved": clip.points - clip.points[0], "again": heat}
    return ArraySequence(clip.points, objects=clip.objects, times=clip.times, fields=fields)


def test_fields_are_compared_at_equal_error_on_what_their_bytes_decode_to() -> None:
    clip = fields_clip()
    points = list(measure_fields("wave", clip, BASELINES, tolerance=1e-3, effort="fast"))
    order = [("heat", 1e-3), ("touches", 0), ("moved", 1e-3), ("again", 1e-3)]
    assert [(point.field, point.tolerance) for point in points[:4]] == order
    assert [(point.field, point.tolerance) for point in points[4:]] == [
        (name, 1e-5) for name in ("heat", "moved", "again")
    ]
    heat, touches, moved, again = points[:4]
    for point in points:
        assert list(point.bits) == ["pdecodec", QuantiseDelta.name]  # other baselines take no fields
        assert point.within
        assert point.values == clip.read_field(point.field, 0, 8).size
    written = encode(clip, tolerance=1e-3, effort="fast")
    with open_animation(written.data or b"") as animation:
        values, decoded = clip.read_field("heat", 0, 8), animation.read_field("heat", 0, 8)
    finite = np.isfinite(values)
    extent = float(values[finite].max()) - float(values[finite].min())
    worst = float(np.abs(decoded[finite].astype(np.float64) - values[finite]).max())
    assert heat.errors["pdecodec"] == pytest.approx(worst / (1e-3 * extent))
    share = written.sections["FLDS"] / 4  # of the descriptions
    assert heat.bits["pdecodec"] == 8 * (written.fields[0].bytes + share) / values.size
    assert 0.5 < heat.errors[QuantiseDelta.name] <= 1.0
    assert again.bits == {**heat.bits, "pdecodec": 8 * share / values.size}  # a decoder copies it
    assert [point.field for point in points[:4] if not point.is_stored] == ["again"]
    assert touches.errors == {"pdecodec": 0.0, QuantiseDelta.name: 0.0}
    columns = np.ascontiguousarray(clip.read_field("moved", 0, 8).transpose(0, 2, 1)).reshape(8, -1, 1)
    other = RateCurve(QuantiseDelta(), columns, Connectivity(240)).reach(1e-3 * float(np.ptp(columns)))
    assert moved.bits[QuantiseDelta.name] == 8.0 * other.size / columns.size


def test_bits_of_fields_end_in_geometric_means_over_those_that_every_coder_has() -> None:
    def point(name: str, tolerance: float, ours: float, its: float | None) -> FieldPoint:
        return FieldPoint("a", name, tolerance, 10, {"pdecodec": ours, "p": its}, {"pdecodec": 0.9, "p": 0.5}, ours > 0)

    points = [point("x", 1e-3, 1, 2), point("y", 1e-3, 0, 2), point("z", 1e-3, 1, None), point("flag", 0, 4, 2)]
    table = fields_table(points)
    assert table.column("ours / best other") == [0.5, 0, None, 2, pytest.approx(1), pytest.approx(2)]
    assert table.column("tolerance") == [1e-3, 1e-3, 1e-3, "exact", *FIELD_TOLERANCES]
    assert [row[1] for row in table.rows[-2:]] == ["of 2", "of 1"]
    assert table.column("pdecodec")[-2:] == [pytest.approx(2), pytest.approx(4)]
    assert table.column("error / bound")[-1] == 0.9
    assert points[2].ratio is None


def test_the_table_ends_in_medians_and_geometric_means() -> None:
    points = [replace(POINT, clip=clip, size=size) for clip, size in (("a", 100), ("b", 400), ("c", 200))]
    table = merit_table(points, coder="auto", tolerances=[1e-3], means=True)
    assert table.column("clip") == ["a", "b", "c", "median", "geometric mean"]
    assert table.column("bpvf") == [4, 16, 8, 8, pytest.approx(8)]
    other = merit_table([*points, baseline("p", 200)], coder="auto", tolerances=[1e-3], means=True)
    assert other.column("ours / its") == [0.5, None, None, 0.5, 0.5]


def test_clips_are_files_patterns_and_folders_of_frames_each_by_a_name_of_its_own(tmp_path: Path) -> None:
    for name in ("x/a.npz", "y/a.npz", "y/b.h5", "y/frames/f.0001.obj", "y/frames/f.0002.obj", "y/notes.txt", "z/t.md"):
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).touch()
    kinds = ([".npz", ".h5", ".obj"], [".obj"])
    assert find_clips([tmp_path / "x", tmp_path / "y"], *kinds) == {
        "x-a.npz": tmp_path / "x/a.npz",
        "y-a.npz": tmp_path / "y/a.npz",
        "b": tmp_path / "y/b.h5",
        "frames": tmp_path / "y/frames",
    }
    assert find_clips([tmp_path / "y/frames", tmp_path / "q.####.obj"], *kinds) == {
        "frames": tmp_path / "y/frames",
        "q.####": tmp_path / "q.####.obj",
    }
    odd = Path(os.fsdecode(b"a\xff.npz"))
    assert find_clips([odd, odd.with_suffix(".h5")], *kinds) == {
        r"a\udcff.npz": odd,
        r"a\udcff.h5": odd.with_suffix(".h5"),
    }
    with pytest.raises(InputError, match="no mesh sequence in this folder"):
        find_clips([tmp_path / "z"], *kinds)


@pytest.fixture(scope="module")
def three_baselines() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(baselines, "available_baselines", lambda: (BASELINES, ("zfp needs the package zfpy",)))
        yield


def report(source: Path, output: Path, *more: str) -> Result:
    options = ("--tolerance", "1e-2", "--tolerance", "1e-3", "--effort", "fast", "--jobs", "1")
    return CliRunner().invoke(pdecodec, ["report", str(source), "-o", str(output), *options, *more])


@pytest.fixture(scope="module")
def reported(three_baselines: None, tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Result]:
    """Make a folder with wave.npz, and its report in out."""
    folder = tmp_path_factory.mktemp("reported")
    write_sequence(fields_clip(), folder / "wave.npz")
    return folder, report(folder / "wave.npz", folder / "out")


def test_a_report_has_its_page_charts_figures_and_summary(reported: tuple[Path, Result]) -> None:
    folder, result = reported
    assert result.exit_code == 0
    assert result.stdout == (folder / "out" / "summary.md").read_text()
    assert "- Hero (no vertex off by more than a pixel" in result.stdout
    assert "note: zfp needs the package zfpy" in result.stderr
    assert "12 points measured, 0 kept" in result.stderr  # ten points, and two other efforts
    out = folder / "out"
    page = (out / "index.html").read_text()
    record = json.loads((out / "report.json").read_text())
    charts = re.findall(r'<div class="chart" id="(.*?)-chart">', page)
    assert len(charts) >= 8
    for name in charts:
        assert (out / f"{name}.svg").read_text().startswith("<svg")
        assert (out / f"{name}.png").read_bytes().startswith(b"\x89PNG")
        assert len((out / f"{name}.csv").read_text().splitlines()) > 1
    assert (out / "error-over-mesh.png").exists()
    assert 'href="errors.html"' in page
    assert '"original"' in (out / "errors.html").read_text()
    assert [(point["coder"], point["tolerance"]) for point in record["points"]][:3] == [
        ("auto", 0.01),
        ("auto", 0.001),
        ("paper", 0.01),
    ]
    with (out / "points.csv").open() as lines:
        assert len(list(csv.DictReader(lines))) == len(record["points"]) == 10
    assert not re.search(r'(?:src|href)="(?:https?:)?//', page)
    assert "| wave | heat | 0.001 |" in result.stdout
    assert [row[1:3] for row in record["figures"]["fields"]["rows"]][:2] == [["heat", 1e-3], ["touches", "exact"]]
    assert "Bits per value" in page
    # Positions are measured without their fields.
    alone = encode(wave_sequence(8), tolerance=1e-2, effort="fast").file_bytes
    assert record["points"][0]["size"] + record["points"][0]["constant_size"] == alone
    with (out / "speed-size.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    assert {row["doing"] for row in rows} == {"encoding", "opening and decoding"}
    assert [row["coder"] for row in rows if row["doing"] == "encoding" and row["coder"].startswith("pdecodec")] == [
        *("pdecodec auto", "pdecodec paper", "pdecodec auto, default", "pdecodec auto, best")
    ]


def test_a_second_report_lists_changes_and_fails_if_files_grew(reported: tuple[Path, Result], tmp_path: Path) -> None:
    source, out = reported[0] / "wave.npz", tmp_path / "out"
    shutil.copytree(reported[0] / "out", out)
    old = json.loads((out / "report.json").read_text())
    old["points"][0]["size"] -= 60
    (tmp_path / "old.json").write_text(json.dumps(old))
    again = ("--profile", "auto", "--compare", str(tmp_path / "old.json"), "--fail-if-larger")
    result = report(source, out, *again, "99%", "--json")
    found = json.loads(result.stdout)
    assert (result.exit_code, found["measured"], found["kept"]) == (0, 0, 10)
    assert [item["field"] for item in found["fields"]] == [
        "heat",
        "touches",
        "moved",
        "again",
        "heat",
        "moved",
        "again",
    ]
    assert [item["verdict"] for item in found["changes"]][:2] == ["larger", "no change"]
    result = report(source, out, *again, "1%")
    assert result.exit_code == 1
    assert "failed: wave, pdecodec auto at 0.01: larger by" in result.stderr
    assert "1 larger, 1 no change" in result.stdout


def test_several_clips_have_a_table_of_all_and_a_page_each(tmp_path: Path) -> None:
    for name, height in (("calm", 0.02), ("rough", 0.3)):
        write_sequence(wave_sequence(6, height), tmp_path / f"{name}.npz")
    encode(ChangingSequence(sheets(2, 4)), tmp_path / "pond.pdeanim")
    result = report(tmp_path, tmp_path / "out", "--no-baselines", "--profile", "auto")
    assert result.exit_code == 0
    rows = [line.split("|")[1].strip() for line in result.stdout.splitlines() if line.startswith("| ")]
    assert rows[:5] == ["clip", "calm", "rough", "median", "geometric mean"]
    page = (tmp_path / "out" / "index.html").read_text()
    titles = {"calm": "how small", "rough": "how small", "pond": "what connectivity that changes costs"}
    for name, title in titles.items():
        assert f'href="{name}/index.html"' in page
        assert f"{name}: {title}" in (tmp_path / "out" / name / "index.html").read_text()
    # Tables of several clips leave out clips whose connectivity changes.
    record = json.loads((tmp_path / "out" / "report.json").read_text())
    assert {point["clip"] for point in record["points"]} == {"calm", "rough"}


def lines_only() -> ArraySequence:
    clip = wave_sequence(6)
    wire = MeshObject("wire", connectivity_of(80, lines=[range(80)]))
    return ArraySequence(clip.points, objects=[wire], times=clip.times)


ODD_CLIPS = {
    "five frames of ten vertices": lambda: ArraySequence(
        np.random.default_rng(0).normal(size=(5, 10, 3)).astype(np.float32), times=np.arange(5) / 24
    ),
    "lines only": lines_only,
    "points only": lambda: ArraySequence(wave_sequence(6).points, times=np.arange(6) / 24),
    "static": lambda: ArraySequence(
        np.repeat(wave_sequence(1).points, 6, axis=0), objects=wave_sequence(1).objects, times=np.arange(6) / 24
    ),
    "one frame": lambda: wave_sequence(1),
    "one vertex that stands still": lambda: ArraySequence(np.ones((6, 1, 3), np.float32), times=np.arange(6) / 24),
}


@pytest.fixture(scope="module")
def odd_reports(three_baselines: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a folder with a report for each of the odd clips."""
    folder = tmp_path_factory.mktemp("odd")
    for kind, make in ODD_CLIPS.items():
        write_sequence(make(), folder / f"{kind}.npz")
    assert report(folder, folder / "out", "--profile", "auto").exit_code == 0
    return folder / "out"


@pytest.mark.parametrize("kind", ODD_CLIPS)
def test_odd_clips_have_a_report_of_points_that_keep_the_bound(kind: str, odd_reports: Path) -> None:
    points = json.loads((odd_reports / kind / "report.json").read_text())["points"]
    assert len(points) == 8
    for point in points:
        assert point["kind"] == "baseline" if point["size"] is None else point["max_error"] <= point["tolerance"]


def test_a_browser_draws_every_chart_of_odd_clips(odd_reports: Path, tmp_path: Path) -> None:
    with browsing(tmp_path / "profile") as browser:
        for kind in ODD_CLIPS:
            browser.open((odd_reports / kind / "index.html").as_uri())
            drawn = browser.run(DRAWN)
            assert len(drawn) >= 3, kind
            assert all(marks > 0 for marks in drawn), kind
            browser.open((odd_reports / kind / "errors.html").as_uri())
            browser.run("await pdeanimView.ready")
            assert browser.errors() == [], kind


DRAWN = """
const places = [...document.querySelectorAll("div.chart")];
for (let left = 600; left > 0 && places.some((place) => place.dataset.drawn !== "yes"); left -= 1) {
  await new Promise((done) => setTimeout(done, 50));
}
const marks = "svg .role-mark path, svg .role-mark text";
return places.map((place) => place.dataset.drawn === "yes" ? place.querySelectorAll(marks).length : 0);
"""
"""Waits until every chart of a page is drawn, and returns how many marks each has."""


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [
        (["none.npz"], 3, "none.npz"),
        (["wave.npz", "--fail-if-larger", "5%"], 2, "--compare"),
        (["wave.npz", "--compare", "none.json"], 3, "none.json"),
        (["wave.npz", "--compare", "wave.npz"], 3, "not the report.json"),
        (["wave.npz", "--fail-if-larger", "much", "--compare", "x"], 2, "such as 5%"),
        (["wave.npz", "--tolerance", "-1"], 2, "tolerance"),
        (["wave.npz", "--jobs", "0"], 2, "jobs"),
        (["empty"], 3, "no mesh sequence in this folder"),
    ],
)
def test_a_report_that_cannot_be_made_fails_with_one_line(
    arguments: list[str],
    code: int,
    said: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sequence(wave_sequence(2), tmp_path / "wave.npz")
    (tmp_path / "empty").mkdir()
    assert run(["report", *arguments, "-o", "out", "--no-baselines", "--effort", "fast"]) == code
    error = capsys.readouterr().err.strip().splitlines()[-1]
    assert said in error
    assert not (tmp_path / "out").exists()


def test_a_report_on_a_missing_clip_names_only_the_clip(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("pdecodec.research.baselines.available_baselines", lambda: ((), ("another method is missing",)))
    write_sequence(wave_sequence(2), tmp_path / "wave.npz")
    none = tmp_path / "none.npz"
    assert run(["report", str(tmp_path / "wave.npz"), str(none), "-o", str(tmp_path / "out")]) == 3
    assert capsys.readouterr().err == f"error: {none}: there is no such file; check the name\n"


def sheets(*heights: int) -> list[ArraySequence]:
    """Return sheets with the given numbers of rows, for one second each."""
    points = wave_sequence().points
    return [
        ArraySequence(points[k : k + 1, : 20 * rows], objects=[MeshObject("sheet", grid(rows, 20))], times=[k])
        for k, rows in enumerate(heights)
    ]


@pytest.mark.usefixtures("three_baselines")
def test_a_clip_whose_connectivity_changes_is_compared_with_draco_frame_by_frame(tmp_path: Path) -> None:
    pytest.importorskip("DracoPy")
    runs = sheets(2, 4, 3)
    encode(ChangingSequence(runs), tmp_path / "pond.pdeanim", tolerance=1e-6)
    result = report(tmp_path / "pond.pdeanim", tmp_path / "out")
    assert result.exit_code == 0
    said = result.stdout
    assert "3 frames in 3 runs of constant connectivity, 180 positions, up to 80 vertices" in said
    with (tmp_path / "out" / "points.csv").open() as lines:
        rows = list(csv.DictReader(lines))
    assert [(row["coder"], row["tolerance"]) for row in rows] == [
        (coder, tolerance)
        for coder in ("pdecodec auto", "pdecodec auto, order free", "Draco a frame")
        for tolerance in ("0.01", "0.001")
    ]
    assert all(0 < float(row["max / bound"]) <= 1 for row in rows)
    with open_sequence(tmp_path / "pond.pdeanim") as clip:
        own = encode(clip, tolerance=0.01, effort="fast")
    assert int(rows[0]["bytes"]) == own.file_bytes
    assert float(rows[0]["bytes a frame"]) == pytest.approx(own.file_bytes / 3)
    assert float(rows[2]["of these faces and order"]) <= float(rows[0]["of these faces and order"])
    assert (tmp_path / "out" / "bytes-a-frame.svg").read_text().startswith("<svg")


@pytest.mark.parametrize("merges", [False, True])
def test_draco_keeps_faces_of_meshes_whose_vertices_it_would_merge(merges: bool) -> None:
    draco_py = pytest.importorskip("DracoPy")
    (sheet,) = sheets(3)
    if merges:
        sheet.points[:, 7] = sheet.points[:, 8]
    data = DracoWithFaces().prepare(sheet.points, sheet.connectivity)(1e-3)
    reader = FieldReader(data, "draco")
    assert reader.integers("QB") == (1, int(merges))
    assert len(draco_py.decode(reader.sized()).faces) == 2 * sheet.connectivity.face_count
    found = DracoWithFaces().decode(data, sheet.connectivity)
    assert np.abs(found - sheet.points).max() <= 1e-3
