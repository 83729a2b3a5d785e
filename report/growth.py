"""How time and memory grow with frames and with vertices: `make growth`, or `python -m pdecodec.report.growth`.

A sheet of travelling waves, computed as it is read, is encoded and decoded whole, every size in a process of its own
and by one thread. Times are those of the processor, without what computing the sheet takes, and hardly depend on what
else the machine does; they are of one run.
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

from pdecodec.report.bench import GeneratedClip
from pdecodec.sequence import Float32Array

IN_FRAMES = ((100, 32), (1_000, 32), (10_000, 32))
"""Frames, and rows and columns of the sheet."""

IN_VERTICES = ((12, 100), (12, 400), (12, 1_414))
"""From ten thousand to two million vertices."""

BYTES_AT_ONCE = 2**26
"""Positions that are decoded by one call."""

THREADS = ("PDECODEC_THREADS", "OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


@dataclass(frozen=True)
class Size:
    """One clip, and what it took.

    Attributes
    ----------
    frames, vertices, file_bytes : int
    encode_seconds, decode_seconds : float [s]
        Of the processor; to decode is to open the file, to decode its mesh, and every frame.
    memory : int [bytes]
        The most that the process held while it encoded.
    """

    frames: int
    vertices: int
    file_bytes: int
    encode_seconds: float
    decode_seconds: float
    memory: int


class TimedClip(GeneratedClip):
    """The sheet, and the seconds of the processor that computing it has taken."""

    seconds = 0.0

    def read_frames(self, start: int, stop: int) -> Float32Array:
        began = time.process_time()
        found = super().read_frames(start, stop)
        self.seconds += time.process_time() - began
        return found


def measure(frames: int, side: int) -> Size:
    """One size, in this process."""
    import resource  # which not every system has

    from pdecodec.decoder import open_animation
    from pdecodec.encoder import encode

    clip = TimedClip(frames, side, side)
    with tempfile.TemporaryDirectory() as folder:
        path, began = Path(folder) / "sheet.pdeanim", time.process_time()
        report = encode(clip, path)
        encoded = time.process_time() - began - clip.seconds
        memory = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * (1 if sys.platform == "darwin" else 1024)
        began = time.process_time()
        with open_animation(path) as animation:
            at_once = max(1, BYTES_AT_ONCE // (12 * animation.vertex_count))
            for first in range(0, frames, at_once):
                animation.read_frames(first, min(first + at_once, frames))
            decoded = time.process_time() - began
    return Size(frames, clip.vertex_count, report.file_bytes, encoded, decoded, memory)


def measure_apart(frames: int, side: int) -> Size:
    """One size, in a process of its own and by one thread."""
    command = [sys.executable, "-m", "pdecodec.report.growth", str(frames), str(side)]
    environment = {**os.environ, **dict.fromkeys(THREADS, "1")}
    run = subprocess.run(command, capture_output=True, text=True, check=True, env=environment)
    return Size(**json.loads(run.stdout))


def exponent(first: float, last: float, growth: float) -> float:
    """Of what took `first` and takes `last` when something grew by a factor."""
    return math.log(last / first) / math.log(growth)


def rows(sizes: Sequence[Size], growth: float) -> Iterator[str]:
    """A table in Markdown, and the exponents from its first line to its last one."""
    yield "| frames | vertices | encoded in | decoded whole in | memory of the encoder |"
    yield "|--:|--:|--:|--:|--:|"
    for size in sizes:
        yield (
            f"| {size.frames:,} | {size.vertices:,} | {size.encode_seconds:.3g} s | "
            f"{size.decode_seconds:.2g} s | {size.memory / 1e6:,.0f} MB |"
        )
    first, last = sizes[0], sizes[-1]
    encoding = exponent(first.encode_seconds, last.encode_seconds, growth)
    decoding = exponent(first.decode_seconds, last.decode_seconds, growth)
    yield ""
    yield f"Exponents: {encoding:.2f} of encoding, {decoding:.2f} of decoding."


def main(arguments: Sequence[str]) -> int:
    """Print both tables; or with frames and a side, one size as JSON."""
    if arguments:
        frames, side = map(int, arguments)
        print(json.dumps(asdict(measure(frames, side))))
        return 0
    for table in (IN_FRAMES, IN_VERTICES):
        sizes = [measure_apart(frames, side) for frames, side in table]
        growth = table[-1][0] / table[0][0] * (table[-1][1] / table[0][1]) ** 2
        print("\n".join(rows(sizes, growth)), end="\n\n", flush=True)
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
