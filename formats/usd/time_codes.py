"""Collect the time codes at which a USD scene is sampled: points, their skinning, and the transforms above them."""

from __future__ import annotations

from collections.abc import Hashable, Sequence
from typing import Any

import numpy as np
from pxr import UsdGeom

from pdecodec.formats.usd.implicit import Implicit
from pdecodec.formats.usd.shapes import UsdShape
from pdecodec.formats.usd.values import spline_codes
from pdecodec.mesh.arrays import Float64Array


class TimeCodes:
    """Time codes at which shapes of a stage are sampled; prims that several shapes share are visited once.

    Attributes
    ----------
    straight, curved : list of (codes,) float64
        Between codes of `straight`, points move in straight lines; between codes of `curved` they may not.
    """

    def __init__(self, shapes: Sequence[UsdShape]) -> None:
        self.straight: list[Float64Array] = []
        self.curved: list[Float64Array] = []
        self._seen: set[Hashable] = set()
        for shape in shapes:
            self._add_shape(shape)

    def _is_new(self, *key: Hashable) -> bool:
        is_new = key not in self._seen
        self._seen.add(key)
        return is_new

    def _add(self, codes: Sequence[float], *, straight: bool) -> None:
        if len(codes):
            (self.straight if straight else self.curved).append(np.asarray(codes, np.float64))

    def _add_shape(self, shape: UsdShape) -> None:
        if self._is_new("points", shape.prim.GetPath()):
            self._add(shape.points.GetTimeSamples(), straight=True)
            self._add(shape.described_at, straight=True)
            for one in shape.fields:
                self._add(one.times, straight=True)
            if isinstance(shape.points, Implicit):
                self._add(shape.points.spline_codes(shape.prim.GetStage()), straight=False)
        skinning = shape.skinning
        if skinning is not None and self._is_new("skinning", skinning.sampled_by, skinning.is_linear):
            self._add(skinning.time_codes(), straight=skinning.is_linear)
        prim = shape.placed_by
        for instancer, instance in shape.instances:
            if self._is_new("instancer", instancer.prim.GetPath()):
                self._add(instancer.arrays.GetPositionsAttr().GetTimeSamples(), straight=True)
                for attribute in instancer.turning:
                    self._add(attribute.GetTimeSamples(), straight=False)
            self._add_transforms(prim, instancer.root(instance))
            prim = instancer.prim
        self._add_transforms(prim)

    def _add_transforms(self, prim: Any, last: Any = None) -> None:
        """Add the codes of the transforms of a prim and its ancestors, up to `last` if it is given."""
        end = None if last is None else last.GetPath()
        while prim and not prim.IsPseudoRoot() and self._is_new("transform", prim.GetPath(), end):
            xformable = UsdGeom.Xformable(prim)
            if xformable:
                steps = xformable.GetOrderedXformOps()
                moving = [op for op in steps if op.GetNumTimeSamples() > 1]
                shifts = all(op.GetOpType() == UsdGeom.XformOp.TypeTranslate for op in moving)
                self._add(xformable.GetTimeSamples() if steps else (), straight=shifts)
                for op in steps:
                    self._add(spline_codes(op.GetAttr(), prim.GetStage()), straight=False)
                if xformable.GetResetXformStack():
                    break
            if prim == last:
                break
            prim = prim.GetParent()
