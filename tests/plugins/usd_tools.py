"""The USD plug-in: open layers through it, and compare stages."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

pytest.importorskip("pxr", reason="USD is not installed here (pip install 'pdecodec[usd]')")

from pxr import Sdf, Tf, Usd

if Sdf.FileFormat.FindByExtension("pdeanim") is None:
    pytest.skip("USD has no plug-in for .pdeanim: build plugins/usd, set PXR_PLUGINPATH_NAME", allow_module_level=True)

FROM_MOTION = {"velocities", "accelerations"}
"""Attributes that the plug-in has and a written stage lacks, unless it is asked for them."""

WRITTEN_ALONE = {"pdecodecSampled"}
"""Layer data of written stages: every frame is a sample there, and nothing lies between samples."""


def opened(path: Path, **arguments: object) -> Any:
    found = {name: str(value) for name, value in arguments.items()}
    return Usd.Stage.Open(Sdf.Layer.FindOrOpen(str(path), found) if found else Sdf.Layer.FindOrOpen(str(path)))


def value_at(path: Path, attribute: str, code: float, **arguments: object) -> Any:
    stage = opened(path, **arguments)
    return np.array(stage.GetAttributeAtPath(attribute).Get(code))


def plain(value: Any) -> Any:
    """Return a value that compares by content: arrays as NumPy's, lists and matrices as they are."""
    try:
        return np.array(value) if hasattr(value, "__len__") and not isinstance(value, str) else value
    except (TypeError, ValueError):
        return list(value)


def file_name(asset: str) -> str:
    """Return the name of a file without its folder, also of one inside another."""
    return asset.rstrip("]").rpartition("[")[2].rpartition("/")[2]


def assert_same_value(found: Any, expected: Any, what: str, tolerance: float) -> None:
    assert type(found) is type(expected), what
    if isinstance(expected, Sdf.AssetPath):
        # The plug-in names the file inside the clip.
        assert file_name(found.path) == file_name(expected.path), what
    elif tolerance and expected is not None:
        np.testing.assert_allclose(plain(found), plain(expected), rtol=0, atol=tolerance, err_msg=what)
    else:
        np.testing.assert_array_equal(plain(found), plain(expected), err_msg=what)


def assert_same_attribute(found: Any, expected: Any, rounding: float = 0.0) -> None:
    what = f"{expected.GetPath()} ({found.GetPrim().GetStage().GetRootLayer().identifier})"
    assert found.GetTypeName() == expected.GetTypeName(), what
    assert found.IsCustom() == expected.IsCustom(), what
    assert found.GetVariability() == expected.GetVariability(), what
    for key in ("interpolation", "elementSize", "customData"):
        assert found.GetMetadata(key) == expected.GetMetadata(key), what
    tolerance = 2e-6 if expected.GetName() in ("normals", "primvars:normals") else 0.0
    if expected.GetTypeName().type.typeName.endswith(("<float>", "GfVec3f>")):
        tolerance = max(tolerance, rounding)
    if expected.GetTypeName() == "matrix4d":
        tolerance = 1e-12
    codes = expected.GetTimeSamples()
    if not codes:
        assert_same_value(found.Get(), expected.Get(), what, tolerance)
    for code in codes:
        assert_same_value(found.Get(code), expected.Get(code), f"{what} at {code}", tolerance)


def assert_same_stage(found: Any, expected: Any, rounding: float = 0.0) -> None:
    """Assert that a stage has the prims, metadata, attributes and values of another one; single floats may be off."""
    for key in ("upAxis", "metersPerUnit", "startTimeCode", "endTimeCode", "timeCodesPerSecond", "framesPerSecond"):
        assert found.HasAuthoredMetadata(key) == expected.HasAuthoredMetadata(key), key
        assert found.GetMetadata(key) == expected.GetMetadata(key), key
    layers = [dict(one.GetRootLayer().customLayerData) for one in (found, expected)]
    assert layers[0] == {key: value for key, value in layers[1].items() if key not in WRITTEN_ALONE}
    assert found.GetDefaultPrim().GetPath() == expected.GetDefaultPrim().GetPath()
    paths = [[str(prim.GetPath()) for prim in one.TraverseAll()] for one in (found, expected)]
    assert sorted(paths[0]) == sorted(paths[1])
    for prim in expected.TraverseAll():
        own = found.GetPrimAtPath(prim.GetPath())
        assert own.GetTypeName() == prim.GetTypeName()
        assert own.GetAppliedSchemas() == prim.GetAppliedSchemas()
        for key in ("customData", "displayName"):
            assert own.GetMetadata(key) == prim.GetMetadata(key)
        names = [{one.GetName() for one in either.GetAuthoredProperties()} for either in (own, prim)]
        assert names[0] - FROM_MOTION == names[1] - FROM_MOTION, prim.GetPath()
        for relationship in prim.GetAuthoredRelationships():
            assert own.GetRelationship(relationship.GetName()).GetTargets() == relationship.GetTargets()
        for attribute in prim.GetAuthoredAttributes():
            assert_same_attribute(own.GetAttribute(attribute.GetName()), attribute, rounding)


def message_of(path: Path, read: Callable[[], object]) -> str:
    """Return the one line about a file that USD's error has; nothing if reading succeeds."""
    try:
        read()
    except Tf.ErrorException as error:
        (line,) = [line for line in str(error).splitlines() if f"{path}: " in line]
        return line
    return ""
