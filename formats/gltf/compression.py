"""Compressed geometry in glTF files: Draco's meshes and meshoptimizer's buffer views (extra ``gltf``).

What the decoders get is hostile: how much they may write is checked against limits before they run, and what they give
against what the file declares.
"""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import MissingExtraError
from pdecodec.mesh.arrays import Int64Array

DRACO = "KHR_draco_mesh_compression"
MESHOPT_NAMES = ("EXT_meshopt_compression", "KHR_meshopt_compression")

MOST_DECODED = 2**30
"""Bytes that the buffer views of a file may become together."""

_FILTER_STRIDES = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,), "EXPONENTIAL": tuple(range(4, 257, 4))}
"""Bytes of the rows that each filter is for; meshoptimizer ends the process at others."""


@dataclass(frozen=True)
class DracoMesh:
    """Attributes by their number, (vertices, k), and triangles, (corners,) int64."""

    attributes: Mapping[int, NDArray[Any]]
    indices: Int64Array


def decode_draco(data: bytes) -> DracoMesh:
    """A mesh that Draco compressed.

    Raises
    ------
    MissingExtraError
        If DracoPy is not installed.
    ValueError
        If it is damaged, or a point cloud.
    """
    draco = _decoder("DracoPy", DRACO)
    try:
        mesh = draco.decode(data)
        found = {int(one["unique_id"]): np.asarray(one["data"]) for one in mesh.attributes}
        faces = np.asarray(mesh.faces)
    except Exception as error:  # what it raises is not said anywhere
        raise ValueError(f"Draco cannot decode it: {error}") from error
    rows = {len(values) for values in found.values()}
    if len(rows) != 1 or (faces.size and int(faces.max()) >= min(rows)):
        raise ValueError("its compressed attributes and triangles do not fit each other")
    return DracoMesh(
        {number: values.reshape(len(values), -1) for number, values in found.items()},
        faces.reshape(-1).astype(np.int64),
    )


def decode_view(data: bytes, entry: Mapping[str, Any], most: int = MOST_DECODED) -> bytes:
    """A buffer view that meshoptimizer compressed, at most so many bytes; `entry` is what its extension says.

    Raises
    ------
    MissingExtraError
        If meshoptimizer is not installed.
    ValueError, TypeError, KeyError
        If it is damaged, or its entry does not make sense.
    """
    stride, count, mode, kind = entry["byteStride"], entry["count"], entry["mode"], entry.get("filter", "NONE")
    if not (isinstance(stride, int) and isinstance(count, int) and 0 < stride <= 256 and count >= 0):
        raise ValueError("its rows have no size")
    if stride * count > most:
        raise ValueError(f"it becomes {stride * count / 1e9:.1f} GB, {most / 1e9:.1f} GB are left")
    if kind != "NONE" and (mode != "ATTRIBUTES" or stride not in _FILTER_STRIDES.get(str(kind), ())):
        raise ValueError(f"its filter {kind} is not known, or not for rows of {stride} bytes")
    decoder = _decoder("meshoptimizer", MESHOPT_NAMES[0])
    try:
        if mode == "ATTRIBUTES":
            rows = decoder.decode_vertex_buffer(count, stride, data, np.dtype(f"V{stride}"))
            if kind != "NONE":
                decode = {
                    "OCTAHEDRAL": decoder.decode_filter_oct,
                    "QUATERNION": decoder.decode_filter_quat,
                    "EXPONENTIAL": decoder.decode_filter_exp,
                }[kind]
                rows = decode(rows, count, stride)
        elif mode in ("TRIANGLES", "INDICES") and stride in (2, 4) and (mode == "INDICES" or count % 3 == 0):
            decode = decoder.decode_index_buffer if mode == "TRIANGLES" else decoder.decode_index_sequence
            rows = decode(count, stride, data)
        else:
            raise ValueError(f"{count} rows of {stride} bytes are not of the mode {mode}")
    except RuntimeError as error:
        raise ValueError(f"meshoptimizer cannot decode it: {error}") from error
    decoded: bytes = rows.tobytes()[: stride * count]
    return decoded


def _decoder(package: str, extension: str) -> Any:
    try:
        return importlib.import_module(package)
    except ModuleNotFoundError as error:
        raise MissingExtraError(
            f"its geometry is in {extension}, which needs the package {package}; run: pip install 'pdecodec[gltf]'"
        ) from error
