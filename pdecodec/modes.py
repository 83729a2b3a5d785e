"""Bytes for the modes of the `modal` time basis: the principal trajectories of a group of frames.

Two methods, of which an encoder takes the cheaper. Motion without a rhythm, jumps and starts included, is followed
in time: each number is predicted from the four frames before it, by weights that encoder and decoder learn alike.
Motion that swings or repeats itself is transformed by cosines. Either way whole numbers of steps are left, small
for the most part, and coded by the sizes of their neighbours: in time (or frequency), among axes, among modes.
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

FOLLOWED, TRANSFORMED = 0, 1
"""The first byte: which method."""

LONGEST_TRANSFORM = 1024
"""Frames beyond which modes are not transformed: a decoder's work grows with their square."""

MOST_STEPS = 2.0**30
"""Largest magnitude of a number, in steps. float32 itself is coarser than that."""

ROUNDING = 0.4
"""Added to a magnitude in steps before its fraction is dropped. At equal error, 0.5 takes 3 % more bytes and above at
one bit a number, about as many at four; 0.33 takes 2 % more at any rate."""

BITS_OF_AN_ERROR = 6.0 / math.log(2.0)
"""Bits that a squared error of step^2 is worth: the error of a number, step^2 / 12, falls to a quarter with each bit,
which is a slope of step^2 / 12 * 2 ln 2."""

FIRST_BYTES = 64
"""Room for the first try at encoding, besides two bytes a number."""


@dataclass(frozen=True)
class _Coded:
    """Modes by one method: levels (count, frames, axes) int64 and what they decode to, (frames, axes, count)."""

    method: int
    levels: Int64Array
    decoded: Float64Array

    def cost(self, bits: float, scaled: Float64Array, step: float) -> float:
        """Bits, with the error in bits."""
        error = (self.decoded - scaled) / step
        return bits + BITS_OF_AN_ERROR * float(np.einsum("tak,tak->", error, error))


def encode_modes(scaled: Float64Array, step: float) -> tuple[bytes, Float64Array]:
    """Quantise modes and code them.

    Parameters
    ----------
    scaled : (frames, axes, count) float64
        Axes 3, or 1 where all three move alike.
        Trajectories by falling energy, each times its singular value; finite.
    step : float
        Quantisation step, in the same unit. The mean squared error comes out near step^2 / 12, or below where
        little moves.

    Returns
    -------
    data : bytes
        Empty where all that is left is zero.
    decoded : (frames, axes, count) float64
        What :func:`decode_modes` gives, to the last bit.

    Raises
    ------
    SettingsError
        If the step is not positive, or so small that numbers exceed 2^30 steps.
    """
    coded = [(_write(item.levels), item) for item in _candidates(scaled, step)]
    data, best = min(coded, key=lambda pair: pair[1].cost(8.0 * len(pair[0]), scaled, step))
    return (bytes([best.method]) + data if best.levels.any() else b""), best.decoded


def measure_modes(scaled: Float64Array, step: float) -> tuple[float, Float64Array]:
    """What :func:`encode_modes` would take in bits, to a byte or two, and what would come back.

    Parameters, results and errors are those of :func:`encode_modes`, bits in the place of bytes.
    """
    measured = [(_measure(item.levels), item) for item in _candidates(scaled, step)]
    bits, best = min(measured, key=lambda pair: pair[1].cost(pair[0], scaled, step))
    return (8.0 + bits if best.levels.any() else 0.0), best.decoded


def decode_modes(data: bytes, frames: int, count: int, step: float, *, axes: int = 3) -> Float64Array:
    """Undo :func:`encode_modes`.

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
    if method not in (FOLLOWED, TRANSFORMED):
        raise CorruptFileError(f"modes are coded by an unknown method, {method}; get the file again")
    if method == TRANSFORMED and frames > LONGEST_TRANSFORM:
        raise CorruptFileError(f"{frames} frames of modes are transformed at once; get the file again")
    levels = np.zeros((count, frames, axes), np.int64)
    coded = np.frombuffer(data, np.uint8)[1:].copy()  # the compiled coder takes no read-only array
    coder = new_decoder(coded)
    code_levels(coder, coded, levels, *new_model(frames))
    if not is_finished(coder, coded):
        raise CorruptFileError("section TIME does not end where its modes do; get the file again")
    return _follow(levels, step) if method == FOLLOWED else _transform_back(levels, step)


def _candidates(scaled: Float64Array, step: float) -> list[_Coded]:
    """The modes by every method that can be."""
    if not 0.0 < step < math.inf:
        raise SettingsError(f"the step of modes must be a positive number, not {step}")
    frames = scaled.shape[0]
    with np.errstate(over="ignore"):
        wanted = np.ascontiguousarray(scaled.transpose(2, 0, 1)) / step
    if not np.all(np.abs(wanted) <= MOST_STEPS):
        raise SettingsError(f"modes go beyond 2^30 steps of {step}; take a larger tolerance")
    levels = np.zeros(wanted.shape, np.int64)
    coded = [_Coded(FOLLOWED, levels, _follow(levels, step, wanted))]
    if 0 < frames <= LONGEST_TRANSFORM:
        levels = _transform(wanted)
        coded.append(_Coded(TRANSFORMED, levels, _transform_back(levels, step)))
    return coded


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


def _write(levels: Int64Array) -> bytes:
    """Levels as the range coder's bytes."""
    from pdecodec.kernels.modes import code_levels, new_model
    from pdecodec.kernels.rangecoder import ENCODE, finish, new_coder

    room = FIRST_BYTES + 2 * levels.size
    while True:
        data = np.zeros(room, np.uint8)
        coder = new_coder(ENCODE)
        code_levels(coder, data, levels, *new_model(levels.shape[1]))
        size = int(finish(coder, data))
        if size <= room:
            return data[:size].tobytes()
        room = size


def _measure(levels: Int64Array) -> float:
    """Bits that :func:`_write` would take."""
    from pdecodec.kernels.modes import code_levels, new_model
    from pdecodec.kernels.rangecoder import COST, COST_BITS, MEASURE, new_coder

    coder = new_coder(MEASURE)
    code_levels(coder, np.zeros(1, np.uint8), levels, *new_model(levels.shape[1]))
    return float(coder[COST]) / 2.0**COST_BITS
