"""Motion in glTF files (PDECODEC_mesh_motion) as Babylon.js plays it."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spec.extension.make_example import PATH
from tests.browser.test_gltf_in_three import MOVED, NAME, assert_close, points_at
from tests.formats.test_gltf_mesh_motion import changed
from tests.support.browser_tools import BROWSER, node_modules
from tests.support.driven_browser import Browser, browsing
from tests.support.remote_server import serving

MAIN = """
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Ray } from "@babylonjs/core/Culling/ray.js";
import { LoadAssetContainerAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/core/Animations/animatable.js";
import "@babylonjs/loaders/glTF/2.0/glTFLoader.js";
import { registerMeshMotion } from "pdeanim/babylon";

registerMeshMotion();
const scene = new Scene(new NullEngine({ deterministicLockstep: true, lockstepMaxSteps: 1 }));
scene.useRightHandedSystem = true;
new FreeCamera("camera", new Vector3(0, 1, 5), scene);
const tick = async () => {
  await new Promise((next) => setTimeout(next, 5));
  scene.render();
};
const load = async (name = "example") => {
  const container = await LoadAssetContainerAsync(`/${name}.glb`, scene);
  container.addAllToScene();
  for (const group of container.animationGroups) group.stop();
  return container;
};
const movedOf = (meshes) => meshes.filter(({ motionState }) => motionState);
async function pointsOf(mesh) {
  await tick();
  return [...mesh.getVerticesData("position")];
}
Object.assign(globalThis, { scene, load, movedOf, pointsOf, tick, Ray, Vector3 });
"""


def add_lines(root: dict[str, Any]) -> None:
    """Add a primitive of lines with the flag's attributes, and state a duration of too many frames."""
    primitives = root["meshes"][0]["primitives"]
    corners = root["accessors"][primitives[0]["indices"]]
    root["accessors"].append(corners | {"byteOffset": 2, "count": corners["count"] - 2})
    primitives.append(primitives[0] | {"indices": len(root["accessors"]) - 1, "mode": 1})
    root["extensions"][NAME]["motions"][0]["frameRate"] = 1e300


def drop_indices(root: dict[str, Any]) -> None:
    """Draw the flag's vertices, three by three."""
    primitive = root["meshes"][0]["primitives"][0]
    del primitive["indices"]
    for index in (*primitive["attributes"].values(), primitive["extensions"][NAME]["vertexMap"]):
        root["accessors"][index]["count"] -= root["accessors"][index]["count"] % 3


@pytest.fixture(scope="module")
def page(packed_player: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    for name in ("@babylonjs", "esbuild"):
        if not (node_modules() / name).is_dir():
            pytest.skip(f"{name} is not here; npm install --prefix tests/browser")
    folder: Path = tmp_path_factory.mktemp("babylon")
    shutil.copytree(packed_player, folder / "node_modules" / "pdeanim")
    (folder / "node_modules" / "@babylonjs").symlink_to(node_modules() / "@babylonjs")
    (folder / "main.js").write_text(MAIN)
    (folder / "index.html").write_text('<!doctype html><script type="module" src="built/main.js"></script>')
    shutil.copy(PATH, folder)
    changed(folder / "lines.glb", add_lines)
    changed(folder / "list.glb", drop_indices)
    shutil.copy(BROWSER / "bundle.mjs", folder)
    command = ["node", "bundle.mjs", "esbuild", str(node_modules())]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False, timeout=120)
    assert done.returncode == 0, done.stderr
    shutil.copy(packed_player / "pdeanim.wasm", folder / "built")
    with serving(folder) as server, browsing(tmp_path_factory.mktemp("profile")) as browser:
        browser.open(f"{server.address}/index.html")
        browser.run("while (!globalThis.load) await new Promise((next) => setTimeout(next, 20));")
        yield browser
        assert [error for error in browser.errors() if "favicon" not in error] == []


def test_an_animation_group_plays_the_motion_where_the_plain_decoder_has_it(page: Browser) -> None:
    name, shown, corners = page.run(
        "const { meshes, animationGroups: [group] } = await load(); const [flag] = movedOf(meshes);"
        "group.start(true); await tick(); const shown = []; for (const time of [0.3, 1.2, 0]) {"
        " group.goToFrame(60 * time); group.pause(); shown.push(await pointsOf(flag)); }"
        "const { minimum, maximum } = flag.getBoundingInfo();"
        "return [flag.material.name, shown, [minimum.asArray(), maximum.asArray()]]"
    )
    assert name == "cloth"
    for points, time in zip(shown, [0.3, 1.2, 0.0], strict=True):
        assert_close(points, points_at(time))
    own: Any = MOVED["extensions"][NAME]
    assert corners == [pytest.approx(own["min"]), pytest.approx(own["max"])]


def test_weights_blend_with_the_first_frame_and_rays_hit_the_moved_flag(page: Browser) -> None:
    blended, hits = page.run(
        "const { meshes } = await load(); const [flag] = movedOf(meshes);"
        "flag.motionState.set(0.25 * 0.3, 0.25); const blended = await pointsOf(flag);"
        "flag.motionState.set(0.6, 1); const ray = new Ray(new Vector3(0.9, 1.2, 5), new Vector3(0, 0, -1));"
        "await pointsOf(flag); const hit = ray.intersectsMesh(flag); return [blended, [hit.hit, hit.pickedPoint.z]]"
    )
    first, there = points_at(0.0), points_at(0.3)
    assert_close(blended, first + 0.25 * (there - first))
    moved = points_at(0.6)
    near = moved[abs(moved[:, 0] - 0.9).argsort()[:8], 2]
    assert hits[0]
    assert near.min() - 1e-3 <= hits[1] <= near.max() + 1e-3


def test_normals_are_those_of_triangles_alone_with_and_without_indices(page: Browser) -> None:
    plain, beside_lines, unindexed = page.run(
        "const found = []; for (const name of ['example', 'lines', 'list']) { const { meshes } = await load(name);"
        " const [flag] = movedOf(meshes); flag.motionState.set(0.3, 1); await pointsOf(flag);"
        " found.push([...flag.getVerticesData('normal')]); } return found"
    )
    assert_close(beside_lines, np.reshape(plain, (-1, 3)))
    corners = points_at(0.3)[: len(unindexed) // 3].astype(np.float64).reshape(-1, 3, 3)
    cross = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    # Away from the seam, each vertex is in one triangle; at the seam, some triangles have no area.
    lengths = np.linalg.norm(cross, axis=1)
    alone = (cross / np.maximum(lengths, 1e-9)[:, None])[:, None]
    differences = np.abs(np.reshape(unindexed, (-1, 3, 3)) - alone)[lengths > 1e-6].max(axis=(1, 2))
    assert (differences <= 1e-4).sum() >= 6


def test_copies_have_a_time_of_their_own(page: Browser) -> None:
    shown, instance, geometries = page.run(
        "const container = await load(); const [flag] = movedOf(container.meshes); const copy = flag.clone('copy');"
        "await tick(); await tick(); flag.motionState.set(0.3, 1); copy.motionState.set(0.6, 1);"
        "const shown = [await pointsOf(flag), await pointsOf(copy)];"
        "const made = container.instantiateModelsToScene(undefined, false, { doNotInstantiate: true });"
        "await tick(); await tick(); const own = movedOf(made.rootNodes[0].getChildMeshes())[0];"
        "const [group] = made.animationGroups; group.start(true); await tick(); group.goToFrame(54); group.pause();"
        "const instance = await pointsOf(own); const all = [flag, copy, own];"
        "return [shown, instance, new Set(all.map((one) => one.geometry)).size]"
    )
    for points, time in zip([*shown, instance], [0.3, 0.6, 0.9], strict=True):
        assert_close(points, points_at(time))
    assert geometries == 3
