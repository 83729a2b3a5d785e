"""Settings of an encode: a frozen dataclass that goes to JSON and comes back equal; the file records it."""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass, fields
from typing import Literal

from pdecodec.errors import SettingsError

Profile = Literal["auto", "paper"]
Alignment = Literal["auto", "none", "affine", "rotation"]

DEFAULT_TOLERANCE = 1e-3
"""A thousandth of frame 0's diagonal: below what is seen on a full-frame character."""

MAX_SEGMENT_FRAMES = 64
"""Longest time segment: four functions carry no more, and an encoder holds one segment in memory."""


@dataclass(frozen=True, kw_only=True)
class EncodeSettings:
    """How to encode.

    Parameters
    ----------
    tolerance : float or None
        Largest Euclidean vertex distance at the input's frames, over the diagonal of frame 0's bounding box.
        None sets no bound: the model alone, without corrections. Default 1e-3 (None under profile "paper").
    max_error : float or None [scene units]
        The same bound in scene units; overrides `tolerance`.
    profile : {"auto", "paper"}
        "paper": the paper's 32 functions on whole curves over fixed segments (Fang et al. 2024, Eq. 18).
        "auto": curve pieces and time segments as long as the bound allows.
    alignment : {"auto", "none", "affine", "rotation"}
        Transformation elimination (Eqs. 19 to 23): none, as four affine functions of the rest shape,
        or as a rotation and translation per curve piece. "auto" measures; "paper" means "rotation".
    segment_frames : int or None
        Frames of a time segment; None lets the motion decide ("paper": 11, as in the paper's section 5).
    piece_points : int or None
        Points of a curve piece; None lets the motion decide ("paper": the whole curve).
    alpha : float or None
        Rate of the time functions (Eq. 12) over half a segment; None chooses it by error, for each segment.
    r : float or None
        Rate of the space functions (Eqs. 14, 16) over half a piece; None chooses it by error.
    effort : int
        1 (quick) to 9 (thorough): how many alternatives the encoder measures.
    """

    tolerance: float | None = None
    max_error: float | None = None
    profile: Profile = "auto"
    alignment: Alignment = "auto"
    segment_frames: int | None = None
    piece_points: int | None = None
    alpha: float | None = None
    r: float | None = None
    effort: int = 5
