"""Read the data of an Alembic shape besides positions: UVs, colours, face sets and constant parameters."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np
from alembic3d import AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.fields import (
    DOMAIN_KEY,
    DOMAINS,
    DTYPE_KEY,
    FIELD_PARAMETERS,
    Reader,
    field_name,
    field_of_parameter,
    interpolated,
    role_of_kind,
)
from pdecodec.formats.alembic.values import ALWAYS, change_times, sample_times, select, times_within, to_numpy
from pdecodec.formats.base.attribute_roles import GROUP, MATERIAL, SPACE, UV, VELOCITIES, role_name
from pdecodec.formats.base.normals import SHARED_NORMAL
from pdecodec.formats.base.scene_reading import Extras
from pdecodec.formats.base.stored_normals import StoredNormals, spread
from pdecodec.mesh.arrays import Float64Array, Int32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import AttributeDomain, Connectivity

FPS_PROPERTY, METADATA_PROPERTY = "pdecodec_fps", "pdecodec_metadata"
"""Properties of the top object that our writer adds, because Alembic has no place for these data."""


OWN_PREFIX = "pdecodec_"
"""Prefix of the names of parameters that only this package writes and reads."""


_OWN_CONNECTIVITY = tuple(f"{OWN_PREFIX}{name}" for name in ("vertex", "line_counts", "line_indices"))


ADDED_KEY = "pdecodec_added"
"""Metadata key of a transform that our writer adds to move a shape; it is no part of the object's name."""


KIND_KEY, LABEL_KEY = "pdecodec_kind", "pdecodec_label"
"""Metadata keys of a face set or parameter: the role it has, and its label if Alembic's names cannot hold it."""


FaceSet = tuple[str, NDArray[np.integer]]
"""Label, and the faces of the set."""


_PARAMETERS = {**FIELD_PARAMETERS, "String": AbcGeom.IStringGeomParam}
"""Types of parameters by their names."""


_CONSTANT = {"Float", "Int32", "V2f", "V3f", "P3f", "N3f", "C3f", "C4f", "Double", "Uchar", "String"}
"""Names of the types that an attribute can hold."""


class AlembicExtras(Extras):
    """Data of a shape, and what became of each property and face set that was read.

    Attributes
    ----------
    fates : dict of str to (bool, str)
        For each path below the shape, such as ``.arbGeomParams/Cd``: whether it is kept, and a note on what is lost.
    span : (float, float) [s]
        Times between which the connectivity is constant: what changes between them becomes a field.
    samplings : list of ((samples,) float64 [s], TimeSampling)
        Times and time samplings of fields.
    """

    def __init__(self, connectivity: Connectivity, order: Int64Array, span: tuple[float, float] = ALWAYS) -> None:
        super().__init__(connectivity, order)
        self.fates: dict[str, tuple[bool, str]] = {}
        self.span = span
        self.samplings: list[tuple[Float64Array, Any]] = []

    @contextmanager
    def reading(self, *names: str) -> Iterator[None]:
        """Record what becomes of the properties that are read in the block."""
        before, kept = len(self.left_out), self._count()
        yield
        lost = self.left_out[before:]
        self.fates |= dict.fromkeys(names, (self._count() > kept or not lost, ", ".join(lost)))

    def _count(self) -> int:
        return len(self.attributes) + len(self.own) + len(self.fields)

    def changes(self, param: Any) -> bool:
        """Return whether a parameter changes while connectivity does not."""
        if param.isConstant() or self.span == ALWAYS:
            return not param.isConstant()
        props = [one for one in (param.getValueProperty(), param.getIndexProperty()) if one.valid()]
        return next(change_times(props, self.span), None) is not None

    def add_samples(
        self,
        prop: Any,
        find: Callable[[Float64Array], tuple[Field, Reader]],
        place: str,
        rows_at: Callable[[float], Int64Array] | None = None,
    ) -> None:
        """Add a field whose samples are those of a property at `place`; `find` returns it from times [s] to read."""
        times = sample_times(prop)
        inside = times_within(times, self.span)
        own = inside if inside.size else times[:1]
        moving = own.size > 1 and not prop.isConstant()
        field, read_at = find(own)
        before = len(self.fields)
        self.add_field(field, read_at, own.tolist() if moving else (), place, rows_at)
        if moving and len(self.fields) > before:
            self.samplings.append((times, prop.getTimeSampling()))

    def add_parameter(self, param: Any, name: str, metadata: Any, place: str) -> None:
        """Add a parameter that changes, as a field. The field is called `name` unless the metadata give another
        name.
        """
        numbers = field_of_parameter(param, name, metadata, self.connectivity)
        if numbers is None:
            self.left_out.append(f"{name} (it changes with time)")
            return
        field, sample, rows_at = numbers
        place += "/.vals" if param.isIndexed() else ""
        self.add_samples(param, lambda times: (field, interpolated(sample, times, field)), place, rows_at)

    def add_velocities(self, prop: Any) -> None:
        """Add velocities of points, if there are any."""
        field = Field(VELOCITIES, "vertex", components=SPACE)

        def sample(time: float) -> NDArray[Any]:
            return to_numpy(prop.getValue(select(time)))

        if prop.valid() and prop.getNumSamples():
            with self.reading(".velocities"):
                self.add_samples(prop, lambda times: (field, interpolated(sample, times, field)), ".geom/.velocities")


def read_extras(kind: str, schema: Any, node: Any, extras: AlembicExtras, at: Any = None) -> None:
    """Read all data of a shape; the connectivity of `extras` has faces that are already reversed.

    What changes becomes fields. If the selector `at` is given, read everything else at its sample.
    """
    if kind in ("mesh", "subdivision"):
        uvs = schema.getUVsParam()
        if uvs.valid() and uvs.getNumSamples():
            with extras.reading("uv"):
                name = role_name(UV, uvs.getHeader().getMetaData().getSourceName() or UV, ("st",))
                if extras.changes(uvs):
                    extras.add_parameter(uvs, name, uvs.getHeader().getMetaData(), ".geom/uv")
                else:
                    domain, values, indices = _sample(uvs, at)
                    if at is None or values.size:
                        extras.add(name, domain, values, indices)
        if kind == "mesh" and schema.getNormalsParam().valid() and schema.getNormalsParam().getNumSamples():
            with extras.reading("N"):
                _read_normals(schema, extras, at)
        _read_face_sets(node, extras, at)
    parameters = schema.getArbGeomParams()
    if parameters.valid():
        for index in range(parameters.getNumProperties()):
            header = parameters.getPropertyHeader(index)
            with extras.reading(f".arbGeomParams/{header.getName()}"):
                _read_parameter(parameters, header, extras, at)
    extras.add_velocities(schema.getVelocitiesProperty())


def _read_normals(schema: Any, extras: AlembicExtras, at: Any) -> None:
    param, positions, parameters = schema.getNormalsParam(), schema.getPositionsProperty(), schema.getArbGeomParams()
    stored = StoredNormals(*_sample(param, at))
    if at is not None and not stored.values.size:
        return
    times, of_normals = (times_within(sample_times(one), extras.span) for one in (positions, param))

    def later() -> Iterator[tuple[NDArray[Any], StoredNormals | None]]:
        for time in spread(times.tolist()):
            points = np.asarray(positions.getValue(select(time))).reshape(-1, 3)
            if len(points) == extras.connectivity.vertex_count:
                # Normals that are not sampled belong to the first positions.
                yield points, StoredNormals(*_sample(param, select(time))) if of_normals.size > 1 else None

    first = np.asarray(positions.getValue(select(sample_times(positions)[0]) if at is None else at)).reshape(-1, 3)
    has_shared = parameters.valid() and parameters.getPropertyHeader(SHARED_NORMAL) is not None
    extras.add_normals(stored, first, later(), has_shared=has_shared)


def find_own_properties(schema: Any) -> list[Any]:
    """Return array properties that only our writer adds: which vertices curves share, and lines of a mesh with
    faces.
    """
    parameters = schema.getArbGeomParams()
    if not parameters.valid():
        return []
    names = [parameters.getPropertyHeader(index).getName() for index in range(parameters.getNumProperties())]
    return [AbcGeom.IInt32GeomParam(parameters, name).getValueProperty() for name in names if name in _OWN_CONNECTIVITY]


def _read_face_sets(node: Any, extras: AlembicExtras, at: Any) -> None:
    found = []
    # In the order of the tree, because the schema sorts its own list of names.
    for index in range(node.getNumChildren()):
        if not AbcGeom.IFaceSet.matches(node.getChildHeader(index)):
            continue
        name = node.getChildHeader(index).getName()
        face_set = AbcGeom.IFaceSet(node, name)
        members = to_numpy(value_at(face_set.getSchema().getValue, at).getFaces())
        if at is not None and not members.size:
            # The set belongs to other runs of frames.
            continue
        with extras.reading(name):
            fits = not members.size or 0 <= members.min() <= members.max() < extras.connectivity.face_count
            if not fits:
                extras.left_out.append(f"face set {name} (it names faces that do not exist)")
            elif at is None and not face_set.getSchema().isConstant():
                extras.left_out.append(f"face set {name} after its first sample")
        extras.fates[name] = (fits, extras.fates[name][1])
        if not fits:
            continue
        metadata = face_set.getMetaData()
        found.append((metadata.get(KIND_KEY), metadata.get(LABEL_KEY) or name, members))
    ours, others = ([one for one in found if bool(one[0]) == is_ours] for is_ours in (True, False))
    extras.add_face_sets([*ours, *_shown_as_materials([one[1:] for one in others])])


def _shown_as_materials(found: Sequence[FaceSet]) -> list[tuple[str, str, NDArray[np.integer]]]:
    """Return role, label and members of face sets as programs show them, each set as a material.

    If a face is in several sets, the last one by name shows; then every set is also returned as a group.
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
    """Call a getter of samples with a selector, or without one for the first sample."""
    return get() if at is None else get(at)


def _read_parameter(parent: Any, header: Any, extras: AlembicExtras, at: Any) -> None:
    name, metadata = header.getName(), header.getMetaData()
    kind = next((kind for kind, one in _PARAMETERS.items() if one.matches(header)), "")
    param = _PARAMETERS[kind](parent, name) if kind else None
    if param is None or not param.getNumSamples():
        extras.left_out.append(name)
        return
    own = name.startswith(OWN_PREFIX)
    if not own and (metadata.get(DTYPE_KEY) or extras.changes(param)):
        wanted = field_name(kind, metadata.get(LABEL_KEY) or name, metadata)
        extras.add_parameter(param, wanted, metadata, f".geom/.arbGeomParams/{name}")
        return
    if kind not in _CONSTANT:
        extras.left_out.append(name)
        return
    if own:
        # It is empty if this run has none, which has the same effect as a missing one.
        extras.own[name.removeprefix(OWN_PREFIX)] = to_numpy(value_at(param.getIndexedValue, at).getVals())
        return
    name = role_of_kind(kind, metadata.get(LABEL_KEY) or name, metadata)
    domain, values, indices = _sample(param, at)
    if at is not None and not values.size and not (indices is not None and indices.size):
        # The parameter belongs to other runs of frames.
        return
    domain_of = metadata.get(DOMAIN_KEY)
    if domain_of and indices is not None and indices.size == extras.connectivity.face_indices.size:
        counts = extras.connectivity.face_counts
        domain, indices = ("face", indices[np.cumsum(counts) - counts]) if domain_of == "face" else ("object", None)
        if indices is not None and np.array_equal(indices, np.arange(len(values))):
            indices = None
    labels = tuple(map(str, values)) if kind == "String" else ()
    if labels:
        values = np.arange(len(labels), dtype=np.int32)
    if labels and metadata.get(KIND_KEY):
        # The last label means no group.
        labels, values[-1] = labels[:-1], -1
    extras.add(name, domain, values, indices, labels)


def _sample(param: Any, at: Any) -> tuple[AttributeDomain, NDArray[Any], Int32Array | None]:
    """Return the domain, values and indices of a numeric parameter."""
    sample = value_at(param.getIndexedValue, at)
    values = to_numpy(sample.getVals())
    extent = param.getArrayExtent()
    if extent > 1 and values.ndim == 1 and values.size % extent == 0:
        values = values.reshape(-1, extent)
    indices = to_numpy(sample.getIndices()).astype(np.int32) if param.isIndexed() else None
    return DOMAINS.get(str(param.getScope()), "object"), values, indices
