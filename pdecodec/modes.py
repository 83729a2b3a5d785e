"""Bytes for the functions of time of trajectories and shapes, called modes: one value a frame and axis.

Three methods, of which an encoder takes the cheapest. Motion without a rhythm, jumps and starts included, is followed
in time: each number is predicted from the four frames before it, by weights that encoder and decoder learn alike.
Motion that swings or repeats itself is transformed by cosines. Motion between keyframes is a row of straight lines:
changes of speed, nearly all of them zero. Each way whole numbers are left, small for the most part, and coded by the
sizes of their neighbours: in time (or frequency), among axes, among modes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from pdecodec.basis import series_functions
from pdecodec.errors import CorruptFileError, SettingsError

Float64Array = NDArray[np.float64]
Int64Array = NDArray[np.int64]

FOLLOWED, TRANSFORMED, STRAIGHT = 0, 1, 2
"""The first byte: which method."""

LONGEST_TRANSFORM = 1024
"""Frames beyond which modes are not transformed: a decoder's work grows with their square."""

MOST_STEPS = 2.0**30
"""Largest magnitude of a number, in steps. float32 itself is coarser than that."""

ROUNDING = 0.4
"""Added to a magnitude in steps before its fraction is dropped. At equal error, 0.5 takes 3 % more bytes and above at
one bit a number, about as many at four; 0.33 takes 2 % more at any rate."""

MOST_TURNS = 1.0 / 3.0
"""Share of the numbers that may change the speed; where more do, straight lines are no candidate."""

BITS_OF_AN_ERROR = 6.0 / math.log(2.0)
"""Bits that a squared error of step^2 is worth: the error of a number, step^2 / 12, falls to a quarter with each bit,
which is a slope of step^2 / 12 * 2 ln 2."""

FIRST_BYTES = 64
"""Room for the first try at encoding, besides two bytes a number."""


@dataclass(frozen=True, eq=False)
class QuantisedModes:
    """Modes as they will be coded.

    Attributes
    ----------
    method : int
    levels : (count, frames, axes) int64
    decoded : (frames, axes, count) float64
        What :func:`decode_modes` gives, to the last bit.
    bits : float
        Of :meth:`to_bytes`, measured, to a byte or two.
    """

    method: int
    levels: Int64Array
    decoded: Float64Array
    bits: float

    def to_bytes(self) -> bytes:
        """The modes as bytes; empty where all levels are zero."""
        from pdecodec.kernels.modes import code_levels, new_model
        from pdecodec.kernels.rangecoder import ENCODE, finish, new_coder

        if not self.levels.any():
            return b""
        room = FIRST_BYTES + 2 * self.levels.size
        while True:
            data = np.zeros(room, np.uint8)
            coder = new_coder(ENCODE)
            code_levels(coder, data, self.levels, *new_model(self.levels.shape[1]))
            size = int(finish(coder, data))
            if size <= room:
                return bytes([self.method]) + data[:size].tobytes()
            room = size


def quantise_modes(scaled: Float64Array, step: float) -> QuantisedModes:
    """Quantise modes, by the method that takes fewest bits for its error.

    Parameters
    ----------
    scaled : (frames, axes, count) float64
        Axes 3, or 1 where all three move alike.
        Trajectories by falling energy, each times its singular value; finite.
    step : float
        Quantisation step, in the same unit. The mean squared error comes out near step^2 / 12, or below where
        little moves.

    Raises
    ------
    SettingsError
        If the step is not positive, or so small that numbers exceed 2^30 steps.
    """

    def cost(item: QuantisedModes) -> float:
        error = (item.decoded - scaled) / step
        return item.bits + BITS_OF_AN_ERROR * float(np.einsum("tak,tak->", error, error))

    return min(quantised_by_each_method(scaled, step), key=cost)


def quantised_by_each_method(scaled: Float64Array, step: float) -> list[QuantisedModes]:
    """Modes by every method that can be; see :func:`quantise_modes`."""
    if not 0.0 < step < math.inf:
        raise SettingsError(f"the step of modes must be a positive number, not {step}")
    frames = scaled.shape[0]
    with np.errstate(over="ignore"):
        wanted = np.ascontiguousarray(scaled.transpose(2, 0, 1)) / step
    if not np.all(np.abs(wanted) <= MOST_STEPS):
        raise SettingsError(f"modes go beyond 2^30 steps of {step}; take a larger tolerance")
    levels = np.zeros(wanted.shape, np.int64)
    found = [_measured(FOLLOWED, levels, _follow(levels, step, wanted))]
    if 0 < frames <= LONGEST_TRANSFORM:
        levels = _transform(wanted)
        found.append(_measured(TRANSFORMED, levels, _transform_back(levels, step)))
    if frames > 0:
        levels = _straight_runs(wanted)
        if np.count_nonzero(levels) <= MOST_TURNS * levels.size:
            found.append(_measured(STRAIGHT, levels, _along_straight_runs(levels, step)))
    return found


def decode_modes(data: bytes, frames: int, count: int, step: float, *, axes: int = 3) -> Float64Array:
    """Undo :meth:`QuantisedModes.to_bytes`.

    Parameters
    ----------
    data : bytes
    frames, count : int
        0 or more; memory and time are bounded by their product, which the caller has held against its limits.
    step : float
        That of the encoder.
    axes : int
        3, or 1 where all three move alike.

    Returns
    -------
    (frames, axes, count) float64
        Finite for every step below 2^900.

    Raises
    ------
    CorruptFileError
        If the method is unknown or cannot be, or bytes are left over or missing. Other damage gives other modes.
    """
    from pdecodec.kernels.modes import code_levels, new_model
    from pdecodec.kernels.rangecoder import is_finished, new_decoder

    if not data:
        return np.zeros((frames, axes, count))
    if frames * count == 0:
        raise CorruptFileError(f"{len(data)} bytes of modes stand where there are none; get the file again")
    method = data[0]
    if method not in (FOLLOWED, TRANSFORMED, STRAIGHT):
        raise CorruptFileError(f"modes are coded by an unknown method, {method}; get the file again")
    if method == TRANSFORMED and frames > LONGEST_TRANSFORM:
        raise CorruptFileError(f"{frames} frames of modes are transformed at once; get the file again")
    levels = np.zeros((count, frames, axes), np.int64)
    coded = np.frombuffer(data, np.uint8)[1:].copy()  # the compiled coder takes no read-only array
    coder = new_decoder(coded)
    code_levels(coder, coded, levels, *new_model(frames))
    if not is_finished(coder, coded):
        raise CorruptFileError("section TIME does not end where its modes do; get the file again")
    decode = {FOLLOWED: _follow, TRANSFORMED: _transform_back, STRAIGHT: _along_straight_runs}[method]
    return decode(levels, step)


def _measured(method: int, levels: Int64Array, decoded: Float64Array) -> QuantisedModes:
    from pdecodec.kernels.modes import code_levels, new_model
    from pdecodec.kernels.rangecoder import COST, COST_BITS, MEASURE, new_coder

    bits = 0.0
    if levels.any():
        coder = new_coder(MEASURE)
        code_levels(coder, np.zeros(1, np.uint8), levels, *new_model(levels.shape[1]))
        bits = 8.0 + float(coder[COST]) / 2.0**COST_BITS
    return QuantisedModes(method, levels, decoded, bits)


def _follow(levels: Int64Array, step: float, wanted: Float64Array | None = None) -> Float64Array:
    """Modes from their levels by the method FOLLOWED; given what is wanted, in steps, levels are written first."""
    from pdecodec.kernels.modes import ORDER, follow_modes

    values = np.empty(levels.shape)
    scratch = np.empty(ORDER), np.empty((ORDER, ORDER)), np.empty(ORDER), np.empty(ORDER)
    follow_modes(levels, values, values if wanted is None else wanted, wanted is not None, ROUNDING, *scratch)
    return np.ascontiguousarray(values.transpose(1, 2, 0)) * step


def _transform(wanted: Float64Array) -> Int64Array:
    """Levels by the method TRANSFORMED of what is wanted, in steps."""
    from scipy.fft import dct

    waves = dct(wanted, axis=1, norm="ortho")
    levels: Int64Array = np.copysign(np.floor(np.abs(waves) + ROUNDING), waves).astype(np.int64)
    return levels


def _transform_back(levels: Int64Array, step: float) -> Float64Array:
    """Modes from their levels by the method TRANSFORMED."""
    from pdecodec.kernels.modes import sum_cosines

    count, frames, axes = levels.shape
    values = np.zeros((count, axes, frames))
    sum_cosines(levels, cosine_wave(frames), np.empty(frames), values)
    return np.ascontiguousarray(values.transpose(2, 1, 0)) * step


def _straight_runs(wanted: Float64Array) -> Int64Array:
    """Levels by the method STRAIGHT of what is wanted, in steps."""
    from pdecodec.kernels.modes import find_straight_runs

    levels = np.empty(wanted.shape, np.int64)
    find_straight_runs(levels, wanted, 1.0 - ROUNDING)
    return levels


def _along_straight_runs(levels: Int64Array, step: float) -> Float64Array:
    """Modes from their levels by the method STRAIGHT: the first value, then sums of sums, wrapping at 64 bits."""
    from pdecodec.kernels.modes import STRAIGHT_UNITS

    speeds = levels.copy()
    speeds[:, 1:] = np.cumsum(levels[:, 1:], axis=1)
    values = np.cumsum(speeds, axis=1)
    modes: Float64Array = np.ascontiguousarray(values.transpose(1, 2, 0), np.float64) * (step / STRAIGHT_UNITS)
    return modes


def cosine_wave(frames: int) -> Float64Array:
    """One period of the cosine in 4 `frames` samples, the same bits on every machine.

    Of the series functions of order 4 at rate 1, ``cos x = phi_0(x) - phi_2(x)``.

    Parameters
    ----------
    frames : int
        1 or more.

    Returns
    -------
    (4 frames,) float64
        ``cos(2 pi j / (4 frames))``, within 2^-51.
    """
    series = series_functions(np.arange(frames + 1) * (np.pi / (2 * frames)), 1.0, 4)
    quarter = series[:, 0] - series[:, 2]
    half = np.concatenate([quarter, -quarter[-2::-1]])
    return np.concatenate([half, half[-2:0:-1]])
