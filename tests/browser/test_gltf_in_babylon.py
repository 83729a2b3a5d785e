"""Motion in glTF files (PDECODEC_mesh_motion) as Babylon.js plays it."""

from __future__ import annotations

import base64
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.formats.gltf.file import read_gltf
from spec.extension.make_example import PATH
from tests.browser.test_gltf_in_three import MOVED, NAME, add_instances, assert_close, points_at
from tests.formats.test_gltf_mesh_motion import changed
from tests.support.browser_pages import GRAPHICS, HELPERS, showing
from tests.support.browser_tools import bundle, node_module
from tests.support.driven_browser import Browser

MAIN = """
import { NullEngine } from "@babylonjs/core/Engines/nullEngine.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { WebGPUEngine } from "@babylonjs/core/Engines/webgpuEngine.js";
import { FreeCamera } from "@babylonjs/core/Cameras/freeCamera.js";
import { Ray } from "@babylonjs/core/Culling/ray.js";
import { DirectionalLight } from "@babylonjs/core/Lights/directionalLight.js";
import { ShadowGenerator } from "@babylonjs/core/Lights/Shadows/shadowGenerator.js";
import { LoadAssetContainerAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import "@babylonjs/core/Materials/standardMaterial.js";
import { RenderTargetTexture } from "@babylonjs/core/Materials/Textures/renderTargetTexture.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { CreateGround } from "@babylonjs/core/Meshes/Builders/groundBuilder.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/core/Animations/animatable.js";
import "@babylonjs/loaders/glTF/2.0/glTFLoader.js";
import "@babylonjs/loaders/glTF/2.0/Extensions/EXT_mesh_gpu_instancing.js";
import { registerMeshMotion } from "pdeanim/babylon";
import { GpuMotion } from "pdeanim/gpu";
import { WebGpuMotion } from "pdeanim/webgpu";

registerMeshMotion();
const options = { deterministicLockstep: true, lockstepMaxSteps: 1 };
const canvas = document.createElement("canvas");

/** Let WebGPU draw into a texture: software that replaces a graphics card loses the device with a canvas. */
function drawElsewhere() {
  let drawn;
  const configure = ({ device, format, usage }) => {
    drawn = device.createTexture({ format, usage, size: [canvas.width, canvas.height] });
  };
  canvas.getContext = () => ({ canvas, configure, unconfigure() {}, getCurrentTexture: () => drawn });
}

const ENGINES = {
  none: () => new NullEngine(options),
  WebGL: () => new Engine(canvas, false, options),
  WebGPU: async () => {
    drawElsewhere();
    const engine = new WebGPUEngine(canvas, options);
    await engine.initAsync();
    return engine;
  },
};
const engine = await ENGINES[location.hash.slice(1)]();
const { _gl: gl, _device: device } = engine;
let errors = 0;
device?.addEventListener("uncapturederror", () => errors++);
const Motion = device ? WebGpuMotion : gl && GpuMotion;
const scene = new Scene(engine);
scene.useRightHandedSystem = true;
const camera = new FreeCamera("camera", new Vector3(0.5, 1.2, 3), scene);
camera.setTarget(new Vector3(0.5, 0.8, 0));
camera.minZ = 0.1;
const light = new DirectionalLight("light", new Vector3(-0.5, -2, -1), scene);
light.position.set(1, 4, 2);
const ground = CreateGround("ground", { width: 6, height: 6 }, scene);
ground.receiveShadows = true;

const draw = () => {
  engine.beginFrame();
  scene.render();
  engine.endFrame();
};
const tick = async () => {
  await new Promise((next) => setTimeout(next, 5));
  draw();
};
const load = async (name = "example") => {
  const container = await LoadAssetContainerAsync(`/${name}.glb`, scene);
  container.addAllToScene();
  for (const group of container.animationGroups) group.stop();
  return container;
};
const movedOf = (meshes) => meshes.filter(({ motionState }) => motionState);

/** Read what is drawn. */
async function drawnBy(mesh, kind = "position") {
  await tick();
  const [buffer, count] = [mesh.getVertexBuffer(kind).getBuffer().underlyingResource, mesh.getTotalVertices()];
  if (gl) return [...readFromContext(gl, buffer, count)];
  return [...(device ? await readFromDevice(device, buffer, count) : mesh.getVerticesData(kind))];
}

/** Return the picture of meshes and their shadows. */
async function pictureOf(meshes) {
  const shadows = new ShadowGenerator(256, light);
  meshes.forEach((mesh) => shadows.addShadowCaster(mesh));
  const target = new RenderTargetTexture("picture", { width: 160, height: 120 }, scene);
  Object.assign(target, { activeCamera: camera, renderList: [ground, ...meshes] });
  scene.customRenderTargets.push(target);
  await scene.whenReadyAsync();
  while (!target.isReadyForRendering()) await tick();
  draw();
  const pixels = [...(await target.readPixels())];
  scene.customRenderTargets.pop();
  for (const one of [target, shadows]) one.dispose();
  return pixels;
}

const error = () => (gl ? gl.getError() : errors);
Object.assign(globalThis, { scene, gl, Motion, load, movedOf, drawnBy, pictureOf, tick, error, Ray, Vector3 });
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


def add_tangents(root: dict[str, Any]) -> None:
    """Give the flag tangents along x."""
    attributes = root["meshes"][0]["primitives"][0]["attributes"]
    count = root["accessors"][attributes["POSITION"]]["count"]
    tangents = np.tile(np.array([1, 0, 0, -1], "<f4"), (count, 1))
    address = "data:application/octet-stream;base64," + base64.b64encode(tangents.tobytes()).decode()
    root["buffers"].append({"byteLength": tangents.nbytes, "uri": address})
    root["bufferViews"].append({"buffer": len(root["buffers"]) - 1, "byteLength": tangents.nbytes})
    view = {"bufferView": len(root["bufferViews"]) - 1, "componentType": 5126, "count": count, "type": "VEC4"}
    root["accessors"].append(view)
    attributes["TANGENT"] = len(root["accessors"]) - 1


def share_the_flag(root: dict[str, Any]) -> None:
    """Draw the flag twice, and its arrays and its material a third time in a mesh that stands still."""
    (primitive,) = root["meshes"][0]["primitives"]
    still = {key: value for key, value in primitive.items() if key != "extensions"}
    root["meshes"].append({"primitives": [still]})
    root["nodes"] += [{"name": "second", "mesh": 0}, {"name": "still", "mesh": 2}]
    root["scenes"][0]["nodes"] += [2, 3]


@pytest.fixture(scope="module")
def built(packed_player: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a folder with the page and clips."""
    folder: Path = tmp_path_factory.mktemp("babylon")
    shutil.copytree(packed_player, folder / "node_modules" / "pdeanim")
    (folder / "node_modules" / "@babylonjs").symlink_to(node_module("@babylonjs"))
    (folder / "main.js").write_text(HELPERS + MAIN)
    (folder / "index.html").write_text('<!doctype html><script type="module" src="built/main.js"></script>')
    shutil.copy(PATH, folder)
    changed(folder / "lines.glb", add_lines)
    changed(folder / "list.glb", drop_indices)
    changed(folder / "instanced.glb", add_instances)
    changed(folder / "shared.glb", share_the_flag)
    changed(folder / "tangents.glb", add_tangents)
    bundle(folder, "esbuild")
    shutil.copy(packed_player / "pdeanim.wasm", folder / "built")
    return folder


@pytest.fixture(scope="module", params=["none", *GRAPHICS])
def page(built: Path, request: pytest.FixtureRequest) -> Iterator[Browser]:
    with showing(built, f"index.html#{request.param}", "globalThis.load", request.param) as browser:
        yield browser


def test_an_animation_group_plays_the_motion_where_the_plain_decoder_has_it(page: Browser) -> None:
    name, is_gpu, shown, corners, errors = page.run(
        "const { meshes, animationGroups: [group] } = await load(); const [flag] = movedOf(meshes);"
        "group.start(true); await tick(); const shown = []; for (const time of [0.3, 1.2, 0]) {"
        " group.goToFrame(60 * time); group.pause();"
        " shown.push([await drawnBy(flag), [...flag.getVerticesData('position')], flag.isOnGpu]); }"
        "const { minimum, maximum } = flag.getBoundingInfo();"
        "return [flag.material.name, Boolean(Motion), shown, [minimum.asArray(), maximum.asArray()], error()]"
    )
    assert (name, errors) == ("cloth", 0)
    for (points, read, is_on_gpu), time in zip(shown, [0.3, 1.2, 0.0], strict=True):
        assert is_on_gpu == is_gpu
        assert_close(points, points_at(time))
        assert_close(read, points_at(time))
    own: Any = MOVED["extensions"][NAME]
    assert corners == [pytest.approx(own["min"]), pytest.approx(own["max"])]


def test_weights_blend_and_rays_hit_the_moved_flag_and_its_instance(page: Browser) -> None:
    blended, hits = page.run(
        "const { meshes } = await load(); const [flag] = movedOf(meshes);"
        "flag.motionState.set(0.25 * 0.3, 0.25); const blended = await drawnBy(flag);"
        "const instance = flag.createInstance('instance'); instance.position.x = 2;"
        "flag.motionState.set(0.6, 1); await drawnBy(flag);"
        "const hits = [[flag, 0.9], [instance, 2.9]].map(([mesh, x]) =>"
        " new Ray(new Vector3(x, 1.2, 5), new Vector3(0, 0, -1)).intersectsMesh(mesh));"
        "return [blended, hits.map(({ hit, pickedPoint }) => [hit, pickedPoint?.z])]"
    )
    first, there = points_at(0.0), points_at(0.3)
    assert_close(blended, first + 0.25 * (there - first))
    moved = points_at(0.6)
    near = moved[abs(moved[:, 0] - 0.9).argsort()[:8], 2]
    for is_hit, depth in hits:
        assert is_hit
        assert near.min() - 1e-3 <= depth <= near.max() + 1e-3


def test_a_picture_with_shadows_is_that_of_the_decoder(page: Browser) -> None:
    if page.run("return !Motion"):
        pytest.skip("no engine draws")
    here, there, other, *found = page.run(
        "const shown = []; const isOnGpu = []; const { holds } = Motion;"
        "for (const [isAllowed, time] of [[true, 0.6], [false, 0.6], [true, 0]]) {"
        " if (!isAllowed) Motion.holds = () => false;"
        " const container = await load(); Motion.holds = holds; const [flag] = movedOf(container.meshes);"
        " flag.position.z = 0.5; flag.rotation.y = 0.5; const copy = flag.createInstance('i'); copy.position.x = 0.4;"
        " flag.motionState.set(time, 1); await tick();"
        " isOnGpu.push(flag.isOnGpu); shown.push(await pictureOf([flag, copy])); copy.dispose(); container.dispose(); }"
        "return [...shown, isOnGpu, error()]"
    )
    assert found == [[True, False, True], 0]
    here, there, other = (np.array(pixels, float) for pixels in (here, there, other))
    assert np.ptp(there) > 100, "something is lit"
    assert np.mean(np.abs(here - there) > 8) < 2e-3
    assert np.mean(np.abs(here - other) > 8) > 1e-2, "at another time it is another picture"


def test_normals_are_those_of_triangles_alone_with_and_without_indices(page: Browser) -> None:
    plain, beside_lines, unindexed = page.run(
        "const found = []; for (const name of ['example', 'lines', 'list']) { const { meshes } = await load(name);"
        " const [flag] = movedOf(meshes); flag.motionState.set(0.3, 1); "
        " found.push(await drawnBy(flag, 'normal')); } return found"
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
        "const shown = [await drawnBy(flag), await drawnBy(copy)];"
        "const made = container.instantiateModelsToScene(undefined, false, { doNotInstantiate: true });"
        "await tick(); await tick(); const own = movedOf(made.rootNodes[0].getChildMeshes())[0];"
        "const [group] = made.animationGroups; group.start(true); await tick(); group.goToFrame(54); group.pause();"
        "const instance = await drawnBy(own); const all = [flag, copy, own];"
        "return [shown, instance, new Set(all.map((one) => one.geometry)).size]"
    )
    for points, time in zip([*shown, instance], [0.3, 0.6, 0.9], strict=True):
        assert_close(points, points_at(time))
    assert geometries == 3


def test_meshes_that_share_arrays_and_a_frozen_material_do_not_move_each_other(page: Browser) -> None:
    (before, after), facts, errors = page.run(
        "const { meshes } = await load('shared'); const [first, second] = movedOf(meshes);"
        "const still = meshes.find(({ name }) => name === 'still'); const all = [first, second, still];"
        "const shownBy = (one) => (one === still ? [...one.getVerticesData('position')] : drawnBy(one));"
        "await tick(); first.material.freeze();"
        "first.motionState.set(0.3, 1); second.motionState.set(0.6, 1); await tick();"
        "const before = await Promise.all(all.map(shownBy));"
        "const facts = [movedOf(meshes).length, first.material === still.material];"
        "first.dispose(); await tick(); await tick(); second.motionState.set(0.9, 1);"
        "const after = [await drawnBy(second), shownBy(still)];"
        "return [[before, after], facts, error()]"
    )
    assert (facts, errors) == ([2, True], 0)
    stored = read_gltf(PATH).accessor(MOVED["attributes"]["POSITION"])
    expected = [points_at(0.3), points_at(0.6), stored, points_at(0.9), stored]
    for points, own in zip([*before, *after], expected, strict=True):
        assert_close(points, own)


def test_the_box_of_instances_is_around_all_of_them(page: Browser) -> None:
    shown, boxes, errors = page.run(
        "const { meshes } = await load('instanced'); const flags = movedOf(meshes);"
        "for (const flag of flags) flag.motionState.set(0.6, 1); await tick();"
        "const boxes = flags.map((flag) => { const { minimum, maximum } = flag.getBoundingInfo();"
        " return [flag.thinInstanceCount, minimum.asArray(), maximum.asArray()]; });"
        "return [await Promise.all(flags.map((one) => drawnBy(one))), boxes, error()]"
    )
    own: Any = MOVED["extensions"][NAME]
    for points in shown:
        assert_close(points, points_at(0.6))
    assert len(boxes) == 2
    for count, low, high in boxes:
        assert (count, low) == (2, pytest.approx(own["min"]))
        assert high == pytest.approx(np.add(own["max"], [2, 0, 0]))
    assert errors == 0


def test_tangents_turn_with_their_normals(page: Browser) -> None:
    tangents, normals, stored = page.run(
        "const { meshes } = await load('tangents'); const [flag] = movedOf(meshes);"
        "const stored = [...flag.getVerticesData('tangent')];"
        "flag.motionState.set(0.6, 1); await tick();"
        "return [[...flag.getVerticesData('tangent')], [...flag.getVerticesData('normal')], stored]"
    )
    turned, before = (np.reshape(rows, (-1, 4)) for rows in (tangents, stored))
    along = (turned[:, :3] * np.reshape(normals, (-1, 3))).sum(axis=1)
    np.testing.assert_allclose(along, 0, atol=1e-6)
    np.testing.assert_allclose(np.linalg.norm(turned[:, :3], axis=1), 1, atol=1e-6)
    assert (turned[:, 3] == before[:, 3]).all()
    assert np.abs(turned - before).max() > 0.01


def test_the_graphics_processor_keeps_nothing_and_survives_a_lost_context(page: Browser) -> None:
    if page.run("return !gl"):
        pytest.skip("WebGL alone tells what remains, and comes back")
    left, again, is_on_gpu = page.run(
        "const left = await countLeft(gl, async () => { const container = await load();"
        " for (const one of movedOf(container.meshes)) one.motionState.set(0.5, 1);"
        " await tick(); await tick(); container.dispose(); });"
        "const { meshes } = await load(); const [flag] = movedOf(meshes); flag.motionState.set(0.3, 1); await tick();"
        "const lost = gl.getExtension('WEBGL_lose_context');"
        "const isBack = new Promise((next) => scene.getEngine().onContextRestoredObservable.addOnce(next));"
        "lost.loseContext(); await new Promise((next) => setTimeout(next, 50)); lost.restoreContext(); await isBack;"
        "return [left, await drawnBy(flag), flag.isOnGpu]"
    )
    assert left[1:] == left[1:2] * 3
    assert is_on_gpu
    assert_close(again, points_at(0.3))
