"""Apply UsdSkel: joints and blend shapes that deform the points of prims."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Usd, UsdSkel, Vt

from pdecodec.errors import damaged
from pdecodec.mesh.arrays import Float32Array


class Skinning:
    """UsdSkel's blend shapes and joints that deform one prim."""

    def __init__(self, query: Any, skeleton: Any) -> None:
        self._query, self._skeleton = query, skeleton
        self.skeleton_prim = skeleton.GetPrim()
        self._animation = skeleton.GetAnimQuery()
        self._shapes = None
        if query.HasBlendShapes() and self._animation:
            self._shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(query.GetPrim()))
            self._shape_indices = self._shapes.ComputeBlendShapePointIndices()
            self._shape_offsets = self._shapes.ComputeSubShapePointOffsets()

    @property
    def is_linear(self) -> bool:
        """Whether points move in straight lines between the codes at which the animation is sampled."""
        shapes = self._shapes
        return not self.has_joints and shapes is not None and shapes.GetNumSubShapes() == shapes.GetNumBlendShapes()

    @property
    def has_joints(self) -> bool:
        """Whether deformed points are in the skeleton's space."""
        return bool(self._query.HasJointInfluences())

    @property
    def paths(self) -> set[str]:
        """Paths of the prims that deform: skeleton, animation, blend shapes."""
        binding = UsdSkel.BindingAPI(self._query.GetPrim())
        shapes = binding.GetBlendShapeTargetsRel().GetForwardedTargets() if self._shapes is not None else []
        animation = [self._animation.GetPrim().GetPath()] if self._animation else []
        return {str(path) for path in (self.skeleton_prim.GetPath(), *animation, *shapes)}

    @property
    def sampled_by(self) -> tuple[str, bool]:
        """Path of the animation, and whether it drives blend shapes, which together determine its time codes."""
        return str(self._animation.GetPrim().GetPath()) if self._animation else "", self._shapes is not None

    def time_codes(self) -> list[float]:
        """Return the time codes at which the animation is sampled."""
        if not self._animation:
            return []
        codes = list(self._animation.GetJointTransformTimeSamples())
        if self._shapes is not None:
            codes += self._animation.GetBlendShapeWeightTimeSamples()
        return codes

    def deform(self, points: Float32Array, code: float) -> Float32Array:
        """Deform points (vertices, 3), at rest in the prim's space, as they are at a time code.

        The result is in the skeleton's space if :attr:`has_joints`, else in the prim's.
        """
        moved = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points))
        if self._shapes is not None:
            weights = self._animation.ComputeBlendShapeWeights(code)
            mapper = self._query.GetBlendShapeMapper()
            if mapper is not None and not mapper.IsIdentity():
                weights = mapper.Remap(weights, Vt.FloatArray(self._shapes.GetNumBlendShapes()))
            sub_weights, shapes, sub_shapes = self._shapes.ComputeSubShapeWeights(weights)
            self._shapes.ComputeDeformedPoints(
                sub_weights, shapes, sub_shapes, self._shape_indices, self._shape_offsets, moved
            )
        if self.has_joints and not self._query.ComputeSkinnedPoints(
            self._skeleton.ComputeSkinningTransforms(code), moved, code
        ):
            path = self._query.GetPrim().GetPath()
            raise damaged(f"the joints of {path} do not fit its {len(points)} points; export the file again")
        return np.array(moved, np.float32)


def find_skinning(stage: Any) -> dict[str, Skinning]:
    """Return the skinning of each skinned prim of a stage, by the prim's path."""
    cache = UsdSkel.Cache()
    predicate = Usd.TraverseInstanceProxies()
    found = {}
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), predicate):
        if not prim.IsA(UsdSkel.Root):
            continue
        root = UsdSkel.Root(prim)
        cache.Populate(root, predicate)
        for binding in cache.ComputeSkelBindings(root, predicate):
            skeleton = cache.GetSkelQuery(binding.GetSkeleton())
            for query in binding.GetSkinningTargets():
                if skeleton and (query.HasJointInfluences() or query.HasBlendShapes()):
                    found[str(query.GetPrim().GetPath())] = Skinning(query, skeleton)
    return found
