"""Settings of an encode: a frozen dataclass that goes to JSON and comes back equal; the file records it."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass, fields
from numbers import Integral, Real
from typing import Any, Literal, get_args

from pdecodec.basis import MAX_RATE
from pdecodec.errors import SettingsError

Profile = Literal["auto", "segments", "paper"]
Alignment = Literal["auto", "none", "affine", "rotation"]

DEFAULT_TOLERANCE = 1e-3
"""A thousandth of frame 0's diagonal: below what is seen on a full-frame character."""

SMALLEST_BOUND = 2.0**-150
"""Half the least distance of two float32 that differ: a smaller bound asks for nothing more."""

LARGEST_BOUND = 2.0**130
"""Farther than any two float32 positions lie apart: a larger bound allows nothing more."""

MAX_SEGMENT_FRAMES = 64
"""Longest time segment: four functions carry no more, and an encoder holds one segment in memory."""

PAPER_SEGMENT_FRAMES = 11
"""Frames 0 to 10, the window of the paper's section 5."""

MAX_EFFORT = 9


@dataclass(frozen=True, kw_only=True)
class EncodeSettings:
    """How to encode.

    Parameters
    ----------
    tolerance : float or None
        Largest Euclidean vertex distance at the input's frames, over the diagonal of frame 0's bounding box.
        None: 1e-3; under profile "paper" no bound, the model alone without corrections.
    max_error : float or None [scene units]
        The same bound in scene units; instead of `tolerance`.
    profile : {"auto", "segments", "paper"}
        "auto": modes, shapes or cosines over groups of frames, on patches or curves: what costs least.
        "segments": the paper's functions in closed form (Fang et al. 2024, Eq. 18), on curve pieces and time
        segments as long as the bound allows.
        "paper": the same on whole curves over fixed segments: 32 functions.
    alignment : {"auto", "none", "affine", "rotation"}
        Transformation elimination (Eqs. 19 to 23): none, as four affine functions of the rest shape, or as
        a rotation and a translation of each curve piece. "auto" measures; under "paper" the affine ones are left out.
    segment_frames : int or None
        Frames of a time segment, 2 to 64; None lets the motion decide ("paper": 11, as in its section 5).
    piece_points : int or None
        Points of a curve piece, 2 or more, rounded to the next length the format knows; None lets the motion
        decide ("paper": the whole curve).
    alpha : float or None
        Rate of the time functions (Eq. 12) over half a segment, 0 to 12; None chooses it by error, segment by
        segment.
    r : float or None
        Rate of the space functions (Eqs. 14, 16) over half a piece, 0 to 12; None chooses it by error.
    effort : int
        1 (quick) to 9 (thorough): how many alternatives the encoder measures.

    Raises
    ------
    SettingsError
        If a value is out of range or two contradict each other.
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

    def __post_init__(self) -> None:
        if self.tolerance is not None and self.max_error is not None:
            raise SettingsError("give a tolerance or a maximum error, not both")
        for name in ("segment_frames", "piece_points", "effort"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Integral):
                raise SettingsError(f"{name} must be a whole number, not {value!r}")
        for name in ("tolerance", "max_error", "alpha", "r"):
            value = getattr(self, name)
            if value is not None and not isinstance(value, Real):
                raise SettingsError(f"{name} must be a number, not {value!r}")
        for name in ("tolerance", "max_error"):
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingsError(f"{name} must be a positive number, not {value}")
        for name, known in (("profile", get_args(Profile)), ("alignment", get_args(Alignment))):
            if getattr(self, name) not in known:
                raise SettingsError(f"{name} must be one of {', '.join(known)}, not {getattr(self, name)!r}")
        for name, least, most in (
            ("segment_frames", 2, MAX_SEGMENT_FRAMES),
            ("piece_points", 2, None),
            ("alpha", 0, MAX_RATE),
            ("r", 0, MAX_RATE),
            ("effort", 1, MAX_EFFORT),
        ):
            value = getattr(self, name)
            if value is not None and not (least <= value and (most is None or value <= most)):
                limits = f"at least {least}" if most is None else f"from {least} to {most:g}"
                raise SettingsError(f"{name} must be {limits}, not {value}")

        if self.profile == "auto":
            for name in ("segment_frames", "piece_points", "alpha", "r"):
                if getattr(self, name) is not None:
                    raise SettingsError(f"{name} is a setting of the profiles segments and paper; take one of them")
            if self.alignment != "auto":
                raise SettingsError("alignment is a setting of the profiles segments and paper; take one of them")
        if self.profile == "paper" and self.alignment == "affine":
            raise SettingsError("the paper's profile has no affine functions; take alignment none or rotation")

    def bound(self, scale: float) -> float | None:
        """The largest distance allowed, in scene units; None where there is no bound.

        Parameters
        ----------
        scale : float [scene units]
            What tolerances are relative to, :func:`pdecodec.metrics.frame_scale` of frame 0.
        """
        if self.max_error is not None:
            bound = self.max_error
        elif self.tolerance is not None:
            bound = self.tolerance * scale
        elif self.profile == "paper":
            return None
        else:
            bound = DEFAULT_TOLERANCE * scale
        return min(max(bound, SMALLEST_BOUND), LARGEST_BOUND)

    def to_json(self) -> dict[str, Any]:
        """As a JSON object; :meth:`from_json` brings it back equal."""
        return asdict(self)

    def changed(self) -> dict[str, Any]:
        """As :meth:`to_json`, without what is as it is by default."""
        usual = EncodeSettings().to_json()
        return {name: value for name, value in self.to_json().items() if value != usual[name]}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> EncodeSettings:
        """Undo :meth:`to_json`; names of later versions are passed over."""
        known = {item.name for item in fields(cls)}
        return cls(**{name: value for name, value in values.items() if name in known})
