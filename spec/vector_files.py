"""The vectors of the specification: accepted ones are files, refused ones are in the manifest.

    python -m spec.vector_files FOLDER      write the refused ones as files, for programs that need files

There are three times as many refused files as accepted ones, about three hundred bytes each.
"""

from __future__ import annotations

import base64
import json
import sys
from pathlib import Path
from typing import Any

FOLDER = Path(__file__).resolve().parent / "vectors"
ACCEPT = FOLDER / "accept"
MANIFEST = FOLDER / "manifest.json"

Manifest = dict[str, dict[str, dict[str, Any]]]


def read_manifest() -> Manifest:
    """Return what is expected of each vector, by `accept` or `reject` and by name."""
    manifest: Manifest = json.loads(MANIFEST.read_text("utf-8"))
    return manifest


def accepted_vectors() -> dict[str, bytes]:
    """Return the files that every decoder must read, by name."""
    return {path.stem: path.read_bytes() for path in sorted(ACCEPT.glob("*.pdeanim"))}


def refused_vectors() -> dict[str, bytes]:
    """Return the files that every decoder must refuse, by name."""
    return {name: base64.b64decode(entry["data"]) for name, entry in read_manifest()["reject"].items()}


def write_refused(folder: Path) -> list[Path]:
    """Write the refused files into a folder, which is made; return their paths in the manifest's order."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = [folder / f"{name}.pdeanim" for name in refused_vectors()]
    for path, data in zip(paths, refused_vectors().values(), strict=True):
        path.write_bytes(data)
    return paths


if __name__ == "__main__":
    write_refused(Path(sys.argv[1]))
