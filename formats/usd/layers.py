"""Check the layers of a USD stage: they must be regular files in the folder of the root layer, or in an allowed folder.

USD opens every file that a layer refers to, so layers are followed before a stage is made of them: each reference is
checked before it is opened. Only then is it known which layers the stage uses; unused layers may be anywhere.
"""

from __future__ import annotations

import glob
import os
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from pxr import Ar, Sdf, Tf, Usd, UsdUtils

from pdecodec.errors import InputError
from pdecodec.formats.usd.composition import stage_errors
from pdecodec.system.reading import FileScope, open_regular

SEARCH_VARIABLE = "PXR_AR_DEFAULT_SEARCH_PATH"
"""Environment variable of USD that lists folders to search for layers: setting it allows them."""


def open_stage(path: Path) -> Any:
    """Open the stage of a file.

    Raises
    ------
    InputError
        If one of its layers or value clips is outside the folder of the file, or no regular file.
    Tf.ErrorException
        If it is not a USD file, or is damaged.
    """
    known = Sdf.Layer.Find(str(path))
    if known is not None:
        # USD caches open files, and this file may have been written again since.
        known.Reload()
    scope = usd_scope(path)
    layers, _ = _layers(path, scope)  # Keep a reference, so that USD does not read them again.
    stage = Usd.Stage.Open(str(path))
    for layer in stage.GetUsedLayers():
        _check(layer.realPath, scope)
    _check_clips(stage, scope)
    del layers
    return stage


def usd_scope(path: Path) -> FileScope:
    """Return the scope in which the layers of a stage must be."""
    listed = os.environ.get(SEARCH_VARIABLE, "").split(os.pathsep)
    return FileScope(path, [folder for folder in listed if folder])


def layer_files(path: Path) -> Iterator[Path]:
    """Yield the files that a stage consists of, including value clips; none for packages."""
    if path.suffix.lower() != ".usdz":
        with stage_errors(path):
            yield from _layers(path, usd_scope(path))[1]


def check_package(file: Path, scope: FileScope) -> None:
    """Raise InputError if a file that goes into the package of a layer is outside the scope."""
    layers, assets, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
    own = os.path.dirname(os.path.realpath(file))
    for place in (*(layer.realPath for layer in layers), *assets):
        if not os.path.realpath(place).startswith(os.path.join(own, "")):
            _check(place, scope)


def _layers(path: Path, scope: FileScope) -> tuple[list[Any], dict[Path, None]]:
    """Return the layers inside the scope that a file consists of, and the files of these layers and of value clips."""
    left, layers, files, resolver = [str(path)], [], {path: None}, Ar.GetResolver()
    seen = set(left)
    while left:
        try:
            layer = Sdf.Layer.FindOrOpen(left.pop())
        except Tf.ErrorException:
            continue  # USD reports this error for the stage.
        if not layer:
            continue
        layers.append(layer)
        named = set(layer.GetCompositionAssetDependencies())
        for name in (*sorted(named), *_clip_names(layer)):
            place = layer.ComputeAbsolutePath(name)
            found = str(resolver.Resolve(place))
            if found and place not in seen and _is_inside(_file_of(found), scope):
                seen.add(place)
                files[_file_of(found)] = None
                if name in named:
                    left.append(place)
    return layers, files


def _is_inside(file: Path, scope: FileScope) -> bool:
    """Return whether a file that USD finds is in the scope; raise InputError if it is no regular file."""
    if os.path.lexists(file):
        with open_regular(file):
            pass
        try:
            scope.checked(str(file))
        except InputError:
            return False
    return True


def _clip_names(layer: Any) -> list[str]:
    """Return the names of the value clip files of a layer: USD opens them when it makes the stage."""
    names: list[str] = []

    def visit(path: Any) -> None:
        if not (path.IsPrimPath() or path.IsPrimVariantSelectionPath()):
            return
        clips = layer.GetObjectAtPath(path).GetInfo("clips")
        for one in clips.values() if isinstance(clips, dict) else ():
            found = [*(one.get("assetPaths") or ()), one.get("manifestAssetPath")] if isinstance(one, dict) else []
            names.extend(asset.path for asset in found if isinstance(asset, Sdf.AssetPath) and asset.path)
            if isinstance(one, dict) and isinstance(one.get("templateAssetPath"), str):
                template = layer.ComputeAbsolutePath(one["templateAssetPath"])
                names.extend(glob.glob(re.sub("#+", "*", glob.escape(template))))

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return names


def _check_clips(stage: Any, scope: FileScope) -> None:
    """Check the files of value clips, which USD opens when their values are read."""
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        if prim.HasAuthoredMetadata("clips"):
            clips = Usd.ClipsAPI(prim)
            for name in clips.GetClipSets().GetAddedOrExplicitItems():
                for asset in (*clips.ComputeClipAssetPaths(name), clips.GetClipManifestAssetPath(name)):
                    if asset is not None and asset.resolvedPath:
                        _check(asset.resolvedPath, scope)


def _check(place: str, scope: FileScope) -> None:
    """Raise InputError if a file, or the package that holds a layer, must not be read; layers in memory may be."""
    if place:
        scope.regular(str(_file_of(place)))


def _file_of(place: str) -> Path:
    """Return the file of a layer; for one in a package, ``shot.usdz[walk.usda]``, the package."""
    return Path(Ar.SplitPackageRelativePathOuter(place)[0] if Ar.IsPackageRelativePath(place) else place)
