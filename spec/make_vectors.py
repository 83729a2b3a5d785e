"""Make the vectors of the specification: on purpose only (`make vectors`), never by a test.

    python -m spec.make_vectors             write vectors where none of those there would change
    python -m spec.make_vectors --replace   replace those that would

Accepted files pin down decoding. Encoders may go on to other bytes for the same input; nothing here has to
change then. Vectors of a released version of the format are never replaced: they are made only where they are missing.
"""

from __future__ import annotations

import hashlib
import json
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec import open_animation
from spec.accepted import accepted
from spec.accepted_2 import accepted as accepted_2
from spec.refused import Refused, refused
from spec.refused_2 import refused as refused_2

FOLDER = Path(__file__).resolve().parent / "vectors"

RELEASED = 1
"""Versions of the format up to this one are released."""

BETWEEN = (0.01, 0.3, 0.5, 0.77, 0.995)
"""Times that positions are given at besides the frames, over the clip."""


def describe(data: bytes, path: Path) -> dict[str, Any]:
    """What the manifest says of an accepted file."""
    path.write_bytes(data)
    with open_animation(path) as animation:
        first, last = float(animation.times[0]), float(animation.times[-1])
        between = [first + (last - first) * share for share in BETWEEN]
        part = animation.connectivity
        return {
            "sha256": hashlib.sha256(data).hexdigest(),
            "objects": [item.name for item in animation.objects],
            "vertices": animation.vertex_count,
            "faces": part.face_count,
            "lines": part.line_count,
            "frames": animation.frame_count,
            "positions": digest(animation.sample(animation.times)),
            "between": between,
            "positions_between": digest(animation.sample(between)),
        }


def digest(points: NDArray[np.float32]) -> str:
    """SHA-256 of positions, float32, little-endian."""
    return hashlib.sha256(points.astype("<f4").tobytes()).hexdigest()


def every_accepted(folder: Path) -> Iterator[tuple[int, str, bytes]]:
    """Version of the format, name and bytes of each file that every decoder must read."""
    for name, data in accepted(folder):
        yield 1, name, data
    for name, data in accepted_2():
        yield 2, f"v2_{name}", data


def every_refused(folder: Path) -> Iterator[tuple[int, Refused]]:
    """Version of the format and file of each that every decoder must refuse."""
    for item in refused(folder):
        yield 1, item
    for item in refused_2():
        yield 2, replace(item, name=f"v2_{item.name}")


def main(arguments: list[str]) -> None:
    listed = FOLDER / "manifest.json"
    before = json.loads(listed.read_text("utf-8")) if listed.exists() else {"accept": {}, "reject": {}}
    manifest: dict[str, dict[str, dict[str, Any]]] = {"accept": {}, "reject": {}}
    files: dict[Path, bytes] = {}
    with tempfile.TemporaryDirectory() as name:
        for version, vector, data in every_accepted(Path(name)):
            if version <= RELEASED and vector in before["accept"]:
                manifest["accept"][vector] = before["accept"][vector]
                continue
            files[FOLDER / "accept" / f"{vector}.pdeanim"] = data
            manifest["accept"][vector] = describe(data, Path(name) / "c.pdeanim")
        for version, item in every_refused(Path(name)):
            said = {"error": item.error, "exit_code": 4, "reason": item.reason}
            if version <= RELEASED and item.name in before["reject"]:
                manifest["reject"][item.name] = before["reject"][item.name] | said
                continue
            files[FOLDER / "reject" / f"{item.name}.pdeanim"] = item.data
            manifest["reject"][item.name] = {"sha256": hashlib.sha256(item.data).hexdigest(), **said}
    different = [
        name
        for folder, entries in manifest.items()
        for name, entry in entries.items()
        if {**before[folder].get(name, entry), "reason": ""} != {**entry, "reason": ""}
    ]
    if different and "--replace" not in arguments:
        names = ", ".join(different)
        sys.exit(f"nothing is written: these vectors would change ({names}); --replace replaces them")
    for path, data in files.items():
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
    listed.write_text(json.dumps(manifest, indent=1, ensure_ascii=False) + "\n", "utf-8")
    print(f"{len(files)} vectors, {sum(map(len, files.values()))} bytes, {len(different)} replaced")


if __name__ == "__main__":
    main(sys.argv[1:])
