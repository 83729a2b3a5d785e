"""What an Exodus file holds, listed with h5py or SciPy."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
from numpy.typing import NDArray
from scipy.io import netcdf_file

_OF_LAYOUT = ("DIMENSION_LIST", "REFERENCE_LIST", "NAME")


def exodus_listing(path: Path) -> tuple[dict[str, Any], dict[str, NDArray[Any]]]:
    """Return all facts about a file and its arrays, in order, and the arrays' values."""
    if path.read_bytes()[:3] == b"CDF":
        with netcdf_file(path, "r", mmap=False) as file:
            facts = {"": (dict(file.dimensions), _texts(file._attributes), int(file.version_byte))}
            for name, one in file.variables.items():
                facts[name] = (one.dimensions, one.data.dtype.str, _texts(one._attributes))
            return facts, {name: np.array(one.data) for name, one in file.variables.items()}
    with h5py.File(path, "r") as file:
        facts = {"": _texts(file.attrs)}
        for name, one in file.items():
            scales = [[scale.name for scale in axis.values()] for axis in one.dims]
            layout = (one.maxshape, one.chunks, one.compression, one.compression_opts, one.shuffle, one.fillvalue)
            facts[name] = (scales, one.dtype.str, str(layout), one.is_scale, _texts(one.attrs))
        return facts, {name: one[()] for name, one in file.items()}


def _texts(attributes: Any) -> dict[str, str]:
    return {key: f"{np.asarray(value).dtype} {value!r}" for key, value in attributes.items() if key not in _OF_LAYOUT}
