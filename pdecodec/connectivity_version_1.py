"""Connectivity in format version 1: faces and lines in their original order, as differences of vertex indices."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.entropy import pack_integers, unpack_integers
from pdecodec.errors import CorruptFileError, InputError, LimitError
from pdecodec.sequence import Connectivity

Int64Array = NDArray[np.int64]

BYTES_PER_CORNER = 80
"""Peak memory of opening a file, per corner: connectivity, and the edges that curves are found on."""


def encode_connectivity(parts: Sequence[Connectivity]) -> bytes:
    """Section CONN: the connectivity of every object, in order."""
    writer = FieldWriter()
    for part in parts:
        for counts, indices in _kinds(part):
            writer.numbers("QQ", counts.size, indices.size)
            uniform = counts.size > 0 and bool((counts == counts[0]).all())
            writer.numbers("I", int(counts[0]) if uniform else 0)
            if not uniform:
                writer.sized(pack_integers(counts))
            writer.sized(pack_integers(_differences(counts, indices)))
    return writer.to_bytes()


def decode_connectivity(data: bytes, vertex_counts: Sequence[int], most_corners: int) -> list[Connectivity]:
    """Undo :func:`encode_connectivity`.

    Parameters
    ----------
    data : bytes
    vertex_counts : sequence of int
        Vertices of each object.
    most_corners : int
        Face corners and line points that the memory limit leaves room for, at BYTES_PER_CORNER each.

    Raises
    ------
    CorruptFileError
        If the section is damaged or an index is out of range.
    LimitError
        If there are more corners than `most_corners`.
    """
    reader = FieldReader(data, "CONN")
    parts = []
    for vertices in vertex_counts:
        kinds = []
        for _ in range(2):
            count, size = reader.integers("QQ")
            if count > size:
                raise CorruptFileError(f"section CONN declares {count} faces or lines with {size} corners")
            if size > most_corners:
                raise LimitError(f"section CONN declares {size} corners, more than the memory limit allows")
            most_corners -= size
            (uniform,) = reader.integers("I")
            if uniform:
                if uniform * count != size:
                    raise CorruptFileError("section CONN has counts that do not add up to its corners")
                counts = np.full(count, uniform, np.int64)
            else:
                counts = unpack_integers(reader.sized(), count)
                if counts.sum() != size or (count and (counts.min() < 1 or counts.max() > size)):
                    raise CorruptFileError("section CONN has counts that do not add up to its corners")
            kinds.append((counts, _indices(counts, unpack_integers(reader.sized(), size), vertices)))
        (face_counts, face_indices), (line_counts, line_indices) = kinds
        try:
            parts.append(
                Connectivity(
                    vertices, face_counts.astype(np.int32), face_indices, line_counts.astype(np.int32), line_indices
                )
            )
        except InputError as error:
            raise CorruptFileError(f"section CONN is damaged ({error.message})") from error
    reader.finish()
    return parts


def _kinds(part: Connectivity) -> tuple[tuple[NDArray[np.int32], NDArray[np.int32]], ...]:
    return (part.face_counts, part.face_indices), (part.line_counts, part.line_indices)


def _differences(counts: NDArray[np.integer], indices: NDArray[np.integer]) -> Int64Array:
    # A face's first corner against the first of the face before it, every other against the corner before it.
    wide = indices.astype(np.int64)
    differences = np.diff(wide, prepend=0)
    firsts = np.cumsum(counts, dtype=np.int64) - counts
    differences[firsts] = np.diff(wide[firsts], prepend=0)
    return differences


def _indices(counts: Int64Array, differences: Int64Array, vertices: int) -> NDArray[np.int32]:
    if differences.size and int(np.abs(differences).max()) > vertices:
        raise CorruptFileError("section CONN refers to a vertex that is not there")
    firsts = np.cumsum(counts, dtype=np.int64) - counts
    running = differences.copy()
    # Sums of at most 2^31 differences below 2^31: no overflow. The first corners form a chain of their own.
    first_values = np.cumsum(running[firsts])
    running[firsts] = 0
    along = np.cumsum(running)
    owner = np.repeat(np.arange(counts.size), counts)
    indices: Int64Array = along - along[firsts][owner] + first_values[owner]
    if indices.size and (int(indices.min()) < 0 or int(indices.max()) >= vertices):
        raise CorruptFileError("section CONN refers to a vertex that is not there")
    return indices.astype(np.int32)
