"""Compare the coder of fields with other codecs: `python -m pdecodec.research.field_bench FOLDER`.

The folder has clips as NPZ files, and in `peers.csv` the bits per value of other codecs at the same largest error.
Each field is encoded in groups of frames at 1e-3 and 1e-5 of its range; its error is measured on decoded values.
Prints a table in Markdown.
"""

from __future__ import annotations

import csv
import json
import math
import sys
import time
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from pdecodec import _core
from pdecodec.codec.encode.field.chunks import choose_coding, encode_chunk, field_quantiser, group_frames

DOMAINS = {"node": 0, "point": 0, "face": 1, "cell": 1, "corner": 2}


class Measured(NamedTuple):
    """A field encoded and decoded: bytes, largest error over the bound, processor seconds."""

    size: int
    error: float
    encoding: float
    decoding: float


def connectivity_of(clip: dict[str, NDArray[Any]]) -> tuple[Any, ...]:
    """Return the connectivity of a clip as the core takes it. Elements with fewer than three corners are padded
    by repeating the last corner.
    """
    none = np.zeros(0, np.int32)
    corners = next((clip[name] for name in ("faces", "cells") if name in clip), np.zeros((0, 3), np.int32))
    for column in range(1, 3):
        corners[:, column] = np.where(corners[:, column] < 0, corners[:, column - 1], corners[:, column])
    sizes = (corners >= 0).sum(axis=1).astype(np.int32)
    flat = corners[corners >= 0].astype(np.int32)
    return clip["points"].shape[1], sizes, flat, none, none, none.astype(np.uint8), none, none


def measure(rows: _core.FieldRows, values: NDArray[Any], tolerance: str) -> Measured:
    """Encode and decode a field."""
    finite = values[np.isfinite(values)]
    least, most = float(finite.min()), float(finite.max())
    bound = None if tolerance == "lossless" else float(tolerance) * (most - least)
    quantiser = field_quantiser(values.dtype, least, most, bound)
    frames = group_frames(len(values), values[0].size)
    groups = [values[at : at + frames] for at in range(0, len(values), frames)]
    begin = time.process_time()
    coding, _ = choose_coding(rows, quantiser, groups[0])
    chunks = [encode_chunk(rows, quantiser, group, coding) for group in groups]
    encoded = time.process_time()
    components = values.shape[2] * quantiser.planes
    found = [
        quantiser.restore(_core.decode_field_chunk(rows, chunk, len(group), components))
        for chunk, group in zip(chunks, groups, strict=True)
    ]
    decoded = time.process_time()
    apart = np.abs(np.concatenate(found).astype(np.float64) - values)[np.isfinite(values)].max()
    error = float(apart) / bound if bound else float(apart)
    return Measured(sum(map(len, chunks)), error, encoded - begin, decoded - encoded)


def best_peers(path: Path) -> dict[tuple[str, str, str], tuple[float, str]]:
    """Return the fewest bits per value of any other codec, and its name, by clip, field and tolerance."""
    found: dict[tuple[str, str, str], tuple[float, str]] = defaultdict(lambda: (math.inf, ""))
    with path.open(encoding="utf-8") as rows:
        for row in csv.DictReader(rows):
            key = row["clip"], row["field"], row["tolerance_of_range"]
            found[key] = min(found[key], (float(row["bits_per_value"]), row["peer"]))
    return found


def rows_of(folder: Path) -> Iterator[tuple[str, str, str, int, Measured]]:
    """Yield clip, field, tolerance, number of values and measurement, for every field at every tolerance."""
    for path in sorted(folder.glob("*/*.npz")):
        clip = dict(np.load(path))
        part = connectivity_of(clip)
        for name, domain in json.loads(str(clip["domains"])).items():
            rows = _core.FieldRows(DOMAINS[domain], [part])
            values = clip[f"field_{name}"]
            if values.dtype.kind == "f":
                values = values.astype(np.float32)
            values = values.reshape(*values.shape[:2], -1)
            for tolerance in ("0.001", "1e-05") if values.dtype.kind == "f" else ("lossless",):
                yield path.stem, name, tolerance, values.size, measure(rows, values, tolerance)


def main() -> None:
    """Print the table."""
    folder = Path(sys.argv[1])
    peers = best_peers(folder / "peers.csv")
    ratios: dict[str, list[float]] = defaultdict(list)
    count = encoding = decoding = 0.0
    print("| clip | field | bound | values | bits a value | best other codec | its bits | ours / its | error / bound |")
    print("|---|---|---|---|---|---|---|---|---|")
    for clip, name, tolerance, size, found in rows_of(folder):
        bits, peer = 8.0 * found.size / size, peers[clip, name, tolerance]
        ratios[tolerance].append(bits / peer[0])
        count, encoding, decoding = count + size, encoding + found.encoding, decoding + found.decoding
        ours = f"{bits:.4f} | {peer[1]} | {peer[0]:.4f} | {bits / peer[0]:.3f} | {found.error:.4f}"
        print(f"| {clip} | {name} | {tolerance} | {size} | {ours} |")
    for tolerance, own in ratios.items():
        whole = own if tolerance == "lossless" else own + ratios["lossless"]
        means = [math.exp(math.fsum(map(math.log, some)) / len(some)) for some in (own, whole)]
        print(f"\nGeometric mean at {tolerance}: {means[0]:.3f}; with exact fields {means[1]:.3f}", end="")
    print(f"\n\n{count / encoding / 1e6:.1f} million values a second encoded, {count / decoding / 1e6:.1f} decoded")


if __name__ == "__main__":
    main()
