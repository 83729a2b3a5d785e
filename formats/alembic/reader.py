"""Read Alembic scenes on demand, sample by sample: polygon meshes, subdivision surfaces, curves and points.

There is a frame at every time at which positions, a transform above them or a field have a sample. Data without a
sample at this time are interpolated between their own samples: positions and fields of floats linearly; rotation,
stretch and translation of transforms separately. Fields of whole numbers hold.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from alembic3d import Abc
from numpy.typing import NDArray

from pdecodec.errors import InputError, damaged
from pdecodec.formats.alembic.attributes import FPS_PROPERTY, METADATA_PROPERTY
from pdecodec.formats.alembic.inventory import take_inventory
from pdecodec.formats.alembic.shapes import AlembicShape, ShapeScan
from pdecodec.formats.alembic.values import sample_times, samples_at, select
from pdecodec.formats.base.registry import Transforms, read_errors
from pdecodec.formats.base.scene_reading import Refusals, SceneFacts, SceneSequence, runs_of_scene
from pdecodec.formats.base.times import Timing, merged_times, rate_or_default, resampled, round_rate, snapped_times
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence, check_frame_range

HDF5_IDENTIFIER = b"\x89HDF\r\n\x1a\n"


_DAMAGE_ERRORS = (RuntimeError, ArithmeticError, LookupError, MemoryError, TypeError, ValueError)
"""Exceptions that the library and NumPy raise on damaged files, including text that is not UTF-8."""


def open_alembic(
    path: Path, *, fps: float | None, transforms: Transforms = "bake", skip_unsupported: bool = False
) -> MeshSequence:
    """Open the geometry of an Alembic file of the Ogawa kind; each change of faces or ids of points begins a
    new run.

    If `fps` is given, there are frames at this rate from the first stored time to the last, instead of at the stored
    times.

    Raises
    ------
    InputError
        If it is no such file, or holds no geometry.
    """
    with _archive_errors(path):
        archive = _open_archive(path)
        scan = ShapeScan(Refusals(skip=skip_unsupported))
        shapes = scan.shapes(archive)
        scan.refusals.check(shapes)
        # The inventory names them.
        scan.refusals.others.clear()
        moving = _moving_samplings(shapes)
        names = [item.name for item in scan.refusals.found]
        contents, lost = take_inventory(archive, shapes, [sampling for _, sampling in moving], names)
        notices = scan.refusals.notices(shapes, lost)
        times, rate, time_notices = _timing(archive, shapes, moving, fps)
        metadata = _metadata(archive)
    timing = times, rate, (*time_notices, *notices)
    facts = SceneFacts(path=path, transforms=transforms, metadata=metadata, unsupported=tuple(scan.refusals.found))

    def open_run(first: int, own: Timing) -> MeshSequence:
        with _archive_errors(path):
            walk = ShapeScan(Refusals(skip=skip_unsupported), float(times[first]), scan.changes)
            found = walk.shapes(archive) if scan.changes else shapes
            return AlembicSequence(archive, facts, found, own, first)

    sequence = runs_of_scene(times, [*scan.changes.values()], timing, open_run)
    sequence.contents = contents
    return sequence


class AlembicSequence(SceneSequence):
    """Frames of one connectivity of an Alembic file, which stays open until :meth:`close`."""

    def __init__(
        self, archive: Any, facts: SceneFacts, shapes: Sequence[AlembicShape], timing: Timing, first_frame: int
    ) -> None:
        self._archive = archive
        self._begin(facts, shapes, timing, first_frame)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        with _archive_errors(self._path):
            return super().read_frames(start, stop)

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        with _archive_errors(self._path):
            return super()._field_values(field, start, stop)

    def _matrices(self, shape: AlembicShape, start: int, stop: int) -> Float64Array | None:
        if not any(one.moves or not np.array_equal(one.matrices[0], np.eye(4)) for one in shape.chain):
            return None
        return self.shape_matrices(shape, self.times[start:stop])

    @property
    def top(self) -> Any:
        """Top object of the archive."""
        return self._archive.getTop()

    def shape_matrices(self, shape: AlembicShape, times: Float64Array) -> Float64Array:
        """Return (times, 4, 4) matrices from a shape's space to the scene's at times [s], for points that are rows."""
        matrices = np.broadcast_to(np.eye(4), (times.size, 4, 4))
        for transform in shape.chain:
            matrices = matrices @ transform.at(times)
        return matrices

    def _read(self, shape: AlembicShape, start: int, stop: int, out: Float32Array) -> None:
        before: tuple[int, int, float] | None = None
        for row, time in enumerate(self.times[start:stop].tolist()):
            first, second, share = around = samples_at(shape.times, time)
            if around == before and share == 0:
                out[row] = out[row - 1]
                continue
            out[row] = self._sample(shape, first, start + row)
            if share:
                out[row] += share * (self._sample(shape, second, start + row).astype(np.float64) - out[row])
            before = around

    def _sample(self, shape: AlembicShape, index: int, frame: int) -> Float32Array:
        array: Float32Array = np.asarray(shape.positions.getValue(select(shape.times[index]))).reshape(-1, 3)
        return shape.fitted(array, self._path, self._first_frame + frame).copy()

    def close(self) -> None:
        # The archive closes when nothing refers to it any more.
        self._shapes = []
        self._archive = None


@contextmanager
def _archive_errors(path: Path) -> Iterator[None]:
    """Turn exceptions of the library on damaged files into an error of one line that names `path`."""
    try:
        yield
    except _DAMAGE_ERRORS as error:
        reason = " ".join(str(error).split()) or type(error).__name__
        raise damaged(f"is not an Alembic file, or is damaged ({reason}); export it again", path=path) from error


def _open_archive(path: Path) -> Any:
    with read_errors(path), path.open("rb") as file:
        head = file.read(len(HDF5_IDENTIFIER))
    if head == HDF5_IDENTIFIER:
        raise InputError(
            "is an HDF5-backed Alembic file; convert it to Ogawa first (abcconvert -toOgawa)",
            code="unsupported-feature",
            path=path,
        )
    return Abc.IArchive(str(path))


def _moving_samplings(shapes: Sequence[AlembicShape]) -> list[tuple[Float64Array, Any]]:
    """Return times [s] and time sampling of all positions and transforms that move shapes, and of their fields."""
    moving = [(shape.times, shape.positions.getTimeSampling()) for shape in shapes if shape.times.size > 1]
    moving += [sampling for shape in shapes for sampling in shape.samplings]
    return moving + [(one.times, one.sampling) for shape in shapes for one in shape.chain if one.moves]


def _timing(
    archive: Any, shapes: Sequence[AlembicShape], moving: Sequence[tuple[Float64Array, Any]], fps: float | None
) -> Timing:
    stored = _stored_rate(archive, [sampling for _, sampling in moving])
    rate, notices = rate_or_default(stored, fps)
    if moving:
        times = snapped_times(merged_times([times for times, _ in moving]), stored or rate)
        if fps is not None:
            times, notices = resampled(times, fps)
        return times, rate, notices
    # Nothing moves, but properties may have several samples.
    still = max((sample_times(shape.positions) for shape in shapes), key=len)
    return snapped_times(still, stored or rate), rate, notices if still.size > 1 else ()


def _stored_rate(archive: Any, samplings: Sequence[Any]) -> float | None:
    """Return the frame rate: the one our writer stored, or that of the time sampling, or the hint of the
    writing program.
    """
    top = archive.getTop().getProperties()
    if top.getPropertyHeader(FPS_PROPERTY) is not None:
        return float(Abc.IDoubleProperty(top, FPS_PROPERTY).getValue())
    for sampling in samplings:
        kind = sampling.getTimeSamplingType()
        if not kind.isAcyclic():
            return round_rate(1.0 / kind.getTimePerCycle())
    hint = float(Abc.GetArchiveInfo(archive).get("dccFPS", 0.0))
    return hint if hint > 0 else None


def _metadata(archive: Any) -> dict[str, str]:
    top = archive.getTop().getProperties()
    if top.getPropertyHeader(METADATA_PROPERTY) is not None:
        try:
            found = json.loads(Abc.IStringProperty(top, METADATA_PROPERTY).getValue())
        except ValueError:
            found = None
        if isinstance(found, dict):
            return {str(key): str(value) for key, value in found.items()}
    application = Abc.GetArchiveInfo(archive).get("appName", "")
    return {"source": application} if application else {}
