"""Gather the variables of Exodus, one number each, to vectors and tensors, and find their values on nodes and faces."""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import unique_name
from pdecodec.formats.base.frame_data import on_elements
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.fields import Field, FieldDomain, missing_value

AXES = "xyz"
_COMPONENT_NAME = re.compile(r"(?P<base>.+?)_?(?P<axis>[xyz])", re.IGNORECASE | re.DOTALL)
"""Pattern of the name of a nodal variable that is one component of a vector."""

_DISPLACEMENT = "disp"
"""Prefix, in lower case, of names that SEACAS and ParaView use for displacements: displ_x, DISPX, displacement_x."""

_PARTIAL_DISPLACEMENTS = ("disp", "displ", "displacement", "displacements")
"""Names of displacements that count even with fewer components: nodes then do not move along the other axes."""

_TENSORS = tuple(
    map(str.split, ("xx xy xz yx yy yz zx zy zz", "xx yy zz xy yz zx", "xx yy zz xy yz xz", "xx yy zz xy", "xx yy xy"))
)
"""Components of tensors, in the order of their fields: full, symmetric, of plane strain, of two dimensions."""

_TENSOR_NAME = re.compile(r"(?P<base>.+?)_?(?P<pair>[xyz]{2})", re.IGNORECASE | re.DOTALL)
"""Pattern of the name of a variable that is one component of a tensor."""


_NUMBERED = re.compile(r"(?P<base>.+)_(?P<number>[1-9]\d*)", re.DOTALL)
"""Pattern of the name of a variable that is one of several numbered from 1, as SEACAS names arrays of values."""


def component_names(name: str, components: int) -> list[str]:
    """Return the names of the variables that store a field; :func:`gathered` joins them to one field again."""
    if components == 1:
        return [name]
    pairs = next((one for one in _TENSORS[:2] if len(one) == components), None)
    ends = list(AXES) if components == len(AXES) else pairs or list(map(str, range(1, components + 1)))
    return [f"{name}_{end}" for end in ends]


def vectors_of(names: Sequence[str], axes: int) -> dict[str, dict[int, int]]:
    """Return the vectors formed by nodal variables: for each axis the number of its variable, from 1.

    Parameters
    ----------
    names : sequence of str
        Names of the variables, such as ``displ_x``, ``displ_y``, ``displ_z``; case does not matter.
    axes : int
        Number of axes of the coordinates.

    Returns
    -------
    dict
        By names without axes, such as ``displ``: all vectors with a component for every axis, and those named as
        displacements with fewer.
    """
    found: dict[tuple[str, bool], tuple[str, dict[int, int]]] = {}
    for number, name in enumerate(names, 1):
        part = _COMPONENT_NAME.fullmatch(name)
        if part is not None:
            key = part["base"].lower(), "_" in name[part.end("base") :]
            axis = AXES.index(part["axis"].lower())
            found.setdefault(key, (part["base"], {}))[1].setdefault(axis, number)
    vectors = [
        (base, dict(sorted(parts.items())))
        for (lower, _), (base, parts) in found.items()
        if set(range(axes)) <= set(parts) or lower in _PARTIAL_DISPLACEMENTS
    ]
    bases = Counter(base for base, _ in vectors)
    # Two vectors of the same name, ``disp_x`` and ``dispx``, are named by their first variable.
    return {base if bases[base] == 1 else names[min(parts.values()) - 1]: parts for base, parts in vectors}


def displacements(vectors: Mapping[str, Mapping[int, int]], axes: int) -> list[str]:
    """Return the vectors that SEACAS and ParaView use as displacements: names that begin with ``disp``.

    Vectors with a component for every axis take precedence over those with fewer.
    """
    named = [name for name in vectors if name.lower().startswith(_DISPLACEMENT)]
    return [name for name in named if len(vectors[name]) >= axes] or named


def gathered(names: Sequence[str], axes: int) -> dict[str, list[int]]:
    """Return the numbers of variables, from 1, by the names of the vectors and tensors that they form.

    Variables form a tensor only if they are exactly the components of one of :data:`_TENSORS`, and a vector only if
    there is one for every axis. Variables numbered from 1 without a gap form one field. Other variables stand alone.
    A name that is taken already gets a number. Variables without names are left out.
    """
    tensors: dict[tuple[str, bool], tuple[str, dict[str, int]]] = {}
    for number, name in enumerate(names, 1):
        part = _TENSOR_NAME.fullmatch(name)
        if part is not None:
            key = part["base"].lower(), "_" in name[part.end("base") :]
            tensors.setdefault(key, (part["base"], {}))[1].setdefault(part["pair"].lower(), number)
    groups = [
        (base, [parts[pair] for pair in pairs])
        for base, parts in tensors.values()
        for pairs in _TENSORS
        if set(pairs) == set(parts)
    ]
    used = {number for _, group in groups for number in group}
    groups += [
        (base, group)
        for base, parts in vectors_of(
            ["" if number in used else name for number, name in enumerate(names, 1)], axes
        ).items()
        if len(group := list(parts.values())) >= max(axes, 2)
    ]
    used |= {number for _, group in groups for number in group}
    numbered: dict[str, dict[int, int]] = {}
    for number, name in enumerate(names, 1):
        part = None if number in used else _NUMBERED.fullmatch(name)
        if part is not None:
            numbered.setdefault(part["base"], {}).setdefault(int(part["number"]), number)
    groups += [
        (base, [parts[place] for place in sorted(parts)])
        for base, parts in numbered.items()
        if len(parts) > 1 and max(parts) == len(parts)
    ]
    used |= {number for _, group in groups for number in group}
    groups += [(name, [number]) for number, name in enumerate(names, 1) if name and number not in used]
    taken: set[str] = set()
    return {unique_name(name, taken, " "): group for name, group in sorted(groups, key=lambda one: min(one[1]))}


@dataclass(frozen=True)
class Part:
    """Rows of a field whose components are stored in one array (steps, values) each.

    Attributes
    ----------
    columns, rows : slice or array of int
        Which values of the array they are, and which rows of the field.
    array : str
        Name of the array, with ``{}`` for the number of the variable.
    values : int
        Number of values of a step.
    """

    columns: Int64Array | slice
    rows: Int64Array | slice
    array: str
    values: int


@dataclass(frozen=True)
class StoredField:
    """A field, and the arrays of its components in each part; rows in no part are NaN."""

    field: Field
    parts: Sequence[tuple[Part, tuple[Any, ...]]]

    def read(self, start: int, stop: int, rows: int, fill: Callable[[Any], float]) -> NDArray[Any]:
        """Return the values (frames, rows[, components]); values equal to `fill` were never written, and become NaN."""
        shape = stop - start, rows, self.field.components
        values = np.full(shape, missing_value(self.field.dtype), self.field.dtype)
        for part, arrays in self.parts:
            for component, array in enumerate(arrays):
                stored = np.asarray(array[start:stop], self.field.dtype)[:, part.columns]
                if not self.field.is_exact:
                    stored = np.where(stored == fill(array), np.nan, stored)
                values[:, part.rows, component] = stored
        return values if self.field.components > 1 else values[:, :, 0]


def store_fields(
    stored: dict[str, StoredField],
    domain: FieldDomain,
    names: Sequence[str],
    axes: int,
    parts: Sequence[Part],
    find: Callable[[str, Part], Any],
) -> list[str]:
    """Add the fields that variables form to those that are stored, and return the names of the variables.

    `find` returns the array of a name if it has the values of a part, else None. A field has the common type of its
    arrays. Components that different parts have are fields of their own.
    """
    arrays: dict[int, list[tuple[Part, Any]]] = {}
    for number, name in enumerate(names, 1):
        there = [(part, find(part.array.format(number), part)) for part in parts] if name else []
        if found := [(part, array) for part, array in there if array is not None]:
            arrays[number] = found
    listed = [name if number in arrays else "" for number, name in enumerate(names, 1)]
    for name, group in gathered(listed, axes).items():
        owners = [[part for part, _ in arrays[number]] for number in group]
        alone = any(one != owners[0] for one in owners)
        for numbers in [[number] for number in group] if alone else [group]:
            label = names[numbers[0] - 1] if alone else name
            label = unique_name(
                on_elements(label, domain) if domain != "vertex" and label in stored else label, set(stored), " "
            )
            columns = zip(*([array for _, array in arrays[number]] for number in numbers), strict=True)
            whole = list(zip((part for part, _ in arrays[numbers[0]]), columns, strict=True))
            dtype = np.result_type(*(dtype_of(array).newbyteorder("=") for _, one in whole for array in one))
            if len(whole) < len(parts):  # the values of other parts are NaN
                dtype = np.result_type(dtype, np.float32)
            field = Field(label, domain, dtype, len(numbers))
            stored[label] = StoredField(field, whole)
    return [names[number - 1] for number in arrays]


def dtype_of(variable: Any) -> np.dtype[Any]:
    """Return the type of numbers of a variable of h5py or SciPy."""
    return np.dtype((variable if hasattr(variable, "dtype") else variable.data).dtype)  # type: ignore[no-any-return]
