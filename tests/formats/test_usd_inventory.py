"""The inventory of USD stages lists everything in them, and a note names everything that is dropped."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from pdecodec.cli.main import run
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from tests.support.scene_cases import SPACE, scene

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Sdf, Usd

from pdecodec.formats.usd.inventory import Fate
from pdecodec.formats.usd.reader import inventory_of

FILES = ("files/usd/*", "interop/usd/*", "reports/*/*.usd*", "fields/*/*.usd*")

SHOP = """#usda 1.0
(
    "for the shop"
    customLayerData = { string creator = "hand" }
    defaultPrim = "shop"
    upAxis = "Y"
    renderSettingsPrimPath = "/Render"
)
def Xform "shop" (
    kind = "component"
    assetInfo = { string name = "shop" }
    prepend variantSets = "look"
    variants = { string look = "new" }
)
{
    color3f[] primvars:displayColor = [(1, 0, 0)]
    string userProperties:owner = "me"
    variantSet "look" = {
        "new" {
            def Xform "sign" {}
        }
        "old" {
        }
    }
    def Mesh "cup" (
        prepend apiSchemas = ["MaterialBindingAPI", "PhysicsRigidBodyAPI"]
        customData = { int batch = 3 }
        displayName = "the cup"
    )
    {
        uniform bool doubleSided = 1
        float3[] extent = [(0, 0, 0), (1, 1, 0)]
        float[] creaseSharpnesses = [2]
        int[] creaseIndices = [0, 1]
        int[] creaseLengths = [2]
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        uniform token interpolateBoundary = "edgeAndCorner"
        uniform token faceVaryingLinearInterpolation = "none"
        point3f[] points.timeSamples = { 0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 1: [(0, 0, 0), (1, 0, 0), (0, 1, 1)] }
        vector3f[] velocities = [(0, 0, 0), (0, 0, 0), (0, 0, 24)]
        vector3f[] accelerations = [(0, 0, 0), (0, 0, 0), (0, 0, 0)]
        float[] primvars:heat.timeSamples = { 0: [1], 1: [2] }
        string[] primvars:label.timeSamples = { 0: ["a"], 1: ["b"] }
        float[] primvars:kept = [5]
        float temperature.timeSamples = { 0: 1, 1: 2 }
        rel proxyPrim = </shop/stand>
        rel material:binding = </shop/glaze>
        rel material:binding:preview = </shop/bare>
        def GeomSubset "rim" {
            uniform token elementType = "face"
            int[] indices = [0]
        }
    }
    def Points "dust" {
        point3f[] points = [(0, 0, 0)]
        int64[] ids = [7]
        float[] widths = [0.5]
    }
    def Mesh "stand" {
        uniform token purpose = "proxy"
        int[] faceVertexCounts = []
        int[] faceVertexIndices = []
        point3f[] points = []
    }
    def Mesh "nothing" {
    }
    def Material "glaze" {
        float inputs:wet = 1
        token outputs:surface.connect = </shop/glaze/paint.outputs:surface>
        def Shader "paint" {
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor.connect = </shop/glaze/picture.outputs:rgb>
            token outputs:surface
        }
        def Shader "picture" {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @./a folder/cup.png@
            float3 outputs:rgb
        }
    }
    def Material "bare" {
    }
    def Material "unused" {
    }
    def Skeleton "bones" {
        uniform token[] joints = ["a"]
    }
    def Xform "hook" {
    }
    def Scope "props" {
        def Camera "front" {
            float focalLength.timeSamples = { 0: 20, 1: 40 }
        }
        def DomeLight "sky" {
            asset inputs:texture:file = @sky.exr@
        }
    }
    def NurbsPatch "patch" {
        uniform token uForm = "open"
    }
    def Mesh "off" (
        active = false
    )
    {
    }
}
over "ghost" {
    int x = 3
}
class "_kind" {
    int y = 3
}
"""


def listing(path: Path) -> set[tuple[str, str]]:
    """Return the prims, properties and metadata of a stage, found through its layers alone."""
    layer = Usd.Stage.Open(str(path)).Flatten(addSourceFileComment=False)
    found: set[tuple[str, str]] = set()

    def visit(spec_path: Any) -> None:
        spec = layer.GetObjectAtPath(spec_path)
        if spec_path == Sdf.Path.absoluteRootPath or spec_path.IsPrimPath():
            found.update((str(spec_path), key) for key in spec.ListInfoKeys())
        if spec_path.IsPrimPath() or spec_path.IsPropertyPath():
            found.add((str(spec_path), ""))

    layer.Traverse("/", visit)
    return found


def assert_complete(path: Path) -> None:
    """Check that the inventory lists everything, and that notices name everything that is dropped."""
    inventory = inventory_of(path)
    items = {(item.path, item.key) for item in inventory.items}
    for held in listing(path):
        assert held in items, held
    with open_sequence(path, skip_unsupported=True) as read:
        told = "\n".join(read.notices)
    for item in inventory.items:
        if item.fate == Fate.DROPPED:
            assert item.word, item
            assert item.word in told, item


@pytest.mark.data
@pytest.mark.parametrize("pattern", FILES)
def test_everything_in_shared_files_is_listed_and_losses_are_noted(shared_data: Path, pattern: str) -> None:
    paths = sorted(path for path in shared_data.glob(pattern) if path.parent.name != "24")
    assert paths
    for path in paths:
        assert_complete(path)


def test_everything_in_a_stage_is_listed_and_losses_are_noted(tmp_path: Path) -> None:
    path = tmp_path / "shop.usda"
    path.write_text(SHOP)
    assert_complete(path)
    with open_sequence(path, skip_unsupported=True) as read:
        assert [item.name for item in read.objects] == ["shop/cup", "shop/dust"]
        told = {line.partition(":")[0]: line for line in read.notices[1:]}
        assert read.notices[0] == (
            "not kept: 2 textures of 'cup.png', 'sky.exr'; writing the motion onto this file keeps them"
        )
    line = told["not kept"]
    for word in (
        "label (it changes with time)",
        "creases",
        "Mesh 'shop/nothing'",
        "Camera 'shop/props/front'",
        "DomeLight 'shop/props/sky'",
        "Material 'shop/bare', 'shop/unused'",
        "Skeleton 'shop/bones'",
        "prims without geometry 'shop/sign', 'shop/hook'",
        "inactive prims 'shop/off'",
        "prims that are not defined 'ghost'",
        "temperature (it changes with time)",
        "doubleSided",
        "widths",
        "userProperties:owner",
        "relationships (material:binding:preview, proxyPrim)",
        "API schemas (PhysicsRigidBodyAPI)",
        "metadata of prims (assetInfo, kind, customData:batch, displayName)",
        "variants that are not selected (look=old)",
        "shaders (UsdPreviewSurface, UsdUVTexture)",
        "properties of materials (inputs:wet, outputs:surface)",
        "renderSettingsPrimPath",
        "customLayerData:creator",
    ):
        assert word in line, word
    for word in ("kept,", "extent", "interpolateBoundary", "glaze", "GeomSubset", "(ids", " ids"):
        assert word not in line.replace("not kept", ""), word


def test_encode_and_info_tell_once_what_is_dropped(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "x.usda").write_text(SHOP.replace("NurbsPatch", "Xform"))
    for command in (
        ["info", str(tmp_path / "x.usda")],
        ["encode", "--scene", "drop", str(tmp_path / "x.usda"), str(tmp_path / "x.pdeanim")],
    ):
        assert run(command) == 0
        said = capsys.readouterr().err
        assert said.count("Camera 'shop/props/front'") == 1
        assert said.count("cup.png") == 1


def test_a_stage_without_geometry_is_refused_with_its_contents(tmp_path: Path) -> None:
    (tmp_path / "x.usda").write_text('#usda 1.0\ndef Camera "a" {}\ndef DomeLight "b" {}\ndef Camera "c" {}\n')
    with pytest.raises(InputError, match="no mesh, curve or point animation: there are 2 Cameras, 1 DomeLight"):
        open_sequence(tmp_path / "x.usda")


def test_nothing_is_dropped_of_what_we_write(tmp_path: Path) -> None:
    write_sequence(scene(**SPACE), tmp_path / "x.usdc")
    assert {item.fate for item in inventory_of(tmp_path / "x.usdc").items} <= {Fate.CODED, Fate.COMPOSED, Fate.COMPUTED}
    with open_sequence(tmp_path / "x.usdc") as read:
        assert read.notices == ()
