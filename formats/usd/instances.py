"""USD's point instancers: the placement of each instance of a prototype."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pdecodec.errors import damaged
from pdecodec.formats.base.scene_reading import MAX_INSTANCED_VERTICES
from pdecodec.mesh.arrays import BoolArray, Float64Array, Int64Array

MAX_KEPT_BYTES = 2**28
"""Bytes of transforms that are cached."""


@dataclass(frozen=True, eq=False)
class Instancer:
    """A point instancer.

    Attributes
    ----------
    prim, arrays
        The prim, and its schema.
    roots : tuple
        Root prims of its prototypes.
    prototypes : (instances,) int64
        Index of each instance's prototype.
    shown : (instances,) bool
        Whether the instance is ever visible.
    hidden : (instances,) bool
        Whether the instance is invisible at times.
    """

    prim: Any
    arrays: Any
    roots: tuple[Any, ...]
    prototypes: Int64Array
    shown: BoolArray
    hidden: BoolArray
    _kept: dict[float, Float64Array] = field(default_factory=dict)

    @property
    def turning(self) -> list[Any]:
        """Attributes that move instances along curves."""
        return [self.arrays.GetOrientationsAttr(), self.arrays.GetOrientationsfAttr(), self.arrays.GetScalesAttr()]

    def root(self, instance: int) -> Any:
        """Return the root prim of an instance's prototype."""
        return self.roots[self.prototypes[instance]]

    def placed(self, instance: int, prim: Any, cache: Any) -> Float64Array:
        """Return the matrix (4, 4) from the space of a prim of a prototype to the instancer's, for points that
        are rows.
        """
        inner = np.array(cache.ComputeRelativeTransform(prim, self.root(instance))[0], np.float64)
        placed: Float64Array = inner @ self._at(cache.GetTime())[instance]
        return placed

    def _at(self, code: Any) -> Float64Array:
        """Return each instance's transform, including its prototype's own: (instances, 4, 4)."""
        key = code.GetValue()
        if key not in self._kept:
            if len(self._kept) * self.prototypes.size * 128 > MAX_KEPT_BYTES:
                self._kept.clear()
            include, ignore = UsdGeom.PointInstancer.IncludeProtoXform, UsdGeom.PointInstancer.IgnoreMask
            found = self.arrays.ComputeInstanceTransformsAtTime(code, code, include, ignore)
            if len(found) != self.prototypes.size:
                raise damaged(
                    f"instancer {self.prim.GetPath()} has {len(found)} places for {self.prototypes.size} instances"
                )
            self._kept[key] = np.array(found, np.float64).reshape(-1, 4, 4)
        return self._kept[key]


def placed_in_scene(instances: Sequence[tuple[Instancer, int]], prim: Any, cache: Any) -> Float64Array:
    """Return the matrix (4, 4) from the space of a prim to the scene's, for points that are rows, at a cache's time.

    `instances` are the nested instances that contain the prim: each prototype holds the instancer before it.
    """
    matrix = np.eye(4)
    for instancer, instance in instances:
        matrix = matrix @ instancer.placed(instance, prim, cache)
        prim = instancer.prim
    placed: Float64Array = matrix @ np.array(cache.GetLocalToWorldTransform(prim), np.float64)
    return placed


def open_instancer(prim: Any) -> Instancer | str:
    """Return a prim as an instancer, or a description of the feature that cannot be read."""
    arrays = UsdGeom.PointInstancer(prim)
    stage = prim.GetStage()
    roots = tuple(stage.GetPrimAtPath(path) for path in arrays.GetPrototypesRel().GetForwardedTargets())
    stored = arrays.GetProtoIndicesAttr().Get(Usd.TimeCode.EarliestTime())
    prototypes = np.array(stored if stored is not None else [], np.int64)
    if not all(roots) or (prototypes.size and not 0 <= prototypes.min() <= prototypes.max() < len(roots)):
        return "instances of prototypes that are not there"
    if prototypes.size > MAX_INSTANCED_VERTICES:
        return f"{prototypes.size:,} instances, more than {MAX_INSTANCED_VERTICES:,}; thin them out"
    codes = [Usd.TimeCode(code) for code in arrays.GetInvisibleIdsAttr().GetTimeSamples()]
    masks = [list(arrays.ComputeMaskAtTime(code)) for code in codes or [Usd.TimeCode.EarliestTime()]]
    there = np.array([mask or [True] * prototypes.size for mask in masks], bool).reshape(len(masks), prototypes.size)
    shown, always = np.logical_or.reduce(there), np.logical_and.reduce(there)
    return Instancer(prim, arrays, roots, prototypes, shown, ~always)
