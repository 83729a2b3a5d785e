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
"""Time limit of Node, and of a browser without a graphics card [s]."""


def node_modules() -> Path:
    """Return the folder with gltf-validator and three: PDECODEC_NODE_MODULES, or the one next to the scripts."""
    return Path(os.environ.get("PDECODEC_NODE_MODULES", BROWSER / "node_modules"))


def node_module(name: str) -> Path:
    """Return the folder of a module; skip the test if it is missing."""
    folder = node_modules() / name
    if not folder.is_dir():
        pytest.skip(f"{name} is not here; npm install --prefix tests/browser")
    return folder


def run_node(*arguments: object, folder: Path | None = None, given: str | None = None) -> str:
    """Run Node in a folder with text `given` as its input; return what it prints."""
    if shutil.which("node") is None:
        pytest.skip("node is not here")
    command = ["node", *map(str, arguments)]
    done = subprocess.run(
        command, cwd=folder, input=given, env=os.environ | {"NODE_PATH": str(node_modules())},
        capture_output=True, text=True, check=False, timeout=PATIENCE,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr + done.stdout
    return done.stdout


def bundle(folder: Path, bundler: str) -> None:
    """Build the folder's ``main.js`` into its folder ``built``."""
    node_module(bundler)
    run_node(BROWSER / "bundle.mjs", bundler, node_modules(), folder=folder)


def gltf_issues(path: Path) -> dict[str, Any]:
    """Return the report of Khronos' validator on a file."""
    node_module("gltf-validator")
    found: dict[str, Any] = json.loads(run_node(BROWSER / "validate.js", path))
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
