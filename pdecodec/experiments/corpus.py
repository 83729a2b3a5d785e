"""Rate, distortion and speed over a folder of sequences, as one Markdown table.

``python -m pdecodec.experiments.corpus FOLDER [--tolerance 0.001]`` encodes every sequence in the folder,
decodes the file again, compares what came back with what went in, and prints a row for each.
"""

from __future__ import annotations

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.formats import open_sequence
from pdecodec.metrics import bits_per_vertex_frame, measure_distortion
from pdecodec.sequence import Float32Array
from pdecodec.settings import DEFAULT_TOLERANCE, EncodeSettings

COPY_RUNS = 5
"""Copies timed; the fastest counts, so that the multiple is not flattered."""


@dataclass(frozen=True)
class Row:
    """What one sequence gave; errors are over the diagonal of frame 0, of the decoded file."""

    name: str
    frames: int
    vertices: int
    ratio: float
    bpvf: float
    max_error: float
    rms_error: float
    kg_error: float
    encode_rate: float
    decode_multiple: float
    model: str


def measure(source: Path, settings: EncodeSettings) -> Row:
    """Encode one sequence, decode the file and compare.

    Parameters
    ----------
    source : Path
    settings : EncodeSettings
    """
    with open_sequence(source) as opened:
        sequence = opened.to_array()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "clip.pdeanim"
        report = encode(sequence, path, settings)
        started = time.perf_counter()
        with open_animation(path) as animation:
            decoded = animation.to_array()
        decode_seconds = time.perf_counter() - started
    if not decoded.connectivity.same_as(sequence.connectivity):
        raise AssertionError(f"{source.name}: connectivity came back otherwise")
    found = measure_distortion(sequence, decoded)
    counted = report.file_bytes - report.sections["CONN"] - report.sections.get("ATTR", 0)
    return Row(
        name=source.stem,
        frames=report.frames,
        vertices=report.vertices,
        ratio=report.raw_bytes / report.file_bytes,
        bpvf=bits_per_vertex_frame(counted, vertices=report.vertices, frames=report.frames),
        max_error=found.max_error / found.scale,
        rms_error=found.rms_error / found.scale,
        kg_error=found.kg_error,
        encode_rate=report.raw_bytes / 1e6 / report.seconds,
        decode_multiple=decode_seconds / _copy_seconds(decoded.points),
        model=report.summary,
    )


def _copy_seconds(points: Float32Array) -> float:
    target = np.empty_like(points)
    fastest = math.inf
    for _ in range(COPY_RUNS):
        started = time.perf_counter()
        np.copyto(target, points)
        fastest = min(fastest, time.perf_counter() - started)
    return fastest


def as_markdown(rows: Sequence[Row]) -> str:
    """The table, with the geometric means of its ratios and rates."""
    lines = [
        "| sequence | frames x vertices | ratio | bpvf | max | rms | KG % | encode MB/s | decode / copy | model |",
        "|---|---|---|---|---|---|---|---|---|---|",
    ]
    lines += [
        f"| {row.name} | {row.frames} x {row.vertices} | {row.ratio:.1f} | {row.bpvf:.2f} | {row.max_error:.2e} "
        f"| {row.rms_error:.2e} | {row.kg_error:.3f} | {row.encode_rate:.1f} | {row.decode_multiple:.0f} "
        f"| {row.model} |"
        for row in rows
    ]
    mean = [math.exp(np.mean(np.log([getattr(row, name) for row in rows]))) for name in ("ratio", "bpvf")]
    lines.append(f"| geometric mean | | {mean[0]:.1f} | {mean[1]:.2f} | | | | | | |")
    return "\n".join(lines)


def main(arguments: Sequence[str]) -> int:
    """Print the table of a folder; returns the exit code."""
    parser = argparse.ArgumentParser(description="Rate, distortion and speed over a folder of sequences.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--tolerance", type=float, default=DEFAULT_TOLERANCE)
    chosen = parser.parse_args(arguments)
    sources = sorted(chosen.folder.glob("*.npz"))
    if not sources:
        print(f"{chosen.folder}: no .npz sequence in it", file=sys.stderr)
        return 3
    settings = EncodeSettings(tolerance=chosen.tolerance)
    measure(sources[0], settings)  # compiles
    print(as_markdown([measure(source, settings) for source in sources]))
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
