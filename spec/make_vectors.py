"""Make the vectors of the specification: on purpose only (`make vectors`), never by a test.

    python -m spec.make_vectors             write vectors where none of those there would change
    python -m spec.make_vectors --replace   replace those that would

Accepted files pin down decoding. Encoders may go on to other bytes for the same input; nothing here has to change
then. Once the version of the format is released, its vectors are never replaced.
"""

from __future__ import annotations

import hashlib
import json
import sys
from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np

from spec.accepted import accepted
from spec.decoder.animation import Animation, decode
from spec.refused import refused

FOLDER = Path(__file__).resolve().parent / "vectors"

MOMENTS = (0.0, 0.3, 0.77, 1.0)
"""Times that positions are given at, over the clip."""

MOST_VERTICES = 4
"""Of which positions are given."""


def describe(data: bytes) -> dict[str, Any]:
    """What the manifest says of an accepted file."""
    animation = decode(data)
    vertices = sum(mesh.vertices for mesh in animation.meshes)
    first, last = animation.times[0], animation.times[-1]
    shown = range(0, vertices, -(-vertices // MOST_VERTICES))
    positions = []
    for time in dict.fromkeys(first + (last - first) * moment for moment in MOMENTS):
        points = animation.positions(time)
        positions += [[time, vertex, *map(float, points[vertex])] for vertex in shown]
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        "objects": [mesh.name for mesh in animation.meshes],
        "vertices": vertices,
        "faces": sum(len(mesh.faces) for mesh in animation.meshes),
        "lines": sum(len(mesh.lines) for mesh in animation.meshes),
        "frames": len(animation.times),
        "integers": integers(animation),
        "positions": positions,
    }


def integers(animation: Animation) -> dict[str, str]:
    """What every decoder must find alike, as SHA-256 of whole numbers, `i64` each."""
    groups = [animation.motion.group(index) for index in range(len(animation.motion.groups))]
    polygons = (polygon for mesh in animation.meshes for kind in (mesh.faces, mesh.lines) for polygon in kind)
    frames = (frame for group in groups for frame in group.residuals)
    return {
        "polygons": digest(number for polygon in polygons for number in (len(polygon), *polygon)),
        "reference": digest(number for point in animation.reference.grid for number in point),
        "coefficients": digest(number for group in groups for row in group.coefficients for number in row),
        "residuals": digest(
            number for frame in frames for place, levels in frame.levels.items() for number in (place, *levels)
        ),
    }


def digest(numbers: Iterable[int]) -> str:
    return hashlib.sha256(np.fromiter(numbers, "<i8").tobytes()).hexdigest()


def main(arguments: list[str]) -> None:
    listed = FOLDER / "manifest.json"
    before = json.loads(listed.read_text("utf-8")) if listed.exists() else {"accept": {}, "reject": {}}
    manifest: dict[str, dict[str, dict[str, Any]]] = {"accept": {}, "reject": {}}
    files: dict[Path, bytes] = {}
    for name, data in accepted():
        files[FOLDER / "accept" / f"{name}.pdeanim"] = data
        manifest["accept"][name] = describe(data)
    for item in refused():
        files[FOLDER / "reject" / f"{item.name}.pdeanim"] = item.data
        sha256 = hashlib.sha256(item.data).hexdigest()
        manifest["reject"][item.name] = {"sha256": sha256, "error": item.error, "exit_code": 4, "reason": item.reason}
    different = [
        name
        for folder, entries in manifest.items()
        for name, entry in entries.items()
        if before[folder].get(name, entry)["sha256"] != entry["sha256"]
    ]
    if different and "--replace" not in arguments:
        sys.exit(f"nothing is written: {', '.join(different)} would change; --replace replaces them")
    for folder in ("accept", "reject"):
        (FOLDER / folder).mkdir(parents=True, exist_ok=True)
        for path in set((FOLDER / folder).iterdir()) - files.keys():
            path.unlink()
    for path, data in files.items():
        path.write_bytes(data)
    lines = (
        f' "{folder}": {{\n'
        + ",\n".join(f'  "{name}": {json.dumps(entry, ensure_ascii=False)}' for name, entry in entries.items())
        + "\n }"
        for folder, entries in manifest.items()
    )
    listed.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
    print(f"{len(files)} vectors, {sum(map(len, files.values()))} bytes, {len(different)} replaced")


if __name__ == "__main__":
    main(sys.argv[1:])
