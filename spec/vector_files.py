"""The vectors of the specification, all in `vectors/manifest.json`: the expected result for each file, and its bytes.

    python -m spec.vector_files FOLDER      write them as FOLDER/accept/NAME.pdeanim and FOLDER/reject/NAME.pdeanim

The files are small, about six hundred bytes each, and tests read them together. This module needs only Python.
"""

from __future__ import annotations

import base64
import json
import os
import sys
from functools import cache
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
MANIFEST = ROOT / "spec" / "vectors" / "manifest.json"

Manifest = dict[str, dict[str, dict[str, Any]]]


@cache
def read_manifest() -> Manifest:
    """Return the expected result of each vector, and its bytes in base64, by `accept` or `reject` and by name."""
    manifest: Manifest = json.loads(MANIFEST.read_text("utf-8"))
    return manifest


def accepted_vectors() -> dict[str, bytes]:
    """Return the files that every decoder must read, by name."""
    return _unpack("accept")


def refused_vectors() -> dict[str, bytes]:
    """Return the files that every decoder must refuse, by name."""
    return _unpack("reject")


def write_vectors(folder: Path, kind: str) -> dict[str, Path]:
    """Write the vectors of a kind, `accept` or `reject`, into a folder, which is made; return their paths by name."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = {name: folder / f"{name}.pdeanim" for name in read_manifest()[kind]}
    for name, data in _unpack(kind).items():
        if not paths[name].exists() or paths[name].read_bytes() != data:
            partial = paths[name].with_suffix(f".{os.getpid()}")  # other processes may read the file meanwhile
            partial.write_bytes(data)
            partial.replace(paths[name])
    return paths


@cache
def accepted_files() -> dict[str, Path]:
    """Write the accepted files under `build/vectors`, once per process, and return their paths by name."""
    return write_vectors(ROOT / "build" / "vectors" / "accept", "accept")


def _unpack(kind: str) -> dict[str, bytes]:
    return {name: base64.b64decode(entry["data"]) for name, entry in read_manifest()[kind].items()}


if __name__ == "__main__":
    for kind in read_manifest():
        write_vectors(Path(sys.argv[1], kind), kind)
