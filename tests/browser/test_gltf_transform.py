"""gltf-transform keeps motion in glTF files (PDECODEC_mesh_motion) with the class of the npm package."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spec.decoder.gltf import root_of, shape_at
from spec.extension.make_example import PATH
from tests.support.browser_tools import assert_valid, node_modules

NAME = "PDECODEC_mesh_motion"

SCRIPT = """
import { NodeIO } from "@gltf-transform/core";
import { dedup, prune, reorder, resample, weld } from "@gltf-transform/functions";
import { MeshoptEncoder } from "meshoptimizer";
import { PDECODECMeshMotion } from "pdeanim/gltf-transform";
const [from, to, changes] = given;
await MeshoptEncoder.ready;
const steps = { dedup: dedup(), prune: prune(), resample: resample(), weld: weld(),
  reorder: reorder({ encoder: MeshoptEncoder }) };
const io = new NodeIO().registerExtensions([PDECODECMeshMotion]);
const document = await io.read(from);
const fail = (text) => {
  throw new Error(text);
};
document.setLogger({ debug() {}, info() {}, warn: fail, error: fail });
await document.transform(...changes.map((name) => steps[name]));
const first = await io.writeBinary(document);
await io.write(to, document);
found = first.length;
"""


@pytest.mark.parametrize(
    ("changes", "is_reordered"), [(["dedup", "prune", "resample"], False), (["weld", "reorder", "prune"], True)]
)
def test_gltf_transform_keeps_the_motion(
    site: Path, run_node: Callable[..., Any], tmp_path: Path, changes: list[str], is_reordered: bool
) -> None:
    for name in ("@gltf-transform", "meshoptimizer"):
        if not (node_modules() / name).is_dir():
            pytest.skip(f"{name} is not here; npm install --prefix tests/browser")
        if not (site / "node_modules" / name).exists():
            (site / "node_modules" / name).symlink_to(node_modules() / name)
    path = tmp_path / "kept.glb"
    assert run_node(SCRIPT, str(PATH), str(path), changes) == path.stat().st_size
    assert_valid(path)
    before, after = PATH.read_bytes(), path.read_bytes()
    motions, kept = (root_of(data)["extensions"][NAME]["motions"] for data in (before, after))
    assert [one | {"bufferView": 0} for one in motions] == [one | {"bufferView": 0} for one in kept]
    first, other = (root_of(data)["meshes"][0]["primitives"][0] for data in (before, after))
    for time in (0.0, 0.71):
        expected, found = (np.array(shape_at(*given, time)) for given in ((before, first), (after, other)))
        if is_reordered:
            assert not np.array_equal(found, expected), "another order"
            expected, found = (np.unique(points, axis=0) for points in (expected, found))
        np.testing.assert_array_equal(found, expected)
