"""A sequence that is read in a process of its own: whatever its file does to the library that reads it ends only that.

It costs the start of a process, and the way of every frame from it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.codec.source import DecodeLimits, chosen_limits, usual_limits
from pdecodec.formats.base.child import Answer, Child, serve
from pdecodec.formats.base.object_arrays import LaidOutSequence, arrays_of
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.rounding import note_rounding, rounding_noticed
from pdecodec.mesh.sequence import MeshSequence, Unsupported


class IsolatedSequence(LaidOutSequence):
    """A sequence of any format, opened in a child; options and errors as of :func:`open_sequence`.

    Parameters
    ----------
    serving : str
        ``"module:function"``, what runs in the child: calls :func:`serve_sequences`.
    path : pathlib.Path
    options : mapping
    """

    def __init__(self, serving: str, path: Path, options: Mapping[str, Any]) -> None:
        self._child = Child(serving)
        try:
            limits = dataclasses.asdict(chosen_limits(None))
            found = self._child.ask(path, options={**options}, limits=limits)
            self._points = _Points(self._child, path, (int(found["frames"]), int(found["vertices"]), 3))
            own = ("frames", "vertices", "notices", "unsupported")
            names = [name for name in found if name not in own]
            self._take(names, found.__getitem__, None, "array")
        except BaseException:
            self._child.close()
            raise
        self.notices = tuple(map(str, found["notices"]))
        self.unsupported = tuple(
            Unsupported(name, feature, None if frame == "" else int(frame))
            for name, feature, frame in found["unsupported"].reshape(-1, 3).tolist()
        )

    def close(self) -> None:
        self._child.close()


class _Points:
    """Positions as an array that is asked for by blocks of frames."""

    dtype = np.dtype(np.float32)

    def __init__(self, child: Child, path: Path, shape: tuple[int, int, int]) -> None:
        self._child, self._path, self.shape = child, path, shape

    def __getitem__(self, frames: slice) -> Float32Array:
        found = self._child.ask(self._path, frames.start, start=frames.start, stop=frames.stop)
        note_rounding(float(found["rounding"]))
        return found["points"]


def serve_sequences(opener: Callable[..., MeshSequence]) -> None:
    """Answer requests in a child: for everything but positions first, which opens a file, then for blocks of these."""
    sequence: MeshSequence | None = None

    def answer(
        path: Path,
        options: Mapping[str, Any] | None = None,
        limits: Mapping[str, Any] | None = None,
        start: int = 0,
        stop: int = 0,
    ) -> Answer:
        nonlocal sequence
        if options is None:
            assert sequence is not None
            with rounding_noticed() as rounding:
                return {"points": sequence.read_frames(start, stop), "rounding": np.array(rounding.largest)}
        with usual_limits(DecodeLimits(**(limits or {}))):
            sequence = opener(path, **options)
        lost = [(one.name, one.feature, "" if one.frame is None else str(one.frame)) for one in sequence.unsupported]
        facts = {"frames": sequence.frame_count, "vertices": sequence.vertex_count}
        texts = {"notices": np.array(sequence.notices, np.str_), "unsupported": np.array(lost, np.str_)}
        return {**arrays_of(sequence, sequence.fps), **facts, **texts}

    serve(answer)
