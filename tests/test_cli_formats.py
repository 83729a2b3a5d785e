"""The command line over every format: convert, info, encode and decode, and what they say of losses."""

from __future__ import annotations

import json
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.cli.main import run
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.sequence import MeshObject
from tests.mesh_cases import connectivity_of
from tests.scene_cases import IRREGULAR, assert_same_scene, body, scene

WITHOUT_EXTRA = ["obj/", "npz", "h5", "mdd", "pc2", "pvd", "xdmf", "glb", "gltf", "####.vtu", "####.ply"]

WITH_EXTRA = {"abc": "alembic3d", "usdc": "pxr", "usda": "pxr", "usdz": "pxr"}


def needed(extension: str) -> None:
    """Skip, by name, what an extension needs and is not here."""
    if extension in WITH_EXTRA:
        pytest.importorskip(WITH_EXTRA[extension], reason=f"what .{extension} needs is not installed here")


def place(folder: Path, name: str, extension: str) -> str:
    return f"{folder / name}/" if extension.endswith("/") else str(folder / f"{name}.{extension}")


def info_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[dict[str, Any], str]:
    capsys.readouterr()
    assert run(["info", "--json", *arguments]) == 0
    said = capsys.readouterr()
    found: dict[str, Any] = json.loads(said.out)
    return found, said.err


@pytest.mark.parametrize("target", [*WITHOUT_EXTRA, *WITH_EXTRA])
@pytest.mark.parametrize("source", ["npz", "abc", "usdc", "glb"])
def test_any_format_converts_to_any_other(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], source: str, target: str
) -> None:
    needed(source)
    needed(target)
    clip = scene(up_axis="Y", unit="m")
    write_sequence(clip, place(tmp_path, "in", source))
    assert run(["convert", place(tmp_path, "in", source), place(tmp_path, "out", target)]) == 0
    facts, _ = info_of(capsys, place(tmp_path, "out", target), "--fps", "24")
    assert (facts["frames"], facts["vertices"]) == (5, 15)
    assert facts["connectivity_constant"] is True
    assert facts["source_bytes"] > 12 * 15
    with open_sequence(place(tmp_path, "out", target), fps=24) as read:
        assert np.abs(read.read_frames(0, 5) - clip.points).max() < 1e-6


def test_the_output_is_named_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sequence(scene(), tmp_path / "a.npz")
    for arguments in ([], [f"{tmp_path}/b.npz", "-o", f"{tmp_path}/c.npz"]):
        assert run(["convert", f"{tmp_path}/a.npz", *arguments]) == 2
        assert "name one output" in capsys.readouterr().err


def test_what_a_format_cannot_hold_is_told_once_and_by_name(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sequence(scene(), tmp_path / "a.npz")
    assert run(["convert", f"{tmp_path}/a.npz", f"{tmp_path}/b.xdmf"]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("XDMF has no place for attributes: uv, group, material, color") == 1


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("root/arm/hand", ["root/arm/hand"]),
        ("hand", ["root/arm/hand"]),
        ("arm/nail", ["root/arm/nail"]),
        ("/root/arm", ["root/arm/hand", "root/arm/nail"]),
        ("*/h*", ["root/arm/hand", "root/hair"]),
    ],
)
def test_objects_are_named_by_path_end_branch_or_pattern(tmp_path: Path, name: str, expected: list[str]) -> None:
    write_sequence(scene(), tmp_path / "a.npz")
    assert run(["convert", f"{tmp_path}/a.npz", f"{tmp_path}/b.npz", "--object", name]) == 0
    with open_sequence(tmp_path / "b.npz") as read:
        assert [item.name for item in read.objects] == expected


def test_an_object_that_is_not_there_is_refused_with_those_that_are(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write_sequence(scene(), tmp_path / "a.npz")
    assert run(["convert", f"{tmp_path}/a.npz", f"{tmp_path}/b.npz", "--object", "foot"]) == 3
    assert "there is no object 'foot'" in capsys.readouterr().err


def test_frames_axis_and_scale_are_changed_together(tmp_path: Path) -> None:
    clip = scene(up_axis="Z", unit="cm")
    write_sequence(clip, tmp_path / "a.npz")
    options = ["--frames", "1:4", "--up-axis", "y", "--scale", "0.01"]
    assert run(["convert", f"{tmp_path}/a.npz", f"{tmp_path}/b.npz", *options]) == 0
    with open_sequence(tmp_path / "b.npz") as read:
        turned = clip.points[1:4][..., [0, 2, 1]] * np.float32([0.01, 0.01, -0.01])
        assert np.allclose(read.read_frames(0, 3), turned, rtol=1e-6)
        assert dict(read.metadata) == {"up_axis": "Y", "unit": "m"}


def test_a_point_cache_takes_its_mesh_from_any_format(tmp_path: Path) -> None:
    clip = scene(times=IRREGULAR)
    write_sequence(clip, tmp_path / "a.npz")
    write_sequence(clip, tmp_path / "a.mdd")
    arguments = [f"{tmp_path}/a.mdd", f"{tmp_path}/b.npz", "--mesh", f"{tmp_path}/a.npz"]
    assert run(["convert", *arguments]) == 0
    with open_sequence(tmp_path / "b.npz") as read:
        assert [item.name for item in read.objects] == [item.name for item in clip.objects]
        assert np.array_equal(read.read_frames(0, 5), clip.points)


@pytest.mark.parametrize("target", ["abc", "usdc"])
def test_a_scene_goes_through_a_pdeanim_file_with_its_tree_and_attributes(tmp_path: Path, target: str) -> None:
    needed(target)
    clip = scene(up_axis="Y", unit="m")
    source, coded, out = f"{tmp_path}/a.{target}", f"{tmp_path}/a.pdeanim", f"{tmp_path}/b.{target}"
    write_sequence(clip, source)
    assert run(["encode", source, "-o", coded, "--profile", "segments", "--tolerance", "1e-6"]) == 0
    assert run(["decode", coded, "-o", out, "--velocities"]) == 0
    with open_sequence(out) as read:
        assert np.abs(read.read_frames(0, 5) - clip.points).max() < 1e-4
        assert read.notices == ("not kept: velocities",)
        exact = scene(up_axis="Y", unit="m")
        exact.points[:] = read.read_frames(0, 5)
        assert_same_scene(read, exact)
        assert dict(read.metadata) == {"up_axis": "Y", "unit": "m"}


def test_attributes_are_counted_apart_in_the_report(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sequence(scene(), tmp_path / "a.npz")
    assert run(["encode", f"{tmp_path}/a.npz", "-o", f"{tmp_path}/a.pdeanim", "--profile", "segments", "--json"]) == 0
    sections = json.loads(capsys.readouterr().out)["sections"]
    assert sections["ATTR"] > 0


@pytest.mark.parametrize(("name", "extra", "module"), [("a.abc", "abc", "alembic3d"), ("a.usdc", "usd", "pxr")])
def test_a_missing_extra_is_one_line_with_the_command_and_exit_code_5(
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
    extra: str,
    module: str,
) -> None:
    for loaded in [one for one in sys.modules if one.startswith(("pdecodec.formats.alembic", "pdecodec.formats.usd"))]:
        monkeypatch.delitem(sys.modules, loaded)
    for blocked in (module, "imath"):
        monkeypatch.setitem(sys.modules, blocked, None)
    (tmp_path / name).write_bytes(b"Ogawa" if extra == "abc" else b"PXR-USDC")
    assert run(["info", str(tmp_path / name)]) == 5
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"pip install 'pdecodec[{extra}]'" in said
    write_sequence(scene(), tmp_path / "x.npz")
    assert run(["convert", f"{tmp_path}/x.npz", str(tmp_path / name), "--overwrite"]) == 5


def test_info_tells_the_first_frame_that_changes_connectivity(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    first = MeshObject("mesh", connectivity_of(4, [[0, 1, 2]]))
    for frame, faces in enumerate(([[0, 1, 2]], [[0, 1, 2]], [[2, 1, 0]])):
        item = MeshObject("mesh", connectivity_of(4, faces))
        write_sequence(scene([item], frames=1), tmp_path / f"x.{frame}.obj")
    assert first.vertex_count == 4
    facts, said = info_of(capsys, f"{tmp_path}/x.#.obj", "--fps", "24")
    assert (facts["connectivity_constant"], facts["first_changed_frame"]) == (False, 2)
    assert "frame 2" in said
    assert run(["info", f"{tmp_path}/x.#.obj", "--fps", "24"]) == 0
    assert "changes at frame 2" in capsys.readouterr().out


def test_info_lists_what_it_had_to_leave_out(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pxr", reason="USD is not installed here")
    from pxr import Usd, UsdGeom

    write_sequence(scene([body()]), tmp_path / "x.usda")
    stage = Usd.Stage.Open(str(tmp_path / "x.usda"))
    UsdGeom.Sphere.Define(stage, "/root/ball")
    stage.Save()
    facts, _ = info_of(capsys, f"{tmp_path}/x.usda")
    assert [item["name"] for item in facts["unsupported"]] == ["root/ball"]
    assert run(["convert", f"{tmp_path}/x.usda", f"{tmp_path}/y.npz"]) == 3
    assert "object 'root/ball' has the type Sphere" in capsys.readouterr().err
    assert run(["convert", f"{tmp_path}/x.usda", f"{tmp_path}/y.npz", "--skip-unsupported"]) == 0
    assert "'root/ball' is left out" in capsys.readouterr().err


def test_info_measures_every_frame_when_asked(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    clip = scene()
    write_sequence(clip, tmp_path / "x.npz")
    facts, _ = info_of(capsys, f"{tmp_path}/x.npz", "--all-frames")
    assert facts["bounds"] == [clip.points.min(axis=(0, 1)).tolist(), clip.points.max(axis=(0, 1)).tolist()]


@pytest.mark.data
@pytest.mark.parametrize("folder", ["abc", "usd", "gltf"])
def test_every_file_of_the_shared_data_is_read_or_refused_by_one_clear_line(
    shared_data: Path, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    needed({"usd": "usdc"}.get(folder, folder))
    refused = []
    for file in sorted((shared_data / "files" / folder).iterdir()):
        code = run(["info", str(file), "--fps", "30"])
        said = capsys.readouterr().err
        if code:
            assert code == 3
            assert said.count("\n") == 1
            refused.append(file.name)
    assert refused == {"abc": ["cortex_points.abc", "openusd_testAbcCamera.abc"]}.get(folder, [])
