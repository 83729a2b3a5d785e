"""A scene, and a simulation of it as a mesh sequence."""

from __future__ import annotations

import math
import tempfile
import weakref
from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial
from itertools import accumulate
from typing import IO

import numpy as np

from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float32Array, Float64Array, Int32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence, check_frame_range
from pdecodec.mesh.times import DEFAULT_FPS
from pdecodec.simulate.constraints import Method
from pdecodec.simulate.quantities import solver_fields, solver_values
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.system import System

MAX_SUBSTEPS = 100_000
"""Largest number of substeps per frame; more is a typing error."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Scene:
    """A system, its visible part, and how finely to simulate it.

    Parameters
    ----------
    name : str
    system : System
    visible : (vertices,) int32
        Particle of each vertex of the mesh.
    faces : (faces, 3 or 4) int32
        Over the vertices, not over the particles.
    substeps : int
        Substeps per frame at 24 frames per second with which the scene looks right at one iteration.
    frames : int
        Default number of frames.
    """

    name: str
    system: System
    visible: Int32Array
    faces: Int32Array
    substeps: int = 20
    frames: int = 100

    def simulate(
        self,
        *,
        frames: int | None = None,
        fps: float = DEFAULT_FPS,
        substeps: int | None = None,
        iterations: int = 1,
        method: Method = "xpbd",
        fields: bool = False,
    ) -> Simulation:
        """Return a mesh sequence that simulates while it is read.

        Parameters
        ----------
        frames : int, optional
            Frame 0 is the initial state. Default: the scene's own.
        fps : float [1/s]
        substeps : int, optional
            Substeps per frame. Default: the scene's own, with the same length in seconds at another frame rate.
        iterations : int
            Sweeps over all constraints in each substep.
        method : {"xpbd", "pbd"}
        fields : bool
            Whether the sequence has the solver's quantities as fields: velocities, elastic energies and Lagrange
            multipliers (:mod:`pdecodec.simulate.quantities`).
        """
        frames = self.frames if frames is None else frames
        if frames < 1:
            raise SettingsError(f"must be 1 or more, not {frames}", setting="frames")
        if not (math.isfinite(fps) and fps > 0):
            raise SettingsError(f"must be a positive number, not {fps}", setting="fps")
        if substeps is None:
            substeps = math.ceil(self.substeps * DEFAULT_FPS / fps)
        if not 1 <= substeps <= MAX_SUBSTEPS:
            raise SettingsError(f"must be 1 to {MAX_SUBSTEPS}, not {substeps}", setting="substeps")
        return Simulation(
            self, frames=frames, fps=fps, substeps=substeps, iterations=iterations, method=method, fields=fields
        )


class Simulation(MeshSequence):
    """Frames of a scene, computed when they are read.

    Each frame follows from the one before. Reading forwards costs one simulation, however it is divided into blocks.
    Reading an earlier frame starts again from the initial state and gives the same bits. Use :meth:`to_array` to
    keep frames that fit in memory. Fields of frames that were read go to a temporary file, so that reading them after
    the positions does not simulate again.

    Attributes
    ----------
    solver : Solver
        At the frame that was read last, for measurements.
    """

    def __init__(
        self, scene: Scene, *, frames: int, fps: float, substeps: int, iterations: int, method: Method, fields: bool
    ) -> None:
        self.scene = scene
        self.objects = (MeshObject(scene.name, Connectivity.from_padded(scene.visible.size, scene.faces)),)
        self.times: Float64Array = np.arange(frames) / fps
        self.fps = float(fps)
        self.metadata: Mapping[str, str] = {
            "source": f"pdecodec simulate {scene.name}, {method}, {substeps} substeps, {iterations} iterations",
            "up_axis": "Y",
            "unit": "m",
        }
        self.notices = ()
        self._substeps = substeps
        substep = 1 / (self.fps * substeps)
        self._new_solver = partial(Solver, scene.system, substep=substep, iterations=iterations, method=method)
        self._restart()
        if fields:
            self.fields = solver_fields(scene.system, method)
            self._columns = [*accumulate((field.components for field in self.fields), initial=0)]
            self._frame_bytes = 4 * self._columns[-1] * self.vertex_count
            self._kept: IO[bytes] = tempfile.TemporaryFile()  # noqa: SIM115 - closed at the end
            weakref.finalize(self, self._kept.close)
            self._is_kept = np.zeros(frames, bool)

    def _restart(self) -> None:
        self.solver = self._new_solver()
        self._frame = 0

    def read_frames(self, start: int, stop: int) -> Float32Array:
        """Return positions of frames ``start`` to ``stop - 1``; raise SettingsError if too long substeps made
        them infinite.
        """
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        if start < stop and start < self._frame:
            self._restart()
        for frame in range(start, stop):
            # Overflow is found below and reported with its frame.
            with np.errstate(over="ignore", invalid="ignore"):
                self.solver.advance((frame - self._frame) * self._substeps)
                self._frame = frame
                points[frame - start] = self.solver.positions[self.scene.visible]
            if not np.isfinite(points[frame - start]).all():
                raise SettingsError("the simulation ran off to infinity; give it more substeps", frame=frame)
            if self.fields and not self._is_kept[frame]:
                self._kept.seek(frame * self._frame_bytes)
                self._kept.write(solver_values(self.solver)[self.scene.visible].data)
                self._is_kept[frame] = True
        return points

    def _field_values(self, field: Field, start: int, stop: int) -> Float32Array:
        if not self._is_kept[start:stop].all():
            self.read_frames(start, stop)
        self._kept.seek(start * self._frame_bytes)
        values = np.frombuffer(self._kept.read((stop - start) * self._frame_bytes), np.float32)
        number = self.fields.index(field)
        columns = slice(*self._columns[number : number + 2])
        return values.reshape(stop - start, self.vertex_count, self._columns[-1])[..., columns].reshape(
            field.shape(stop - start, self.objects)
        )
