"""Settings of an encode: a frozen dataclass that converts to JSON and back unchanged; the file records it."""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, fields
from numbers import Integral, Real
from typing import Any, Literal, TypedDict, get_args

import numpy as np

from pdecodec.codec.sections.closed_form import MAX_RATE
from pdecodec.errors import SettingsError
from pdecodec.system.arguments import as_integer, shown

Profile = Literal["auto", "paper"]
Order = Literal["keep", "free"]
SceneChoice = Literal["keep", "drop"]
EffortName = Literal["fast", "default", "best"]

DEFAULT_FIELD_TOLERANCE = 1e-3
"""Default tolerance of fields, as a fraction of the range of a field."""

DEFAULT_TOLERANCE = 1e-3
"""Default tolerance, as a fraction of frame 0's diagonal: invisible on a character that fills the picture."""

SMALLEST_BOUND = 2.0**-150
"""Half the smallest difference of two float32 numbers; a smaller bound has the same effect."""

LARGEST_BOUND = 2.0**130
"""More than the largest distance of two float32 positions; a larger bound has the same effect."""

MAX_SEGMENT_FRAMES = 64
"""Largest number of frames of a group in closed form: its four functions cannot describe more."""

PAPER_SEGMENT_FRAMES = 11
"""Number of frames from 0 to 10, the window of the paper's section 5."""


BYTE_POWERS = {"": 0, "K": 1, "M": 2, "G": 3, "T": 4}


def parse_fraction(text: str) -> float:
    """Return the value of a number or a percentage, ``0.001`` or ``0.1%``; ValueError if the text is neither."""
    number = text.strip()
    return float(number[:-1]) / 100.0 if number.endswith("%") else float(number)


def parse_byte_count(text: str) -> int:
    """Return the number of bytes that a text states, ``800000000``, ``200kB`` or ``1.5GiB``; ValueError if it is
    invalid.

    Units are those of coreutils: kB, MB, GB, TB are decimal; K, M, G, T and KiB, MiB, GiB, TiB binary.
    """
    found = re.fullmatch(r"(\d+(?:\.\d+)?)\s*([KMGT]?)(|B|iB)", text.strip(), re.IGNORECASE)
    if found is None:
        raise ValueError(f"{text!r} is not a number of bytes such as 800M or 1.5G")
    base = 1000 if found[3].upper() == "B" else 1024
    return int(float(found[1]) * base ** BYTE_POWERS[found[2].upper()])


_CHOICES: tuple[tuple[str, Any], ...] = (
    ("profile", Profile),
    ("order", Order),
    ("effort", EffortName),
    ("scene", SceneChoice),
)
"""Settings whose value is one of several words, and these words."""


@dataclass(frozen=True, kw_only=True)
class PaperSettings:
    """Settings of the profile "paper" alone: the model of Fang et al. 2024, section 4.

    Parameters
    ----------
    segment_frames : int
        Frames of a time segment, 2 to 64; 11 in the paper's section 5.
    piece_points : int or None
        About as many points in each curve piece, 2 to 65535; None: whole curves.
    alpha : float or None
        Rate of the time functions (Eq. 12) over half a segment, above 0 and at most 12; None chooses it by error,
        segment by segment.
    r : float or None
        Rate of the space functions (Eqs. 14, 16) over half a piece, likewise; None chooses it by error.

    Raises
    ------
    SettingsError
        If a value is out of range.
    """

    segment_frames: int = PAPER_SEGMENT_FRAMES
    piece_points: int | None = None
    alpha: float | None = None
    r: float | None = None

    def __post_init__(self) -> None:
        _convert_numbers(self, ("segment_frames", "piece_points"), int, Integral, "a whole number")
        _convert_numbers(self, ("alpha", "r"), float, Real, "a number")
        as_integer(self.segment_frames, "segment_frames", 2, MAX_SEGMENT_FRAMES)
        if self.piece_points is not None and self.piece_points < 2:
            raise SettingsError(f"must be at least 2, not {shown(self.piece_points)}", setting="piece_points")
        for name in ("alpha", "r"):
            value = getattr(self, name)
            if value is not None and not 0 < value <= MAX_RATE:
                raise SettingsError(f"must be above 0 and at most {MAX_RATE:g}, not {value}", setting=name)


def _convert_numbers(settings: object, names: tuple[str, ...], kind: type, taken: type, what: str) -> None:
    """Convert numbers of other libraries to Python's own, because the file records settings as JSON."""
    for name in names:
        value = getattr(settings, name)
        if value is None:
            continue
        if not isinstance(value, kind | taken):
            raise SettingsError(f"must be {what}, not {shown(value)}", setting=name)
        try:
            object.__setattr__(settings, name, kind(value))
        except OverflowError as error:
            raise SettingsError("must be below 2^1024", setting=name) from error


@dataclass(frozen=True, kw_only=True)
class EncodeSettings:
    """Settings of an encode.

    Parameters
    ----------
    tolerance : float or None
        Largest Euclidean vertex distance at the input's frames, over the diagonal of frame 0's bounding box.
        None: 1e-3; with profile "paper" there is then no bound, and no residuals correct the model.
    max_error : float or None [scene units]
        The same bound in scene units; instead of `tolerance`.
    profile : {"auto", "paper"}
        "auto": trajectories, shapes or cosines over groups of frames, on patches or curves, whichever cost least.
        "paper": the functions of Fang et al. 2024 (Eq. 18) in closed form, 32 coefficients for each curve, axis and
        segment of time.
    effort : {"fast", "default", "best"}
        How many candidates the encoder of profile "auto" compares (:data:`pdecodec.codec.encode.tuning.TUNINGS`).
    group_frames : int or None
        Largest number of frames of a group, from 2 on, with profile "auto"; None: as many as memory allows. Cutting a
        file, and reading parts of a remote one, works in whole groups; short groups cost bytes.
    max_memory : int or None [bytes]
        Approximate memory that encoding may take, interpreter included, with profile "auto": groups of frames become
        shorter until they fit, which costs bytes. None: the memory for groups of usual length.
    uv_tolerance : float or None
        Largest error of texture coordinates on each axis, in units of the texture; None keeps them to the last bit.
    field_tolerance : float
        Largest error of a value of a field, over the field's range (:class:`pdecodec.Field`). Whole numbers and flags
        are exact.
    fields : mapping of str to float or str
        For a field by its name: another tolerance, an error in the field's units (``"0.5 units"``), ``"exact"``, or
        ``"drop"`` to leave it out; UVs and colours then stay as in the first frame.
    order : {"keep", "free"}
        Whether to keep the order of vertices, faces and their first corners, or to decode them in an order that takes
        no bytes.
    scene : {"keep", "drop"}
        Whether the file carries the scene around the motion (cameras, materials, textures, custom data) if the source's
        format supports it; decoding to that format restores the scene.
    why : bool
        Record in the file's remarks which alternatives were tried, and what they would have cost. Not recorded for
        files of several runs, because each run makes its own choices.
    paper : PaperSettings
        Settings of profile "paper".

    Raises
    ------
    SettingsError
        If a value is out of range or two contradict each other.
    """

    tolerance: float | None = None
    max_error: float | None = None
    profile: Profile = "auto"
    effort: EffortName = "default"
    group_frames: int | None = None
    max_memory: int | None = None
    uv_tolerance: float | None = None
    field_tolerance: float = DEFAULT_FIELD_TOLERANCE
    fields: Mapping[str, float | str] = field(default_factory=dict)
    order: Order = "keep"
    scene: SceneChoice = "keep"
    why: bool = False
    paper: PaperSettings = field(default_factory=PaperSettings)

    def __post_init__(self) -> None:
        check_one_target({"tolerance": self.tolerance, "max_error": self.max_error})
        names = ("tolerance", "max_error", "uv_tolerance", "field_tolerance")
        _convert_numbers(self, names, float, Real, "a number")
        object.__setattr__(self, "fields", _checked_fields(self.fields))
        _convert_numbers(self, ("why",), bool, np.bool_, "True or False")
        for name in names:
            value = getattr(self, name)
            if value is not None and not (math.isfinite(value) and value > 0):
                raise SettingsError(f"must be a positive number, not {value}", setting=name)
        _convert_numbers(self, ("group_frames", "max_memory"), int, Integral, "a whole number")
        if self.group_frames is not None and self.group_frames < 2:
            raise SettingsError(f"must be at least 2, not {shown(self.group_frames)}", setting="group_frames")
        for name, instead in (("group_frames", "is segment_frames"), ("max_memory", "takes short segments anyway")):
            if getattr(self, name) is not None and self.profile == "paper":
                message = f"is a setting of the profile auto; the paper's {instead}"
                raise SettingsError(message, code="setting-unsupported", setting=name)
        for name, kind in _CHOICES:
            known = get_args(kind)
            value = getattr(self, name)
            if not isinstance(value, str) or value not in known:
                raise SettingsError(f"must be one of {', '.join(known)}, not {shown(value)}", setting=name)
        if not isinstance(self.paper, PaperSettings):
            raise SettingsError(f"must be PaperSettings, not {shown(self.paper)}", setting="paper")
        if self.profile != "paper" and self.paper != PaperSettings():
            message = "segment_frames, piece_points, alpha and r are settings of the profile paper; choose that profile"
            raise SettingsError(message, code="setting-unsupported")

    def bound(self, scale: float) -> float | None:
        """The largest distance allowed, in scene units; None if there is no bound.

        Parameters
        ----------
        scale : float [scene units]
            Length that tolerances are relative to, :func:`pdecodec.mesh.metrics.frame_scale` of frame 0.
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
        """Return the settings as a JSON object; :meth:`from_json` restores them."""
        return asdict(self)

    def changed(self) -> dict[str, Any]:
        """Return the settings of :meth:`to_json` that differ from the defaults, without `scene`, which the file
        itself shows.
        """
        usual = EncodeSettings().to_json()
        return {name: value for name, value in self.to_json().items() if value != usual[name] and name != "scene"}

    @classmethod
    def from_json(cls, values: Mapping[str, Any]) -> EncodeSettings:
        """Undo :meth:`to_json`; names that are unknown here, because later versions added them, are ignored."""
        found = _known(cls, values)
        if "paper" in found:
            found["paper"] = PaperSettings(**_known(PaperSettings, found["paper"]))
        return cls(**found)


class EncodeOptions(TypedDict, total=False):
    """The fields of :class:`EncodeSettings` as keyword arguments."""

    tolerance: float | None
    max_error: float | None
    profile: Profile
    effort: EffortName
    group_frames: int | None
    max_memory: int | None
    uv_tolerance: float | None
    field_tolerance: float
    fields: Mapping[str, float | str]
    order: Order
    scene: SceneChoice
    why: bool
    paper: PaperSettings


EXACT, DROP, UNITS = "exact", "drop", "units"
"""Words for the ways in which a field is stored."""


def field_bound(asked: float | str, extent: float) -> float | None:
    """Return the largest error that a field's setting allows; None if values are exact.

    Parameters
    ----------
    asked : float or str
        The setting.
    extent : float
        Difference of the field's largest and smallest value.
    """
    if isinstance(asked, str):
        return None if asked == EXACT else float(asked.removesuffix(UNITS))
    return asked * extent


def parse_field_setting(text: str) -> float | str:
    """Parse the setting of a field: ``1e-4``, ``0.1%``, ``0.5 units``, ``exact`` or ``drop``; ValueError if it
    is none of these.
    """
    stripped = " ".join(text.split())
    if stripped in (EXACT, DROP):
        return stripped
    number = stripped.removesuffix(UNITS).strip()
    value = float(number) if number != stripped else parse_fraction(stripped)
    if not (math.isfinite(value) and value > 0):
        raise ValueError(f"{text!r} is not above 0")
    return value if number == stripped else f"{value!r} {UNITS}"


def parse_named_field_setting(text: str) -> tuple[str, float | str]:
    """Parse ``NAME=X`` into the name of a field and its setting, with X as in :func:`parse_field_setting`;
    ValueError if the text has another form.
    """
    name, _, asked = text.rpartition("=")
    if not name:
        raise ValueError("write NAME=X")
    return name, parse_field_setting(asked)


def _checked_fields(given: object) -> dict[str, float | str]:
    if not isinstance(given, Mapping):
        raise SettingsError(f"must be a mapping of names to tolerances, not {shown(given)}", setting="fields")
    found: dict[str, float | str] = {}
    for name, asked in given.items():
        try:
            found[str(name)] = parse_field_setting(asked if isinstance(asked, str) else repr(float(asked)))
        except (TypeError, ValueError):
            raise SettingsError(
                f"{name!r} must be a tolerance, '0.5 {UNITS}', '{EXACT}' or '{DROP}', not {shown(asked)}",
                setting="fields",
            ) from None
    return found


def check_one_target(targets: Mapping[str, object]) -> None:
    """Raise SettingsError if more than one target is given; the message names them."""
    given = [name for name, value in targets.items() if value is not None]
    if len(given) > 1:
        message = f"{' and '.join(given)} exclude each other; give one of them"
        raise SettingsError(message, code="conflicting-settings")


def _known(settings: type[EncodeSettings] | type[PaperSettings], values: Mapping[str, Any]) -> dict[str, Any]:
    return {item.name: values[item.name] for item in fields(settings) if item.name in values}
