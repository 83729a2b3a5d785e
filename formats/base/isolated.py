"""Read a sequence in a worker process, so that a file that crashes its library ends only the worker.

This costs the start of a process, and copying every frame.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Collection, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.sections.scene import Carrier, decode_scene, encode_scene
from pdecodec.codec.source import DecodeLimits, chosen_limits, usual_limits
from pdecodec.errors import InputError, Notice, PdecodecError
from pdecodec.formats.base.object_arrays import LaidOutSequence, arrays_of
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.rounding import note_rounding, rounding_noticed
from pdecodec.mesh.selection import ObjectSelection
from pdecodec.mesh.sequence import Content, MeshSequence, Unsupported
from pdecodec.system.workers import Worker, WorkerEndedError, WorkerNotStartedError


def call_about_file(
    worker: Worker, path: Path, function: Callable[..., Any], *arguments: Any, frame: int | None = None
) -> dict[str, NDArray[Any]]:
    """Return the arrays that ``function(path, *arguments)`` returns in a worker; errors name the file.

    Raises
    ------
    InputError, MissingExtraError, CorruptFileError, LimitError
        If the function raised it, or the process ended.
    """
    try:
        found: dict[str, NDArray[Any]] = worker.call(function, path.absolute(), *arguments)
        return found
    except WorkerEndedError as error:
        message = "the library that reads this file crashed: the file is damaged; export it again"
        raise InputError(message, code="worker-ended", path=path, frame=frame) from error
    except WorkerNotStartedError as error:
        raise InputError(
            f"no worker process could be started to read it ({error})", code="worker-ended", path=path
        ) from error
    except PdecodecError as error:
        raise error.placed(path=path) from error


class IsolatedSequence(LaidOutSequence):
    """A sequence of any format, opened in a worker process.

    Parameters
    ----------
    path : pathlib.Path
    opened_by : callable
        :func:`pdecodec.formats.open_sequence`; its errors pass through.
    options : mapping
        Options of `opened_by`.

    Attributes
    ----------
    worker : Worker
    """

    def __init__(self, path: Path, opened_by: Callable[..., MeshSequence], options: Mapping[str, Any]) -> None:
        self.worker = Worker(arrays_only=True)
        try:
            found = call_about_file(self.worker, path, _open, opened_by, dict(options), chosen_limits(None))
            self._points = _Points(self.worker, path, (int(found["frames"]), int(found["vertices"]), 3))
            told = json.loads(found.pop("told").tobytes())
            own = ("frames", "vertices")
            names = [name for name in found if name not in own]
            self._take(names, found.__getitem__, None, "array")
        except BaseException:
            self.worker.end()
            raise
        self.notices = tuple(
            Notice(text, setting=setting, value=value, purpose=purpose)
            for text, setting, value, purpose in told["notices"]
        )
        self.unsupported = tuple(Unsupported(*one) for one in told["unsupported"])
        self.fields = tuple(
            Field(name, domain, np.dtype(dtype), components, unit, None if objects is None else tuple(objects))
            for name, domain, dtype, components, unit, objects in told["fields"]
        )
        self._path = path
        if told["has_scene"]:
            self.carried = _IsolatedScene(self.worker, path)
            if told["is_stored"]:  # in a `.pdeanim` file, whose scene needs no library to be passed on
                names = [one.name for one in self.fields]
                self.carried = self.carried.carrier(self, exact_uvs=True, fields=names)
        self.contents = tuple(Content(*one) for one in told["contents"])

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        return call_about_file(self.worker, self._path, _read_field, field.name, start, stop, frame=start)["values"]

    def close(self) -> None:
        self.worker.end()


class _IsolatedScene:
    """The scene of a file that a worker holds; the worker cuts the coded arrays out of it."""

    family = None

    def __init__(self, worker: Worker, path: Path) -> None:
        self._worker, self._path = worker, path

    def of_some_objects(self) -> _IsolatedScene:
        """Return itself: shapes that are not coded stay in the carrier."""
        return self

    def carrier(self, sequence: MeshSequence, *, exact_uvs: bool, fields: Collection[str]) -> Carrier | None:
        """Return the carrier; None if the file holds only meshes."""
        names = [item.name for item in sequence.objects]
        data = call_about_file(self._worker, self._path, _carry, names, exact_uvs, list(fields))["scene"].tobytes()
        return decode_scene(data) if data else None


class _Points:
    """Positions as an array that is indexed by blocks of frames."""

    dtype = np.dtype(np.float32)

    def __init__(self, worker: Worker, path: Path, shape: tuple[int, int, int]) -> None:
        self._worker, self._path, self.shape = worker, path, shape

    def __getitem__(self, frames: slice) -> Float32Array:
        first, stop = frames.start, frames.stop
        found = call_about_file(self._worker, self._path, _read, first, stop, frame=first)
        note_rounding(float(found["rounding"]))
        return found["points"]


_opened: dict[Path, MeshSequence] = {}
"""The sequences that this worker process has opened, by path."""


def _open(
    path: Path, opened_by: Callable[..., MeshSequence], options: Mapping[str, Any], limits: DecodeLimits
) -> dict[str, Any]:
    """Open a sequence in a worker; return everything but positions."""
    with usual_limits(limits):
        sequence = _opened[path] = opened_by(path, **options)
    lost = [(one.name, one.feature, one.frame) for one in sequence.unsupported]
    facts = {"frames": sequence.frame_count, "vertices": sequence.vertex_count}
    known = [one if isinstance(one, Notice) else Notice(one) for one in sequence.notices]
    notices = [(one.text, one.setting, one.value, one.purpose) for one in known]
    # In an array of text, every element takes the length of the longest text.
    fields = [(one.name, one.domain, str(one.dtype), one.components, one.unit, one.objects) for one in sequence.fields]
    told = {
        "has_scene": sequence.carried is not None,
        "is_stored": sequence.carried is not None and sequence.carried.family is not None,
        "notices": notices,
        "unsupported": lost,
        "contents": sequence.contents,
        "fields": fields,
    }
    return {**arrays_of(sequence, sequence.fps), **facts, "told": np.frombuffer(json.dumps(told).encode(), np.uint8)}


def _carry(path: Path, names: list[str], exact_uvs: bool, fields: list[str]) -> dict[str, Any]:
    """Cut the arrays of objects out of a file in a worker; return section SCEN."""
    if path not in _opened:
        raise InputError("the worker process that had it open has ended; open it again", code="worker-ended")
    scene = _opened[path].carried
    chosen = ObjectSelection(_opened[path], names)
    carrier = None if scene is None else scene.carrier(chosen, exact_uvs=exact_uvs, fields=fields)
    data = b"" if carrier is None else encode_scene(carrier)
    return {"scene": np.frombuffer(data, np.uint8)}


def _read_field(path: Path, name: str, start: int, stop: int) -> dict[str, Any]:
    """Read a block of frames of a field in a worker."""
    if path not in _opened:
        raise InputError("the worker process that had it open has ended; open it again", code="worker-ended")
    return {"values": _opened[path].read_field(name, start, stop)}


def _read(path: Path, start: int, stop: int) -> dict[str, Any]:
    """Read a block of frames in a worker."""
    if path not in _opened:  # The worker ended and was started again.
        raise InputError("the worker process that had it open has ended; open it again", code="worker-ended")
    with rounding_noticed() as rounding:
        return {"points": _opened[path].read_frames(start, stop), "rounding": np.array(rounding.largest)}
