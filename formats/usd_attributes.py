"""What a USD prim carries beside points: primvars, face subsets and materials, in and out; and names of prims."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, UsdGeom, UsdShade, Vt

from pdecodec.formats.attribute_roles import (
    COLOR,
    GROUP,
    MATERIAL,
    UV,
    face_sets,
    is_by_vertex,
    role_name,
    source_name,
)
from pdecodec.formats.scene_reading import Extras
from pdecodec.formats.scene_writing import Drawn, Parameter, named_face_sets, write_parameters
from pdecodec.sequence import AttributeDomain, Connectivity, MeshObject

OWN = "pdecodec"
"""Namespace of attributes that only we write and read."""

NAME, ADDED = f"{OWN}:name", f"{OWN}:added"
"""Custom data of a prim: the name it stands for where USD could not hold it; whether the tree did not have it."""

METADATA = f"{OWN}Metadata"
"""Custom data of a layer: metadata that USD has no place for."""

_DOMAINS: dict[str, AttributeDomain] = {
    "constant": "object",
    "uniform": "face",
    "varying": "vertex",
    "vertex": "vertex",
    "faceVarying": "corner",
}

_INTERPOLATIONS = {"vertex": "vertex", "face": "uniform", "corner": "faceVarying", "object": "constant"}

_UV_NAMES = ("st", "uv", "UVMap", "map1")
"""Names under which float2 primvars are UVs, though their type does not say so."""

NORMALS = "normals"
"""Name of the primvar that goes before the attribute of that name."""

SAMPLED = f"{OWN}Sampled"
"""Custom data of a layer: whether every frame is a sample, so that nothing lies between samples."""

_OTHERS_OWN = ("skel:",)
"""Beginnings of primvars that belong to something else: what they do is in the points."""

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

_ROLE_TYPES = {
    (COLOR, 3): (Sdf.ValueTypeNames.Color3fArray, Vt.Vec3fArray),
    (COLOR, 4): (Sdf.ValueTypeNames.Color4fArray, Vt.Vec4fArray),
    (UV, 2): (Sdf.ValueTypeNames.TexCoord2fArray, Vt.Vec2fArray),
    (UV, 3): (Sdf.ValueTypeNames.TexCoord3fArray, Vt.Vec3fArray),
}
"""Types of colours and UVs, by numbers in a row."""


def valid_name(step: str) -> str:
    """What a prim is called for a step of a path."""
    return step if Sdf.Path.IsValidIdentifier(step) else str(Tf.MakeValidIdentifier(step))


def object_name(prim: Any) -> str:
    """The path of an object: names from the root, without the leading slash."""
    steps = []
    while prim and not prim.IsPseudoRoot():
        if not prim.GetCustomDataByKey(ADDED):
            steps.append(str(prim.GetCustomDataByKey(NAME) or prim.GetName()))
        prim = prim.GetParent()
    return "/".join(reversed(steps))


def int_array(values: NDArray[np.integer]) -> Any:
    """(n,) as Vt.IntArray."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))


def read_extras(prim: Any, connectivity: Connectivity, order: NDArray[np.int64], *, moves: bool = False) -> Extras:
    """Everything constant that the prim carries; `order` as of :class:`Extras`, `moves` whether its points do."""
    extras = Extras(connectivity, order)
    for primvar in UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance():
        if not primvar.HasAuthoredValue():
            continue
        name = str(primvar.GetPrimvarName())
        if not name.startswith(_OTHERS_OWN) and not (name == NORMALS and connectivity.face_count):
            _read_primvar(primvar, name, extras, moves)
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetNamespace() == OWN:
            extras.own[attribute.GetBaseName()] = np.array(attribute.Get(), np.int32)
    if connectivity.face_count:
        _read_normals(UsdGeom.Mesh(prim), extras)
        _read_subsets(prim, extras)
    elif _material_name(prim):
        extras.left_out.append("material")
    return extras


def first_value(attribute: Any) -> Any:
    """An attribute's value at its first sample, else its default."""
    codes = attribute.GetTimeSamples()
    return attribute.Get(codes[0]) if codes else attribute.Get()


def _read_normals(mesh: Any, extras: Extras) -> None:
    attribute, interpolation, indices = mesh.GetNormalsAttr(), mesh.GetNormalsInterpolation(), None
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(NORMALS)
    if primvar and primvar.HasAuthoredValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
        if primvar.IsIndexed():
            indices = np.array(first_value(primvar.GetIndicesAttr()), np.int32)
    found = first_value(attribute) if attribute.HasAuthoredValue() else None
    if found is not None:
        extras.add_normals(_DOMAINS.get(str(interpolation), "object"), np.array(found, np.float32), indices)


def _read_primvar(primvar: Any, name: str, extras: Extras, moves: bool) -> None:
    type_name = primvar.GetTypeName()
    if primvar.ValueMightBeTimeVarying():
        extras.left_out.append(f"{name} (it changes with time)")
        return
    if moves and type_name.role == Sdf.ValueRoleNames.Normal:
        extras.left_out.append(f"{name} (normals that would stand still)")
        return
    stored = primvar.Get()
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
    if type_name.role == Sdf.ValueRoleNames.TextureCoordinate or (
        type_name == Sdf.ValueTypeNames.Float2Array and name in _UV_NAMES
    ):
        wanted = role_name(UV, name, ("st",))
        name = f"{UV}:{name}" if any(one.name == wanted for one in extras.attributes) else wanted
    elif type_name.role == Sdf.ValueRoleNames.Color:
        name = role_name(COLOR, name, ("displayColor",))
    indices = np.array(primvar.GetIndices(), np.int32) if primvar.IsIndexed() else None
    extras.add(name, _DOMAINS.get(str(primvar.GetInterpolation()), "object"), values, indices, labels)


def _read_subsets(prim: Any, extras: Extras) -> None:
    found: list[tuple[str, str, NDArray[np.integer]]] = []
    faces = extras.connectivity.face_count
    for subset in UsdGeom.Subset.GetAllGeomSubsets(UsdGeom.Imageable(prim)):
        name = str(subset.GetPrim().GetCustomDataByKey(NAME) or subset.GetPrim().GetName())
        members = np.array(subset.GetIndicesAttr().Get() or [], np.int64)
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


def write_extras(prim: Any, item: MeshObject, drawn: Drawn, written: Sequence[str]) -> list[str]:
    """Write what an object carries beside points, but for attributes of these names; what had no place."""
    if drawn.kind == "mesh":
        _write_subsets(UsdGeom.Imageable(prim), item)
    api = UsdGeom.PrimvarsAPI(prim)
    return write_parameters(item, drawn, "USD", lambda one: _put_primvar(api, item, one), written)


def _put_primvar(api: Any, item: MeshObject, one: Parameter) -> bool:
    """Whether there was a type of primvar for it."""
    attribute, values, indices = one.attribute, one.values, one.indices
    name, interpolation = attribute.name, _INTERPOLATIONS[attribute.domain]
    if one.role == "label":
        type_name, array = Sdf.ValueTypeNames.StringArray, Vt.StringArray(values.tolist())
    else:
        found = _ROLE_TYPES.get((one.role, one.width)) or _TYPES.get(one.kind)
        if found is None or attribute.labels:
            return False
        type_name = found[0]
        array = found[1].FromNumpy(np.ascontiguousarray(values.reshape(-1) if one.width == 1 else values))
    if one.role == COLOR:
        name = source_name(attribute, COLOR, "displayColor" if one.width == 3 else COLOR)
    elif one.role == UV:
        name = source_name(attribute, UV, "st")
        if is_by_vertex(attribute, item.connectivity):
            interpolation, indices = "vertex", None
    primvar = api.CreatePrimvar(":".join(map(valid_name, name.split(":"))), type_name, interpolation)
    primvar.Set(array)
    if indices is not None:
        primvar.SetIndices(int_array(indices))
    return True


def _write_subsets(mesh: Any, item: MeshObject) -> None:
    families = {GROUP: "pdecodecGroup", MATERIAL: str(UsdShade.Tokens.materialBind)}
    for role, label, name, members in named_face_sets(item, valid_name):
        indices = int_array(members)
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, UsdGeom.Tokens.face, indices, families[role])
        if name != label:
            subset.GetPrim().SetCustomDataByKey(NAME, label)
    for role, family in families.items():
        sizes = [members.size for _, members in face_sets(item, role)]
        if sizes:
            kind = UsdGeom.Tokens.nonOverlapping
            if sum(sizes) > item.connectivity.face_count:
                kind = UsdGeom.Tokens.unrestricted
            UsdGeom.Subset.SetFamilyType(mesh, family, kind)
