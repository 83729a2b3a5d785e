"""The scene that a `.pdeanim` file carries: what commands report and pass on, and the effects of hostile scenes."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from pdecodec.cli.main import run
from pdecodec.codec.sections.scene import Carrier
from pdecodec.errors import InputError
from pdecodec.formats.gltf.file import read_gltf
from tests.support.gltf_files import gltf_scene


def carrying(tmp_path: Path, **options: Any) -> Path:
    """Encode a scene and lose it."""
    source = gltf_scene(tmp_path / "source.glb")
    pdecodec.encode(source, tmp_path / "a.pdeanim", **options)
    source.unlink()
    return tmp_path / "a.pdeanim"


def test_encode_prints_the_size_of_the_scene_and_info_lists_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source = gltf_scene(tmp_path / "a.glb")
    assert run(["encode", str(source), "-o", str(tmp_path / "a.pdeanim")]) == 0
    said = capsys.readouterr().err
    assert "scene: 1 camera, 1 material, 1 texture, 1 skeleton: " in said
    assert "--scene drop leaves it out" in said
    assert "not kept: 1 texture" not in said
    assert run(["info", str(tmp_path / "a.pdeanim")]) == 0
    listed = capsys.readouterr().out
    assert "gltf, 1 camera, 1 material, 1 texture, 1 skeleton" in listed
    assert "my%20image.png" in listed
    assert "motion alone" in listed
    assert run(["encode", str(source), "-o", str(tmp_path / "b.pdeanim"), "--scene", "drop", "--json"]) == 0
    said = capsys.readouterr()
    assert json.loads(said.out)["scene"] is None
    assert "not kept: 1 texture" in said.err


@pytest.mark.parametrize(
    ("options", "cameras", "told"),
    [
        ([], 1, ""),
        (["--scene", "drop"], 0, ""),
        (["--quantize"], 0, "left out: quantize would move its nodes"),
        (["--object", "shown"], 0, "left out, because objects are chosen"),
        (["--scale", "2"], 0, "left out, because objects are chosen, or turned or scaled"),
        (["--frames", "1:3"], 1, ""),
        (["--fps", "48", "--straight"], 1, ""),
    ],
)
def test_decode_writes_the_scene_unless_it_cannot(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], cameras: int, told: str
) -> None:
    file = carrying(tmp_path)
    assert run(["decode", str(file), "-o", str(tmp_path / "b.gltf"), *options]) == 0
    assert len(read_gltf(tmp_path / "b.gltf").listed("cameras")) == cameras
    assert told in capsys.readouterr().err
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.pdeanim", "b.gltf"]


def test_convert_and_a_second_encode_pass_the_scene_on(tmp_path: Path) -> None:
    file = carrying(tmp_path)
    assert run(["encode", str(file), "-o", str(tmp_path / "b.pdeanim"), "--tolerance", "0.01"]) == 0
    assert run(["convert", str(tmp_path / "b.pdeanim"), str(tmp_path / "c.glb")]) == 0
    assert read_gltf(tmp_path / "c.glb").root["cameras"] == read_gltf(gltf_scene(tmp_path / "d.glb")).root["cameras"]
    assert run(["decode", str(file), "-o", str(tmp_path / "e.usda")]) == 0


def test_a_selection_of_objects_keeps_the_others_as_they_are(tmp_path: Path) -> None:
    source = gltf_scene(tmp_path / "source.glb")
    file = tmp_path / "a.pdeanim"
    assert run(["encode", str(source), "-o", str(file), "--object", "shown"]) == 0
    assert run(["decode", str(file), "-o", str(tmp_path / "b.glb")]) == 0
    with pdecodec.open_sequence(source) as old, pdecodec.open_sequence(tmp_path / "b.glb") as new:
        assert {one.name.split("/")[-1] for one in new.objects} == {one.name.split("/")[-1] for one in old.objects}


def test_a_file_of_the_scene_never_replaces_another(tmp_path: Path) -> None:
    (tmp_path / "a.obj").write_text("mtllib looks.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    (tmp_path / "looks.mtl").write_text("newmtl red\n")
    pdecodec.encode(tmp_path / "a.obj", tmp_path / "a.pdeanim")
    (tmp_path / "looks.mtl").write_text("newmtl other\n")
    with pdecodec.open(tmp_path / "a.pdeanim") as animation, pytest.raises(InputError, match="is not the file"):
        pdecodec.write_sequence(animation, tmp_path / "b.obj", overwrite=True)
    assert (tmp_path / "looks.mtl").read_text() == "newmtl other\n"
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.obj", "a.pdeanim", "looks.mtl"]


HOSTILE_LAYERS = {
    "absolute": "(subLayers = [@/etc/passwd@])",
    "above": "(subLayers = [@../../a.pdeanim@])",
    "no text": "(",
    "nothing": "",
    "no layer": "\n",
    "a script next to the output": "(customLayerData = {int one = 1})",
    "files of unfinished output": 'def Mesh "m"\n{\n'
    "int[] faceVertexCounts = [3]\nint[] faceVertexIndices = [0, 1, 2]\n"
    "point3f[] points = [(0,0,0), (0,0,0), (0,0,1)]\n}",
}

HOSTILE_CUTS = {
    HOSTILE_LAYERS["no layer"]: {"arrays": [["b.usda", "/m.x", 0, "values", ""]]},
    HOSTILE_LAYERS["a script next to the output"]: {"companions": ["conftest.py"]},
    HOSTILE_LAYERS["files of unfinished output"]: {"companions": [".x.ready/b.usda"]},
}


@pytest.mark.parametrize("layer", HOSTILE_LAYERS.values(), ids=HOSTILE_LAYERS)
def test_a_hostile_stage_reads_nothing_outside_and_leaves_the_meshes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], layer: str
) -> None:
    pytest.importorskip("pxr", reason="what USD needs is not installed here")
    file, out = tmp_path / "a.pdeanim", tmp_path / "out"
    cuts = json.dumps({"root": "a.usda", "companions": [], "arrays": [], **HOSTILE_CUTS.get(layer, {})}).encode()
    files = {"files/a.usda": f"#usda 1.0\n{layer}\n".encode(), "files/b.usda": b"(", "files/.x.ready/b.usda": b"("}
    files["files/conftest.py"] = b"raise SystemExit"
    clip = pdecodec.ArraySequence(np.random.default_rng(1).normal(size=(3, 3, 3)), faces=[[0, 1, 2]])
    clip.carried = Carrier.of("usd", [], [], {"cuts": cuts, **files})
    pdecodec.encode(clip, file)
    out.mkdir()
    assert run(["decode", str(file), "-o", str(out / "b.usda")]) == 0
    lines = [one for one in capsys.readouterr().err.splitlines() if "left out" in one]
    assert len(lines) == 1
    assert [one.name for one in out.iterdir()] == ["b.usda"]
    assert "/etc" not in (out / "b.usda").read_text()


@pytest.mark.parametrize(
    ("companion", "out"),
    [("original", "b.usda"), ("whole", "b.usda"), ("look", "original.usda"), ("look", "look.usda"), ("con", "b.usda")],
)
def test_names_of_a_scene_do_not_meet_those_of_its_writer(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], companion: str, out: str
) -> None:
    pytest.importorskip("pxr", reason="what USD needs is not installed here")
    source, folder = tmp_path / "a.usda", tmp_path / "out"
    pdecodec.write_sequence(
        pdecodec.ArraySequence(np.random.default_rng(1).normal(size=(3, 4, 3)), faces=[[0, 1, 2], [0, 2, 3]]), source
    )
    first, rest = source.read_text().split("(", 1)
    source.write_text(f"{first}(\n    subLayers = [@./{companion}.usda@]{rest}")
    look = '#usda 1.0\n\ndef Camera "eye"\n{\n}\n\n'
    (tmp_path / f"{companion}.usda").write_text(look)
    assert run(["encode", str(source), "-o", str(tmp_path / "a.pdeanim")]) == 0
    folder.mkdir()
    assert run(["decode", str(tmp_path / "a.pdeanim"), "-o", str(folder / out)]) == (3 if out == "look.usda" else 0)
    written = {one.name: one.read_text() for one in folder.iterdir()}
    if out == "look.usda":
        assert "the name of a file that the scene consists of" in capsys.readouterr().err
        assert not written
    elif companion == "con":
        assert written.keys() == {out}
    else:
        assert written.keys() == {out, f"{companion}.usda"}
        assert written[f"{companion}.usda"] == look


def test_files_of_a_scene_do_not_follow_links_out_of_the_folder(tmp_path: Path) -> None:
    pytest.importorskip("pxr", reason="what USD needs is not installed here")
    from tests.support.usd_stages import usd_shot

    source = usd_shot(tmp_path / "in", "a.usda")
    pdecodec.encode(source, tmp_path / "a.pdeanim")
    shutil.rmtree(tmp_path / "in")
    out, elsewhere = tmp_path / "out", tmp_path / "elsewhere"
    out.mkdir()
    elsewhere.mkdir()
    (out / "layers").symlink_to(elsewhere)
    with pdecodec.open(tmp_path / "a.pdeanim") as animation, pytest.raises(InputError, match="link out of the folder"):
        pdecodec.write_sequence(animation, out / "b.usda")
    assert not [*elsewhere.iterdir()]
    assert [one.name for one in out.iterdir()] == ["layers"]


def test_a_file_that_is_read_in_a_worker_is_cut_there(tmp_path: Path) -> None:
    source = gltf_scene(tmp_path / "a.glb")
    usual, isolated, some = (tmp_path / f"{name}.pdeanim" for name in "abc")
    assert run(["encode", str(source), "-o", str(usual)]) == 0
    assert run(["encode", str(source), "-o", str(isolated), "--isolate"]) == 0
    assert isolated.read_bytes() == usual.read_bytes()
    assert run(["encode", str(source), "-o", str(some), "--isolate", "--object", "shown"]) == 0
    with pdecodec.open(some) as animation:
        assert animation.carried is not None


def changed(data: Path, name: str, content: bytes | None) -> None:
    """Replace a stream of a file's scene, or remove it."""
    with pdecodec.open(data) as animation:
        assert animation.carried is not None
        files = animation.carried.files(2**20)
        clip = animation.to_array()
    files = {key: value for key, value in files.items() if key != name}
    clip.carried = Carrier.of("gltf", [], [], files if content is None else {**files, name: content})
    pdecodec.encode(clip, data, overwrite=True)


@pytest.mark.parametrize(
    ("name", "content"),
    [
        ("cuts", None),
        ("cuts", b"[]"),
        ("cuts", b"{"),
        ("cuts", b"[" * 100_000),
        ("cuts", b'{"root": "scene.gltf", "companions": [], "checks": {}, "images": [], "arrays": [], "clip": 5}'),
        ("cuts", b'{"root": "../other.gltf", "companions": []}'),
        ("cuts", b'{"root": "scene.gltf", "companions": [], "fields": 5}'),
        ("cuts", b'{"root": "scene.gltf", "companions": [], "fields": [[]]}'),
        ("cuts", b'{"root": "scene.gltf", "companions": ["/etc/passwd"]}'),
        ("cuts", b'{"root": "scene.gltf", "companions": [], "checks": {"../../x": 0}, "images": [], "arrays": []}'),
        ("cuts", b'{"root": "scene.gltf", "companions": [], "checks": {"0": 0}, "images": [], "arrays": []}'),
        ("cuts", b'{"root": "scene.gltf", "companions": [], "checks": {}, "images": [[0, 0]], "arrays": []}'),
        (
            "cuts",
            b'{"root": "scene.gltf", "companions": [], "checks": {"0": 0}, "images": [], '
            b'"arrays": [{"accessor": 0, "object": 0, "start": 0, "uv": "none"}]}',
        ),
        ("files/scene.gltf", b"{}"),
        ("files/scene.gltf", b'{"accessors": [{"componentType": 5126, "count": 1e99}]}'),
        (
            "files/scene.gltf",
            b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "../../a.pdeanim", "byteLength": 9}]}',
        ),
        ("files/scene.gltf", b'{"asset": {"version": "2.0"}, "buffers": [{"uri": "/etc/passwd", "byteLength": 9}]}'),
        ("files/0.bin", None),
        ("files/0.bin", b""),
    ],
)
def test_a_hostile_scene_leaves_the_meshes_and_is_named_in_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str, content: bytes | None
) -> None:
    file = carrying(tmp_path)
    changed(file, name, content)
    out = tmp_path / "out"
    out.mkdir()
    assert run(["decode", str(file), "-o", str(out / "b.glb")]) == 0
    (line,) = [one for one in capsys.readouterr().err.splitlines() if "scene of the file is left out: " in one]
    assert len(line) < 400
    assert [one.name for one in out.iterdir()] == ["b.glb"]
    assert sorted(one.name for one in tmp_path.iterdir()) == ["a.pdeanim", "out"]
    assert not read_gltf(out / "b.glb").listed("cameras")


def test_a_damaged_scene_stops_only_those_who_write_it(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    file = carrying(tmp_path)
    data = bytearray(file.read_bytes())
    data[-1] ^= 1
    file.write_bytes(data)
    assert run(["decode", str(file), "-o", str(tmp_path / "b.npz"), "--frames", "1:3"]) == 0
    assert run(["decode", str(file), "-o", str(tmp_path / "b.glb"), "--scene", "drop"]) == 0
    assert run(["info", str(file)]) == 0
    assert "damaged (section SCEN" in capsys.readouterr().out
    assert run(["decode", str(file), "-o", str(tmp_path / "c.glb")]) == 4
    assert "pass --scene drop to write the meshes alone" in capsys.readouterr().err
    assert not (tmp_path / "c.glb").exists()


def test_names_that_utf8_cannot_hold_keep_their_scene(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    source = tmp_path / "a.gltf"
    points = np.random.default_rng(2).normal(size=(3, 4, 3))
    pdecodec.write_sequence(pdecodec.ArraySequence(points, faces=[[0, 1, 2], [0, 2, 3]], fps=24), source)
    root = json.loads(source.read_text())
    root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}, "name": "half\ud800"}]
    root["nodes"].append({"camera": 0, "name": "\udc00 é"})
    source.write_text(json.dumps(root))
    assert run(["encode", str(source), "-o", str(tmp_path / "a.pdeanim")]) == 0
    assert "scene: 1 camera" in capsys.readouterr().err
    for name in ("b.gltf", "b.glb"):
        assert run(["decode", str(tmp_path / "a.pdeanim"), "-o", str(tmp_path / name)]) == 0
        found = read_gltf(tmp_path / name).root
        assert found["cameras"] == root["cameras"]
        assert root["nodes"][-1] in found["nodes"]


@pytest.mark.parametrize(
    ("options", "is_kept"),
    [(["--up-axis", "Y"], True), (["--unit", "m"], True), (["--up-axis", "Z"], False), (["--unit", "cm"], False),
     (["--scale", "2"], False), (["--order", "free"], False)],
)  # fmt: skip
def test_a_scene_is_kept_where_its_meshes_keep_their_place(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], options: list[str], is_kept: bool
) -> None:
    source, file = gltf_scene(tmp_path / "a.glb"), str(tmp_path / "a.pdeanim")
    assert run(["encode", str(source), "-o", file, *options]) == 0
    said = capsys.readouterr().err
    assert ("scene: 1 camera" in said) == is_kept
    assert ("the scene around the motion is not kept: " in said) != is_kept
    assert run(["decode", file, "-o", str(tmp_path / "b.glb"), *(options[:2] if is_kept else [])]) == 0
    assert len(read_gltf(tmp_path / "b.glb").listed("cameras")) == is_kept


def test_rigid_parts_of_a_gltf_scene_stay_small(tmp_path: Path) -> None:
    turns = np.linspace(0, 2, 40)[:, None]
    flat = np.random.default_rng(2).normal(size=(1, 60, 3))
    around = np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=2)
    parts = flat + np.where(np.arange(60)[None, :, None] < 30, around, 4 - around)
    faces = [[k, k + 1, k + 2] for k in range(58) if k not in (28, 29)]
    source, file = tmp_path / "a.gltf", tmp_path / "a.pdeanim"
    # One mesh is a single part, the other has two parts.
    for number, points in enumerate((flat + around, parts)):
        clip = pdecodec.ArraySequence(points, faces=faces, fps=24)
        pdecodec.write_sequence(clip, source, overwrite=True)
        root = json.loads(source.read_text())
        root["cameras"] = [{"type": "perspective", "perspective": {"yfov": 1, "znear": 1}}]
        source.write_text(json.dumps(root))
        pdecodec.encode(source, file, tolerance=0.01, overwrite=True)
        with pdecodec.open(file) as animation:
            notices = pdecodec.write_sequence(animation, tmp_path / "b.glb", overwrite=True)
            assert "1 object written as rigid" in str(notices)
            with pdecodec.open_sequence(tmp_path / "b.glb") as read:
                off = np.linalg.norm(read.read_frames(0, 40) - animation.read_frames(0, 40), axis=2)
                assert off.max() <= 0.011
        root = read_gltf(tmp_path / "b.glb").root
        assert len(root["cameras"]) == 1
        assert not [one for mesh in root["meshes"] for one in mesh["primitives"] if "targets" in one]
        assert len(root.get("skins", ())) == number
        assert (tmp_path / "b.glb").stat().st_size < 4 * points.size
        assert run(["decode", str(file), "-o", str(tmp_path / "c.glb"), "--no-rigid", "--overwrite"]) == 0
        assert "skins" not in (free := read_gltf(tmp_path / "c.glb").root)
        assert len(free["cameras"]) == 1
        assert any("targets" in one for mesh in free["meshes"] for one in mesh["primitives"])
