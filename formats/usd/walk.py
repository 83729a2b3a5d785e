"""The walk through a USD stage: what can be read, instances once for each, and what is refused or hidden."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pdecodec.formats.base.scene_reading import MOST_INSTANCED
from pdecodec.formats.usd.implicit import Implicit, read_implicit
from pdecodec.formats.usd.instances import open_instancer
from pdecodec.formats.usd.metadata import object_name
from pdecodec.formats.usd.shapes import (
    ShapeScan,
    UsdShape,
    change_codes,
    open_curves,
    open_implicit,
    open_mesh,
    open_points,
    open_tets,
)
from pdecodec.formats.usd.skinning import Skinning, find_skinning

_PURPOSES = ("default", "render")
"""Purposes of prims that are read; proxies and guides stand beside what they stand for."""


def shapes_of(stage: Any, scan: ShapeScan) -> list[UsdShape]:
    """Return the shapes of a stage."""
    shapes = _shapes_below(stage.GetPseudoRoot(), find_skinning(stage), scan)
    counts = Counter(shape.prim.GetTypeName() for shape in shapes if isinstance(shape.points, Implicit))
    scan.refusals.tessellated.update(counts)
    return shapes


def _shapes_below(root: Any, skinned: Mapping[str, Skinning], scan: ShapeScan) -> list[UsdShape]:
    """Shapes at and below a prim; those of instancers once for each instance."""
    shapes: list[UsdShape] = []
    # Prototypes may stand below prims that no layer defines, so that they are not drawn themselves.
    predicate = Usd.PrimIsActive & Usd.PrimIsLoaded if scan.within else Usd.PrimDefaultPredicate
    prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(predicate)))
    for prim in prims:
        name = object_name(prim)
        imageable = UsdGeom.Imageable(prim)
        skinning = skinned.get(str(prim.GetPath()))
        opened = None
        if imageable and prim.IsA(UsdGeom.Gprim) and imageable.ComputePurpose() not in _PURPOSES:
            scan.refusals.others[f"prim of purpose {imageable.ComputePurpose()}"] += 1
        elif prim.IsA(UsdGeom.PointInstancer):
            # Prototypes below it stand nowhere by themselves.
            prims.PruneChildren()
            shapes += _instances(prim, name, skinned, scan)
        elif prim.IsA(UsdGeom.TetMesh):
            opened = open_tets(prim, name, scan, skinning)
        elif prim.IsA(UsdGeom.Mesh):
            opened = open_mesh(prim, name, scan, skinning)
        elif prim.IsA(UsdGeom.BasisCurves):
            opened = open_curves(prim, name, scan, skinning)
        elif prim.IsA(UsdGeom.Points):
            opened = open_points(prim, name, scan, skinning)
        elif (implicit := read_implicit(prim)) is not None:
            opened = open_implicit(prim, name, implicit, skinning)
        elif prim.IsA(UsdGeom.Gprim):
            scan.refusals.refuse(
                name, f"the type {prim.GetTypeName()}, which is no mesh, curve or point set; convert it"
            )
        # Times are of all that changes, be it there at first or not.
        if opened is not None and (opened.connectivity.vertex_count or (scan.is_first and opened.described_at)):
            opened.hidden = _is_hidden(prim)
            shapes.append(opened)
    return shapes


def _instances(prim: Any, name: str, skinned: Mapping[str, Skinning], scan: ShapeScan) -> list[UsdShape]:
    """A shape for each instance and each shape of its prototype."""
    arrays, refusals = UsdGeom.PointInstancer(prim), scan.refusals
    changed = change_codes([arrays.GetProtoIndicesAttr(), arrays.GetIdsAttr()], by_size=False)
    if changed:
        refusals.refuse(name, f"instances that come, go or change places at time code {changed[0]:g}")
        return []
    instancer = open_instancer(prim)
    if isinstance(instancer, str):
        refusals.refuse(name, instancer)
        return []
    if prim in scan.within:
        refusals.refuse(name, "a prototype that holds the instancer itself")
        return []
    found: dict[int, list[UsdShape]] = {}
    for number in np.unique(instancer.prototypes[instancer.shown]).tolist():
        root = instancer.roots[number]
        scan.within.append(prim)
        found[number] = _shapes_below(root, skinned, scan)
        scan.within.pop()
        changing = [one for one in found[number] if one.described_at]
        if changing:
            refusals.refuse(name, f"a prototype whose faces or points change ({changing[0].name}); convert it")
            return []
        odd = [
            one for one in found[number] if not one.instances and not one.placed_by.GetPath().HasPrefix(root.GetPath())
        ]
        if odd:
            refusals.refuse(name, f"a prototype whose joints stand outside of it ({odd[0].name}); convert it")
            return []
    numbers = np.flatnonzero(instancer.shown).tolist()
    vertices = sum(one.connectivity.vertex_count for k in numbers for one in found[int(instancer.prototypes[k])])
    if vertices > MOST_INSTANCED:
        refusals.refuse(name, f"instances of {vertices:,} vertices, more than {MOST_INSTANCED:,}; thin them out")
        return []
    shapes = []
    for number in numbers:
        of_prototype = object_name(instancer.root(number))
        for one in found[int(instancer.prototypes[number])]:
            inner = f"{name}/{number}{one.name.removeprefix(of_prototype)}"
            hidden = one.hidden or bool(instancer.hidden[number])
            instances = (*one.instances, (instancer, number))
            shapes.append(dataclasses.replace(one, name=inner, instances=instances, hidden=hidden))
    return shapes


def _is_hidden(prim: Any) -> bool:
    """Whether a prim or one above it is invisible, always or at times."""
    while prim and not prim.IsPseudoRoot():
        visibility = UsdGeom.Imageable(prim).GetVisibilityAttr() if prim.IsA(UsdGeom.Imageable) else None
        if visibility and visibility.HasAuthoredValue():
            codes = [Usd.TimeCode(code) for code in visibility.GetTimeSamples()] or [Usd.TimeCode.Default()]
            if any(visibility.Get(code) == UsdGeom.Tokens.invisible for code in codes):
                return True
        prim = prim.GetParent()
    return False
