"""List, with USD itself, the content of a stage other than the motion of its meshes."""

from __future__ import annotations

import zipfile
from pathlib import Path
from typing import Any

from pxr import Sdf, Usd

_OF_MOTION = {"points", "normals", "primvars:normals", "primvars:normals:indices", "extent"}

_OF_SKELETONS = {
    *("skel:skeleton", "skel:animationSource", "skel:blendShapeTargets", "skel:blendShapes"),
    *("primvars:skel:jointIndices", "primvars:skel:jointWeights"),
}


def _plain(value: Any) -> Any:
    """Return a value that can be compared, with the names of assets as they are written."""
    if isinstance(value, Sdf.AssetPath):
        return value.path
    if hasattr(value, "__len__") and not isinstance(value, str):
        return (
            [_plain(one) for one in value] if not isinstance(value, dict) else {k: _plain(v) for k, v in value.items()}
        )
    return value if isinstance(value, (str, int, float, bool, type(None))) else str(value)


def listing(path: Path, moved: set[str]) -> dict[str, Any]:
    """Return everything in a stage except the motion of the prims `moved`, by its path."""
    stage = Usd.Stage.Open(str(path))
    found: dict[str, Any] = {}
    for name, value in stage.GetPseudoRoot().GetAllMetadata().items():
        if name not in ("startTimeCode", "endTimeCode", "customLayerData", "subLayers", "subLayerOffsets"):
            found[f"stage {name}"] = _plain(value)
    custom = {k: v for k, v in stage.GetRootLayer().customLayerData.items() if not k.startswith("pdecodec")}
    found["stage customLayerData"] = _plain(custom)
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimAllPrimsPredicate)):
        place = str(prim.GetPath())
        left_out = _OF_MOTION | _OF_SKELETONS if place in moved else set()
        # Implicit shapes become meshes, and moved instances become separate prims.
        changed = ("apiSchemas", "instanceable", *(("typeName",) if place in moved else ()))
        metadata = {k: v for k, v in prim.GetAllMetadata().items() if k not in changed}
        found[place] = _plain({**metadata, "children": [child.GetName() for child in prim.GetAllChildren()]})
        for one in prim.GetAuthoredProperties():
            name = one.GetName()
            if name in left_out:
                continue
            key = f"{place}.{name}"
            if isinstance(one, Usd.Relationship):
                found[key] = _plain(one.GetTargets())
                continue
            samples = {code: _plain(one.Get(code)) for code in one.GetTimeSamples()}
            found[key] = [str(one.GetTypeName()), _plain(one.GetAllMetadata()), _plain(one.Get()), samples]
    return found


def others_in_package(path: Path) -> dict[str, bytes]:
    """Return the names of all files of a package, with the content of those that are not layers."""
    with zipfile.ZipFile(path) as package:
        names = package.namelist()
        return {name: b"" if name.endswith((".usdc", ".usda", ".usd")) else package.read(name) for name in names}
