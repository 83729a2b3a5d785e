"""Leave out the cells of a sequence, for formats that cannot hold them; their surface stays."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from numpy.typing import NDArray

from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.runs import changed
from pdecodec.mesh.sequence import MeshSequence


def surface_of(sequence: MeshSequence, told: list[str]) -> MeshSequence:
    """Return a sequence without cells and their data; runs without cells and all vertices stay as they are.

    `told` gets a notice about the first run with cells, when that run is used.
    """

    def surface(run: MeshSequence) -> MeshSequence:
        count = sum(item.connectivity.cell_count for item in run.objects)
        if not count:
            return run
        names = [one.name for one in run.fields if one.domain == "cell"]
        names += dict.fromkeys(one.name for item in run.objects for one in item.attributes if one.domain == "cell")
        lost = f", without their data ({', '.join(names)})" if names else ""
        if not told:
            told.append(f"{count} cells are written as their surface{lost}")
        return SurfaceSequence(run)

    return changed(sequence, surface)


class SurfaceSequence(MeshSequence):
    """A sequence without the cells of another one."""

    def __init__(self, source: MeshSequence) -> None:
        self._source = source
        self.times, self.fps, self.metadata, self.notices = source.times, source.fps, source.metadata, source.notices
        self.fields = tuple(one for one in source.fields if one.domain != "cell")
        self.objects = tuple(
            replace(
                item,
                connectivity=item.connectivity.without_cells(),
                attributes=tuple(one for one in item.attributes if one.domain != "cell"),
            )
            for item in source.objects
        )

    def read_frames(self, start: int, stop: int) -> Float32Array:
        return self._source.read_frames(start, stop)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return self._source.read_field(field.name, start, stop)

    def close(self) -> None:
        self._source.close()
