"""Fields: values on vertices, faces, corners, objects or cells that change from frame to frame.

Constant values are an :class:`pdecodec.Attribute` of their object. A field belongs to the sequence, which reads it by
blocks of frames as it reads positions.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import accumulate, pairwise, starmap
from typing import Any, Literal, Protocol, get_args

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.errors import InputError
from pdecodec.mesh.arrays import Int64Array
from pdecodec.system.arguments import shown


class MeshObject(Protocol):
    """The part of :class:`pdecodec.MeshObject` that fields need; its module imports this one."""

    @property
    def vertex_count(self) -> int: ...
    @property
    def connectivity(self) -> Any: ...


FieldDomain = Literal["vertex", "face", "corner", "object", "cell"]

FieldArrays = Mapping[str, ArrayLike] | Iterable[tuple["Field", ArrayLike]]
"""Fields that :class:`pdecodec.ArraySequence` takes: arrays by name, or pairs of a :class:`Field` and its array."""

DTYPES = tuple(np.dtype(name) for name in ("f4", "f8", "i1", "i2", "i4", "i8", "u1", "u2", "u4", "u8", "?"))
"""Types of values, in the order of the format."""


def missing_value(dtype: np.dtype[Any]) -> float:
    """Return the value that marks a missing one: NaN, or 0 for whole numbers and flags."""
    return np.nan if dtype.kind == "f" else 0


@dataclass(frozen=True)
class Field:
    """Description of values that change in time.

    Its *rows* are the elements of its domain in all objects that have the field, object after object.

    Parameters
    ----------
    name : str
        Unique within a sequence.
    domain : {"vertex", "face", "corner", "object", "cell"}
    dtype : dtype
        float32, float64, int8 to int64, uint8 to uint64, or bool; default float32.
    components : int
        Numbers of each row, 1 or more.
    unit : str
        ``"Pa"``, ``"m/s"``; empty if it is not known.
    objects : tuple of int, optional
        Indices of the objects that have the field, increasing. Default: all.

    Raises
    ------
    InputError
        If a value is not one of these.
    """

    name: str
    domain: FieldDomain
    dtype: np.dtype[Any] = DTYPES[0]
    components: int = 1
    unit: str = ""
    objects: tuple[int, ...] | None = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "dtype", np.dtype(self.dtype).newbyteorder("="))
        if self.domain not in get_args(FieldDomain):
            raise self._error(f"has the unknown domain {shown(self.domain)}; use vertex, face, corner, object or cell")
        if self.dtype not in DTYPES:
            raise self._error(f"has the unsupported type {self.dtype}; use one of {', '.join(map(str, DTYPES))}")
        if self.components < 1:
            raise self._error(f"has {self.components} components; give 1 or more")
        if self.objects is not None and (not self.objects or self.objects[0] < 0 or (np.diff(self.objects) <= 0).any()):
            raise self._error("needs object indices of 0 or more in increasing order")

    def _error(self, what: str) -> InputError:
        return InputError(f"field {self.name!r} {what}", code="invalid-field")

    @property
    def is_exact(self) -> bool:
        """Whether its values are whole numbers or flags, which are never rounded or interpolated."""
        return self.dtype.kind != "f"

    def row_counts(self, objects: Sequence[MeshObject]) -> list[int]:
        """Return the number of rows in each object; 0 if the object does not have the field."""
        owners = range(len(objects)) if self.objects is None else frozenset(self.objects)
        return [rows_of_domain(item, self.domain) if index in owners else 0 for index, item in enumerate(objects)]

    def row_count(self, objects: Sequence[MeshObject]) -> int:
        """Return the number of rows of all objects together."""
        return sum(self.row_counts(objects))

    def slices(self, objects: Sequence[MeshObject]) -> list[slice]:
        """Return the slice of rows that belongs to each object; empty if the object does not have the field."""
        return list(starmap(slice, pairwise(accumulate(self.row_counts(objects), initial=0))))

    def frame_bytes(self, objects: Sequence[MeshObject]) -> int:
        """Return the size of the values of one frame [bytes]."""
        return self.row_count(objects) * self.components * self.dtype.itemsize

    def shape(self, frames: int, objects: Sequence[MeshObject]) -> tuple[int, ...]:
        """Return the shape of the values of some frames: the components are an axis if there are several."""
        return (frames, self.row_count(objects), *([self.components] if self.components > 1 else []))


def rows_of_domain(item: MeshObject, domain: FieldDomain) -> int:
    """Return the number of elements of a domain in an object."""
    return {
        "vertex": item.vertex_count,
        "face": int(item.connectivity.face_count),
        "corner": int(item.connectivity.face_indices.size),
        "object": 1,
        "cell": int(item.connectivity.cell_count),
    }[domain]


def check_fields(fields: Sequence[Field], objects: Sequence[MeshObject]) -> tuple[Field, ...]:
    """Return fields, after checking that names are unique and objects exist; raise InputError otherwise."""
    names = [field.name for field in fields]
    for field in fields:
        if names.count(field.name) > 1:
            raise InputError(f"several fields are named {field.name!r}; rename one", code="invalid-field")
        if field.objects is not None and field.objects[-1] >= len(objects):
            raise InputError(
                f"field {field.name!r} belongs to object {field.objects[-1]}, but there are {len(objects)}",
                code="invalid-field",
            )
    return tuple(fields)


def fields_in_memory(
    given: FieldArrays, frames: int, objects: Sequence[MeshObject]
) -> tuple[tuple[Field, ...], dict[str, NDArray[Any]]]:
    """Return the fields that arrays describe, and the arrays by name; raise InputError if their shapes do not
    fit the objects.
    """
    if isinstance(given, Mapping):
        pairs = [(field_of_array(str(name), np.shape(array), np.asarray(array).dtype, objects), array)
                 for name, array in given.items()]  # fmt: skip
    else:
        pairs = list(given)
    arrays = {}
    for field, array in pairs:
        values = np.asarray(array, field.dtype)
        if field.components == 1 and values.ndim == 3 and values.shape[2] == 1:
            values = values[:, :, 0]
        wanted = field.shape(frames, objects)
        if values.shape != wanted:
            raise InputError(
                f"field {field.name!r} has values of shape {values.shape}; {frames} frames of "
                f"{field.row_count(objects)} rows of domain {field.domain} need {wanted}",
                code="invalid-field",
            )
        arrays[field.name] = values
    return check_fields([field for field, _ in pairs], objects), arrays


def field_of_array(
    name: str,
    shape: Sequence[int],
    dtype: np.dtype[Any],
    objects: Sequence[MeshObject],
    domain: FieldDomain | None = None,
    unit: str = "",
) -> Field:
    """Return the field that describes an array (frames, rows[, components]).

    Parameters
    ----------
    name : str
    shape, dtype
        Of the array.
    objects : sequence of MeshObject
    domain : str, optional
        Default: the domain with that number of rows, vertices first.
    unit : str

    Raises
    ------
    InputError
        If no domain has that number of rows, or several have it but not the vertices.
    """
    if len(shape) not in (2, 3):
        raise InputError(
            f"field {name!r} must have the shape (frames, rows) or (frames, rows, components), not {tuple(shape)}",
            code="invalid-field",
        )
    if domain is None:
        totals = {one: sum(rows_of_domain(item, one) for item in objects) for one in get_args(FieldDomain)}
        found = [one for one, total in totals.items() if total == shape[1]]
        if found[:1] != ["vertex"] and len(found) != 1:
            known = ", ".join(f"{total} of domain {one}" for one, total in totals.items())
            raise InputError(
                f"field {name!r} has {shape[1]} rows, there are {known}; "
                + ("give its domain, as a Field" if found else "give one row for each element of one domain"),
                code="invalid-field",
            )
        domain = found[0]
    # float16 and values in another byte order are converted to a type of this computer.
    exact = np.dtype(np.float32) if dtype == np.float16 else dtype
    return Field(name, domain, exact, int(shape[2]) if len(shape) == 3 else 1, unit)


def selected_objects(
    fields: Iterable[Field], objects: Sequence[MeshObject], chosen: Sequence[int]
) -> tuple[tuple[Field, ...], dict[str, Int64Array]]:
    """Return the fields that selected objects have, and for each field name the rows of the source."""
    kept, rows = [], {}
    for field in fields:
        owners = range(len(objects)) if field.objects is None else frozenset(field.objects)
        own = [(number, index) for number, index in enumerate(chosen) if index in owners]
        if own:
            slices = field.slices(objects)
            parts = [np.arange(slices[index].start, slices[index].stop) for _, index in own]
            rows[field.name] = np.concatenate(parts).astype(np.int64)
            new = None if len(own) == len(chosen) else tuple(number for number, _ in own)
            kept.append(replace(field, objects=new))
    return tuple(kept), rows


def held_or_mixed(field: Field, before: NDArray[Any], after: NDArray[Any], share: float) -> NDArray[Any]:
    """Return values between two frames: interpolated linearly if they are floats and both finite, else the
    earlier ones.
    """
    if field.is_exact:
        return before
    with np.errstate(invalid="ignore", over="ignore"):  # A difference beyond the largest float is infinite.
        mixed = before + share * (after.astype(np.float64) - before)
    return np.where(np.isfinite(mixed), mixed, before).astype(field.dtype)
