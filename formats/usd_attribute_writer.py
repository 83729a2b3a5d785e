"""Attributes of an object as primvars and face subsets of a USD prim."""

from __future__ import annotations

from typing import Any

import numpy as np
from pxr import Sdf, UsdGeom, UsdShade, Vt

from pdecodec.formats.attribute_roles import (
    COLOR,
    CURVE_BASIS,
    CURVE_WRAP,
    GROUP,
    MATERIAL,
    SUBDIVISION,
    UV,
    colors,
    face_sets,
    indexed_rows,
    is_role,
    source_name,
    uv_sets,
)
from pdecodec.formats.object_tree import Drawn
from pdecodec.formats.transforms import TRANSFORM
from pdecodec.formats.usd_names import NAME, valid_name
from pdecodec.sequence import Attribute, MeshObject

_WRITTEN_ELSEWHERE = frozenset({SUBDIVISION, CURVE_BASIS, CURVE_WRAP, TRANSFORM})

_INTERPOLATIONS = {"vertex": "vertex", "face": "uniform", "corner": "faceVarying", "object": "constant"}

_TYPES = {
    ("f", 4, 1): (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray),
    ("f", 4, 2): (Sdf.ValueTypeNames.Float2Array, Vt.Vec2fArray),
    ("f", 4, 3): (Sdf.ValueTypeNames.Float3Array, Vt.Vec3fArray),
    ("f", 4, 4): (Sdf.ValueTypeNames.Float4Array, Vt.Vec4fArray),
    ("f", 8, 1): (Sdf.ValueTypeNames.DoubleArray, Vt.DoubleArray),
    ("f", 8, 2): (Sdf.ValueTypeNames.Double2Array, Vt.Vec2dArray),
    ("f", 8, 3): (Sdf.ValueTypeNames.Double3Array, Vt.Vec3dArray),
    ("f", 8, 4): (Sdf.ValueTypeNames.Double4Array, Vt.Vec4dArray),
    ("i", 4, 1): (Sdf.ValueTypeNames.IntArray, Vt.IntArray),
    ("i", 4, 2): (Sdf.ValueTypeNames.Int2Array, Vt.Vec2iArray),
    ("i", 4, 3): (Sdf.ValueTypeNames.Int3Array, Vt.Vec3iArray),
    ("i", 4, 4): (Sdf.ValueTypeNames.Int4Array, Vt.Vec4iArray),
    ("i", 8, 1): (Sdf.ValueTypeNames.Int64Array, Vt.Int64Array),
    ("u", 1, 1): (Sdf.ValueTypeNames.UCharArray, Vt.UCharArray),
}
"""USD's types of values: by NumPy kind, bytes, and columns."""


def write_attributes(stage: Any, prim: Any, item: MeshObject, drawn: Drawn) -> list[str]:
    """Write what an object carries beside points.

    Returns
    -------
    list of str
        What had no place.
    """
    notices, left_out = [], []
    if drawn.kind == "mesh":
        _write_subsets(stage, prim, item)
    for attribute in item.attributes:
        if attribute.name in _WRITTEN_ELSEWHERE:
            continue
        if attribute.domain == "face" and any(is_role(attribute, role) for role in (GROUP, MATERIAL)):
            continue
        if not _write_primvar(prim, item, attribute, drawn):
            left_out.append(attribute.name)
    if left_out:
        notices.append(f"USD has no place for attributes: {', '.join(left_out)}")
    return notices


def _write_primvar(prim: Any, item: MeshObject, attribute: Attribute, drawn: Drawn) -> bool:
    """Whether there was a type of primvar for it."""
    if attribute.domain in ("face", "corner") and drawn.kind != "mesh":
        return False
    values, indices = attribute.values, attribute.indices
    width = values.shape[1] if values.ndim == 2 else 1
    name, interpolation = attribute.name, _INTERPOLATIONS[attribute.domain]
    found = _TYPES.get((values.dtype.kind, values.dtype.itemsize, width))
    if any(attribute is one for one in colors(item)):
        name = source_name(attribute, COLOR, "displayColor" if width == 3 else COLOR)
        types = Sdf.ValueTypeNames
        found = (types.Color3fArray, Vt.Vec3fArray) if width == 3 else (types.Color4fArray, Vt.Vec4fArray)
        values, indices = _with_none(attribute)
    elif any(attribute is one for one in uv_sets(item)):
        name = source_name(attribute, UV, "st")
        types = Sdf.ValueTypeNames
        found = (types.TexCoord2fArray, Vt.Vec2fArray) if width == 2 else (types.TexCoord3fArray, Vt.Vec3fArray)
        values, indices = _with_none(attribute)
        if (
            indices is not None
            and len(values) == item.vertex_count
            and np.array_equal(indices, item.connectivity.face_indices)
        ):
            interpolation, indices = "vertex", None
    elif attribute.labels and values.ndim == 1 and values.size and values.min() >= 0:
        rows = values if indices is None else values[indices]
        return _put_labels(prim, name, interpolation, attribute.labels, rows)
    if found is None or attribute.labels:
        return False
    type_name, array = found
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(_primvar_name(name), type_name, interpolation)
    primvar.Set(array.FromNumpy(np.ascontiguousarray(values.reshape(-1) if width == 1 else values)))
    if indices is not None:
        primvar.SetIndices(Vt.IntArray.FromNumpy(np.ascontiguousarray(indices, np.int32)))
    return True


def _with_none(attribute: Attribute) -> tuple[Any, Any]:
    """Rows as float32; indices keep -1, which is no row in USD either."""
    values, indices, filled = indexed_rows(attribute)
    return (values[:-1], attribute.indices) if filled else (values, indices)


def _primvar_name(name: str) -> str:
    return ":".join(valid_name(part) for part in name.split(":"))


def _put_labels(prim: Any, name: str, interpolation: str, labels: tuple[str, ...], rows: Any) -> bool:
    kind = Sdf.ValueTypeNames.StringArray
    primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(_primvar_name(name), kind, interpolation)
    primvar.Set(Vt.StringArray(list(labels)))
    primvar.SetIndices(Vt.IntArray.FromNumpy(np.ascontiguousarray(rows, np.int32)))
    return True


def _write_subsets(stage: Any, prim: Any, item: MeshObject) -> None:
    mesh = UsdGeom.Imageable(prim)
    taken: set[str] = set()
    for role, family in ((GROUP, "pdecodecGroup"), (MATERIAL, str(UsdShade.Tokens.materialBind))):
        sets = face_sets(item, role)
        for label, members in sets:
            name = base = valid_name(label or role)
            number = 1
            while name in taken:
                number += 1
                name = f"{base}_{number}"
            taken.add(name)
            indices = Vt.IntArray.FromNumpy(np.ascontiguousarray(members, np.int32))
            subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, UsdGeom.Tokens.face, indices, family)
            if name != label:
                subset.GetPrim().SetCustomDataByKey(NAME, label)
        if sets:
            apart = sum(members.size for _, members in sets) <= item.connectivity.face_count
            kind = UsdGeom.Tokens.nonOverlapping if apart else UsdGeom.Tokens.unrestricted
            UsdGeom.Subset.SetFamilyType(mesh, family, kind)
