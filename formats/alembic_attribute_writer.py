"""Attributes of an object as parameters and face sets of an Alembic shape."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from alembic3d import AbcCoreAbstract, AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic_arrays import (
    byte_array,
    color_array,
    double_array,
    float_array,
    int_array,
    string_array,
    unsigned_array,
    vector_array,
)
from pdecodec.formats.alembic_attributes import KIND, LABEL, OWN
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
    reversed_corners,
    source_name,
    uv_sets,
)
from pdecodec.formats.object_tree import Drawn
from pdecodec.formats.transforms import TRANSFORM
from pdecodec.sequence import Attribute, Connectivity, MeshObject

_SCOPES = {
    "vertex": AbcGeom.GeometryScope.kVertexScope,
    "face": AbcGeom.GeometryScope.kUniformScope,
    "corner": AbcGeom.GeometryScope.kFacevaryingScope,
    "object": AbcGeom.GeometryScope.kConstantScope,
}

_WRITTEN_ELSEWHERE = frozenset({SUBDIVISION, CURVE_BASIS, CURVE_WRAP, TRANSFORM})

METADATA_MARKS = frozenset(";=")
"""Characters that Alembic's metadata cannot hold."""

_FACE_SET_ROLES = (GROUP, MATERIAL)

_KINDS = {
    ("f", 4, 1): "Float",
    ("f", 4, 2): "V2f",
    ("f", 4, 3): "V3f",
    ("f", 8, 1): "Double",
    ("i", 4, 1): "Int32",
    ("u", 1, 1): "Uchar",
}
"""Alembic's types of values: by NumPy kind, bytes, and columns."""

_ARRAYS: dict[str, Callable[[Any], Any]] = {
    "Float": float_array,
    "Double": double_array,
    "Int32": int_array,
    "Uchar": byte_array,
    "C3f": color_array,
    "C4f": color_array,
    "String": string_array,
}


def uv_sample(uv: Attribute, connectivity: Connectivity, order: NDArray[np.int64]) -> Any:
    """The main UV set as Alembic's sample: by vertex where it is, else by corner, rows shared as they are."""
    values, indices, _ = indexed_rows(uv)
    if _is_by_vertex(uv, connectivity):
        return AbcGeom.OV2fGeomParamSample(vector_array(values[:, :2]), _SCOPES["vertex"])
    if indices is None:
        return AbcGeom.OV2fGeomParamSample(vector_array(values[order, :2]), _SCOPES["corner"])
    return AbcGeom.OV2fGeomParamSample(vector_array(values[:, :2]), unsigned_array(indices[order]), _SCOPES["corner"])


def _is_by_vertex(uv: Attribute, connectivity: Connectivity) -> bool:
    return (
        uv.indices is not None
        and len(uv.values) == connectivity.vertex_count
        and np.array_equal(uv.indices, connectivity.face_indices)
    )


class AttributeWriter:
    """Writes what an object carries beside positions and its main UV set.

    Parameters
    ----------
    item : MeshObject
    drawn : Drawn
    handle : object
        The shape, of the binding, after its first sample.
    """

    def __init__(self, item: MeshObject, drawn: Drawn, handle: Any) -> None:
        self._item, self._drawn = item, drawn
        self._handle, self._schema = handle, handle.getSchema()
        self._parameters = self._schema.getArbGeomParams()
        self.notices: list[str] = []

    def write(self) -> None:
        """Write everything; :attr:`notices` then says what had no place."""
        if self._drawn.kind == "mesh":
            self._write_face_sets()
            self._describe_main_uv()
        main_uv = uv_sets(self._item)[:1]
        left_out = []
        for attribute in self._item.attributes:
            if attribute.name in _WRITTEN_ELSEWHERE or any(attribute is one for one in main_uv):
                continue
            if attribute.domain == "face" and any(is_role(attribute, role) for role in _FACE_SET_ROLES):
                continue
            if not self._write_parameter(attribute):
                left_out.append(attribute.name)
        if left_out:
            self.notices.append(f"Alembic has no place for attributes: {', '.join(left_out)}")
        self._write_own()

    def _describe_main_uv(self) -> None:
        sets = uv_sets(self._item)
        if not sets:
            return
        if sets[0].values.shape[1] == 3:
            self.notices.append(f"the third number of {sets[0].name!r} is not kept: UVs have two in Alembic")
        if sets[0].indices is not None and (sets[0].indices < 0).any():
            self.notices.append(f"corners without a row of {sets[0].name!r} have (0, 0) in Alembic")

    def _write_face_sets(self) -> None:
        taken: set[str] = set()
        for role in _FACE_SET_ROLES:
            for label, members in face_sets(self._item, role):
                name = base = label.replace("/", "_") or role
                number = 1
                while name in taken:
                    number += 1
                    name = f"{base}_{number}"
                taken.add(name)
                metadata = AbcCoreAbstract.MetaData()
                metadata.set(KIND, role)
                if name != label and not set(label) & METADATA_MARKS:
                    metadata.set(LABEL, label)
                face_set = AbcGeom.OFaceSet(self._handle, name, metadata)
                face_set.getSchema().set(AbcGeom.OFaceSetSchemaSample(int_array(members)))

    def _write_parameter(self, attribute: Attribute) -> bool:
        """Whether there was a type of parameter for it."""
        item = self._item
        if attribute.domain in ("face", "corner") and self._drawn.kind != "mesh":
            return False
        if attribute.indices is not None and (attribute.indices < 0).any() and not is_role(attribute, UV):
            return False
        values, indices = attribute.values, attribute.indices
        width = values.shape[1] if values.ndim == 2 else 1
        name, kind = attribute.name, _KINDS.get((values.dtype.kind, values.dtype.itemsize, width))
        if any(attribute is one for one in colors(item)):
            name, kind = source_name(attribute, COLOR, COLOR), "C3f" if width == 3 else "C4f"
            values, indices, _ = indexed_rows(attribute)
        elif any(attribute is one for one in uv_sets(item)) and width == 2:
            name, kind = source_name(attribute, UV, UV), "V2f"
            values, indices, _ = indexed_rows(attribute)
        elif attribute.labels and values.ndim == 1 and values.size and values.min() >= 0:
            kind = "String"
            rows = values if indices is None else values[indices]
            values, indices = np.array(attribute.labels), rows
        if kind is None:
            return False
        if attribute.domain == "corner":
            order = reversed_corners(item.connectivity.face_counts)
            values, indices = (values[order], None) if indices is None else (values, indices[order])
        flat = values.reshape(-1) if width == 1 else values
        self._put(kind, name.replace("/", "_"), _SCOPES[attribute.domain], flat, indices)
        return True

    def _put(self, kind: str, name: str, scope: Any, values: NDArray[Any], indices: NDArray[Any] | None) -> None:
        make: Callable[[Any], Any] = _ARRAYS.get(kind, vector_array)
        array = make(values)
        sample_type = getattr(AbcGeom, f"O{kind}GeomParamSample")
        sample = sample_type(array, scope) if indices is None else sample_type(array, unsigned_array(indices), scope)
        metadata = AbcCoreAbstract.MetaData()
        if kind == "V2f" and scope == _SCOPES["corner"]:
            metadata.setIsUV(True)
        param = getattr(AbcGeom, f"O{kind}GeomParam")(self._parameters, name, indices is not None, scope, 1, metadata)
        param.set(sample)

    def _write_own(self) -> None:
        constant = _SCOPES["object"]
        if self._drawn.gather is not None:
            self._put("Int32", f"{OWN}vertex", _SCOPES["vertex"], self._drawn.gather, None)
        if self._drawn.hidden_lines:
            connectivity = self._item.connectivity
            self._put("Int32", f"{OWN}line_counts", constant, connectivity.line_counts, None)
            self._put("Int32", f"{OWN}line_indices", constant, connectivity.line_indices, None)
