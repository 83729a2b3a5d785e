"""gltf-transform keeps motion in glTF files (PDECODEC_mesh_motion) with the class of the npm package."""

from __future__ import annotations

import base64
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spec.decoder.gltf import root_of, shape_at
from tests.formats.test_gltf_mesh_motion import changed
from tests.support.browser_tools import assert_valid, node_module

NAME = "PDECODEC_mesh_motion"

SCRIPT = """
import { NodeIO } from "@gltf-transform/core";
import { ALL_EXTENSIONS } from "@gltf-transform/extensions";
import { dedup, prune, reorder, resample, textureCompress, weld } from "@gltf-transform/functions";
import { MeshoptEncoder } from "meshoptimizer";
import { PDECODECMeshMotion } from "pdeanim/gltf-transform";
import sharp from "sharp";
const [from, to, changes] = given;
await MeshoptEncoder.ready;
const steps = { dedup: dedup(), prune: prune(), resample: resample(), weld: weld(),
  reorder: reorder({ encoder: MeshoptEncoder }), webp: textureCompress({ encoder: sharp, targetFormat: "webp" }) };
const io = new NodeIO().registerExtensions([...ALL_EXTENSIONS, PDECODECMeshMotion]);
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


def add_pictures(root: dict[str, Any]) -> None:
    """Give the flag a picture, and the file a copy of it that nothing uses."""
    pixels = np.random.default_rng(1).integers(0, 255, (64, 64, 3), np.uint8)
    rows = b"".join(b"\0" + row.tobytes() for row in pixels)
    chunks = ((b"IHDR", struct.pack(">2I5B", 64, 64, 8, 2, 0, 0, 0)), (b"IDAT", zlib.compress(rows)), (b"IEND", b""))
    data = b"".join(
        struct.pack(">I", len(own)) + kind + own + struct.pack(">I", zlib.crc32(kind + own)) for kind, own in chunks
    )
    address = "data:image/png;base64," + base64.b64encode(b"\x89PNG\r\n\x1a\n" + data).decode()
    root["images"] = [{"uri": address}] * 2
    root["textures"] = [{"source": 0}, {"source": 1}]
    material = root["materials"][root["meshes"][0]["primitives"][0]["material"]]
    material.setdefault("pbrMetallicRoughness", {})["baseColorTexture"] = {"index": 0}


@pytest.mark.parametrize(
    ("changes", "is_reordered"),
    [(["dedup", "prune", "resample", "webp"], False), (["weld", "reorder", "prune"], True)],
)
def test_gltf_transform_keeps_the_motion(
    site: Path, run_node: Callable[..., Any], tmp_path: Path, changes: list[str], is_reordered: bool
) -> None:
    for name in ("@gltf-transform", "meshoptimizer", "sharp"):
        if not (site / "node_modules" / name).exists():
            (site / "node_modules" / name).symlink_to(node_module(name))
    original, path = changed(tmp_path / "painted.glb", add_pictures), tmp_path / "kept.glb"
    assert run_node(SCRIPT, str(original), str(path), changes) == path.stat().st_size
    assert_valid(path)
    kinds = [image["mimeType"] for image in root_of(path.read_bytes())["images"]]
    assert kinds == ["image/webp" if "webp" in changes else "image/png"]
    before, after = original.read_bytes(), path.read_bytes()
    motions, kept = (root_of(data)["extensions"][NAME]["motions"] for data in (before, after))
    assert [one | {"bufferView": 0} for one in motions] == [one | {"bufferView": 0} for one in kept]
    first, other = (root_of(data)["meshes"][0]["primitives"][0] for data in (before, after))
    for time in (0.0, 0.71):
        expected, found = (np.array(shape_at(*given, time)) for given in ((before, first), (after, other)))
        if is_reordered:
            assert not np.array_equal(found, expected), "another order"
            expected, found = (np.unique(points, axis=0) for points in (expected, found))
        np.testing.assert_array_equal(found, expected)
