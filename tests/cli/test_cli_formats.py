"""The command line with every format: convert, info, encode and decode, and their notes about losses."""

from __future__ import annotations

import json
import re
import sys
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec.cli.main import run
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.sequence import MeshObject
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import IRREGULAR, WITH_EXTRA, assert_same_scene, body, needed, scene

TARGETS = [
    *("obj/", "npz", "h5", "mdd", "pc2", "pvd", "xdmf", "exo", "glb", "gltf", "####.vtu", "####.ply"),
    *sorted(WITH_EXTRA),
]


@pytest.fixture(autouse=True)
def in_a_folder_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def info_of(capsys: pytest.CaptureFixture[str], *arguments: str) -> tuple[dict[str, Any], str]:
    capsys.readouterr()
    assert run(["info", "--json", *arguments]) == 0
    said = capsys.readouterr()
    found: dict[str, Any] = json.loads(said.out)
    return found, said.err


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("source", ["npz", "abc", "usdc", "glb"])
def test_any_format_converts_to_any_other(capsys: pytest.CaptureFixture[str], source: str, target: str) -> None:
    needed(source)
    needed(target)
    clip = scene(up_axis="Y", unit="m")
    write_sequence(clip, f"in.{source}")
    out = "out/" if target == "obj/" else f"out.{target}"
    assert run(["convert", f"in.{source}", out]) == 0
    facts, _ = info_of(capsys, out, "--fps", "24")
    assert (facts["frames"], facts["vertices"], facts["connectivity_constant"]) == (5, 15, True)
    assert facts["source_bytes"] > 12 * 15
    with open_sequence(out, fps=24) as read:
        assert np.abs(read.read_frames(0, 5) - clip.points).max() < 1e-6


def test_the_output_is_named_once_and_what_it_cannot_hold_by_name(capsys: pytest.CaptureFixture[str]) -> None:
    write_sequence(scene(), "a.npz")
    for arguments in ([], ["b.npz", "-o", "c.npz"]):
        assert run(["convert", "a.npz", *arguments]) == 2
        assert re.search("name an input and an output|name a folder", capsys.readouterr().err)
    assert run(["convert", "a.npz", "b.xdmf"]) == 0
    said = capsys.readouterr()
    assert said.out == ""
    assert said.err.count("XDMF cannot store attributes: uv, group, material, color") == 1


@pytest.mark.parametrize(
    ("name", "expected"),
    [
        ("root/arm/hand", ["root/arm/hand"]),
        ("hand", ["root/arm/hand"]),
        ("arm/nail", ["root/arm/nail"]),
        ("/root/arm", ["root/arm/hand", "root/arm/nail"]),
        ("*/h*", ["root/arm/hand", "root/hair"]),
        ("foot", None),
    ],
)
def test_objects_are_named_by_path_end_branch_or_pattern(
    capsys: pytest.CaptureFixture[str], name: str, expected: list[str] | None
) -> None:
    write_sequence(scene(), "a.npz")
    code = run(["convert", "a.npz", "b.npz", "--object", name])
    if expected is None:
        assert code == 3
        assert "there is no object 'foot'" in capsys.readouterr().err
        return
    assert code == 0
    with open_sequence("b.npz") as read:
        assert [item.name for item in read.objects] == expected


def test_frames_axis_and_scale_are_changed_together() -> None:
    clip = scene(up_axis="Z", unit="cm")
    write_sequence(clip, "a.npz")
    assert run(["convert", "a.npz", "b.npz", "--frames", "1:4", "--up-axis", "y", "--scale", "0.01"]) == 0
    with open_sequence("b.npz") as read:
        turned = clip.points[1:4][..., [0, 2, 1]] * np.float32([0.01, 0.01, -0.01])
        assert np.allclose(read.read_frames(0, 3), turned, rtol=1e-6)
        assert dict(read.metadata) == {"up_axis": "Y", "unit": "m"}


def test_a_point_cache_takes_its_mesh_from_any_format() -> None:
    clip = scene(times=IRREGULAR)
    write_sequence(clip, "a.npz")
    write_sequence(clip, "a.mdd")
    assert run(["convert", "a.mdd", "b.npz", "--mesh", "a.npz"]) == 0
    with open_sequence("b.npz") as read:
        assert [item.name for item in read.objects] == [item.name for item in clip.objects]
        assert np.array_equal(read.read_frames(0, 5), clip.points)


@pytest.mark.parametrize("target", ["abc", "usdc"])
def test_a_scene_goes_through_a_pdeanim_file_with_its_tree_and_attributes(
    capsys: pytest.CaptureFixture[str], target: str
) -> None:
    needed(target)
    source, out = f"a.{target}", f"b.{target}"
    clip = scene(up_axis="Y", unit="m")
    write_sequence(clip, source)
    assert run(["encode", source, "-o", "a.pdeanim", "--tolerance", "1e-6", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["sections"]["ATTR"] > 0
    assert run(["decode", "a.pdeanim", "-o", out, "--velocities"]) == 0
    with open_sequence(out) as read:
        assert np.abs(read.read_frames(0, 5) - clip.points).max() < 1e-4
        assert read.notices == ()
        with pdecodec.open("a.pdeanim") as animation:
            speeds = animation.velocities(animation.times)
        np.testing.assert_allclose(read.read_field("velocities", 0, 5), speeds, rtol=1e-5, atol=1e-4)
        clip.points[:] = read.read_frames(0, 5)
        assert_same_scene(read, clip)
        assert dict(read.metadata) == {"up_axis": "Y", "unit": "m"}


@pytest.mark.parametrize(("name", "extra", "module"), [("a.abc", "abc", "alembic3d"), ("a.usdc", "usd", "pxr")])
def test_a_missing_extra_is_one_line_with_the_command_and_exit_code_5(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, name: str, extra: str, module: str
) -> None:
    for loaded in [one for one in sys.modules if one.startswith(("pdecodec.formats.alembic", "pdecodec.formats.usd"))]:
        monkeypatch.delitem(sys.modules, loaded)
    for blocked in (module, "imath"):
        monkeypatch.setitem(sys.modules, blocked, None)
    Path(name).write_bytes(b"Ogawa" if extra == "abc" else b"PXR-USDC")
    assert run(["info", name]) == 5
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    assert f"pip install 'pdecodec[{extra}]'" in said
    write_sequence(scene(), "x.npz")
    assert run(["convert", "x.npz", name, "--overwrite"]) == 5


def test_info_names_the_first_frame_that_changes_connectivity(capsys: pytest.CaptureFixture[str]) -> None:
    for frame, faces in enumerate(([[0, 1, 2]], [[0, 1, 2]], [[2, 1, 0]])):
        write_sequence(scene([MeshObject("mesh", connectivity_of(4, faces))], frames=1), f"x.{frame}.obj")
    facts, said = info_of(capsys, "x.#.obj", "--fps", "24")
    assert (facts["connectivity_constant"], facts["first_changed_frame"]) == (False, 2)
    assert (facts["runs"], facts["run_frames"], said) == (2, [1, 2], "")
    assert run(["info", "x.#.obj", "--fps", "24"]) == 0
    assert "changes at frame 2" in capsys.readouterr().out


def test_info_lists_what_it_had_to_leave_out(capsys: pytest.CaptureFixture[str]) -> None:
    needed("usda")
    from pxr import Usd, UsdGeom

    write_sequence(scene([body()]), "x.usda")
    stage = Usd.Stage.Open("x.usda")
    UsdGeom.NurbsPatch.Define(stage, "/root/ball")
    stage.Save()
    facts, _ = info_of(capsys, "x.usda")
    assert [item["name"] for item in facts["unsupported"]] == ["root/ball"]
    assert run(["convert", "x.usda", "y.npz"]) == 3
    assert "object 'root/ball': has the type NurbsPatch" in capsys.readouterr().err
    assert run(["convert", "x.usda", "y.npz", "--skip-unsupported"]) == 0
    assert "'root/ball' is left out" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("counts", "said"),
    [
        ([3, 2], "a face of 2 corners (number 1, from 0), and a face needs 3 or more"),
        ([3, 3], "faces with 6 corners in all, and vertices for 5 corners"),
    ],
)
def test_an_error_in_faces_is_reported(counts: list[int], said: str, capsys: pytest.CaptureFixture[str]) -> None:
    needed("usda")
    from pxr import Usd, UsdGeom

    name = "x.usda"
    stage = Usd.Stage.CreateNew(name)
    for path in ("/sheet", "/other"):
        mesh = UsdGeom.Mesh.Define(stage, path)
        mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
        mesh.CreateFaceVertexCountsAttr(counts)
        mesh.CreateFaceVertexIndicesAttr([0, 1, 2, 0, 1])
    stage.Save()
    assert run(["convert", name, "y.npz"]) == 3
    assert f"object 'sheet': has {said}; pass --skip-unsupported to go on without it" in capsys.readouterr().err
    assert run(["convert", name, "y.npz", "--skip-unsupported"]) == 3
    rest = ", and 1 more object cannot be read either"
    assert f"holds nothing that can be read: object 'sheet' has {said}{rest}" in capsys.readouterr().err


def test_info_measures_every_frame_on_request(capsys: pytest.CaptureFixture[str]) -> None:
    clip = scene()
    write_sequence(clip, "x.npz")
    facts, _ = info_of(capsys, "x.npz", "--all-frames")
    assert facts["bounds"] == [clip.points.min(axis=(0, 1)).tolist(), clip.points.max(axis=(0, 1)).tolist()]


REFUSED = {"files/abc": ["openusd_testAbcCamera.abc"]}
"""Files of the shared data that hold neither faces nor points."""


@pytest.mark.data
@pytest.mark.parametrize(
    "folder", [f"{place}/{kind}" for place in ("files", "interop") for kind in ("abc", "usd", "gltf")]
)
def test_every_file_of_the_shared_data_is_read_or_refused_by_one_clear_line(
    shared_data: Path, folder: str, capsys: pytest.CaptureFixture[str]
) -> None:
    needed(folder.partition("/")[2])
    refused, codes = [], set()
    found = [file for file in (shared_data / folder).rglob("*") if file.suffix not in (".bin", ".txt", ".json", "")]
    for file in sorted(found):
        code = run(["info", str(file), "--fps", "30"])
        said = capsys.readouterr().err
        codes.add(code)
        if code == 5:
            continue  # compressed glTF, which needs a package that is not installed here
        if code:
            assert code == 3
            assert said.count("\n") == 1
            refused.append(file.name)
    assert (refused, 0 in codes) == (REFUSED.get(folder, []), True)
