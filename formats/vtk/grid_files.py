"""Represent the content of a VTK file, and read meshes from such files: as stored, or moved by vectors."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pdecodec.errors import InputError
from pdecodec.formats.base.frame_changes import NotKept
from pdecodec.formats.base.frame_data import DataKey, StoredData
from pdecodec.formats.base.frame_meshes import MeshFile, joined_meshes
from pdecodec.formats.vtk.cells import Cells, node_attribute
from pdecodec.formats.vtk.motion import choose_vectors, contents_of, motion_notices, moved, not_kept_data
from pdecodec.mesh.arrays import Int64Array
from pdecodec.mesh.fields import DTYPES
from pdecodec.mesh.sequence import Content, Fate, MeshObject

TIME = "TimeValue"
"""Name of the field data in which VTK stores the time of a data set."""


@dataclass(frozen=True)
class GridFile:
    """Content of one file.

    Attributes
    ----------
    mesh : MeshFile
        Without displacement.
    vectors : tuple of str
        Names of vectors with two or three real components on points.
    point_data, cell_data : tuple of str
        Names of all data.
    added : (vertices, components) array or None
        Values of the requested vectors.
    time : float or None
        Time stored in the file [s].
    field_data : tuple of str
        Names of data of the whole data set, except the time.
    """

    mesh: MeshFile
    vectors: tuple[str, ...] = ()
    point_data: tuple[str, ...] = ()
    cell_data: tuple[str, ...] = ()
    added: NDArray[np.generic] | None = field(default=None, compare=False)
    time: float | None = None
    field_data: tuple[str, ...] = ()


_KINDS_OF_DATA = {"vertex": "point data", "face": "cell data"}

Read = Callable[[Path, str | None], GridFile]
"""Reads a file, and the vectors of a given name if it has them; raises InputError."""


def is_vectors(values: NDArray[np.generic]) -> bool:
    """Return whether data are vectors with two or three real components."""
    return values.ndim == 2 and values.shape[1] in (2, 3) and values.dtype.kind == "f"


def grid_of_cells(
    points: NDArray[np.floating],
    cells: Cells,
    point_data: Mapping[str, NDArray[np.generic]],
    cell_data: Sequence[str],
    wanted: str | None,
    stored: Mapping[DataKey, StoredData],
    *,
    only_used: bool = False,
) -> GridFile:
    """Return the grid of cells at points (nodes, 3); `only_used` leaves out points without faces and lines.

    `stored` are data on all points and cells: "vertex" and "face" in their keys.
    """
    connectivity, gather = cells.connectivity(points, only_used=only_used)
    rows = {"vertex": gather, "face": cells.owners}
    data: dict[DataKey, StoredData] = {
        key: one if rows[key[0]] is None else one.gathered(rows[key[0]]) for key, one in stored.items()
    }
    if cells.has_cells:
        data = {("cell" if domain == "face" else domain, name): one for (domain, name), one in stored.items()}
    vectors = tuple(name for name, values in point_data.items() if is_vectors(values))
    added = point_data[wanted] if wanted in vectors and wanted is not None else None
    notices = cells.left_out_notices(gather, len(points))
    if any(domain == "face" for domain, _ in stored):
        notices += cells.inner_notice("cells", "cell data")
    if gather is None:
        mesh = MeshFile(points, connectivity, (), notices, data)
    else:
        mesh = MeshFile(points[gather], connectivity, (node_attribute(gather),), notices, data)
        added = None if added is None else gather_rows(added, gather, len(points))
    return GridFile(mesh, vectors, tuple(point_data), tuple(cell_data), added)


def gather_rows(values: NDArray[np.generic], gather: Int64Array, nodes: int) -> NDArray[np.generic]:
    """Return the rows of data at the kept points; data of another size are returned as they are, and refused later."""
    return values[gather] if len(values) == nodes else values


def joined_grids(grids: Sequence[GridFile]) -> GridFile:
    """Join grids to one, their points concatenated; it has the vectors that all of them have."""
    if len(grids) == 1:
        return grids[0]
    filled = [grid for grid in grids if len(grid.mesh.points)] or grids[:1]
    vectors = [name for name in filled[0].vectors if all(name in grid.vectors for grid in filled)]
    added = [grid.added for grid in filled]
    found = [one for one in added if one is not None]
    return GridFile(
        joined_meshes([grid.mesh for grid in grids]),
        tuple(vectors),
        tuple(dict.fromkeys(name for grid in grids for name in grid.point_data)),
        tuple(dict.fromkeys(name for grid in grids for name in grid.cell_data)),
        np.concatenate(found) if len(found) == len(filled) else None,
        next((grid.time for grid in grids if grid.time is not None), None),
        tuple(dict.fromkeys(name for grid in grids for name in grid.field_data)),
    )


class GridReader:
    """Reads the meshes of files, and records which data they have.

    Parameters
    ----------
    read : callable
        A :data:`Read`.
    asked : str or None
        The option ``displacement``.
    """

    def __init__(self, read: Read, asked: str | None) -> None:
        self._read, self._asked = read, asked
        self._is_chosen = False
        self._chosen: str | None = None
        self._vectors: tuple[str, ...] = ()
        self._fields: dict[str, dict[str, None]] = {"vertex": {}, "face": {}}
        self._others: dict[str, dict[str, None]] = {"vertex": {}, "face": {}}
        self._field_data: dict[str, None] = {}
        self._geometry: dict[Path, bytes] = {}
        self._times: dict[Path, float | None] = {}

    def __call__(self, path: Path) -> MeshFile:
        """Return the mesh of a file, moved by the vectors that were chosen from the first file."""
        if not path.exists():
            raise InputError("there is no such file; restore it", code="file-missing", path=path)
        grid = self._read(path, self._chosen)
        if not self._is_chosen:
            self._chosen = choose_vectors(grid.vectors, self._asked, path)
            self._vectors, self._is_chosen = grid.vectors, True
            if self._chosen is not None:
                grid = self._read(path, self._chosen)
        if path not in self._geometry:
            self._geometry[path] = hashlib.blake2b(np.ascontiguousarray(grid.mesh.points).tobytes()).digest()
        self._times[path] = grid.time
        has_faces = grid.mesh.connectivity.face_count > 0
        data = {key: one for key, one in grid.mesh.data.items() if key != ("vertex", self._chosen)
                if (key[0] != "face" or has_faces) and one.dtype in DTYPES and one.components}  # fmt: skip
        grid = replace(grid, mesh=replace(grid.mesh, data=data))
        for domain, names in (("vertex", grid.point_data), ("face", grid.cell_data)):
            for name in names:
                if domain == "face" or name != self._chosen:
                    is_kept = (domain, name) in data or (domain == "face" and ("cell", name) in data)
                    (self._fields if is_kept else self._others)[domain][name] = None
        self._field_data.update(dict.fromkeys(grid.field_data))
        if self._chosen is None or not len(grid.mesh.points):
            return grid.mesh
        if grid.added is None:
            raise InputError(f"has no vectors {self._chosen!r} on its points", code="object-missing", path=path)
        return replace(grid.mesh, points=moved(grid.mesh.points, grid.added, self._chosen, path))

    def times(self, frames: Sequence[Sequence[Path]]) -> list[float] | None:
        """Return the times [s] that are stored in the files of frames; None unless all have one and they increase."""
        found = [self._times.get(files[0]) for files in frames]
        times = [time for time in found if time is not None and math.isfinite(time)]
        is_whole = len(times) == len(frames) and all(a < b for a, b in pairwise(times))
        return times if is_whole else None

    def time_notices(self, frames: Sequence[Sequence[Path]]) -> tuple[str, ...]:
        """Return a notice that explains why stored times are not kept, if any file has one."""
        if self.times(frames) is not None or all(self._times.get(files[0]) is None for files in frames):
            return ()
        return (f"times of the files ({TIME}) are not kept: not every file has one, or they do not increase",)

    def notices(self, frames: Sequence[Sequence[Path]]) -> tuple[str, ...]:
        """Return notices about the files of frames: what moves the mesh, and which data are not kept."""
        geometry = {tuple(self._geometry.get(path, b"") for path in files) for files in frames}
        moves = len(frames) < 2 or len(geometry) > 1
        return (
            *motion_notices(self._chosen, self._vectors, self._asked, moves=moves),
            *not_kept_data(self._lost()),
        )

    def contents(
        self, frames: Sequence[Sequence[Path]], objects: Sequence[MeshObject], notices: Sequence[str]
    ) -> tuple[Content, ...]:
        """List what the files of frames hold; lines of `notices` name data that cannot be fields."""
        uneven = {name for line in notices if isinstance(line, NotKept) for name in line.names}
        kept = {
            kind: [name for name in self._fields[domain] if name not in uneven]
            for domain, kind in _KINDS_OF_DATA.items()
        }
        kept["point data"] += [] if self._chosen is None else [self._chosen]
        has_times = any(time is not None for time in self._times.values())
        lost = {kind: [*self._lost()[kind], *(name for name in self._fields[domain] if name in uneven)]
                for domain, kind in _KINDS_OF_DATA.items()} | {"field data": list(self._field_data)}  # fmt: skip
        times: Fate = "dropped" if self.time_notices(frames) else "coded"
        return (
            *contents_of(objects, kept, lost),
            *[Content(f"/field data/{TIME}", "field data", times)] * has_times,
        )

    def _lost(self) -> dict[str, Iterable[str]]:
        others = {
            kind: [name for name in self._others[domain] if name not in self._fields[domain]]
            for domain, kind in _KINDS_OF_DATA.items()
        }
        return {**others, "field data": self._field_data}
