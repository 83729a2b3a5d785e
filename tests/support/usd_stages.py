"""Small USD stages: a triangle, a skeleton and the prims that it moves."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt


def stage_at(path: Path, *, rate: float | None = 24.0) -> Usd.Stage:
    stage = Usd.Stage.CreateNew(str(path))
    if rate is not None:
        stage.SetTimeCodesPerSecond(rate)
    return stage


def triangle(stage: Usd.Stage, path: str) -> UsdGeom.Mesh:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.CreatePointsAttr([(0, 0, 0), (1, 0, 0), (0, 1, 0)])
    mesh.CreateFaceVertexCountsAttr([3])
    mesh.CreateFaceVertexIndicesAttr([0, 1, 2])
    return mesh


def skeleton_of(stage: Usd.Stage, *joints: str) -> UsdSkel.Skeleton:
    """Make joints at the origin, below a root of skinned prims."""
    skeleton = UsdSkel.Skeleton.Define(stage, "/root/skeleton")
    skeleton.CreateJointsAttr(joints)
    for create in (skeleton.CreateBindTransformsAttr, skeleton.CreateRestTransformsAttr):
        create(Vt.Matrix4dArray([Gf.Matrix4d(1)] * len(joints)))
    return skeleton


def animation_of(stage: Usd.Stage, skeleton: UsdSkel.Skeleton, *joints: str) -> UsdSkel.Animation:
    """Make an animation whose joints neither rotate nor scale."""
    animation = UsdSkel.Animation.Define(stage, "/root/skeleton/animation")
    animation.CreateJointsAttr(joints)
    animation.CreateRotationsAttr([Gf.Quatf(1)] * len(joints))
    animation.CreateScalesAttr([(1, 1, 1)] * len(joints))
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return animation


def bound_to(skeleton: UsdSkel.Skeleton, shape: Any, *weights: Sequence[float]) -> UsdSkel.BindingAPI:
    """Bind the points of a shape to all joints, with weights for each point."""
    binding, joints = UsdSkel.BindingAPI.Apply(shape.GetPrim()), len(weights[0])
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateJointIndicesPrimvar(False, joints).Set([*range(joints)] * len(weights))
    binding.CreateJointWeightsPrimvar(False, joints).Set([one for row in weights for one in row])
    return binding


SHOT = """#usda 1.0
(
    customLayerData = { string studio = "ours" }
    defaultPrim = "Root"
    endTimeCode = 3
    metersPerUnit = 0.01
    startTimeCode = 1
    subLayers = [@./layers/look.usda@, @layers/motion.usda@]
    timeCodesPerSecond = 24
    upAxis = "Z"
)
def Xform "Root" (kind = "assembly")
{
    def Camera "Eye"
    {
        float focalLength.timeSamples = { 1: 35, 3: 50 }
    }
    def Mesh "Sheet" (customData = { int edition = 3 })
    {
        uniform token orientation = "leftHanded"
        uniform token subdivisionScheme = "none"
        int[] faceVertexCounts = [4, 3]
        int[] faceVertexIndices = [0, 1, 2, 3, 2, 1, 4]
        texCoord2f[] primvars:st = [(0, 0), (1, 0), (1, 1), (0.125, 1), (0.3, 0.7)] (interpolation = "faceVarying")
        int[] primvars:st:indices = [0, 1, 2, 3, 2, 1, 4]
        float[] primvars:heat (interpolation = "vertex")
        float[] primvars:heat.timeSamples = { 1: [1, 2, 3, 4, 5], 3: [2, 3, 4, 5, 6.5] }
        custom string note = "by hand"
        vector3f[] velocities.timeSamples = { 1: [(0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1), (0, 0, 1)] }
        rel material:binding = </Root/Look>
    }
    def Xform "Still" (references = @parts/box.usda@</Box>)
    {
        double3 xformOp:translate = (0, 0, 5)
        uniform token[] xformOpOrder = ["xformOp:translate"]
    }
}
"""

LOOK = """#usda 1.0
over "Root"
{
    def Material "Look"
    {
        token outputs:surface.connect = </Root/Look/Image.outputs:rgb>
        def Shader "Image"
        {
            uniform token info:id = "UsdUVTexture"
            asset inputs:file = @../wood.png@
            float3 outputs:rgb
        }
    }
}
"""

MOTION = """#usda 1.0
over "Root"
{
    over "Sheet"
    {
        point3f[] points.timeSamples = {
            1: [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0), (2, 0, 0)],
            2: [(0, 0, 0), (1, 0, 1), (1, 1, 0), (0, 1, 0), (2, 0, 1)],
            3: [(0, 0, 1), (1, 0, 2), (1, 1, 0), (0, 1, 0), (2, 0, 1)],
        }
    }
}
"""

BOX = """#usda 1.0
def Mesh "Box"
{
    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]
    int[] faceVertexCounts = [3]
    int[] faceVertexIndices = [0, 1, 2]
}
"""


def usd_shot(folder: Path, name: str) -> Path:
    """Write a stage of several layers; with the extension of packages, as a package."""
    from pxr import Sdf, UsdUtils

    for file, text in (
        ("a.usda", SHOT),
        ("layers/look.usda", LOOK),
        ("layers/motion.usda", MOTION),
        ("parts/box.usda", BOX),
    ):
        (folder / file).parent.mkdir(parents=True, exist_ok=True)
        (folder / file).write_text(text)
    (folder / "wood.png").write_bytes(b"a picture")
    path = folder / name
    if path.suffix == ".usdz":
        assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(folder / "a.usda")), str(path))
    elif path.name != "a.usda":
        assert Sdf.Layer.FindOrOpen(str(folder / "a.usda")).Export(str(path))
    return path
