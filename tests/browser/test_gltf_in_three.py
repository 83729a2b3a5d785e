"""Motion in glTF files (PDECODEC_mesh_motion) as three.js plays it."""

from __future__ import annotations

import base64
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.mesh.arrays import Float32Array
from spec.decoder.gltf import root_of, shape_at
from spec.extension.make_example import PATH
from tests.formats.test_gltf_mesh_motion import changed
from tests.support.browser_pages import GRAPHICS, showing, three_page
from tests.support.driven_browser import Browser

NAME = "PDECODEC_mesh_motion"

MOVED = root_of(PATH.read_bytes())["meshes"][0]["primitives"][0]
"""The flag."""

DURATION = 35 / 24

MARGIN = 2e-6
"""Largest difference of coordinates between evaluations in float32 [m]."""

SCRIPT = """
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { GLTFMeshMotionExtension } from "pdeanim/three";

const camera = new THREE.PerspectiveCamera(50, 4 / 3, 0.1, 100);
camera.position.set(0.5, 1.2, 3);
renderer.setRenderTarget(new (THREE.WebGLRenderTarget ?? THREE.RenderTarget)(160, 120));

async function load(name = "example.glb") {
  const loader = new GLTFLoader();
  loader.register((parser) => new GLTFMeshMotionExtension(parser));
  return loader.loadAsync(name);
}

const movedOf = (root) => {
  const found = [];
  root.traverse((object) => object.motionState && found.push(object));
  return found;
};

/** Draw until changes of time reach the graphics processor. */
function draw(...roots) {
  const scene = new THREE.Scene().add(new THREE.AmbientLight(), ...roots);
  for (let k = 0; k < 2; k++) renderer.render(scene, camera);
  return scene;
}

const pointsOf = async ({ geometry: { attributes: { position } } }) => [
  ...(position.array?.length ? position.array : await buffered(position)),
];

/** What three.js's rays and boxes read. */
const readOf = ({ geometry: { attributes: { position } } }) =>
  Array.from({ length: 3 * position.count }, (_, k) => position.getComponent(Math.floor(k / 3), k % 3));

Object.assign(globalThis, { THREE, renderer, load, movedOf, draw, pointsOf, readOf, error });
"""


def add_instances(root: dict[str, Any]) -> None:
    """Draw the flag twice, with a number of its own each time, and name neither its node nor its mesh."""
    offsets, numbers = np.array([[0, 0, 0], [2, 0, 0]], "<f4"), np.array([1, 2], "<f4")
    for values, kind in ((offsets, "VEC3"), (numbers, "SCALAR")):
        root["bufferViews"].append({"buffer": len(root["buffers"]), "byteLength": values.nbytes})
        address = "data:application/octet-stream;base64," + base64.b64encode(values.tobytes()).decode()
        root["buffers"].append({"byteLength": values.nbytes, "uri": address})
        view = {"bufferView": len(root["bufferViews"]) - 1, "componentType": 5126, "count": 2, "type": kind}
        root["accessors"].append(view)
    first = len(root["accessors"]) - 2
    del root["nodes"][0]["name"]
    root["nodes"][0] |= {
        "children": [1],
        "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": first}}},
    }
    root["nodes"].append(
        {
            "name": "numbered",
            "mesh": 0,
            "extensions": {"EXT_mesh_gpu_instancing": {"attributes": {"TRANSLATION": first, "_ID": first + 1}}},
        }
    )
    root["scenes"][0]["nodes"] = [0, 2]
    root["extensionsUsed"].append("EXT_mesh_gpu_instancing")


@pytest.fixture(scope="module", params=GRAPHICS)
def page(request: pytest.FixtureRequest, site: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    served = three_page(site, tmp_path_factory.mktemp("scene") / "served", SCRIPT, request.param)
    data = PATH.read_bytes()
    (served / "example.glb").write_bytes(data)
    (served / "broken.glb").write_bytes(data.replace(b'"vertexMap":3', b'"vertexMap":0'))  # three values a vertex
    (served / "long.glb").write_bytes(data.replace(b'"duration":1', b'"duration":2'))
    changed(served / "instanced.glb", add_instances)
    with showing(served, "index.html", "globalThis.load", request.param) as browser:
        yield browser


@cache
def points_at(time: float) -> Float32Array:
    """Return the positions of the flag's drawn vertices, as the plain decoder has them."""
    return np.array(shape_at(PATH.read_bytes(), MOVED, time), np.float32)


def assert_close(found: list[float], expected: Any) -> None:
    np.testing.assert_allclose(np.reshape(found, (-1, 3)), expected, atol=MARGIN)


def test_a_mixer_plays_the_motion_where_the_plain_decoder_has_it(page: Browser) -> None:
    times = [0.3, 0.777, DURATION - 0.01]
    found = page.run(
        "const gltf = await load(); const mixer = new THREE.AnimationMixer(gltf.scene);"
        "for (const clip of gltf.animations) mixer.clipAction(clip).play();"
        "const [flag] = movedOf(gltf.scene); const shown = [];"
        "for (const time of [...arguments_, 0]) {"
        " mixer.setTime(time - 1e-3); draw(gltf.scene); mixer.setTime(time); draw(gltf.scene);"
        " shown.push([flag.isOnGpu, await pointsOf(flag), readOf(flag)]); }"
        "return [gltf.animations.map(({ name, duration }) => [name, duration]), flag.name, flag.material.name,"
        " shown, error()]",
        *times,
    )
    clips, name, material, shown, errors = found
    assert [duration for _, duration in clips] == pytest.approx([DURATION], abs=1e-6)
    assert (name, material, errors) == ("flag", "cloth", 0)
    for time, (is_on_gpu, points, read) in zip([*times, 0.0], shown, strict=True):
        assert is_on_gpu
        assert_close(points, points_at(time))
        assert_close(read, points_at(time))


def test_actions_loop_fade_and_stop(page: Browser) -> None:
    found = page.run(
        "const gltf = await load(); const mixer = new THREE.AnimationMixer(gltf.scene);"
        "const action = mixer.clipAction(gltf.animations[0]).play(); const [flag] = movedOf(gltf.scene);"
        "const shown = [];"
        "const show = async () => { draw(gltf.scene); shown.push([await pointsOf(flag), readOf(flag)]); };"
        "mixer.setTime(arguments_[0] + arguments_[1]); await show();"
        "action.weight = 0.25; mixer.update(0); await show();"
        "action.weight = 1; const part = THREE.AnimationUtils.subclip(gltf.animations[0], 'part', 5.5, 30.5, 24);"
        "action.stop(); await show();"
        "const other = mixer.clipAction(part).play(); other.time = 0.25; mixer.update(0); await show();"
        "other.crossFadeTo(action.play(), 1, false); action.time = 1; mixer.update(0.5); await show();"
        "return [shown, part.duration]",
        DURATION,
        0.3,
    )
    shown, length = found
    first, here = points_at(0.0), points_at(0.3)
    blended = points_at((0.25 + 0.25 + 0.5 + 1.5 - DURATION) / 2)
    assert length == pytest.approx(1.0, abs=1e-6)
    for pair, expected in zip(
        shown, [here, first + 0.25 * (here - first), first, points_at(0.5), blended], strict=True
    ):
        for points in pair:
            assert_close(points, expected)


def test_ten_instances_share_a_decoder_and_end_with_the_last(page: Browser) -> None:
    found = page.run(
        "const gltf = await load(); const roots = Array.from({ length: 10 }, () => gltf.scene.clone());"
        "const flags = roots.flatMap(movedOf); const { memory } = renderer.info; draw(new THREE.Group());"
        "const before = memory.geometries;"
        "draw(...roots); flags.forEach((flag, k) => { flag.motionTime = 0.1 * (k + 1); }); draw(...roots);"
        "const shown = await Promise.all(flags.map(pointsOf)); const areOnGpu = flags.every(({ isOnGpu }) => isOnGpu);"
        "const animations = new Set(flags.map(({ geometry }) => geometry.shape.animation));"
        "const [animation] = animations;"
        "const meshes = []; for (const root of roots) root.traverse((one) => one.isMesh && meshes.push(one));"
        "meshes.slice(2).forEach(({ geometry }) => geometry.dispose()); const isKept = !animation.isClosed;"
        "meshes.slice(0, 2).forEach(({ geometry }) => geometry.dispose());"
        "const ended = [isKept, animation.isClosed, memory.geometries - before];"
        "flags[9].motionTime = 0.3; draw(roots[9]); const again = await pointsOf(flags[9]);"
        "return [shown, areOnGpu, animations.size, ended, again, error()]"
    )
    shown, are_on_gpu, decoders, ended, again, errors = found
    assert (are_on_gpu, decoders, ended, errors) == (True, 1, [True, True, 0], 0)
    for k, points in enumerate(shown):
        assert_close(points, points_at(0.1 * (k + 1)))
    assert_close(again, points_at(0.3))


def test_loads_leave_nothing_on_the_graphics_processor(page: Browser) -> None:
    if page.run("return !globalThis.gl"):
        pytest.skip("WebGPU tells of no buffers that are left")
    left = page.run(
        "return countLeft(gl, async () => { const { scene } = await load(); draw(scene);"
        " for (const one of movedOf(scene)) one.motionTime = 0.5; draw(scene);"
        " scene.traverse((one) => { one.geometry?.dispose(); one.material?.dispose(); }); })"
    )
    assert left[1:] == left[1:2] * 3


def test_rays_and_boxes_find_the_moved_flag(page: Browser) -> None:
    found = page.run(
        "const gltf = await load(); const [flag] = movedOf(gltf.scene); draw(gltf.scene);"
        "flag.motionTime = 0.6; const [from, to] = [new THREE.Vector3(0.9, 1.2, 5), new THREE.Vector3(0, 0, -1)];"
        "const ray = new THREE.Raycaster(from, to);"
        "const [hit] = ray.intersectObject(flag); draw(gltf.scene); const [same] = ray.intersectObject(flag);"
        "const { min, max } = new THREE.Box3().setFromObject(flag);"
        "return [hit.point.z, same.point.z, hit.uv.toArray(), min.toArray(), max.toArray()]"
    )
    points = points_at(0.6)
    near = points[np.argsort(np.linalg.norm(points[:, :2] - [0.9, 1.2], axis=1))[:4]]
    assert near[:, 2].min() <= found[0] <= near[:, 2].max()
    assert found[1] == pytest.approx(found[0], abs=1e-5)
    assert (found[3], found[4]) == (MOVED["extensions"][NAME]["min"], MOVED["extensions"][NAME]["max"])


def test_instances_move_and_rays_find_them(page: Browser) -> None:
    found = page.run(
        "const gltf = await load('instanced.glb'); const mixer = new THREE.AnimationMixer(gltf.scene);"
        "for (const clip of gltf.animations) mixer.clipAction(clip).play();"
        "const flags = movedOf(gltf.scene); draw(gltf.scene); mixer.setTime(0.6); draw(gltf.scene);"
        "const [from, to] = [new THREE.Vector3(2.9, 1.2, 5), new THREE.Vector3(0, 0, -1)];"
        "const hits = new THREE.Raycaster(from, to).intersectObjects(flags);"
        "const copy = movedOf(gltf.scene.clone())[1]; copy.motionTime = 0.3; draw(copy);"
        "return [flags.map(({ isInstancedMesh, count, isOnGpu }) => [isInstancedMesh, count, isOnGpu]),"
        " await Promise.all(flags.map(pointsOf)), hits.map(({ instanceId, point }) => [instanceId, point.z]),"
        " readOf(copy), copy.count, copy.geometry.attributes._ID.array[1], flags[0].children.length, error()]"
    )
    flags, shown, hits, copied, *rest = found
    assert flags == [[True, 2, True]] * 2
    assert rest == [2, 2, 1, 0]
    moved = points_at(0.6)
    for points in shown:
        assert_close(points, moved)
    assert_close(copied, points_at(0.3))
    near = moved[np.argsort(np.linalg.norm(moved[:, :2] - [0.9, 1.2], axis=1))[:4]]
    assert len(hits) == 2
    for instance, depth in hits:
        assert instance == 1
        assert near[:, 2].min() <= depth <= near[:, 2].max()


@pytest.mark.parametrize("name", ["broken", "long"])
def test_a_motion_that_cannot_be_read_leaves_the_mesh_still(page: Browser, name: str) -> None:
    found = page.run(
        "const said = []; const before = console.error; console.error = (text) => said.push(text);"
        "const gltf = await load(`${arguments_[0]}.glb`); console.error = before;"
        "return [said, movedOf(gltf.scene).length, gltf.animations[0].tracks.length]",
        name,
    )
    assert len(found[0]) == 1
    assert "mesh 0 stays still" in found[0][0]
    assert found[1:] == [0, 1], "the ball's node moves"
