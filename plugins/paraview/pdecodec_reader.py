"""Read `.pdeanim` files in VTK and ParaView: a reader for VTK's pipeline, which is a ParaView plug-in as it stands.

In ParaView: Tools > Manage Plugins > Load New, and choose this file. The other files of the folder are no plug-ins:
leave the folder out of ``PV_PLUGIN_PATH``.
"""

# ruff: noqa: N802 - VTK and ParaView call methods by their names
from __future__ import annotations

import os
import sys
from typing import Any
from weakref import finalize

from vtkmodules.util.vtkAlgorithm import VTKPythonAlgorithmBase
from vtkmodules.vtkCommonCore import vtkDataArraySelection, vtkOutputWindow
from vtkmodules.vtkCommonDataModel import vtkCompositeDataSet, vtkDataObject, vtkMultiBlockDataSet
from vtkmodules.vtkCommonExecutionModel import vtkAlgorithm, vtkStreamingDemandDrivenPipeline

import pdecodec
from pdecodec.paraview.vtk_blocks import RunBlocks


class _Undecorated:
    """Stands for ParaView's decorators where there is no ParaView."""

    def __getattr__(self, name: str) -> Any:
        return lambda *_, **__: lambda decorated: decorated


if "paraview" in sys.modules:  # where both are installed, importing it next to another VTK ends the process
    from paraview.util.vtkAlgorithm import smdomain, smhint, smproperty, smproxy
else:
    smdomain = smhint = smproperty = smproxy = _Undecorated()

NAME, EXTENSION = "pdecodec animation", "pdeanim"

SWITCH = """
<IntVectorProperty name="Velocity" command="SetVelocity" number_of_elements="1" default_values="0">
  <BooleanDomain name="bool"/>
  <Documentation>Add the derivative of the positions as point data [scene units / s].</Documentation>
</IntVectorProperty>"""


@smproxy.reader(name="PdecodecReader", label="Pdecodec Reader", extensions=EXTENSION, file_description=NAME)
class PdecodecReader(VTKPythonAlgorithmBase):
    """Give the objects of a `.pdeanim` file at any time as the blocks of a multiblock data set.

    Time steps are the frames; any time between them may be asked for. Objects with solids are unstructured grids,
    others are polygons and lines. Fields on vertices are point data, those on faces or cells cell data, those of
    objects field data.

    Attributes
    ----------
    error : PdecodecError or None
        Why the last request failed.
    """

    def __init__(self) -> None:
        super().__init__(nInputPorts=0, nOutputPorts=1, outputType="vtkMultiBlockDataSet")
        self._path, self._velocity = "", False
        # The animation, its blocks and what identifies its file. VTK keeps some readers until after the interpreter's
        # end, which must find files closed.
        self._open: dict[str, Any] = {}
        finalize(self, _close, self._open)
        self._selection = vtkDataArraySelection()
        self._selection.SetUnknownArraySetting(1)  # fields that only later runs of frames have
        self._selection.AddObserver("ModifiedEvent", lambda *_: self.Modified())
        self.error: pdecodec.PdecodecError | None = None

    @smproperty.stringvector(name="FileName")
    @smdomain.filelist()
    @smhint.filechooser(extensions=EXTENSION, file_description=NAME)
    def SetFileName(self, path: str | None) -> None:
        """Set the path of the file."""
        if self._path != (path or ""):
            self._path = path or ""
            self.Modified()

    def GetFileName(self) -> str:
        """Return the path of the file."""
        return self._path

    @smproperty.doublevector(name="TimestepValues", information_only="1", si_class="vtkSITimeStepsProperty")
    def GetTimestepValues(self) -> list[float]:
        """Return the times of the frames [s]; an empty list if the file cannot be opened."""
        return self.animation.times.tolist() if self._opened() else []

    @smproperty.dataarrayselection(name="Fields")
    def GetFields(self) -> Any:
        """Return the selection of fields; all are selected at first."""
        if self._path:
            self._opened()
        return self._selection

    @smproperty.xml(SWITCH)
    def SetVelocity(self, wanted: bool | int) -> None:
        """Choose whether the output has the derivative of the positions as point data."""
        if self._velocity != bool(wanted):
            self._velocity = bool(wanted)
            self.Modified()

    def GetVelocity(self) -> bool:
        """Return whether the output has the derivative of the positions."""
        return self._velocity

    @property
    def animation(self) -> Any:
        """The open file, a :class:`pdecodec.Animation`; None before a request."""
        return self._open.get("animation")

    def close(self) -> None:
        """Close the file; the next request opens it again."""
        _close(self._open)

    def RequestInformation(self, request: Any, inputs: Any, outputs: Any) -> int:
        """State the times of the frames."""
        if not self._opened():
            return 0
        information, pipeline = outputs.GetInformationObject(0), vtkStreamingDemandDrivenPipeline
        times = self.animation.times.tolist()
        information.Set(pipeline.TIME_STEPS(), times, len(times))
        information.Set(pipeline.TIME_RANGE(), [times[0], times[-1]], 2)
        information.Set(vtkAlgorithm.CAN_HANDLE_PIECE_REQUEST(), 1)
        return 1

    def RequestData(self, request: Any, inputs: Any, outputs: Any) -> int:
        """Fill the output with the objects at the time that is asked for, clamped to the clip."""
        if not self._opened():
            return 0
        information, pipeline = outputs.GetInformationObject(0), vtkStreamingDemandDrivenPipeline
        times = self.animation.times
        key = pipeline.UPDATE_TIME_STEP()
        time = float(min(max(information.Get(key) if information.Has(key) else times[0], times[0]), times[-1]))
        # Several processes share the objects.
        piece, pieces = (
            information.Get(key()) if information.Has(key()) else usual
            for key, usual in ((pipeline.UPDATE_PIECE_NUMBER, 0), (pipeline.UPDATE_NUMBER_OF_PIECES, 1))
        )
        try:
            self._fill(vtkMultiBlockDataSet.GetData(outputs, 0), time, slice(piece, None, pieces))
        except pdecodec.PdecodecError as error:
            return self._failed(error)
        return 1

    def _fill(self, output: Any, time: float, owned: slice) -> None:
        run = self.animation.run_at(time)
        blocks = self._open.get("blocks")
        if blocks is None or blocks.run is not run:
            blocks = self._open["blocks"] = RunBlocks(run)
        output.SetNumberOfBlocks(len(blocks.names))
        chosen = {one.name for one in run.fields if self._selection.ArrayIsEnabled(one.name)}
        for index, data in blocks.at(time, chosen, velocity=self._velocity, owned=owned):
            output.SetBlock(index, data)
        for index, name in enumerate(blocks.names):
            output.GetMetaData(index).Set(vtkCompositeDataSet.NAME(), name)
        output.GetInformation().Set(vtkDataObject.DATA_TIME_STEP(), time)

    def _opened(self) -> bool:
        """Open the file if it has changed since it was opened; return False and keep the error if that fails."""
        try:
            status = os.stat(self._path) if os.path.exists(self._path) else None
            stamp = status and (self._path, status.st_size, status.st_mtime_ns, status.st_ino)
            if self.animation is None or stamp != self._open["stamp"]:
                self.close()
                self._open.update(stamp=stamp, animation=pdecodec.open_animation(self._path))
                for field in self.animation.runs[0].fields:
                    self._selection.AddArray(field.name)
        except pdecodec.PdecodecError as error:
            return bool(self._failed(error))
        self.error = None
        return True

    def _failed(self, error: pdecodec.PdecodecError) -> int:
        self.error = error
        vtkOutputWindow.GetInstance().DisplayErrorText(f"{error}\n")
        return 0


def _close(opened: dict[str, Any]) -> None:
    animation = opened.pop("animation", None)
    if animation is not None:
        animation.close()
    opened.clear()
