"""Presets: names for purposes of a file, each with a tolerance and an effort."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Literal, get_args

from pdecodec.codec.coded_order import CodedOrderSequence
from pdecodec.codec.opening import open_animation
from pdecodec.codec.rate_control import RateLimit
from pdecodec.codec.settings import DEFAULT_TOLERANCE, EffortName, EncodeSettings
from pdecodec.errors import SettingsError
from pdecodec.mesh.runs import changed
from pdecodec.mesh.sequence import MeshSequence, Progress
from pdecodec.system.arguments import shown

PresetName = Literal["preview", "default", "hero", "archive"]

HERO_CLOSE = 0.05
"""Share of the limit on normals that may stay unused: a tenth of a degree, which is invisible."""


@dataclass(frozen=True, kw_only=True)
class Preset:
    """Settings of a preset.

    Attributes
    ----------
    tolerance : float or None
        As in :class:`EncodeSettings`.
    effort : {"fast", "default", "best"}
    normal_angle : float or None [degrees]
        Largest angle by which 99 % of the normals may be off; a tolerance that keeps it is searched, up to `tolerance`.
    """

    tolerance: float | None = None
    effort: EffortName = "default"
    normal_angle: float | None = None


PRESETS: dict[PresetName, Preset] = {
    # Five pixels for a mesh that fills a picture of 1000 pixels: enough to judge timing and poses.
    "preview": Preset(tolerance=5e-3, effort="fast"),
    "default": Preset(),
    # Shading shows errors of normals; to keep these small, cloth and fine meshes need a finer tolerance than coarse
    # meshes.
    "hero": Preset(tolerance=DEFAULT_TOLERANCE, normal_angle=2.0),
    # A tenth of a pixel in a picture 8192 pixels wide, and a fifth of the resolution of float16 at half of its range
    # (2^-12 / 5).
    "archive": Preset(tolerance=1e-5, effort="best"),
}


def preset_named(name: str | None) -> Preset:
    """Return a preset, the default one if there is no name; SettingsError if there is no such preset."""
    known = get_args(PresetName)
    if name is not None and (not isinstance(name, str) or name not in known):
        raise SettingsError(f"must be one of {', '.join(known)}, not {shown(name)}", setting="preset")
    return PRESETS["default" if name is None else name]  # type: ignore[index]


def with_preset(settings: EncodeSettings, name: str | None, *, keeps_effort: bool) -> EncodeSettings:
    """Return settings with the bound of a preset and, unless `keeps_effort`, its effort.

    Raises
    ------
    SettingsError
        If there is no such preset, or the profile is not "auto".
    """
    preset = preset_named(name)
    if name is None:
        return settings
    if settings.profile != "auto":
        message = f"is a setting of the profile auto, not of {settings.profile}"
        raise SettingsError(message, code="setting-unsupported", setting="preset")
    effort = settings.effort if keeps_effort or settings.effort != PRESETS["default"].effort else preset.effort
    return replace(settings, tolerance=None if preset.normal_angle else preset.tolerance, effort=effort)


def normal_limit(sequence: MeshSequence, preset: Preset) -> RateLimit | None:
    """Return the limit on normals that a preset sets; None if it sets none.

    Raises
    ------
    SettingsError
        If the sequence has no faces.
    """
    if preset.normal_angle is None or preset.tolerance is None:
        return None
    if not any(run.connectivity.face_count for run in sequence.runs):
        message = "hero limits the error of normals, and this clip has no faces; give a tolerance instead"
        raise SettingsError(message, code="setting-unsupported", setting="preset")
    angle = preset.normal_angle
    return RateLimit(
        value=angle,
        measure=lambda report: report.normal_p99 or 0.0,
        falls=False,
        start=preset.tolerance,
        coarsest=preset.tolerance,
        close=HERO_CLOSE,
        refusal=lambda least: (
            f"no tolerance keeps 99 % of the normals within {angle:g} degrees: the smallest reached is {least:.3g}; "
            "give a tolerance instead"
        ),
    )


def normals_measured(sequence: MeshSequence, *, is_free: bool) -> Callable[[bytes, Progress | None], float | None]:
    """Return a function that takes a file's bytes, decodes the file and returns the result of
    :func:`measure_corner_normals`.

    Parameters
    ----------
    sequence : MeshSequence
    is_free : bool
        Whether the file was encoded with ``order="free"``, so that its vertices are in the coded order.
    """
    reference = changed(sequence, CodedOrderSequence) if is_free else sequence

    def measure(data: bytes, progress: Progress | None) -> float | None:
        # Needs scipy, which programs that bundle the library do without.
        from pdecodec.mesh.surface_metrics import measure_corner_normals

        with open_animation(data) as decoded:
            return measure_corner_normals(reference, decoded, progress)

    return measure
