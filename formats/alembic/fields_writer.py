"""Write the data of an Alembic shape that change with time, as parameters with a sample for each frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any
from urllib.parse import quote

import numpy as np
from alembic3d import AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.attributes import OWN_PREFIX
from pdecodec.formats.alembic.attributes_writer import ParameterKind, ParameterWriter
from pdecodec.formats.alembic.fields import DOMAIN_KEY, DTYPE_KEY, NAME_KEY, UNIT_KEY, field_name
from pdecodec.formats.alembic.values import SCOPES, WIDTHS, Keep, unsigned_array, vector_array
from pdecodec.formats.base.attribute_roles import (
    COLOR,
    NORMAL,
    UV,
    VECTOR,
    direction_role,
    field_source_name,
    limited_to_double,
    reversed_corners,
    unique_name,
)
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.looks import SharedRows
from pdecodec.mesh.sequence import Connectivity

_ROLE_KINDS = {
    (UV, "f4", 2): "V2f",
    (COLOR, "f4", 3): "C3f",
    (COLOR, "f4", 4): "C4f",
    (VECTOR, "f4", 3): "V3f",
    (VECTOR, "f8", 3): "V3d",
    (NORMAL, "f4", 3): "N3f",
    (NORMAL, "f8", 3): "N3d",
}
"""Names of Alembic's types by role, NumPy type and components; other fields are arrays of numbers with an extent."""

_SCALAR_KINDS = {
    "f4": "Float",
    "f8": "Double",
    "i8": "Double",
    "u8": "Double",
    "u1": "Uchar",
    "u4": "UInt32",
    "b1": "Boolean",
}
"""Names of Alembic's types of single numbers, by NumPy's; other integers are written as Int32. The Python binding does
not write 64-bit integers.
"""


def is_uv_set(field: Field, *, changes: bool) -> bool:
    """Return whether the UVs of a mesh can hold a field. If connectivity changes, UVs are always stored per corner."""
    return _role_kind(field) == "V2f" and (field.domain == "corner" or (field.domain == "vertex" and not changes))


def _role_kind(field: Field) -> str | None:
    role = direction_role(field) or field.name.partition(":")[0]
    return _ROLE_KINDS.get((role, field.dtype.str[1:], field.components))


class FieldsWriter:
    """Writer of the fields of one shape.

    Parameters
    ----------
    handle : AbcGeom object
        The shape; its schema must have its first sample already.
    sampling : int
        Number of the time sampling of frames.
    taken : set of str
        Names of parameters of the shape; those of fields are added.
    """

    def __init__(self, handle: Any, sampling: int, taken: set[str]) -> None:
        self._handle, self._sampling, self._taken = handle, sampling, taken
        self._known: dict[str, tuple[ParameterKind, ParameterWriter]] = {}
        self._shared: dict[str, tuple[Connectivity, SharedRows]] = {}
        self._frames = 0

    def write(self, fields: Sequence[tuple[Field, NDArray[Any]]], frames: int, connectivity: Connectivity) -> list[str]:
        """Write values (frames, rows, components); return notices about losses.

        Parameters of fields that only earlier runs of frames have get empty samples.
        """
        notices = list[str]()
        for field, stored in fields:
            if field.name not in self._known:
                self._known[field.name] = self._made(field, has_faces=connectivity.face_count > 0)
            kind, parameter = self._known[field.name]
            values, told = limited_to_double(stored, field.name, "Alembic")
            notices += told
            for rows in values:
                shared, indices = self._rows(field, kind, rows, connectivity)
                parameter.set(shared if kind.kind in WIDTHS else shared.reshape(-1), indices)
        self._frames += frames
        for _, parameter in self._known.values():
            parameter.fill(self._frames)
        return notices

    def _made(self, field: Field, *, has_faces: bool) -> tuple[ParameterKind, ParameterWriter]:
        """Return the kind of parameter for a field, and its writer, which has samples for all previous frames."""
        of_role, domain, metadata = _role_kind(field), field.domain, {DTYPE_KEY: field.dtype.name}
        is_color = of_role in ("C3f", "C4f")
        if is_color and has_faces and domain in ("face", "object"):
            domain, metadata[DOMAIN_KEY] = "corner", domain
        is_indexed = DOMAIN_KEY in metadata or (of_role == "V2f" and domain == "corner")
        kind = of_role or _SCALAR_KINDS.get(field.dtype.str[1:], "Int32")
        name = field_source_name(field, UV, COLOR).replace("/", "_")
        if not name or name.startswith(OWN_PREFIX):
            name = f"field_{name}"
        name = unique_name(name, self._taken)
        if field_name(kind, name, {}) != field.name:
            metadata[NAME_KEY] = quote(field.name)
        if field.unit:
            metadata[UNIT_KEY] = quote(field.unit)
        described = ParameterKind(kind, domain, metadata, is_indexed, 1 if of_role else field.components)
        parameter = ParameterWriter(self._handle.getSchema().getArbGeomParams(), name, described, self._sampling)
        parameter.fill(self._frames)
        return described, parameter

    def _rows(
        self, field: Field, kind: ParameterKind, rows: NDArray[Any], connectivity: Connectivity
    ) -> tuple[NDArray[Any], NDArray[np.integer] | None]:
        """Return the rows of the file and their indices for the rows of one frame."""
        if kind.domain != "corner":
            return rows, None
        if field.domain == "face":
            return rows, np.repeat(np.arange(len(rows)), connectivity.face_counts)
        if field.domain == "object":
            return rows, np.zeros(connectivity.face_indices.size, np.int64)
        order = reversed_corners(connectivity.face_counts)
        return self._shared_rows(field, rows, connectivity, order) if kind.is_indexed else (rows[order], None)

    def _shared_rows(
        self, field: Field, rows: NDArray[Any], connectivity: Connectivity, order: Int64Array
    ) -> tuple[Float32Array, Int64Array]:
        known = self._shared.get(field.name)
        if known is None or known[0] is not connectivity:
            known = self._shared[field.name] = connectivity, SharedRows(connectivity.face_indices)
        shared = known[1]
        shared.add(rows)
        return rows[shared.firsts], shared.rows[order]

    def uv_sample(self, field: Field, rows: NDArray[Any], connectivity: Connectivity, keep: Keep) -> Any:
        """Return the UVs (rows, 2) of one frame as an Alembic sample for the shape's own UVs."""
        sample = AbcGeom.OV2fGeomParamSample
        if field.domain == "vertex":
            return keep(sample(keep(vector_array(rows)), SCOPES["vertex"]))
        order = reversed_corners(connectivity.face_counts)
        found, indices = self._shared_rows(field, rows, connectivity, order)
        return keep(sample(keep(vector_array(found)), keep(unsigned_array(indices)), SCOPES["corner"]))
