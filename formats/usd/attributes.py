"""Read the data of a USD prim other than points: primvars, normals, face subsets and materials."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, UsdShade

from pdecodec.formats.base.attribute_roles import COLOR, GROUP, MATERIAL, NORMAL, UV, VECTOR, role_name
from pdecodec.formats.base.normals import SHARED_NORMAL
from pdecodec.formats.base.scene_reading import Extras, first_sample, gathered_rows
from pdecodec.formats.base.stored_normals import StoredNormals, spread
from pdecodec.formats.usd.metadata import DTYPE_KEY, NAME, OWN, UNIT_KEY
from pdecodec.formats.usd.skinning import Skinning
from pdecodec.formats.usd.values import ALWAYS, changes_with_time, codes_within, spline_codes, value_at
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.fields import DTYPES, Field
from pdecodec.mesh.sequence import AttributeDomain, Connectivity

_DOMAINS: dict[str, AttributeDomain] = {
    "constant": "object",
    "uniform": "face",
    "varying": "vertex",
    "vertex": "vertex",
    "faceVarying": "corner",
}

_UV_NAMES = ("st", "uv", "UVMap", "map1")
"""Names of float2 primvars that are UVs, though their type does not say so."""

NORMALS = "normals"
"""Name of the primvar of normals, which takes precedence over the attribute of the same name."""

_APPLIED_PREFIXES = ("skel:",)
"""Prefixes of primvars that are already applied to the points."""


def read_extras(
    prim: Any,
    connectivity: Connectivity,
    order: Int64Array,
    span: tuple[float, float] = ALWAYS,
    *,
    moves: bool = False,
    at: float | None = None,
    skinning: Skinning | None = None,
    mirrored: bool = False,
) -> Extras:
    """Read all data of the prim; `order` as in :class:`Extras`, `moves` tells whether its points move.

    `mirrored` says that the skeleton mirrors the mesh, whose faces are reversed for it.
    Primvars that change between the codes of `span`, in which the connectivity is constant, become fields. If the time
    code `at` is given, everything else is read there.
    """
    extras = Extras(connectivity, order)
    for primvar in UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance():
        if not primvar.HasAuthoredValue():
            continue
        name = str(primvar.GetPrimvarName())
        if not name.startswith(_APPLIED_PREFIXES) and not (name == NORMALS and connectivity.face_count):
            _read_primvar(primvar, name, extras, moves, at, span)
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetNamespace() == OWN:
            extras.own[attribute.GetBaseName()] = np.array(value_at(attribute, at), np.int32)
    if connectivity.face_count:
        _read_normals(UsdGeom.Mesh(prim), extras, at, span, skinning, mirrored=mirrored)
        _read_subsets(prim, extras, at)
    elif _material_name(prim):
        extras.left_out.append("material")
    return extras


def _read_normals(
    mesh: Any,
    extras: Extras,
    at: float | None,
    span: tuple[float, float],
    skinning: Skinning | None,
    *,
    mirrored: bool,
) -> None:
    attribute, interpolation, rows = mesh.GetNormalsAttr(), mesh.GetNormalsInterpolation(), None
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(NORMALS)
    if primvar and primvar.HasAuthoredValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
        rows = primvar.GetIndicesAttr() if primvar.IsIndexed() else None
    domain, points = _DOMAINS.get(str(interpolation), "object"), mesh.GetPointsAttr()
    sides = np.array([-1 if mirrored else 1, 1, 1], np.float32)

    def stored_at(code: float | None) -> StoredNormals | None:
        found = value_at(attribute, code) if attribute.HasAuthoredValue() else None
        if found is None or (code is not None and not len(found)):
            return None
        indices = None if rows is None else np.array(value_at(rows, code), np.int32)
        return StoredNormals(domain, np.array(found, np.float32) * sides, indices)

    def later() -> Iterator[tuple[NDArray[Any], StoredNormals | None]]:
        codes = merged_codes([points, attribute], span)
        codes += [code for code in (skinning.time_codes() if skinning else ()) if span[0] <= code < span[1]]
        codes = sorted(set(codes))
        # Skinned points are elsewhere at the first code, too.
        for code in [*(codes[:1] if skinning else ()), *spread(codes)]:
            places = points.Get(code)
            if places is None or len(places) != extras.connectivity.vertex_count:
                continue
            moved = np.array(places, np.float32)
            if skinning is None:
                # Normals that are not sampled belong to the first points.
                yield moved, stored_at(code) if attribute.GetNumTimeSamples() > 1 else None
            else:
                yield skinning.deform(moved, code), None

    stored, first = stored_at(at), value_at(points, at)
    if stored is not None and first is not None:
        has_shared = any(one.name == SHARED_NORMAL for one in extras.attributes)
        extras.add_normals(stored, np.array(first, np.float32).reshape(-1, 3) * sides, later(), has_shared=has_shared)


def read_directions(attribute: Any, extras: Extras, span: tuple[float, float], *, is_skinned: bool) -> None:
    """Read velocities or accelerations of points; those of skinned points belong to the points before skinning."""
    name = attribute.GetName()
    if is_skinned:
        extras.left_out.append(name)
    else:
        extras.add_field(Field(name, "vertex", components=3), *_values_in_time([attribute], span), place=name)


def _values_in_time(
    attributes: Sequence[Any], span: tuple[float, float], width: int = 1
) -> tuple[Callable[[float], NDArray[Any] | None], list[float]]:
    """Return a function that reads an attribute at a code, through its indices if it has any, and the codes of its
    samples.

    A row consists of `width` elements. Codes after the last sample in the span read that sample, because the next
    one may belong to other faces.
    """
    codes = merged_codes(attributes, span)

    def read_at(code: float) -> NDArray[Any] | None:
        inside = min(code, codes[-1]) if codes and span[1] < np.inf else code
        stored, *indices = (attribute.Get(inside) for attribute in attributes)
        if stored is None or (indices and indices[0] is None):
            return None
        values = np.atleast_1d(np.array(stored))
        values = values.reshape(-1, width) if width > 1 and values.size % width == 0 else values
        if not indices:
            return values
        return gathered_rows(values, np.array(indices[0], np.int64))

    return read_at, codes


def merged_codes(attributes: Sequence[Any], span: tuple[float, float]) -> list[float]:
    """Return the codes in a span at which one of several attributes is sampled, or has a knot of a spline."""
    found = [codes_within(one, span) for one in attributes]
    found += [spline_codes(one, one.GetPrim().GetStage()) for one in attributes]
    return sorted({code for codes in found for code in codes})


def _read_field(primvar: Any, name: str, extras: Extras, span: tuple[float, float]) -> None:
    attribute = primvar.GetAttr()
    read_at, codes = _values_in_time(
        [attribute, *([primvar.GetIndicesAttr()] if primvar.IsIndexed() else [])], span, primvar.GetElementSize()
    )
    first = first_sample(read_at, codes)
    if first is None:
        return
    stored = np.dtype(np.float32) if first.dtype == np.float16 else first.dtype
    told = str(attribute.GetCustomDataByKey(DTYPE_KEY) or "")
    dtype = next((one for one in DTYPES if one.name == told), stored)
    if stored not in DTYPES:
        extras.left_out.append(f"{name} (it changes with time)")
        return
    own = attribute.GetCustomDataByKey(NAME) or field_name(name, primvar.GetTypeName())
    domain = _DOMAINS.get(str(primvar.GetInterpolation()), "object")
    unit = str(attribute.GetCustomDataByKey(UNIT_KEY) or "")
    indices = primvar.GetIndicesAttr() if primvar.IsIndexed() else None
    extras.add_field(
        Field(str(own), domain, dtype, 1, unit),
        read_at,
        codes,
        place=attribute.GetName(),
        rows_at=None if indices is None else lambda code: np.array(indices.Get(code), np.int64),
    )


def field_name(name: str, type_name: Any) -> str:
    """Return the name of the field that a primvar becomes."""
    directions = {Sdf.ValueRoleNames.Vector: VECTOR, Sdf.ValueRoleNames.Normal: NORMAL}
    return f"{directions[type_name.role]}:{name}" if type_name.role in directions else _attribute_name(name, type_name)


def _is_uv(name: str, type_name: Any) -> bool:
    is_float2 = type_name == Sdf.ValueTypeNames.Float2Array
    return type_name.role == Sdf.ValueRoleNames.TextureCoordinate or (is_float2 and name in _UV_NAMES)


def _attribute_name(name: str, type_name: Any) -> str:
    if _is_uv(name, type_name):
        return role_name(UV, name, ("st",))
    return role_name(COLOR, name, ("displayColor",)) if type_name.role == Sdf.ValueRoleNames.Color else name


def _read_primvar(
    primvar: Any, name: str, extras: Extras, moves: bool, at: float | None, span: tuple[float, float]
) -> None:
    type_name = primvar.GetTypeName()
    indices_of = primvar.GetIndicesAttr() if primvar.IsIndexed() else None
    is_field = primvar.GetAttr().HasCustomDataKey(DTYPE_KEY)
    if is_field or any(changes_with_time(one, span) for one in (primvar.GetAttr(), indices_of) if one):
        _read_field(primvar, name, extras, span)
        return
    if moves and type_name.role == Sdf.ValueRoleNames.Normal:
        extras.left_out.append(f"{name} (normals that would stand still)")
        return
    stored = value_at(primvar.GetAttr(), at)
    if at is not None and not np.size(stored):
        # Only other runs of frames have this primvar.
        return
    labels: tuple[str, ...] = ()
    if type_name.scalarType in (Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.Token):
        texts = [stored] if isinstance(stored, str) else list(stored or ())
        labels, values = tuple(map(str, texts)), np.arange(len(texts), dtype=np.int32)
    else:
        values = np.atleast_1d(np.array(stored))
    if values.dtype == np.float16:
        values = values.astype(np.float32)
    if values.dtype not in (np.float32, np.float64, np.int32, np.int64, np.uint8) or values.ndim > 2:
        extras.left_out.append(name)
        return
    wanted = _attribute_name(name, type_name)
    has_main = _is_uv(name, type_name) and any(one.name == wanted for one in extras.attributes)
    name = f"{UV}:{name}" if has_main else wanted
    indices = None if indices_of is None else np.array(value_at(indices_of, at), np.int32)
    extras.add(name, _DOMAINS.get(str(primvar.GetInterpolation()), "object"), values, indices, labels)


def _read_subsets(prim: Any, extras: Extras, at: float | None) -> None:
    found: list[tuple[str, str, NDArray[np.integer]]] = []
    faces = extras.connectivity.face_count
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        name = str(subset.GetPrim().GetCustomDataByKey(NAME) or subset.GetPrim().GetName())
        members = np.array(value_at(subset.GetIndicesAttr(), at) or [], np.int64)
        if at is None and changes_with_time(subset.GetIndicesAttr()):
            extras.left_out.append(f"changes of subset {name} with time (its first sample is kept)")
        if at is not None and not members.size:
            # Only other runs of frames have this set.
            continue
        inside = not members.size or 0 <= members.min() <= members.max() < faces
        if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face or not inside:
            extras.left_out.append(f"subset {name}")
        elif str(subset.GetFamilyNameAttr().Get() or "") == UsdShade.Tokens.materialBind:
            found.append((MATERIAL, _material_name(subset.GetPrim()) or name, members))
        else:
            found.append((GROUP, name, members))
    bound = _material_name(prim)
    if bound:
        own = [members for role, _, members in found if role == MATERIAL]
        rest = np.setdiff1d(np.arange(faces), np.concatenate(own) if own else [])
        same = next((index for index, (role, label, _) in enumerate(found) if (role, label) == (MATERIAL, bound)), None)
        if same is not None:
            found[same] = (MATERIAL, bound, np.union1d(found[same][2], rest))
        elif rest.size:
            found.append((MATERIAL, bound, rest))
    extras.add_face_sets(found)


def _material_name(prim: Any) -> str | None:
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if not material:
        return None
    return str(material.GetPrim().GetCustomDataByKey(NAME) or material.GetPrim().GetName())
