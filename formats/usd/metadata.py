"""Convert names of prims and metadata of stages in both directions, including data that only pdecodec uses."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from pxr import Sdf, UsdGeom

from pdecodec.formats.base.scene_space import UNIT, UP_AXIS, unit_text
from pdecodec.formats.base.times import SAME_TIME
from pdecodec.mesh.arrays import Float64Array

OWN = "pdecodec"
"""Namespace of attributes that only pdecodec writes and reads."""

NAME, ADDED = f"{OWN}:name", f"{OWN}:added"
"""Custom data of a prim: the original name if USD could not hold it; whether the prim was added to the tree."""

UNIT_KEY, DTYPE_KEY = f"{OWN}:unit", f"{OWN}:dtype"
"""Custom data of a primvar: its unit and type as a field. The presence of a type marks the primvar as a field."""

METADATA = f"{OWN}Metadata"
"""Custom data of a layer: metadata that USD cannot hold."""

SAMPLED = f"{OWN}Sampled"
"""Custom data of a layer: whether every frame is a sample, so that motion between samples is linear."""

TIME_RANGE, TIME_CODE_RATE = "time_range", "time_codes_per_second"
"""Keys of metadata: first and last time [s] of a stage, if its frames do not span them, followed by the first
and last time of the frames; and its time codes per second, if they differ from its frames per second.
"""


def valid_name(step: str) -> str:
    """Return the prim name for a step of a path, as OpenUSD's importers make it.

    A name that begins with a digit gets an underscore before it, and each character that USD rejects becomes one.
    """
    found = "".join(one if Sdf.Path.IsValidIdentifier(f"_{one}") else "_" for one in step)
    return found if Sdf.Path.IsValidIdentifier(found) else f"_{found}"


def object_name(prim: Any, known: dict[Any, str] | None = None) -> str:
    """Return an object's path: names from the root, without a leading slash; `known` caches names."""
    known = {} if known is None else known
    unknown, name = [], ""
    while prim and not prim.IsPseudoRoot():
        if prim.GetPath() in known:
            name = known[prim.GetPath()]
            break
        unknown.append(prim)
        prim = prim.GetParent()
    for below in reversed(unknown):
        if not below.GetCustomDataByKey(ADDED):
            own = str(below.GetCustomDataByKey(NAME) or below.GetName())
            name = f"{name}/{own}" if name else own
        known[below.GetPath()] = name
    return name


def read_metadata(stage: Any, times: Float64Array, per_second: float) -> dict[str, str]:
    """Return the metadata of a stage with frames at `times` [s] and `per_second` time codes per second."""
    stored = stage.GetRootLayer().customLayerData.get(METADATA, {})
    metadata = {str(key): str(text) for key, text in stored.items()} if isinstance(stored, dict) else {}
    if stage.HasAuthoredMetadata("upAxis"):
        metadata[UP_AXIS] = str(UsdGeom.GetStageUpAxis(stage))
    if stage.HasAuthoredMetadata("metersPerUnit"):
        metadata[UNIT] = unit_text(float(UsdGeom.GetStageMetersPerUnit(stage)))
    ends = [float(times[0]), float(times[-1])]
    authored = [stage.HasAuthoredMetadata(f"{which}TimeCode") for which in ("start", "end")]
    codes = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    first, last = (code / per_second if said else end for code, said, end in zip(codes, authored, ends, strict=True))
    if math.isfinite(first) and first <= last < math.inf and np.abs(np.subtract((first, last), ends)).max() > SAME_TIME:
        metadata[TIME_RANGE] = f"{first!r} {last!r} {ends[0]!r} {ends[1]!r}"
    if stage.HasAuthoredMetadata("framesPerSecond") and stage.GetFramesPerSecond() != per_second:
        metadata[TIME_CODE_RATE] = repr(float(per_second))
    return metadata


def time_range(text: str | None, times: Float64Array) -> tuple[float, float]:
    """Return the first and last time [s] of a stage: from the metadata, unless frames were added or removed since."""
    own = float(times[0]), float(times[-1])
    try:
        first, last, *ends = map(float, (text or "").split())
    except ValueError:
        return own
    is_whole = len(ends) == 2 and np.allclose(ends, own, rtol=0, atol=SAME_TIME)
    return (first, last) if is_whole and math.isfinite(first) and first <= last < math.inf else own


def time_code_rate(text: str | None, rate: float) -> float:
    """Return time codes per second: from the metadata, else the frame rate."""
    try:
        found = float(text or "nan")
    except ValueError:
        return rate
    return found if 0 < found < math.inf else rate
