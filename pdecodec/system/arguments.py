"""Arguments of callers: check numbers, lists of numbers and paths; a SettingsError names the setting in one line."""

from __future__ import annotations

import math
import os
from numbers import Integral, Real
from pathlib import Path
from typing import TYPE_CHECKING, Any

from pdecodec.errors import SettingsError

if TYPE_CHECKING:
    from numpy.typing import ArrayLike, NDArray

LONGEST_SHOWN = 80
"""Largest number of characters of a value in an error message."""


def shown(value: object) -> str:
    """Return a value as error messages show it: in one line, shortened."""
    try:
        text = " ".join(repr(value).split())
    except ValueError:  # Python refuses to print an integer of thousands of digits.
        return "a number of thousands of digits"
    return text if len(text) <= LONGEST_SHOWN else f"{text[:LONGEST_SHOWN]}..."


def as_number(value: Any, setting: str) -> float:
    """Return a number as a float, infinity and NaN included; SettingsError for text and anything else."""
    if not isinstance(value, Real) and getattr(value, "shape", None) != ():
        raise SettingsError(f"must be a number, not {shown(value)}", setting=setting)
    try:
        return float(value)
    except OverflowError as error:
        raise SettingsError("must be below 2^1024", setting=setting) from error
    except (TypeError, ValueError) as error:  # for example for an array that holds one string
        raise SettingsError(f"must be a number, not {shown(value)}", setting=setting) from error


def as_positive(value: Any, setting: str) -> float:
    """Return a positive and finite number as a float; SettingsError for anything else."""
    number = as_number(value, setting)
    if not 0 < number < float("inf"):
        raise SettingsError(f"must be a positive number, not {shown(value)}", setting=setting)
    return number


def as_integer(value: Any, setting: str, least: float = -math.inf, most: float = math.inf) -> int:
    """Return a whole number from `least` to `most`; SettingsError for anything else."""
    if not isinstance(value, Integral):
        raise SettingsError(f"must be a whole number, not {shown(value)}", setting=setting)
    if not least <= int(value) <= most:
        raise SettingsError(f"must be from {least} to {most}, not {shown(value)}", setting=setting)
    return int(value)


def as_numbers(values: ArrayLike, setting: str) -> NDArray[Any]:
    """Return numbers as a float64 array of their shape; SettingsError for text and anything else."""
    import numpy as np

    try:
        array = np.asarray(values)
        if array.dtype.kind in "fiub":
            return np.asarray(array, np.float64)
        # NumPy would read text as numbers and None as NaN; numbers beyond 64 bits become objects.
        if array.dtype.kind == "O" and all(isinstance(one, Real) for one in array.flat):
            return array.astype(np.float64)
    except (TypeError, ValueError, OverflowError):
        pass
    raise SettingsError(f"must be a number or a list of numbers, not {shown(values)}", setting=setting)


def as_path(value: Any, setting: str = "path") -> Path:
    """Return a path of text, bytes or a path object; SettingsError for anything else."""
    if not isinstance(value, str | bytes | os.PathLike):
        raise SettingsError(f"must be a path, not {shown(value)}", setting=setting)
    return Path(os.fsdecode(value))
