"""Read USD stages on request: meshes, curves and points, with UsdSkel, blend shapes and transforms applied.

There is a frame at every time code at which anything in the scene is sampled. If transforms or skeletons do not move
in straight lines, there are also frames between these at the stage's frame rate. On request, frames are at a given
rate instead. At frames without a sample, USD interpolates.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from pdecodec.errors import InputError
from pdecodec.formats.base.registry import Transforms
from pdecodec.formats.base.scene_reading import Refusals, SceneFacts, SceneSequence, runs_of_scene
from pdecodec.formats.base.times import (
    Timing,
    codes_of,
    merged_times,
    rate_or_default,
    resampled,
    snapped_times,
    without_gaps,
)
from pdecodec.formats.usd.composition import check_composition, check_rates, stage_errors
from pdecodec.formats.usd.instances import placed_in_scene
from pdecodec.formats.usd.inventory import Inventory
from pdecodec.formats.usd.layers import open_stage
from pdecodec.formats.usd.metadata import SAMPLED, read_metadata
from pdecodec.formats.usd.shapes import ShapeScan, UsdShape
from pdecodec.formats.usd.time_codes import TimeCodes
from pdecodec.formats.usd.walk import shapes_again, shapes_of
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import to_float32
from pdecodec.mesh.sequence import MeshSequence


def open_usd(
    path: Path, *, fps: float | None, transforms: Transforms = "bake", skip_unsupported: bool = False
) -> MeshSequence:
    """Open the geometry of a USD stage; in runs of frames if faces, or the set of points, change.

    With `fps`, frames are at that rate from the first sample to the last; if the stage does not state its time codes
    per second, `fps` is taken for that instead.

    Raises
    ------
    InputError
        If it is not a USD file, or holds no geometry.
    """
    with stage_errors(path):
        stage = open_stage(path)
        check_rates(stage)
        scan = ShapeScan(Refusals(skip=skip_unsupported))
        absent = check_composition(stage, scan.refusals)
        shapes = shapes_of(stage, scan)
        inventory = Inventory(stage, shapes, scan.refusals)
        if not shapes:
            scan.refusals.others.update(inventory.others)
        told = scan.refusals.notices(shapes, inventory.left_out())
        codes, (times, rate, time_notices) = _timing(stage, shapes, fps)
        notices = (*inventory.lost_textures(), *time_notices, *absent, *told)
        metadata = read_metadata(stage, times, _codes_per_second(stage, fps))
    facts = SceneFacts(path=path, transforms=transforms, metadata=metadata, unsupported=tuple(scan.refusals.found))

    def shapes_from(first: int) -> Sequence[UsdShape]:
        with stage_errors(path):
            again = ShapeScan(Refusals(skip=skip_unsupported), float(codes[first]), scan.changes)
            return shapes_again(shapes, again) if scan.changes else shapes

    def open_run(first: int, own: Timing) -> MeshSequence:
        found = shapes_from(first)
        with stage_errors(path):
            return UsdSequence(stage, codes[first : first + own[0].size], facts, found, own, first)

    def vertices_from(first: int) -> int:
        return sum(shape.connectivity.vertex_count for shape in shapes_from(first))

    per_second = _codes_per_second(stage, fps)
    changes = [np.asarray(one) / per_second for one in scan.changes.values()]
    sequence = runs_of_scene(times, changes, (times, rate, notices), open_run, vertices_from)
    sequence.list_contents = inventory.contents
    return sequence


def inventory_of(path: Path) -> Inventory:
    """Return everything that a USD file holds, and what happens to it if unreadable shapes are left out."""
    with stage_errors(path):
        stage = open_stage(path)
        scan = ShapeScan(Refusals(skip=True))
        return Inventory(stage, shapes_of(stage, scan), scan.refusals)


class UsdSequence(SceneSequence):
    """Frames of one connectivity of a USD stage, which stays open until :meth:`close`."""

    def __init__(
        self,
        stage: Any,
        codes: Float64Array,
        facts: SceneFacts,
        shapes: Sequence[UsdShape],
        timing: Timing,
        first_frame: int,
    ) -> None:
        self._stage, self._codes = stage, codes
        self._begin(facts, shapes, timing, first_frame)

    def _matrices(self, shape: UsdShape, start: int, stop: int) -> Float64Array:
        instances, prim = shape.instances, shape.placed_by
        return _placed_at(self._codes[start:stop], lambda cache: placed_in_scene(instances, prim, cache))

    def _field_times(self, start: int, stop: int) -> Sequence[float]:
        return [float(code) for code in self._codes[start:stop]]

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        with stage_errors(self._path):
            return super()._field_values(field, start, stop)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        with stage_errors(self._path):
            return super().read_frames(start, stop)

    def _read(self, shape: UsdShape, start: int, stop: int, out: Float32Array) -> None:
        for row, code in enumerate(self._codes[start:stop].tolist()):
            stored = shape.points.Get(shape.code_within(code))
            if stored is None:
                raise InputError(
                    f"the points of {shape.prim.GetPath()} have no value at time code {code:g} (blocked); "
                    "give them a sample there",
                    path=self._path,
                    frame=self._first_frame + start + row,
                    code="unsupported-feature",
                )
            points = to_float32(np.asarray(stored).reshape(-1, 3))
            if shape.skinning is not None:
                points = shape.skinning.deform(points, code)
            out[row] = shape.fitted(points, self._path, self._first_frame + start + row)

    @property
    def stage(self) -> Any:
        """The stage, which stays open with the sequence."""
        return self._stage

    @property
    def root_layer(self) -> Any:
        """The root layer of the stage."""
        return self._stage.GetRootLayer()

    @property
    def layers(self) -> list[Any]:
        """All layers that the stage uses."""
        return list(self._stage.GetUsedLayers())

    def prim_matrices(self, prim: Any, times: Float64Array) -> Float64Array:
        """Return the matrices (times, 4, 4) from a prim's space to the scene's at times [s], for points that
        are rows.
        """
        codes = codes_of(times, self._stage.GetTimeCodesPerSecond())
        return _placed_at(codes, lambda cache: cache.GetLocalToWorldTransform(prim))

    def close(self) -> None:
        # The stage closes when nothing refers to it any more.
        self._shapes = []
        self._stage = None


def _placed_at(codes: Float64Array, place: Callable[[Any], Any]) -> Float64Array:
    """Return the matrices (codes, 4, 4) that `place` returns for a cache of transforms at each time code."""
    cache, found = UsdGeom.XformCache(), []
    for code in codes.tolist():
        cache.SetTime(Usd.TimeCode(code))
        found.append(np.array(place(cache), np.float64))
    return np.array(found, np.float64).reshape(-1, 4, 4)


def _states_rate(stage: Any) -> bool:
    """Return whether a stage states its time codes per second.

    If no layer states a rate, the caller may give one. If a layer below the root states one, USD has already scaled
    its time codes to those of the stage, 24 per second unless the root states another rate.
    """
    return any(layer.HasTimeCodesPerSecond() or layer.HasFramesPerSecond() for layer in stage.GetUsedLayers())


def _codes_per_second(stage: Any, fps: float | None) -> float:
    says = _states_rate(stage)
    return rate_or_default(stage.GetTimeCodesPerSecond() if says else None, None if says else fps)[0]


def _timing(stage: Any, shapes: Sequence[UsdShape], fps: float | None) -> tuple[Float64Array, Timing]:
    """Return the time codes of the frames, and their times."""
    says = _states_rate(stage)
    rate = stage.GetTimeCodesPerSecond() if says else None
    per_second, notices = rate_or_default(rate, None if says else fps)
    nominal = float(stage.GetFramesPerSecond()) if stage.HasAuthoredMetadata("framesPerSecond") else per_second
    if says and fps is not None:
        nominal, notices = rate_or_default(nominal, fps)
    found = TimeCodes(shapes)
    straight, curved = ([codes / per_second for codes in lists] for lists in (found.straight, found.curved))
    if not straight and not curved:
        code = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
        return np.array([code]), (np.array([code / per_second]), nominal, notices if says else ())
    stored = merged_times(straight + curved)
    if says and fps is not None:
        times, notices = resampled(stored, fps)
    else:
        sampled = bool(stage.GetRootLayer().customLayerData.get(SAMPLED))
        times = without_gaps(stored, nominal) if curved and not sampled else stored
    codes = codes_of(times, per_second)
    return codes, (snapped_times(codes / per_second, per_second), nominal, notices)
