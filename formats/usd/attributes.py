"""What a USD prim carries beside points: primvars, face subsets and materials, in and out; and names of prims."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Ts, UsdGeom, UsdShade, Vt

from pdecodec.formats.base.attribute_roles import (
    COLOR,
    GROUP,
    MATERIAL,
    UV,
    face_sets,
    is_by_vertex,
    role_name,
    source_name,
)
from pdecodec.formats.base.scene_reading import Extras
from pdecodec.formats.base.scene_writing import Drawn, Parameter, named_face_sets, unlike, write_parameters
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import AttributeDomain, Connectivity, MeshObject

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

_FAMILIES = {GROUP: "pdecodecGroup", MATERIAL: str(UsdShade.Tokens.materialBind)}
"""Families of subsets of faces, by what they stand for."""

MATERIALS = "pdecodecMaterials"
"""What holds the materials of subsets, below the default prim: they come along where that is referenced."""

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


def read_extras(
    prim: Any, connectivity: Connectivity, order: Int64Array, *, moves: bool = False, at: float | None = None
) -> Extras:
    """Everything constant that the prim carries; `order` as of :class:`Extras`, `moves` whether its points do.

    Where a time code says `at` which sample, everything is read there, be it constant or not.
    """
    extras = Extras(connectivity, order)
    for primvar in UsdGeom.PrimvarsAPI(prim).FindPrimvarsWithInheritance():
        if not primvar.HasAuthoredValue():
            continue
        name = str(primvar.GetPrimvarName())
        if not name.startswith(_OTHERS_OWN) and not (name == NORMALS and connectivity.face_count):
            _read_primvar(primvar, name, extras, moves, at)
    for attribute in prim.GetAuthoredAttributes():
        if attribute.GetNamespace() == OWN:
            extras.own[attribute.GetBaseName()] = np.array(value_at(attribute, at), np.int32)
    if connectivity.face_count:
        _read_normals(UsdGeom.Mesh(prim), extras, at)
        _read_subsets(prim, extras, at)
    elif _material_name(prim):
        extras.left_out.append("material")
    return extras


def value_at(attribute: Any, at: float | None) -> Any:
    """An attribute's value at a time code; at its first sample, else its default, where that is None."""
    if at is not None:
        return attribute.Get(at)
    codes = attribute.GetTimeSamples()
    return attribute.Get(codes[0]) if codes else attribute.Get()


def changes_with_time(attribute: Any) -> bool:
    """Whether an attribute has different values at different times: one sample, or equal ones, are a constant."""
    if attribute.HasSpline():
        return True
    codes = attribute.GetTimeSamples()
    first = attribute.Get(codes[0]) if codes else None
    return any(not np.array_equal(np.asarray(attribute.Get(code)), np.asarray(first)) for code in codes[1:])


def spline_codes(attribute: Any, stage: Any) -> list[float]:
    """Time codes between which an attribute follows its spline; none where it has no spline.

    Where the spline goes on before its first knot or after its last one, the stage's range counts too.
    """
    if not attribute.HasSpline():
        return []
    spline = attribute.GetSpline()
    codes = [float(code) for code in spline.GetKnots()]
    if spline.HasInnerLoops():
        loop = spline.GetInnerLoopParams()
        length = loop.protoEnd - loop.protoStart
        codes += [loop.protoStart - loop.numPreLoops * length, loop.protoEnd + loop.numPostLoops * length]
    ends = (
        (spline.GetPreExtrapolation(), stage.HasAuthoredMetadata("startTimeCode"), stage.GetStartTimeCode()),
        (spline.GetPostExtrapolation(), stage.HasAuthoredMetadata("endTimeCode"), stage.GetEndTimeCode()),
    )
    still = (Ts.ExtrapHeld, Ts.ExtrapValueBlock)
    codes += [float(code) for outside, is_authored, code in ends if is_authored and outside.mode not in still]
    return sorted(codes)


def _read_normals(mesh: Any, extras: Extras, at: float | None) -> None:
    attribute, interpolation, indices = mesh.GetNormalsAttr(), mesh.GetNormalsInterpolation(), None
    primvar = UsdGeom.PrimvarsAPI(mesh).GetPrimvar(NORMALS)
    if primvar and primvar.HasAuthoredValue():
        attribute, interpolation = primvar.GetAttr(), primvar.GetInterpolation()
        if primvar.IsIndexed():
            indices = np.array(value_at(primvar.GetIndicesAttr(), at), np.int32)
    found = value_at(attribute, at) if attribute.HasAuthoredValue() else None
    if found is not None and (at is None or len(found)):
        extras.add_normals(_DOMAINS.get(str(interpolation), "object"), np.array(found, np.float32), indices)


def _read_primvar(primvar: Any, name: str, extras: Extras, moves: bool, at: float | None) -> None:
    type_name = primvar.GetTypeName()
    indices_of = primvar.GetIndicesAttr() if primvar.IsIndexed() else None
    if at is None and any(changes_with_time(one) for one in (primvar.GetAttr(), indices_of) if one):
        extras.left_out.append(f"{name} (it changes with time)")
        return
    if moves and type_name.role == Sdf.ValueRoleNames.Normal:
        extras.left_out.append(f"{name} (normals that would stand still)")
        return
    stored = value_at(primvar.GetAttr(), at)
    if at is not None and not np.size(stored):
        # What other runs of frames have.
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
    if type_name.role == Sdf.ValueRoleNames.TextureCoordinate or (
        type_name == Sdf.ValueTypeNames.Float2Array and name in _UV_NAMES
    ):
        wanted = role_name(UV, name, ("st",))
        name = f"{UV}:{name}" if any(one.name == wanted for one in extras.attributes) else wanted
    elif type_name.role == Sdf.ValueRoleNames.Color:
        name = role_name(COLOR, name, ("displayColor",))
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
            # A set that other runs of frames have.
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


class ExtrasWriter:
    """Writes what an object carries beside points, for one or several runs of frames.

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

    def write(self, item: MeshObject, drawn: Drawn, written: Sequence[str], at: Sequence[Any]) -> list[str]:
        """Write a run of frames, but for attributes of these names; what had no place.

        `at` are the time codes of its first and last frame, or USD's code for what has no samples: numbers would not
        stand still between samples of two runs.
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
        """Whether there was a type of primvar for it, and no primvar of its name of another kind, or in `put`."""
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
            # Interpolation is said once for all runs.
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
                self._subsets[role, label] = subset = self._new_subset(role, label, unlike(name, taken))
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

    def _write_own(self, connectivity: Connectivity, drawn: Drawn, at: Any) -> None:
        """What USD's shapes cannot say, in attributes of our own."""
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


def _material(stage: Any, label: str) -> Any:
    """The material of a name, without a surface: programs know sets of faces by the materials bound to them."""
    above = UsdGeom.Scope.Define(stage, stage.GetDefaultPrim().GetPath().AppendChild(MATERIALS))
    others = {}
    for prim in above.GetPrim().GetChildren():
        others[prim.GetName()] = str(prim.GetCustomDataByKey(NAME) or prim.GetName())
        if others[prim.GetName()] == label:
            return UsdShade.Material(prim)
    name = unlike(valid_name(label), set(others))
    found = UsdShade.Material.Define(stage, above.GetPath().AppendChild(name))
    if name != label:
        found.GetPrim().SetCustomDataByKey(NAME, label)
    return found


class _PrimvarWriter:
    """A primvar and the type of its arrays."""

    def __init__(self, primvar: Any, array_type: Any, *, is_indexed: bool) -> None:
        self._primvar, self._array_type, self._is_indexed = primvar, array_type, is_indexed

    def takes(self, type_name: Any, interpolation: str) -> bool:
        """Whether it is of this type and for these elements."""
        return bool(self._primvar.GetTypeName() == type_name and self._primvar.GetInterpolation() == interpolation)

    def set(self, values: NDArray[Any] | None, indices: NDArray[np.integer] | None, at: Sequence[Any]) -> None:
        """Set it at time codes, with indices or without them as it was made; to nothing without values."""
        if values is None:
            array, rows = self._array_type(), Vt.IntArray()
        else:
            if indices is not None and not self._is_indexed:
                # Index -1 is an element that has none.
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
