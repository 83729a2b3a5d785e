"""Clips of very many frames, vertices, objects or runs: the cost of every operation grows at most in proportion.

A short form counts calls of functions; `make long` measures processor time and memory at the largest sizes.
"""

from __future__ import annotations

import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, MeshSequence
from pdecodec.cli.main import run
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.codec.encode.model import ModelSearch
from pdecodec.codec.settings import EffortName
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.sequence import MeshObject
from tests.slow.test_endurance import figures
from tests.support.mesh_cases import grid

__all__ = ["figures"]


def walk(frames: int, vertices: int) -> np.ndarray:
    """Positions of random walks, (frames, vertices, 3) float32."""
    steps = np.random.default_rng(1).standard_normal((frames, vertices, 3), np.float32)
    return steps.cumsum(axis=0, dtype=np.float32)


def many_frames(size: int) -> MeshSequence:
    return ArraySequence(walk(size, 1))


def many_vertices(size: int) -> MeshSequence:
    return ArraySequence(walk(1, size))


def many_objects(size: int) -> MeshSequence:
    return ArraySequence(walk(4, 4 * size), objects=[MeshObject(f"object {k}", grid(2, 2)) for k in range(size)])


def many_runs(size: int) -> MeshSequence:
    points = walk(size, 9)
    return ChangingSequence(
        [ArraySequence(points[k : k + 1], times=[k / 24], faces=[[0, 1, 2], [2, 3, 4 + k % 5]]) for k in range(size)]
    )


CLIPS: dict[str, tuple[Callable[[int], MeshSequence], tuple[int, int], tuple[int, int]]] = {
    "frames": (many_frames, (1100, 4400), (100_000, 1_000_000)),
    "vertices": (many_vertices, (2000, 8000), (500_000, 5_000_000)),
    "objects": (many_objects, (40, 160), (1000, 10_000)),
    "runs": (many_runs, (10, 40), (1000, 10_000)),
}
"""Functions that make a clip of a given size, each with two sizes at which calls are counted and two that are
measured.
"""


def steps(clip: MeshSequence, folder: Path) -> Iterator[tuple[str, Callable[[], object]]]:
    """Yield the operations on a clip, by name and in order."""
    path, other = folder / "clip.pdeanim", folder / "other.pdeanim"
    frames = clip.frame_count

    def decode() -> None:
        with pdecodec.open_animation(path) as animation:
            for each in animation.runs:
                each.read_frames(0, each.frame_count)
            animation.verify()

    yield "encode", lambda: pdecodec.encode(clip, path, tolerance=1e-3, effort="fast", overwrite=True)
    yield "decode", decode
    yield "check", lambda: pdecodec.check_file(path, deep=True)
    yield "info", lambda: run(["info", "--json", str(path)])
    if not isinstance(clip, ChangingSequence):
        yield "cut", lambda: cut_animation(path, other, 0, (frames + 1) // 2, recode=True, overwrite=True)
        yield "join", lambda: join_animations(path, [path], other, shift=True, overwrite=True)


def calls_of(work: Callable[[], object]) -> int:
    """Return the number of calls of functions, of Python and compiled ones."""
    calls = count()
    sys.setprofile(lambda _, event, __: next(calls) if event in ("call", "c_call") else None)
    try:
        work()
    finally:
        sys.setprofile(None)
    return next(calls)


@pytest.mark.parametrize("kind", CLIPS)
def test_calls_grow_no_faster_than_the_clip(
    kind: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("PDECODEC_THREADS", "1")
    make, (small, large), _ = CLIPS[kind]
    for _, work in steps(make(small), tmp_path):
        work()  # runs imports
    fewer, more = ({name: calls_of(work) for name, work in steps(make(size), tmp_path)} for size in (small, large))
    for name, calls in fewer.items():
        assert more[name] < 1.2 * large / small * calls, name


def test_a_long_clip_of_few_vertices_keeps_long_groups() -> None:
    """Beyond half a million positions effort "fast" does not search; groups must still be longer than twelve frames."""
    clip = ArraySequence(walk(2**14 + 512, 32))
    assert pdecodec.encode(clip, tolerance=1e-3, effort="fast").groups < 50


@pytest.mark.parametrize("effort", ["fast", "default", "best"])
def test_a_single_frame_is_encoded_without_a_search(effort: EffortName, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delattr(ModelSearch, "_with_reference")
    report = pdecodec.encode(many_runs(3), tolerance=1e-3, effort=effort)
    assert report.coefficients == 0
    assert report.max_error <= (report.bound or 0)


def measured(kind: str, size: int, folder: Path) -> dict[str, float]:
    """Return the processor time that each step takes [s], and the peak memory [bytes]."""
    found: dict[str, float] = {}
    for name, work in steps(CLIPS[kind][0](size), folder):
        began = time.process_time()
        work()
        found[name] = time.process_time() - began
    found["memory"] = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    return found


@pytest.mark.long
@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured as on Linux")
@pytest.mark.parametrize("kind", CLIPS)
def test_ten_times_as_much_takes_hardly_more_than_ten_times_as_long(
    kind: str, tmp_path: Path, figures: Callable[[str], None]
) -> None:
    found = []
    for size in CLIPS[kind][2]:
        command = [sys.executable, "-m", "tests.slow.test_long_and_thin", kind, str(size), str(tmp_path)]
        environment = {**os.environ, "PDECODEC_THREADS": "1"}
        done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
        found.append(json.loads(done.stdout.splitlines()[-1]))
        figures(f"{size:,} {kind}: " + ", ".join(f"{name} {number:.3g}" for name, number in found[-1].items()))
    for name, seconds in found[0].items():
        # With ten times as many vertices the partition tree has three more levels, and data no longer fit in the
        # processor's caches.
        assert found[1][name] < (30 if kind == "vertices" else 15) * max(seconds, 0.1), name


if __name__ == "__main__":
    print(json.dumps(measured(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))))
