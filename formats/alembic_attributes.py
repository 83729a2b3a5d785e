"""What an Alembic shape carries beside positions: UVs, colours, face sets and constant parameters, as attributes."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from alembic3d import AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic_arrays import to_numpy
from pdecodec.formats.alembic_scene import Geometry
from pdecodec.formats.attribute_roles import COLOR, GROUP, MATERIAL, UV, face_groups, role_name
from pdecodec.sequence import Attribute, AttributeDomain, Connectivity

OWN = "pdecodec_"
"""Beginning of the names of parameters that only we write and read."""

KIND, LABEL = "pdecodec_kind", "pdecodec_label"
"""Metadata of a face set: what it stands for, and its name where Alembic could not hold it."""

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

_COLORS = (AbcGeom.IC3fGeomParam, AbcGeom.IC4fGeomParam)

_UV_PARAMETERS = (AbcGeom.IV2fGeomParam,)

_SCOPES = {
    "kConstantScope": "object",
    "kUniformScope": "face",
    "kVaryingScope": "vertex",
    "kVertexScope": "vertex",
    "kFacevaryingScope": "corner",
}


@dataclass
class Extras:
    """Attributes of a shape, parameters of our own, and names of what is left out."""

    attributes: list[Attribute] = field(default_factory=list)
    own: dict[str, NDArray[Any]] = field(default_factory=dict)
    left_out: list[str] = field(default_factory=list)


def read_extras(shape: Geometry, connectivity: Connectivity, order: NDArray[np.int64]) -> Extras:
    """Everything constant that the shape carries.

    Parameters
    ----------
    shape : Geometry
    connectivity : Connectivity
        Faces already turned around.
    order : (corners,) int64
        Corner of the file that each corner of `connectivity` was.
    """
    extras = Extras()
    schema = shape.schema
    if shape.kind in ("mesh", "subdivision"):
        _read_uvs(schema.getUVsParam(), connectivity, order, extras)
        if shape.kind == "mesh" and schema.getNormalsParam().valid():
            extras.left_out.append("normals")
        _read_face_sets(shape, connectivity.face_count, extras)
    if schema.getVelocitiesProperty().valid():
        extras.left_out.append("velocities")
    parameters = schema.getArbGeomParams()
    if parameters.valid():
        for index in range(parameters.getNumProperties()):
            _read_parameter(parameters, parameters.getPropertyHeader(index), connectivity, order, extras)
    return extras


def _read_uvs(param: Any, connectivity: Connectivity, order: NDArray[np.int64], extras: Extras) -> None:
    if not param.valid() or param.getNumSamples() == 0:
        return
    name = param.getHeader().getMetaData().getSourceName()
    attribute = _attribute(param, role_name(UV, name or UV, ("st",)), connectivity, order)
    if attribute is None:
        extras.left_out.append(UV)
        return
    if not param.isConstant():
        extras.left_out.append(f"{attribute.name} after its first sample")
    extras.attributes.append(as_corners(attribute, connectivity))


def as_corners(attribute: Attribute, connectivity: Connectivity) -> Attribute:
    """An attribute of vertices as one of corners, the same rows shared."""
    if attribute.domain != "vertex":
        return attribute
    rows = np.arange(connectivity.vertex_count, dtype=np.int32) if attribute.indices is None else attribute.indices
    return Attribute(attribute.name, "corner", attribute.values, rows[connectivity.face_indices], attribute.labels)


def _read_face_sets(shape: Geometry, faces: int, extras: Extras) -> None:
    sets: dict[str, list[tuple[str, NDArray[np.integer]]]] = {GROUP: [], MATERIAL: []}
    # By the tree: the schema's own list of names is sorted.
    for index in range(shape.node.getNumChildren()):
        if not AbcGeom.IFaceSet.matches(shape.node.getChildHeader(index)):
            continue
        name = shape.node.getChildHeader(index).getName()
        face_set = AbcGeom.IFaceSet(shape.node, name)
        members = to_numpy(face_set.getSchema().getValue().getFaces())
        if members.size and not 0 <= members.min() <= members.max() < faces:
            extras.left_out.append(f"face set {name} (it names faces that are not there)")
            continue
        metadata = face_set.getMetaData()
        kind = MATERIAL if metadata.get(KIND) == MATERIAL else GROUP
        sets[kind].append((metadata.get(LABEL) or name, members))
    for kind, found in sets.items():
        extras.attributes += face_groups(kind, found, faces)


def _read_parameter(
    parent: Any, header: Any, connectivity: Connectivity, order: NDArray[np.int64], extras: Extras
) -> None:
    name = header.getName()
    kind = next((one for one in _PARAMETERS if one.matches(header)), None)
    if kind is None:
        extras.left_out.append(name)
        return
    param = kind(parent, name)
    if param.getNumSamples() == 0 or not param.isConstant():
        extras.left_out.append(f"{name} (it changes with time)" if param.getNumSamples() else name)
        return
    if name.startswith(OWN):
        extras.own[name.removeprefix(OWN)] = to_numpy(param.getIndexedValue().getVals())
        return
    if kind in _COLORS:
        name = role_name(COLOR, name, ())
    elif kind in _UV_PARAMETERS and header.getMetaData().isUV():
        name = role_name(UV, name, ())
    attribute = _attribute(param, name, connectivity, order)
    if attribute is None:
        extras.left_out.append(name)
    else:
        extras.attributes.append(attribute)


def _attribute(param: Any, name: str, connectivity: Connectivity, order: NDArray[np.int64]) -> Attribute | None:
    """A parameter's first sample as an attribute; None where it does not fit the shape."""
    sample = param.getIndexedValue()
    domain: AttributeDomain = _SCOPES.get(str(param.getScope()), "object")  # type: ignore[assignment]
    labels: tuple[str, ...] = ()
    if isinstance(param, AbcGeom.IStringGeomParam):
        labels = tuple(str(text) for text in sample.getVals())
        values: NDArray[Any] = np.arange(len(labels), dtype=np.int32)
    else:
        values = to_numpy(sample.getVals())
        extent = param.getArrayExtent()
        if extent > 1 and values.ndim == 1 and values.size % extent == 0:
            values = values.reshape(-1, extent)
    rows = {
        "vertex": connectivity.vertex_count,
        "face": connectivity.face_count,
        "corner": connectivity.face_indices.size,
        "object": None,
    }[domain]
    indices = to_numpy(sample.getIndices()).astype(np.int32) if param.isIndexed() else None
    given = len(values) if indices is None else indices.size
    if rows is not None and given != rows:
        return None
    if indices is not None and indices.size and not 0 <= indices.min() <= indices.max() < len(values):
        return None
    if domain == "corner":
        if indices is None:
            values = values[order]
        else:
            indices = indices[order]
    if labels and indices is not None:
        # Labels are told apart by the values themselves.
        values, indices = values[indices], None
    if domain == "object" and indices is not None:
        values, indices = values[indices], None
    return Attribute(name, domain, values, indices, labels)
