"""`pdecodec info --json` of a rich file of each format, against what the format's own library lists of it."""

from __future__ import annotations

import base64
import json
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from pdecodec.cli.main import run
from tests.support.scene_cases import needed


def alembic(folder: Path) -> tuple[Path, Counter[str]]:
    """An archive, and how often the library lists each name of a property."""
    from tests.formats.test_alembic_inventory import everything, listing

    path = everything(folder / "x.abc")
    return path, Counter(one.rpartition("/")[2] for one in listing(path) if ":" in one)


def usd(folder: Path) -> tuple[Path, Counter[str]]:
    """A stage, and how often its flattened layer has each type of prim, property and key of metadata."""
    from pxr import Usd

    from tests.formats.test_usd_inventory import SHOP, listing

    path = folder / "x.usda"
    # Flattened layers have no inactive prims.
    path.write_text(SHOP.replace("active = false", "hidden = true"))
    stage = Usd.Stage.Open(str(path))
    found = Counter(key or place.partition(".")[2] for place, key in listing(path))
    del found[""]
    prims = Usd.PrimRange(stage.GetPseudoRoot(), Usd.PrimAllPrimsPredicate)
    return path, found + Counter(prim.GetTypeName() or "prim" for prim in list(prims)[1:])


def gltf(folder: Path) -> tuple[Path, Counter[str]]:
    """A scene, and how often its JSON has each kind of entry, attribute, extension and extra."""
    from tests.formats.test_gltf_inventory import kinds_in

    corners = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]] * 3, "<f4")
    data = corners.tobytes() + np.array([0, 1], "<f4").tobytes()
    uri = f"data:application/octet-stream;base64,{base64.b64encode(data).decode()}"
    spin = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    root = {
        "asset": {"version": "2.0", "copyright": "me", "extras": {"shop": 3}},
        "extensionsUsed": ["KHR_lights_punctual", "KHR_materials_clearcoat"],
        "extensions": {"KHR_lights_punctual": {"lights": [{"type": "point"}]}},
        "scenes": [{"nodes": [0, 1, 3]}, {"nodes": [2]}],
        "nodes": [
            {"name": "cup", "mesh": 0, "extras": {"owner": "me"}},
            {"name": "sun", "extensions": {"KHR_lights_punctual": {"light": 0}}},
            {"name": "elsewhere", "mesh": 1},
            {"name": "shot", "camera": 0},
        ],
        "cameras": [{"type": "perspective", "perspective": {"yfov": 1, "znear": 0.1}, "name": "front"}],
        "meshes": [
            {
                "primitives": [
                    {
                        "attributes": {"POSITION": 0, "NORMAL": 0, "TANGENT": 2, "_HEAT": 0},
                        "targets": [{"POSITION": 0, "NORMAL": 0}],
                        "material": 0,
                    },
                    {"attributes": {"POSITION": 0, "NORMAL": 0}, "mode": 0, "material": 1},
                ]
            },
            {"primitives": [{"attributes": {"POSITION": 0}}]},
        ],
        "materials": [
            {
                "name": "glaze",
                "doubleSided": True,
                "pbrMetallicRoughness": {"baseColorTexture": {"index": 0}, "roughnessFactor": 0.2},
                "extensions": {"KHR_materials_clearcoat": {"clearcoatFactor": 1}},
            },
            {"name": "dots"},
        ],
        "textures": [{"source": 0}],
        "images": [{"uri": "cup.png"}],
        "animations": [
            {"samplers": [{"input": 1, "output": 3}], "channels": [spin]},
            {"name": "other", "samplers": [{"input": 1, "output": 3}], "channels": [spin]},
        ],
        "accessors": [
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC3"},
            {"bufferView": 1, "componentType": 5126, "count": 2, "type": "SCALAR"},
            {"bufferView": 0, "componentType": 5126, "count": 3, "type": "VEC4"},
            {"bufferView": 0, "componentType": 5126, "count": 2, "type": "VEC3"},
        ],
        "bufferViews": [
            {"buffer": 0, "byteLength": corners.nbytes},
            {"buffer": 0, "byteOffset": corners.nbytes, "byteLength": 8},
        ],
        "buffers": [{"byteLength": len(data), "uri": uri}],
    }
    path = folder / "x.gltf"
    path.write_text(json.dumps(root))
    return path, kinds_in(root)


def ply(folder: Path) -> tuple[Path, Counter[str]]:
    """Frames with colours and data that have no place, and how often their headers have each kind."""
    from tests.formats.test_frame_inventory import CHANNELS, RED
    from tests.formats.test_frame_inventory import ply as text_of

    for number, more in enumerate(([], ["float late"])):
        columns = ((*CHANNELS, "float heat", *more), ("float flags",))
        text = text_of([f"{RED} 5{' 1' * len(more)}"] * 3, ["3 0 1 2 1"], columns=columns)
        (folder / f"x.{number}.ply").write_text(text)
    return folder / "x.#.ply", Counter(("positions", "faces", "vertex colours", "heat", "late", "face flags"))


EXPECTED = {
    ply: {"coded": ("positions", "faces", "vertex colours"), "dropped": ("heat", "late", "face flags")},
    alembic: {"coded": ("P", ".faces", "visible"), "dropped": ("studio", "width"), "implied": (".selfBnds",)},
    usd: {
        "coded": ("points", "Mesh", "primvars:kept", "upAxis"),
        "implied": ("extent", "defaultPrim"),
        "dropped": ("velocities", "Camera", "look=old", "PhysicsRigidBodyAPI", "renderSettingsPrimPath"),
    },
    gltf: {
        "coded": ("POSITION", "NORMAL", "materials", "name", "animations", "scenes", "nodes", "meshes", "channels"),
        "implied": ("accessors", "buffers", "doubleSided", "morphed NORMAL", "asset.version"),
        "dropped": (
            *("asset.copyright", "extras.shop", "extras.owner", "KHR_lights_punctual", "KHR_materials_clearcoat"),
            *("cameras", "nodes", "meshes", "scenes", "animations", "materials", "textures", "images", "NORMAL"),
            *("TANGENT", "_HEAT", "roughnessFactor", "baseColorTexture"),
        ),
    },
}


@pytest.mark.parametrize("make", EXPECTED)
def test_info_counts_what_a_file_holds_by_what_becomes_of_it(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], make: Callable[[Path], tuple[Path, Counter[str]]]
) -> None:
    needed({alembic: "abc", usd: "usda", gltf: "gltf", ply: "ply"}[make])
    path, listed = make(tmp_path)
    shown = []
    for options in ([], ["--isolate"]):
        assert run(["info", str(path), "--skip-unsupported", "--json", *options]) == 0
        shown.append(json.loads(capsys.readouterr().out)["contents"])
    assert shown[0] == shown[1]
    counts: Counter[str] = Counter()
    for one in shown[0]:
        counts[one["kind"].rpartition("/")[2]] += one["count"]
    assert {kind: counts[kind] for kind in listed} == dict(listed)
    for fate, kinds in EXPECTED[make].items():
        assert {one["kind"] for one in shown[0] if one["fate"] == fate} >= set(kinds)
