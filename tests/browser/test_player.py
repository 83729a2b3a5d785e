"""The player: the decoder as WebAssembly, in Node."""

from __future__ import annotations

import gzip
import importlib.util
import json
import re
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pdecodec
from core.bindings.wasm import build
from pdecodec import Animation, encode, open_animation
from pdecodec.mesh.arrays import Float32Array, Float64Array
from spec.decoder import animation as independent
from spec.vector_files import accepted_files, accepted_vectors, read_manifest, write_vectors
from tests.support.browser_tools import BROWSER, run_node
from tests.support.decoders import assert_close
from tests.support.remote_server import serving

ROOT = Path(__file__).resolve().parents[2]
PLAYER = ROOT / "player"
MANIFEST = read_manifest()

MAX_BYTES = 230_000
"""Limit of the module's size after gzip [bytes]."""


def decode_in_node(jobs: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Decode files with ``tests/browser/decode.mjs``, and return the player's results."""
    found: list[dict[str, Any]] = json.loads(run_node(BROWSER / "decode.mjs", given=json.dumps(jobs)))
    return found


def points(numbers: list[float]) -> Float32Array:
    return np.array(numbers, np.float64).astype(np.float32).reshape(-1, 3)


def times_of(times: Float64Array) -> list[float]:
    """Return the times of frames, times between them, and one after the last."""
    between = times[:-1] + 0.37 * np.diff(times)
    return [float(time) for time in (*times[:8], *between[:8], times[-1], times[-1] + 1.0)]


@pytest.fixture(scope="module")
def accepted() -> dict[str, dict[str, Any]]:
    """Return the player's results for each accepted vector, with the times that were requested."""
    jobs = []
    for name in MANIFEST["accept"]:
        path = accepted_files()[name]
        with open_animation(path) as animation:
            jobs.append({"path": str(path), "times": times_of(animation.times)})
    found = decode_in_node(jobs)
    return {
        name: {"asked": job["times"]} | result
        for name, job, result in zip(MANIFEST["accept"], jobs, found, strict=True)
    }


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_positions_are_within_the_margin_of_the_specification(accepted: dict[str, Any], name: str) -> None:
    found = accepted[name]
    assert "error" not in found, found
    with open_animation(accepted_files()[name]) as animation:
        assert (found["times"], found["frameRate"]) == (animation.times.tolist(), animation.fps)
        plain = independent.decode_runs(accepted_vectors()[name])
        for time, here in zip(found["asked"], found["at"], strict=True):
            other = independent.run_at(plain, time)
            if min(time, other.times[-1]) in other.times:
                assert_close(points(here["positions"]), other, min(time, other.times[-1]))
                continue
            # Between frames, the corrections of both frames are added, and each sum is rounded.
            expected = animation.positions(time)
            margin = 2 * other.motion.margin(time) + 2 * np.spacing(np.abs(expected))
            assert (np.abs(points(here["positions"]) - expected) <= margin).all(), time


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_velocities_and_accelerations_are_those_of_the_library(accepted: dict[str, Any], name: str) -> None:
    with open_animation(accepted_files()[name]) as animation:
        for time, here in zip(accepted[name]["asked"], accepted[name]["at"], strict=True):
            run = animation.run_at(time)
            assert isinstance(run, Animation)
            for quantity in ("velocities", "accelerations"):
                expected = getattr(run, quantity)(time)
                scale = np.abs(expected).max() + 1.0
                assert np.abs(points(here[quantity]) - expected).max() <= 1e-5 * scale, (quantity, time)


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_meshes_and_attributes_are_those_of_the_library(accepted: dict[str, Any], name: str) -> None:
    with open_animation(accepted_files()[name]) as animation:
        for meshes, run in zip(accepted[name]["runs"], animation.runs, strict=True):
            assert isinstance(run, Animation)
            for mesh, item in zip(meshes, run.objects, strict=True):
                own = item.connectivity
                assert (mesh["name"], mesh["vertices"]) == (item.name, item.vertex_count)
                assert (mesh["faceSizes"], mesh["faceIndices"]) == (own.face_counts.tolist(), own.face_indices.tolist())
                assert (mesh["lineSizes"], mesh["lineIndices"]) == (own.line_counts.tolist(), own.line_indices.tolist())
                for found, attribute in zip(mesh["attributes"], item.attributes, strict=True):
                    assert found["name"] == attribute.name
                    assert tuple(found["labels"]) == attribute.labels
                    values = np.array(found["values"], np.float64)
                    assert np.array_equal(values, attribute.values.astype(np.float64).ravel())
                    indices = None if attribute.indices is None else attribute.indices.tolist()
                    assert found["indices"] == indices


def test_fields_are_those_of_the_library(tmp_path: Path) -> None:
    path, times = tmp_path / "fields.pdeanim", [0.0, 0.3, 1.0, 2.0]
    random = np.random.default_rng(0)
    objects = [
        pdecodec.MeshObject(name, pdecodec.Connectivity.from_padded(4, np.array([[0, 1, 2, 3]]))) for name in "ab"
    ]
    heat = random.normal(size=(3, 8)).astype(np.float32)
    heat[1, 2] = np.nan
    fields = [
        (pdecodec.Field("heat", "vertex", unit="K"), heat),
        (pdecodec.Field("stress", "face", np.float64, 6, objects=(1,)), random.normal(size=(3, 1, 6))),
        (pdecodec.Field("id", "corner", np.int64), random.integers(-(2**62), 2**62, (3, 8))),
        (pdecodec.Field("touches", "object", bool), random.integers(0, 2, (3, 2))),
    ]
    clip = pdecodec.ArraySequence(
        random.normal(size=(3, 8, 3)).astype(np.float32), objects=objects, times=np.arange(3.0), fields=fields
    )
    encode(clip, path)
    (found,) = decode_in_node([{"path": str(path), "times": times}])
    assert "error" not in found, found
    with open_animation(path) as animation:
        for described, field, stored in zip(found["fields"][0], animation.fields, animation.stored_fields, strict=True):
            objects_of_field = [0, 1] if field.objects is None else list(field.objects)
            described |= {name: float(described[name]) for name in ("smallest", "largest", "bound")}
            assert described == {
                "name": field.name, "unit": field.unit, "type": str(field.dtype), "components": field.components,
                "domain": {"vertex": "vertices", "face": "faces", "corner": "corners"}.get(field.domain, field.domain),
                "rows": field.row_count(animation.objects), "objects": objects_of_field,
                "smallest": stored.smallest, "largest": stored.largest, "bound": stored.bound,
            }  # fmt: skip
        for time, here in zip(times, found["at"], strict=True):
            for field, texts in zip(animation.fields, here["fields"], strict=True):
                values = np.array(texts, np.float64 if field.dtype.kind == "f" else np.int64).astype(field.dtype)
                np.testing.assert_array_equal(values, animation.field(field.name, time).ravel())


def test_refused_vectors_end_in_the_pinned_error(tmp_path: Path) -> None:
    expected = MANIFEST["reject"]
    jobs = [{"path": str(path), "times": []} for path in write_vectors(tmp_path, "reject").values()]
    for name, found in zip(expected, decode_in_node(jobs), strict=True):
        if expected[name].get("section") in ("META", "SCEN"):
            assert "error" not in found, "the player leaves remarks and scenes unread, as a decoder may"
        else:
            assert found.get("code") == expected[name]["error"], (name, found.get("error"))
            assert found["error"]


def test_a_file_at_an_address_is_read_group_by_group(tmp_path: Path) -> None:
    clip = moving_points(frames=400, vertices=600)
    path = tmp_path / "long.pdeanim"
    encode(clip, path, tolerance=1e-6, group_frames=20)
    with open_animation(path) as animation, serving(tmp_path) as server:
        assert path.stat().st_size > 6 * 65536, "long enough for parts"
        (found,) = decode_in_node([{"address": f"{server.address}/long.pdeanim", "times": [0.0]}])
        assert "error" not in found, found
        assert np.abs(points(found["at"][0]["positions"]) - animation.positions(0.0)).max() <= 1e-6
        assert server.bytes_given < path.stat().st_size / 2
        (missing,) = decode_in_node([{"address": f"{server.address}/none.pdeanim", "times": []}])
    assert "answered 404" in missing["error"]
    assert missing["code"] == "read-failed"


def moving_points(*, frames: int, vertices: int) -> pdecodec.ArraySequence:
    """Return random positions, which no model predicts, so that the file is large."""
    random = np.random.default_rng(1)
    steps = random.normal(size=(frames, vertices, 3)).astype(np.float32)
    return pdecodec.ArraySequence(steps, times=np.arange(frames) / 24)


def test_the_module_is_small_enough_to_be_fetched_in_a_moment() -> None:
    assert len(gzip.compress((PLAYER / "pdeanim.wasm").read_bytes(), 9)) <= MAX_BYTES


def test_the_module_is_built_from_the_sources_that_are_here() -> None:
    made = build.built_from((PLAYER / "pdeanim.wasm").read_bytes())
    assert made["sources"] == build.digest(), "the core has changed: make wasm"


def test_building_again_gives_the_same_module(tmp_path: Path) -> None:
    made = build.built_from((PLAYER / "pdeanim.wasm").read_bytes())
    if importlib.util.find_spec("ziglang") is None or build.version("ziglang") != made["ziglang"]:
        pytest.skip(f"the package ziglang {made['ziglang']} is not here")
    if build.binaryen_version() != made["binaryen"]:
        pytest.skip(f"Binaryen {made['binaryen']} is not here: make wasm")
    build.build(tmp_path / "again.wasm")
    assert (tmp_path / "again.wasm").read_bytes() == (PLAYER / "pdeanim.wasm").read_bytes()


def test_the_types_and_the_readme_name_every_export() -> None:
    listed = json.loads((PLAYER / "package.json").read_text("utf-8"))["exports"]
    readme = (PLAYER / "README.md").read_text("utf-8")
    pattern = re.compile(
        r"^export (?:abstract |async )?(?:class|function\*?|const) (\w+)|^export \{ ([\w, ]+) \}", re.M
    )
    for address, places in listed.items():
        assert f"`pdeanim{address.removeprefix('.')}`" in readme
        if isinstance(places, str):
            continue
        names, typed = (
            set(", ".join(map("".join, pattern.findall((PLAYER / places[kind]).read_text("utf-8")))).split(", "))
            for kind in ("default", "types")
        )
        assert names == typed
        assert not {name for name in names if f"`{name}`" not in readme}


def test_the_types_name_what_the_scripts_have() -> None:
    script = """
        const modules = {};
        for (const name of ["pdeanim", "mesh", "gpu", "webgpu"]) {
          modules[name] = await import(`./player/${name}.js`);
        }
        const found = {};
        for (const [name, module] of Object.entries(modules)) {
          found[name] = Object.keys(module);
          for (const value of Object.values(module)) {
            if (!value.prototype || !/^class/.test(value)) continue;
            found[name].push(...Object.getOwnPropertyNames(value.prototype));
          }
        }
        console.log(JSON.stringify(found));
    """
    found = run_node("--input-type=module", "-e", script, folder=ROOT)
    for name, members in json.loads(found).items():
        types = (PLAYER / f"{name}.d.ts").read_text("utf-8")
        if "extends GroupedMotion" in types:
            types += (PLAYER / "motion.d.ts").read_text("utf-8")
        own = {member for member in members if not member.startswith("_")}
        missing = {member for member in own if not re.search(rf"\b{member}\b", types)}
        assert not missing, (name, missing)
