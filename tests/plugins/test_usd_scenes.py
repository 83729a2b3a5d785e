"""The USD plug-in shows the scene that a file carries as `pdecodec decode` writes it, with the motion at any time."""

from __future__ import annotations

import json
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pxr import Ar, Plug, Sdf, Usd, UsdGeom

import pdecodec
from pdecodec.codec.sections.scene import Carrier
from pdecodec.formats import open_sequence, write_sequence
from tests.plugins.usd_tools import assert_same_stage, message_of, opened
from tests.support.usd_stages import usd_shot

if not Plug.Registry().GetPluginWithName("pdeanim_usd").metadata.get("scenes"):
    pytest.skip("the plug-in is built without the headers of Pcp", allow_module_level=True)

ROUNDING = 1e-5
"""How much single floats may differ: transforms are inverted and multiplied in another order."""

STAGE = Path(__file__).parent / "stages/shot.usda"
"""A stage with references, payloads, variants, instances, mirrors, and every kind of shape."""


def carrying(source: Path, path: Path) -> Path:
    with open_sequence(source, skip_unsupported=True) as sequence:
        pdecodec.encode(sequence, path)
    return path


def decoded(path: Path, folder: Path, **options: Any) -> Any:
    folder.mkdir()
    with pdecodec.open(path) as animation:
        write_sequence(animation, folder / "out.usdc", **options)
    return Usd.Stage.Open(str(folder / "out.usdc"))


@pytest.fixture(scope="module")
def many(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("many")
    return carrying(STAGE, folder / "shot.pdeanim")


@pytest.fixture(scope="module")
def shot(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A file that carries layers and a texture of a package."""
    folder = tmp_path_factory.mktemp("shot")
    return carrying(usd_shot(folder / "in", "b.usdz"), folder / "shot.pdeanim")


def test_a_scene_opens_as_the_stage_that_it_decodes_to(many: Path, tmp_path: Path) -> None:
    assert_same_stage(opened(many), decoded(many, tmp_path / "out"), ROUNDING)


@pytest.mark.parametrize("name", ["a.usda", "b.usdz", "c.usdc"])
def test_layers_and_packages_open_as_the_stage_that_they_decode_to(tmp_path: Path, name: str) -> None:
    path = carrying(usd_shot(tmp_path / "in", name), tmp_path / "shot.pdeanim")
    assert_same_stage(opened(path), decoded(path, tmp_path / "out"), ROUNDING)


@pytest.mark.parametrize(
    "name",
    [*(f"interop/usd/{one}" for one in ("AnimatedCube.usdz", "CesiumMan.usdz", "arm.usda", "lbs.usda")),
     "files/usd/openusd_blendshapes.baked.usda"],
)  # fmt: skip
def test_shared_scenes_open_as_the_stages_that_they_decode_to(tmp_path: Path, shared_data: Path, name: str) -> None:
    path = carrying(shared_data / name, tmp_path / "shot.pdeanim")
    assert_same_stage(opened(path), decoded(path, tmp_path / "out"), ROUNDING)


def test_points_between_frames_are_those_of_the_decoder_in_the_scene(many: Path) -> None:
    stage, rate = opened(many), 24
    with pdecodec.open(many) as animation:
        for code in np.random.default_rng(1).uniform(-2, 50, 12):
            time = float(np.clip(code / rate, animation.times[0], animation.times[-1]))
            cache = UsdGeom.XformCache(time * rate)
            expected = animation.positions(time)
            first = 0
            for item in animation.objects:
                own, first = expected[first : first + item.vertex_count], first + item.vertex_count
                prim = stage.GetPrimAtPath(f"/{item.name}")
                if not prim or prim.IsInstanceProxy() or "Pts" in item.name:
                    continue
                matrix = np.array(cache.GetLocalToWorldTransform(prim))
                points = np.array(prim.GetAttribute("points").Get(time * rate))
                np.testing.assert_allclose(points @ matrix[:3, :3] + matrix[3, :3], own, atol=ROUNDING)


def test_velocities_are_those_of_the_points_in_their_own_space(many: Path) -> None:
    stage = opened(many)
    for name, code in (("Left", 12.3), ("Dust", 4.5), ("Hair", 20.25)):
        prim = stage.GetPrimAtPath(f"/World/{name}")
        before, after = (np.array(prim.GetAttribute("points").Get(code + step)) for step in (-0.01, 0.01))
        found = np.array(prim.GetAttribute("velocities").Get(code))
        np.testing.assert_allclose(found, (after.astype(float) - before) / (0.02 / 24), atol=0.02)
        # Those of a space that moves itself would not be exact.
        assert not prim.GetAttribute("accelerations").HasAuthoredValue()


def test_files_of_a_scene_are_found_in_the_clip(shot: Path, tmp_path: Path) -> None:
    shown = opened(shot)
    texture = shown.GetAttributeAtPath("/Root/Look/Image.inputs:file").Get()
    asset = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(texture.resolvedPath))
    assert asset.GetBuffer() == b"a picture"
    # Where another stage refers to the clip, too.
    (tmp_path / "root.usda").write_text(f'#usda 1.0\ndef "a" (references = @{shot}@</Root>) {{}}\n')
    stage = Usd.Stage.Open(str(tmp_path / "root.usda"))
    assert stage.GetAttributeAtPath("/a/Look/Image.inputs:file").Get().resolvedPath
    points = [one.GetAttributeAtPath(f"{root}/Sheet.points").Get(2) for one, root in ((stage, "/a"), (shown, "/Root"))]
    np.testing.assert_array_equal(*map(np.array, points))


def test_a_scene_is_left_out_if_it_is_asked_for(many: Path) -> None:
    found = opened(many, scene="drop")
    assert not found.GetPrimAtPath("/World/Cam")
    with pdecodec.open(many) as animation:
        first = animation.positions(0.5)[: animation.objects[0].vertex_count]
    np.testing.assert_array_equal(found.GetAttributeAtPath("/World/A/Body.points").Get(12), first)
    assert "argument 'scene'" in message_of(many, lambda: opened(many, scene="some"))


GOOD = """#usda 1.0
def Mesh "mesh" {
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
    point3f[] points = [(0, 0, 0), (0, 0, 0), (0, 0, 0)]
}
"""

HOSTILE: dict[str, tuple[dict[str, Any], str]] = {
    "no text": ({}, "("),
    "nothing": ({}, ""),
    "no meshes": ({}, "#usda 1.0\n"),
    "too few points": ({}, GOOD.replace("(0, 0, 0), ", "", 1)),
    "points of another type": ({}, GOOD.replace("point3f[]", "string[]").replace("(0, 0, 0)", '"a"')),
    "a layer that is not there": ({"root": "other.usda"}, GOOD),
    "a root that is no text": ({"root": 5}, GOOD),
    "an array of no object": ({"arrays": [["a.usda", "/mesh.faceVertexCounts", 7, "faceVertexCounts", ""]]}, GOOD),
    "an array of another type": ({"arrays": [["a.usda", "/mesh.points", 0, "faceVertexCounts", ""]]}, GOOD),
    "an array without an attribute": ({"arrays": [["a.usda", "/mesh.faceVertexCounts", 0, "weights", "values"]]}, GOOD),
    "an array of no place": ({"arrays": [["a.usda", "//", 0, "faceVertexCounts", ""]]}, GOOD),
    "an array of a prim": ({"arrays": [["a.usda", "/mesh", 0, "faceVertexCounts", ""]]}, GOOD),
    "a row that is no list": ({"arrays": [5]}, GOOD),
    "a field that is not there": (
        {"samples": [["a.usda", "/mesh.points", "heat", 0, "<f4", 0.0, 0.0, 3]]}, GOOD
    ),
    "a negative number": ({"samples": [["a.usda", "/mesh.points", "heat", -1, "<f4", 0.0, 0.0, 3]]}, GOOD),
    "lists within lists": ({"arrays": json.loads("[" * 900 + "]" * 900)}, GOOD),
    "references in a chain": (
        {}, GOOD + "".join(f'def "r{i}" (references = </r{i + 1}>) {{}}\n' for i in range(1000)) + 'def "r1000" {}\n'
    ),
    "a rate of nothing": ({}, GOOD.replace("#usda 1.0", "#usda 1.0\n(timeCodesPerSecond = 0)")),
    "a transform that flattens": (
        {}, GOOD.replace("    int[] faceVertexCounts", "    float3 xformOp:scale = (1, 0, 1)\n"
                         '    uniform token[] xformOpOrder = ["xformOp:scale"]\n    int[] faceVertexCounts')
    ),
    "a transform of no kind": (
        {}, GOOD.replace("    int[] faceVertexCounts", "    string xformOp:shear = \"a\"\n"
                         '    uniform token[] xformOpOrder = ["xformOp:shear"]\n    int[] faceVertexCounts')
    ),
}  # fmt: skip


def hostile(path: Path, layer: str | bytes, *, triangles: int = 1, **cuts: Any) -> Path:
    """Write a file that carries a layer, by the name of the root, and what was cut out of it."""
    cuts = {"root": "a.usda", "companions": [], "arrays": [], **cuts}
    content = layer.encode() if isinstance(layer, str) else layer
    faces = np.arange(3 * triangles).reshape(-1, 3)
    clip = pdecodec.ArraySequence(np.random.default_rng(1).normal(size=(3, faces.size, 3)), faces=faces)
    name = "a.usda" if cuts["root"] != "a.pdeanim" else "a.pdeanim"
    clip.carried = Carrier.of("usd", [], [], {"cuts": json.dumps(cuts).encode(), f"files/{name}": content})
    pdecodec.encode(clip, path)
    return path


@pytest.mark.parametrize("name", HOSTILE)
def test_a_hostile_scene_leaves_the_meshes(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    cuts, layer = HOSTILE[name]
    path = hostile(tmp_path / "a.pdeanim", layer, **cuts)
    stage = opened(path)
    with pdecodec.open(path) as animation:
        np.testing.assert_array_equal(stage.GetAttributeAtPath("/mesh.points").Get(1), animation.positions(1 / 24))
    assert f"{path}: the meshes are shown without the scene around them: " in capfd.readouterr().err


USES = """
def "r" (references = @@</mesh>) {}
def "p" (payload = @@</mesh>) {}
def "v" (
    variants = { string choice = "one" }
    prepend variantSets = "choice"
) {
    variantSet "choice" = {
        "one" (references = @@</mesh>) {
        }
    }
}
"""
"""Prims that name a layer which a sublayer names, too."""


@pytest.mark.parametrize(
    "name", ["{0}/other.usda", "./other.usda", "{0}/a.pdeanim", "./a.pdeanim:SDF_FORMAT_ARGS:fps=3"]
)
def test_opening_a_scene_reads_no_other_file(tmp_path: Path, name: str) -> None:
    other = tmp_path / "other.usda"
    other.write_text('#usda 1.0\nover "mesh" {\n custom string secret = "read"\n}\n')
    asset = f"@{name.format(tmp_path)}@"
    layer = GOOD.replace("#usda 1.0", f"#usda 1.0\n(subLayers = [{asset}])") + USES.replace("@@", asset)
    found = Sdf.Layer.FindOrOpen(str(hostile(tmp_path / "a.pdeanim", layer)))
    assert found.GetPrimAtPath("/mesh")
    assert not Sdf.Layer.Find(str(other))
    # Whoever composes the layer opens what it names, as with every file of USD.
    stage = Usd.Stage.Open(found)
    assert stage.GetPrimAtPath("/mesh").GetAttribute("secret").Get() == ("read" if "other" in name else None)


def test_a_clip_within_a_clip_is_no_layer_of_its_scene(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    # Each would be opened while the one around it is.
    path = hostile(tmp_path / "a.pdeanim", GOOD)
    for _ in range(3):
        path = hostile(tmp_path / f"{path.stem}b.pdeanim", path.read_bytes(), root="a.pdeanim")
    assert opened(path).GetPrimAtPath("/mesh")
    assert "has no layer of USD 'a.pdeanim'" in capfd.readouterr().err


BOMBS: dict[str, tuple[str, dict[str, Any]]] = {
    "a long layer": (GOOD + "#" * (10 << 20), {}),
    "references to references": (
        GOOD
        + "".join(
            f'class "c{i}" {{\n def "a" (references = </c{i + 1}>) {{}}\n def "b" (references = </c{i + 1}>) {{}}\n}}\n'
            for i in range(12)
        )
        + 'class "c12" {}\ndef "all" (references = </c0>) {}\n',
        {},
    ),
    "a long list": (GOOD, {"companions": [[]] * 50000}),
    "one array many times": (
        GOOD.replace("    point3f", "".join(f"    int[] x{i}\n" for i in range(300)) + "    point3f"),
        {"triangles": 3000, "arrays": [["a.usda", f"/mesh.x{i}", 0, "faceVertexIndices", ""] for i in range(300)]},
    ),
}


@pytest.mark.parametrize("name", BOMBS)
def test_a_scene_is_shown_within_the_memory_limit(tmp_path: Path, name: str, capfd: pytest.CaptureFixture[str]) -> None:
    layer, options = BOMBS[name]
    assert opened(hostile(tmp_path / "a.pdeanim", layer, **options), memory=8).GetPrimAtPath("/mesh")
    assert "more memory than the memory limit allows" in capfd.readouterr().err


def test_damage_in_a_scene_is_named(shot: Path, tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    with pdecodec.open(shot) as animation:
        first = shot.stat().st_size - sum(len(one.packed) for one in animation.carried.streams)
    data, path, named = shot.read_bytes(), tmp_path / "damaged.pdeanim", 0
    for place in range(first - 60, len(data), 12):
        path.write_bytes(data[:place] + bytes([data[place] ^ 255]) + data[place + 1 :])
        message = message_of(path, partial(opened, path)) or capfd.readouterr().err
        named += f"{path}: " in message and "SCEN" in message
    # Textures are read when they are shown.
    assert named > 20
