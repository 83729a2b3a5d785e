"""Integers as compiled code should see them."""

from __future__ import annotations

from typing import Any

import numpy as np

wide: Any = np.int64
"""Around first values and constants: a plain 0 is a type of its own to numba, and whatever it is passed to is compiled
once more for it."""

unsigned: Any = np.uint64
"""Around indices that are never negative: numba lets others count from the end, and looks each time."""
