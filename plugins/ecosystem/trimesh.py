"""Load `.pdeanim` files in trimesh, which has no entry points: importing this module registers the format.

>>> import trimesh, pdecodec.ecosystem.trimesh
>>> scene = trimesh.load_scene("walk.pdeanim", time=0.5)
"""

from __future__ import annotations

from collections import Counter
from typing import Any, BinaryIO

import numpy as np
from numpy.typing import NDArray
from trimesh.exchange.load import mesh_loaders

import pdecodec


def load(file_obj: BinaryIO, file_type: str | None = None, *, time: float | None = None, **_: Any) -> dict[str, Any]:
    """Return the objects of a `.pdeanim` file at one time, as arguments of a :class:`trimesh.Scene`.

    The second object of one name is ``NAME_2``. Vertices keep their order; faces of more than three corners
    become fans of triangles, of which the face attribute ``face`` names the face. Objects without faces are clouds of
    points. Fields on vertices and faces are vertex and face attributes, those of clouds their metadata.

    Parameters
    ----------
    file_obj : binary file
        Open for reading.
    file_type : str, optional
        Not used: all loaders are called with it.
    time : float, optional [s]
        Any time within the clip. Default: that of the first frame.

    Raises
    ------
    PdecodecError
        If the file cannot be read.
    """
    with pdecodec.open_animation(file_obj) as animation:
        at = float(animation.times[0] if time is None else time)
        run: Any = pdecodec.bake_transforms(animation.run_at(at))
        positions, start, geometry, repeats = run.positions(at), 0, {}, Counter[str]()
        fields = [(one, run.field(one.name, at)) for one in run.fields if one.domain in ("vertex", "face")]
        for index, item in enumerate(run.objects):
            found: dict[str, Any] = {"vertices": positions[start : start + item.vertex_count]}
            start += item.vertex_count
            triangles, faces = _fans(item.connectivity)
            data: dict[str, Any] = {"vertex": {}, "face": {"face": faces}}
            for field, values in fields:
                own, name = values[field.slices(run.objects)[index]], field.name
                while name in data[field.domain]:
                    name += "_field"
                if len(own):
                    data[field.domain][name] = own[faces] if field.domain == "face" else own
            if item.connectivity.face_count:
                found |= {"faces": triangles, "process": False}
                found |= {"vertex_attributes": data["vertex"], "face_attributes": data["face"]}
            else:
                found["metadata"] = data["vertex"]
            name = item.name
            while name in geometry:
                repeats[item.name] += 1
                name = f"{item.name}_{repeats[item.name] + 1}"
            geometry[name] = found
        metadata = {**animation.metadata, "time": at}
    nodes = [{"frame_to": name, "geometry": name} for name in geometry]
    return {"geometry": geometry, "graph": nodes, "metadata": metadata}


def _fans(mesh: pdecodec.Connectivity) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Return the triangles (n, 3) of the fans that polygons become, and the face of each."""
    triangles = mesh.face_counts.astype(np.int64) - 2
    faces = np.repeat(np.arange(mesh.face_count), triangles)
    first = (np.cumsum(mesh.face_counts, dtype=np.int64) - mesh.face_counts)[faces]
    place = np.arange(faces.size) - (np.cumsum(triangles) - triangles)[faces]
    corners = mesh.face_indices.astype(np.int64)
    return np.stack([corners[first], corners[first + place + 1], corners[first + place + 2]], axis=1), faces


mesh_loaders["pdeanim"] = load
