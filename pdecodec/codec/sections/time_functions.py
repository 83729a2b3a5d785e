"""Code the stored functions of time (section TIME), trajectories and shapes: one value per frame and axis.

There are three methods; the encoder takes the cheapest. Irregular motion, including discontinuities and starts, is
predicted in time: each number from the four frames before it, by weights that encoder and decoder learn alike.
Motion that swings or repeats itself is transformed by cosines. Motion between keyframes is a sequence of straight
lines, coded as changes of speed, nearly all of them zero. Each method yields mostly small integers, which are coded
with the sizes of their neighbours as context: in time (or frequency), among axes, among functions. Everything except
the choice of method is native: `core/sections/temporal/`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property, partial

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.codec.sections.groups import cosines
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array, Int64Array
from pdecodec.system.shares import side_by_side, thread_count

PREDICTED, TRANSFORMED, STRAIGHT = 0, 1, 2
"""The methods, by their number in a stream's first byte."""

LONGEST_TRANSFORM = 1024
"""Largest number of frames that are transformed; the work of a decoder grows with the square of this number."""

MAX_STEPS = 2.0**30
"""Largest magnitude of a number [steps]; the spacing of float32 is coarser than a step there."""

ROUNDING = 0.4
"""Added to a magnitude in steps before its fraction is dropped. At equal error, 0.5 takes 3 % more bytes at one
bit per number or more, and about as many at four bits; 0.33 takes 2 % more at any rate.
"""

MAX_TURN_FRACTION = 1.0 / 3.0
"""Largest fraction of the numbers at which the speed may change; beyond it, straight lines are no candidate."""

SAMPLING_STRIDE, MIN_SAMPLED_FUNCTIONS = 3, 8
"""To choose one method for all functions, one function in SAMPLING_STRIDE is coded by every method, if at least
MIN_SAMPLED_FUNCTIONS are sampled.
"""

BITS_PER_SQUARED_ERROR = 6.0 / math.log(2.0)
"""Bits that a squared error of step^2 is worth: the error of a number, step^2 / 12, falls to a quarter with
each bit, which is a slope of step^2 / 12 * 2 ln 2.
"""


@dataclass(frozen=True, eq=False)
class QuantisedTimeFunctions:
    """Functions of time as they will be coded.

    Attributes
    ----------
    method : int
    quantised : (functions, frames, axes) int64
    decoded : (frames, axes, functions) float64
        Their decoded values, exact.
    step : float
    """

    method: int
    quantised: Int64Array
    decoded: Float64Array
    step: float

    @cached_property
    def bits(self) -> float:
        """Measured size of :meth:`to_bytes` [bits], to within a byte or two."""
        return _core.measure_time_functions(self.quantised)

    def to_bytes(self) -> bytes:
        """Return the functions of time as bytes; empty if all numbers are zero."""
        return _core.encode_time_functions(self.method, self.quantised)


def quantise_time_functions(scaled: Float64Array, step: float) -> QuantisedTimeFunctions:
    """Quantise functions of time, by the method with the lowest rate-distortion cost.

    Parameters
    ----------
    scaled : (frames, axes, functions) float64
        Axes 3, or 1 if all three move alike.
        Functions by falling energy, each times its singular value; finite.
    step : float
        Quantisation step, in the same unit. The mean squared error comes out near step^2 / 12, or below where
        little moves. A coarser step is taken if numbers would exceed :data:`MAX_STEPS`.

    Raises
    ------
    SettingsError
        If the step is not positive and finite.
    """

    def cost(item: QuantisedTimeFunctions, of: Float64Array = scaled) -> float:
        error = (item.decoded - of) / item.step
        return item.bits + BITS_PER_SQUARED_ERROR * _core.sum_of_products(error.ravel(), error.ravel())

    some = scaled[:, :, ::SAMPLING_STRIDE]
    if some.shape[2] < MIN_SAMPLED_FUNCTIONS:
        return min(quantise_by_each_method(scaled, step), key=cost)
    method = min(quantise_by_each_method(some, step), key=lambda item: cost(item, some)).method
    return quantise_by_each_method(scaled, step, method)[0]


class TimeFunctionCost:
    """Estimates the cost of functions of time at any step, after one measurement.

    The bits of a number are proportional to the logarithm of its distance from a straight line through the two
    frames before it; the measurement gives the factor.

    Parameters
    ----------
    scaled : (frames, axes, functions) float64
        As for :func:`quantise_time_functions`.
    step : float
        The step of the measurement.
    """

    def __init__(self, scaled: Float64Array, step: float) -> None:
        self._scaled = scaled
        self._off = np.abs(np.diff(scaled, n=2, axis=0, prepend=np.zeros((2, *scaled.shape[1:]))))
        every = SAMPLING_STRIDE if scaled.shape[2] >= SAMPLING_STRIDE * MIN_SAMPLED_FUNCTIONS else 1
        found = quantise_time_functions(scaled[:, :, ::every], step)
        rough = _count_digits(self._off[:, :, ::every] / found.step)
        self._factor = found.bits / rough if rough else 0.0

    def bits(self, used: NDArray[np.intp], step: float) -> float:
        """Estimate the bits of the functions `used` at a step."""
        return self._factor * _count_digits(self._off[:, :, used] / step)

    def rounded(self, used: NDArray[np.intp], step: float) -> Float64Array:
        """Return the functions `used` with the error that coding at a step gives them."""
        values = self._scaled[:, :, used]
        rounded: Float64Array = np.copysign(step * np.floor(np.abs(values) / step + ROUNDING), values)
        return rounded


def quantise_by_each_method(scaled: Float64Array, step: float, only: int | None = None) -> list[QuantisedTimeFunctions]:
    """Quantise functions of time by every possible method, or only by one; see :func:`quantise_time_functions`.

    If the requested method is not possible, prediction is used.
    """
    step, frames = _representable_step(step, scaled), scaled.shape[0]
    wanted = np.ascontiguousarray(scaled.transpose(2, 0, 1)) / step

    def transformed(method: int, quantised: Int64Array) -> QuantisedTimeFunctions:
        return QuantisedTimeFunctions(method, quantised, _core.time_function_values(method, quantised, step), step)

    ways: list[Callable[[], QuantisedTimeFunctions]] = []
    if only in (None, TRANSFORMED) and 0 < frames <= LONGEST_TRANSFORM:
        ways.append(lambda: transformed(TRANSFORMED, _transform(wanted)))
    if only in (None, STRAIGHT) and frames > 0:
        straight = _core.quantise_straight(wanted, 1.0 - ROUNDING)
        if np.count_nonzero(straight) <= MAX_TURN_FRACTION * straight.size:
            ways.append(lambda: transformed(STRAIGHT, straight))
    if only in (None, PREDICTED) or not ways:
        ways.insert(
            0, lambda: QuantisedTimeFunctions(PREDICTED, *_core.quantise_predicted(wanted, ROUNDING, step), step)
        )

    def measured(way: Callable[[], QuantisedTimeFunctions]) -> QuantisedTimeFunctions:
        found = way()
        if only is None:
            _ = found.bits  # Measure the bits in this thread, in parallel; the property caches them.
        return found

    return side_by_side(*(partial(measured, way) for way in ways))


def _representable_step(step: float, scaled: Float64Array) -> float:
    """Return the step, or a coarser one if numbers would exceed :data:`MAX_STEPS`. A motion that many vertices
    share is larger than that of each vertex by the square root of their number, so the error of each vertex
    hardly grows.
    """
    if not 0.0 < step < math.inf:
        raise SettingsError(f"the step of functions of time must be a positive number, not {step}")
    return max(step, float(np.abs(scaled).max(initial=0.0)) / MAX_STEPS)


def _count_digits(steps: Float64Array) -> float:
    """Estimate the number of binary digits of numbers: the sum of log2(1 + magnitude)."""
    return float(_core.binary_logarithms(1.0 + steps.reshape(len(steps), -1)).sum())


def _transform(wanted: Float64Array) -> Int64Array:
    """Return the quantised cosine transform of (functions, frames, axes) values, in steps."""
    functions, frames, axes = wanted.shape
    waves = _core.multiply_rows(wanted.reshape(functions, frames * axes), cosines(frames, frames), axes, thread_count())
    waves = waves.reshape(wanted.shape)
    quantised: Int64Array = np.copysign(np.floor(np.abs(waves) + ROUNDING), waves).astype(np.int64)
    return quantised
