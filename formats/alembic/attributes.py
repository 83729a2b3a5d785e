"""What an Alembic shape carries beside positions: UVs, colours, face sets and constant parameters, read."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from alembic3d import AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.values import change_times, to_numpy
from pdecodec.formats.base.attribute_roles import (
    COLOR,
    GROUP,
    MATERIAL,
    UV,
    role_name,
)
from pdecodec.formats.base.scene_reading import Extras
from pdecodec.formats.base.times import SAME_TIME
from pdecodec.mesh.arrays import Int32Array, Int64Array
from pdecodec.mesh.sequence import AttributeDomain, Connectivity

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


NOT_UV = "notUV"
"""Metadata of a parameter of two numbers that are no texture coordinates; Alembic's own."""


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


class AlembicExtras(Extras):
    """What a shape carries, and what became of each property and face set that was read.

    Attributes
    ----------
    fates : dict of str to (bool, str)
        By the path below the shape, ``.arbGeomParams/Cd``: whether it is kept, and what of it is not, in words.
    edges : sequence of float [s] or None
        When connectivity changes, where what changes in between is to be noted.
    """

    def __init__(self, connectivity: Connectivity, order: Int64Array, edges: Sequence[float] | None = None) -> None:
        super().__init__(connectivity, order)
        self.fates: dict[str, tuple[bool, str]] = {}
        self.edges = edges

    @contextmanager
    def reading(self, *names: str) -> Iterator[None]:
        """Note what becomes of properties that are read within."""
        before, kept = len(self.left_out), len(self.attributes) + len(self.own)
        yield
        lost = self.left_out[before:]
        is_kept = len(self.attributes) + len(self.own) > kept or not lost
        self.fates |= dict.fromkeys(names, (is_kept, ", ".join(lost)))

    def note_changes(self, name: str, param: Any) -> None:
        """Note a parameter that changes while connectivity does not."""
        if self.edges is not None and not param.isConstant():
            changes = change_times([one for one in (param.getValueProperty(), param.getIndexProperty()) if one.valid()])
            if any(np.abs(np.asarray(self.edges) - time).min(initial=np.inf) > SAME_TIME for time in changes):
                self.left_out.append(f"{name} where it changes and faces do not")


def read_extras(kind: str, schema: Any, node: Any, extras: AlembicExtras, at: Any = None) -> None:
    """Read everything constant that a shape carries; the connectivity of `extras` has faces already turned around.

    Where a selector says `at` which sample, everything is read there, be it constant or not.
    """
    if kind in ("mesh", "subdivision"):
        uvs = schema.getUVsParam()
        if uvs.valid() and uvs.getNumSamples():
            with extras.reading("uv"):
                name = role_name(UV, uvs.getHeader().getMetaData().getSourceName() or UV, ("st",))
                domain, values, indices = _sample(uvs, at)
                if at is None or values.size:
                    extras.add(name, domain, values, indices)
                if at is None and not uvs.isConstant():
                    extras.left_out.append(f"{name} after its first sample")
                extras.note_changes(name, uvs)
        if kind == "mesh" and schema.getNormalsParam().valid() and schema.getNormalsParam().getNumSamples():
            with extras.reading("N"):
                domain, values, indices = _sample(schema.getNormalsParam(), at)
                if at is None or values.size:
                    extras.add_normals(domain, values, indices)
        _read_face_sets(node, extras, at)
    parameters = schema.getArbGeomParams()
    if parameters.valid():
        for index in range(parameters.getNumProperties()):
            header = parameters.getPropertyHeader(index)
            with extras.reading(f".arbGeomParams/{header.getName()}"):
                _read_parameter(parameters, header, extras, at)


def own_properties(schema: Any) -> list[Any]:
    """Array properties that only our writer leaves: which vertices curves share, and lines beside faces."""
    parameters = schema.getArbGeomParams()
    if not parameters.valid():
        return []
    names = [parameters.getPropertyHeader(index).getName() for index in range(parameters.getNumProperties())]
    return [AbcGeom.IInt32GeomParam(parameters, name).getValueProperty() for name in names if name in _OWN_CONNECTIVITY]


def _read_face_sets(node: Any, extras: AlembicExtras, at: Any) -> None:
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
        with extras.reading(name):
            fits = not members.size or 0 <= members.min() <= members.max() < extras.connectivity.face_count
            if not fits:
                extras.left_out.append(f"face set {name} (it names faces that are not there)")
            elif at is None and not face_set.getSchema().isConstant():
                extras.left_out.append(f"face set {name} after its first sample")
        extras.fates[name] = (fits, extras.fates[name][1])
        if not fits:
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


def _read_parameter(parent: Any, header: Any, extras: AlembicExtras, at: Any) -> None:
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
    extras.note_changes(name, param)
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
