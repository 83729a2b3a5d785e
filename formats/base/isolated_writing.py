"""Write a scene that a file carries in a worker process: a file in it that crashes a library ends only the worker.

The worker writes in a thread of its own. Whenever it needs values of the sequence, the worker's answer says which, and
the next call brings them. Answers are arrays, as those of workers that read.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from queue import SimpleQueue
from threading import Thread
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.codec.source import DecodeLimits, chosen_limits, usual_limits
from pdecodec.errors import damaged
from pdecodec.formats.base.isolated import call_about_file
from pdecodec.formats.base.registry import Format, list_formats
from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.fields import Field
from pdecodec.mesh.sequence import MeshSequence
from pdecodec.system.reading import allowed_folders, asset_folders_allowed
from pdecodec.system.workers import Worker

Write = Callable[[MeshSequence, Format, Path, Path, dict[str, Any], Mapping[str, Any]], Sequence[Any]]
"""A function that fills and writes a scene (:func:`pdecodec.formats.base.carrying.write_filled`)."""

_FACTS = ("objects", "times", "fps", "metadata", "notices", "fields")


def in_worker(
    write: Write,
    sequence: MeshSequence,
    entry: Format,
    place: Path,
    where: Path,
    cuts: dict[str, Any],
    options: Mapping[str, Any],
) -> tuple[str, str, Sequence[str], tuple[str, ...]]:
    """Return ``write(sequence, entry, place, where, cuts, options)``, called in a worker process."""
    velocities, progress = options["velocities"], options["progress"]
    facts = [None if one is None else {name: getattr(one, name) for name in _FACTS} for one in (sequence, velocities)]
    own = {key: value for key, value in options.items() if key not in ("velocities", "progress")}
    sources = {"sequence": sequence, "velocities": velocities}
    worker = Worker(arrays_only=True)
    try:
        arguments = write, facts, entry.name, where, cuts, own, chosen_limits(None), allowed_folders()
        told = call_about_file(worker, place, _begin, *arguments)
        while True:
            asked = json.loads(told["asked"].tobytes())
            match asked["what"]:
                case "done":
                    root, original, companions = asked["names"]
                    # A process that was taken over can answer anything.
                    if all(isinstance(one, str) for one in (root, original, *companions, *asked["notices"])):
                        return root, original, companions, tuple(asked["notices"])
                    raise TypeError("names are text")
                case "progress":
                    values = None
                    if progress is not None:
                        progress(*asked["done"])
                case "frames":
                    values = sources[asked["of"]].read_frames(*asked["frames"])
                case _:
                    values = sources[asked["of"]].read_field(asked["name"], *asked["frames"])
            told = call_about_file(worker, place, _answer, values)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise damaged("the scene is damaged (the process that wrote it gave no answer that makes sense)") from error
    finally:
        worker.end()


class _Asked(MeshSequence):
    """A sequence whose values the other process has."""

    def __init__(self, name: str, facts: Mapping[str, Any], ask: Callable[..., Any]) -> None:
        self._name, self._ask = name, ask
        self.__dict__.update(facts)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        found: Float32Array = self._ask("frames", of=self._name, frames=[start, stop])
        return found

    def _field_values(self, field: Field, start: int, stop: int) -> NDArray[Any]:
        found: NDArray[Any] = self._ask("field", of=self._name, name=field.name, frames=[start, stop])
        return found


class _Job(Thread):
    """The writing, in a worker."""

    def __init__(self, write: Callable[[Callable[..., Any]], Sequence[Any]]) -> None:
        super().__init__(daemon=True)
        self._write = write
        self.questions, self.answers = SimpleQueue[dict[str, Any] | Exception](), SimpleQueue[Any]()

    def run(self) -> None:
        try:
            *names, notices = self._write(self._ask)
            self.questions.put({"what": "done", "names": names, "notices": notices})
        except Exception as error:  # every error is returned to the caller
            self.questions.put(error)

    def _ask(self, what: str, **more: Any) -> Any:
        self.questions.put({"what": what, **more})
        return self.answers.get()

    def next_question(self) -> dict[str, NDArray[np.uint8]]:
        question = self.questions.get()
        if isinstance(question, Exception):
            raise question
        return {"asked": np.frombuffer(json.dumps(question).encode(), np.uint8)}


_jobs: list[_Job] = []
"""The writing of this worker process."""


def _begin(
    place: Path,
    write: Write,
    facts: list[Any],
    name: str,
    where: Path,
    cuts: dict[str, Any],
    options: dict[str, Any],
    limits: DecodeLimits,
    folders: Any,
) -> dict[str, NDArray[np.uint8]]:
    """Begin to write in a worker; return what it asks first."""

    def written(ask: Callable[..., Any]) -> Sequence[Any]:
        sequence = _Asked("sequence", facts[0], ask)
        velocities = None if facts[1] is None else _Asked("velocities", facts[1], ask)
        entry = next(one for one in list_formats() if one.name == name)
        more = {**options, "velocities": velocities, "progress": lambda *done: ask("progress", done=done)}
        with usual_limits(limits), asset_folders_allowed(folders):
            return write(sequence, entry, place, where, cuts, more)

    _jobs[:] = [_Job(written)]
    _jobs[0].start()
    return _jobs[0].next_question()


def _answer(place: Path, values: Any) -> dict[str, NDArray[np.uint8]]:
    """Answer what a worker asked; return what it asks next."""
    _jobs[0].answers.put(values)
    return _jobs[0].next_question()
