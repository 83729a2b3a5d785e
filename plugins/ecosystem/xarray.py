"""Open `.pdeanim` files in xarray, which finds this backend by the entry point ``xarray.backends``.

>>> clip = xarray.open_dataset("walk.pdeanim", engine="pdeanim")
>>> heights = clip.positions.sel(component="z").max("vertex").compute()
"""

from __future__ import annotations

import os
from collections.abc import Iterable
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from xarray import Dataset
from xarray.backends import BackendEntrypoint

import pdecodec

DOMAINS = ("vertex", "face", "corner", "cell", "object")


class PdeanimBackend(BackendEntrypoint):
    """Open positions and fields as Dask arrays, of which each block decodes one group of frames."""

    description = "pdecodec animations (.pdeanim)"
    open_dataset_parameters = ("filename_or_obj", "drop_variables", "times")

    def guess_can_open(self, filename_or_obj: Any) -> bool:
        """Return whether this is the path of a `.pdeanim` file."""
        return isinstance(filename_or_obj, str | os.PathLike) and os.fspath(filename_or_obj).endswith(".pdeanim")

    def open_dataset(
        self,
        filename_or_obj: str | os.PathLike[str],
        *,
        drop_variables: str | Iterable[str] | None = None,
        times: ArrayLike | None = None,
    ) -> Dataset:
        """Return a file as a data set.

        Parameters
        ----------
        filename_or_obj : path or address
        drop_variables : str or iterable of str, optional
        times : (n,) array [s], optional
            Any, between frames too. Default: those of the frames.

        Returns
        -------
        xarray.Dataset
            ``positions`` (time, vertex, component), float32 [scene units]; each field (time, elements of its domain
            [, components]), as ``NAME_field`` if something else has its name; the faces, lines and cells as counts and
            indices (:class:`pdecodec.Connectivity`) of all objects together. ``time`` is in seconds; ``vertex_object``
            and others number the object of each element.

        Raises
        ------
        PdecodecError
            If the file cannot be read, or its connectivity changes.
        """
        from pdecodec import dask

        with pdecodec.open_animation(filename_or_obj) as animation:
            objects, whole = animation.objects, animation.connectivity
            positions = dask.positions(filename_or_obj, times)
            found: dict[str, Any] = {
                "positions": (("time", "vertex", "component"), positions, {"units": animation.metadata.get("unit", "")})
            }
            coordinates: dict[str, Any] = {
                "time": ("time", animation.times if times is None else np.asarray(times, float), {"units": "s"}),
                "component": ["x", "y", "z"],
                "object": [item.name for item in objects],
            }
            for name, dimension in (("counts", "face"), ("indices", "corner")):
                for kind in ("face", "line", "cell"):
                    values = getattr(whole, f"{kind}_{name}")
                    if values.size:
                        own = dimension if kind == "face" else kind if name == "counts" else f"{kind}_node"
                        found[f"{kind}_{name}"] = own, values
            if whole.cell_count:
                found["cell_shapes"] = "cell", whole.cell_shapes
            for domain in DOMAINS[:-1]:
                rows = pdecodec.Field("", domain).row_counts(objects)  # type: ignore[arg-type]  # a domain
                if sum(rows):
                    coordinates[domain] = np.arange(sum(rows))
                    coordinates[f"{domain}_object"] = domain, np.repeat(np.arange(len(objects)), rows)
            for field in animation.fields:
                dimension = field.domain if field.objects is None else f"{field.domain}_of_{field.name}"
                if field.objects is not None:
                    coordinates[dimension] = _rows(field, objects)
                axes = ("time", dimension, *([f"component_of_{field.name}"] if field.components > 1 else []))
                taken = {*found, *coordinates, *(one for values in found.values() for one in np.atleast_1d(values[0]))}
                name = field.name
                while name in taken:
                    name += "_field"
                found[name] = axes, dask.field(filename_or_obj, field.name, times), {"units": field.unit}
            attributes = {"fps": animation.fps, **animation.metadata}
        dropped = {drop_variables} if isinstance(drop_variables, str) else set(drop_variables or ())
        data = Dataset(
            {name: one for name, one in found.items() if name not in dropped},
            {name: one for name, one in coordinates.items() if name not in dropped},
            attributes,
        )
        for variable in data.variables.values():
            if "time" in variable.dims and variable.chunks:
                variable.encoding["preferred_chunks"] = dict(zip(variable.dims, variable.chunks, strict=True))
        return data


def _rows(field: pdecodec.Field, objects: tuple[pdecodec.MeshObject, ...]) -> Any:
    """Return the numbers, among all elements of its domain, of the rows that a field of some objects has."""
    every = pdecodec.Field("", field.domain).slices(objects)
    return np.concatenate([np.arange(every[index].start, every[index].stop) for index in field.objects or ()])
