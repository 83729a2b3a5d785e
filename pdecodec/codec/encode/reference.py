"""The reference frame: which quantisation steps are tried, and what each costs.

The reference frame's error is there in every frame. Where parts turn, it turns with them: what every vertex is off by
then looks like motion that no function of space describes, and a finer reference frame pays for itself many times
over. Where little turns or the clip is short, bits are better spent on the motion.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor

import numpy as np

from pdecodec.codec.encode.tuning import Tuning
from pdecodec.codec.sections.reference import ReferenceFrame, encode_reference, quantise_smoothly
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import MeshObject

SINGLE_FRAME_STEP = 1.1
"""Step where there is one frame, in units: the largest that keeps the bound (2 / sqrt 3 = 1.15) but for float32."""


COARSEST_STEP = 2.0
"""Coarsest step that is tried, in units: a coarser one breaks the bound even when smoothed."""

WELL_SMOOTHED, COARSE_GRID = 0.75, 512
"""Smoothing pays where it leaves so much of the mean error of a frame at most, on a grid of so many steps along the
longest side at most."""


def smooths_well(reference: ReferenceFrame) -> bool:
    """Return whether smoothing in the decoder brings a reference frame much nearer to the points."""
    coded = reference.coded
    return coded is not None and coded.error_ratio <= WELL_SMOOTHED and coded.grid.max() <= COARSE_GRID


def reference_steps(points: Float32Array, unit: float, tuning: Tuning) -> list[float]:
    """Return the quantisation steps of a reference frame that are worth trying, falling.

    Halves and thirds of halves of its longest side: symmetric shapes, which many man-made ones are, then have
    coordinates that repeat, and steps do not depend on the bound.

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


class References:
    """Reference frames and their sections, made by another thread or when they are asked for, each once."""

    def __init__(self, objects: Sequence[MeshObject], beside: ThreadPoolExecutor) -> None:
        self._objects, self._beside = objects, beside
        self._made: dict[float, Future[bytes]] = {}
        self._frames: dict[float, ReferenceFrame] = {}

    def frame(self, points: Float32Array, step: float) -> ReferenceFrame:
        """Return the clip's first frame on a grid of `step`, smoothed where that brings it nearer to the points."""
        if step not in self._frames:
            self._frames[step] = quantise_smoothly(points, step, self._objects)
        return self._frames[step]

    def begin(self, reference: ReferenceFrame) -> None:
        """Begin to make what will be asked for."""
        if reference.coded_step not in self._made:
            self._made[reference.coded_step] = self._beside.submit(encode_reference, reference, self._objects)

    def data(self, reference: ReferenceFrame) -> bytes:
        """Return the section."""
        if reference.coded_step not in self._made:
            made: Future[bytes] = Future()
            made.set_result(encode_reference(reference, self._objects))
            self._made[reference.coded_step] = made  # only now: whoever found it before would wait for one that failed
        return self._made[reference.coded_step].result()
