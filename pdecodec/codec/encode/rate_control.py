"""Rate control: the tolerance is searched for, so that the file has a given size or a given mean error.

Every step of the search is a whole encode, since nothing short of it tells the size of a file;
:data:`MOST_ENCODES` of them at most.
"""

from __future__ import annotations

import math
import os
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from numbers import Integral, Real
from pathlib import Path
from typing import Any, TypeVar

from pdecodec.codec.encode.encoder import encode
from pdecodec.codec.encode.report import EncodeReport
from pdecodec.codec.settings import DEFAULT_TOLERANCE, EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.storage import is_address, remote_output
from pdecodec.system.whole_output import check_writable, whole_file

Outcome = TypeVar("Outcome")

FINEST = 1e-18
"""Finest tolerance tried: a float32 step of coordinates of a hundred-billionth of the diagonal. Clips come back exactly
long before it."""

COARSEST = 1.0
"""Coarsest tolerance tried: vertices may be anywhere in the scene."""

MOST_ENCODES = 10
"""Encodes at most: six to bracket the limit from anywhere in the range, four to close in on it."""

CLOSE = 0.01
"""A limit counts as met when it is kept and used up to this share, or the tolerance is known this well."""

FIRST_STRIDE = math.log(4.0)
"""First step away from a tolerance that misses the limit; each further one in the same direction is doubled."""

LEAST_MOVE = 0.1
"""Share of the bracket that an interpolated tolerance stays away from its ends, where it would not narrow it."""

TOLERANCE_OVER_RMS = 2.5
"""Where the search for a mean error starts: profile "auto" leaves 0.3 to 0.5 of its bound as mean error."""

SMALLEST_VALUE = 1e-300
"""In the place of an error of zero, which has no logarithm."""


@dataclass(frozen=True)
class _Limit:
    """What is held: a measure of a report and its largest value."""

    value: float
    measure: Callable[[EncodeReport], float]
    falls: bool
    start: float
    refusal: Callable[[float], str]
    """The message where no file keeps it, given the smallest value reached."""


def encode_to_size(
    sequence: MeshSequence,
    size: int,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> EncodeReport:
    """Encode at the finest tolerance whose file is no larger than a size.

    The tolerance taken has four digits and is in the file's settings: :func:`pdecodec.encode` with it gives the
    same bytes. Files are held in memory until the search is over.

    Parameters
    ----------
    sequence : MeshSequence
        Read once for every encode.
    size : int [bytes]
        Of the whole file, at most. It is used to 99 % where file sizes follow the tolerance that closely.
    path, settings, overwrite, progress, **options
        As :func:`pdecodec.encode` takes them, but for `tolerance` and `max_error`, which are what is searched.

    Returns
    -------
    EncodeReport
        Of the file taken; `seconds` are those of the whole search.

    Raises
    ------
    SettingsError
        If the coarsest tolerance's file is larger, the size is not a positive whole number, or settings are out
        of range, unknown, or bound the error as well.
    InputError
        As :func:`pdecodec.encode` raises it.
    """
    _check_positive("size", size, Integral, "whole number of bytes")
    limit = _Limit(
        value=float(size),
        measure=lambda report: float(report.file_bytes),
        falls=True,
        start=DEFAULT_TOLERANCE,
        refusal=lambda least: (
            f"no tolerance up to {COARSEST:g} gives a file of {size} bytes: the smallest takes {least:.0f}; "
            "allow as many, or encode less"
        ),
    )
    return _encode_within(limit, sequence, path, settings, options, overwrite=overwrite, progress=progress)


def encode_to_rms(
    sequence: MeshSequence,
    rms: float,
    path: str | os.PathLike[str] | None = None,
    settings: EncodeSettings | None = None,
    *,
    overwrite: bool = False,
    progress: Progress | None = None,
    **options: Any,
) -> EncodeReport:
    """Encode at the coarsest tolerance whose root mean square vertex distance is no larger than a limit.

    As :func:`encode_to_size` in all else.

    Parameters
    ----------
    sequence : MeshSequence
        Read once for every encode.
    rms : float
        Root of the mean square vertex distance over all frames, at most, over the diagonal of frame 0's bounding
        box as tolerances are.
    path, settings, overwrite, progress, **options
        As :func:`pdecodec.encode` takes them, but for `tolerance` and `max_error`, which are what is searched.

    Returns
    -------
    EncodeReport
        Of the file taken; `seconds` are those of the whole search.

    Raises
    ------
    SettingsError
        If the finest tolerance's error is larger, `rms` is not a positive number, or settings are out of range,
        unknown, or bound the error as well.
    InputError
        As :func:`pdecodec.encode` raises it.
    """
    _check_positive("rms", rms, Real, "number")
    limit = _Limit(
        value=float(rms),
        measure=lambda report: report.rms_error / report.scale,
        falls=False,
        start=TOLERANCE_OVER_RMS * rms,
        refusal=lambda least: (
            f"no tolerance down to {FINEST:g} gives an rms error of {rms:g} of the diagonal: the smallest is "
            f"{least:.3g}; allow as much"
        ),
    )
    return _encode_within(limit, sequence, path, settings, options, overwrite=overwrite, progress=progress)


def _check_positive(name: str, value: Any, kind: Any, noun: str) -> None:
    if not isinstance(value, kind) or not (math.isfinite(value) and value > 0):
        raise SettingsError(f"{name} must be a positive {noun}, not {value!r}")


def _encode_within(
    limit: _Limit,
    sequence: MeshSequence,
    path: str | os.PathLike[str] | None,
    settings: EncodeSettings | None,
    options: dict[str, Any],
    *,
    overwrite: bool,
    progress: Progress | None,
) -> EncodeReport:
    given = settings or EncodeSettings()
    if any(options.get(name, getattr(given, name)) is not None for name in ("tolerance", "max_error")):
        raise SettingsError("give one of a tolerance, a maximum error, an rms error and a size, not several")
    if path is not None and is_address(path):
        with remote_output(str(path), overwrite=overwrite) as local:
            report = _encode_within(limit, sequence, local, settings, options, overwrite=overwrite, progress=progress)
            return replace(report, path=str(path))
    target = None if path is None else Path(path)
    if target is not None:
        check_writable(target, overwrite=overwrite)
    started = time.perf_counter()
    values: list[float] = []

    def encode_at(tolerance: float) -> tuple[EncodeReport, float]:
        said = _numbered(progress, len(values) + 1)
        report = encode(sequence, None, settings, progress=said, **{**options, "tolerance": tolerance})
        values.append(limit.measure(report))
        return report, values[-1] / limit.value

    found = search_tolerance(
        encode_at, start=limit.start, falls=limit.falls, is_exact=lambda report: report.max_error == 0
    )
    if found is None:
        raise SettingsError(limit.refusal(min(values)))
    if target is not None:
        assert found.data is not None  # encoded without a path
        with whole_file(target, overwrite=overwrite) as partial:
            partial.write_bytes(found.data)
        found = replace(found, path=target, data=None)
    return replace(found, seconds=time.perf_counter() - started)


def search_tolerance(
    measure: Callable[[float], tuple[Outcome, float]],
    *,
    start: float,
    falls: bool,
    is_exact: Callable[[Outcome], bool] = lambda _: False,
) -> Outcome | None:
    """The outcome nearest to a limit among those that keep it, in :data:`MOST_ENCODES` measurements at most.

    Brackets the limit in growing strides, then interpolates on logarithmic scales, where size and error are
    nearly straight lines over the tolerance, and bisects where that narrows too little.

    Parameters
    ----------
    measure : callable
        Takes a tolerance; gives an outcome, and its value over the limit.
    start : float
        First tolerance, brought into the range.
    falls : bool
        Whether the value falls as the tolerance grows: bytes do, errors do not.
    is_exact : callable, optional
        Whether an outcome has no error, so that nothing is gained by a finer tolerance.

    Returns
    -------
    outcome or None
        None where no tolerance from :data:`FINEST` to :data:`COARSEST` keeps the limit.
    """
    ends = math.log(FINEST), math.log(COARSEST)
    at = min(max(math.log(start), ends[0]), ends[1])
    stride = FIRST_STRIDE
    best: Outcome | None = None
    fine: tuple[float, float] | None = None
    coarse: tuple[float, float] | None = None
    last_width = math.inf
    for _ in range(MOST_ENCODES):
        outcome, share = measure(float(f"{math.exp(at):.4g}"))
        excess = math.log(max(share, SMALLEST_VALUE))
        if excess <= 0.0:
            best = outcome
            if excess > -CLOSE or (falls and is_exact(outcome)):
                break
        is_too_fine = (excess > 0.0) == falls
        if is_too_fine:
            fine = (at, excess)
        else:
            coarse = (at, excess)
        if fine is not None and coarse is not None:
            width = coarse[0] - fine[0]
            if width < CLOSE:
                break
            at = 0.5 * (fine[0] + coarse[0]) if width > 0.5 * last_width else _interpolated(fine, coarse)
            last_width = width
        else:
            if at == ends[is_too_fine]:
                break
            at = min(max(at + (stride if is_too_fine else -stride), ends[0]), ends[1])
            stride *= 2.0
    return best


def _interpolated(fine: tuple[float, float], coarse: tuple[float, float]) -> float:
    """Where the line through two (log tolerance, log value over limit) passes just under the limit."""
    share = (fine[1] + 0.5 * CLOSE) / (fine[1] - coarse[1])
    return fine[0] + min(max(share, LEAST_MOVE), 1.0 - LEAST_MOVE) * (coarse[0] - fine[0])


def _numbered(progress: Progress | None, attempt: int) -> Progress | None:
    """The same progress, saying which encode it is."""
    if progress is None:
        return None
    return lambda done, total, what: progress(done, total, f"{what}, attempt {attempt}")
