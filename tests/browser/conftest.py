"""The npm package as it is installed, for tests of programs that use it."""

from __future__ import annotations

import json
import shutil
import subprocess
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from tests.support import browser_tools
from tests.support.browser_tools import node_module

PLAYER = Path(__file__).resolve().parents[2] / "player"


@pytest.fixture(scope="session")
def three() -> Path:
    """Return the folder of three.js."""
    return node_module("three")


@pytest.fixture(scope="session")
def packed_player(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the player's npm package, packed and unpacked again."""
    if shutil.which("npm") is None:
        pytest.skip("npm is not here")
    folder: Path = tmp_path_factory.mktemp("packed")
    command = ["npm", "pack", "--json", "--pack-destination", str(folder)]
    done = subprocess.run(command, cwd=PLAYER, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    (packed,) = json.loads(done.stdout)
    names = {item["path"] for item in packed["files"]}
    assert {"pdeanim.wasm", "pdeanim.js", "pdeanim.d.ts", "three.js", "README.md", "LICENSE"} <= names
    assert not {name for name in names if "__init__" in name or name.startswith("view/")}
    shutil.unpack_archive(folder / packed["filename"], folder, "gztar")
    return folder / "package"


@pytest.fixture(scope="module")
def site(three: Path, packed_player: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with three.js and the player in node_modules."""
    folder: Path = tmp_path_factory.mktemp("site")
    modules = folder / "node_modules"
    shutil.copytree(packed_player, modules / "pdeanim")
    (modules / "three").symlink_to(three)
    return folder


@pytest.fixture(scope="module")
def run_node(site: Path) -> Callable[..., Any]:
    """Return a function that runs a module's text next to `site`'s node_modules: ``found`` is what the text sets."""

    def run(text: str, *given: object) -> Any:
        script = f"const given = JSON.parse(process.argv[2]); let found;\n{text}\nconsole.log(JSON.stringify(found));"
        (site / "script.mjs").write_text(script)
        return json.loads(browser_tools.run_node("script.mjs", json.dumps(given), folder=site))

    return run
