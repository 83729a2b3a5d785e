"""The layers that a USD stage is made of: regular files, in the folder of the first one or where that is allowed.

USD opens whatever a layer names, so layers are gone through before a stage is made of them: what they name is looked at
before it is opened. Which layers a stage uses is known when it is made: those that it does not use may lie anywhere.
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
"""Environment variable of USD that lists folders in which layers are sought: whoever sets it allows them."""


def open_stage(path: Path) -> Any:
    """Return the stage of a file.

    Raises
    ------
    InputError
        If a layer or a value clip of it lies outside the folder of the file, or is no regular file.
    Tf.ErrorException
        If it is no USD file, or a damaged one.
    """
    known = Sdf.Layer.Find(str(path))
    if known is not None:
        # USD keeps files that are open: this one may have been written again since.
        known.Reload()
    scope = usd_scope(path)
    layers, _ = _layers(path, scope)  # held, so that USD does not read them again
    stage = Usd.Stage.Open(str(path))
    for layer in stage.GetUsedLayers():
        _check(layer.realPath, scope)
    _check_clips(stage, scope)
    del layers
    return stage


def usd_scope(path: Path) -> FileScope:
    """Return where the layers of a stage may lie."""
    listed = os.environ.get(SEARCH_VARIABLE, "").split(os.pathsep)
    return FileScope(path, [folder for folder in listed if folder])


def layer_files(path: Path) -> Iterator[Path]:
    """Yield the files that a stage is made of, those of value clips too; of packages, none."""
    if path.suffix.lower() != ".usdz":
        with stage_errors(path):
            yield from _layers(path, usd_scope(path))[1]


def check_package(file: Path, scope: FileScope) -> None:
    """Raise InputError where what goes into the package of a layer lies outside the scope."""
    layers, assets, _ = UsdUtils.ComputeAllDependencies(Sdf.AssetPath(str(file)))
    own = os.path.dirname(os.path.realpath(file))
    for place in (*(layer.realPath for layer in layers), *assets):
        if not os.path.realpath(place).startswith(os.path.join(own, "")):
            _check(place, scope)


def _layers(path: Path, scope: FileScope) -> tuple[list[Any], dict[Path, None]]:
    """Return the layers that a file is made of, of those in the scope, and the files of these and of value clips."""
    left, layers, files, resolver = [str(path)], [], {path: None}, Ar.GetResolver()
    seen = set(left)
    while left:
        try:
            layer = Sdf.Layer.FindOrOpen(left.pop())
        except Tf.ErrorException:
            continue  # USD says it of the stage
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
    """Whether a file that USD finds lies in the scope; InputError where it is no regular file."""
    if os.path.lexists(file):
        with open_regular(file):
            pass
        try:
            scope.checked(str(file))
        except InputError:
            return False
    return True


def _clip_names(layer: Any) -> list[str]:
    """Return what a layer calls the files of value clips: USD opens them when it makes the stage."""
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
    """Look at the files of value clips, which USD opens when their values are asked for."""
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)):
        if prim.HasAuthoredMetadata("clips"):
            clips = Usd.ClipsAPI(prim)
            for name in clips.GetClipSets().GetAddedOrExplicitItems():
                for asset in (*clips.ComputeClipAssetPaths(name), clips.GetClipManifestAssetPath(name)):
                    if asset is not None and asset.resolvedPath:
                        _check(asset.resolvedPath, scope)


def _check(place: str, scope: FileScope) -> None:
    """Raise InputError where a file, or the package that a layer is in, is not one to read; layers in memory are."""
    if place:
        scope.regular(str(_file_of(place)))


def _file_of(place: str) -> Path:
    """Return the file of a layer: of one in a package, ``shot.usdz[walk.usda]``, that of the package."""
    return Path(Ar.SplitPackageRelativePathOuter(place)[0] if Ar.IsPackageRelativePath(place) else place)
