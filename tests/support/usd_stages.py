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
