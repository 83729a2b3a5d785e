"""A cosine transform of every coordinate over the whole clip."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.peers.prediction import decode_over_mesh, encode_over_mesh
from pdecodec.peers.transform import Transform, rounded
from pdecodec.peers.traversal import traverse
from pdecodec.sequence import Connectivity, Float32Array


@dataclass(frozen=True, eq=False)
class Frequencies:
    """Rounded spectrum of a clip.

    Attributes
    ----------
    step : float [scene units]
    frames : int
    levels : (kept, vertices, 3) int64
        Lowest frequency first; the highest are nothing and left out.
    """

    step: float
    frames: int
    levels: NDArray[np.int64]


class CosineInTime(Transform[Frequencies]):
    """Orthonormal DCT-II in time, one step for all frequencies, each predicted across the mesh."""

    name = "DCT in time"
    source = "Ahmed, Natarajan and Rao 1974, Discrete cosine transform; prediction after Touma and Gotsman 1998"

    def analyse(self, points: Float32Array, connectivity: Connectivity) -> Callable[[float], Frequencies]:
        from scipy.fft import dct

        spectrum = dct(points.astype(np.float64), axis=0, norm="ortho")

        def round_to(length: float) -> Frequencies:
            levels = rounded(spectrum, length)
            kept = 1 + max(np.flatnonzero(levels.reshape(len(points), -1).any(axis=1)), default=0)
            return Frequencies(length, len(points), levels[:kept])

        return round_to

    def write(self, levels: Frequencies, connectivity: Connectivity) -> bytes:
        kept = levels.levels
        writer = FieldWriter()
        writer.numbers("d2Q", levels.step, levels.frames, len(kept))
        columns = kept.transpose(1, 0, 2).reshape(connectivity.vertex_count, -1)
        writer.sized(encode_over_mesh(columns, traverse(connectivity)))
        return writer.to_bytes()

    def read(self, data: bytes, connectivity: Connectivity) -> Frequencies:
        reader = FieldReader(data, self.name)
        (step,) = reader.reals("d")
        frames, kept = reader.integers("2Q")
        columns = decode_over_mesh(reader.sized(), 3 * kept, traverse(connectivity))
        return Frequencies(step, frames, columns.reshape(-1, kept, 3).transpose(1, 0, 2))

    def synthesise(self, levels: Frequencies, connectivity: Connectivity) -> Float32Array:
        from scipy.fft import idct

        spectrum = np.zeros((levels.frames, connectivity.vertex_count, 3))
        spectrum[: len(levels.levels)] = levels.levels * levels.step
        points: Float32Array = idct(spectrum, axis=0, norm="ortho", overwrite_x=True).astype(np.float32)
        return points
