"""Objects, attributes and metadata as named arrays: the layout that NPZ and HDF5 share.

==================================  ===========================================================
``objects/0/name``                  text
``objects/0/vertex_count``          int64; objects' vertices follow each other in the positions
``objects/0/face_counts``           (faces,) int32
``objects/0/face_indices``          (corners,) int32, from 0 within the object
``objects/0/line_counts``           (lines,) int32
``objects/0/line_indices``          (line points,) int32
``objects/0/attributes/0/name``     text
``objects/0/attributes/0/domain``   text: vertex, face, corner or object
``objects/0/attributes/0/values``   (n,) or (n, k) numbers
``objects/0/attributes/0/indices``  int32, if there are any
``objects/0/attributes/0/labels``   (labels,) text, if there are any
``metadata``                        (entries, 2) text, if there are any
``field_NAME``                      (frames, rows) or (frames, rows, components)
``domains``                         JSON: the domain of each field by its name
``units``                           JSON: units of fields, if known
``objects_with_fields``             JSON: indices, of fields that not all objects have
==================================  ===========================================================

In ``field_NAME`` the characters ``%``, ``/`` and NUL of a name are written as in addresses, ``%25``. Domains are vertex
(also read: node, point), face (also read: cell), corner or object; without ``domains`` the number of rows tells.
Points of one frame with fields of several do not move.

A file also holds ``points`` (frames, vertices, 3), ``times`` (frames,) [s] and ``fps``; and, for programs that know
only these, ``faces`` (rows, widest) int32 padded with -1, if they can represent the connectivity.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from typing import Any, cast, get_args
from urllib.parse import unquote

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.base.frame_changes import not_kept
from pdecodec.formats.base.times import timing_of_arrays
from pdecodec.mesh.arrays import Float32Array, Int32Array
from pdecodec.mesh.fields import DTYPES, Field, FieldDomain, check_fields, field_of_array
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import (
    Attribute,
    AttributeDomain,
    Connectivity,
    Content,
    Fate,
    MeshObject,
    MeshSequence,
    check_frame_range,
)

PADDING_FACTOR = 4
"""``faces`` is left out if padding would make it this many times as large as the indices: padded for one n-gon
of a thousand corners, a million triangles would take gigabytes.
"""

_FIELD = "field_"
_OF_FIELDS = ("domains", "units", "objects_with_fields")
_DOMAINS: Mapping[str, FieldDomain] = {
    **{domain: domain for domain in get_args(FieldDomain)},
    "node": "vertex",
    "point": "vertex",
    "cell": "face",
}

_WHOLE = ("points", "faces", "times", "fps", "metadata", *_OF_FIELDS)

_CONNECTIVITY = ("face_counts", "face_indices", "line_counts", "line_indices")

Arrays = Mapping[str, NDArray[Any]]


class LaidOutSequence(MeshSequence):
    """A sequence read from arrays of this layout, wherever they are stored."""

    _points: Any
    _values: Mapping[str, Any] = {}
    _contents: list[Content]

    def _take(
        self,
        names: Sequence[str],
        read: Callable[[str], NDArray[Any]],
        fps: float | None,
        what: str,
        sliced: Callable[[str], Any] | None = None,
    ) -> None:
        """Check the points, and read everything else but fields.

        `read` returns an array by its name, `what` names the kind of array in messages, and `sliced` returns an
        array that can be read in slices.
        """
        shape, dtype = self._points.shape, self._points.dtype
        if len(shape) != 3 or shape[2] != 3 or dtype.kind not in "fiu":
            raise InputError(
                f"points must be numbers of shape (frames, vertices, 3), not {dtype} {shape}", code="damaged-input"
            )
        if shape[1] == 0:
            raise InputError("points have no vertices; give at least one", code="no-vertices")
        arrays = {name: read(name) for name in names if name in _WHOLE[1:] or name.startswith("objects/")}
        self.objects = _objects_of(arrays, shape[1])
        self.metadata = _metadata_of(arrays)
        fields = self._possible_fields(arrays, {} if sliced is None else _readable(names, sliced))
        frames = shape[0]
        if frames == 1:
            frames = max([frames, *(array.shape[0] for _, array in fields.values())])
        self.times, self.fps, notices = timing_of_arrays(arrays, frames, fps)
        fields = {name: one for name, one in fields.items() if one[1].shape[0] == frames}
        self.fields = tuple(field for field, _ in fields.values())
        self._values = {field.name: array for field, array in fields.values()}
        kept = {*_WHOLE, *_names_of(self.objects), *fields}
        fates: dict[str, Fate] = {name: "coded" if name in kept else "dropped" for name in names}
        if "faces" in fates and "objects/0/name" in fates:
            fates["faces"] = "implied"
        self._contents = [Content(f"/{name}", name.rpartition("/")[2], fate) for name, fate in fates.items()]
        self.list_contents = lambda: tuple(self._contents)
        lost = [name for name, fate in fates.items() if fate == "dropped"]
        self.notices = (*notices, *not_kept(lost, f"{what}s not kept: {{}}"))

    def _possible_fields(self, arrays: Arrays, values: Mapping[str, Any]) -> dict[str, tuple[Field, Any]]:
        """Return fields and their arrays by array name, for all arrays whose shape fits this mesh.

        The number of frames is not checked, because it may be known only from the fields.
        """
        domains, units, owners = (_json_of(arrays, name) for name in _OF_FIELDS)
        found: dict[str, tuple[Field, Any]] = {}
        taken: set[str] = set()
        for array_name, array in values.items():
            name, dtype = unquote(array_name.removeprefix(_FIELD)), np.dtype(array.dtype).newbyteorder("=")
            stated, objects = domains.get(name), owners.get(name)
            domain = None if stated is None else _DOMAINS.get(str(stated))
            try:
                if dtype not in (*DTYPES, np.dtype(np.float16)) or (stated is not None and domain is None):
                    raise InputError("of a type or domain that is not known")
                field = field_of_array(name, array.shape, dtype, self.objects, domain, str(units.get(name, "")))
                field = replace(field, objects=None if objects is None else tuple(map(int, objects)))
                check_fields([field], self.objects)
            except (InputError, TypeError, ValueError):
                continue
            squeezed = field.shape(array.shape[0], self.objects)
            if array.shape in (squeezed, (*squeezed, 1)) and name not in taken:
                taken.add(name)
                found[array_name] = field, array
        return found

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        values = np.asarray(self._values[field.name][start:stop], field.dtype)
        return values.reshape(field.shape(stop - start, self.objects))

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        if self._points.shape[0] == 1 < self.frame_count:
            return np.repeat(to_float32(self._points[0:1]), stop - start, axis=0)
        return to_float32(self._points[start:stop])


def check_has_points(names: Sequence[str], what: str) -> None:
    """Raise InputError unless one of the names is ``points``."""
    if "points" not in names:
        there = f"it has {', '.join(names)}; rename the one that holds the positions" if names else "it is empty"
        raise InputError(f"has no {what} named points, of shape (frames, vertices, 3); {there}", code="damaged-input")


def arrays_of(sequence: MeshSequence, fps: float) -> dict[str, NDArray[Any]]:
    """Return everything but points as arrays by name; text as ``<U`` arrays."""
    arrays: dict[str, NDArray[Any]] = {"times": sequence.times, "fps": np.asarray(fps, np.float64)}
    faces = _padded_faces(sequence.connectivity)
    if faces is not None:
        arrays["faces"] = faces
    for number, item in enumerate(sequence.objects):
        place = f"objects/{number}"
        arrays[f"{place}/name"] = np.asarray(item.name)
        arrays[f"{place}/vertex_count"] = np.asarray(item.vertex_count, np.int64)
        for name in _CONNECTIVITY:
            arrays[f"{place}/{name}"] = getattr(item.connectivity, name)
        for rank, attribute in enumerate(item.attributes):
            inner = f"{place}/attributes/{rank}"
            arrays[f"{inner}/name"] = np.asarray(attribute.name)
            arrays[f"{inner}/domain"] = np.asarray(attribute.domain)
            arrays[f"{inner}/values"] = attribute.values
            if attribute.indices is not None:
                arrays[f"{inner}/indices"] = attribute.indices
            if attribute.labels:
                arrays[f"{inner}/labels"] = np.asarray(attribute.labels)
    if sequence.metadata:
        arrays["metadata"] = np.asarray(sorted(sequence.metadata.items()))
    if sequence.fields:
        about = (
            {one.name: one.domain for one in sequence.fields},
            {one.name: one.unit for one in sequence.fields if one.unit},
            {one.name: one.objects for one in sequence.fields if one.objects is not None},
        )
        arrays |= {name: np.asarray(json.dumps(texts)) for name, texts in zip(_OF_FIELDS, about, strict=True) if texts}
    return arrays


def fields_as_arrays(sequence: MeshSequence) -> Iterator[tuple[str, Field, tuple[int, ...]]]:
    """Yield the name and shape of each field's array; its values are read by blocks of frames."""
    for one in sequence.fields:
        name = one.name.replace("%", "%25").replace("/", "%2F").replace("\0", "%00")
        yield _FIELD + name, one, one.shape(sequence.frame_count, sequence.objects)


def _padded_faces(whole: Connectivity) -> Int32Array | None:
    """Return faces, lines of two points and points as rows padded with -1; None if rows cannot represent them or would
    be too large.

    A line of three points or more would be read as a face.
    """
    counts = np.concatenate([whole.face_counts, whole.line_counts])
    indices = np.concatenate([whole.face_indices, whole.line_indices])
    if counts.size == 0 or whole.line_counts.max(initial=0) > 2:
        return None
    width = int(counts.max())
    if width * counts.size > PADDING_FACTOR * indices.size:
        return None
    padded = np.full((counts.size, width), -1, np.int32)
    padded[np.arange(width) < counts[:, None]] = indices
    return padded


def _names_of(objects: Sequence[MeshObject]) -> Iterator[str]:
    """Yield the names of all arrays of objects in the layout, whether or not a file has them."""
    for number, item in enumerate(objects):
        yield from (f"objects/{number}/{name}" for name in ("name", "vertex_count", *_CONNECTIVITY))
        for rank in range(len(item.attributes)):
            for name in ("name", "domain", "values", "indices", "labels"):
                yield f"objects/{number}/attributes/{rank}/{name}"


def _readable(names: Sequence[str], sliced: Callable[[str], Any]) -> dict[str, Any]:
    """Return the arrays whose names mark them as fields, except those of types that cannot be read."""
    found: dict[str, Any] = {}
    for name in names:
        try:
            found |= {name: sliced(name)} if name.startswith(_FIELD) else {}
        except InputError as error:
            if error.code != "unsupported-feature":
                raise
    return found


def _json_of(arrays: Arrays, name: str) -> Mapping[str, Any]:
    """Return a JSON object that is stored as text; empty if there is none."""
    if name not in arrays:
        return {}
    try:
        found = json.loads(_text(arrays, name))
    except ValueError:
        found = None
    if not isinstance(found, dict):
        raise damaged(f"{name} must be a JSON object that maps names of fields to texts; write it again")
    return found


def _objects_of(arrays: Arrays, vertex_count: int) -> tuple[MeshObject, ...]:
    """Return the objects that arrays describe: from ``objects/``, else from padded ``faces``, else points alone."""
    if "objects/0/name" not in arrays:
        faces = arrays.get("faces")
        connectivity = Connectivity(vertex_count) if faces is None else Connectivity.from_padded(vertex_count, faces)
        return (MeshObject("mesh", connectivity),)
    objects: list[MeshObject] = []
    while f"objects/{len(objects)}/name" in arrays:
        objects.append(_object_of(arrays, f"objects/{len(objects)}"))
    total = sum(item.vertex_count for item in objects)
    if total != vertex_count:
        raise damaged(f"objects have {total} vertices, but points have {vertex_count}; write the file again")
    return tuple(objects)


def _metadata_of(arrays: Arrays) -> dict[str, str]:
    if "metadata" not in arrays:
        return {}
    entries = arrays["metadata"]
    if entries.ndim != 2 or entries.shape[1] != 2 or entries.dtype.kind != "U":
        raise InputError(f"metadata must be pairs of text, not {entries.dtype} {entries.shape}", code="damaged-input")
    return {str(key): str(value) for key, value in entries}


def _object_of(arrays: Arrays, place: str) -> MeshObject:
    vertex_count = _number(arrays, f"{place}/vertex_count")
    connectivity = Connectivity(vertex_count, *(_array(arrays, f"{place}/{name}") for name in _CONNECTIVITY))
    attributes: list[Attribute] = []
    while f"{place}/attributes/{len(attributes)}/name" in arrays:
        attributes.append(_attribute_of(arrays, f"{place}/attributes/{len(attributes)}"))
    return MeshObject(_text(arrays, f"{place}/name"), connectivity, tuple(attributes))


def _attribute_of(arrays: Arrays, place: str) -> Attribute:
    domain = _text(arrays, f"{place}/domain")
    if domain not in get_args(AttributeDomain):
        raise InputError(
            f"{place}/domain is {domain!r}, not one of {', '.join(get_args(AttributeDomain))}", code="damaged-input"
        )
    values = _array(arrays, f"{place}/values")
    if values.ndim not in (1, 2) or values.dtype.kind not in "fiu":
        raise InputError(
            f"{place}/values must be numbers in one or two dimensions, not {values.dtype} {values.shape}",
            code="damaged-input",
        )
    indices = arrays.get(f"{place}/indices")
    if indices is not None and (indices.ndim != 1 or indices.dtype.kind not in "iu"):
        raise InputError(
            f"{place}/indices must be one row of integers, not {indices.dtype} {indices.shape}", code="damaged-input"
        )
    labels = arrays.get(f"{place}/labels", np.zeros(0, "U1"))
    if labels.ndim != 1 or labels.dtype.kind != "U":
        raise InputError(
            f"{place}/labels must be one row of text, not {labels.dtype} {labels.shape}", code="damaged-input"
        )
    return Attribute(
        _text(arrays, f"{place}/name"),
        cast(AttributeDomain, domain),
        values,
        indices=None if indices is None else indices.astype(np.int32),
        labels=tuple(str(label) for label in labels),
    )


def _array(arrays: Arrays, name: str) -> NDArray[Any]:
    if name not in arrays:
        raise damaged(f"{name} is missing; write the file again")
    return arrays[name]


def _text(arrays: Arrays, name: str) -> str:
    array = _array(arrays, name)
    if array.shape != () or array.dtype.kind != "U":
        raise InputError(f"{name} must be text, not {array.dtype} {array.shape}", code="damaged-input")
    return str(array)


def _number(arrays: Arrays, name: str) -> int:
    array = _array(arrays, name)
    if array.shape != () or array.dtype.kind not in "iu" or int(array) < 0:
        raise InputError(
            f"{name} must be a whole number, 0 or more, not {array.dtype} {array.shape}", code="damaged-input"
        )
    return int(array)
