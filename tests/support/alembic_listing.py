"""List, with Alembic itself, the content of an archive other than the motion of its shapes."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
from alembic3d import Abc

_OF_MOTION = {".geom/P", ".geom/N", ".geom/N/.vals", ".geom/N/.indices", ".geom/.selfBnds"}
_LIKE_POSITIONS = {".geom/.faceIndices", ".geom/.faceCounts", ".geom/nVertices", ".geom/.pointIds"}


def _value(found: Any) -> Any:
    if hasattr(found, "min") and hasattr(found, "max") and not hasattr(found, "__len__"):
        return str(found)
    try:
        return np.array(found).tolist() if hasattr(found, "__len__") and not isinstance(found, str) else str(found)
    except (TypeError, ValueError):
        return [str(one) for one in found]


def listing(path: Path, moved: set[str]) -> dict[str, Any]:
    """Return everything in an archive except the motion of the shapes `moved`, by its path."""
    archive = Abc.IArchive(str(path))
    found: dict[str, Any] = {"archive": str(archive.getTop().getMetaData())}
    left = [archive.getTop()]
    while left:
        item = left.pop()
        place = item.getFullName()
        children = [item.getChild(index) for index in range(item.getNumChildren())]
        found[place] = (str(item.getMetaData()) if place != "/" else "", [one.getName() for one in children])
        left += children
        for name, value in _properties(item.getProperties(), "", moved=place in moved):
            found[f"{place} {name}"] = value
    return found


def _properties(owner: Any, above: str, *, moved: bool) -> Iterator[tuple[str, Any]]:
    for index in range(owner.getNumProperties()):
        header = owner.getPropertyHeader(index)
        name = f"{above}{header.getName()}"
        if moved and name in _OF_MOTION:
            continue
        if header.isCompound():
            yield name, str(header.getMetaData())
            yield from _properties(Abc.ICompoundProperty(owner, header.getName()), f"{name}/", moved=moved)
            continue
        kind = Abc.IScalarProperty if header.isScalar() else Abc.IArrayProperty
        stored = kind(owner, header.getName())
        sampling = stored.getTimeSampling()
        times = [sampling.getSampleTime(k) for k in range(stored.getNumSamples())]
        samples = [(time, _value(stored.getValue(Abc.ISampleSelector(time)))) for time in times]
        if moved and name in _LIKE_POSITIONS and all(one == samples[0][1] for _, one in samples):
            # Equal samples are written once: their number follows that of positions.
            samples = [(0.0, samples[0][1])]
        yield name, (str(header.getMetaData()), str(header.getDataType()), samples)
