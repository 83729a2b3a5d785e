"""Build the extension: the files of this folder and the wheels that they need, in one archive.

    python plugins/blender/build.py dist WHEEL...

A wheel of the package pdecodec and one of nanobind-backend for each platform; `make blender-extension` makes those of
this machine. Everything else that pdecodec imports here, Blender has: numpy and zstandard.
"""

from __future__ import annotations

import sys
import tomllib
import zipfile
from collections.abc import Sequence
from pathlib import Path

HERE = Path(__file__).resolve().parent

FILES = ("__init__.py", "meshes.py", "player.py", "README.md")

PLATFORMS = {
    ("linux", "x86_64"): "linux-x64",
    ("linux", "aarch64"): "linux-arm64",
    ("macosx", "x86_64"): "macos-x64",
    ("macosx", "arm64"): "macos-arm64",
    ("win", "amd64"): "windows-x64",
    ("win", "arm64"): "windows-arm64",
}
"""Blender's names of platforms, by what is in the names of wheels."""


def platform_of(wheel: Path) -> str:
    """Return Blender's name of a wheel's platform."""
    tag = wheel.stem.rpartition("-")[2]
    return next(name for parts, name in PLATFORMS.items() if all(part in tag for part in parts))


def build(folder: Path, wheels: Sequence[Path]) -> Path:
    """Write the archive, which is named by its version and platforms, into a folder, and return its path."""
    manifest = (HERE / "blender_manifest.toml").read_text(encoding="utf-8")
    platforms = sorted({platform_of(wheel) for wheel in wheels})
    # Keys of the whole file come before its first table.
    head, table = manifest.split("\n[", 1)
    listed = "".join(f'  "./wheels/{wheel.name}",\n' for wheel in wheels)
    named = ", ".join(f'"{name}"' for name in platforms)
    manifest = f"{head}platforms = [{named}]\nwheels = [\n{listed}]\n\n[{table}"
    facts = tomllib.loads(manifest)
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"blender-{facts['id']}-{facts['version']}-{'-'.join(platforms)}.zip"
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        parts = {"blender_manifest.toml": manifest.encode(), **{name: (HERE / name).read_bytes() for name in FILES}}
        for name, data in {**parts, **{f"wheels/{wheel.name}": wheel.read_bytes() for wheel in wheels}}.items():
            entry = zipfile.ZipInfo(name)  # without the time of now: the same files give the same bytes
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)
    return path


if __name__ == "__main__":
    print(build(Path(sys.argv[1]), [Path(name) for name in sys.argv[2:]]))
