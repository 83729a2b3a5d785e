"""Check that everything states one version, and print the changelog's section of that version.

    python docs/make_release.py [TAG]

TAG is the tag of the release, such as v1.0.0; without one, the files are compared with each other. Needs Python alone.
"""

from __future__ import annotations

import re
import sys
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]

STATED = {
    "pyproject.toml": r'^version = "(.+)"',
    "pdecodec/__init__.py": r'^__version__ = "(.+)"',
    "core/CMakeLists.txt": r"^project\(pdeanim VERSION (\S+)",
    "player/package.json": r'^  "version": "(.+)"',
    "plugins/blender/blender_manifest.toml": r'^version = "(.+)"',
    "plugins/blender/README.md": r"blender-pdecodec-([\d.]+)-",
    "plugins/usd/pyproject.toml": r'^version = "(.+)"',
    "plugins/usd/CMakeLists.txt": r"^project\(pdeanim_usd VERSION (\S+)",
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


def notes(version: str) -> str:
    """Return the changelog's section of a version, without its heading."""
    _, _, rest = read("CHANGELOG.md").partition(f"\n## [{version}]")
    return re.split(r"\n## \[|\n\[Unreleased\]:", rest.partition("\n")[2], maxsplit=1)[0].strip() + "\n"


if __name__ == "__main__":
    versions = stated_versions()
    wanted = sys.argv[1].removeprefix("v") if len(sys.argv) > 1 else versions["pyproject.toml"]
    if others := [f"{name} states {one}, not {wanted}" for name, one in versions.items() if one != wanted]:
        sys.exit("\n".join(others))
    print(notes(wanted), end="")
