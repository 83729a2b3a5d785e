"""Read `.pdeanim` files in PyVista, which finds this reader by the entry point ``pyvista.readers`` (0.49 or later)."""

from __future__ import annotations

from typing import Any

import pyvista
from pyvista.core.utilities.reader import TimeReader

from pdecodec.paraview.pdecodec_reader import PdecodecReader


class PdeanimReader(pyvista.BaseReader, TimeReader):
    """Read the objects of a `.pdeanim` file as the blocks of a :class:`pyvista.MultiBlock`, at any time.

    Returned by :func:`pyvista.get_reader`. Raises :class:`pdecodec.PdecodecError` if the file cannot be read.

    Parameters
    ----------
    path : path
    """

    _class_reader = PdecodecReader
    _output_types = (pyvista.MultiBlock,)

    def _set_defaults(self) -> None:
        self._time: float | None = None

    def _update_information(self) -> None:
        self.reader.UpdateInformation()
        self._check()

    def _check(self) -> None:
        if self.reader.error is not None:
            raise self.reader.error

    def _times(self) -> list[float]:
        times: list[float] = self.reader.GetTimestepValues()
        self._check()
        return times

    def read(self, *, validate: bool | None = None) -> Any:
        """Return the objects at the active time.

        Returns
        -------
        pyvista.MultiBlock
            A block for each object, by name: polygons and lines, or an unstructured grid if it has solids.

        Raises
        ------
        PdecodecError
            If the file is damaged or asks for more memory than is allowed.
        """
        self.reader.UpdateTimeStep(self.active_time_value)
        self._check()
        return pyvista.wrap(self.reader.GetOutputDataObject(0), validate=validate)

    @property
    def fields(self) -> list[str]:
        """Names of the fields to read; all of the file's at first."""
        selection = self.reader.GetFields()
        names = [selection.GetArrayName(index) for index in range(selection.GetNumberOfArrays())]
        return [name for name in names if selection.ArrayIsEnabled(name)]

    @fields.setter
    def fields(self, names: list[str]) -> None:
        selection = self.reader.GetFields()
        self._check()
        for name in names:
            self.reader.animation.runs[0].field_named(name)
        selection.DisableAllArrays()
        for name in names:
            selection.EnableArray(name)

    @property
    def velocity(self) -> bool:
        """Whether to add the derivative of the positions as point data ``velocity`` [scene units / s]."""
        return bool(self.reader.GetVelocity())

    @velocity.setter
    def velocity(self, wanted: bool) -> None:
        self.reader.SetVelocity(wanted)

    @property
    def number_time_points(self) -> int:
        """Number of frames."""
        return len(self._times())

    def time_point_value(self, time_point: int) -> float:
        """Return the time of a frame [s]."""
        return float(self._times()[time_point])

    @property
    def active_time_value(self) -> float:
        """The time to read [s]; at first that of the first frame."""
        return self.time_point_value(0) if self._time is None else self._time

    @active_time_value.setter
    def active_time_value(self, time_value: float) -> None:
        self.set_active_time_value(time_value)

    def set_active_time_value(self, time_value: float) -> None:
        """Set the time to read [s]: any, clamped to the clip."""
        self._time = float(time_value)

    def set_active_time_point(self, time_point: int) -> None:
        """Set the frame to read."""
        self._time = self.time_point_value(time_point)
