"""Formats do what their specifications declare: one small file per feature is read, and whatever is dropped is
named.
"""

from __future__ import annotations

import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import list_formats, open_sequence, write_sequence
from pdecodec.formats.specifications import SPECIFICATIONS
from pdecodec.mesh.sequence import ArraySequence, MeshSequence
from tests.formats.test_gltf_content import with_entries
from tests.support.exodus_files import write_exodus

POINTS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)


def attributes(clip: MeshSequence) -> set[str]:
    return {f"{one.name} {one.domain}" for item in clip.objects for one in item.attributes}


def has(*names: str) -> Callable[[MeshSequence], bool]:
    """Return a function that checks whether objects have attributes of these names and domains."""
    return lambda clip: set(names) <= attributes(clip)


def has_field(name: str) -> Callable[[MeshSequence], bool]:
    """Return a function that checks whether there is a field of that name and domain."""
    return lambda clip: name in [f"{field.name} {field.domain}" for field in clip.fields]


def counts(vertices: int, faces: int = 1, lines: int = 0) -> Callable[[MeshSequence], bool]:
    whole = (vertices, faces, lines)
    return lambda clip: (clip.vertex_count, clip.connectivity.face_count, clip.connectivity.line_count) == whole


def edited(path: Path, old: str, new: str) -> Path:
    path.write_text(path.read_text().replace(old, new))
    return path


def obj(folder: Path, lines: str, triangle: str = "f 1 2 3") -> Path:
    (folder / "x.obj").write_text(f"v 0 0 0\nv 1 0 0\nv 0 1 0\n{lines}\n{triangle}\n")
    return folder / "x.obj"


def ply(folder: Path, vertex: str = "", face: str = "", more: str = "", rows: str = "", head: str = "") -> Path:
    """Write a triangle; `vertex` and `face` are names of further properties, of type uchar unless a type
    precedes them, with value 1.
    """
    columns = [[one if " " in one else f"uchar {one}" for one in text.split(",") if one] for text in (vertex, face)]
    values = [" 1" * len(columns[0]), "".join(" 2 1 1" if one.startswith("list") else " 1" for one in columns[1])]
    text = ["ply", "format ascii 1.0", *head.splitlines(), "element vertex 3"]
    text += [f"property {one}" for one in ("float x", "float y", "float z", *columns[0])]
    text += ["element face 1", "property list uchar int vertex_indices", *(f"property {one}" for one in columns[1])]
    text += [*more.splitlines(), "end_header", *(f"{place}{values[0]}" for place in ("0 0 0", "1 0 0", "0 1 0"))]
    (folder / "x.ply").write_text("\n".join([*text, f"3 0 1 2{values[1]}", rows, ""]))
    return folder / "x.ply"


def stl(folder: Path, names: str = "", attribute: int = 0) -> Path:
    facet = "facet normal 0 0 1\nouter loop\nvertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\nendfacet\n"
    text = "".join(f"solid {name}\n{facet}endsolid {name}\n" for name in names.split() or [""])
    data = bytes(80) + struct.pack("<I12fH", 1, 0, 0, 1, *POINTS.reshape(-1).tolist(), attribute)
    (folder / "x.stl").write_bytes(data if attribute else text.encode())
    return folder / "x.stl"


def off(folder: Path, head: str = "OFF", color: str = "") -> Path:
    (folder / "x.off").write_text(f"{head}\n3 1 0\n0 0 0\n1 0 0\n0 1 0\n3 0 1 2 {color}\n")
    return folder / "x.off"


def array(name: str, kind: str, values: str, more: str = "") -> str:
    return f'<DataArray type="{kind}" Name="{name}" format="ascii" {more}>{values}</DataArray>'


def vtu(folder: Path, point_data: str = "", cell_data: str = "", field_data: str = "") -> Path:
    cells = array("connectivity", "Int32", "0 1 2") + array("offsets", "Int32", "3") + array("types", "UInt8", "5")
    points = array("Points", "Float32", "0 0 0 1 0 0 0 1 0", 'NumberOfComponents="3"')
    (folder / "x.vtu").write_text(
        '<VTKFile type="UnstructuredGrid" version="0.1" byte_order="LittleEndian"><UnstructuredGrid>'
        f'<FieldData>{field_data}</FieldData><Piece NumberOfPoints="3" NumberOfCells="1">'
        f"<PointData>{point_data}</PointData><CellData>{cell_data}</CellData>"
        f"<Points>{points}</Points><Cells>{cells}</Cells></Piece></UnstructuredGrid></VTKFile>"
    )
    return folder / "x.vtu"


def xdmf(folder: Path, within: str = "", kind: str = "Triangle") -> Path:
    items = [f'<DataItem Dimensions="{size}" Format="XML">{text}</DataItem>' for size, text in (
        ("1 3", "0 1 2"), ("3 3", "0 0 0 1 0 0 0 1 0"))]  # fmt: skip
    grid = f'<Grid Name="g"><Topology TopologyType="{kind}" NumberOfElements="1">{items[0]}</Topology>'
    grid += f'<Geometry GeometryType="XYZ">{items[1]}</Geometry>{within}</Grid>'
    (folder / "x.xdmf").write_text(f'<Xdmf Version="3.0"><Domain>{grid}</Domain></Xdmf>')
    return folder / "x.xdmf"


def numbered(folder: Path) -> Path:
    with h5py.File(exodus(folder), "a") as file:
        file["node_num_map"] = np.array([4, 3, 2, 9], np.int32)
    return folder / "x.e"


def exodus(folder: Path, *records: str, **options: Any) -> Path:
    write_exodus(folder / "x.e", options.pop("nodal", {}), **options)
    with h5py.File(folder / "x.e", "a") as file:
        for name in records:
            file[name] = np.zeros((1, 81), "S1")
    return folder / "x.e"


def arrays(folder: Path, kind: str, **more: Any) -> Path:
    path = folder / f"x.{kind}"
    found = {"points": POINTS[None], "faces": np.array([[0, 1, 2]]), **more}
    if kind == "npz":
        np.savez(path, **found)
    else:
        with h5py.File(path, "w") as file:
            for name, values in found.items():
                file[name] = values
    return path


def written(folder: Path, extension: str) -> Path:
    clip = ArraySequence(np.stack([POINTS, POINTS + 1]), faces=[[0, 1, 2]], fps=24)
    write_sequence(clip, folder / f"x.{extension}")
    return folder / f"x.{extension}"


ITEM = '<DataItem Dimensions="3" Format="XML">1 2 3</DataItem>'
NORMALS, UVS = "vn 0 0 1", "vt 0 0\nvt 1 0\nvt 1 1"
VECTORS = array("shift", "Float64", "0 0 1 0 0 1 0 0 1", 'NumberOfComponents="3"')

SAMPLES: dict[str, dict[str, tuple[Callable[[Path], Path], Any]]] = {
    "obj": {
        "v": (lambda folder: obj(folder, ""), counts(3)),
        "colours of v": (lambda folder: obj(folder, "v 1 1 1 1 0 0"), has("color vertex")),
        "vt": (lambda folder: obj(folder, UVS, "f 1/1 2/2 3/3"), has("uv corner")),
        "vn (which corners share one)": (
            lambda folder: obj(folder, NORMALS, "f 1//1 2//1 3//1"),
            has("normal_group corner"),
        ),
        "f": (lambda folder: obj(folder, ""), counts(3)),
        "l": (lambda folder: obj(folder, "l 1 2"), counts(3, 1, 1)),
        "p": (lambda folder: obj(folder, "p 1"), counts(3, 1, 1)),
        "o": (lambda folder: obj(folder, "o chair"), lambda clip: clip.objects[0].name == "chair"),
        "g": (lambda folder: obj(folder, "g legs"), has("group face")),
        "s": (lambda folder: obj(folder, "s 1"), has("smoothing face")),
        "usemtl": (lambda folder: obj(folder, "usemtl oak"), has("material face")),
        "mtllib": (lambda folder: obj(folder, "mtllib a.mtl"), lambda clip: "mtllib" in clip.metadata),
        "g and usemtl of l and p": (lambda folder: obj(folder, "g a\nl 1 2"), "groups and materials of lines"),
        "comments": (lambda folder: obj(folder, "# by hand"), counts(3)),
    },
    "ply": {
        "vertex x, y, z": (ply, counts(3)),
        "vertex nx, ny, nz (which corners share one)": (
            lambda folder: ply(folder, "float nx,float ny,float nz"),
            has("normal_group corner"),
        ),
        "vertex red, green, blue": (lambda folder: ply(folder, "red,green,blue"), has("color vertex")),
        "vertex s, t": (lambda folder: ply(folder, "float s,float t"), has("uv corner")),
        "face vertex_indices": (ply, counts(3)),
        "face texcoord": (
            lambda folder: edited(ply(folder, "", "list uchar float texcoord"), " 2 2 1 1", " 2 6 0 0 1 0 1 1"),
            has("uv corner"),
        ),
        "face red, green, blue": (lambda folder: ply(folder, "", "red,green,blue"), has("color face")),
        "edge": (
            lambda folder: ply(folder, more="element edge 1\nproperty int vertex1\nproperty int vertex2", rows="0 1"),
            counts(3, 1, 1),
        ),
        "tristrips": (
            lambda folder: edited(
                ply(folder), "element face 1\nproperty list uchar", "element tristrips 1\nproperty list int"
            ),
            counts(3),
        ),
        "other properties of vertex": (lambda folder: ply(folder, "quality"), has_field("quality vertex")),
        "other properties of face": (lambda folder: ply(folder, "", "flags"), has_field("flags face")),
        "other lists": (lambda folder: edited(ply(folder, "", "list uchar float w"), "2 2 1 1", "2 1 0.5"), "face w"),
        "properties of edge": (
            lambda folder: ply(
                folder,
                more="element edge 1\nproperty int vertex1\nproperty int vertex2\nproperty int crease",
                rows="0 1 5",
            ),
            "edge crease",
        ),
        "other elements": (
            lambda folder: ply(folder, more="element material 1\nproperty float ambient", rows="1"),
            "material ambient",
        ),
        "obj_info": (lambda folder: ply(folder, head="obj_info by hand"), "obj_info"),
        "comments": (lambda folder: ply(folder, head="comment by hand"), counts(3)),
    },
    "stl": {
        "facets": (stl, counts(3)),
        "names of solids": (lambda folder: stl(folder, "cup"), "solid cup"),
        "attribute bytes": (lambda folder: stl(folder, attribute=7), "attribute bytes"),
        "normals of facets": (stl, counts(3)),
    },
    "off": {
        "vertices": (off, counts(3)),
        "faces": (off, counts(3)),
        "colours of faces": (lambda folder: off(folder, color="0.5 0 0"), has("color face")),
        "COFF, NOFF, STOFF, 4OFF": (lambda folder: off(folder, "NOFF"), "does not begin with OFF"),
        "comments": (lambda folder: off(folder, "OFF # by hand"), counts(3)),
    },
    "vtu": {
        "Points": (vtu, counts(3)),
        "Cells": (vtu, counts(3)),
        "TimeValue": (lambda folder: vtu(folder, field_data=array("TimeValue", "Float64", "2")), counts(3)),
        "vectors chosen as the displacement": (lambda folder: vtu(folder, VECTORS), has_field("shift vertex")),
        "PointData": (lambda folder: vtu(folder, array("heat", "Float64", "1 2 3")), has_field("heat vertex")),
        "CellData": (lambda folder: vtu(folder, "", array("load", "Float64", "1")), has_field("load face")),
        "FieldData": (lambda folder: vtu(folder, "", "", array("run", "Float64", "1")), "field data 'run'"),
    },
    "xdmf": {
        "Geometry": (xdmf, counts(3)),
        "Topology": (xdmf, counts(3)),
        "Time": (lambda folder: xdmf(folder, '<Time Value="2"/>'), lambda clip: clip.times[0] == 2),
        "spatial collections": (
            lambda folder: edited(
                edited(xdmf(folder), "<Domain>", '<Domain><Grid GridType="Collection" CollectionType="Spatial">'),
                "</Domain>",
                "</Grid></Domain>",
            ),
            counts(3),
        ),
        "Attribute of nodes, cells and grids": (
            lambda folder: xdmf(folder, f'<Attribute Name="heat">{ITEM}</Attribute>'),
            has_field("heat vertex"),
        ),
        "Attribute of faces and edges": (
            lambda folder: xdmf(folder, f'<Attribute Name="heat" Center="Edge">{ITEM}</Attribute>'),
            "edge data 'heat'",
        ),
        "Set": (lambda folder: xdmf(folder, f'<Set Name="rim" SetType="Node">{ITEM}</Set>'), "sets 'rim'"),
        "Information": (lambda folder: xdmf(folder, '<Information Name="who" Value="me"/>'), "information 'who'"),
        "Polyhedron": (lambda folder: xdmf(folder, kind="Polyhedron"), "type polyhedron is not read"),
    },
    "exodus": {
        "coord": (exodus, counts(4)),
        "connect": (exodus, counts(4)),
        "node_num_map": (numbered, has("node vertex")),
        "time_whole": (
            lambda folder: exodus(
                folder, nodal={"disp_x": np.arange(3.0), "disp_y": np.zeros(3), "disp_z": np.zeros(3)}
            ),
            lambda clip: clip.times.tolist() == [0, 0.1, 0.2],
        ),
        "displacements": (
            lambda folder: exodus(
                folder, nodal={"disp_x": np.arange(3.0), "disp_y": np.zeros(3), "disp_z": np.zeros(3)}
            ),
            lambda clip: clip.read_frames(2, 3)[0, 0, 0] == 2,
        ),
        "eb_names": (lambda folder: exodus(folder, listed={"eb_names": ["shell"]}), has("group face")),
        "nodal variables": (lambda folder: exodus(folder, nodal={"heat": np.zeros(3)}), has_field("heat vertex")),
        "element variables": (
            lambda folder: exodus(folder, elements={"load": {1: np.zeros((3, 1))}}),
            has_field("load face"),
        ),
        "variables of sets, edges and the whole": (
            lambda folder: exodus(folder, listed={"name_glo_var": ["energy"]}),
            "global variables 'energy'",
        ),
        "node sets": (lambda folder: exodus(folder, listed={"ns_names": ["rim"]}), "node sets 'rim'"),
        "side sets": (lambda folder: exodus(folder, listed={"ss_names": ["lid"]}), "side sets 'lid'"),
        "info_records": (lambda folder: exodus(folder, "info_records"), "records 'info_records'"),
        "qa_records": (lambda folder: exodus(folder, "qa_records"), "records 'qa_records'"),
        "element attributes": (lambda folder: exodus(folder, "attrib1"), "element attributes '1'"),
        "other arrays": (lambda folder: exodus(folder, "assembly1"), "other arrays 'assembly1'"),
    },
    **{
        name: {
            **{
                thing: (lambda folder, kind=kind: written(folder, kind), lambda clip: clip.fps == 24)  # type: ignore[misc]
                for thing in ("points", "times", "fps", "faces", "objects", "metadata")
            },
            "other arrays": (lambda folder, kind=kind: arrays(folder, kind, heat=np.zeros(3)), "heat"),  # type: ignore[misc]
        }
        for name, kind in (("npz", "npz"), ("hdf5", "h5"))
    },
    "mdd": {thing: (lambda folder: written(folder, "mdd"), counts(3, 0)) for thing in ("times", "positions")},
    "pc2": {thing: (lambda folder: written(folder, "pc2"), counts(3, 0)) for thing in ("start and step", "positions")},
}
for _statement in (*SPECIFICATIONS["obj"].dropped, *SPECIFICATIONS["obj"].refused):
    SAMPLES["obj"].setdefault(
        _statement,
        (lambda folder, one=_statement: obj(folder, f"{one} 0 1 1 2"), f"{_statement}"),  # type: ignore[misc]
    )

LISTED: dict[str, tuple[str, dict[str, str]]] = {
    "alembic": (
        "alembic3d",
        {
            "parameters of text that change": "texts (it changes with time)",
            "parameters of 64-bit integers and boxes": "serial",
            "options of subdivision": "properties of subdivision",
            "objects of other schemas": "objects without a schema",
        },
    ),
    "usd": (
        "pxr",
        {
            "textures": "2 textures",
            "lights": "DomeLight",
            "primvars of text that change": "label (it changes with time)",
            "other attributes": "attributes (",
            "prims of purpose proxy and guide": "purpose proxy",
        },
    ),
    "gltf": (
        "numpy",
        {
            "textures": "1 texture",
            "meshes that the scene does not show": "which the scene does not show",
            "extensions that are not read": "KHR_lights_punctual",
        },
    ),
}
"""Formats whose readers list everything in a file, which other tests compare with the formats' own libraries:
for each the package, and its words for things that notices call something else.
"""


def with_all(name: str, folder: Path) -> Path:
    """Write a file of a format that holds everything its reader drops."""
    if name == "alembic":
        from tests.formats.test_alembic_inventory import everything

        return everything(folder / "x.abc")
    if name == "usd":
        from tests.formats.test_usd_inventory import SHOP

        (folder / "x.usda").write_text(SHOP)
        return folder / "x.usda"
    made = with_entries(
        textures=[{}],
        materials=[{"name": "a", "alphaMode": "MASK"}],
        cameras=[{}],
        nodes=[{"name": "n", "extras": {"hp": 3}}],
        scenes=[{"nodes": [0]}, {"name": "other", "nodes": [1]}],
        meshes=[{"name": "spare", "primitives": []}],
        extensions={"KHR_lights_punctual": {"lights": [{"type": "spot"}]}},
        asset={"version": "2.0", "copyright": "me"},
    )
    return made.save(folder / "x.glb")


@pytest.mark.parametrize("name", LISTED)
def test_dropped_parts_of_scenes_are_named(name: str, tmp_path: Path) -> None:
    package, words = LISTED[name]
    pytest.importorskip(package)
    with open_sequence(with_all(name, tmp_path), skip_unsupported=True) as clip:
        notices = "; ".join(clip.notices)
    specification = SPECIFICATIONS[name]
    missing = [one for one in (*specification.dropped, *specification.carried) if words.get(one, one) not in notices]
    assert missing == [], notices


ALIKE = {"vtp": "vtu", "vtk": "vtu", "pvtu": "vtu", "pvd": "vtu", "series": "vtu"}
"""Formats that share a reader."""

CASES = [
    (name, fate, thing)
    for name, specification in SPECIFICATIONS.items()
    for fate in ("coded", "dropped", "refused", "implied")
    for thing in getattr(specification, fate)
    if name not in (*LISTED, *ALIKE)
]


def test_every_format_that_is_read_declares_what_it_can_hold() -> None:
    names = {entry.name for entry in list_formats() if entry.reads and entry.name != "pdeanim"}
    assert names == set(SPECIFICATIONS)
    assert {name: set(SAMPLES[name]) for name in SAMPLES} == {
        name: {thing for other, _, thing in CASES if other == name} for name in SAMPLES
    }
    assert set(SAMPLES) | set(LISTED) | set(ALIKE) == names


@pytest.mark.parametrize(("name", "fate", "thing"), CASES)
def test_each_declaration_of_a_format_holds(name: str, fate: str, thing: str, tmp_path: Path) -> None:
    make, expected = SAMPLES[name][thing]
    path = make(tmp_path)
    if fate == "refused":
        with pytest.raises(InputError, match=expected):
            open_sequence(path, fps=24)
        return
    with open_sequence(path, fps=24) as clip:
        notices = "; ".join(clip.notices)
        if callable(expected):
            assert expected(clip)
            assert not any(word in notices for word in ("not kept", "left out"))
        else:
            assert expected in notices
