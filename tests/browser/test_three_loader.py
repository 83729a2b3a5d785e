"""The player's loader for three.js, and its npm package."""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import Animation, ArraySequence, Connectivity, Field, MeshObject, encode, open_animation
from pdecodec.mesh.fields import FieldDomain
from spec.accepted import with_attributes
from spec.vector_files import accepted_files
from tests.browser.test_view import GPU_MARGIN, two_sheets
from tests.support.browser_pages import GRAPHICS, readme_block, showing, three_page
from tests.support.browser_tools import BROWSER, node_module, run_node
from tests.support.driven_browser import Browser


def loaded(site: Path, path: Path, *steps: float | dict[str, Any]) -> dict[str, Any]:
    script = shutil.copy(BROWSER / "three_loader.mjs", site)  # where it finds the package
    found: dict[str, Any] = json.loads(run_node(script, path, *map(json.dumps, steps)))
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
            known = {tuple(row) for row in uv.values.astype(float).tolist()} | {(0.0, 0.0)}  # for corners without UVs
            assert {tuple(row) for row in rows.tolist()} <= known
            assert len(rows) > 1
            points = animation.positions(0.0)[np.array(mesh["sources"]) + first_vertex(animation.objects, item)]
            assert np.abs(np.reshape(mesh["points"], (-1, 3)) - points).max() <= 1e-6


@pytest.mark.parametrize(
    ("domain", "rows", "drawn"),
    [("vertex", 5, [0, 1, 2, 0, 2, 3, 2, 1, 4]), ("corner", 7, [0, 1, 2, 0, 2, 3, 4, 5, 6])],
)
def test_three_has_uvs_that_change_as_they_are_at_first(
    site: Path, domain: FieldDomain, rows: int, drawn: list[int], tmp_path: Path
) -> None:
    faces = Connectivity(5, np.array([4, 3]), np.array([0, 1, 2, 3, 2, 1, 4]))
    uvs = np.random.default_rng(2).random((3, 2 * rows, 2)).astype(np.float32)
    points = np.random.default_rng(3).random((3, 10, 3))
    field = Field("uv", domain, components=2)
    clip = ArraySequence(points, objects=[MeshObject(name, faces) for name in "ab"], fps=24, fields=[(field, uvs)])
    encode(clip, tmp_path / "x.pdeanim", fields={"uv": "exact"})
    (meshes,) = loaded(site, tmp_path / "x.pdeanim", 2 / 24)["found"]
    for mesh, own in zip(meshes, np.split(uvs[0], 2), strict=True):
        assert np.array_equal(np.reshape(mesh["uvs"], (-1, 2))[mesh["index"]], own[drawn])


def rows_of_drawn(animation: Animation, field: Field, index: int, sources: list[int]) -> Any:
    """Return the row of a field that each of three.js's vertices of an object shows, -1 for none."""
    owners = range(len(animation.objects)) if field.objects is None else field.objects
    own = animation.objects[index].connectivity
    if index not in owners:
        return np.full(len(sources), -1)
    first = field.row_count([item for k, item in enumerate(animation.objects) if k < index and k in owners])
    if field.domain == "vertex":
        return first + np.array(sources)
    if field.domain == "object":
        return np.full(len(sources), first)
    starts = np.cumsum(own.face_counts) - own.face_counts
    triangles = [(face, (0, k, k + 1)) for face, size in enumerate(own.face_counts) for k in range(1, size - 1)]
    corners = [starts[face] + k for face, corners in triangles for k in corners]
    assert sources == own.face_indices[corners].tolist()
    return first + (np.repeat([face for face, _ in triangles], 3) if field.domain == "face" else np.array(corners))


@pytest.mark.parametrize(
    ("name", "component"),
    [("velocity", None), ("velocity", 2), ("age", None), ("stress", None), ("nass/feucht 水", None), ("shade", 1),
     ("index", None), ("small", None), ("id", None)],
)  # fmt: skip
def test_three_s_vertices_have_the_values_of_a_field(site: Path, name: str, component: int | None) -> None:
    path, time = accepted_files()["fields"], 0.11
    colours: dict[str, Any] = {"name": name, "options": {} if component is None else {"component": component}}
    numbers_alone = {"name": name, "options": colours["options"] | {"colormap": None}}
    shown = loaded(site, path, numbers_alone, time, {"name": None}, colours)["found"]
    with open_animation(path) as animation:
        field = animation.field_named(name)
        values = animation.field(name, time).astype(np.float64).reshape(-1, field.components)
        is_magnitude = component is None and field.components > 1
        numbers = np.linalg.norm(values, axis=1) if is_magnitude else values[:, component or 0]
        for index, (mesh, plain, coloured) in enumerate(zip(shown[1], *shown[2:], strict=True)):
            rows = rows_of_drawn(animation, field, index, mesh["sources"])
            expected = np.where(rows < 0, np.nan, numbers[rows] if numbers.size else np.nan)
            finite = np.where(np.isfinite(expected), expected, np.nan)  # JSON has no infinity
            np.testing.assert_allclose(np.array(mesh["field"], np.float64), finite, rtol=1e-6)
            assert (plain["field"], plain["colors"], plain["vertexColors"]) == (None, None, False)
            assert (mesh["vertexColors"], coloured["vertexColors"]) == (False, True)
            is_grey = np.ptp(np.reshape(coloured["colors"], (-1, 3)), axis=1) < 1e-6
            np.testing.assert_array_equal(is_grey, np.isnan(expected))


def test_colours_follow_the_range_the_map_and_the_time(site: Path, tmp_path: Path) -> None:
    path = tmp_path / "heat.pdeanim"
    heat = np.array([[0.0, 1.0, 2.0, 4.0], [4.0, 3.0, np.nan, -9.0]], np.float32)
    faces = Connectivity.from_padded(4, np.array([[0, 1, 2, 3]], np.int32))
    points = np.zeros((2, 4, 3)) + np.eye(4, 3)
    clip = ArraySequence(points, objects=[MeshObject("quad", faces)], times=[0.0, 1.0], fields={"heat": heat})
    encode(clip, path, fields={"heat": "exact"})
    shown = {"name": "heat", "options": {"colormap": ["black", "red"], "range": [0, 4]}}
    _, first, last = (meshes[0]["colors"] for meshes in loaded(site, path, shown, 0.0, 1.0)["found"])
    reds = np.array([0, 64, 128, 255]) / 255
    linear = np.where(reds <= 0.04045, reds / 12.92, ((reds + 0.055) / 1.055) ** 2.4)
    np.testing.assert_allclose(np.reshape(first, (-1, 3)), linear[:, None] * [1, 0, 0], atol=3e-3)
    at_end = np.reshape(last, (-1, 3))
    np.testing.assert_allclose(at_end[[0, 3]], [[1, 0, 0], [0, 0, 0]], atol=1e-6)
    assert at_end[2, 0] == at_end[2, 1] == at_end[2, 2] > 0.1
    for wrong, said in (
        (shown | {"name": "cold"}, "cold"),
        ({"name": "heat", "options": {"colormap": "odd"}}, "viridis"),
    ):
        with pytest.raises(AssertionError, match=said):
            loaded(site, path, wrong)


@pytest.mark.parametrize(("name", "kind"), [("lines", "LineSegments"), ("points", "Points")])
def test_lines_and_points_are_drawn_as_such(site: Path, name: str, kind: str) -> None:
    path = accepted_files()[name]
    with open_animation(path) as animation:
        time = float(animation.times[-1])
        (meshes,) = loaded(site, path, time - float(animation.times[0]))["found"]
        assert {mesh["type"] for mesh in meshes} == {kind}
        found = np.concatenate([np.reshape(mesh["points"], (-1, 3)) for mesh in meshes])
        assert np.abs(found - animation.positions(time)).max() <= 1e-6 * np.abs(found).max()
        for mesh, item in zip(meshes, animation.objects, strict=True):
            counts = item.connectivity.line_counts
            segments = int((counts - 1)[counts > 1].sum())
            assert mesh["index"] is None if kind == "Points" else len(mesh["index"]) == 2 * segments


def first_vertex(objects: Any, wanted: Any) -> int:
    counts = [item.vertex_count for item in objects]
    return sum(counts[: [item.name for item in objects].index(wanted.name)])


TYPED_BABYLON = """
import type { Mesh } from "@babylonjs/core/Meshes/mesh.js";
import { registerMeshMotion, type MovedByMotion } from "pdeanim/babylon";

registerMeshMotion();
export const advance = (mesh: Mesh & MovedByMotion): boolean => mesh.motionState.set(0.5, 1) && mesh.isOnGpu;
// @ts-expect-error what evaluates is not the program's choice
export const choose = (mesh: MovedByMotion) => (mesh.isOnGpu = true);
"""


@pytest.mark.parametrize("name", ["typed.mts", "babylon.mts"])
def test_a_typescript_program_is_checked_against_the_types(site: Path, name: str) -> None:
    compiler = node_module("typescript") / "bin" / "tsc"
    for needed in ("@types", "@gltf-transform", "property-graph", "@babylonjs"):
        if not (site / "node_modules" / needed).exists():
            (site / "node_modules" / needed).symlink_to(node_module(needed))
    (site / name).write_text((BROWSER / name).read_text("utf-8") if name == "typed.mts" else TYPED_BABYLON)
    options = {"strict": True, "noEmit": True, "target": "es2022", "module": "nodenext", "lib": ["esnext", "dom"]}
    # Babylon.js's own types contradict each other.
    project = {"compilerOptions": {**options, "types": [], "skipLibCheck": name == "babylon.mts"}, "files": [name]}
    (site / "tsconfig.json").write_text(json.dumps(project))
    run_node(compiler, "-p", site)


SCENE_OF_THE_README = """
const scene = new THREE.Scene();
scene.add(new THREE.AmbientLight());
const camera = new THREE.PerspectiveCamera(50, 2, 0.1, 100);
camera.position.set(1, 2, 3);
camera.lookAt(1, 0, 0);
{script}
globalThis.drawn = () => [renderer.info.render.triangles, renderer.info.render.frame];
"""


def test_a_fresh_page_follows_the_readme_alone(site: Path, tmp_path: Path) -> None:
    script = readme_block("js", "import { PDEAnimLoader }").replace('import * as THREE from "three";\n', "")
    served = three_page(site, tmp_path / "served", SCENE_OF_THE_README.replace("{script}", script))
    encode(two_sheets(), served / "cloth.pdeanim", tolerance=1e-4)
    with showing(served, "index.html", "globalThis.drawn?.()[1] > 2") as browser:
        assert browser.run("return drawn()[0]") == 2 * 2 * 121


SCRIPT = """
import { PDEAnimLoader } from "pdeanim/three";

renderer.shadowMap.enabled = true;
const target = new (THREE.WebGLRenderTarget ?? THREE.RenderTarget)(160, 120);
const camera = new THREE.PerspectiveCamera(50, 4 / 3, 0.1, 100);
camera.position.set(1, 2.5, 3);
camera.lookAt(1, 0, 0);
const light = new THREE.DirectionalLight(0xffffff, 3);
light.position.set(1, 3, 1);
light.castShadow = true;
const floor = new THREE.Mesh(new THREE.PlaneGeometry(8, 8).rotateX(-Math.PI / 2), new THREE.MeshStandardMaterial());
floor.position.y = -0.6;
floor.receiveShadow = true;
// A texture that is flipped when it is uploaded, as pictures are.
const dots = new THREE.DataTexture(new Uint8Array([90, 160, 220, 255, 220, 160, 90, 255]), 1, 2);
dots.flipY = true;
dots.needsUpdate = true;
floor.material.map = dots;

async function show(clip, seconds) {
  const scene = new THREE.Scene().add(light, floor, clip);
  for (const mesh of clip.children) mesh.castShadow = true;
  renderer.setRenderTarget(target);
  clip.setTime(seconds);
  const isKept = renderer.getRenderTarget() === target;
  renderer.render(scene, camera);
  return { pixels: [...(await pixelsOf(target, 160, 120))], isKept };
}

const read = async (attribute) => [...(attribute.array?.length ? attribute.array : await buffered(attribute))];

const meshes = (clip) =>
  Promise.all(
    clip.children.map(async (mesh) => ({
      name: mesh.name,
      points: await read(mesh.geometry.attributes.position),
      normals: await read(mesh.geometry.attributes.normal),
      sources: [...clip.sourcesOf(mesh)],
    })),
  );

function box(clip) {
  const { min, max } = new THREE.Box3().setFromObject(clip);
  return [min.toArray(), max.toArray()];
}

function hits(clip, from, to) {
  const ray = new THREE.Raycaster(new THREE.Vector3(...from), new THREE.Vector3(...to).normalize());
  clip.updateMatrixWorld();
  return ray.intersectObject(clip).map(({ point, normal, object }) => [object.name, ...point, ...normal]);
}

const loadOn = (own, name) => new PDEAnimLoader().setRenderer(own).loadAsync(name);
Object.assign(globalThis, { renderer, Motion, show, meshes, box, hits, loadOn, error, on: {}, off: {} });
"""


@pytest.fixture(scope="module")
def clips(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return files by name: sheets in several groups of frames, and objects with UVs."""
    folder: Path = tmp_path_factory.mktemp("clips")
    encode(two_sheets(), folder / "sheets.pdeanim", tolerance=1e-4, group_frames=9)
    encode(with_attributes(), folder / "mapped.pdeanim", tolerance=1e-4)
    shutil.copy(accepted_files()["fields"], folder / "fields.pdeanim")
    return {path.stem: path for path in folder.iterdir()}


@pytest.fixture(scope="module", params=GRAPHICS)
def scene(
    request: pytest.FixtureRequest, site: Path, clips: dict[str, Path], tmp_path_factory: pytest.TempPathFactory
) -> Iterator[Browser]:
    """Open a page with a three.js scene and each clip twice: ``on.NAME`` is evaluated by the graphics
    processor, ``off.NAME`` by the decoder.
    """
    served = three_page(site, tmp_path_factory.mktemp("scene") / "served", SCRIPT, request.param)
    for path in clips.values():
        shutil.copy(path, served)
    with showing(served, "index.html", "globalThis.loadOn", request.param) as browser:
        browser.run(
            "for (const name of arguments_) {"
            " on[name] = await loadOn(renderer, `${name}.pdeanim`);"
            " off[name] = await loadOn(null, `${name}.pdeanim`); }",
            *clips,
        )
        yield browser


def assert_where_the_library_has_it(meshes: list[dict[str, Any]], animation: Any, time: float) -> None:
    points = animation.positions(time)
    for mesh, item in zip(meshes, animation.objects, strict=True):
        own = points[first_vertex(animation.objects, item) + np.array(mesh["sources"])]
        margin = GPU_MARGIN * (np.ptp(points, axis=0).max() + np.abs(points).max())
        assert np.abs(np.reshape(mesh["points"], (-1, 3)) - own).max() <= margin, time


@pytest.mark.parametrize("name", ["sheets", "mapped"])
def test_the_graphics_processor_has_three_s_vertices_where_the_library_has_them(
    scene: Browser, clips: dict[str, Path], name: str
) -> None:
    with open_animation(clips[name]) as animation:
        start, end = animation.times[[0, -1]]
        for time in np.linspace(start, end, 10):
            ask = "const [name, time] = arguments_; for (const all of [on, off]) all[name].setTime(time);"
            found = scene.run(
                ask + "return [on[name].isOnGpu, off[name].isOnGpu, await meshes(on[name]), await meshes(off[name])]",
                name,
                float(time - start),
            )
            assert found[:2] == [True, False]
            assert_where_the_library_has_it(found[2], animation, float(time))
            for here, there in zip(found[2], found[3], strict=True):
                assert np.abs(np.subtract(here["normals"], there["normals"])).max() <= 1e-3
    assert scene.run("return error()") == 0


def test_a_lit_scene_with_shadows_looks_the_same_by_either(scene: Browser, clips: dict[str, Path]) -> None:
    seen = scene.run("return [await show(on.sheets, 0.7), await show(off.sheets, 0.7), await show(on.sheets, 0)]")
    assert all(item["isKept"] for item in seen), "the render target stays what it was"
    here, there, other = (np.array(item["pixels"], float) for item in seen)
    assert np.ptp(there) > 100, "something is lit"
    assert np.mean(np.abs(here - there) > 8) < 2e-3, "but for what lies at an edge"
    assert np.mean(np.abs(here - other) > 8) > 1e-2, "at another time it is another picture"
    assert scene.run("return error()") == 0


def test_rays_and_boxes_find_the_shape_that_is_shown(scene: Browser, clips: dict[str, Path]) -> None:
    for time in (0.2, 0.9):
        here, there = scene.run(
            "return [on.sheets, off.sheets].map((clip) => (clip.setTime(arguments_[0]),"
            " [box(clip), hits(clip, [0.4, 2, 0.6], [0.05, -1, 0.02]), hits(clip, [5, 2, 5], [0, -1, 0])]))",
            time,
        )
        assert np.allclose(here[0], there[0], atol=1e-6)
        assert [hit[0] for hit in here[1]] == [hit[0] for hit in there[1]] == ["left"]
        assert np.allclose(np.array(here[1][0][1:], float), np.array(there[1][0][1:], float), atol=1e-5)
        assert here[2] == there[2] == []


def test_a_clip_that_does_not_fit_is_evaluated_by_the_decoder(scene: Browser, clips: dict[str, Path]) -> None:
    for what in ("Motion.holds", "Motion.prototype.fits"):
        found = scene.run(
            f"const before = {what}; {what} = () => false;"
            f"try {{ const clip = await loadOn(renderer, 'sheets.pdeanim'); clip.setTime(0.6);"
            f" const found = [clip.isOnGpu, await meshes(clip)]; clip.dispose(); return found; }}"
            f" finally {{ {what} = before; }}"
        )
        assert found[0] is False
        with open_animation(clips["sheets"]) as animation:
            assert_where_the_library_has_it(found[1], animation, 0.6)
    assert scene.run("return error()") == 0


def test_data_are_uploaded_again_after_a_lost_context(scene: Browser, clips: dict[str, Path]) -> None:
    if scene.run("return !globalThis.gl"):
        pytest.skip("a device of WebGPU that was lost does not come back")
    found = scene.run(
        "await show(on.sheets, 0.3); const lost = gl.getExtension('WEBGL_lose_context');"
        "const canvas = renderer.domElement;"
        "const event = (name) => new Promise((next) => canvas.addEventListener(name, next, { once: true }));"
        "const isLost = event('webglcontextlost'); lost.loseContext(); await isLost;"
        "await new Promise((next) => setTimeout(next, 20));"
        "const isBack = event('webglcontextrestored'); lost.restoreContext(); await isBack;"
        "const own = await meshes(on.sheets); error();"
        "return [own, await show(on.sheets, 0.3), await show(off.sheets, 0.3), error()]"
    )
    with open_animation(clips["sheets"]) as animation:
        assert_where_the_library_has_it(found[0], animation, 0.3)
    here, there = (np.array(item["pixels"], float) for item in found[1:3])
    assert np.mean(np.abs(here - there) > 8) < 2e-3
    assert found[3] == 0


@pytest.mark.parametrize(("name", "component"), [("velocity", 1), ("stress", 0)])
def test_the_graphics_processor_colours_by_fields_of_vertices_and_faces(
    scene: Browser, clips: dict[str, Path], name: str, component: int
) -> None:
    found = scene.run(
        "const [name, component, time] = arguments_; const shown = [];"
        "for (const clip of [on.fields, off.fields]) { clip.setTime(time); clip.setField(name, { component });"
        " const colours = clip.children.map(({ geometry }) => [...geometry.attributes.color.array]);"
        " shown.push([await meshes(clip), colours]); }"
        "const pictures = [await show(on.fields, time), await show(off.fields, time)];"
        "for (const clip of [on.fields, off.fields]) clip.setField(null);"
        "return [on.fields.isOnGpu, shown, pictures, error()]",
        name,
        component,
        0.1,
    )
    assert (found[0], found[3]) == (True, 0)
    (here, colours), (_, others) = found[1]
    with open_animation(clips["fields"]) as animation:
        assert_where_the_library_has_it(here, animation, 0.1)
    assert colours == others
    assert len({tuple(colour) for colour in np.reshape(colours[0], (-1, 3)).tolist()}) > 2
    first, second = (np.array(item["pixels"], float) for item in found[2])
    assert np.mean(np.abs(first - second) > 8) < 2e-3
