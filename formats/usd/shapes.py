"""Shapes of USD stages that can be read: meshes, curves, points, implicit shapes and instances.

Faces of left-handed meshes are turned around.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pdecodec.formats.base.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    ID,
    SUBDIVISION,
    label_attribute,
    reversed_corners,
)
from pdecodec.formats.base.scene_reading import MOST_INSTANCED, Extras, SceneWalk, Shape, fault_of_faces
from pdecodec.formats.base.scene_space import mirrors
from pdecodec.formats.usd.attributes import read_extras
from pdecodec.formats.usd.implicit import Implicit, read_implicit
from pdecodec.formats.usd.instances import Instancer, open_instancer
from pdecodec.formats.usd.metadata import OWN, object_name
from pdecodec.formats.usd.skinning import Skinning, find_skinning
from pdecodec.formats.usd.values import spline_codes, value_at
from pdecodec.mesh.arrays import Float64Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import MAX_INDEX, Connectivity

SUBDIVISION_SCHEMES = {"catmullClark": "catmull-clark", "loop": "loop", "bilinear": "bilinear"}
"""USD's names of subdivision schemes, and ours."""

_PURPOSES = ("default", "render")
"""Purposes of prims that are read; proxies and guides stand beside what they stand for."""


@dataclass(kw_only=True, eq=False)
class UsdShape(Shape):
    """A prim that can be read, its attribute of points, and what deforms them."""

    prim: Any
    points: Any
    skinning: Skinning | None
    instancer: Instancer | None = None
    instance: int = 0
    described_at: Sequence[float] = ()
    """Time codes at which its connectivity is sampled, where that changes."""

    @property
    def placed_by(self) -> Any:
        """The prim in whose space the points are."""
        return self.skinning.skeleton_prim if self.skinning is not None and self.skinning.has_joints else self.prim

    def code_within(self, code: float) -> float:
        """The code at which points are read: not later than their last sample of the connectivity at `code`.

        USD goes straight on to the next sample where that has as many points.
        """
        later = [other for other in self.described_at if other > code]
        if not later:
            return code
        own = [sample for sample in self.points.GetTimeSamples() if sample < later[0]]
        return min(code, own[-1]) if own else code

    def time_codes(self) -> tuple[list[Float64Array], list[Float64Array]]:
        """Lists of codes at which its points and the transforms above it are sampled.

        Of the first lists, points move in straight lines between codes; of the second they need not.
        """
        straight: list[Any] = [self.points.GetTimeSamples(), self.described_at]
        curved: list[Any] = (
            [self.points.spline_codes(self.prim.GetStage())] if isinstance(self.points, Implicit) else []
        )
        if self.skinning is not None:
            (straight if self.skinning.is_linear else curved).append(self.skinning.time_codes())
        prim = self.placed_by
        if self.instancer is not None:
            straight.append(self.instancer.arrays.GetPositionsAttr().GetTimeSamples())
            curved += [one.GetTimeSamples() for one in self.instancer.turning]
            above_it = self.instancer.prim
            prims = [*_up(prim, self.instancer.roots[self.instancer.prototypes[self.instance]]), *_up(above_it)]
        else:
            prims = _up(prim)
        for prim in prims:
            xformable = UsdGeom.Xformable(prim)
            if xformable:
                steps = xformable.GetOrderedXformOps()
                moving = [op for op in steps if op.GetNumTimeSamples() > 1]
                shifts = all(op.GetOpType() == UsdGeom.XformOp.TypeTranslate for op in moving)
                (straight if shifts else curved).append(xformable.GetTimeSamples())
                curved += [spline_codes(op.GetAttr(), prim.GetStage()) for op in steps]
        first, second = (
            [np.asarray(codes, np.float64) for codes in lists if len(codes)] for lists in (straight, curved)
        )
        return first, second


def _up(prim: Any, last: Any = None) -> list[Any]:
    """A prim and those above it whose transforms place it, up to the last one if that is given."""
    found = []
    while prim and not prim.IsPseudoRoot():
        found.append(prim)
        xformable = UsdGeom.Xformable(prim)
        if prim == last or (xformable and xformable.GetResetXformStack()):
            break
        prim = prim.GetParent()
    return found


class ShapeScan(SceneWalk):
    """A walk through a stage; its times are time codes."""

    def shapes(self, stage: Any) -> list[UsdShape]:
        """The shapes of a stage."""
        shapes = _shapes_below(stage.GetPseudoRoot(), find_skinning(stage), self)
        counts = Counter(shape.prim.GetTypeName() for shape in shapes if isinstance(shape.points, Implicit))
        self.refusals.tessellated.update(counts)
        return shapes

    def look(self, prim: Any, attributes: Sequence[Any], *, by_size: bool = False) -> float | None:
        """The code at which array attributes of a prim that may change are to be read; None for their first values.

        Where they are compared `by_size`, they only change when their lengths do.
        """
        path = str(prim.GetPath())
        if self.is_first:
            own = [attribute for attribute in prim.GetAuthoredAttributes() if attribute.GetNamespace() == OWN]
            found = _change_codes(attributes, by_size=by_size) + _change_codes(own, by_size=False)
            if found:
                self.changes[path] = sorted(set(found))
        if path not in self.changes:
            return None
        return float(Usd.TimeCode.EarliestTime().GetValue()) if self.at is None else self.at

    def described_at(self, prim: Any) -> Sequence[float]:
        """Codes at which the connectivity of a prim changes."""
        return self.changes.get(str(prim.GetPath()), ())


def _change_codes(attributes: Sequence[Any], *, by_size: bool) -> list[float]:
    """Codes from which on one of several array attributes is not what it was before."""
    changed: list[float] = []
    for attribute in attributes:
        before = None
        codes = attribute.GetTimeSamples()
        for code in codes if len(codes) > 1 else ():
            found = attribute.Get(code)
            now = np.array(0 if found is None else len(found)) if by_size else np.asarray(found)
            if before is not None and not np.array_equal(now, before):
                changed.append(code)
            before = now
    return sorted(set(changed))


def _shapes_below(root: Any, skinned: Mapping[str, Skinning], scan: ShapeScan) -> list[UsdShape]:
    """Shapes at and below a prim; those of instancers once for each instance."""
    shapes: list[UsdShape] = []
    prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
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
        elif prim.IsA(UsdGeom.Mesh):
            opened = _open_mesh(prim, name, scan, skinning)
        elif prim.IsA(UsdGeom.BasisCurves):
            opened = _open_curves(prim, name, scan, skinning)
        elif prim.IsA(UsdGeom.Points):
            opened = _open_points(prim, name, scan, skinning)
        elif (implicit := read_implicit(prim)) is not None:
            opened = _open_implicit(prim, name, implicit, skinning)
        elif prim.IsA(UsdGeom.Gprim):
            scan.refusals.refuse(
                name, f"the type {prim.GetTypeName()}, which is no mesh, curve or point set; convert it"
            )
        elif prim.IsA(UsdGeom.Camera):
            scan.refusals.others["camera"] += 1
        # Times are of all that changes, be it there at first or not.
        if opened is not None and (opened.connectivity.vertex_count or (scan.is_first and opened.described_at)):
            opened.hidden = _is_hidden(prim)
            shapes.append(opened)
    return shapes


def _open_implicit(prim: Any, name: str, implicit: Implicit, skinning: Skinning | None) -> UsdShape:
    extras = read_extras(prim, implicit.connectivity, np.arange(implicit.connectivity.face_indices.size))
    extras.attributes.append(implicit.normal_group)
    return UsdShape(
        name=name,
        connectivity=implicit.connectivity,
        attributes=extras.attributes,
        left_out=extras.left_out,
        prim=prim,
        points=implicit,
        skinning=skinning,
    )


def _instances(prim: Any, name: str, skinned: Mapping[str, Skinning], scan: ShapeScan) -> list[UsdShape]:
    """A shape for each instance and each shape of its prototype."""
    arrays, refusals = UsdGeom.PointInstancer(prim), scan.refusals
    changed = _change_codes([arrays.GetProtoIndicesAttr(), arrays.GetIdsAttr()], by_size=False)
    if changed:
        refusals.refuse(name, f"instances that come, go or change places at time code {changed[0]:g}")
        return []
    instancer = open_instancer(prim)
    if isinstance(instancer, str):
        refusals.refuse(name, instancer)
        return []
    found: dict[int, list[UsdShape]] = {}
    for number in np.unique(instancer.prototypes[instancer.shown]).tolist():
        found[number] = _shapes_below(instancer.roots[number], skinned, scan)
        changing = [one for one in found[number] if one.described_at]
        if changing:
            refusals.refuse(name, f"a prototype whose faces or points change ({changing[0].name}); convert it")
            return []
        odd = [one for one in found[number] if one.instancer or (one.skinning is not None and one.skinning.has_joints)]
        if odd:
            refusals.refuse(name, f"a prototype with instances or joints of its own ({odd[0].name}); convert it")
            return []
    numbers = np.flatnonzero(instancer.shown).tolist()
    vertices = sum(one.connectivity.vertex_count for k in numbers for one in found[int(instancer.prototypes[k])])
    if vertices > MOST_INSTANCED:
        refusals.refuse(name, f"instances of {vertices:,} vertices, more than {MOST_INSTANCED:,}; thin them out")
        return []
    shapes = []
    for number in numbers:
        prototype = int(instancer.prototypes[number])
        root = object_name(instancer.roots[prototype])
        for one in found[prototype]:
            inner = f"{name}/{number}{one.name.removeprefix(root)}"
            hidden = one.hidden or bool(instancer.hidden[number])
            shapes.append(dataclasses.replace(one, name=inner, instancer=instancer, instance=number, hidden=hidden))
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


def _integers(attribute: Any, at: float | None) -> Int32Array:
    """An integer array attribute's value at a code, else its first one; empty where it has none."""
    found = value_at(attribute, at)
    return np.zeros(0, np.int32) if found is None else np.array(found, np.int32).reshape(-1)


def _points_alone(schema: Any, at: float | None) -> Connectivity:
    found = value_at(schema.GetPointsAttr(), at)
    return Connectivity(0 if found is None else len(found))


def _moves(schema: Any, skinning: Skinning | None) -> bool:
    """Whether points move in the shape's own space."""
    return skinning is not None or schema.GetPointsAttr().GetNumTimeSamples() > 1


def _open_mesh(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    mesh = UsdGeom.Mesh(prim)
    faces = [mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()]
    at = scan.look(prim, faces)
    counts, indices = (_integers(attribute, at) for attribute in faces)
    if (fault := fault_of_faces(counts, indices)) is not None:
        scan.refusals.refuse(name, fault)
        return None
    turned = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    if skinning is not None and skinning.has_joints:
        # Where the mesh stands itself says which side of it is outside; its points come out where the skeleton stands.
        cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
        own, joints = (cache.GetLocalToWorldTransform(one) for one in (prim, skinning.skeleton_prim))
        turned ^= mirrors([np.array(own * joints, np.float64)])
    order = reversed_corners(counts) if turned else np.arange(indices.size)
    whole = Connectivity(_points_alone(mesh, at).vertex_count, face_counts=counts, face_indices=indices[order])
    extras = read_extras(prim, whole, order, moves=_moves(mesh, skinning), at=at)
    scheme = SUBDIVISION_SCHEMES.get(str(mesh.GetSubdivisionSchemeAttr().Get()))
    if scheme is not None:
        extras.attributes.append(label_attribute(SUBDIVISION, scheme))
    for what, attribute in (
        ("creases", mesh.GetCreaseIndicesAttr()),
        ("corners", mesh.GetCornerIndicesAttr()),
        ("holes", mesh.GetHoleIndicesAttr()),
    ):
        if attribute.HasAuthoredValue() and len(value_at(attribute, None) or ()):
            extras.left_out.append(what)
    return _shape(name, mesh, extras.own_lines("lineCounts", "lineIndices"), extras, scan, skinning=skinning)


def _open_curves(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    curves = UsdGeom.BasisCurves(prim)
    at = scan.look(prim, [curves.GetCurveVertexCountsAttr()])
    counts, points = _integers(curves.GetCurveVertexCountsAttr(), at), _points_alone(curves, at)
    if int(counts.sum(dtype=np.int64)) != points.vertex_count or (counts < 1).any():
        scan.refusals.refuse(name, "curves whose numbers of points do not add up")
        return None
    extras = read_extras(prim, points, np.zeros(0, np.int64), moves=_moves(curves, skinning), at=at)
    if curves.GetTypeAttr().Get() == UsdGeom.Tokens.cubic:
        basis = str(curves.GetBasisAttr().Get()).lower()
        extras.attributes.append(label_attribute(CURVE_BASIS, f"cubic {basis}"))
    wrap = str(curves.GetWrapAttr().Get())
    if wrap != "nonperiodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, wrap))
    connectivity, gather = extras.curves(counts)
    return _shape(name, curves, connectivity, extras, scan, gather=gather, skinning=skinning)


def _open_points(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    points = UsdGeom.Points(prim)
    ids = points.GetIdsAttr()
    # Points without ids are others where there are more of them, or fewer.
    counted = ids.GetNumTimeSamples() < 2
    at = scan.look(prim, [points.GetPointsAttr() if counted else ids], by_size=counted)
    alone = _points_alone(points, at)
    extras = read_extras(prim, alone, np.zeros(0, np.int64), moves=_moves(points, skinning), at=at)
    numbers = None if at is None or counted else ids.Get(at)
    if numbers is not None:
        rows = np.array(numbers, np.int64)
        small = not rows.size or np.abs(rows).max() <= MAX_INDEX
        extras.add(ID, "vertex", rows.astype(np.int32) if small else rows, None)
    return _shape(name, points, extras.own_lines("lineCounts", "lineIndices"), extras, scan, skinning=skinning)


def _shape(
    name: str,
    schema: Any,
    connectivity: Connectivity,
    extras: Extras,
    scan: ShapeScan,
    *,
    gather: Int64Array | None = None,
    skinning: Skinning | None = None,
) -> UsdShape:
    if schema.GetNormalsAttr().HasAuthoredValue() and not connectivity.face_count:
        extras.left_out.append("normals")
    if schema.GetVelocitiesAttr().HasAuthoredValue():
        extras.left_out.append("velocities")
    return UsdShape(
        name=name,
        connectivity=connectivity,
        attributes=extras.attributes,
        gather=gather,
        left_out=extras.left_out,
        prim=schema.GetPrim(),
        points=schema.GetPointsAttr(),
        skinning=skinning,
        described_at=scan.described_at(schema.GetPrim()),
    )
