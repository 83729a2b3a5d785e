"""Write the data of a USD prim other than points: primvars, face subsets and materials."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, UsdShade, Vt

from pdecodec.formats.base.attribute_roles import (
    ACCELERATIONS,
    COLOR,
    GROUP,
    MATERIAL,
    NORMAL,
    SPACE,
    UV,
    VECTOR,
    VELOCITIES,
    direction_role,
    face_sets,
    field_source_name,
    is_by_vertex,
    source_name,
    unique_name,
)
from pdecodec.formats.base.scene_writing import Parameter, ShapeForm, named_face_sets, write_parameters
from pdecodec.formats.usd.attributes import field_name
from pdecodec.formats.usd.metadata import DTYPE_KEY, NAME, OWN, UNIT_KEY, valid_name
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Connectivity, MeshObject

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
"""USD's value types by NumPy kind, size in bytes, and number of columns."""

_SCALARS = {
    "f4": (Sdf.ValueTypeNames.FloatArray, Vt.FloatArray, np.float32),
    "f8": (Sdf.ValueTypeNames.DoubleArray, Vt.DoubleArray, np.float64),
    "i8": (Sdf.ValueTypeNames.Int64Array, Vt.Int64Array, np.int64),
    "u1": (Sdf.ValueTypeNames.UCharArray, Vt.UCharArray, np.uint8),
    "u4": (Sdf.ValueTypeNames.UIntArray, Vt.UIntArray, np.uint32),
    "u8": (Sdf.ValueTypeNames.UInt64Array, Vt.UInt64Array, np.uint64),
    "b1": (Sdf.ValueTypeNames.BoolArray, Vt.BoolArray, np.bool_),
}
"""USD's value types of single numbers, by NumPy type; other integers are written as int."""

_INT = (Sdf.ValueTypeNames.IntArray, Vt.IntArray, np.int32)

_FAMILIES = {GROUP: "pdecodecGroup", MATERIAL: str(UsdShade.Tokens.materialBind)}
"""Families of face subsets by role."""

MATERIALS = "pdecodecMaterials"
"""Scope of the subsets' materials, below the default prim, so that references to this prim include them."""

_ROLE_TYPES = {
    (COLOR, 3): (Sdf.ValueTypeNames.Color3fArray, Vt.Vec3fArray),
    (COLOR, 4): (Sdf.ValueTypeNames.Color4fArray, Vt.Vec4fArray),
    (UV, 2): (Sdf.ValueTypeNames.TexCoord2fArray, Vt.Vec2fArray),
    (UV, 3): (Sdf.ValueTypeNames.TexCoord3fArray, Vt.Vec3fArray),
    (VECTOR, 3): (Sdf.ValueTypeNames.Vector3fArray, Vt.Vec3fArray),
    (NORMAL, 3): (Sdf.ValueTypeNames.Normal3fArray, Vt.Vec3fArray),
}
"""Types of colours, UVs and directions by role and numbers per row."""


def int_array(values: NDArray[np.integer]) -> Any:
    """Return integers (n,) as Vt.IntArray."""
    return Vt.IntArray.FromNumpy(np.ascontiguousarray(values, np.int32))


class ExtrasWriter:
    """Writer of an object's data other than points, for one or several runs of frames.

    Parameters
    ----------
    prim : Usd.Prim
    """

    def __init__(self, prim: Any) -> None:
        self._prim, self._api = prim, UsdGeom.PrimvarsAPI(prim)
        self._primvars: dict[str, _PrimvarWriter] = {}
        self._subsets: dict[tuple[str, str], Any] = {}
        self._own: dict[str, Any] = {}
        self._overlapping: set[str] = set()
        self._first: Any = None

    def write(self, item: MeshObject, drawn: ShapeForm, written: Sequence[str], at: Sequence[Any]) -> list[str]:
        """Write the attributes of a run of frames, except those named in `written`; return notices about attributes
        that USD cannot store.

        `at` holds the time codes of the run's first and last frame, or USD's code for values without samples. Both
        ends are written, because USD would interpolate numbers between samples of two runs.
        """
        self._first = at[0] if self._first is None else self._first
        put: set[str] = set()
        if drawn.kind == "mesh":
            self._write_subsets(item, at[0])
        notices = write_parameters(item, drawn, "USD", lambda one: self._put_primvar(item, one, at, put), written)
        for name in self._primvars.keys() - put:
            self._primvars[name].set(None, None, at[:1])
        self._write_own(item.connectivity, drawn, at[0])
        return notices

    def _put_primvar(self, item: MeshObject, one: Parameter, at: Sequence[Any], put: set[str]) -> bool:
        """Write a primvar; return False if no type fits it, or the primvar of its name has another type or is
        in `put`.
        """
        attribute, values, indices = one.attribute, one.values, one.indices
        name, interpolation = attribute.name, _INTERPOLATIONS[attribute.domain]
        if one.role == "label":
            type_name, array_type = Sdf.ValueTypeNames.StringArray, Vt.StringArray
        else:
            found = _ROLE_TYPES.get((one.role, one.width)) or _TYPES.get(one.kind)
            if found is None or attribute.labels:
                return False
            type_name, array_type = found
        if one.role == COLOR:
            name = source_name(attribute, COLOR, "displayColor" if one.width == 3 else COLOR)
        elif one.role == UV:
            name = source_name(attribute, UV, "st")
            # The primvar's interpolation is stored once for all runs.
            if at[0].IsDefault() and is_by_vertex(attribute, item.connectivity):
                interpolation, indices = "vertex", None
        name = ":".join(map(valid_name, name.split(":")))
        known = self._primvars.get(name)
        if known is None:
            primvar = self._api.CreatePrimvar(name, type_name, interpolation)
            known = self._primvars[name] = _PrimvarWriter(primvar, array_type, is_indexed=indices is not None)
            if self._first != at[0]:
                known.set(None, None, [self._first])
        elif name in put or not known.takes(type_name, interpolation):
            return False
        known.set(values.reshape(-1) if one.width == 1 else values, indices, at)
        put.add(name)
        return True

    def _write_subsets(self, item: MeshObject, at: Any) -> None:
        members_of = {key: np.zeros(0, np.int32) for key in self._subsets}
        taken = {subset.GetPrim().GetName() for subset in self._subsets.values()}
        for role, label, name, members in named_face_sets(item, valid_name):
            members_of[role, label] = members
            if (role, label) not in self._subsets:
                self._subsets[role, label] = subset = self._new_subset(role, label, unique_name(name, taken))
                if self._first != at:
                    subset.GetIndicesAttr().Set(Vt.IntArray(), self._first)
        for key, subset in self._subsets.items():
            subset.GetIndicesAttr().Set(int_array(members_of[key]), at)
        for role, family in _FAMILIES.items():
            sizes = [members.size for _, members in face_sets(item, role)]
            if sum(sizes) > item.connectivity.face_count:
                self._overlapping.add(role)
            if sizes:
                tokens = UsdGeom.Tokens
                kind = tokens.unrestricted if role in self._overlapping else tokens.nonOverlapping
                UsdGeom.Subset.SetFamilyType(UsdGeom.Imageable(self._prim), family, kind)

    def _new_subset(self, role: str, label: str, name: str) -> Any:
        mesh, none = UsdGeom.Imageable(self._prim), Vt.IntArray()
        subset = UsdGeom.Subset.CreateGeomSubset(mesh, name, UsdGeom.Tokens.face, none, _FAMILIES[role])
        if name != label:
            subset.GetPrim().SetCustomDataByKey(NAME, label)
        if role == MATERIAL:
            UsdShade.MaterialBindingAPI.Apply(subset.GetPrim()).Bind(_material(self._prim.GetStage(), label))
        return subset

    def _write_own(self, connectivity: Connectivity, drawn: ShapeForm, at: Any) -> None:
        """Write, as attributes in pdecodec's namespace, data that USD's shapes cannot hold."""
        arrays = {name: np.zeros(0, np.int32) for name in self._own}
        if drawn.gather is not None:
            arrays["vertex"] = drawn.gather
        if drawn.hidden_lines:
            arrays |= {"lineCounts": connectivity.line_counts, "lineIndices": connectivity.line_indices}
        for name, array in arrays.items():
            if name not in self._own:
                varies = Sdf.VariabilityUniform if at.IsDefault() else Sdf.VariabilityVarying
                kind = Sdf.ValueTypeNames.IntArray
                self._own[name] = self._prim.CreateAttribute(f"{OWN}:{name}", kind, True, varies)
                if self._first != at:
                    self._own[name].Set(Vt.IntArray(), self._first)
            self._own[name].Set(int_array(array), at)


class FieldsWriter:
    """Writer of the fields of one prim: samples of its velocities and accelerations, or of primvars.

    Parameters
    ----------
    prim : Usd.Prim
    """

    def __init__(self, prim: Any) -> None:
        self._prim = prim
        self._known: dict[str, tuple[Any, Any, Any]] = {}

    def write(self, fields: Sequence[tuple[Field, NDArray[Any]]], codes: Sequence[float], first: Any) -> None:
        """Write values (frames, rows, components) at time codes; `first` is the code of the first frame of the file.

        Fields that earlier runs had and this run lacks become empty.
        """
        for field, _ in fields:
            if field.name not in self._known:
                self._known[field.name] = put, array_type, _ = self._made(field)
                if not first.IsDefault() and first.GetValue() < codes[0]:
                    put.Set(array_type(), first)
        with Sdf.ChangeBlock():
            for field, values in fields:
                put, array_type, dtype = self._known[field.name]
                shape = (-1, field.components) if hasattr(array_type(1)[0], "dimension") else (-1,)
                for code, rows in zip(codes, values, strict=True):
                    put.Set(array_type.FromNumpy(np.ascontiguousarray(rows.reshape(shape), dtype)), code)
            for name in self._known.keys() - {field.name for field, _ in fields}:
                self._known[name][0].Set(self._known[name][1](), codes[0])

    def _made(self, field: Field) -> tuple[Any, Any, Any]:
        """Return the attribute or primvar of a field, the type of its arrays, and the NumPy type of its numbers."""
        if field.name in (VELOCITIES, ACCELERATIONS) and field.domain == "vertex" and direction_role(field):
            geometry = UsdGeom.PointBased(self._prim)
            is_speed = field.name == VELOCITIES
            made = geometry.CreateVelocitiesAttr() if is_speed else geometry.CreateAccelerationsAttr()
            return made, Vt.Vec3fArray, np.float32
        kind = (field.dtype.kind, field.dtype.itemsize, field.components)
        role = _ROLE_TYPES.get((field.name.partition(":")[0], field.components)) if kind[:2] == ("f", 4) else None
        found = role or (_TYPES.get(kind) if field.components > 1 else None)
        type_name, array_type, dtype = _SCALARS.get(field.dtype.str[1:], _INT)
        if found is not None:
            (type_name, array_type), dtype = found, field.dtype.type
        name = field_source_name(field, "st", "displayColor" if field.components == SPACE else COLOR)
        name = ":".join(map(valid_name, name.split(":")))
        taken = {one.removeprefix("primvars:") for one in self._prim.GetAuthoredPropertyNames()}
        name = unique_name(name, taken)
        primvar = UsdGeom.PrimvarsAPI(self._prim).CreatePrimvar(name, type_name, _INTERPOLATIONS[field.domain])
        if found is None and field.components > 1:
            primvar.SetElementSize(field.components)
        attribute = primvar.GetAttr()
        attribute.SetCustomDataByKey(DTYPE_KEY, field.dtype.name)
        if field.unit:
            attribute.SetCustomDataByKey(UNIT_KEY, field.unit)
        if field_name(name, type_name) != field.name:
            attribute.SetCustomDataByKey(NAME, field.name)
        return primvar, array_type, dtype


def _material(stage: Any, label: str) -> Any:
    """Return the material of a name, without a surface: programs identify sets of faces by their bound materials."""
    above = UsdGeom.Scope.Define(stage, stage.GetDefaultPrim().GetPath().AppendChild(MATERIALS))
    others = {}
    for prim in above.GetPrim().GetChildren():
        others[prim.GetName()] = str(prim.GetCustomDataByKey(NAME) or prim.GetName())
        if others[prim.GetName()] == label:
            return UsdShade.Material(prim)
    name = unique_name(valid_name(label), set(others))
    found = UsdShade.Material.Define(stage, above.GetPath().AppendChild(name))
    if name != label:
        found.GetPrim().SetCustomDataByKey(NAME, label)
    return found


class _PrimvarWriter:
    """A primvar and the type of its arrays."""

    def __init__(self, primvar: Any, array_type: Any, *, is_indexed: bool) -> None:
        self._primvar, self._array_type, self._is_indexed = primvar, array_type, is_indexed

    def takes(self, type_name: Any, interpolation: str) -> bool:
        """Return whether the primvar has this type and interpolation."""
        return bool(self._primvar.GetTypeName() == type_name and self._primvar.GetInterpolation() == interpolation)

    def set(self, values: NDArray[Any] | None, indices: NDArray[np.integer] | None, at: Sequence[Any]) -> None:
        """Set the primvar at time codes, with indices if it was created with them; None clears it."""
        if values is None:
            array, rows = self._array_type(), Vt.IntArray()
        else:
            if indices is not None and not self._is_indexed:
                # Index -1 stands for an element without a value.
                values, indices = np.concatenate([values, np.zeros_like(values[:1])])[indices], None
            rows = int_array(np.arange(len(values)) if indices is None else indices)
            is_text = self._array_type is Vt.StringArray
            array = (
                Vt.StringArray(values.tolist()) if is_text else self._array_type.FromNumpy(np.ascontiguousarray(values))
            )
        for code in at:
            self._primvar.Set(array, code)
            if self._is_indexed:
                self._primvar.SetIndices(rows, code)
