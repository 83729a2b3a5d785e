"""Names of objects as paths of prims, and what our writer leaves so that they come back as they were."""

from __future__ import annotations

from typing import Any

from pxr import Sdf, Tf

OWN = "pdecodec"
"""Namespace of attributes that only we write and read."""

NAME, ADDED = f"{OWN}:name", f"{OWN}:added"
"""Custom data of a prim: the name it stands for where USD could not hold it; whether the tree did not have it."""

METADATA, ASSUMED = f"{OWN}Metadata", f"{OWN}Assumed"
"""Custom data of a layer: metadata that USD has no place for; what of the stage nobody said, but USD asks for."""


def valid_name(step: str) -> str:
    """What a prim is called for a step of a path."""
    return step if Sdf.Path.IsValidIdentifier(step) else str(Tf.MakeValidIdentifier(step))


def object_name(prim: Any) -> str:
    """The path of an object: names from the root, without the leading slash."""
    steps = []
    while prim and not prim.IsPseudoRoot():
        if not prim.GetCustomDataByKey(ADDED):
            steps.append(str(prim.GetCustomDataByKey(NAME) or prim.GetName()))
        prim = prim.GetParent()
    return "/".join(reversed(steps))
