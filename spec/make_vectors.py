"""Make the vectors of the specification. Run it deliberately (`make vectors`); no test does.

    python -m spec.make_vectors             write vectors that do not exist yet; keep all others
    python -m spec.make_vectors --replace   also replace vectors that the current encoder writes differently

Accepted files pin down decoding. Encoders may write other bytes for the same input; nothing has to change here then.
Once the version of the format is released, its vectors are never replaced.
"""

from __future__ import annotations

import base64
import hashlib
import json
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np

from spec.accepted import accepted
from spec.decoder.animation import Animation, decode_runs, run_at
from spec.refused import refused
from spec.sealing import take_apart
from spec.vector_files import MANIFEST, Manifest, accepted_vectors, refused_vectors

LISTED_TIMES = (0.0, 0.3, 0.77, 1.0)
"""Times at which positions are listed, as fractions of the clip."""

MAX_LISTED_VERTICES = 4
"""Largest number of vertices whose positions are listed."""


def describe(data: bytes) -> dict[str, Any]:
    """Describe an accepted file for the manifest."""
    runs = decode_runs(data)
    first, last = runs[0].times[0], runs[-1].times[-1]
    positions = []
    for time in dict.fromkeys(first + (last - first) * moment for moment in LISTED_TIMES):
        points = run_at(runs, time).positions(time)
        shown = range(0, len(points), -(-len(points) // MAX_LISTED_VERTICES))
        positions += [[time, vertex, *map(float, points[vertex])] for vertex in shown]
    of_runs = [
        {
            "objects": [mesh.name for mesh in run.meshes],
            "vertices": sum(mesh.vertices for mesh in run.meshes),
            "faces": sum(len(mesh.faces) for mesh in run.meshes),
            "lines": sum(len(mesh.lines) for mesh in run.meshes),
            "frames": len(run.times),
        }
        for run in runs
    ]
    has_runs = any(part.kind == "RUNS" for part in take_apart(data))
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        **{name: [run[name] for run in of_runs] if has_runs else value for name, value in of_runs[0].items()},
        "integers": hash_integers(runs),
        "positions": positions,
        "data": base64.b64encode(data).decode(),
    }


def hash_integers(runs: list[Animation]) -> dict[str, str]:
    """Return SHA-256 of the integers that every decoder must find, each as `i64`, run by run."""
    groups = [run.motion.group(index) for run in runs for index in range(len(run.motion.groups))]
    meshes = [mesh for run in runs for mesh in run.meshes]
    polygons = (polygon for mesh in meshes for kind in (mesh.faces, mesh.lines) for polygon in kind)
    frames = (frame for group in groups for frame in group.residuals)
    return {
        "polygons": digest(number for polygon in polygons for number in (len(polygon), *polygon)),
        "reference": digest(number for run in runs for point in run.reference.grid for number in point),
        "coefficients": digest(number for group in groups for row in group.coefficients for number in row),
        "residuals": digest(
            number for frame in frames for place, levels in frame.levels.items() for number in (place, *levels)
        ),
    }


def digest(numbers: Iterable[int]) -> str:
    return hashlib.sha256(np.fromiter(numbers, "<i8").tobytes()).hexdigest()


def main(arguments: list[str]) -> None:
    manifest: Manifest = {"accept": {}, "reject": {}}
    different: list[str] = []

    def choose(name: str, made: bytes, known: dict[str, bytes]) -> bytes:
        """Choose the bytes of a vector: the existing ones, or the new ones with `--replace`."""
        if known.get(name, made) == made:
            return made
        different.append(name)
        return made if "--replace" in arguments else known[name]

    known = accepted_vectors() if MANIFEST.exists() else {}
    files = {name: choose(name, made, known) for name, made in accepted()}
    manifest["accept"] = {name: describe(data) for name, data in files.items()}
    known = refused_vectors() if MANIFEST.exists() else {}
    for item in refused():
        data = choose(item.name, item.data, known)
        sha256 = hashlib.sha256(data).hexdigest()
        entry = {"sha256": sha256, "error": item.error, "exit_code": 4, "reason": item.reason}
        section = {} if item.section is None else {"section": item.section}
        manifest["reject"][item.name] = {**entry, **section, "data": base64.b64encode(data).decode()}
    lines = (
        f' "{folder}": {{\n'
        + ",\n".join(f'  "{name}": {json.dumps(entry, ensure_ascii=False)}' for name, entry in entries.items())
        + "\n }"
        for folder, entries in manifest.items()
    )
    MANIFEST.write_text("{\n" + ",\n".join(lines) + "\n}\n", "utf-8")
    done = "replaced" if "--replace" in arguments else "of other bytes than the encoder's today kept"
    print(f"{len(files)} accepted and {len(manifest['reject'])} refused vectors, {len(different)} {done}")


if __name__ == "__main__":
    main(sys.argv[1:])
