"""Measure how time and memory grow with frames and vertices: `make growth`, or `python -m pdecodec.research.growth`.

A sheet of travelling waves, computed while it is read, is encoded and decoded whole. Each size runs in a process of
its own with one thread. Times are processor time, which other programs hardly affect, without the time to compute
the sheet. Fast decodes are repeated, and the shortest time counts.

Along frames, all sizes share one group length, and time is split at the end of the first group. The first part,
which does not depend on the number of frames, covers mesh, reference frame, functions of space and the encoder's
model search. The second part is the cost of further frames.
"""

from __future__ import annotations

import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import NamedTuple

from pdecodec.mesh.arrays import Float32Array
from pdecodec.research.bench import GeneratedClip

IN_FRAMES = ((100, 32, 50), (1_000, 32, 50), (10_000, 32, 50))
"""Frames, side of the sheet and frames per group, along the number of frames."""

IN_VERTICES = ((12, 100, 12), (12, 400, 12), (12, 1_414, 12))
"""Frames, side of the sheet and frames per group, along the number of vertices: ten thousand to two million."""

REPEATS, QUICK_SECONDS = 5, 1.0
"""Number of repeats of a fast decode, and the seconds below which a decode counts as fast."""

BYTES_AT_ONCE = 2**26
"""Bytes of positions decoded per call."""

THREADS = ("PDECODEC_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class Seconds(NamedTuple):
    """Processor seconds until the first group of frames was done, and until all were."""

    first: float
    whole: float

    @property
    def after(self) -> float:
        """Seconds spent on the groups after the first."""
        return self.whole - self.first


@dataclass(frozen=True)
class Size:
    """One clip and its cost.

    Attributes
    ----------
    frames, vertices : int
    group_frames : int
        Frames per group.
    file_bytes : int
    encoding, decoding : Seconds
        Decoding includes opening the file and decoding its mesh and every frame.
    memory : int [bytes]
        Peak memory of the process while it encoded.
    """

    frames: int
    vertices: int
    group_frames: int
    file_bytes: int
    encoding: Seconds
    decoding: Seconds
    memory: int


class TimedClip(GeneratedClip):
    """The sheet, and the processor seconds spent on computing it."""

    seconds = 0.0

    def read_frames(self, start: int, stop: int) -> Float32Array:
        began = time.process_time()
        found = super().read_frames(start, stop)
        self.seconds += time.process_time() - began
        return found


def measure(frames: int, side: int, group_frames: int) -> Size:
    """Measure one size in this process."""
    import resource  # not available on Windows

    from pdecodec.codec.encoding import encode

    clip = TimedClip(frames, side, side)
    first: list[float] = []
    with tempfile.TemporaryDirectory() as folder:
        path, began = Path(folder) / "sheet.pdeanim", time.process_time()

        def seconds() -> float:
            return time.process_time() - began - clip.seconds

        report = encode(clip, path, group_frames=group_frames, progress=lambda *_: first.append(seconds()))
        encoding = Seconds(first[0], seconds())
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        decodings = [decode(path)]
        if decodings[0].whole < QUICK_SECONDS:
            decodings += [decode(path) for _ in range(REPEATS - 1)]
    decoding = Seconds(*map(min, zip(*decodings, strict=True)))
    return Size(frames, clip.vertex_count, group_frames, report.file_bytes, encoding, decoding, memory)


def decode(path: Path) -> Seconds:
    """Decode every frame of a file."""
    from pdecodec.codec.opening import open_animation

    began = time.process_time()
    with open_animation(path) as animation:
        at_once = max(1, BYTES_AT_ONCE // (12 * animation.vertex_count))
        groups = animation.group_frames
        ends = []
        for begin, end in ((0, groups[0][1]), (groups[0][1], groups[-1][1])):
            for first in range(begin, end, at_once):
                animation.read_frames(first, min(first + at_once, end))
            ends.append(time.process_time() - began)
    return Seconds(*ends)


def measure_apart(frames: int, side: int, group_frames: int) -> Size:
    """Measure one size in a process of its own, with one thread."""
    command = [sys.executable, "-m", "pdecodec.research.growth", *map(str, (frames, side, group_frames))]
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    found = json.loads(run.stdout)
    return Size(**{**found, "encoding": Seconds(*found["encoding"]), "decoding": Seconds(*found["decoding"])})


def exponent(first: float, last: float, growth: float) -> float:
    """Return the exponent of growth from `first` to `last` when the size grew by the factor `growth`."""
    return math.log(last / first) / math.log(growth)


def rows(sizes: Sequence[Size]) -> Iterator[str]:
    """Yield a Markdown table, and the exponents from its first row to its last."""
    yield "| frames | vertices | encoded in | first group in | decoded in | first group in | memory of the encoder |"
    yield "|--:|--:|--:|--:|--:|--:|--:|"
    for size in sizes:
        encoding, decoding = (f"{own.whole:.3g} s | {own.first:.2g} s" for own in (size.encoding, size.decoding))
        yield f"| {size.frames:,} | {size.vertices:,} | {encoding} | {decoding} | {size.memory / 1e6:,.0f} MB |"
    first, last = sizes[0], sizes[-1]
    growth = last.frames * last.vertices / (first.frames * first.vertices)
    found = (exponent(a.whole, b.whole, growth) for a, b in _ways(first, last))
    yield ""
    yield "Exponents: {:.2f} of encoding, {:.2f} of decoding.".format(*found)
    later = [size.frames - size.group_frames for size in (first, last)]
    if later[0] > 0:
        after = (exponent(a.after, b.after, later[1] / later[0]) for a, b in _ways(first, last))
        yield "After the first group: {:.2f} of encoding, {:.2f} of decoding.".format(*after)


def _ways(first: Size, last: Size) -> tuple[tuple[Seconds, Seconds], ...]:
    return (first.encoding, last.encoding), (first.decoding, last.decoding)


def main(arguments: Sequence[str]) -> int:
    """Print both tables; with frames, a side and frames per group as arguments, print one size as JSON."""
    if arguments:
        frames, side, group_frames = map(int, arguments)
        print(json.dumps(asdict(measure(frames, side, group_frames))))
        return 0
    for table in (IN_FRAMES, IN_VERTICES):
        print("\n".join(rows([measure_apart(*size) for size in table])), end="\n\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
