"""Limits of quantised numbers, which every part of the format keeps."""

from __future__ import annotations

LARGEST = 2**40
"""Largest magnitude of a quantised coefficient or residual."""

LARGEST_STEP = 2.0**160
"""Largest quantisation step: float32 positions end at 2^128, and products with it stay far from overflow."""
