"""Bytes for functions of time that are stored (section TIME), trajectories and shapes: one value a frame and axis.

Three methods, of which an encoder takes the cheapest. Motion without a rhythm, jumps and starts included, is predicted
in time: each number from the four frames before it, by weights that encoder and decoder learn alike. Motion that
swings or repeats itself is transformed by cosines. Motion between keyframes is a row of straight lines: changes of
speed, nearly all of them zero. Each way whole numbers are left, small for the most part, and coded by the sizes of
their neighbours: in time (or frequency), among axes, among functions. All but the choice is native:
`core/sections/temporal/`.
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
"""The first byte: which method."""

LONGEST_TRANSFORM = 1024
"""Frames beyond which nothing is transformed: a decoder's work grows with their square."""

MOST_STEPS = 2.0**30
"""Largest magnitude of a number, in steps. float32 itself is coarser than that."""

ROUNDING = 0.4
"""Added to a magnitude in steps before its fraction is dropped. At equal error, 0.5 takes 3 % more bytes and above at
one bit a number, about as many at four; 0.33 takes 2 % more at any rate."""

MOST_TURNS = 1.0 / 3.0
"""Share of the numbers that may change the speed; where more do, straight lines are no candidate."""

SAMPLED, FEWEST_SAMPLED = 3, 8
"""One in so many functions is coded by every method, to choose one for all, where those are so many at least."""

BITS_OF_AN_ERROR = 6.0 / math.log(2.0)
"""Bits that a squared error of step^2 is worth: the error of a number, step^2 / 12, falls to a quarter with each bit,
which is a slope of step^2 / 12 * 2 ln 2."""


@dataclass(frozen=True, eq=False)
class QuantisedTimeFunctions:
    """Functions of time as they will be coded.

    Attributes
    ----------
    method : int
    quantised : (functions, frames, axes) int64
    decoded : (frames, axes, functions) float64
        What they decode to, to the last bit.
    step : float
    """

    method: int
    quantised: Int64Array
    decoded: Float64Array
    step: float

    @cached_property
    def bits(self) -> float:
        """Of :meth:`to_bytes`, measured, to a byte or two."""
        return _core.measure_time_functions(self.quantised)

    def to_bytes(self) -> bytes:
        """The functions of time as bytes; empty where all numbers are zero."""
        return _core.encode_time_functions(self.method, self.quantised)


def quantise_time_functions(scaled: Float64Array, step: float) -> QuantisedTimeFunctions:
    """Quantise functions of time, by the method that takes fewest bits for its error.

    Parameters
    ----------
    scaled : (frames, axes, functions) float64
        Axes 3, or 1 where all three move alike.
        Functions by falling energy, each times its singular value; finite.
    step : float
        Quantisation step, in the same unit. The mean squared error comes out near step^2 / 12, or below where
        little moves. A coarser one is taken where numbers would exceed :data:`MOST_STEPS`.

    Raises
    ------
    SettingsError
        If the step is not positive and finite.
    """

    def cost(item: QuantisedTimeFunctions, of: Float64Array = scaled) -> float:
        error = (item.decoded - of) / item.step
        return item.bits + BITS_OF_AN_ERROR * _core.sum_of_products(error.ravel(), error.ravel())

    some = scaled[:, :, ::SAMPLED]
    if some.shape[2] < FEWEST_SAMPLED:
        return min(quantised_by_each_method(scaled, step), key=cost)
    method = min(quantised_by_each_method(some, step), key=lambda item: cost(item, some)).method
    return quantised_by_each_method(scaled, step, method)[0]


class TimeFunctionCost:
    """What functions of time take at any step, after one measurement.

    The bits of a number follow the logarithm of how far it is off a straight line through the two frames before it;
    by how many times, the measurement tells.

    Parameters
    ----------
    scaled : (frames, axes, functions) float64
        As :func:`quantise_time_functions` takes them.
    step : float
        That of the measurement.
    """

    def __init__(self, scaled: Float64Array, step: float) -> None:
        self._scaled = scaled
        self._off = np.abs(np.diff(scaled, n=2, axis=0, prepend=np.zeros((2, *scaled.shape[1:]))))
        every = SAMPLED if scaled.shape[2] >= SAMPLED * FEWEST_SAMPLED else 1
        found = quantise_time_functions(scaled[:, :, ::every], step)
        rough = _size(self._off[:, :, ::every] / found.step)
        self._factor = found.bits / rough if rough else 0.0

    def bits(self, used: NDArray[np.intp], step: float) -> float:
        """Of some of the functions, about."""
        return self._factor * _size(self._off[:, :, used] / step)

    def rounded(self, used: NDArray[np.intp], step: float) -> Float64Array:
        """Some of the functions, as far off as they are after coding."""
        values = self._scaled[:, :, used]
        rounded: Float64Array = np.copysign(step * np.floor(np.abs(values) / step + ROUNDING), values)
        return rounded


def quantised_by_each_method(
    scaled: Float64Array, step: float, only: int | None = None
) -> list[QuantisedTimeFunctions]:
    """Functions of time by every method that can be, or by one alone; see :func:`quantise_time_functions`.

    Predicted ones where the one cannot be.
    """
    step, frames = _possible(step, scaled), scaled.shape[0]
    wanted = np.ascontiguousarray(scaled.transpose(2, 0, 1)) / step

    def transformed(method: int, quantised: Int64Array) -> QuantisedTimeFunctions:
        return QuantisedTimeFunctions(method, quantised, _core.time_function_values(method, quantised, step), step)

    ways: list[Callable[[], QuantisedTimeFunctions]] = []
    if only in (None, TRANSFORMED) and 0 < frames <= LONGEST_TRANSFORM:
        ways.append(lambda: transformed(TRANSFORMED, _transform(wanted)))
    if only in (None, STRAIGHT) and frames > 0:
        straight = _core.quantise_straight(wanted, 1.0 - ROUNDING)
        if np.count_nonzero(straight) <= MOST_TURNS * straight.size:
            ways.append(lambda: transformed(STRAIGHT, straight))
    if only in (None, PREDICTED) or not ways:
        ways.insert(
            0, lambda: QuantisedTimeFunctions(PREDICTED, *_core.quantise_predicted(wanted, ROUNDING, step), step)
        )

    def measured(way: Callable[[], QuantisedTimeFunctions]) -> QuantisedTimeFunctions:
        found = way()
        if only is None:
            _ = found.bits  # to compare them by; kept
        return found

    return side_by_side(*(partial(measured, way) for way in ways))


def _possible(step: float, scaled: Float64Array) -> float:
    """A step, or a coarser one where numbers would exceed :data:`MOST_STEPS`: what many vertices have in common is as
    many times larger than each as the root of their number, so that each is off by hardly more.
    """
    if not 0.0 < step < math.inf:
        raise SettingsError(f"the step of functions of time must be a positive number, not {step}")
    return max(step, float(np.abs(scaled).max(initial=0.0)) / MOST_STEPS)


def _size(steps: Float64Array) -> float:
    """Binary digits of numbers, about: the logarithms of one more than each, added up."""
    return float(_core.binary_logarithms(1.0 + steps.reshape(len(steps), -1)).sum())


def _transform(wanted: Float64Array) -> Int64Array:
    """Quantised cosine transform of what is wanted, (functions, frames, axes), in steps."""
    functions, frames, axes = wanted.shape
    waves = _core.multiply_rows(wanted.reshape(functions, frames * axes), cosines(frames, frames), axes, thread_count())
    waves = waves.reshape(wanted.shape)
    quantised: Int64Array = np.copysign(np.floor(np.abs(waves) + ROUNDING), waves).astype(np.int64)
    return quantised
