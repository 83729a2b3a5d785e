"""Walk through a USD stage: find shapes that can be read, one for each instance, and note what is refused or hidden."""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pdecodec.formats.base.scene_reading import MAX_INSTANCED_VERTICES
from pdecodec.formats.usd.implicit import IMPLICIT_TYPES, Implicit
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

_OPENERS = (
    (UsdGeom.TetMesh, open_tets),
    (UsdGeom.Mesh, open_mesh),
    (UsdGeom.BasisCurves, open_curves),
    (UsdGeom.Points, open_points),
)
"""Functions that open prims, by their type."""

_PURPOSES = ("default", "render")
"""Purposes of prims that are read; proxies and guides duplicate the prims they stand for."""


def shapes_of(stage: Any, scan: ShapeScan) -> list[UsdShape]:
    """Return the shapes of a stage."""
    shapes = _shapes_below(stage.GetPseudoRoot(), find_skinning(stage), scan)
    counts = Counter(shape.prim.GetTypeName() for shape in shapes if isinstance(shape.points, Implicit))
    scan.refusals.tessellated.update(counts)
    return shapes


def shapes_again(shapes: Sequence[UsdShape], scan: ShapeScan) -> list[UsdShape]:
    """Return the shapes at the time code of another scan, without shapes that have no vertices at that time."""
    found: list[UsdShape] = []
    for shape in shapes:
        opened: UsdShape | None = shape
        open_prim = _opener(shape.prim) if shape.described_at else None
        if open_prim is not None:
            opened = open_prim(shape.prim, shape.name, scan, shape.skinning)
        if opened is not None and opened.connectivity.vertex_count:
            opened.hidden = shape.hidden
            found.append(opened)
    return found


def _opener(prim: Any) -> Callable[[Any, str, ShapeScan, Skinning | None], UsdShape | None] | None:
    """Return the function that opens prims of this type; None if there is none."""
    if str(prim.GetTypeName()) in IMPLICIT_TYPES:
        return open_implicit
    return next((open_prim for schema, open_prim in _OPENERS if prim.IsA(schema)), None)


def _shapes_below(root: Any, skinned: Mapping[str, Skinning], scan: ShapeScan) -> list[UsdShape]:
    """Return the shapes at and below a prim; those of instancers once for each instance."""
    shapes: list[UsdShape] = []
    # Prototypes may be below prims that no layer defines, which keeps them from being drawn themselves.
    predicate = Usd.PrimIsActive & Usd.PrimIsLoaded if scan.within else Usd.PrimDefaultPredicate
    prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies(predicate)))
    for prim in prims:
        name = object_name(prim, scan.names)
        imageable = UsdGeom.Imageable(prim)
        skinning = skinned.get(str(prim.GetPath()))
        if imageable and prim.IsA(UsdGeom.Gprim) and imageable.ComputePurpose() not in _PURPOSES:
            scan.refusals.others[f"prim of purpose {imageable.ComputePurpose()}"] += 1
        elif prim.IsA(UsdGeom.PointInstancer):
            # Prototypes below an instancer are drawn only by it.
            prims.PruneChildren()
            shapes += _instances(prim, name, skinned, scan)
        elif (open_prim := _opener(prim)) is not None:
            opened = open_prim(prim, name, scan, skinning)
            # Shapes whose connectivity changes contribute times even if they are empty at first.
            if opened is not None and (opened.connectivity.vertex_count or opened.described_at):
                opened.hidden = _is_hidden(prim, scan.hidden)
                shapes.append(opened)
        elif prim.IsA(UsdGeom.Gprim):
            scan.refusals.refuse(
                name, f"the type {prim.GetTypeName()}, which is no mesh, curve or point set; convert it"
            )
    return shapes


def _instances(prim: Any, name: str, skinned: Mapping[str, Skinning], scan: ShapeScan) -> list[UsdShape]:
    """Return a shape for each instance and each shape of its prototype."""
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
    if vertices > MAX_INSTANCED_VERTICES:
        refusals.refuse(
            name, f"instances of {vertices:,} vertices, more than {MAX_INSTANCED_VERTICES:,}; thin them out"
        )
        return []
    shapes = []
    for number in numbers:
        of_prototype = object_name(instancer.root(number), scan.names)
        for one in found[int(instancer.prototypes[number])]:
            inner = f"{name}/{number}{one.name.removeprefix(of_prototype)}"
            hidden = one.hidden or bool(instancer.hidden[number])
            instances = (*one.instances, (instancer, number))
            shapes.append(dataclasses.replace(one, name=inner, instances=instances, hidden=hidden))
    return shapes


def _is_hidden(prim: Any, known: dict[Any, bool]) -> bool:
    """Return whether a prim or an ancestor is invisible, always or at times; `known` caches results by path."""
    unknown, found = [], False
    while prim and not prim.IsPseudoRoot():
        if prim.GetPath() in known:
            found = known[prim.GetPath()]
            break
        unknown.append(prim)
        prim = prim.GetParent()
    for below in reversed(unknown):
        visibility = UsdGeom.Imageable(below).GetVisibilityAttr() if below.IsA(UsdGeom.Imageable) else None
        if not found and visibility and visibility.HasAuthoredValue():
            codes = [Usd.TimeCode(code) for code in visibility.GetTimeSamples()] or [Usd.TimeCode.Default()]
            found = any(visibility.Get(code) == UsdGeom.Tokens.invisible for code in codes)
        known[below.GetPath()] = found
    return found
