"""Decode compressed geometry of glTF files: Draco meshes and meshoptimizer buffer views (extra ``gltf``).

The data are untrusted: the size of the output is checked against limits before a decoder runs, and the result
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

MAX_DECODED_BYTES = 2**30
"""Largest total size of the decoded buffer views of a file [bytes]."""

_FILTER_STRIDES = {"OCTAHEDRAL": (4, 8), "QUATERNION": (8,), "EXPONENTIAL": tuple(range(4, 257, 4))}
"""Row sizes that each filter accepts [bytes]; meshoptimizer aborts the process at others."""


@dataclass(frozen=True)
class DracoMesh:
    """Attributes (vertices, k) by their Draco ids, and corners (corners,) int64 of the triangles."""

    attributes: Mapping[int, NDArray[Any]]
    indices: Int64Array


def decode_draco(data: bytes) -> DracoMesh:
    """Decode a mesh that Draco compressed.

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
    except Exception as error:  # Draco documents no exceptions
        raise ValueError(f"Draco cannot decode it: {error}") from error
    rows = {len(values) for values in found.values()}
    if len(rows) != 1 or (faces.size and int(faces.max()) >= min(rows)):
        raise ValueError("its compressed attributes and triangles do not match")
    return DracoMesh(
        {number: values.reshape(len(values), -1) for number, values in found.items()},
        faces.reshape(-1).astype(np.int64),
    )


def decode_view(data: bytes, entry: Mapping[str, Any], most: int = MAX_DECODED_BYTES) -> bytes:
    """Decode a buffer view that meshoptimizer compressed, to at most `most` bytes.

    Parameters
    ----------
    data : bytes
    entry : mapping
        The view's entry in the extension.
    most : int
        Largest size of the result [bytes].

    Raises
    ------
    MissingExtraError
        If meshoptimizer is not installed.
    ValueError, TypeError, KeyError
        If the data are damaged, or `entry` makes no sense.
    """
    stride, count, mode, kind = entry["byteStride"], entry["count"], entry["mode"], entry.get("filter", "NONE")
    if not (isinstance(stride, int) and isinstance(count, int) and 0 < stride <= 256 and count >= 0):
        raise ValueError("the number or size of its rows is missing or invalid")
    if stride * count > most:
        raise ValueError(f"it decodes to {stride * count / 1e9:.1f} GB, only {most / 1e9:.1f} GB are allowed")
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
