"""Read the motion of meshes from `.pdeanim` files in buffer views: the extension PDECODEC_mesh_motion.

`spec/extension` describes it.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.codec.container import IDENTIFIER
from pdecodec.codec.decoder import Animation
from pdecodec.codec.opening import open_animation
from pdecodec.errors import CorruptFileError, damaged
from pdecodec.formats.base.times import FLOAT32_ROUNDING, SAME_TIME
from pdecodec.formats.gltf.file import GltfFile
from pdecodec.formats.gltf.types import MESH_MOTION
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int64Array

EVALUATED_BYTES = 2**26
"""Bytes of positions of a motion that are evaluated at once: a primitive may need few vertices of a large one."""

DURATION_SLACK = 1e-6
"""Largest difference between the stated duration and that of the file [s]."""


class StoredMotion:
    """A motion that a glTF file holds.

    Attributes
    ----------
    entry : mapping
        Its object in the extension.
    coded : Animation
    times : (frames,) float64 [s]
        Times of its frames in the glTF animation.
    offset : float [s]
        What added to a time of the glTF animation gives the time of the `.pdeanim` file.
    """

    def __init__(self, entry: Mapping[str, Any], coded: Animation) -> None:
        self.entry, self.coded = entry, coded
        self.offset = float(coded.times[0]) - float(entry.get("startTime", 0))
        self.times: Float64Array = coded.times - self.offset
        self._read: tuple[bytes, Float32Array] | None = None

    def positions(self, times: Float64Array, numbers: Int64Array) -> Float32Array:
        """Return positions (times, n, 3) of some vertices (n,) at times of the glTF animation."""
        # A time that differs from that of a frame only by rounding is the frame's.
        after = np.clip(np.searchsorted(self.times, times), 0, self.times.size - 1)
        before = np.maximum(after - 1, 0)
        is_nearer = np.abs(self.times[before] - times) < np.abs(self.times[after] - times)
        nearest = np.where(is_nearer, before, after)
        is_frame = np.abs(self.times[nearest] - times) <= FLOAT32_ROUNDING * np.abs(times) + SAME_TIME
        exact = np.where(is_frame, self.coded.times[nearest], times + self.offset)
        # The meshes of a scene ask for the same times in turn.
        if self._read is None or self._read[0] != exact.tobytes():
            self._read = exact.tobytes(), self.coded.positions(exact)
        return self._read[1][:, numbers]

    @property
    def times_at_once(self) -> int:
        """Number of times at which positions may be asked for at once."""
        return max(1, EVALUATED_BYTES // (12 * self.coded.vertex_count))


class StoredMotions:
    """The motions of a file, opened when a mesh needs them."""

    def __init__(self, file: GltfFile, path: Path) -> None:
        self._file, self._path = file, path
        self.entries: list[Mapping[str, Any]] = file.root.get("extensions", {}).get(MESH_MOTION, {}).get("motions", [])
        self._opened: dict[int, StoredMotion] = {}

    @property
    def alone(self) -> list[int]:
        """The motions that are animations of their own."""
        return [index for index, one in enumerate(self.entries) if "animation" not in one]

    def playing(self, clip: int) -> list[int]:
        """Return the motions that are part of an animation."""
        return [index for index, one in enumerate(self.entries) if one.get("animation") == clip]

    def of(self, index: int) -> StoredMotion:
        """Return a motion; InputError if it is missing, or is not a `.pdeanim` file with one connectivity.

        CorruptFileError or LimitError if that file is damaged or asks for more memory than allowed.
        """
        if index not in self._opened:
            if index >= len(self.entries):
                raise damaged(f"motion {index} is missing; export the file again")
            entry = self.entries[index]
            animations = self._file.listed("animations")
            if "bufferView" not in entry or entry.get("animation", -1) >= len(animations):
                raise damaged(
                    f"motion {index} names a buffer view or an animation that is missing; export the file again"
                )
            data = self._file.view_bytes(entry["bufferView"])
            if not data.startswith(IDENTIFIER):
                raise damaged(f"motion {index} is no .pdeanim file; export the file again")
            with self._naming(index):
                coded = open_animation(data)
            if len(coded.runs) > 1:
                raise damaged(f"motion {index} has faces that change, which no mesh of glTF has; export the file again")
            span = float(coded.times[-1] - coded.times[0])
            stated = float(entry.get("duration", np.nan))
            if not abs(span - stated) <= DURATION_SLACK:
                raise damaged(
                    f"motion {index} states {stated:g} s, and its .pdeanim file lasts {span:g} s; export the file again"
                )
            if entry.get("startTime", 0) < 0:
                raise damaged(f"motion {index} starts at {entry['startTime']:g} s, before 0 s; export the file again")
            self._opened[index] = StoredMotion(entry, coded)
        return self._opened[index]

    def vertices(self, own: Mapping[str, Any], rows: int) -> Int64Array:
        """Return the vertex of the motion (rows,) for each row of a primitive with this extension object."""
        first, count = own.get("firstVertex", 0), self.of(own["motion"]).coded.vertex_count
        numbers = np.arange(rows, dtype=np.int64)
        if "vertexMap" in own:
            values = self._file.accessor(own["vertexMap"])
            if values.shape != (rows,) or values.dtype.kind != "u":
                raise ValueError(
                    f"the map to its motion has the shape {values.shape}, and {rows} vertices need one each"
                )
            numbers = values.astype(np.int64)
        if rows and first + int(numbers.max()) >= count:
            raise ValueError(f"it needs vertex {first + int(numbers.max())} of its motion, which has {count} vertices")
        found: Int64Array = first + numbers
        return found

    def positions(self, index: int, times: Float64Array, numbers: Int64Array) -> Float32Array:
        """Return positions (times, n, 3) of vertices (n,) of a motion."""
        with self._naming(index):
            return self.of(index).positions(times, numbers)

    @contextmanager
    def _naming(self, index: int) -> Iterator[None]:
        """Name the motion in errors of its `.pdeanim` file."""
        try:
            yield
        except CorruptFileError as error:
            told = {"message": f"motion {index}: {error.message}", "path": self._path}
            raise type(error)(**error.fields() | told) from error


def drop_motions(root: dict[str, Any], meshes: Collection[int]) -> list[int]:
    """Drop motions from the JSON of a file if only these meshes use them; return their buffer views."""
    using = {
        index
        for index, mesh in enumerate(root.get("meshes", ()))
        if any(MESH_MOTION in one.get("extensions", {}) for one in mesh.get("primitives", ()))
    }
    if MESH_MOTION not in root.get("extensions", {}) or not using <= set(meshes):
        return []
    dropped = root["extensions"].pop(MESH_MOTION)
    holders = [root, *(one for index in using for one in root["meshes"][index]["primitives"])]
    for one in holders:
        one.get("extensions", {}).pop(MESH_MOTION, None)
        if not one.get("extensions", True):
            del one["extensions"]
    for kind in ("extensionsUsed", "extensionsRequired"):
        if MESH_MOTION in root.get(kind, ()):
            root[kind] = [name for name in root[kind] if name != MESH_MOTION]
            if not root[kind]:
                del root[kind]
    return [one["bufferView"] for one in dropped.get("motions", ()) if "bufferView" in one]
