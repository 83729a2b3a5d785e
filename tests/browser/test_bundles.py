"""The npm package goes through the bundlers that web applications are built with."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pdecodec import encode, open_animation
from tests.browser.test_view import two_sheets
from tests.support.browser_tools import BROWSER, node_modules
from tests.support.driven_browser import Browser, browsing
from tests.support.remote_server import serving

MAIN = """
import { PDEAnimLoader } from "pdeanim/three";
const group = await new PDEAnimLoader().loadAsync("clip.pdeanim");
group.setTime(0.3);
globalThis.points = [...group.children[1].geometry.attributes.position.array];
"""

PAGE = """<!doctype html>
<script type="importmap">{ "imports": { "three": "./node_modules/three/build/three.module.js" } }</script>
<script type="module" src="built/main.js"></script>
"""


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[tuple[Path, str, Browser]]:
    """Return a served folder, its address and a browser."""
    folder: Path = tmp_path_factory.mktemp("bundles")
    with serving(folder) as server, browsing(tmp_path_factory.mktemp("profile")) as browser:
        yield folder, server.address, browser


@pytest.mark.parametrize(("bundler", "finds_the_module"), [("vite", 1), ("webpack", 1), ("esbuild", 0), ("rollup", 0)])
def test_a_bundle_decodes_in_the_browser(
    opened: tuple[Path, str, Browser], three: Path, packed_player: Path, bundler: str, finds_the_module: int
) -> None:
    modules = node_modules()
    if not (modules / bundler).is_dir():
        pytest.skip(f"{bundler} is not here; npm install --prefix tests/browser")
    served, address, browser = opened
    folder = served / bundler
    shutil.copytree(packed_player, folder / "node_modules" / "pdeanim")
    (folder / "node_modules" / "three").symlink_to(three)
    (folder / "package.json").write_text('{ "type": "module" }')
    (folder / "main.js").write_text(MAIN)
    (folder / "index.html").write_text(PAGE)
    path = folder / "clip.pdeanim"
    encode(two_sheets(), path, tolerance=1e-4)
    shutil.copy(BROWSER / "bundle.mjs", folder)
    command = ["node", "bundle.mjs", bundler, str(modules)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    assert len(list(folder.glob("built/**/*.wasm"))) == finds_the_module
    if not finds_the_module:
        shutil.copy(folder / "node_modules" / "pdeanim" / "pdeanim.wasm", folder / "built")
    browser.open(f"{address}/{bundler}/index.html")
    points = browser.run(
        "for (let k = 0; k < 200 && !globalThis.points; k++) await new Promise((next) => setTimeout(next, 20));"
        "return globalThis.points"
    )
    assert [error for error in browser.errors() if "favicon" not in error] == []
    with open_animation(path) as animation:
        np.testing.assert_allclose(points, np.split(animation.positions(0.3), 2)[1].ravel(), atol=1e-6)
