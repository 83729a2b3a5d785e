"""Node modules and a browser for tests of glTF files and of pages; tests skip by name where they are absent."""

from __future__ import annotations

import functools
import html
import http.server
import json
import os
import re
import shutil
import subprocess
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

BROWSER = Path(__file__).resolve().parent / "browser"

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


class _Server(http.server.ThreadingHTTPServer):
    """Serves the page, the modules and one glTF file."""

    def __init__(self, file: Path, modules: Path) -> None:
        self.file, self.modules = file, modules
        super().__init__(("127.0.0.1", 0), _Handler)


class _Handler(http.server.BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        if path == "/x.glb":
            found = self.server.file
        elif path.startswith("/node_modules/") and ".." not in path:
            found = self.server.modules / path.removeprefix("/node_modules/")
        else:
            found = BROWSER / "play.html"
        if not found.is_file():
            self.send_error(404)
            return
        kinds = {".js": "text/javascript", ".html": "text/html; charset=utf-8"}
        self.send_response(200)
        self.send_header("Content-Type", kinds.get(found.suffix, "application/octet-stream"))
        self.end_headers()
        self.wfile.write(found.read_bytes())

    def log_message(self, *arguments: Any) -> None:
        """Nothing: pytest's output is for tests."""


@contextmanager
def _served(file: Path, modules: Path) -> Iterator[str]:
    server = _Server(file, modules)
    thread = threading.Thread(target=functools.partial(server.serve_forever, poll_interval=0.05), daemon=True)
    thread.start()
    try:
        yield f"http://127.0.0.1:{server.server_address[1]}"
    finally:
        server.shutdown()
        server.server_close()
        thread.join()


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


def play_in_browser(file: Path, times: Sequence[float], profile: Path) -> list[list[dict[str, Any]]]:
    """Play a glTF file with three.js in headless Chromium.

    Returns
    -------
    list
        For each time [s] a list of meshes: ``name``, and ``points`` one coordinate after the other.
    """
    modules = node_modules()
    browser = chromium()
    if not (modules / "three").is_dir():
        pytest.skip("three.js is not here; npm install --prefix tests/browser")
    with _served(file, modules) as address:
        command = [
            browser,
            "--headless",
            "--no-sandbox",
            "--disable-gpu-sandbox",
            "--use-gl=angle",
            "--use-angle=swiftshader",
            "--enable-unsafe-swiftshader",
            f"--user-data-dir={profile}",
            "--virtual-time-budget=60000",
            "--dump-dom",
            f"{address}/?times={','.join(map(repr, times))}",
        ]
        done = subprocess.run(command, capture_output=True, text=True, check=False, timeout=PATIENCE)
    body = re.search(r"<body>(.*?)</body>", done.stdout, re.DOTALL)
    assert body is not None, done.stderr[-2000:]
    result = json.loads(html.unescape(body[1]))
    assert "failed" not in result, result
    assert result["errors"] == 0, "WebGL reported an error"
    frames: list[list[dict[str, Any]]] = result["frames"]
    return frames
