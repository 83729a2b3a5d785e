"""Use an installed pdecodec, and print what it encoded and decoded, as JSON.

    python use.py MANIFEST FOLDER

Runs where nothing but the package and what it needs is installed: it imports nothing of the repository. It decodes all
accepted vectors of MANIFEST, has all others refused, and encodes clips whose positions are the same on every
platform. Digests are SHA-256 of everything decoded, and of each file written; equal digests are equal bits.
"""

from __future__ import annotations

import base64
import hashlib
import json
import platform
import sys
import sysconfig
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

import pdecodec
from pdecodec.cli.main import run


def decoded(animation: Any) -> Iterator[Any]:
    """Yield everything that an animation of one run holds: arrays, or text."""
    times = np.asarray(animation.times)
    between = (times[1:] + times[:-1]) / 2
    yield from (times, animation.positions(times), animation.velocities(times))
    yield animation.positions(between)
    for mesh in animation.objects:
        yield mesh.name
        yield from (array for array in vars(mesh.connectivity).values() if isinstance(array, np.ndarray))
        for attribute in mesh.attributes:
            yield from (attribute.name, attribute.values, str(attribute.labels))
            yield from () if attribute.indices is None else (attribute.indices,)
    for field in animation.fields:
        yield from (field.name, animation.read_field(field.name, 0, animation.frame_count))


def digest(parts: Iterator[Any]) -> str:
    found = hashlib.sha256()
    for part in parts:
        found.update(part.encode() if isinstance(part, str) else np.ascontiguousarray(part).tobytes())
    return found.hexdigest()


def outcome(path: Path) -> str:
    """Return the digest of a file, or the error that refuses it."""
    try:
        with pdecodec.open(path) as animation:
            animation.verify()
            return digest(part for run in animation.runs for part in decoded(run))
    except pdecodec.PdecodecError as error:
        return f"{type(error).__name__} {error.code} exit {error.exit_code}"


def clip(frames: int, rows: int, columns: int) -> np.ndarray:
    """Return positions of a sheet that swings, from sums and products alone: (frames, rows * columns, 3) float32."""
    t, y, x = np.meshgrid(np.arange(frames), np.arange(rows), np.arange(columns), indexing="ij")
    swing = np.abs((t * 5 + x * 3) % 64 - 32.0) / 32
    noise = np.random.default_rng(7).integers(-8, 9, t.shape) / 4096
    points = np.stack([x + noise, y + swing * swing / 2, swing * (y + 1) / 4 + noise], axis=-1)
    return points.reshape(frames, -1, 3).astype(np.float32)


def faces(rows: int, columns: int) -> np.ndarray:
    """Return the corners of the quads of a sheet."""
    first = np.add.outer(np.arange(rows - 1) * columns, np.arange(columns - 1)).ravel()
    return np.stack([first, first + 1, first + columns + 1, first + columns], axis=-1)


def written(folder: Path) -> Iterator[tuple[str, Path]]:
    """Encode clips through the library and the command line; yield each file with a name."""
    rows, columns = 12, 20
    points = clip(40, rows, columns)
    connectivity = pdecodec.Connectivity.from_padded(len(points[0]), faces(rows, columns))
    sheet = pdecodec.ArraySequence(points, objects=[pdecodec.MeshObject("sheet", connectivity)])
    for tolerance in (1e-2, 1e-3, 1e-5):
        path = folder / f"sheet-{tolerance:g}.pdeanim"
        pdecodec.encode(sheet, path, pdecodec.EncodeSettings(tolerance=tolerance))
        yield path.stem, path
    pdecodec.encode(sheet, folder / "paper.pdeanim", pdecodec.EncodeSettings(profile="paper"))
    yield "paper", folder / "paper.pdeanim"
    cloth, encoded, copy = (str(folder / name) for name in ("cloth.####.obj", "cloth.pdeanim", "copy.npz"))
    commands: list[list[str]] = [
        ["simulate", "cloth", "-o", cloth, "--frames", "6", "--columns", "16", "--rows", "12"],
        ["encode", cloth, "-o", encoded],
        ["info", encoded, "--json"],
        ["check", encoded],
        ["decode", encoded, "-o", copy],
        ["compare", copy, encoded],
    ]
    output, sys.stdout = sys.stdout, sys.stderr
    try:
        for command in commands:
            if run([*command, *(["--overwrite"] if "-o" in command else [])]):
                sys.exit(f"pdecodec {' '.join(command)} failed")
    finally:
        sys.stdout = output
    yield "cloth", folder / "cloth.pdeanim"


def main(manifest: Path, folder: Path) -> None:
    vectors = json.loads(manifest.read_text("utf-8"))
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "vector.pdeanim"
    outcomes: dict[str, dict[str, str]] = {}
    for kind in ("accept", "reject"):
        outcomes[kind] = {}
        for name, vector in vectors[kind].items():
            path.write_bytes(base64.b64decode(vector["data"]))
            outcomes[kind][name] = outcome(path)
            code = outcomes[kind][name].partition(" exit ")[2]
            if code != str(vector.get("exit_code", "")):
                sys.exit(f"{kind} {name}: {outcomes[kind][name]}")
    files = dict(written(folder))
    outcomes["encoded"] = {name: hashlib.sha256(file.read_bytes()).hexdigest() for name, file in files.items()}
    outcomes["decoded"] = {name: outcome(file) for name, file in files.items()}
    described = f"{platform.python_implementation()} {platform.python_version()} {sysconfig.get_platform()}"
    place = str(Path(pdecodec.__file__).resolve().parent)
    print(json.dumps({"python": described, "package": place, "outcomes": outcomes}))


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]))
