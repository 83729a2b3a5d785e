"""Write meshes that are there to be shown: without a record of the original faces, seams and order.

Compressed, they are rounded within the bound of the motion, rows with equal attributes become one, rows and triangles
stand in the order that compresses best, and faces that are flat need no normals, because viewers shade triangles
without normals flat.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.base.normals import NormalRows
from pdecodec.formats.gltf.builder import QUANTIZATION, VERTEX_DATA, GltfBuilder
from pdecodec.formats.gltf.file import TRIANGLES
from pdecodec.formats.gltf.mesh_motion import CodedRows
from pdecodec.formats.gltf.mesh_writer import MeshWriter, Part, uv_rows
from pdecodec.formats.gltf.motion import Lattice, Motion, largest_angle, lattice_of
from pdecodec.formats.gltf.packing import TRIANGLE_ORDERS, exponential, octahedral
from pdecodec.formats.gltf.primitives import triangulate
from pdecodec.mesh.arrays import BoolArray, Float32Array, Int64Array
from pdecodec.mesh.sequence import Connectivity, MeshObject

RIGID_SHARES = {"shape": 0.5, "translation": 0.25, "rotation": 0.25}
"""Shares of the bound by which rounding may move vertices of a rigid object."""

UV_STEP = 2.0**-12
"""Step to which texture coordinates are rounded, as gltf-transform does: an eighth of a texel of 512."""

FLAT_ANGLE, ROUNDED_FLAT_ANGLE = 0.1, 1.0
"""Largest angles between the normals of a face and those of its triangles, exact and rounded, that count as flat
[degrees].
"""

FLAT_FINENESS = 8
"""How much finer shapes are rounded whose faces are drawn without normals: these turn with the corners."""

FEWER_ROWS, FINENESS_ROWS = 128, 0.25
"""Rows that faces without normals have to save: as many as a further primitive takes bytes, and for each row of the
mesh, because it takes more digits.
"""


@dataclass(frozen=True)
class Delivery:
    """How meshes are written that are there to be shown.

    Attributes
    ----------
    bound : float or None [scene units]
        By which vertices of the shape at rest may be moved by rounding; None: nothing is rounded.
    """

    bound: float | None

    @property
    def step(self) -> float | None:
        """Step to which the coordinates of the shape are rounded [scene units]."""
        return None if self.bound is None else self.bound * 2 / math.sqrt(3)

    def allows(self, error: float) -> bool:
        """Return whether vertices of the shape may be so far off along each axis [scene units]."""
        return self.bound is None or error * math.sqrt(3) <= self.bound

    def share(self, part: str) -> Delivery:
        """Return the delivery with the share of one of the parts that move a rigid object."""
        return Delivery(None if self.bound is None else self.bound * RIGID_SHARES[part])


def delivered_lattice(
    item: MeshObject, motion: Motion, rows: NormalRows | None, step: float, *, centred: bool
) -> tuple[Lattice, BoolArray | None]:
    """Return the lattice to which a shape is rounded, and a mask (faces,) of the faces that need no normals, if any."""
    if rows is not None and motion.normals is not None:
        fine = lattice_of(motion, centred=centred, step=step / FLAT_FINENESS)
        rounded = fine.offset + fine.scale / np.iinfo(np.int16).max * fine.steps(motion.rest)
        flat = _flat_faces(item.connectivity, (motion.rest, rounded), motion.normals, rows)
        if flat.any():
            corners = _distinct([motion.rest])[0][item.connectivity.face_indices] * (rows.count + 1)
            is_flat = np.repeat(flat, item.connectivity.face_counts)
            before, after = (
                np.unique(corners + one).size
                for one in (rows.corner_rows, np.where(is_flat, rows.count, rows.corner_rows))
            )
            if before - after > after * FINENESS_ROWS + FEWER_ROWS * (not flat.all()):
                return fine, flat
    return lattice_of(motion, centred=centred, step=step), None


def _flat_faces(
    connectivity: Connectivity, shapes: Sequence[NDArray[np.floating]], normals: Float32Array, rows: NormalRows
) -> BoolArray:
    """Return a mask (faces,) of faces whose normals are those of their triangles, exact and rounded."""
    corners, faces = triangulate(connectivity, np.arange(connectivity.face_indices.size))
    given, bent = normals[rows.corner_rows[corners]].astype(np.float64), np.zeros(len(corners), bool)
    for points, angle in zip(shapes, (FLAT_ANGLE, ROUNDED_FLAT_ANGLE), strict=True):
        a, b, c = points[connectivity.face_indices[corners]].astype(np.float64).transpose(1, 0, 2)
        own = np.cross(b - a, c - a)
        least = np.cos(np.radians(angle)) * np.linalg.norm(own, axis=1)
        bent |= (np.einsum("ik,ijk->ij", own, given) < least[:, None]).any(axis=1)
    found: BoolArray = np.bincount(faces[bent], minlength=connectivity.face_count) == 0
    return found


class DeliveredMeshWriter(MeshWriter):
    """A mesh that is there to be shown.

    Parameters
    ----------
    builder, item, motion, rows, lattice
    delivery : Delivery
    coded : CodedRows, optional
        Order the mesh as the `.pdeanim` file that moves it, and give its primitives the extension.
    flat : (faces,) bool, optional
        The faces that need no normals.

    Attributes
    ----------
    normal_angle : float
        Largest angle by which rounding turned normals [degrees].
    """

    def __init__(
        self,
        builder: GltfBuilder,
        item: MeshObject,
        motion: Motion,
        rows: NormalRows | None,
        lattice: Lattice | None,
        delivery: Delivery,
        coded: CodedRows | None = None,
        flat: BoolArray | None = None,
    ) -> None:
        self._coded, self._flat, self._step = coded, flat, delivery.step
        self.normal_angle = 0.0
        super().__init__(builder, item, motion, rows, lattice)
        if self._step is not None:
            builder.require(QUANTIZATION)
        if coded is not None:
            self._reorder(np.argsort(coded.numbers[self.sources], kind="stable"))

    def _normal_columns(self) -> list[NDArray[Any]]:
        if self._flat is None or self._rows is None:
            return super()._normal_columns()
        return [np.where(np.repeat(self._flat, self._item.connectivity.face_counts), -1, self._rows.corner_rows)]

    def _flat_faces(self) -> BoolArray:
        return super()._flat_faces() if self._flat is None else self._flat

    def _face_order(self) -> Int64Array | None:
        return None if self._coded is None else self._coded.ranks

    def _reorder(self, order: Int64Array) -> None:
        """Put rows in another order, (rows,)."""
        rank = np.empty_like(order)
        rank[order] = np.arange(order.size)
        self.sources, self.corner_rows, self.vertex_rows = (
            self.sources[order],
            rank[self.corner_rows],
            rank[self.vertex_rows],
        )

    def _draw(self, part: Part, rows: int) -> dict[str, Any]:
        is_in_order = np.array_equal(_rows_of(part), np.arange(rows))
        found = super()._draw(part._replace(indices=None) if is_in_order else part, rows)
        if part.mode == TRIANGLES:
            del found["mode"]
        return found

    def _row_map(self, own: Int64Array) -> dict[str, int]:
        return {} if self._coded is None else self._coded.row_map(self._builder, self.sources[own])

    def _finish(self, primitive: dict[str, Any], row_map: dict[str, int]) -> None:
        if self._coded is not None:
            self._coded.add_to(primitive, row_map)

    def _extras(self, drawn: Sequence[tuple[int, NDArray[Any]]]) -> dict[str, Any]:
        return {}

    def _batches(self, parts: list[Part]) -> list[tuple[Int64Array, list[Part]]]:
        """Give primitives attributes of their own if no two share rows, so that none has rows that it does not draw."""
        rows = np.arange(self.sources.size)
        parts = [one._replace(indices=rows if one.indices is None else one.indices) for one in parts]
        if self._builder.packer is not None:
            parts = self._well_ordered(parts)
        found: list[tuple[Int64Array, list[Part]]] = []
        for has_normals in (True, False):
            alike = [one for one in parts if one.has_normals == has_normals]
            used = [np.unique(_rows_of(one)) for one in alike]
            if alike and (len(alike) == 1 or np.concatenate(used).size > np.unique(np.concatenate(used)).size):
                used, groups = [np.unique(np.concatenate(used))], [alike]
            else:
                groups = [[one] for one in alike]
            found += zip(used, groups, strict=True)
        # Rows that nothing draws go with the last primitives.
        everywhere = np.concatenate([own for own, _ in found])
        found[-1] = np.union1d(found[-1][0], np.setdiff1d(np.arange(self.sources.size), everywhere)), found[-1][1]
        return [
            (own, [one._replace(indices=np.searchsorted(own, _rows_of(one))) for one in drawn]) for own, drawn in found
        ]

    def _well_ordered(self, parts: list[Part]) -> list[Part]:
        """Order triangles and rows so that they compress best; return the primitives in that order."""
        packer, columns = self._builder.packer, self._compressed_columns()
        assert packer is not None
        columns, places, merged = self._without_equal_rows(columns)
        parts = [one._replace(indices=merged[_rows_of(one)]) for one in parts]
        rows, numbers = np.arange(self.sources.size), None if self._coded is None else self._coded.numbers
        ways = [[_rows_of(one) for one in parts]]
        for way, seen in product(range(TRIANGLE_ORDERS), (rows, places)):
            if seen is rows or places.max() + 1 < rows.size:
                ways.append([])
                for one in parts:
                    indices = _rows_of(one)
                    if one.mode == TRIANGLES:
                        triangles = indices.reshape(-1, 3)
                        indices = triangles[packer.triangle_order(seen[triangles], rows.size, way)].reshape(-1)
                    ways[-1].append(indices)
        best: tuple[int, Int64Array, list[Int64Array]] | None = None
        for drawn in ways:
            used, first = np.unique(np.concatenate([*drawn, rows]), return_index=True)
            for order in (rows, used[np.argsort(first)]):
                rank = np.empty_like(order)
                rank[order] = rows
                size = sum(len(packer.rows(np.ascontiguousarray(one[order]))) for one in columns)
                if numbers is not None:
                    size += len(packer.numbering(numbers[self.sources[order]].astype("<u4"))[1])
                for part, indices in zip(parts, drawn, strict=True):
                    if part.mode == TRIANGLES:
                        packed = packer.pack(rank[indices].astype("<u4"), triangles=True)
                        size += 2 * indices.size if packed is None else len(packed[1])
                if best is None or size < best[0]:
                    best = size, order, [rank[indices] for indices in drawn]
        assert best is not None
        self._reorder(best[1])
        return [one._replace(indices=drawn) for one, drawn in zip(parts, best[2], strict=True)]

    def _compressed_columns(self) -> list[NDArray[Any]]:
        """Return the attributes of rows in the form in which they are compressed, each (rows, k)."""
        motion, points = self._motion, self._motion.rest[self.sources]

        def rounded(values: Float32Array, step: float) -> NDArray[Any]:
            shown, coded = exponential(values, step) if self._step and values.size else (values, None)
            return shown if coded is None else coded[1]

        if self._lattice is None:
            found = [rounded(points, self._step or 0.0)]
        else:
            found = [np.pad(self._lattice.steps(points), ((0, 0), (0, 1)))]
        for uv in self._uv_sets:
            found += [rounded(uv_rows(uv, self.corner_rows, self.sources.size, self.notes), UV_STEP)]
        found += [self._color_rows(color, values) for color, values in self._colors]
        if motion.normals is not None and self._rows is not None:
            normals = motion.normals[self._normal_rows(self._rows)]
            if self._flat is not None:
                normals[self.corner_rows[np.repeat(self._flat, self._item.connectivity.face_counts)]] = 0
            found.append(normals if self._step is None else octahedral(normals)[1][1])
        return [np.ascontiguousarray(one) for one in found]

    def _without_equal_rows(self, columns: list[NDArray[Any]]) -> tuple[list[NDArray[Any]], Int64Array, Int64Array]:
        """Merge rows at one place whose attributes, each (rows, k), are equal.

        Return the attributes, the number of each row's place, and the new number of each old row.
        """
        points = self._motion.rest[self.sources] if self._coded is None else self._coded.numbers[self.sources][:, None]
        places, _ = _distinct([points])
        which, kept = _distinct([places[:, None], *columns])
        self.sources, self.corner_rows = self.sources[kept], which[self.corner_rows]
        self.vertex_rows = which[self.vertex_rows]
        return [one[kept] for one in columns], places[kept], which

    def _positions(self, points: Float32Array, steps: Lattice | None, own: Int64Array) -> int:
        if steps is not None:
            return super()._positions(points, steps, own)
        return self._builder.rounded(points[self.sources[own]], self._step, target=VERTEX_DATA, bounds=True)

    def _texture_coordinates(self, values: Float32Array) -> int:
        return self._builder.rounded(values, None if self._step is None else UV_STEP, target=VERTEX_DATA)

    def _rest_normals(self, normals: Float32Array) -> int:
        if self._step is None:
            return super()._rest_normals(normals)
        found, stored = self._builder.directions(normals)
        self.normal_angle = max(self.normal_angle, largest_angle(stored[None], normals[None]))
        return found


def _rows_of(part: Part) -> Int64Array:
    """Return the rows that a primitive draws, as :meth:`DeliveredMeshWriter._batches` has named them."""
    assert part.indices is not None
    return part.indices


def _distinct(columns: Sequence[NDArray[Any]]) -> tuple[Int64Array, Int64Array]:
    """Number the different rows of columns, each (rows, k), in the order in which they appear.

    Return the number of each row, and the first row of each number.
    """
    wide = [np.ascontiguousarray(one).view(np.uint8).reshape(len(one), -1) for one in columns]
    _, first, which = np.unique(np.concatenate(wide, axis=1), axis=0, return_index=True, return_inverse=True)
    rank = np.empty_like(first)
    rank[np.argsort(first)] = np.arange(first.size)
    return rank[which.reshape(-1)], np.sort(first)
