"""Measure glTF files with morph targets and with motion inside (PDECODEC_mesh_motion): the table in docs/web.md.

``python docs/make_web.py DATA/files docs/web.md gltf-transform``: the folder of the shared files, the page, and the
command of the npm package @gltf-transform/cli.
"""

from __future__ import annotations

import json
import struct
import subprocess
import sys
import tempfile
import zlib
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from pdecodec import open_animation

EXTENSION = "PDECODEC_mesh_motion"

BEGIN, END = "<!-- sizes:begin -->", "<!-- sizes:end -->"

SOURCES = {
    "Fox": "gltf/Fox.glb",
    "robot": "gltf/robot.glb",
    "MorphStressTest": "gltf/MorphStressTest.gltf",
    "flower": "abc/gn_flower.abc",
    "destruction": "abc/destruction.abc",
    "T-shirt": "obj_tshirt",
}

MOTION = ("--motion", "--tolerance", "1e-3", "--web")

COLUMNS = ("clip", "(a) morph targets", "(b) meshopt", "(b) of 11 bits", "(c) `--motion`", "its .pdeanim", "REST, CONN")
COLUMNS += ("(c) / (b)", "(c), `--no-rigid`", "(c) / (b)", "gzip: (b)", "(c)", "(c) / (b)")


def without_images(path: Path) -> tuple[bytes, bytes]:
    """Return a `.glb` file's JSON and buffer without the bytes of images, and its motion."""
    data = path.read_bytes()
    length = struct.unpack_from("<I", data, 12)[0]
    text, chunk = data[20 : 20 + length], bytearray(data[28 + length :])
    root: dict[str, Any] = json.loads(text)
    views = root.get("bufferViews", [])
    motions = [views[one["bufferView"]] for one in root.get("extensions", {}).get(EXTENSION, {}).get("motions", [])]
    motion = b"".join(bytes(chunk[one["byteOffset"] :][: one["byteLength"]]) for one in motions)
    images = [views[one["bufferView"]] for one in root.get("images", []) if "bufferView" in one]
    for view in sorted(images, key=lambda one: -one.get("byteOffset", 0)):
        first = view.get("byteOffset", 0)
        del chunk[first : first + view["byteLength"]]
    for one in root.get("images", []):
        text = text.replace(one.get("uri", "data:").encode(), b"") if one.get("uri", "").startswith("data:") else text
    return text + chunk, motion


def measure(source: Path, transform: str, folder: Path) -> list[str]:
    """Write a clip in every way; return the cells of its row."""

    def convert(name: str, *options: str) -> Path:
        path = folder / name
        command = [sys.executable, "-m", "pdecodec", "convert", str(source), str(path), "--overwrite", "--quiet"]
        subprocess.run([*command, *options], check=True)
        return path

    def squeeze(name: str, *options: str) -> Path:
        path = folder / name
        subprocess.run([transform, "meshopt", str(plain), str(path), *options], check=True, capture_output=True)
        return path

    plain = convert("a.glb")
    files = [plain, squeeze("b.glb"), squeeze("b11.glb", "--quantize-position", "11")]
    files += [convert("c.glb", *MOTION), convert("moved.glb", *MOTION, "--no-rigid")]
    found = [without_images(path) for path in files]
    a, b, coarse, c, moved = (len(one) for one, _ in found)
    squeezed_b, squeezed_c = (len(zlib.compress(found[index][0], 9)) for index in (1, 3))
    motion, repeated = found[3][1], 0
    if motion:
        with open_animation(motion) as coded:
            repeated = coded.sections["REST"] + coded.sections["CONN"]
    sizes = [a, b, coarse, c, len(motion), repeated]
    cells = [*map(_kilobytes, sizes), f"{c / b:.2f}", _kilobytes(moved), f"{moved / b:.2f}"]
    return [*cells, _kilobytes(squeezed_b), _kilobytes(squeezed_c), f"{squeezed_c / squeezed_b:.2f}"]


def _kilobytes(size: int) -> str:
    return f"{size / 1000:.1f} kB"


def _table(rows: Sequence[Sequence[str]]) -> str:
    lines = [COLUMNS, ["---"] + ["---:"] * (len(COLUMNS) - 1), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def main(data: str, page: str, transform: str) -> None:
    rows = []
    for name, path in SOURCES.items():
        with tempfile.TemporaryDirectory() as folder:
            rows.append([name, *measure(Path(data) / path, transform, Path(folder))])
    where = Path(page)
    head, rest = where.read_text(encoding="utf-8").split(BEGIN)
    tail = rest.split(END)[1]
    where.write_text(f"{head}{BEGIN}\n{_table(rows)}\n{END}{tail}", encoding="utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
