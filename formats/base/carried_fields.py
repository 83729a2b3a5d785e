"""Values of coded fields as the file of a scene stores them: in its space and its order of rows.

:class:`SceneSequence` turns directions into the space of the scene, faces around, and gathers rows; this undoes it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.attribute_roles import direction_role, reversed_corners
from pdecodec.formats.base.onto import Fitted
from pdecodec.formats.base.scene_reading import SceneSequence, ShapeField
from pdecodec.formats.base.scene_space import turned_directions
from pdecodec.formats.base.times import SAME_TIME
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence

CLOSE = 1e-5
"""Largest difference of a value that was turned into the space of the scene and back, relative to the largest value."""


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

    def at(self, name: str, number: int, time: float, seconds: float, count: int) -> NDArray[np.generic]:
        """Return the `count` rows (count, components) that are stored at a time of the format.

        `seconds` is that time; of a sequence without a frame then, the nearest frame is taken. Rows that the field
        lacks are 0.
        """
        field, index = self._fields[name], self._fits[number].index
        source, shape = self._original.field_sources[name][index], self._original.shapes[index]
        frame = int(np.abs(self._sequence.times - seconds).argmin())
        values = self._sequence.read_field(name, frame, frame + 1)
        rows = values.reshape(1, values.shape[1], -1)[:, self._slices[name][number]]
        matrix = self._original.field_matrix(field, shape, int(np.abs(self._times - time).argmin()))
        if matrix is not None:
            rows = turned_directions(field, rows, np.linalg.inv(matrix).astype(np.float64))
        rows = rows[0]
        if field.domain == "corner" and self._fits[number].item.connectivity is not shape.connectivity:
            faces = self._fits[number].item.connectivity
            if not faces.same_as(shape.connectivity):
                rows = rows[reversed_corners(faces.face_counts)]
        if source.order is not None:
            rows = _scattered(rows, source.order, source.rows)
        return rows if source.rows_at is None else _scattered(rows, source.rows_at(time), count)

    def is_stored(self, name: str, number: int, time: float, seconds: float, values: NDArray[np.generic]) -> bool:
        """Return whether :meth:`at` gives the values (count, components) that are stored."""
        try:
            found = self.at(name, number, time, seconds, len(values)).astype(values.dtype)
        except (ValueError, IndexError):  # it is flattened, or does not fit
            return False
        if found.shape != values.shape or direction_role(self._fields[name]) is None:
            return found.tobytes() == values.tobytes()
        with np.errstate(invalid="ignore"):
            return bool((np.abs(found - values) <= CLOSE * np.abs(values).max(initial=0)).all())


def _scattered(rows: NDArray[np.generic], places: NDArray[np.integer], count: int) -> NDArray[np.generic]:
    found = np.zeros((count, rows.shape[1]), rows.dtype)
    inside = (places >= 0) & (places < count)
    found[places[inside]] = rows[inside]
    return found
