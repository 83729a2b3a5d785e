"""Make what a release needs besides packages, and check that everything states one version. Needs Python alone.

python docs/make_release.py notes [TAG]    the changelog's section of the version; TAG must be its tag, as v1.0.0
python docs/make_release.py pack FOLDER    the archives of the decoder and of the vectors, INSTALL.md and SHA256SUMS
"""

from __future__ import annotations

import hashlib
import re
import sys
import tempfile
import zipfile
from collections.abc import Mapping
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))

from core import amalgamation  # noqa: E402
from spec import vector_files  # noqa: E402

FORMAT = "1.0"
"""Version of the file format, and of its extension of glTF."""

STATED = {
    "pyproject.toml": r'^version = "(.+)"',
    "pdecodec/__init__.py": r'^__version__ = "(.+)"',
    "core/CMakeLists.txt": r"^project\(pdeanim VERSION (\S+)",
    "player/package.json": r'^  "version": "(.+)"',
    "plugins/blender/blender_manifest.toml": r'^version = "(.+)"',
    "plugins/blender/README.md": r"blender-pdecodec-([\d.]+)-",
    "plugins/usd/pyproject.toml": r'^version = "(.+)"',
    "plugins/usd/CMakeLists.txt": r"^project\(pdeanim_usd VERSION (\S+)",
    "docs/install.md": r"pdecodec==([\d.]+)",
    "CITATION.cff": r"^version: (.+)",
    "CHANGELOG.md": r"^## \[(\d.*)\] - \d{4}-\d\d-\d\d$",
}
"""Files that state the version, and the regular expression of the first line that does."""


def read(name: str) -> str:
    return (ROOT / name).read_text(encoding="utf-8")


def stated_versions() -> dict[str, str]:
    """Return the version that each file states, or "none"."""
    found = {name: re.search(pattern, read(name), re.MULTILINE) for name, pattern in STATED.items()}
    return {name: match[1] if match else "none" for name, match in found.items()}


def without_links(text: str) -> str:
    """Return text without links within the repository, which lead nowhere elsewhere: their labels stay."""
    return re.sub(r"\[([^\]]*)\]\((?!https?:)[^)]*\)", r"\1", text)


def notes(version: str) -> str:
    """Return the changelog's section of a version, without its heading."""
    _, _, rest = read("CHANGELOG.md").partition(f"\n## [{version}]")
    return without_links(re.split(r"\n## \[|\n\[Unreleased\]:", rest.partition("\n")[2], maxsplit=1)[0]).strip() + "\n"


def write_archive(path: Path, files: Mapping[str, bytes]) -> None:
    """Write a zip archive whose bytes depend on names and contents alone."""
    with zipfile.ZipFile(path, "w") as archive:
        for name, data in files.items():
            entry = zipfile.ZipInfo(name)
            entry.external_attr = 0o644 << 16
            archive.writestr(entry, data, zipfile.ZIP_DEFLATED)


def decoder_files() -> dict[str, bytes]:
    """Return the decoder in one file with its header, the licence, and the example program."""
    with tempfile.TemporaryDirectory() as scratch:
        amalgamation.write(Path(scratch))
        made = [*sorted(Path(scratch).iterdir()), ROOT / "examples/c/play.c", ROOT / "LICENSE"]
        return {path.name: path.read_bytes() for path in made}


def vector_archive() -> dict[str, bytes]:
    """Return the vectors with their manifest, and the schemas and the example of the extension of glTF."""
    kinds = {"accept": vector_files.accepted_vectors(), "reject": vector_files.refused_vectors()}
    extension = [ROOT / "spec/extension/example.glb", *sorted((ROOT / "spec/extension/schema").glob("*.json"))]
    return {
        "manifest.json": vector_files.MANIFEST.read_bytes(),
        **{f"{kind}/{name}.pdeanim": data for kind, files in kinds.items() for name, data in files.items()},
        **{path.relative_to(ROOT / "spec").as_posix(): path.read_bytes() for path in extension},
        "LICENSE": (ROOT / "LICENSE").read_bytes(),
    }


def pack(folder: Path, version: str) -> None:
    """Write the archives and the page about them into a folder, then the checksums of all of its files."""
    write_archive(folder / f"pdeanim-decoder-{version}.zip", decoder_files())
    write_archive(folder / f"pdeanim-vectors-{FORMAT}.zip", vector_archive())
    (folder / "INSTALL.md").write_text(without_links(read("docs/install.md")), encoding="utf-8")
    paths = sorted(path for path in folder.iterdir() if path.is_file() and path.name != "SHA256SUMS")
    sums = "".join(f"{hashlib.sha256(path.read_bytes()).hexdigest()}  {path.name}\n" for path in paths)
    (folder / "SHA256SUMS").write_text(sums, encoding="utf-8")


if __name__ == "__main__":
    command, *given = sys.argv[1:]
    versions = stated_versions()
    wanted = given[0].removeprefix("v") if command == "notes" and given else versions["pyproject.toml"]
    if others := [f"{name} states {one}, not {wanted}" for name, one in versions.items() if one != wanted]:
        sys.exit("\n".join(others))
    if command == "pack":
        pack(Path(given[0]), wanted)
    else:
        print(notes(wanted), end="")
