"""The player's loader for three.js, and its npm package."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from browser_tools import node_modules
from driven_browser import browsing
from remote_server import serving
from test_view import two_sheets

from pdecodec import encode, open_animation
from spec.accepted import with_attributes

ROOT = Path(__file__).resolve().parent.parent
PLAYER = ROOT / "player"


def npm(*arguments: str | Path, folder: Path) -> str:
    if shutil.which("npm") is None:
        pytest.skip("npm is not here")
    command = ["npm", *map(str, arguments)]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


@pytest.fixture(scope="module")
def three() -> Path:
    """The folder of three.js."""
    folder = node_modules() / "three"
    if not folder.is_dir():
        pytest.skip("three.js is not here; npm install --prefix tests/browser")
    return folder


@pytest.fixture(scope="module")
def site(three: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with the packed and unpacked player, and three.js, in node_modules."""
    folder: Path = tmp_path_factory.mktemp("site")
    modules = folder / "node_modules"
    modules.mkdir()
    packed = json.loads(npm("pack", "--json", "--pack-destination", folder, folder=PLAYER))[0]
    names = {item["path"] for item in packed["files"]}
    assert {"pdeanim.wasm", "pdeanim.js", "pdeanim.d.ts", "three.js", "README.md", "LICENSE"} <= names
    assert not {name for name in names if "__init__" in name or name.startswith("view/")}
    shutil.unpack_archive(folder / packed["filename"], modules, "gztar")
    (modules / "package").rename(modules / "pdeanim")
    (modules / "three").symlink_to(three)
    return folder


def loaded(site: Path, path: Path, *times: float) -> dict[str, Any]:
    script = site / "load.mjs"
    text = (ROOT / "tests" / "browser" / "three_loader.mjs").read_text("utf-8")
    script.write_text(text.replace("../../player/three.js", "pdeanim/three"))
    done = subprocess.run(
        ["node", script, path, *map(str, times)], capture_output=True, text=True, check=False, timeout=120
    )
    assert done.returncode == 0, done.stderr
    found: dict[str, Any] = json.loads(done.stdout)
    return found


def test_three_has_a_mesh_of_each_object_where_the_library_has_it(site: Path, tmp_path: Path) -> None:
    path = tmp_path / "sheets.pdeanim"
    encode(two_sheets(), path, tolerance=1e-4)
    times = [0.0, 0.43, 9.0]
    result = loaded(site, path, *times)
    with open_animation(path) as animation:
        assert result["duration"] == pytest.approx(animation.times[-1])
        for time, meshes in zip(times, result["found"], strict=True):
            assert [mesh["name"] for mesh in meshes] == [item.name for item in animation.objects]
            expected = np.split(animation.positions(min(time, float(animation.times[-1]))), 2)
            for mesh, points in zip(meshes, expected, strict=True):
                assert (mesh["type"], mesh["material"], mesh["uvs"]) == ("Mesh", "MeshStandardMaterial", None)
                assert np.abs(np.reshape(mesh["points"], (-1, 3)) - points).max() <= 1e-6
                lengths = np.linalg.norm(np.reshape(mesh["normals"], (-1, 3)), axis=1)
                assert np.allclose(lengths, 1.0, atol=1e-5)
                assert len(mesh["index"]) == 2 * 3 * 121


def test_three_has_a_vertex_for_each_uv(site: Path, tmp_path: Path) -> None:
    path = tmp_path / "mapped.pdeanim"
    encode(with_attributes(), path, tolerance=1e-4)
    (meshes,) = loaded(site, path, 0.0)["found"]
    with open_animation(path) as animation:
        mapped = [item for item in animation.objects if any(own.name.startswith("uv") for own in item.attributes)]
        assert mapped, "the clip has UVs"
        for item in mapped:
            mesh = next(mesh for mesh in meshes if mesh["name"] == item.name)
            uv = next(own for own in item.attributes if own.name.startswith("uv"))
            rows = np.unique(np.reshape(mesh["uvs"], (-1, 2)), axis=0)
            known = {tuple(row) for row in uv.values.astype(float).tolist()} | {(0.0, 0.0)}  # where there is none
            assert {tuple(row) for row in rows.tolist()} <= known
            assert len(rows) > 1
            points = animation.positions(0.0)[np.array(mesh["sources"]) + first_vertex(animation.objects, item)]
            assert np.abs(np.reshape(mesh["points"], (-1, 3)) - points).max() <= 1e-6


def first_vertex(objects: Any, wanted: Any) -> int:
    counts = [item.vertex_count for item in objects]
    return sum(counts[: [item.name for item in objects].index(wanted.name)])


PAGE = """<!doctype html>
{imports}
<script type="module">
import * as THREE from "three";
const renderer = new THREE.WebGLRenderer();
const scene = new THREE.Scene();
scene.add(new THREE.AmbientLight());
const camera = new THREE.PerspectiveCamera(50, 2, 0.1, 100);
camera.position.set(1, 2, 3);
camera.lookAt(1, 0, 0);
{script}
globalThis.cloth = cloth;
globalThis.drawn = () => [renderer.info.render.triangles, renderer.info.render.frame];
</script>
"""


def test_a_fresh_page_follows_the_readme_alone(site: Path, tmp_path: Path) -> None:
    blocks = (PLAYER / "README.md").read_text("utf-8").split("```")
    (imports,) = [block.removeprefix("html\n") for block in blocks if block.startswith("html")]
    (script,) = [block.removeprefix("js\n") for block in blocks if "PDEAnimLoader" in block and block.startswith("js")]
    script = script.replace('import * as THREE from "three";\n', "")
    (site / "index.html").write_text(PAGE.replace("{imports}", imports).replace("{script}", script))
    encode(two_sheets(), site / "cloth.pdeanim", tolerance=1e-4, overwrite=True)
    served = tmp_path / "served"
    shutil.copytree(site, served, symlinks=False)
    with serving(served) as server, browsing(tmp_path / "profile") as browser:
        browser.open(f"{server.address}/index.html")
        found = browser.run(
            "for (let k = 0; k < 600 && !(globalThis.drawn && drawn()[1] > 2); k++)"
            " await new Promise((next) => setTimeout(next, 50));"
            " return globalThis.drawn ? drawn() : null"
        )
        assert [error for error in browser.errors() if "favicon" not in error] == []
        assert found[0] == 2 * 2 * 121
