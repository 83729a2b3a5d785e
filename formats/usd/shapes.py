"""Open the shapes of USD stages that can be read: meshes, curves, points, implicit shapes and instances.

Faces of left-handed meshes are reversed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

from pdecodec.formats.base.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    GROUP,
    ID,
    MATERIAL,
    SUBDIVISION,
    label_attribute,
    reversed_corners,
)
from pdecodec.formats.base.normals import NORMAL_GROUP
from pdecodec.formats.base.scene_reading import Extras, Refusals, SceneWalk, Shape, fault_of_faces
from pdecodec.formats.base.transforms import mirrors
from pdecodec.formats.usd.attributes import read_directions, read_extras
from pdecodec.formats.usd.implicit import read_implicit
from pdecodec.formats.usd.instances import Instancer
from pdecodec.formats.usd.metadata import OWN
from pdecodec.formats.usd.skinning import Skinning
from pdecodec.formats.usd.values import value_at
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import MAX_INDEX, Connectivity

SUBDIVISION_SCHEMES = {"catmullClark": "catmull-clark", "loop": "loop", "bilinear": "bilinear"}
"""USD's names of subdivision schemes, and pdecodec's."""

_SURFACE_ATTRIBUTES = (GROUP, MATERIAL, NORMAL_GROUP)
"""Attributes that the surface of tetrahedra keeps."""


@dataclass(kw_only=True, eq=False)
class UsdShape(Shape):
    """A prim that can be read, its attribute of points, and the skinning that deforms them."""

    prim: Any
    points: Any
    skinning: Skinning | None
    instances: Sequence[tuple[Instancer, int]] = ()
    """The nested instances that the shape belongs to, innermost first."""
    described_at: Sequence[float] = ()
    """Time codes at which its connectivity is sampled; empty if that is constant."""

    @property
    def is_instance(self) -> bool:
        """Whether others share what is stored of it."""
        return bool(self.instances) or self.prim.IsInstanceProxy()

    @property
    def placed_by(self) -> Any:
        """The prim in whose space the points are."""
        return self.skinning.skeleton_prim if self.skinning is not None and self.skinning.has_joints else self.prim

    def code_within(self, code: float) -> float:
        """Return the code at which to read points: at most that of their last sample with the connectivity at `code`.

        Beyond it, USD would interpolate to the next sample if that has the same number of points.
        """
        later = [other for other in self.described_at if other > code]
        if not later:
            return code
        own = [sample for sample in self.points.GetTimeSamples() if sample < later[0]]
        return min(code, own[-1]) if own else code


class ShapeScan(SceneWalk):
    """State of a walk through a stage; its times are time codes.

    Attributes
    ----------
    within : list of Usd.Prim
        Instancers whose prototypes are being read.
    names, hidden : dict
        Names of prims, and whether they or their ancestors are invisible, by path.
    """

    def __init__(
        self, refusals: Refusals, at: float | None = None, changes: dict[str, Sequence[float]] | None = None
    ) -> None:
        super().__init__(refusals, at, changes)
        self.within: list[Any] = []
        self.names: dict[Any, str] = {}
        self.hidden: dict[Any, bool] = {}

    def look(self, prim: Any, attributes: Sequence[Any], *, by_size: bool = False) -> float | None:
        """Return the code at which to read array attributes of a prim that may change; None for their first values.

        If `by_size`, only a change of their lengths counts as a change.
        """
        path = str(prim.GetPath())
        if self.is_first:
            own = [attribute for attribute in prim.GetAuthoredAttributes() if attribute.GetNamespace() == OWN]
            found = change_codes(attributes, by_size=by_size) + change_codes(own, by_size=False)
            if found:
                self.changes[path] = sorted(set(found))
        if path not in self.changes:
            return None
        return float(Usd.TimeCode.EarliestTime().GetValue()) if self.at is None else self.at

    def described_at(self, prim: Any) -> Sequence[float]:
        """Return the codes at which the connectivity of a prim changes."""
        return self.changes.get(str(prim.GetPath()), ())

    def span(self, prim: Any) -> tuple[float, float]:
        """Return the codes between which a prim has the connectivity that this walk reads."""
        edges = [-np.inf, *self.described_at(prim), np.inf]
        number = 0 if self.at is None else int(np.searchsorted(edges, self.at, side="right")) - 1
        return edges[number], edges[number + 1]


def change_codes(attributes: Sequence[Any], *, by_size: bool) -> list[float]:
    """Return the codes at which one of several array attributes changes."""
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


def open_implicit(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape:
    implicit = read_implicit(prim)
    extras = read_extras(prim, implicit.connectivity, np.arange(implicit.connectivity.face_indices.size))
    extras.attributes.append(implicit.normal_group)
    return UsdShape(
        name=name,
        connectivity=implicit.connectivity,
        attributes=extras.attributes,
        fields=extras.fields,
        left_out=extras.left_out,
        prim=prim,
        points=implicit,
        skinning=skinning,
    )


def _integers(attribute: Any, at: float | None) -> Int32Array:
    """Return the value of an integer array attribute at a time code, or its first value if no code is given.

    The array is empty if the attribute has no value.
    """
    found = value_at(attribute, at)
    return np.zeros(0, np.int32) if found is None else np.array(found, np.int32).reshape(-1)


def _points_alone(schema: Any, at: float | None) -> Connectivity:
    found = value_at(schema.GetPointsAttr(), at)
    return Connectivity(0 if found is None else len(found))


def _moves(schema: Any, skinning: Skinning | None) -> bool:
    """Return whether points move in the shape's own space."""
    return skinning is not None or schema.GetPointsAttr().GetNumTimeSamples() > 1


def open_mesh(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    mesh = UsdGeom.Mesh(prim)
    faces = [mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()]
    at = scan.look(prim, faces)
    counts, indices = (_integers(attribute, at) for attribute in faces)
    if (fault := fault_of_faces(counts, indices)) is not None:
        scan.refusals.refuse(name, fault)
        return None
    _, extras = _read_surface(mesh, counts, indices, scan, skinning, at)
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


def open_tets(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    """Open the surface of tetrahedra as authored, else as USD computes it; every point is kept."""
    tets = UsdGeom.TetMesh(prim)
    authored = tets.GetSurfaceFaceVertexIndicesAttr()
    at = scan.look(prim, [authored, tets.GetTetVertexIndicesAttr()])
    surface = value_at(authored, at)
    if surface is None or not len(surface):
        surface = UsdGeom.TetMesh.ComputeSurfaceFaces(tets, Usd.TimeCode.EarliestTime() if at is None else at)
    indices = np.array(surface, np.int32).reshape(-1)
    triangles = np.full(indices.size // 3, 3, np.int32)
    connectivity, extras = _read_surface(tets, triangles, indices, scan, skinning, at)
    # Data of elements belong to the tetrahedra, not to their surface; only sets of faces are kept.
    inner = [
        one for one in extras.attributes if one.domain in ("face", "corner") and one.name not in _SURFACE_ATTRIBUTES
    ]
    extras.attributes = [one for one in extras.attributes if not any(one is other for other in inner)]
    of_cells = [one for one in extras.fields if one.field.domain in ("face", "corner")]
    extras.fields = [one for one in extras.fields if one not in of_cells]
    extras.left_out += ["tetrahedra (their surface is kept)", *(one.name for one in inner)]
    extras.left_out += [one.field.name for one in of_cells]
    return _shape(name, tets, connectivity, extras, scan, skinning=skinning)


def _read_surface(
    schema: Any, counts: Int32Array, indices: Int32Array, scan: ShapeScan, skinning: Skinning | None, at: float | None
) -> tuple[Connectivity, Extras]:
    """Return the connectivity with left-handed faces reversed, and everything else of the shape in that order."""
    prim = schema.GetPrim()
    turned, mirrored = schema.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded, False
    if skinning is not None and skinning.has_joints:
        # The mesh's own transform decides which side is outside; its points end up in the skeleton's space.
        cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
        own, joints = (cache.GetLocalToWorldTransform(one) for one in (prim, skinning.skeleton_prim))
        mirrored = mirrors([np.array(own * joints, np.float64)])
    order = reversed_corners(counts) if turned ^ mirrored else np.arange(indices.size)
    points = _points_alone(schema, at).vertex_count
    connectivity = Connectivity(points, face_counts=counts, face_indices=indices[order])
    extras = read_extras(
        prim,
        connectivity,
        order,
        scan.span(prim),
        moves=_moves(schema, skinning),
        at=at,
        skinning=skinning,
        mirrored=mirrored,
    )
    return connectivity, extras


def open_curves(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    curves = UsdGeom.BasisCurves(prim)
    at = scan.look(prim, [curves.GetCurveVertexCountsAttr()])
    counts, points = _integers(curves.GetCurveVertexCountsAttr(), at), _points_alone(curves, at)
    if int(counts.sum(dtype=np.int64)) != points.vertex_count or (counts < 1).any():
        scan.refusals.refuse(name, "curves whose numbers of points do not add up")
        return None
    extras = read_extras(prim, points, np.zeros(0, np.int64), scan.span(prim), moves=_moves(curves, skinning), at=at)
    if curves.GetTypeAttr().Get() == UsdGeom.Tokens.cubic:
        basis = str(curves.GetBasisAttr().Get()).lower()
        extras.attributes.append(label_attribute(CURVE_BASIS, f"cubic {basis}"))
    wrap = str(curves.GetWrapAttr().Get())
    if wrap != "nonperiodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, wrap))
    connectivity, gather = extras.curves(counts)
    return _shape(name, curves, connectivity, extras, scan, gather=gather, skinning=skinning)


def open_points(prim: Any, name: str, scan: ShapeScan, skinning: Skinning | None) -> UsdShape | None:
    points = UsdGeom.Points(prim)
    ids = points.GetIdsAttr()
    # If points have no ids and their number changes, they are different points.
    counted = ids.GetNumTimeSamples() < 2
    at = scan.look(prim, [points.GetPointsAttr() if counted else ids], by_size=counted)
    alone = _points_alone(points, at)
    extras = read_extras(prim, alone, np.zeros(0, np.int64), scan.span(prim), moves=_moves(points, skinning), at=at)
    numbers = value_at(ids, at)
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
    for attribute in (schema.GetVelocitiesAttr(), schema.GetAccelerationsAttr()):
        if attribute.HasAuthoredValue():
            read_directions(attribute, extras, scan.span(schema.GetPrim()), is_skinned=skinning is not None)
    return UsdShape(
        name=name,
        connectivity=connectivity,
        attributes=extras.attributes,
        fields=extras.gathered_fields(gather),
        gather=gather,
        left_out=extras.left_out,
        turned=extras.turned,
        prim=schema.GetPrim(),
        points=schema.GetPointsAttr(),
        skinning=skinning,
        described_at=scan.described_at(schema.GetPrim()),
    )
