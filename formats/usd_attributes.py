"""What a USD prim carries beside points: primvars, face subsets and materials, as attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, UsdShade

from pdecodec.formats.attribute_roles import COLOR, GROUP, MATERIAL, UV, face_groups, role_name
from pdecodec.formats.usd_names import NAME, OWN
from pdecodec.sequence import Attribute, AttributeDomain, Connectivity, Int32Array

_DOMAINS: dict[str, AttributeDomain] = {
    "constant": "object",
    "uniform": "face",
    "varying": "vertex",
    "vertex": "vertex",
    "faceVarying": "corner",
}

_UV_NAMES = ("st", "uv", "UVMap", "map1")
"""Names under which float2 primvars are UVs, though their type does not say so."""

_OTHERS_OWN = ("skel:",)
"""Beginnings of primvars that belong to something else: what they do is in the points."""


@dataclass
class UsdExtras:
    """Attributes of a prim, arrays of our own, and names of what is left out."""

    attributes: list[Attribute] = field(default_factory=list)
    own: dict[str, Int32Array] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def read_extras(prim: Any, connectivity: Connectivity, order: NDArray[np.int64]) -> UsdExtras:
    """Everything constant that the prim carries.

    Parameters
    ----------
    prim : Usd.Prim
    connectivity : Connectivity
    order : (corners,) int64
        Corner of the file that each corner of `connectivity` was.
    """
    extras = UsdExtras()
    for primvar in UsdGeom.PrimvarsAPI(prim).GetPrimvarsWithAuthoredValues():
        name = str(primvar.GetPrimvarName())
        if not name.startswith(_OTHERS_OWN):
            _read_primvar(primvar, name, connectivity, order, extras)
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetNamespace() == OWN:
            extras.own[attribute.GetBaseName()] = np.array(attribute.Get(), np.int32)
    if connectivity.face_count:
        _read_subsets(prim, connectivity.face_count, extras)
    return extras


def _role(name: str, type_name: Any, taken: set[str]) -> str:
    """Name of the attribute for a primvar."""
    if type_name.role == Sdf.ValueRoleNames.TextureCoordinate or (
        type_name in (Sdf.ValueTypeNames.Float2Array, Sdf.ValueTypeNames.TexCoord2fArray) and name in _UV_NAMES
    ):
        wanted = role_name(UV, name, ("st",))
        return f"{UV}:{name}" if wanted in taken else wanted
    if type_name.role == Sdf.ValueRoleNames.Color:
        return role_name(COLOR, name, ("displayColor",))
    return name


def _read_primvar(
    primvar: Any, name: str, connectivity: Connectivity, order: NDArray[np.int64], extras: UsdExtras
) -> None:
    if primvar.ValueMightBeTimeVarying():
        extras.left_out.append(f"{name} (it changes with time)")
        return
    stored = primvar.Get()
    labels: tuple[str, ...] = ()
    if primvar.GetTypeName().scalarType in (Sdf.ValueTypeNames.String, Sdf.ValueTypeNames.Token):
        texts = [stored] if isinstance(stored, str) else list(stored or ())
        labels, values = tuple(map(str, texts)), np.arange(len(texts), dtype=np.int32)
    else:
        values = np.atleast_1d(np.array(stored))
    domain = _DOMAINS.get(str(primvar.GetInterpolation()), "object")
    indices = None
    if primvar.IsIndexed():
        indices = np.array(primvar.GetIndices(), np.int32)
    attribute = _attribute(
        _role(name, primvar.GetTypeName(), {one.name for one in extras.attributes}),
        domain,
        values,
        indices,
        labels,
        connectivity,
        order,
    )
    if attribute is None:
        extras.left_out.append(name)
    else:
        extras.attributes.append(attribute)


def _attribute(
    name: str,
    domain: AttributeDomain,
    values: NDArray[Any],
    indices: Int32Array | None,
    labels: tuple[str, ...],
    connectivity: Connectivity,
    order: NDArray[np.int64],
) -> Attribute | None:
    """An attribute; None where it is of a type or a number of rows that we cannot hold."""
    if values.dtype == np.float16:
        values = values.astype(np.float32)
    if values.dtype.kind not in "fiu" or values.dtype.itemsize > 8 or values.ndim > 2:
        return None
    if values.dtype not in (np.float32, np.float64, np.int32, np.int64, np.uint8):
        return None
    rows = {
        "vertex": connectivity.vertex_count,
        "face": connectivity.face_count,
        "corner": connectivity.face_indices.size,
        "object": None,
    }[domain]
    given = len(values) if indices is None else indices.size
    if rows is not None and given != rows:
        return None
    if indices is not None and indices.size and not -1 <= indices.min() <= indices.max() < len(values):
        return None
    if domain == "corner":
        values, indices = (values[order], None) if indices is None else (values, indices[order])
    if indices is not None and (labels or domain == "object"):
        values, indices = values[indices], None
    if name.partition(":")[0] == UV and domain == "vertex":
        shared = np.arange(len(values), dtype=np.int32) if indices is None else indices
        domain, indices = "corner", shared[connectivity.face_indices]
    return Attribute(name, domain, values, indices, labels)


def _read_subsets(prim: Any, faces: int, extras: UsdExtras) -> None:
    sets: dict[str, list[tuple[str, NDArray[np.integer]]]] = {GROUP: [], MATERIAL: []}
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        name = str(subset.GetPrim().GetCustomDataByKey(NAME) or subset.GetPrim().GetName())
        members = np.array(subset.GetIndicesAttr().Get() or [], np.int64)
        inside = not members.size or 0 <= members.min() <= members.max() < faces
        if subset.GetElementTypeAttr().Get() != UsdGeom.Tokens.face or not inside:
            extras.left_out.append(f"subset {name}")
            continue
        family = str(subset.GetFamilyNameAttr().Get() or "")
        if family == UsdShade.Tokens.materialBind:
            bound = _material_name(subset.GetPrim())
            sets[MATERIAL].append((bound or name, members))
        else:
            sets[GROUP].append((name, members))
    if not sets[MATERIAL]:
        bound = _material_name(prim)
        if bound:
            sets[MATERIAL].append((bound, np.arange(faces)))
    for role, found in sets.items():
        extras.attributes += face_groups(role, found, faces)


def _material_name(prim: Any) -> str | None:
    material, _ = UsdShade.MaterialBindingAPI(prim).ComputeBoundMaterial()
    if not material:
        return None
    return str(material.GetPrim().GetCustomDataByKey(NAME) or material.GetPrim().GetName())
