"""Report USD's failures to compose a stage, and files that cannot be opened, which USD would skip."""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pxr import Pcp, Tf, Usd, UsdGeom, UsdShade, UsdUtils

from pdecodec.errors import InputError, PdecodecError, damaged
from pdecodec.formats.base.scene_reading import Refusals, listed

PARSE_ERROR = re.compile(r":(?P<line>\d+):\d+: (?:parse error matching \S+ (?P<place>at .*)|(?P<what>.*))")
"""USD's message about text that it cannot parse; "matching" is followed by a name from its sources."""

WHERE_IN_USD = re.compile(r"^Error in '[^']*' at line \d+ in file \S+ : ")
"""Start of USD's messages, which names a place in USD's own sources."""

MISSING = re.compile(
    r"(?P<kind>asset|sublayer|(?P<arc>\w+) prim path) @(?P<file>[^@]*)@(?P<prim><[^>]*>)?(?: for (?P<by>\w+))?"
)
"""USD's messages about missing files and prims; its Python interface gives no other access to their names."""

ABSENCES = (Pcp.ErrorInvalidAssetPath, Pcp.ErrorInvalidSublayerPath, Pcp.ErrorUnresolvedPrimPath)
"""USD's errors about missing files and prims."""

SESSION = re.compile(r",@anon:[^@]*@")
"""Pattern of the name of USD's session layer, which is removed from messages."""


@contextmanager
def warnings_hidden() -> Iterator[None]:
    """Keep USD's warnings off the standard error."""
    warnings = UsdUtils.CoalescingDiagnosticDelegate()
    try:
        yield
    finally:
        del warnings


@contextmanager
def stage_errors(path: Path) -> Iterator[None]:
    """Turn USD's exceptions into an InputError about a file, and keep USD's warnings off the standard error."""
    try:
        with warnings_hidden():
            yield
    except (Tf.ErrorException, UnicodeDecodeError) as error:
        try:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
            if found := PARSE_ERROR.search(str(error)):
                what = f"does not parse {found['place']}" if found["place"] else f"is wrong: {found['what']}"
                lines = [f"line {found['line']} {what}"]
        except UnicodeDecodeError:
            # USD's message quotes the file, whose text is not UTF-8.
            lines = ["its text is not UTF-8"]
        reason = WHERE_IN_USD.sub("", lines[-1]).strip("'") if lines else "unknown"
        raise damaged(f"is not a USD file, or is damaged ({reason}); export it again", path=path) from error
    except PdecodecError:
        raise
    except (TypeError, ValueError) as error:
        # A stage may declare attributes of a schema with types of its own, even with types that USD does not know.
        reason = str(error).splitlines()[0]
        raise damaged(
            f"has attributes whose types contradict their USD schemas ({reason}); export it again", path=path
        ) from error


def check_rates(stage: Any) -> None:
    """Raise InputError if a rate is no positive number: USD divides the time codes of other layers by it."""
    for layer in stage.GetUsedLayers():
        for name, is_there, rate in (
            ("timeCodesPerSecond", layer.HasTimeCodesPerSecond(), layer.timeCodesPerSecond),
            ("framesPerSecond", layer.HasFramesPerSecond(), layer.framesPerSecond),
        ):
            if is_there and not (math.isfinite(rate) and rate > 0):
                raise InputError(
                    f"{name} of layer {layer.GetDisplayName()} is {rate:g}; it must be a positive number",
                    code="invalid-times",
                )


def check_composition(stage: Any, refusals: Refusals) -> tuple[str, ...]:
    """Refuse missing files and prims that geometry may come from; return notices about all other failures."""
    missing: dict[tuple[str, str], dict[str, None]] = {}
    notices: dict[str, None] = {}
    folder = Path(stage.GetRootLayer().realPath).parent
    for error in stage.GetCompositionErrors():
        path = error.rootSite.path
        text = SESSION.sub("", " ".join(str(error).split()))
        found = MISSING.search(text)
        if found is None or not isinstance(error, ABSENCES):
            notices[f"USD does not compose {path}: {text}"] = None
            continue
        name = _from(folder, found["file"]) + (found["prim"] or "")
        what = "prim that can be found" if found["prim"] else "file that can be opened"
        if found["kind"] == "sublayer":
            missing.setdefault((name, f"no {what}, and it is a sublayer"), {})
            continue
        arc = found["arc"] or found["by"] or "part"
        if _is_look(stage.GetPrimAtPath(path)):
            notices[f"missing: {name}, a {arc} of {path}"] = None
        else:
            missing.setdefault((name, f"no {what}, and it is a {arc} of"), {})[str(path).lstrip("/")] = None
    for prim in stage.TraverseAll():
        if prim.HasAuthoredMetadata("clips"):
            clips = Usd.ClipsAPI(prim)
            for each in clips.GetClips():
                for asset in clips.ComputeClipAssetPaths(each):
                    if not asset.resolvedPath:
                        key = asset.path, "no file that can be opened, and it holds values of"
                        missing.setdefault(key, {})[str(prim.GetPath()).lstrip("/")] = None
    for (name, feature), users in sorted(missing.items()):
        refusals.refuse(name, f"{feature} {listed(sorted(users))}" if users else feature)
    return tuple(sorted(notices))


def _from(folder: Path, name: str) -> str:
    """Return the name of a file, relative to the folder if it is inside."""
    return str(Path(name).relative_to(folder)) if Path(name).is_relative_to(folder) else name


def _is_look(prim: Any) -> bool:
    """Return whether a prim only describes appearance, so that no geometry comes from it."""
    return bool(prim) and (
        any(prim.IsA(schema) for schema in (UsdShade.Material, UsdShade.Shader, UsdShade.NodeGraph, UsdGeom.Camera))
        or "Light" in str(prim.GetTypeName())
    )
