"""Play glTF files with three.js in headless Chromium; tests are skipped if one is missing, and name it."""

from __future__ import annotations

import http.server
import json
import subprocess
import threading
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.mesh.arrays import Float32Array
from tests.support.browser_tools import BROWSER, chromium, node_modules

PATIENCE = 3600
"""Time limit for all files [s]."""

WITH_GRAPHICS = ("--disable-gpu-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader")

QUIET = (
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-quic",
    "--disable-sync",
    "--no-first-run",
)


@dataclass(frozen=True, eq=False)
class PlayedMesh:
    """A primitive as three.js draws it.

    Attributes
    ----------
    name : str
    kind : str
        ``Mesh``, ``SkinnedMesh``, ``Line``, ``LineSegments``, ``Points``, ...
    points : (times, vertices, 3) float32
        In the scene's space.
    """

    name: str
    kind: str
    points: Float32Array


class _Server(http.server.ThreadingHTTPServer):
    """A server of the page, the modules and the files, which also receives the page's results."""

    def __init__(self, files: Sequence[tuple[Path, Sequence[float]]], modules: Path, *, draw: bool) -> None:
        self.files, self.modules, self.draw = files, modules, draw
        self.meshes: dict[int, list[dict[str, Any]]] = {}
        self.found: dict[int, list[PlayedMesh] | str] = {}
        self.finished = threading.Event()
        super().__init__(("127.0.0.1", 0), _Handler)


class _Handler(http.server.BaseHTTPRequestHandler):
    server: _Server

    def do_GET(self) -> None:
        path = self.path.partition("?")[0]
        kind = {".js": "text/javascript", ".json": "application/json"}.get(Path(path).suffix, "text/html")
        if path == "/jobs.json":
            jobs = {"draw": self.server.draw, "times": [list(times) for _, times in self.server.files]}
            content = json.dumps(jobs).encode()
        elif path.startswith("/file/"):
            content, kind = self.server.files[int(path.rpartition("/")[2])][0].read_bytes(), "model/gltf-binary"
        elif path.startswith("/node_modules/") and ".." not in path:
            content = (self.server.modules / path.removeprefix("/node_modules/")).read_bytes()
        elif path == "/":
            content = (BROWSER / "play.html").read_bytes()
        else:
            self.send_error(404)
            return
        self._answer(content, kind)

    def do_POST(self) -> None:
        content = self.rfile.read(int(self.headers["Content-Length"] or 0))
        _, what, *rest = self.path.split("/")
        server = self.server
        if what == "finished":
            server.finished.set()
        elif what == "failed":
            server.found[int(rest[0])] = content.decode()
        elif what == "meshes":
            server.meshes[int(rest[0])] = json.loads(content)
        else:
            meshes = server.meshes[int(rest[0])]
            times = len(server.files[int(rest[0])][1])
            points = np.frombuffer(content, np.float32).reshape(times, -1, 3)
            parts = np.split(points, np.cumsum([mesh["count"] for mesh in meshes])[:-1], axis=1)
            server.found[int(rest[0])] = [
                PlayedMesh(mesh["name"], mesh["kind"], part) for mesh, part in zip(meshes, parts, strict=False)
            ]
        self._answer(b"", "text/plain")

    def _answer(self, content: bytes, kind: str) -> None:
        self.send_response(200)
        self.send_header("Content-Type", kind)
        self.send_header("Content-Length", str(len(content)))
        self.end_headers()
        self.wfile.write(content)

    def log_message(self, *arguments: Any) -> None:
        """Log nothing: pytest's output is for tests."""


def play(
    files: Sequence[tuple[Path, Sequence[float]]], profile: Path, *, draw: bool, patience: float = PATIENCE
) -> list[list[PlayedMesh] | str]:
    """Return the primitives of each file at times [s], or the reason why there are none. With `draw`, the page also
    draws them.

    Skips the test if there is no browser or no three.js.
    """
    modules, browser = node_modules(), chromium()
    if not (modules / "three").is_dir():
        pytest.skip("three.js is not here; npm install --prefix tests/browser")
    server = _Server(files, modules, draw=draw)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    command = [browser, "--headless", "--no-sandbox", *QUIET, *(WITH_GRAPHICS if draw else ("--disable-gpu",))]
    command += [f"--user-data-dir={profile}", "--remote-debugging-port=0"]
    command.append(f"http://127.0.0.1:{server.server_address[1]}/")
    process = subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    end = time.monotonic() + patience
    try:
        # Stop waiting if the browser has ended.
        while not server.finished.wait(0.1) and process.poll() is None and time.monotonic() < end:
            pass
    finally:
        process.terminate()
        process.wait()
        server.shutdown()
        server.server_close()
    return [server.found.get(number, "three.js did not end") for number in range(len(files))]
