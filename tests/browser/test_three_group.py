"""Groups of three.js's meshes as programs use them: copies, materials of a glTF file, errors."""

from __future__ import annotations

import urllib.parse
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import ArraySequence, Attribute, Connectivity, MeshObject, encode, open_animation
from tests.browser.test_view import two_sheets

LOAD = """
import { readFile } from "node:fs/promises";
import * as THREE from "three";
import { PDEAnimLoader } from "pdeanim/three";
const load = async (loader = new PDEAnimLoader()) => loader.parseAsync(await readFile(given[0]));
"""


@pytest.fixture(scope="module")
def painted(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a file with a strip of four triangles: red, none, red and blue, and UVs; the object is called strip."""
    path: Path = tmp_path_factory.mktemp("painted") / "strip.pdeanim"
    faces = Connectivity.from_padded(6, np.array([[0, 1, 2], [1, 3, 2], [2, 3, 4], [3, 5, 4]], np.int32))
    attributes = (
        Attribute("uv", "vertex", np.linspace(0, 1, 12, dtype=np.float32).reshape(6, 2)),
        Attribute("material", "face", np.array([1, -1, 1, 0], np.int32), labels=("blue", "red")),
    )
    still = np.array([[0, 0, 0], [0, 1, 0], [1, 0, 0], [1, 1, 0], [2, 0, 0], [2, 1, 0]], np.float32)
    points = still + np.array([0.0, 0.5, 1.0], np.float32)[:, None, None] * [0, 0, 1]
    encode(ArraySequence(points, objects=[MeshObject("strip", faces, attributes)], fps=2), path)
    return path


def test_a_copy_shares_the_decoder_and_has_a_time_of_its_own(run_node: Callable[..., Any], tmp_path: Path) -> None:
    path = tmp_path / "sheets.pdeanim"
    encode(two_sheets(), path, tolerance=1e-4)
    found = run_node(
        LOAD
        + """
        const first = await load();
        first.setTime(0.3);
        first.position.set(1, 2, 3);
        first.children[1].visible = false;
        first.add(new THREE.Object3D());
        const copy = first.clone();
        const holder = new THREE.Group().add(first).clone();
        const inner = holder.children[0];
        inner.setTime(0.1);
        const points = (group) => [...group.children[0].geometry.attributes.position.array];
        const kept = [points(first), points(copy), points(inner)];
        copy.setTime(0.1);
        first.dispose();
        inner.dispose();
        const alive = points(copy);
        copy.setTime(0.2);
        const here = { at: copy.position.toArray(), children: copy.children.length,
          seen: copy.children.map(({ visible }) => visible) };
        copy.dispose();
        let code;
        try { copy.animation.positions(0); } catch (error) { code = error.code; }
        found = { kept, alive, code, ...here, isShared: copy.animation === first.animation };
        """,
        str(path),
    )
    with open_animation(path) as animation:
        rows = animation.objects[0].vertex_count
        expected = [animation.positions(time)[:rows].ravel() for time in (0.3, 0.3, 0.1, 0.1)]
    for points, own in zip([*found["kept"], found["alive"]], expected, strict=True):
        np.testing.assert_allclose(points, own, atol=1e-6)
    assert (found["isShared"], found["at"], found["children"]) == (True, [1, 2, 3], 3)
    assert (found["seen"], found["code"]) == ([True, False, True], "argument")


def test_materials_keep_their_names_and_faces(run_node: Callable[..., Any], painted: Path) -> None:
    found = run_node(
        LOAD
        + """
        const [mesh] = (await load()).children;
        found = { names: mesh.material.map(({ name }) => name), groups: mesh.geometry.groups,
          index: [...mesh.geometry.index.array], uvs: [...mesh.geometry.attributes.uv.array] };
        """,
        str(painted),
    )
    assert found["names"] == ["", "blue", "red"]
    assert [(group["start"], group["count"], group["materialIndex"]) for group in found["groups"]] == [
        (0, 3, 0), (3, 3, 1), (6, 6, 2)
    ]  # fmt: skip
    with open_animation(painted) as animation:
        (uv,) = (own for own in animation.objects[0].attributes if own.name == "uv")
        rows = {tuple(row): vertex for vertex, row in enumerate(uv.values.tolist())}
    drawn = [rows[tuple(row)] for row in np.reshape(found["uvs"], (-1, 2))[found["index"]].tolist()]
    assert np.reshape(drawn, (-1, 3)).tolist() == [[1, 3, 2], [3, 5, 4], [0, 1, 2], [2, 3, 4]]


@pytest.mark.parametrize(("flip", "named"), [(False, "blue"), (True, "blue"), (False, "strip")])
def test_materials_and_uvs_follow_a_gltf_file(
    run_node: Callable[..., Any], painted: Path, flip: bool, named: str
) -> None:
    found = run_node(
        LOAD
        + """
        const [, flipY, named] = given;
        const map = Object.assign(new THREE.Texture(), { flipY });
        const material = new THREE.MeshStandardMaterial({ name: "blue", map, vertexColors: true });
        const mapped = Object.assign(new THREE.Mesh(new THREE.BufferGeometry(), material), { name: named });
        const scene = new THREE.Group().add(mapped);
        const before = [...(await load()).children[0].geometry.attributes.uv.array];
        const group = await load(new PDEAnimLoader().useMaterialsFrom({ scene }));
        const [mesh] = group.clone().children;
        found = { before, after: [...mesh.geometry.attributes.uv.array],
          maps: mesh.material.map((own) => own.map === map), colours: mesh.material.map((own) => own.vertexColors) };
        """,
        str(painted),
        flip,
        named,
    )
    # Faces without a material take the material of the mesh that is named like the object. No mesh is named red.
    assert found["maps"] == [named == "strip", True, False]
    assert not any(found["colours"]), "the file has no colours"
    expected = np.reshape(found["before"], (-1, 2))
    if not flip:
        expected = expected * [1, -1] + [0, 1]
    np.testing.assert_allclose(np.reshape(found["after"], (-1, 2)), expected, atol=1e-6)


def test_misuse_and_refused_hosts_end_in_errors_with_codes(
    run_node: Callable[..., Any], painted: Path, tmp_path: Path
) -> None:
    (tmp_path / "page.html").write_text("<!doctype html>")
    found = run_node(
        LOAD
        + """
        import { PdeAnimation, PdeanimError, compile } from "pdeanim";
        found = [];
        const attempt = async (work) => {
          try {
            await work();
            found.push(null);
          } catch (error) {
            found.push([error instanceof PdeanimError, error.code, error.message]);
          }
        };
        await attempt(() => compile(given[2]));
        await attempt(() => compile(new Uint8Array(2)));
        const clip = await PdeAnimation.open(await readFile(given[0]));
        await attempt(() => clip.positions(0, { out: new Float32Array(3) }));
        await attempt(() => clip.positions(0, { out: new Float64Array(18) }));
        await attempt(() => PdeAnimation.open(given[1]));
        await attempt(() => new PDEAnimLoader().loadAsync(given[1]));
        """,
        str(painted),
        "http://127.0.0.1:9/none.pdeanim",
        "file://" + urllib.parse.quote(str(tmp_path / "page.html")),
    )
    page, few, short, doubles, host, loader = found
    for wrong in (page, few):
        assert wrong[:2] == [True, "read-failed"]
        assert "pdeanim.wasm" in wrong[2]
    assert short == [True, "argument", "out has 3 numbers; it needs 18 (Float32Array)"]
    assert doubles is None
    for refused in (host, loader):
        assert refused[:2] == [True, "read-failed"]
        assert "127.0.0.1:9" in refused[2]
