"""Reference frame: which quantisation steps are tried, and reference frames cached by step.

The reference frame's error is in every frame and turns with the parts of the mesh. Then it looks like motion that no
function of space describes, so a finer reference frame saves many times its own bits. Where little turns, or the
clip is short, bits are better spent on the motion.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import Executor, Future, ThreadPoolExecutor
from typing import Any, TypeVar

import numpy as np

from pdecodec.codec.encode.tuning import Tuning
from pdecodec.codec.sections.reference import NO_TIES, ReferenceFrame, encode_reference, quantise_smoothly
from pdecodec.mesh.arrays import Float32Array, Int32Array, Int64Array
from pdecodec.mesh.sequence import MeshObject
from pdecodec.system.shares import MIN_SHARED_SIZE

Result = TypeVar("Result")

SINGLE_FRAME_STEP = 1.1
"""Step for clips of one frame [units]: the largest that keeps the bound (2 / sqrt 3 = 1.15), less a margin for
float32.
"""


COARSEST_STEP = 2.0
"""Coarsest step that is tried [units]: a coarser one breaks the bound even when smoothed."""

WELL_SMOOTHED, COARSE_GRID = 0.75, 512
"""Smoothing pays if it leaves at most this share of a frame's mean error, on a grid of at most this many steps
along the longest side.
"""


def smooths_well(reference: ReferenceFrame) -> bool:
    """Return whether smoothing in the decoder brings a reference frame much closer to the points."""
    coded = reference.coded
    return coded is not None and coded.error_ratio <= WELL_SMOOTHED and coded.grid.max() <= COARSE_GRID


def reference_steps(points: Float32Array, unit: float, tuning: Tuning) -> list[float]:
    """Return the quantisation steps of a reference frame that are worth trying, in falling order.

    They are the longest side divided by powers of two, and two thirds of these. Symmetric shapes, as many man-made
    ones are, then have coordinates that repeat, and steps do not depend on the bound.

    Parameters
    ----------
    points : (vertices, 3) float32 [scene units]
    unit : float [scene units]
    tuning : Tuning
    """
    finest = tuning.finest_reference_step * unit
    side = float(np.ptp(points.astype(np.float64), axis=0).max(initial=0.0))
    if side == 0.0:
        return [tuning.reference_step * unit]
    octave = math.ceil(math.log2(COARSEST_STEP * unit / side))
    octaves = range(octave, octave - math.ceil(math.log2(COARSEST_STEP * unit / finest)) - 1, -1)
    steps = [share * math.ldexp(side, octave) for octave in octaves for share in (1.0, 2.0 / 3.0)]
    return [step for step in steps if finest <= step <= COARSEST_STEP * unit]


HASH_FACTORS = np.array([0x9E3779B97F4A7C15, 0xC2B2AE3D27D4EB4F, 0x165667B19E3779F9, 0xD6E8FEB86659FD93], np.uint64)
"""Of a hash, and of the bits of x, y and z that are added to it: vertices with equal hashes are compared."""


class TieFinder:
    """Finds vertices that have the same position in every frame: at seams of UVs and normals meshes are split.

    Parameters
    ----------
    points : (vertices, 3) float32
        Of the first frame.
    """

    def __init__(self, points: Float32Array) -> None:
        self._first = np.zeros(len(points), np.int32)
        self._part(points[np.newaxis], np.arange(len(points)))

    @property
    def is_empty(self) -> bool:
        """Whether no vertices are tied: no further frame changes that."""
        return bool((self._first == np.arange(self._first.size)).all())

    def add(self, points: Float32Array) -> None:
        """Part vertices that are apart in one of some frames, (frames, vertices, 3)."""
        self._part(points, np.empty(0, np.int64))

    def _part(self, points: Float32Array, apart: Int64Array) -> None:
        """Group vertices that are apart from others anew, then all that turn out to be apart."""
        first = self._first
        while True:
            hashed = first[apart].astype(np.uint64)
            for frame in points:
                bits = (frame[apart] + np.float32(0.0)).view(np.uint32)  # -0 equals 0
                hashed = hashed * HASH_FACTORS[0] + (bits * HASH_FACTORS[1:]).sum(axis=1, dtype=np.uint64)
            _, index, inverse = np.unique(hashed, return_index=True, return_inverse=True)
            first[apart] = apart[index[inverse]]
            compared = np.flatnonzero(first != np.arange(first.size))
            apart = compared[(points[:, compared] != points[:, first[compared]]).any(axis=(0, 2))]
            if not apart.size:
                return

    @property
    def ties(self) -> Int32Array:
        """As :attr:`pdecodec.codec.sections.reference.ReferenceFrame.ties`."""
        return NO_TIES if self.is_empty else self._first


class _AtOnce(Executor):
    """Does what is submitted at once, in the same thread."""

    def submit(self, work: Callable[..., Result], /, *arguments: Any, **named: Any) -> Future[Result]:
        done: Future[Result] = Future()
        try:
            done.set_result(work(*arguments, **named))
        except Exception as error:  # whoever asks for the result gets it, as from a thread
            done.set_exception(error)
        return done


def thread_ahead(size: int) -> Executor:
    """Return a thread that computes ahead, or what replaces it for a clip so small, in vertices times frames, that
    starting a thread takes longer than the work.
    """
    return _AtOnce() if size < MIN_SHARED_SIZE else ThreadPoolExecutor(1)


class References:
    """Cache of reference frames and their sections, each made once, ahead in another thread or when asked for."""

    def __init__(self, objects: Sequence[MeshObject], ahead: Executor, ties: Int32Array = NO_TIES) -> None:
        self._objects, self._ahead, self.ties = objects, ahead, ties
        self.tied = int(np.count_nonzero(ties != np.arange(ties.size)))
        self._made: dict[float, Future[bytes]] = {}
        self._frames: dict[float, ReferenceFrame] = {}

    def frame(self, points: Float32Array, step: float) -> ReferenceFrame:
        """Return the clip's first frame on a grid of `step`, smoothed if that brings it closer to the points."""
        if step not in self._frames:
            self._frames[step] = quantise_smoothly(points, step, self._objects, self.ties)
        return self._frames[step]

    def begin(self, reference: ReferenceFrame) -> None:
        """Start encoding a reference frame in the other thread."""
        if reference.coded_step not in self._made:
            self._made[reference.coded_step] = self._ahead.submit(encode_reference, reference, self._objects)

    def data(self, reference: ReferenceFrame) -> bytes:
        """Return section REST of a reference frame."""
        if reference.coded_step not in self._made:
            made: Future[bytes] = Future()
            made.set_result(encode_reference(reference, self._objects))
            # Stored only now: another thread must not wait for a section that failed.
            self._made[reference.coded_step] = made
        return self._made[reference.coded_step].result()
