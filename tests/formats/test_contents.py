"""`pdecodec info --json` on a rich file of each format, compared with what the format's own library lists."""

from __future__ import annotations

import base64
import json
import struct
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any
from xml.etree import ElementTree

import numpy as np
import pytest

from pdecodec.cli.main import run
from tests.support.scene_cases import needed


def alembic(folder: Path) -> tuple[Path, Counter[str]]:
    """Write an archive; return it, and how often the library lists each name of a property."""
    from tests.formats.test_alembic_inventory import everything, listing

    path = everything(folder / "x.abc")
    return path, Counter(one.rpartition("/")[2] for one in listing(path) if ":" in one)


def usd(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a stage; return it, and how often its flattened layer has each type of prim, property and key of
    metadata.
    """
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
    """Write a scene; return it, and how often its JSON has each kind of entry, attribute, extension and extra."""
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
    """Write frames with colours, other numbers and lists that are not kept; return them, and how often their headers
    have each kind.
    """
    from tests.formats.test_frame_inventory import CHANNELS, RED
    from tests.formats.test_frame_inventory import ply as text_of

    for number, more in enumerate(([], ["float late"])):
        columns = ((*CHANNELS, "float heat", *more), ("float flags", "list uchar float weights"))
        text = text_of([f"{RED} 5{' 1' * len(more)}"] * 3, ["3 0 1 2 1 1 5"], columns=columns)
        (folder / f"x.{number}.ply").write_text(text)
    kinds = ("positions", "faces", "vertex colours", "heat", "late", "face flags", "face weights")
    return folder / "x.#.ply", Counter(kinds)


def obj(folder: Path) -> tuple[Path, Counter[str]]:
    """Write frames with names, colours and statements that are not kept; return them, and how often each kind
    of statement occurs.
    """
    text = """# by hand
#MRGB ffff0000
mtllib a.mtl
mtllib my b.mtl
o seat
v 0 0 0 1 0 0
v 1 0 0 0 1 0
v 0 1 0 0 0 1
vp 1 2
vt 0 0
vt 1 0
vt 1 1
vn 0 0 1
g legs
usemtl oak
s 1
f 1/1/1 2/2/1 3/3/1
usemtl pine
g back
f 1/1/1 3/3/1 2/2/1
o wire
v 0 0 1
v 0 0 2
l 4/1 5/2
lod 3
"""
    frames = [text, text.replace("1 0 0\nv", "1 1 0\nv").replace("v 0 0 1\n", "v 0 0 1\n# later\n")]
    for number, frame in enumerate(frames):
        (folder / f"x.{number}.obj").write_text(frame)
    # One entry for all numbers of an object, one for each name.
    lines = [line.split(maxsplit=1) for line in text.splitlines()]
    first = Counter(dict.fromkeys((word for word, _ in lines), 1))
    names = Counter(word for word, _ in {(word, tuple(rest.split())) for word, rest in lines})
    listed = {
        "objects": names["o"],
        "mtllib": names["mtllib"],
        "groups": names["g"],
        "materials": names["usemtl"],
        "smoothing groups": names["s"],
        "positions": names["o"],  # both objects have positions of their own
        "faces": first["f"],
        "lines": first["l"],
        "UVs": first["vt"],
        "hard edges": first["vn"],
        "vertex colours": 1,
        "comments": first["#"],
        "#MRGB": first["#MRGB"],
        "vp": first["vp"],
        "lod": first["lod"],
        "vt of l": 1,
        "g and usemtl of l and p": 1,
    }
    return folder / "x.#.obj", Counter(listed)


ARRAYS = {
    **{"points": np.zeros((2, 3, 3), np.float32), "faces": np.array([[0, 1, 2]]), "times": np.array([0, 0.5])},
    **{"objects/0/name": "tri", "objects/0/vertex_count": 3, "objects/0/face_counts": [3]},
    **{"objects/0/face_indices": [0, 1, 2], "objects/0/line_counts": [], "objects/0/line_indices": []},
    **{
        "field_warm": np.zeros((2, 3)),
        "field_odd": np.zeros((2, 7)),
        "run/7/heat": 5,
        "objects/0/colour of the year": 1,
        "objects/2/name": "lost",
    },
}


def npz(folder: Path) -> tuple[Path, Counter[str]]:
    """Write an archive with arrays of the layout and others, some under names of the layout; return it, and
    NumPy's list of it.
    """
    typed = {name: np.array(value, None if np.size(value) else np.int32) for name, value in ARRAYS.items()}
    np.savez(folder / "x.npz", **typed)
    with np.load(folder / "x.npz") as archive:
        return folder / "x.npz", Counter(name.rpartition("/")[2] for name in archive.files)


def hdf5(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a file with the same datasets, groups and attributes; return it, and h5py's list of it."""
    import h5py

    listed: Counter[str] = Counter()

    def count(name: str, item: Any) -> None:
        listed["groups" if isinstance(item, h5py.Group) else name.rpartition("/")[2]] += 1
        listed["attributes"] += len(item.attrs)

    with h5py.File(folder / "x.h5", "w") as file:
        for name, value in ARRAYS.items():
            file[name] = np.array(value, None if np.size(value) else np.int32) if name[-4:] != "name" else value
        file.create_group("empty")
        file["run/7"].attrs["solver"] = file["field_odd"].attrs["unit"] = "K"
        file.visititems(count)
    return folder / "x.h5", listed


def mdd(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a cache of one frame of one point, with bytes after it."""
    (folder / "x.mdd").write_bytes(struct.pack(">iif3f", 1, 1, 0.5, 1, 2, 3) + b"more")
    return folder / "x.mdd", Counter(("times", "positions", "bytes after the last frame"))


def pc2(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a cache of two frames of one point."""
    (folder / "x.pc2").write_bytes(b"POINTCACHE2\0" + struct.pack("<iiffi6f", 1, 1, 0, 1, 2, *range(6)))
    return folder / "x.pc2", Counter(("times", "positions"))


def vtu(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a grid with data on points, on cells and on the whole; return it, and meshio's list of the data."""
    import meshio

    from tests.formats.test_specifications import array
    from tests.formats.test_specifications import vtu as written

    heat = array("heat", "Float32", "1 2 3")
    fields = array("TimeValue", "Float64", "0.5") + array("run", "Int32", "7")
    path = written(folder, heat, array("part", "Int32", "1") + array("stress", "Float32", "2"), fields)
    mesh = meshio.read(path)
    counts = {"point data": len(mesh.point_data), "cell data": len(mesh.cell_data), "field data": fields.count("Name=")}
    return path, Counter({**counts, "positions": 1, "faces": len(mesh.cells)})


def xdmf(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a grid with attributes, a set and information; return it, and how often its XML has each kind of
    element.
    """
    from tests.formats.test_specifications import ITEM
    from tests.formats.test_specifications import xdmf as written

    path = written(
        folder,
        f'<Time Value="2"/><Attribute Name="a" Center="Node">{ITEM}</Attribute>'
        f'<Attribute Name="b" Center="Cell">{ITEM}</Attribute><Attribute Name="c" Center="Grid">{ITEM}</Attribute>'
        f'<Set Name="rim" SetType="Node">{ITEM}</Set><Information Name="by" Value="hand"/>',
    )
    listed = Counter(one.tag for one in ElementTree.parse(path).iter())
    kinds = {"times": "Time", "sets": "Set", "information": "Information", "positions": "Geometry", "faces": "Topology"}
    counts = Counter({kind: listed[tag] for kind, tag in kinds.items()})
    return path, counts + Counter({"point data": 1, "cell data": 1, "grid data": 1})


def exodus(folder: Path) -> tuple[Path, Counter[str]]:
    """Write a file with variables, blocks, sets and records; return it, and what h5py lists."""
    import h5py

    from tests.support.exodus_files import write_exodus

    names = {"name_elem_var": ["stress"], "eb_names": ["plate"], "ns_names": ["rim", ""], "name_glo_var": ["energy"]}
    moves = {f"displ_{axis}": np.zeros((3, 4)) for axis in "xyz"}
    write_exodus(folder / "x.e", {**moves, "temp": np.zeros((3, 4))}, listed=names)
    with h5py.File(folder / "x.e", "a") as file:
        for name in (
            "node_ns1",
            "node_ns2",
            "elem_ss1",
            "side_ss1",
            "attrib1",
            "qa_records",
            "assembly1",
            "num_el_blk",
        ):
            file[name] = np.ones(1, np.int32)
        kinds = {"name_nod_var": "nodal variables", "name_elem_var": "element variables", "eb_names": "blocks"}
        counts = Counter({kind: len(file[place]) for place, kind in kinds.items()})
        parts = {"node_ns": "node sets", "elem_ss": "side sets", "attrib": "element attributes"}
        counts.update(parts[name[:-1]] for name in file if name[:-1] in parts)
    rest = ("records", "other arrays", "times", "positions", "faces", "global variables")
    return folder / "x.e", counts + Counter(rest)


DATA = ("point data", "cell data")
LAYOUT = {
    "coded": ("points", "times", "name", "face_counts", "field_warm"),
    "implied": ("faces",),
    "dropped": ("heat", "field_odd", "name", "colour of the year"),
}
EXPECTED = {
    vtu: {"coded": ("positions", "faces", "field data", *DATA), "dropped": ("field data",)},
    xdmf: {"coded": ("positions", "faces", "times", *DATA, "grid data"), "dropped": ("sets", "information")},
    exodus: {
        "coded": ("positions", "faces", "times", "nodal variables", "blocks"),
        "dropped": (
            "element variables",
            "global variables",
            "node sets",
            "side sets",
            "element attributes",
            "records",
            "other arrays",
        ),
    },
    npz: LAYOUT,
    hdf5: {**LAYOUT, "implied": ("faces", "groups"), "dropped": (*LAYOUT["dropped"], "attributes")},
    mdd: {"coded": ("times", "positions"), "dropped": ("bytes after the last frame",)},
    pc2: {"coded": ("times", "positions"), "dropped": ()},
    obj: {
        "coded": ("positions", "groups", "materials", "mtllib", "objects", "vertex colours"),
        "implied": ("comments",),
        "dropped": ("vp", "lod", "#MRGB", "vt of l"),
    },
    ply: {
        "coded": ("positions", "faces", "vertex colours", "heat", "late", "face flags"),
        "dropped": ("face weights",),
    },
    alembic: {"coded": ("P", ".faces", "visible"), "dropped": ("studio", "width"), "implied": (".selfBnds",)},
    usd: {
        "coded": ("points", "velocities", "accelerations", "Mesh", "primvars:kept", "primvars:heat", "upAxis"),
        "implied": ("extent", "defaultPrim"),
        "dropped": ("Camera", "look=old", "PhysicsRigidBodyAPI", "renderSettingsPrimPath"),
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
    needed({alembic: "abc", usd: "usda", gltf: "gltf"}.get(make, make.__name__))
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
