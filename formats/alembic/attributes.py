"""What an Alembic shape carries beside positions: UVs, colours, face sets and constant parameters, in and out."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np
from alembic3d import AbcCoreAbstract, AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.values import (
    ARRAYS,
    SCOPES,
    WIDTHS,
    Keep,
    int_array,
    to_numpy,
    unsigned_array,
    vector_array,
)
from pdecodec.formats.base.attribute_roles import (
    COLOR,
    GROUP,
    MATERIAL,
    UV,
    expanded,
    face_sets,
    indexed_rows,
    is_by_vertex,
    is_role,
    reversed_corners,
    role_name,
    source_name,
    uv_sets,
)
from pdecodec.formats.base.scene_reading import Extras
from pdecodec.formats.base.scene_writing import Drawn, Parameter, named_face_sets, unlike, write_parameters
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import Attribute, AttributeDomain, Connectivity, MeshObject

FPS_PROPERTY, METADATA_PROPERTY = "pdecodec_fps", "pdecodec_metadata"
"""Properties of the top object that our writer leaves: Alembic has no place for either."""


OWN = "pdecodec_"
"""Beginning of the names of parameters that only we write and read."""


_OWN_CONNECTIVITY = tuple(f"{OWN}{name}" for name in ("vertex", "line_counts", "line_indices"))


ADDED = "pdecodec_added"
"""Metadata of a transform that names of objects do not have: it is there to move one of them."""


KIND, LABEL = "pdecodec_kind", "pdecodec_label"
"""Metadata of a face set or of a parameter of groups: what it stands for; and its name where Alembic cannot hold it."""


DOMAIN = "pdecodec_domain"
"""Metadata of colours of corners that are those of faces or of an object: programs know no others of a mesh."""


FaceSet = tuple[str, NDArray[np.integer]]
"""Label and members."""


DOMAIN = "pdecodec_domain"
"""Metadata of a colour of corners: the domain that it has one for, where programs know colours of corners alone."""


NOT_UV = "notUV"
"""Metadata of a parameter of two numbers that are no texture coordinates; Alembic's own."""


METADATA_MARKS = frozenset(";=")
"""Characters that Alembic's metadata cannot hold."""


_PARAMETERS = (
    AbcGeom.IFloatGeomParam,
    AbcGeom.IInt32GeomParam,
    AbcGeom.IV2fGeomParam,
    AbcGeom.IV3fGeomParam,
    AbcGeom.IP3fGeomParam,
    AbcGeom.IN3fGeomParam,
    AbcGeom.IC3fGeomParam,
    AbcGeom.IC4fGeomParam,
    AbcGeom.IDoubleGeomParam,
    AbcGeom.IUcharGeomParam,
    AbcGeom.IStringGeomParam,
)
"""Types of parameters that an attribute can hold."""


_DOMAINS: dict[str, AttributeDomain] = {
    "kConstantScope": "object",
    "kUniformScope": "face",
    "kVaryingScope": "vertex",
    "kVertexScope": "vertex",
    "kFacevaryingScope": "corner",
}


_KINDS = {
    ("f", 4, 1): "Float",
    ("f", 4, 2): "V2f",
    ("f", 4, 3): "V3f",
    ("f", 8, 1): "Double",
    ("i", 4, 1): "Int32",
    ("u", 1, 1): "Uchar",
}
"""Alembic's types of values: by NumPy kind, bytes, and columns."""


def read_extras(
    kind: str, schema: Any, node: Any, connectivity: Connectivity, order: Int64Array, at: Any = None
) -> Extras:
    """Everything constant that a shape carries; `connectivity` has faces already turned around, from `order`.

    Where a selector says `at` which sample, everything is read there, be it constant or not.
    """
    extras = Extras(connectivity, order)
    if kind in ("mesh", "subdivision"):
        uvs = schema.getUVsParam()
        if uvs.valid() and uvs.getNumSamples():
            name = role_name(UV, uvs.getHeader().getMetaData().getSourceName() or UV, ("st",))
            domain, values, indices = _sample(uvs, at)
            if at is None or values.size:
                extras.add(name, domain, values, indices)
            if at is None and not uvs.isConstant():
                extras.left_out.append(f"{name} after its first sample")
        if kind == "mesh" and schema.getNormalsParam().valid() and schema.getNormalsParam().getNumSamples():
            domain, values, indices = _sample(schema.getNormalsParam(), at)
            if at is None or values.size:
                extras.add_normals(domain, values, indices)
        _read_face_sets(node, extras, at)
    if schema.getVelocitiesProperty().valid():
        extras.left_out.append("velocities")
    parameters = schema.getArbGeomParams()
    if parameters.valid():
        for index in range(parameters.getNumProperties()):
            _read_parameter(parameters, parameters.getPropertyHeader(index), extras, at)
    return extras


def own_properties(schema: Any) -> list[Any]:
    """Array properties that only our writer leaves: which vertices curves share, and lines beside faces."""
    parameters = schema.getArbGeomParams()
    if not parameters.valid():
        return []
    names = [parameters.getPropertyHeader(index).getName() for index in range(parameters.getNumProperties())]
    return [AbcGeom.IInt32GeomParam(parameters, name).getValueProperty() for name in names if name in _OWN_CONNECTIVITY]


def _read_face_sets(node: Any, extras: Extras, at: Any) -> None:
    found = []
    # By the tree: the schema's own list of names is sorted.
    for index in range(node.getNumChildren()):
        if not AbcGeom.IFaceSet.matches(node.getChildHeader(index)):
            continue
        name = node.getChildHeader(index).getName()
        face_set = AbcGeom.IFaceSet(node, name)
        members = to_numpy(value_at(face_set.getSchema().getValue, at).getFaces())
        if at is not None and not members.size:
            # A set that other runs of frames have.
            continue
        if members.size and not 0 <= members.min() <= members.max() < extras.connectivity.face_count:
            extras.left_out.append(f"face set {name} (it names faces that are not there)")
            continue
        metadata = face_set.getMetaData()
        found.append((metadata.get(KIND), metadata.get(LABEL) or name, members))
    ours, others = ([one for one in found if bool(one[0]) == is_ours] for is_ours in (True, False))
    extras.add_face_sets([*ours, *_shown_as_materials([one[1:] for one in others])])


def _shown_as_materials(found: Sequence[FaceSet]) -> list[tuple[str, str, NDArray[np.integer]]]:
    """Return the role, the label and the members of face sets as programs show them: each set is a material.

    Where a face is in several sets the last one by name shows; then the sets are groups besides.
    """
    size = 1 + max((int(members.max(initial=-1)) for _, members in found), default=-1)
    shown, in_order = np.full(size, -1), sorted(found, key=lambda one: one[0])
    for number, (_, members) in enumerate(in_order):
        shown[members] = number
    if np.count_nonzero(shown >= 0) == sum(np.unique(members).size for _, members in found):
        return [(MATERIAL, label, members) for label, members in found]
    materials = [(MATERIAL, label, np.flatnonzero(shown == number)) for number, (label, _) in enumerate(in_order)]
    return [*((GROUP, label, members) for label, members in found), *materials]


def value_at(get: Callable[..., Any], at: Any) -> Any:
    """What a getter of samples gives where a selector says, or of the first sample."""
    return get() if at is None else get(at)


def _read_parameter(parent: Any, header: Any, extras: Extras, at: Any) -> None:
    name = header.getName()
    kind = next((one for one in _PARAMETERS if one.matches(header)), None)
    if kind is None:
        extras.left_out.append(name)
        return
    param = kind(parent, name)
    if param.getNumSamples() == 0 or (at is None and not param.isConstant()):
        extras.left_out.append(f"{name} (it changes with time)" if param.getNumSamples() else name)
        return
    if name.startswith(OWN):
        # Of a run that has none it is empty, as where there is none.
        extras.own[name.removeprefix(OWN)] = to_numpy(value_at(param.getIndexedValue, at).getVals())
        return
    metadata = header.getMetaData()
    name = metadata.get(LABEL) or name
    if kind in (AbcGeom.IC3fGeomParam, AbcGeom.IC4fGeomParam):
        name = role_name(COLOR, name, ())
    elif kind is AbcGeom.IV2fGeomParam and metadata.get(NOT_UV) != "1":
        name = role_name(UV, name, ())
    domain, values, indices = _sample(param, at)
    if at is not None and not values.size and not (indices is not None and indices.size):
        # What other runs of frames have.
        return
    own = metadata.get(DOMAIN)
    if own and indices is not None and indices.size == extras.connectivity.face_indices.size:
        counts = extras.connectivity.face_counts
        domain, indices = ("face", indices[np.cumsum(counts) - counts]) if own == "face" else ("object", None)
        if indices is not None and np.array_equal(indices, np.arange(len(values))):
            indices = None
    labels = tuple(map(str, values)) if kind is AbcGeom.IStringGeomParam else ()
    if labels:
        values = np.arange(len(labels), dtype=np.int32)
    if labels and metadata.get(KIND):
        # The last label stands for none.
        labels, values[-1] = labels[:-1], -1
    extras.add(name, domain, values, indices, labels)


def _sample(param: Any, at: Any) -> tuple[AttributeDomain, NDArray[Any], Int32Array | None]:
    """Domain, values and indices of a parameter of numbers."""
    sample = value_at(param.getIndexedValue, at)
    values = to_numpy(sample.getVals())
    extent = param.getArrayExtent()
    if extent > 1 and values.ndim == 1 and values.size % extent == 0:
        values = values.reshape(-1, extent)
    indices = to_numpy(sample.getIndices()).astype(np.int32) if param.isIndexed() else None
    return _DOMAINS.get(str(param.getScope()), "object"), values, indices


def uv_sample(
    uv: Attribute, connectivity: Connectivity, order: Int64Array, keep: Keep, *, by_corner: bool = False
) -> Any:
    """The main UV set as Alembic's sample: by vertex where it is, else by corner, rows shared as they are.

    Where it is to be `by_corner`, as a parameter is that has samples of several connectivities, always so and indexed.
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
    """Writes what a shape carries beside the samples of its schema, under its handle.

    Once, or, where it changes, a sample for every frame: programs take the sample that is nearest to a time.

    Parameters
    ----------
    handle : AbcGeom object
        Of the shape, whose schema has its first sample already.
    sampling : int or None
        Number of the time sampling, where things change.
    """

    def __init__(self, handle: Any, sampling: int | None) -> None:
        self._handle, self._sampling = handle, sampling
        self._parameters: dict[str, _ParameterWriter] = {}
        self._face_sets: dict[tuple[str, str], Any] = {}
        self._members: dict[tuple[str, str], NDArray[np.integer]] = {}
        self._frames = 0

    def write(self, item: MeshObject, drawn: Drawn, written: Sequence[str]) -> list[str]:
        """Write a sample of what an object carries, but for attributes of these names; what had no place."""
        notices = []
        # Programs show face sets as materials: beside those, groups are a parameter.
        self._sets = (MATERIAL,) if face_sets(item, MATERIAL) else (GROUP,)
        if drawn.kind == "mesh":
            self._write_face_sets(item)
            for uv in uv_sets(item)[:1]:
                if uv.values.shape[1] == 3:
                    notices.append(f"the third number of {uv.name!r} is not kept: UVs have two in Alembic")
                if uv.indices is not None and (uv.indices < 0).any():
                    notices.append(f"corners without a row of {uv.name!r} have (0, 0) in Alembic")
        put = partial(self._put_parameter, item, drawn, notices)
        notices += write_parameters(item, drawn, "Alembic", put, written, self._sets)
        if drawn.gather is not None:
            self._put("Int32", f"{OWN}vertex", "vertex", drawn.gather, None)
        if drawn.hidden_lines:
            self._put("Int32", f"{OWN}line_counts", "object", item.connectivity.line_counts, None)
            self._put("Int32", f"{OWN}line_indices", "object", item.connectivity.line_indices, None)
        self._frames += 1
        for parameter in self._parameters.values():
            if parameter.count < self._frames:
                parameter.fill(self._frames)
        return notices

    def repeat(self) -> None:
        """Write the sample of one more frame as the one before it; where nothing changes, nothing."""
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
                self._face_sets[role, label] = self._new_face_set(role, label, unlike(name, taken))
        self._set_members()

    def _new_face_set(self, role: str, label: str, name: str) -> Any:
        metadata = AbcCoreAbstract.MetaData()
        metadata.set(KIND, role)
        if name != label and not set(label) & METADATA_MARKS:
            metadata.set(LABEL, label)
        face_set = AbcGeom.OFaceSet(self._handle, name, metadata, *_sampled(self._sampling))
        for _ in range(self._frames):
            _set_faces(face_set, np.zeros(0, np.int32))
        return face_set

    def _set_members(self) -> None:
        for key, face_set in self._face_sets.items():
            _set_faces(face_set, self._members[key])

    def _put_parameter(self, item: MeshObject, drawn: Drawn, notices: list[str], one: Parameter) -> bool:
        """Whether there was a type of parameter for it."""
        attribute, values, indices = one.attribute, one.values, one.indices
        name, kind, domain = attribute.name, _KINDS.get(one.kind), attribute.domain
        metadata = {NOT_UV: "1"} if kind == "V2f" and one.role != UV else {}
        if one.role == COLOR:
            name, kind = source_name(attribute, COLOR, COLOR), "C3f" if one.width == 3 else "C4f"
            values, indices, filled = indexed_rows(attribute)
            if filled:
                notices.append(f"where {attribute.name!r} has no row it is white in Alembic")
            if domain == "vertex" and indices is not None:
                # Programs do not look colours of vertices up.
                values, indices = values[indices], None
            elif drawn.kind == "mesh" and (domain == "face" or (domain == "object" and len(values) == 1)):
                metadata[DOMAIN] = domain
                counts = item.connectivity.face_counts if domain == "face" else item.connectivity.face_indices.size
                rows = np.arange(len(values), dtype=np.int32) if indices is None else indices
                domain, indices = "corner", np.repeat(rows, counts)
        elif one.role == UV and one.width == 2:
            name = source_name(attribute, UV, UV)
        elif one.role == "label":
            kind = "String"
        elif is_role(attribute, GROUP) and domain == "face" and attribute.labels:
            kind, metadata[KIND] = "String", GROUP
            rows = expanded(attribute)
            inside = (rows >= 0) & (rows < len(attribute.labels))
            values, indices = np.array([*attribute.labels, ""]), np.where(inside, rows, len(attribute.labels))
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
            metadata[LABEL] = name
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
        """Whether no parameter of this name has this sample already, or is of another kind."""
        known = self._parameters.get(name)
        if known is None:
            parent = self._handle.getSchema().getArbGeomParams()
            described = _Described(kind, domain, metadata, indices is not None)
            known = self._parameters[name] = _ParameterWriter(parent, name, described, self._sampling)
            known.fill(self._frames)
        elif known.count > self._frames or not known.takes(kind, domain, metadata):
            return False
        known.set(values, indices)
        return True


class _Described(NamedTuple):
    """What a parameter is in all of its samples: its kind by Alembic's name, and the rest."""

    kind: str
    domain: AttributeDomain
    metadata: Mapping[str, str]
    is_indexed: bool


class _ParameterWriter:
    """A parameter and how many samples it has."""

    def __init__(self, parent: Any, name: str, described: _Described, sampling: int | None) -> None:
        self._described = described
        kind, scope, metadata = described.kind, SCOPES[described.domain], AbcCoreAbstract.MetaData()
        for key, value in described.metadata.items():
            metadata.set(key, value)
        make = getattr(AbcGeom, f"O{kind}GeomParam")
        self._handle = make(parent, name, described.is_indexed, scope, 1, metadata, *_sampled(sampling))
        self.count = 0

    def takes(self, kind: str, domain: AttributeDomain, metadata: Mapping[str, str]) -> bool:
        """Whether it is of this kind."""
        return self._described[:3] == (kind, domain, metadata)

    def set(self, values: NDArray[Any], indices: NDArray[Any] | None) -> None:
        """Add a sample, with indices or without them as the first one was."""
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
        """Add samples of nothing until there are so many."""
        width = WIDTHS.get(self._described.kind)
        while self.count < count:
            self.set(np.zeros((0,) if width is None else (0, width)), None)

    def repeat(self) -> None:
        self._handle.setFromPrevious()
        self.count += 1


def _set_faces(face_set: Any, members: NDArray[np.integer]) -> None:
    array = int_array(members)
    face_set.getSchema().set(AbcGeom.OFaceSetSchemaSample(array))


def _sampled(sampling: int | None) -> tuple[int, ...]:
    """The last argument of what makes an object or a property, where it has a time sampling of its own."""
    return () if sampling is None else (sampling,)
