"""A headless Chromium that draws without a graphics card, controlled through chromedriver by plain HTTP."""

from __future__ import annotations

import base64
import json
import re
import shutil
import subprocess
import urllib.request
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import pytest

from tests.support.browser_tools import PATIENCE, chromium

FLAGS = (
    *("--headless", "--no-sandbox", "--no-first-run", "--disable-quic", "--disable-sync"),
    *("--disable-background-networking", "--disable-component-update"),
    *("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--hide-scrollbars"),
    *("--enable-unsafe-webgpu", "--use-webgpu-adapter=swiftshader"),
)


@dataclass(frozen=True)
class Browser:
    """One open session."""

    address: str

    def call(self, method: str, path: str, content: Mapping[str, Any] | None = None) -> Any:
        data = None if content is None else json.dumps(content).encode()
        request = urllib.request.Request(f"{self.address}{path}", data, {"Content-Type": "application/json"})
        request.method = method
        with urllib.request.urlopen(request, timeout=PATIENCE) as answer:
            return json.load(answer)["value"]

    def open(self, address: str) -> None:
        self.call("POST", "/url", {"url": address})

    def run(self, script: str, *arguments: object) -> Any:
        """Run a script; return its result, or that of the promise it returns."""
        waiting = (
            "const done = arguments[arguments.length - 1]; const given = [...arguments].slice(0, -1);"
            "(async (...arguments_) => {" + script + "})(...given)"
            ".then((value) => done({ value }), (error) => done({ error: String(error) }));"
        )
        found = self.call("POST", "/execute/async", {"script": waiting, "args": list(arguments)})
        assert "error" not in found, found["error"]
        return found.get("value")

    def resize(self, width: int, height: int) -> None:
        self.call(
            "POST",
            "/goog/cdp/execute",
            {
                "cmd": "Emulation.setDeviceMetricsOverride",
                "params": {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": width < 600},
            },
        )

    def picture(self) -> bytes:
        return base64.b64decode(self.call("GET", "/screenshot"))

    def errors(self) -> list[str]:
        """Return the logged errors."""
        entries = self.call("POST", "/se/log", {"type": "browser"})
        return [entry["message"] for entry in entries if entry["level"] == "SEVERE"]


@contextmanager
def browsing(profile: Path) -> Iterator[Browser]:
    """Open a browser with an empty profile for this block."""
    program, driver = chromium(), shutil.which("chromedriver")
    if driver is None:
        pytest.skip("chromedriver is not here")
    process = subprocess.Popen([driver, "--port=0"], stdout=subprocess.PIPE, text=True)
    try:
        assert process.stdout is not None
        port = next(found[1] for line in process.stdout if (found := re.search(r"on port (\d+)\.", line)))
        options = {"binary": program, "args": [*FLAGS, f"--user-data-dir={profile}"]}
        capabilities = {"goog:chromeOptions": options, "goog:loggingPrefs": {"browser": "ALL"}}
        start = Browser(f"http://127.0.0.1:{port}/session")
        session = start.call("POST", "", {"capabilities": {"alwaysMatch": capabilities}})
        browser = Browser(f"{start.address}/{session['sessionId']}")
        browser.call("POST", "/timeouts", {"script": 1000 * PATIENCE})
        try:
            yield browser
        finally:
            browser.call("DELETE", "")
    finally:
        process.terminate()
        process.wait(PATIENCE)
        if process.stdout is not None:
            process.stdout.close()
