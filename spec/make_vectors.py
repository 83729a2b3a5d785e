"""Make the vectors of the specification. Run it deliberately (`make vectors`); no test does.

    python -m spec.make_vectors             write vectors that do not exist yet; keep all others
    python -m spec.make_vectors --replace   also replace vectors that the current encoder writes differently

Accepted files pin down decoding. Encoders may write other bytes for the same input; then nothing has to change here.
Once the version of the format is released, its vectors are never replaced.
"""

from __future__ import annotations

import base64
import hashlib
import json
import struct
import sys
from collections.abc import Iterable
from typing import Any

import numpy as np

from spec.accepted import accepted
from spec.accepted_drawn import accepted_drawn
from spec.accepted_fields import accepted_with_fields
from spec.decoder.animation import Animation, decode_runs, run_at
from spec.decoder.cells import SHAPES
from spec.decoder.mesh import Mesh
from spec.refused import Refused, refused
from spec.refused_fields import refused_with_fields
from spec.refused_rules import refused_rules
from spec.sealing import take_apart
from spec.vector_files import MANIFEST, Manifest, accepted_vectors, refused_vectors

LISTED_TIMES = (0.0, 0.3, 0.77, 1.0)
"""Times at which positions are listed, as fractions of the clip."""

MAX_LISTED_VERTICES = 4
"""Largest number of vertices whose positions are listed, and of values of a field."""


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
    of_fields = [[describe_field(run, index) for index in range(len(run.fields))] for run in runs]
    has_runs = any(part.kind == "RUNS" for part in take_apart(data))
    return {
        "sha256": hashlib.sha256(data).hexdigest(),
        **{name: [run[name] for run in of_runs] if has_runs else value for name, value in of_runs[0].items()},
        "integers": hash_integers(runs),
        "positions": positions,
        **({"fields": of_fields if has_runs else of_fields[0]} if any(of_fields) else {}),
        "data": base64.b64encode(data).decode(),
    }


def describe_field(run: Animation, index: int) -> dict[str, Any]:
    """Describe a field of a run: its header, the SHA-256 of its values if their arithmetic is specified, and
    some values.
    """
    own = run.fields[index]
    values = b"".join(struct.pack(f"<{len(frame)}{own.type}", *frame) for frame in own.frames)
    listed = []
    for time in dict.fromkeys(run.times[0] + (run.times[-1] - run.times[0]) * moment for moment in LISTED_TIMES):
        row = run.field(index, time)
        shown = row[:: -(-len(row) // MAX_LISTED_VERTICES) or 1]
        # Values are listed as text: JSON has no NaN and no infinity, and its readers round integers above 2^53.
        listed.append([time, *(repr(value) if isinstance(value, float) else str(int(value)) for value in shown)])
    return {
        "name": own.name,
        "unit": own.unit,
        "domain": own.domain,
        "type": "boolean" if own.type == "?" else np.dtype(own.type).name,
        "components": own.components,
        "objects": own.objects,
        "range": list(own.range),
        "bound": own.bound,
        **({} if run.depends_on_motion(index) else {"sha256": hashlib.sha256(values).hexdigest()}),
        "values": listed,
    }


def cells_of(mesh: Mesh) -> list[list[int]]:
    """Return the number of the shape and the nodes of each cell."""
    return [[SHAPES.index(cell.shape), *cell.nodes] for cell in mesh.cells]


def hash_integers(runs: list[Animation]) -> dict[str, str]:
    """Return SHA-256 of the integers that every decoder must find, each as `i64`, run by run."""
    groups = [run.motion.group(index) for run in runs for index in range(len(run.motion.groups))]
    meshes = [mesh for run in runs for mesh in run.meshes]
    polygons = (polygon for mesh in meshes for kind in (mesh.faces, mesh.lines, cells_of(mesh)) for polygon in kind)
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
    files = {
        name: choose(name, made, known) for name, made in (*accepted(), *accepted_with_fields(), *accepted_drawn())
    }
    manifest["accept"] = {name: describe(data) for name, data in files.items()}
    known = refused_vectors() if MANIFEST.exists() else {}
    of_fields = (Refused(*item, section="FLDS") for item in refused_with_fields())
    for item in (*refused(), *refused_rules(), *of_fields):
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
