"""Node modules and a browser for tests of glTF files and pages; tests are skipped if one is missing, and name it."""

from __future__ import annotations

import json
import os
import shutil
import subprocess
from collections.abc import Collection
from pathlib import Path
from typing import Any

import pytest

BROWSER = Path(__file__).resolve().parents[1] / "browser"

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")

PATIENCE = 120
"""Time limit of a browser without a graphics card [s]."""


def node_modules() -> Path:
    """Return the folder with gltf-validator and three: PDECODEC_NODE_MODULES, or the one next to the scripts."""
    folder = Path(os.environ.get("PDECODEC_NODE_MODULES", BROWSER / "node_modules"))
    if shutil.which("node") is None:
        pytest.skip("node is not here")
    return folder


def gltf_issues(path: Path) -> dict[str, Any]:
    """Return the report of Khronos' validator on a file."""
    folder = node_modules()
    if not (folder / "gltf-validator").is_dir():
        pytest.skip("gltf-validator is not here; npm install --prefix tests/browser")
    command = ["node", str(BROWSER / "validate.js"), str(path)]
    environment = {**os.environ, "NODE_PATH": str(folder)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def assert_valid(path: Path, *, expected: Collection[tuple[str, str]] = ()) -> None:
    """Assert that the validator finds no error and no warning but those `expected`, each a code and a pointer."""
    issues = gltf_issues(path)
    found = [item for item in issues["messages"] if item["severity"] < 2]
    bad = [
        f"{item['code']} {item['pointer']}: {item['message']}"
        for item in found
        if (item["code"], item["pointer"]) not in expected
    ]
    assert bad == []
    assert issues["numErrors"] + issues["numWarnings"] == len(found)


def chromium() -> str:
    """Return the path of the browser."""
    found = next((path for name in CHROMIUM_NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("chromium is not here")
    return found
