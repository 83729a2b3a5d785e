"""A sequence in the order in which its surfaces are coded, so that no order has to be stored (`order="free"`)."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.sections.attributes import reorder_attributes
from pdecodec.codec.sections.connectivity import CodedOrder, coded_orders
from pdecodec.mesh.arrays import Float32Array, Int64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import AttributeDomain, Connectivity, MeshObject, MeshSequence


class CodedOrderSequence(MeshSequence):
    """A sequence whose vertices, faces and corners stand in the order in which their surface is coded.

    Parameters
    ----------
    source : MeshSequence
    """

    def __init__(self, source: MeshSequence) -> None:
        self._source = source
        self.times, self.fps = source.times, source.fps
        self.metadata, self.notices = source.metadata, source.notices
        self.fields = source.fields
        objects, vertices, first, self._orders = [], [], 0, []
        for item, order in zip(
            source.objects, coded_orders([item.connectivity for item in source.objects]), strict=True
        ):
            if item.connectivity.cell_count:
                order = None  # Cells cost more when numbered in the order of their surface.
            count = item.vertex_count
            self._orders.append(order)
            numbers = np.arange(count) if order is None else order.vertices.astype(np.int64)
            vertices.append(first + numbers)
            objects.append(item if order is None else _reordered(item, order))
            first += count
        self.objects = tuple(objects)
        self._vertices = np.concatenate(vertices)
        self._rows: dict[str, Int64Array] = {}

    def read_frames(self, start: int, stop: int) -> Float32Array:
        return np.ascontiguousarray(self._source.read_frames(start, stop)[:, self._vertices])

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        if field.name not in self._rows:
            self._rows[field.name] = self._rows_of(field)
        return self._source.read_field(field.name, start, stop)[:, self._rows[field.name]]

    def _rows_of(self, field: Field) -> Int64Array:
        """Return the row of the source for each row of a field."""
        rows = []
        for own, order in zip(field.slices(self.objects), self._orders, strict=True):
            numbers = np.arange(own.start, own.stop)
            if order is not None and field.domain != "object" and numbers.size:
                numbers = numbers[
                    {"vertex": order.vertices, "face": order.faces, "corner": order.corners}[field.domain]
                ]
            rows.append(numbers)
        return np.concatenate(rows)

    def close(self) -> None:
        self._source.close()


def _reordered(item: MeshObject, order: CodedOrder) -> MeshObject:
    part = item.connectivity
    number = np.empty(part.vertex_count, np.int32)
    number[order.vertices] = np.arange(part.vertex_count, dtype=np.int32)
    connectivity = Connectivity(
        part.vertex_count,
        face_counts=part.face_counts[order.faces],
        face_indices=number[part.face_indices[order.corners]],
        line_counts=part.line_counts,
        line_indices=number[part.line_indices],
    )
    rows: dict[AttributeDomain, Int64Array] = {
        "vertex": order.vertices.astype(np.int64),
        "face": order.faces.astype(np.int64),
        "corner": order.corners.astype(np.int64),
    }
    return MeshObject(item.name, connectivity, reorder_attributes(item, rows))
