"""Read the data of an Alembic shape that change with time: velocities, UVs, colours and other parameters.

A parameter has a time sampling of its own. Between two of its samples, floats are interpolated linearly, as positions
are, and whole numbers hold.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any
from urllib.parse import unquote

import numpy as np
from alembic3d import AbcGeom
from numpy.typing import NDArray

from pdecodec.formats.alembic.values import samples_at, select, to_numpy
from pdecodec.formats.base.attribute_roles import COLOR, NORMAL, UV, VECTOR, role_name
from pdecodec.formats.base.scene_reading import gathered_rows
from pdecodec.mesh.arrays import Float64Array, Int64Array
from pdecodec.mesh.fields import DTYPES, Field, held_or_mixed
from pdecodec.mesh.sequence import AttributeDomain, Connectivity

NAME_KEY, DTYPE_KEY, UNIT_KEY = "pdecodec_name", "pdecodec_dtype", "pdecodec_unit"
"""Metadata keys of a parameter that is a field: its name, if Alembic's type implies another; its type, which
also marks the parameter as a field; and its unit. Values are percent-encoded, because metadata cannot hold
every character.
"""

DOMAIN_KEY = "pdecodec_domain"
"""Metadata key of colours of faces or of the object: they are stored per corner, because programs read no other
colours of a mesh.
"""

NOT_UV_KEY = "notUV"
"""Alembic's own metadata key of a parameter of two numbers that are not texture coordinates."""

DOMAINS: dict[str, AttributeDomain] = {
    "kConstantScope": "object",
    "kUniformScope": "face",
    "kVaryingScope": "vertex",
    "kVertexScope": "vertex",
    "kFacevaryingScope": "corner",
}

_DTYPES = {
    "bool_t": "?",
    **{f"{sign}int{bits}_t": f"{sign or 'i'}{bits // 8}" for sign in ("", "u") for bits in (8, 16, 32)},
    **{"float16_t": "f4", "float32_t": "f4", "float64_t": "f8"},
}
"""Types of fields by Alembic's types of numbers. The Python binding reads 64-bit integers modulo 2**32."""

_NUMBERS = ("Float", "Double", "Half", "Boolean", "Char", "Uchar", "Int16", "UInt16", "Int32", "UInt32")

_VECTORS = (
    *(f"{what}{size}{kind}" for what in "VP" for size in (3, 2) for kind in "fdis"),
    *(f"{what}{kind}" for what in ("N3", "N2", "Quat", "M33", "M44") for kind in "fd"),
    *(f"C{size}{kind}" for size in (3, 4) for kind in "fhc"),
)

FIELD_PARAMETERS = {name: getattr(AbcGeom, f"I{name}GeomParam") for name in (*_VECTORS, *_NUMBERS)}
"""Alembic's types of parameters that a field can hold, by their names."""


def role_of_kind(kind: str, name: str, metadata: Any) -> str:
    """Return the role of a parameter that holds UVs or colours; otherwise its name."""
    if kind[:2] in ("C3", "C4"):
        return role_name(COLOR, name, ())
    return role_name(UV, name, ()) if kind == "V2f" and metadata.get(NOT_UV_KEY) != "1" else name


def field_name(kind: str, name: str, metadata: Any) -> str:
    """Return the name of the field that a parameter holds."""
    if kind in ("V3f", "V3d", "N3f", "N3d"):
        return f"{VECTOR if kind[0] == 'V' else NORMAL}:{name}"
    return role_of_kind(kind, name, metadata)


Reader = Callable[[float], NDArray[Any] | None]


RowsAt = Callable[[float], Int64Array]


def field_of_parameter(
    param: Any, name: str, metadata: Any, connectivity: Connectivity
) -> tuple[Field, Reader, RowsAt | None] | None:
    """Return the field that a parameter is, a function that reads the values of a sample at its time [s], and one that
    returns the stored row of each of them, unless they are the same.

    Parameters
    ----------
    param : AbcGeom parameter
    name : str
        The field's name, unless the metadata tell another.
    metadata : AbcCoreAbstract.MetaData
    connectivity : Connectivity
        Of the shape.

    Returns
    -------
    (Field, callable, callable or None) or None
        None if there is no type for its numbers. The field has one component.
    """
    stored = _DTYPES.get(str(param.getDataType()).partition("[")[0])
    if stored is None:
        return None
    domain = DOMAINS.get(str(param.getScope()), "object")
    taken: Int64Array | None = None
    if (own := metadata.get(DOMAIN_KEY)) in ("face", "object") and domain == "corner":
        domain = "face" if own == "face" else "object"
        ends = np.cumsum(connectivity.face_counts, dtype=np.int64)
        taken = ends - connectivity.face_counts if own == "face" else np.zeros(1, np.int64)
    dtype = next((one for one in DTYPES if one.name == metadata.get(DTYPE_KEY)), np.dtype(stored))
    field = Field(unquote(metadata.get(NAME_KEY)) or name, domain, dtype, unit=unquote(metadata.get(UNIT_KEY)))
    extent, is_indexed = param.getArrayExtent(), param.isIndexed()

    def sample(time: float) -> NDArray[Any] | None:
        found = param.getIndexedValue(select(time))
        stored = to_numpy(found.getVals())
        stored = stored.reshape(-1, extent) if extent > 1 and stored.size % extent == 0 else stored
        values = gathered_rows(stored, to_numpy(found.getIndices()).astype(np.int64)) if is_indexed else stored
        if values is None or not values.size or (taken is not None and len(values) != connectivity.face_indices.size):
            return None
        values = values if taken is None else values[taken]
        with np.errstate(invalid="ignore"):  # numbers of the file need not fit the type in its metadata
            return values.reshape(len(values), -1).astype(field.dtype)

    def rows_at(time: float) -> Int64Array:
        found = param.getIndexedValue(select(time))
        size = len(found.getIndices()) if is_indexed else len(found.getVals()) // extent
        rows = to_numpy(found.getIndices()).astype(np.int64) if is_indexed else np.arange(size)
        return rows if taken is None else rows[taken]

    return field, sample, rows_at if is_indexed or taken is not None else None


def interpolated(sample: Reader, times: Float64Array, field: Field) -> Reader:
    """Return a function that reads a field at a time [s] from its samples at times [s]."""

    def read_at(time: float) -> NDArray[Any] | None:
        first, second, share = samples_at(times, time)
        before = sample(float(times[first]))
        after = sample(float(times[second])) if share and not field.is_exact else None
        if before is None or after is None or before.shape != after.shape:
            return before
        return held_or_mixed(field, before, after, share)

    return read_at
