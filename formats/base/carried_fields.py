"""Values of coded fields as the file of a scene stores them: in its space and its order of rows.

:class:`SceneSequence` turns directions into the space of the scene, faces around, and gathers rows; this undoes it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.attribute_roles import reversed_corners
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.base.scene_reading import SceneSequence, ShapeField
from pdecodec.formats.base.times import SAME_TIME
from pdecodec.formats.base.transforms import transform_directions
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence

MOST_SKEWED = 1e4
"""Largest condition number of a transform under which directions are cut out: it multiplies their error."""


class StoredFields:
    """The fields of a sequence, as an original stores those of the same names.

    Parameters
    ----------
    sequence : MeshSequence
    original : MeshSequence
        A :class:`SceneSequence`, else there are no :meth:`sources`.
    fits : sequence of Fitted
        Objects of the sequence, in order, with those of the original.
    names : collection of str
        Names of the fields.

    Attributes
    ----------
    names : collection of str
    """

    def __init__(
        self, sequence: MeshSequence, original: MeshSequence, fits: Sequence[Fitted], names: Collection[str]
    ) -> None:
        self._sequence, self._fits, self.names = sequence, fits, names
        self._read: tuple[str, int, NDArray[Any]] | None = None
        if not isinstance(original, SceneSequence):
            self._fields: dict[str, Field] = {}
            return
        self._original = original
        ours = {one.name: one for one in sequence.fields if one.name in names}
        theirs = {one.name: one for one in original.fields}
        self._fields = {name: one for name, one in ours.items() if name in theirs}
        self._slices = {name: one.slices(sequence.objects) for name, one in self._fields.items()}
        self._times = np.array(original.format_times)

    def sources(self) -> Iterator[tuple[str, int, ShapeField]]:
        """Yield the name of each field, the number of each object that has it, and the field of the shape."""
        for name in self._fields:
            for number, one in enumerate(self._fits):
                source = self._original.field_sources[name].get(one.index)
                if source is not None and source.place:
                    yield name, number, source

    def seconds(self, time: float) -> float | None:
        """Return when a time of the format is [s]; None if the sequence has no frame then."""
        if not self._times.size:
            return None
        near = int(np.abs(self._times - time).argmin())
        found = float(self._original.times[near])
        off = abs(self._times[near] - time)
        return found if off <= SAME_TIME and abs(self._sequence.times - found).min() <= SAME_TIME else None

    def at(self, name: str, number: int, time: float, seconds: float, count: int, dtype: str) -> NDArray[np.generic]:
        """Return the `count` rows (count, components) of type `dtype` that are stored at a time of the format.

        `seconds` is that time; of a sequence without a frame then, the nearest frame is taken. Rows that the field
        lacks are 0. Objects of one frame, one after the other, take one read.

        Raises
        ------
        ValueError
            If there are no numbers of this type.
        """
        if np.dtype(dtype).kind not in "fiu":
            raise ValueError(f"{dtype} is no type of numbers")
        field, (source, shape, matrix) = self._fields[name], self._stored(name, number, time)
        frame = int(np.abs(self._sequence.times - seconds).argmin())
        if self._read is None or self._read[:2] != (name, frame):
            self._read = name, frame, self._sequence.read_field(name, frame, frame + 1)
        values = self._read[2]
        rows = values.reshape(1, values.shape[1], -1)[:, self._slices[name][number]]
        if matrix is not None:
            rows = transform_directions(field, rows, np.linalg.inv(matrix).astype(np.float64))
        rows, faces = rows[0], self._fits[number].item.connectivity
        if field.domain == "corner" and not faces.same_as(shape.connectivity):
            rows = rows[reversed_corners(faces.face_counts)]
        return _in_file(source, rows, time, count).astype(dtype)

    def is_stored(self, name: str, number: int, time: float, values: NDArray[np.generic]) -> bool:
        """Return whether values (count, components) are what the original stores at a time, and :meth:`at` gives."""
        source, _, matrix = self._stored(name, number, time)
        if matrix is not None and not np.linalg.cond(matrix[0, :3, :3]) < MOST_SKEWED:
            return False
        try:
            found = _in_file(source, source.at(time), time, len(values))
        except InputError:  # it has no values then
            return False
        return found.astype(values.dtype).tobytes() == values.tobytes()

    def _stored(self, name: str, number: int, time: float) -> tuple[ShapeField, Any, Float64Array | None]:
        """Return a field of a shape, the shape, and the matrix (1, 4, 4) by which its values are turned at a time."""
        index, near = self._fits[number].index, int(np.abs(self._times - time).argmin())
        shape = self._original.shapes[index]
        matrix = self._original.field_matrix(self._fields[name], shape, near)
        return self._original.field_sources[name][index], shape, matrix


def _in_file(source: ShapeField, rows: NDArray[np.generic], time: float, count: int) -> NDArray[np.generic]:
    """Return rows of an object as its file stores them."""
    found = rows if source.order is None else _scattered(rows, source.order, source.rows)
    return found if source.rows_at is None else _scattered(found, source.rows_at(time), count)


def _scattered(rows: NDArray[np.generic], places: NDArray[np.integer], count: int) -> NDArray[np.generic]:
    found = np.zeros((count, rows.shape[1]), rows.dtype)
    inside = (places >= 0) & (places < count)
    found[places[inside]] = rows[inside]
    return found
