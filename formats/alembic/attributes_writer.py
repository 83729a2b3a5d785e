"""Write the data of an Alembic shape besides positions: UVs, colours, face sets and parameters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from alembic3d import AbcCoreAbstract, AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.attributes import KIND_KEY, LABEL_KEY, OWN_PREFIX
from pdecodec.formats.alembic.fields import DOMAIN_KEY, NOT_UV_KEY
from pdecodec.formats.alembic.values import (
    ARRAYS,
    SCOPES,
    WIDTHS,
    Keep,
    int_array,
    unsigned_array,
    vector_array,
)
from pdecodec.formats.base.attribute_roles import (
    COLOR,
    GROUP,
    MATERIAL,
    UV,
    face_sets,
    indexed_rows,
    is_by_vertex,
    is_role,
    label_numbers,
    reversed_corners,
    source_name,
    unique_name,
    uv_sets,
)
from pdecodec.formats.base.scene_writing import Parameter, ShapeForm, named_face_sets, write_parameters
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshObject

METADATA_MARKS = frozenset(";=")
"""Characters that Alembic's metadata cannot hold."""


_KINDS = {
    ("f", 4, 1): "Float",
    ("f", 4, 2): "V2f",
    ("f", 4, 3): "V3f",
    ("f", 8, 1): "Double",
    ("i", 4, 1): "Int32",
    ("u", 1, 1): "Uchar",
}
"""Names of Alembic's value types, by NumPy kind, size in bytes, and columns."""


def uv_sample(
    uv: Attribute, connectivity: Connectivity, order: Int64Array, keep: Keep, *, by_corner: bool = False
) -> Any:
    """Return the main UV set as an Alembic sample: by vertex if it is constant around vertices, else by corner.

    Rows that corners share stay shared. With `by_corner`, the sample is always by corner and indexed, as a parameter
    needs whose samples have several connectivities.
    """
    values, indices, _ = indexed_rows(uv)
    sample = AbcGeom.OV2fGeomParamSample
    if is_by_vertex(uv, connectivity) and not by_corner:
        return keep(sample(keep(vector_array(values[:, :2])), SCOPES["vertex"]))
    if indices is None and not by_corner:
        return keep(sample(keep(vector_array(values[order, :2])), SCOPES["corner"]))
    rows = keep(unsigned_array((np.arange(len(values)) if indices is None else indices)[order]))
    return keep(sample(keep(vector_array(values[:, :2])), rows, SCOPES["corner"]))


class ExtrasWriter:
    """Writes the data of a shape that are not samples of its schema, below the shape's handle.

    Data are written once, or, if connectivity changes, for every frame, because programs take the sample nearest to
    a time.

    Parameters
    ----------
    handle : AbcGeom object
        The shape; its schema must have its first sample already.
    sampling : int or None
        Number of the time sampling if data change, else None.
    taken : set of str
        Names of parameters of the shape; those written here are added.
    """

    def __init__(self, handle: Any, sampling: int | None, taken: set[str]) -> None:
        self._handle, self._sampling, self._taken = handle, sampling, taken
        self._parameters: dict[str, ParameterWriter] = {}
        self._face_sets: dict[tuple[str, str], Any] = {}
        self._members: dict[tuple[str, str], NDArray[np.integer]] = {}
        self._frames = 0

    def write(self, item: MeshObject, drawn: ShapeForm, written: Sequence[str]) -> list[str]:
        """Write a sample of all attributes of an object except those named `written`; return notices about what
        was lost.
        """
        notices = []
        # Programs show face sets as materials. If there are materials, groups are written as a parameter.
        self._sets = (MATERIAL,) if face_sets(item, MATERIAL) else (GROUP,)
        if drawn.kind == "mesh":
            self._write_face_sets(item)
            for uv in uv_sets(item)[:1]:
                if uv.values.shape[1] == 3:
                    notices.append(f"the third component of {uv.name!r} is not kept: UVs have two in Alembic")
                if uv.indices is not None and (uv.indices < 0).any():
                    notices.append(f"corners without a value of {uv.name!r} get (0, 0) in Alembic")
        put = partial(self._put_parameter, item, drawn, notices)
        notices += write_parameters(item, drawn, "Alembic", put, written, self._sets)
        if drawn.gather is not None:
            self._put("Int32", f"{OWN_PREFIX}vertex", "vertex", drawn.gather, None)
        if drawn.hidden_lines:
            self._put("Int32", f"{OWN_PREFIX}line_counts", "object", item.connectivity.line_counts, None)
            self._put("Int32", f"{OWN_PREFIX}line_indices", "object", item.connectivity.line_indices, None)
        self._frames += 1
        for parameter in self._parameters.values():
            if parameter.count < self._frames:
                parameter.fill(self._frames)
        return notices

    def repeat(self) -> None:
        """Repeat the previous sample for one more frame, if data change."""
        if self._sampling is None:
            return
        self._frames += 1
        for parameter in self._parameters.values():
            parameter.repeat()
        self._set_members()

    def _write_face_sets(self, item: MeshObject) -> None:
        self._members = {key: np.zeros(0, np.int32) for key in self._face_sets}
        taken = {face_set.getName() for face_set in self._face_sets.values()}
        for role, label, name, members in named_face_sets(item, lambda label: label.replace("/", "_"), self._sets):
            self._members[role, label] = members
            if (role, label) not in self._face_sets:
                self._face_sets[role, label] = self._new_face_set(role, label, unique_name(name, taken))
        self._set_members()

    def _new_face_set(self, role: str, label: str, name: str) -> Any:
        metadata = AbcCoreAbstract.MetaData()
        metadata.set(KIND_KEY, role)
        if name != label and not set(label) & METADATA_MARKS:
            metadata.set(LABEL_KEY, label)
        face_set = AbcGeom.OFaceSet(self._handle, name, metadata, *_sampling_argument(self._sampling))
        for _ in range(self._frames):
            _set_faces(face_set, np.zeros(0, np.int32))
        return face_set

    def _set_members(self) -> None:
        for key, face_set in self._face_sets.items():
            _set_faces(face_set, self._members[key])

    def _put_parameter(self, item: MeshObject, drawn: ShapeForm, notices: list[str], one: Parameter) -> bool:
        """Write an attribute as a parameter; return whether Alembic has a type for it."""
        attribute, values, indices = one.attribute, one.values, one.indices
        name, kind, domain = attribute.name, _KINDS.get(one.kind), attribute.domain
        metadata = {NOT_UV_KEY: "1"} if kind == "V2f" and one.role != UV else {}
        if one.role == COLOR:
            name, kind = source_name(attribute, COLOR, COLOR), "C3f" if one.width == 3 else "C4f"
            values, indices, filled = indexed_rows(attribute)
            if filled:
                notices.append(f"elements without a value of {attribute.name!r} are white in Alembic")
            if domain == "vertex" and indices is not None:
                # Programs ignore indices of colours of vertices.
                values, indices = values[indices], None
            elif drawn.kind == "mesh" and (domain == "face" or (domain == "object" and len(values) == 1)):
                metadata[DOMAIN_KEY] = domain
                counts = item.connectivity.face_counts if domain == "face" else item.connectivity.face_indices.size
                rows = np.arange(len(values), dtype=np.int32) if indices is None else indices
                domain, indices = "corner", np.repeat(rows, counts)
        elif one.role == UV and one.width == 2:
            name = source_name(attribute, UV, UV)
        elif one.role == "label":
            kind = "String"
        elif is_role(attribute, GROUP) and domain == "face" and attribute.labels:
            kind, metadata[KIND_KEY] = "String", GROUP
            numbers = label_numbers(attribute)
            inside = (numbers >= 0) & (numbers < len(attribute.labels))
            values = np.array([*attribute.labels, ""])
            indices = np.where(inside, numbers, len(attribute.labels)).astype(np.int32)
        if indices is not None and (indices < 0).any():
            if one.role != UV:
                return False
            values, indices, _ = indexed_rows(attribute)
        if kind is None:
            return False
        if domain == "corner":
            order = reversed_corners(item.connectivity.face_counts)
            values, indices = (values[order], None) if indices is None else (values, indices[order])
        flat = values.reshape(-1) if one.width == 1 else values
        valid = name.replace("/", "_")
        if valid != name and not set(name) & METADATA_MARKS:
            metadata[LABEL_KEY] = name
        return self._put(kind, valid, domain, flat, indices, metadata)

    def _put(
        self,
        kind: str,
        name: str,
        domain: AttributeDomain,
        values: NDArray[Any],
        indices: NDArray[Any] | None,
        metadata: Mapping[str, str] = {},
    ) -> bool:
        """Add a sample to a parameter; return False if it has one for this frame, has another kind, or is a field."""
        known = self._parameters.get(name)
        if known is None and name in self._taken:
            return False
        if known is None:
            self._taken.add(name)
            parent = self._handle.getSchema().getArbGeomParams()
            described = ParameterKind(kind, domain, metadata, indices is not None)
            known = self._parameters[name] = ParameterWriter(parent, name, described, self._sampling)
            known.fill(self._frames)
        elif known.count > self._frames or not known.takes(kind, domain, metadata):
            return False
        known.set(values, indices)
        return True


class ParameterKind(NamedTuple):
    """Name of a parameter's kind in Alembic, and the other properties that all its samples share."""

    kind: str
    domain: AttributeDomain
    metadata: Mapping[str, str]
    is_indexed: bool
    extent: int = 1


class ParameterWriter:
    """A parameter, and the number of its samples."""

    def __init__(self, parent: Any, name: str, described: ParameterKind, sampling: int | None) -> None:
        self._described = described
        kind, scope, metadata = described.kind, SCOPES[described.domain], AbcCoreAbstract.MetaData()
        for key, value in described.metadata.items():
            metadata.set(key, value)
        make = getattr(AbcGeom, f"O{kind}GeomParam")
        sampled = _sampling_argument(sampling)
        self._handle = make(parent, name, described.is_indexed, scope, described.extent, metadata, *sampled)
        self.count = 0

    def takes(self, kind: str, domain: AttributeDomain, metadata: Mapping[str, str]) -> bool:
        """Return whether the parameter has this kind, domain and metadata."""
        return self._described[:3] == (kind, domain, metadata)

    def set(self, values: NDArray[Any], indices: NDArray[Any] | None) -> None:
        """Add a sample; it has indices if and only if the first sample had them."""
        kind, scope = self._described.kind, SCOPES[self._described.domain]
        if not self._described.is_indexed and indices is not None:
            values, indices = values[indices], None
        elif self._described.is_indexed and indices is None:
            indices = np.arange(len(values))
        of_kind = getattr(AbcGeom, f"O{kind}GeomParamSample")
        array, numbers = ARRAYS[kind](values), None if indices is None else unsigned_array(indices)
        self._handle.set(of_kind(array, scope) if numbers is None else of_kind(array, numbers, scope))
        self.count += 1

    def fill(self, count: int) -> None:
        """Add empty samples until there are `count`."""
        width = WIDTHS.get(self._described.kind)
        while self.count < count:
            self.set(np.zeros((0,) if width is None else (0, width)), None)

    def repeat(self) -> None:
        """Add the previous sample once more."""
        self._handle.setFromPrevious()
        self.count += 1


def _set_faces(face_set: Any, members: NDArray[np.integer]) -> None:
    array = int_array(members)
    face_set.getSchema().set(AbcGeom.OFaceSetSchemaSample(array))


def _sampling_argument(sampling: int | None) -> tuple[int, ...]:
    """Return the last argument for creating an object or property: its time sampling, if it has one."""
    return () if sampling is None else (sampling,)
