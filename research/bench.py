"""Speed and memory as a table: `make bench`, or `python -m pdecodec.research.bench [--json] [NAME...]`.

Every figure is the median of several runs after one that fills caches; ratios are taken within one run. The clip is
the cube-rope unless stated otherwise. pyPBD, the simulator compared with, comes with the extra `baselines`.
"""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import asdict, dataclass
from functools import cache, partial
from pathlib import Path

import numpy as np

from pdecodec.mesh.arrays import Float32Array
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject, MeshSequence, check_frame_range
from pdecodec.report.clips.measuring import copy_seconds, median_seconds, random_frame_seconds

OBJ_FRAMES = 8
"""Frames of the OBJ clip: enough to keep every thread busy, few enough for the plain Python loop."""

CLOTH_SIDE = 100
CLOTH_FRAMES = 20
CLOTH_SUBSTEPS = 10
"""Cloth that pyPBD is compared on: points per side, frames, substeps per frame."""

LONG_FRAMES = 2_000
"""Frames of the long clip, which would take 480 MB if they were all in memory."""

LONG_VERTICES = (100, 200)
"""Rows and columns of the long clip: 20,000 vertices."""


@dataclass(frozen=True)
class Measurement:
    """One line of the table."""

    name: str
    value: float | None
    unit: str
    note: str = ""


@cache
def _rope() -> ArraySequence:
    from pdecodec.simulate import build

    return build("cube-rope").simulate(frames=60, fps=60.0).to_array()


def bench_codec() -> Iterator[Measurement]:
    """Measure encoding throughput, decoding against `np.copyto`, and one frame at a random time."""
    from pdecodec.codec.encoding import encode
    from pdecodec.codec.opening import open_animation
    from pdecodec.codec.settings import EncodeSettings

    clip = _rope()
    raw = clip.points.nbytes
    shape = f"{clip.frame_count} frames of {clip.vertex_count:,} vertices"
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "rope.pdeanim"
        for label, settings in (
            ("encode, tolerance 0.001", EncodeSettings(tolerance=1e-3)),
            ("encode, profile paper", EncodeSettings(profile="paper")),
        ):
            seconds = median_seconds(partial(encode, clip, path, settings, overwrite=True))
            yield Measurement(label, raw / 1e6 / seconds, "MB/s raw", shape)
        encode(clip, path, EncodeSettings(tolerance=1e-3), overwrite=True)
        copy = copy_seconds(clip.points)
        with open_animation(path) as animation:
            decode = median_seconds(lambda: animation.read_frames(0, animation.frame_count))
            single = random_frame_seconds(animation)
        yield Measurement(
            "decode all frames", decode / copy, "times as long as np.copyto", f"{raw / 1e6 / decode:.0f} MB/s"
        )
        yield Measurement(
            "one frame at a random time", single * 1e6, "microseconds", f"{clip.vertex_count:,} vertices, file open"
        )


def bench_obj() -> Iterator[Measurement]:
    """Measure reading an OBJ sequence against a plain Python loop over the same files."""
    from pdecodec.formats import open_sequence, write_sequence

    clip = _rope()
    short = ArraySequence(clip.points[:OBJ_FRAMES], objects=clip.objects, times=clip.times[:OBJ_FRAMES], fps=clip.fps)
    with tempfile.TemporaryDirectory() as folder:
        frames = Path(folder) / "frames"
        write_sequence(short, frames)
        files = sorted(frames.iterdir())
        size = sum(file.stat().st_size for file in files)

        def read() -> Float32Array:
            with open_sequence(frames, fps=60.0) as sequence:
                return sequence.read_frames(0, sequence.frame_count)

        ours = median_seconds(read)
        plain = median_seconds(lambda: [_read_obj_plainly(file) for file in files], runs=1)
        if not np.array_equal(read(), np.stack([_read_obj_plainly(file) for file in files])):
            raise AssertionError("both readers must return the same positions")
    yield Measurement("read OBJ", size / 1e6 / ours, "MB/s", f"{OBJ_FRAMES} files, {size / 1e6:.0f} MB of text")
    yield Measurement("read OBJ, plain Python loop", size / 1e6 / plain, "MB/s", f"{plain / ours:.0f} times slower")


def _read_obj_plainly(path: Path) -> Float32Array:
    points, faces = [], []
    with path.open() as lines:
        for line in lines:
            words = line.split()
            if words and words[0] == "v":
                points.append([float(word) for word in words[1:4]])
            elif words and words[0] == "f":
                faces.append([int(word.split("/")[0]) for word in words[1:]])
    return np.array(points, np.float32)


def bench_xpbd() -> Iterator[Measurement]:
    """Measure the time per frame of a cloth against pyPBD with equal substeps (one iteration each)."""
    from pdecodec.simulate import build

    scene = build("cloth", columns=CLOTH_SIDE, rows=CLOTH_SIDE)

    def simulate() -> object:
        clip = scene.simulate(frames=CLOTH_FRAMES + 1, fps=60.0, substeps=CLOTH_SUBSTEPS, iterations=1)
        return clip.read_frames(0, clip.frame_count)

    ours = median_seconds(simulate) / CLOTH_FRAMES
    with _one_thread():
        alone = median_seconds(simulate) / CLOTH_FRAMES
    name = f"XPBD cloth {CLOTH_SIDE} x {CLOTH_SIDE}, {CLOTH_SUBSTEPS} substeps"
    yield Measurement(name, ours * 1e3, "ms a frame", f"bundled simulator, {ours / alone:.2f} times one thread's")
    if importlib.util.find_spec("pypbd") is None:
        yield Measurement(f"{name}, pyPBD", None, "ms a frame", "not installed: pip install 'pdecodec[baselines]'")
        return
    # Runs in a process of its own, because pyPBD keeps its scene in global state. The number of threads is that of the
    # available processors, which pyPBD may not detect in a container.
    threads = {**os.environ, "OMP_NUM_THREADS": str(len(os.sched_getaffinity(0)))}
    run = subprocess.run([sys.executable, "-c", _PYPBD], capture_output=True, text=True, check=True, env=threads)
    theirs = float(run.stdout.split()[-1])
    yield Measurement(
        f"{name}, pyPBD",
        theirs * 1e3,
        "ms a frame",
        f"{theirs / ours:.1f} times ours, {threads['OMP_NUM_THREADS']} threads",
    )


@contextmanager
def _one_thread() -> Iterator[None]:
    kept = os.environ.get("PDECODEC_THREADS")
    os.environ["PDECODEC_THREADS"] = "1"
    try:
        yield
    finally:
        del os.environ["PDECODEC_THREADS"]
        if kept is not None:
            os.environ["PDECODEC_THREADS"] = kept


_PYPBD = f"""
import math, statistics, time
import pypbd as pbd
sim = pbd.Simulation.getCurrent(); sim.initDefault(); model = sim.getModel()
n = {CLOTH_SIDE}
turn = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
mesh = model.addRegularTriangleModel(n, n, [0, 0, 0], turn, [10.0, 10.0], testMesh=False)
particles = model.getParticles(); particles.setMass(0, 0.0); particles.setMass(n - 1, 0.0)
model.addClothConstraints(mesh, 4, 1e5, 1e5, 1e5, 1e5, 0.3, 0.3, False, False)
model.addBendingConstraints(mesh, 3, 50.0)
step = sim.getTimeStep()
step.setValueUInt(pbd.TimeStepController.NUM_SUB_STEPS, {CLOTH_SUBSTEPS})
step.setValueUInt(pbd.TimeStepController.MAX_ITERATIONS, 1)
pbd.TimeManager.getCurrent().setTimeStepSize(1 / 60)
step.step(model)
times = []
for _ in range({CLOTH_FRAMES}):
    started = time.perf_counter(); step.step(model); times.append(time.perf_counter() - started)
print(statistics.median(times))
"""
"""The same cloth in pyPBD, with XPBD constraints: distance (4) and isometric bending (3)."""


class GeneratedClip(MeshSequence):
    """A waving sheet, computed while it is read: a long clip that takes no memory.

    Parameters
    ----------
    frames : int
    rows, columns : int
    """

    def __init__(self, frames: int, rows: int, columns: int) -> None:
        corner = np.arange(rows * columns, dtype=np.int32).reshape(rows, columns)
        quads = np.stack([corner[:-1, :-1], corner[:-1, 1:], corner[1:, 1:], corner[1:, :-1]], axis=-1).reshape(-1, 4)
        self.objects = (MeshObject("sheet", Connectivity.from_padded(rows * columns, quads)),)
        self.fps = 60.0
        self.times = np.arange(frames) / self.fps
        self.metadata = {}
        self.notices = ()
        self._x, self._z = (
            axis.ravel() for axis in np.meshgrid(np.linspace(0, 1, rows), np.linspace(0, 2, columns), indexing="ij")
        )

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        time = self.times[start:stop, None]
        height = 0.1 * np.sin(9 * self._x + 5 * time) * np.cos(4 * self._z - 3 * time) + 0.02 * np.sin(
            31 * self._z + 11 * time
        )
        sway = 0.05 * np.sin(2 * time) * self._x
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        points[..., 0] = self._x + sway
        points[..., 1] = height
        points[..., 2] = self._z
        return points


def bench_memory() -> Iterator[Measurement]:
    """Measure the peak memory of a process that encodes a long clip from HDF5."""
    from pdecodec.formats import write_sequence

    with tempfile.TemporaryDirectory() as folder:
        source, output = Path(folder) / "long.h5", Path(folder) / "long.pdeanim"
        clip = GeneratedClip(LONG_FRAMES, *LONG_VERTICES)
        write_sequence(clip, source)
        started = time.perf_counter()
        process = subprocess.Popen(
            [sys.executable, "-m", "pdecodec.cli", "encode", str(source), "-o", str(output)], stderr=subprocess.DEVNULL
        )
        _, status, usage = os.wait4(process.pid, 0)
        seconds = time.perf_counter() - started
        process.returncode = os.waitstatus_to_exitcode(status)
        if process.returncode:
            raise subprocess.CalledProcessError(process.returncode, process.args)
        coded = output.stat().st_size
    raw = 12 * LONG_FRAMES * clip.vertex_count
    shape = f"{LONG_FRAMES:,} frames of {clip.vertex_count:,} vertices, {raw / 1e6:.0f} MB raw"
    yield Measurement("peak memory of an encode from HDF5", usage.ru_maxrss / 2**10, "MiB", shape)
    yield Measurement("the same, throughput", raw / 1e6 / seconds, "MB/s raw", f"{coded / 1e6:.2f} MB out, one run")


BENCHMARKS: dict[str, Callable[[], Iterator[Measurement]]] = {
    "codec": bench_codec,
    "obj": bench_obj,
    "xpbd": bench_xpbd,
    "memory": bench_memory,
}
"""Benchmarks by name."""


def main(arguments: Sequence[str]) -> int:
    """Run the benchmarks named (all by default) and print a table, or JSON with ``--json``."""
    import argparse

    from rich.console import Console
    from rich.table import Table

    parser = argparse.ArgumentParser(prog="bench", description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("names", nargs="*", metavar="NAME", help=f"of {', '.join(BENCHMARKS)}; all by default")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    options = parser.parse_args(arguments)
    unknown = set(options.names) - set(BENCHMARKS)
    if unknown:
        parser.error(f"there is no benchmark {', '.join(sorted(unknown))}; choose from {', '.join(BENCHMARKS)}")
    found: list[Measurement] = []
    for name in options.names or BENCHMARKS:
        print(f"measuring {name}", file=sys.stderr)
        found.extend(BENCHMARKS[name]())
    if options.json:
        print(json.dumps([asdict(item) for item in found], indent=2))
        return 0
    table = Table("measured", "value", "unit", "note", box=None)
    for item in found:
        table.add_row(item.name, "-" if item.value is None else f"{item.value:.3g}", item.unit, item.note)
    Console(markup=False).print(table)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
