"""Node modules and a browser for tests of glTF files and of pages; tests skip by name where they are absent."""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

BROWSER = Path(__file__).resolve().parents[1] / "browser"

CHROMIUM_NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")

PATIENCE = 120
"""Seconds that a browser without a graphics card may take."""


def node_modules() -> Path:
    """Where gltf-validator and three are: PDECODEC_NODE_MODULES, or beside the scripts."""
    folder = Path(os.environ.get("PDECODEC_NODE_MODULES", BROWSER / "node_modules"))
    if shutil.which("node") is None:
        pytest.skip("node is not here")
    return folder


def gltf_issues(path: Path) -> dict[str, Any]:
    """What Khronos' validator says of a file."""
    folder = node_modules()
    if not (folder / "gltf-validator").is_dir():
        pytest.skip("gltf-validator is not here; npm install --prefix tests/browser")
    command = ["node", str(BROWSER / "validate.js"), str(path)]
    environment = {**os.environ, "NODE_PATH": str(folder)}
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def assert_valid(path: Path) -> None:
    """No error, and no warning."""
    issues = gltf_issues(path)
    bad = [
        f"{item['code']} {item['pointer']}: {item['message']}" for item in issues["messages"] if item["severity"] < 2
    ]
    assert issues["numErrors"] == issues["numWarnings"] == 0, bad


def chromium() -> str:
    """The browser's program."""
    found = next((path for name in CHROMIUM_NAMES if (path := shutil.which(name))), None)
    if found is None:
        pytest.skip("chromium is not here")
    return found


@dataclass(frozen=True)
class LoadedPage:
    """What a browser made of a page.

    Attributes
    ----------
    charts, drawn : int
        Places of charts, and how many of them hold one.
    errors : list of str
        What it wrote on the console.
    """

    charts: int
    drawn: int
    errors: list[str]


def load_page(file: Path, profile: Path) -> LoadedPage:
    """Load a page from disk in headless Chromium."""
    options = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--virtual-time-budget=20000"]
    command = [chromium(), *options, f"--user-data-dir={profile}", "--dump-dom", file.resolve().as_uri()]
    done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE)
    assert "</html>" in done.stdout, done.stderr[-2000:]
    places = re.findall(r'<div class="chart[^>]*>', done.stdout)
    drawn = [place for place in places if 'data-drawn="yes"' in place]
    assert done.stdout.count("marks") >= len(drawn), "a chart without marks"
    return LoadedPage(len(places), len(drawn), re.findall(r".*CONSOLE.*", done.stderr))
