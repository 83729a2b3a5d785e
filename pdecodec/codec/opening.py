"""Open a `.pdeanim` file: an animation or, if its faces change, a timeline of animations."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pdecodec.codec.container import FIELD_SECTIONS
from pdecodec.codec.decoder import Animation
from pdecodec.codec.paper_form import PaperForm
from pdecodec.codec.source import DecodeLimits, FileSource, chosen_limits, open_core, open_source
from pdecodec.errors import SettingsError
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.runs import ChangingSequence, OpenedRuns, one_run_of
from pdecodec.mesh.sequence import MeshObject
from pdecodec.mesh.times import Outside
from pdecodec.system.arguments import as_numbers


def open_animation(source: FileSource, *, limits: DecodeLimits | None = None) -> Animation:
    """Open a `.pdeanim` file; ``pdecodec.open`` is the same.

    Parameters
    ----------
    source : path-like, bytes, bytearray, memoryview or binary file
        The file's path; its address (``https://``, ``s3://``; extra ``remote``), of which only needed parts are read;
        the whole file in memory; or a seekable file. A file object stays the caller's, who must not move its position
        while the animation is open, unless it is a plain file of the system.
    limits : DecodeLimits, optional
        Default: those of :func:`pdecodec.codec.source.usual_limits`, else its own defaults.

    Returns
    -------
    Animation
        Close it, or use it in a ``with`` statement: parts are read from the file on request.

    Raises
    ------
    InputError
        If the file cannot be opened or read.
    CorruptFileError
        If it is damaged, truncated, of another kind or a later major version.
    LimitError
        If decoding it would take more memory than `limits` allow.
    """
    limits = chosen_limits(limits)
    opened = open_source(source)
    try:
        core = open_core(opened, limits)
        kind = Animation if len(core.runs) == 1 else ChangingAnimation
        return kind(opened, limits, core=core)
    except BaseException:
        opened.close()
        raise


class ChangingAnimation(ChangingSequence, Animation):
    """A `.pdeanim` file whose connectivity changes: one timeline, with an :class:`Animation` for each of its
    :attr:`runs`.

    Made by :func:`pdecodec.open`. Opening reads only where the runs are; using a run reads only the run's own bytes.
    At a time between two runs, the earlier run keeps its last frame. All times of one call must belong to one run,
    otherwise SettingsError is raised: see :meth:`run_at`.
    """

    __init__ = Animation.__init__

    def _describe(self) -> None:
        runs = self._core.runs
        self._first_frames = [run.first for run in runs]
        self._take_runs(
            OpenedRuns(self._open_run, len(runs)),
            [run.frames for run in runs],
            [run.vertices for run in runs],
        )

    def _open_run(self, number: int) -> Animation:
        with self._naming_the_file():
            core = self._core.open_run(number)
        return Animation(self._source, self._limits, core=core, run=number, first_frame=self._first_frames[number])

    def _run_of(self, times: Float64Array) -> Animation:
        run = self.runs[one_run_of(self, times)]
        assert isinstance(run, Animation)
        return run

    def close(self) -> None:
        ChangingSequence.close(self)
        Animation.close(self)

    @property
    def meshes(self) -> tuple[MeshObject, ...]:  # each run has its own objects
        self._only_run()
        return super().meshes

    def _of_core(
        self, quantity: int, asked: Float64Array, inside: Float64Array, out: Any, outside: Outside, *, is_one: bool
    ) -> Any:
        run = self._run_of(inside)
        # The wrapped time may fall into the gap between two runs.
        own = inside if outside == "loop" else asked
        return run._of_core(quantity, own, run._inside(own, "clamp"), out, "clamp", is_one=is_one)

    def field(
        self,
        name: str,
        times: ArrayLike,
        *,
        object: int | None = None,
        out: NDArray[Any] | None = None,
        outside: Outside = "clamp",
        derivative: int = 0,
    ) -> NDArray[Any]:
        """Return the values of a field of the run that all times belong to, as :meth:`Animation.field` does."""
        given = as_numbers(times, "times")
        inside = self._inside(given if given.ndim else given[np.newaxis], outside)
        # The wrapped time may fall in another run.
        own = inside.reshape(given.shape) if outside == "loop" else given
        return self._run_of(inside).field(name, own, object=object, out=out, derivative=derivative)

    def field_facts(self) -> list[dict[str, Any]]:
        if not {"FLDS"} & {section.type for section in self._core.sections}:
            return []
        found: dict[str, dict[str, Any]] = {}
        for run in self.runs:
            assert isinstance(run, Animation)
            for facts in run.field_facts():
                known = found.setdefault(facts["name"], facts)
                if known is not facts:
                    low, high = zip(known["range"], facts["range"], strict=True)
                    known |= {"range": [min(low), max(high)], "bound": max(known["bound"], facts["bound"])}
                    known |= {name: known[name] + facts[name] for name in ("bytes", "groups")}
        return [*found.values()]

    def coefficients(self, group: int) -> PaperForm:
        raise SettingsError(f"coefficients belong to one run of frames, and the file has {len(self.runs)}; choose one")

    @property
    def sections(self) -> dict[str, int]:
        """Bytes of each section, summed over all runs; and of header and table as ``"container"``."""
        with self._naming_the_file():
            sizes = {section.type: section.length for section in self._core.sections}
            # Runs may share a section: count it once.
            own = {section for number in range(len(self.runs)) for section in self._core.run_sections(number)}
            container = self._core.file_bytes - sum(sizes.values())
        for section in own:
            if section.length and section.type not in FIELD_SECTIONS:
                sizes[section.type] = sizes.get(section.type, 0) + section.length
        del sizes["RDAT"]
        return {"container": container, **dict(sorted(sizes.items()))}

    def info(self) -> dict[str, Any]:
        """Return the facts in the headers, as for other animations, and the number, lengths and sizes of the runs."""
        return {
            **self._facts(),
            "runs": len(self.runs),
            "run_frames": [int(self.run_frames.min()), int(self.run_frames.max())],
            "run_vertices": [int(self.run_vertices.min()), int(self.run_vertices.max())],
        }

    def verify(self) -> None:
        """Check every byte of the file, and decode every part of every run; raises the errors of
        :meth:`Animation.verify`.
        """
        with self._naming_the_file():
            self._core.verify()
        _ = self._remarks
        self._verify_scene()
        for run in self.runs:
            assert isinstance(run, Animation)
            run.verify()
