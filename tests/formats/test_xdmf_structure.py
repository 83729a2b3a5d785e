"""XDMF is read by its structure: grids, parts, times, includes, references and items, as the format defines them."""

from __future__ import annotations

import bz2
import zlib
from pathlib import Path

import h5py
import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence
from pdecodec.formats.base.companions import input_files

SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], np.float64)

QUAD = (
    '<Topology TopologyType="Quadrilateral" NumberOfElements="1">'
    '<DataItem Format="XML" Dimensions="1 4" NumberType="Int">0 1 2 3</DataItem></Topology>'
)

XI = 'xmlns:xi="http://www.w3.org/2001/XInclude"'

TO_MESH = "/Xdmf/Domain/Grid[@Name='{}']/*[self::Topology or self::Geometry]"


def lifted(z: float, x: float = 0.0) -> np.ndarray:
    """Return the square raised to a height, and moved along x."""
    return SQUARE + np.array([x, 0.0, z])


def text_of(points: np.ndarray) -> str:
    return " ".join(map(repr, points.reshape(-1).tolist()))


def geometry(z: float = 0.0, x: float = 0.0) -> str:
    return (
        '<Geometry GeometryType="XYZ"><DataItem Format="XML" Dimensions="4 3">'
        f"{text_of(lifted(z, x))}</DataItem></Geometry>"
    )


def grid(content: str, name: str = "mesh", time: float | None = None) -> str:
    at = "" if time is None else f'<Time Value="{time}"/>'
    return f'<Grid Name="{name}" GridType="Uniform">{at}{content}</Grid>'


def collection(content: str, kind: str = "Temporal", name: str = "c") -> str:
    return f'<Grid Name="{name}" GridType="Collection" CollectionType="{kind}">{content}</Grid>'


def vectors(name: str, values: np.ndarray) -> str:
    shape = " ".join(map(str, values.shape))
    return (
        f'<Attribute Name="{name}" AttributeType="Vector" Center="Node"><DataItem Format="XML" Dimensions="{shape}">'
        f"{text_of(values)}</DataItem></Attribute>"
    )


def write(path: Path, domain: str) -> Path:
    path.write_text(f'<?xml version="1.0"?><Xdmf Version="3.0" {XI}><Domain>{domain}</Domain></Xdmf>')
    return path


def heights(path: Path, displacement: str | None = None) -> tuple[list[float], list[list[float]]]:
    """Return the times, and z of every vertex at each."""
    with open_sequence(path, displacement=displacement) as read:
        return read.times.tolist(), read.read_frames(0, read.frame_count)[:, :, 2].tolist()


def flat(*levels: float) -> list[list[float]]:
    return [[level] * 4 for level in levels]


THREE = [(0.0, 0.0), (0.5, 0.5), (1.0, 1.0)]
"""Pairs of a time and a height."""


def test_parts_of_a_spatial_collection_are_objects_at_the_time_of_the_collection(tmp_path: Path) -> None:
    steps = ""
    for time, z in THREE:
        parts = grid(QUAD + geometry(z), "left") + grid(QUAD + geometry(2 * z, x=2), "right")
        steps += collection(f'<Time Value="{time}"/>{parts}', "Spatial")
    with open_sequence(write(tmp_path / "x.xdmf", collection(steps))) as read:
        assert [(item.name, item.vertex_count) for item in read.objects] == [("left", 4), ("right", 4)]
        assert read.times.tolist() == [0, 0.5, 1]
        found = read.read_frames(0, 3)
        assert found[:, :4, 2].tolist() == flat(0, 0.5, 1)
        assert found[:, 4:, 2].tolist() == flat(0, 1, 2)
        assert found[0, 4:, 0].tolist() == [2, 3, 3, 2]


def test_a_spatial_collection_of_one_part_moves(tmp_path: Path) -> None:
    steps = "".join(collection(grid(QUAD + geometry(z), time=time), "Spatial") for time, z in THREE)
    assert heights(write(tmp_path / "x.xdmf", collection(steps))) == ([0, 0.5, 1], flat(0, 0.5, 1))


@pytest.mark.parametrize(
    "pointer",
    [
        "xpointer(/Xdmf/Domain/Grid[@Name='mesh_{0}']/*[self::Topology or self::Geometry])",
        'xpointer(//Grid[@Name="mesh_{0}"]/*[self::Topology or self::Geometry])',
        "xpointer(/Xdmf/Domain/Grid[@GridType='Uniform'][{1}]/*[self::Topology or self::Geometry])",
        "xpointer(//Domain/Grid[position()={1} and @Name]/*)",
        "element(/1/1/{1}/1)",
    ],
)
def test_each_step_has_the_mesh_that_it_includes(tmp_path: Path, pointer: str) -> None:
    meshes = "".join(grid(QUAD + geometry(z), f"mesh_{number}") for number, (_, z) in enumerate(THREE))
    steps = ""
    for number, (time, _) in enumerate(THREE):
        one = pointer.format(number, number + 1)
        included = [one] if "element" not in one else [one, one[:-2] + "2)"]
        inside = "".join(f"<xi:include xpointer={repr(text) if chr(39) not in text else chr(34) + text + chr(34)}/>"
                         for text in included)  # fmt: skip
        steps += grid(inside, "f", time)
    assert heights(write(tmp_path / "x.xdmf", meshes + collection(steps))) == ([0, 0.5, 1], flat(0, 0.5, 1))


def test_a_step_includes_what_another_step_includes(tmp_path: Path) -> None:
    mesh = grid(QUAD + geometry(2), "mesh")
    first = grid(f'<xi:include xpointer="xpointer({TO_MESH.format("mesh")})"/>', "a", 0)
    # The children of the first step are its time and its include.
    second = grid("<xi:include xpointer=\"xpointer(//Grid[@Name='c']/Grid[1]/*[2])\"/>", "b", 1)
    assert heights(write(tmp_path / "x.xdmf", mesh + collection(first + second)))[1] == flat(2, 2)


def test_an_included_file_names_its_data_from_its_own_folder(tmp_path: Path) -> None:
    (tmp_path / "below").mkdir()
    for number, (_, z) in enumerate(THREE):
        with h5py.File(tmp_path / "below" / f"m{number}.h5", "w") as file:
            file["p"] = lifted(z)
        item = f'<DataItem Format="HDF" Dimensions="4 3">m{number}.h5:/p</DataItem>'
        write(tmp_path / "below" / f"m{number}.xdmf", grid(f"{QUAD}<Geometry>{item}</Geometry>"))
    steps = "".join(
        grid(f'<xi:include href="below/m{number}.xdmf" xpointer="xpointer(//Grid/*)"/>', "s", time)
        for number, (time, _) in enumerate(THREE)
    )
    path = write(tmp_path / "x.xdmf", collection(steps))
    assert heights(path) == ([0, 0.5, 1], flat(0, 0.5, 1))
    assert len(input_files(str(path))) == 4
    (tmp_path / "below" / "m1.xdmf").unlink()
    with pytest.raises(InputError, match=r"names 'below/m1.xdmf', which is missing"):
        open_sequence(path)


@pytest.mark.parametrize(
    "reference",
    [
        '<{0} Reference="XML">/Xdmf/Domain/Grid[@Name="mesh"]/{0}</{0}>',
        "<{0} Reference=\"/Xdmf/Domain/Grid[@Name='mesh']/{0}\"/>",
        '<{0} Reference="XML"> //Grid/{0}[@Name="{0}"] </{0}>',
    ],
)
def test_references_are_followed(tmp_path: Path, reference: str) -> None:
    mesh = grid((QUAD + geometry(3)).replace("<Geometry ", '<Geometry Name="Geometry" ').replace(
        "<Topology ", '<Topology Name="Topology" '))  # fmt: skip
    other = grid(QUAD + geometry(5), "other")
    steps = "".join(grid(reference.format("Topology") + reference.format("Geometry"), "s", time) for time in (0, 1))
    assert heights(write(tmp_path / "x.xdmf", other + mesh + collection(steps))) == ([0, 1], flat(3, 3))


def test_a_data_item_refers_to_another_one(tmp_path: Path) -> None:
    item = f'<DataItem Name="p" Format="XML" Dimensions="4 3">{text_of(lifted(7))}</DataItem>'
    refers = (
        '<Geometry GeometryType="XYZ"><DataItem Reference="XML">/Xdmf/Domain/DataItem[@Name="p"]</DataItem></Geometry>'
    )
    assert heights(write(tmp_path / "x.xdmf", item + grid(QUAD + refers)))[1] == flat(7)


@pytest.mark.parametrize(
    ("times", "expected"),
    [
        ('TimeType="List"><DataItem Format="XML" Dimensions="3">1 2 4</DataItem>', [1, 2, 4]),
        ('TimeType="HyperSlab"><DataItem Format="XML" Dimensions="3">1 0.5 3</DataItem>', [1, 1.5, 2]),
        ('Type="List">1 2 4', [1, 2, 4]),
        ('TimeType="List"><DataItem Format="HDF" Dimensions="3">t.h5:/t</DataItem>', [0.25, 0.5, 1]),
    ],
)
def test_lists_of_times_of_a_collection_hold(tmp_path: Path, times: str, expected: list[float]) -> None:
    with h5py.File(tmp_path / "t.h5", "w") as file:
        file["t"] = [0.25, 0.5, 1]
    steps = "".join(grid(QUAD + geometry(z)) for _, z in THREE)
    path = write(tmp_path / "x.xdmf", collection(f"<Time {times}</Time>{steps}"))
    assert heights(path) == (expected, flat(0, 0.5, 1))


def test_a_range_is_the_time_of_a_grid_where_it_begins(tmp_path: Path) -> None:
    ranges = (
        grid(
            f'<Time TimeType="Range"><DataItem Format="XML" Dimensions="2">{time} {time + 0.4}</DataItem></Time>'
            + QUAD
            + geometry(z)
        )
        for time, z in THREE
    )
    assert heights(write(tmp_path / "x.xdmf", collection("".join(ranges))))[0] == [0, 0.5, 1]


def binary(path: Path, order: str, pack: object = None) -> str:
    raw = lifted(6).astype(f"{order}f8").tobytes()
    path.write_bytes(b"head----" + raw if pack is None else pack(raw))  # type: ignore[operator]
    return path.name


def test_binary_items_are_read_from_where_they_begin(tmp_path: Path) -> None:
    items = []
    for name, order, endian in (("a", ">", "Big"), ("b", "<", "Little")):
        file = binary(tmp_path / name, order)
        items.append(f'Format="Binary" Precision="8" Endian="{endian}" Seek="8" Dimensions="4 3">{file}')
    for name, packing, pack in (("c", "Zlib", zlib.compress), ("d", "BZip2", bz2.compress)):
        file = binary(tmp_path / name, "<", pack)
        items.append(f'Format="Binary" Precision="8" Endian="Little" Compression="{packing}" Dimensions="4 3">{file}')
    steps = "".join(
        grid(f"{QUAD}<Geometry><DataItem {item}</DataItem></Geometry>", time=k) for k, item in enumerate(items)
    )
    path = write(tmp_path / "x.xdmf", collection(steps))
    assert heights(path)[1] == flat(6, 6, 6, 6)
    assert len(input_files(str(path))) == 5
    (tmp_path / "b").write_bytes(b"head")
    with pytest.raises(InputError, match="'b' ends before the 12 numbers"), open_sequence(path) as read:
        read.read_frames(1, 2)


def test_parts_of_arrays_joined_columns_and_single_axes_are_read(tmp_path: Path) -> None:
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file["all"] = np.stack([lifted(z) for z in (1, 2, 3, 4)])
        file["x"], file["y"], file["z"] = SQUARE[:, 0], SQUARE[:, 1], np.full(4, 8.0)

    def column(axis: str) -> str:
        return f'<DataItem Format="HDF" Dimensions="4">d.h5:/{axis}</DataItem>'

    whole = '<DataItem Format="HDF" Dimensions="4 4 3">d.h5:/all</DataItem>'
    slab = '<DataItem Format="XML" Dimensions="3 3">2 0 0 1 1 1 1 4 3</DataItem>'
    columns = "".join(map(column, "xyz"))
    geometries = [
        f'<Geometry><DataItem ItemType="HyperSlab" Dimensions="4 3">{slab}{whole}</DataItem></Geometry>',
        '<Geometry><DataItem Format="HDF" Dimensions="4 3">d.h5:/all|1 0 0|1 1 1|1 4 3|4 4 3</DataItem></Geometry>',
        '<Geometry><DataItem ItemType="Function" Function="JOIN($0, $1, $2)" Dimensions="4 3">'
        f"{columns}</DataItem></Geometry>",
        f'<Geometry GeometryType="X_Y_Z">{columns}</Geometry>',
    ]
    steps = "".join(grid(QUAD + one, time=number) for number, one in enumerate(geometries))
    assert heights(write(tmp_path / "x.xdmf", collection(steps)))[1] == flat(3, 2, 8, 8)


@pytest.mark.parametrize(
    "cells",
    [
        'TopologyType="Quadrilateral" BaseOffset="1" NumberOfElements="1"><DataItem Dimensions="1 4">1 2 3 4',
        'TopologyType="Mixed" BaseOffset="1" NumberOfElements="1"><DataItem Dimensions="5">5 1 2 3 4',
        'TopologyType="Polygon" NodesPerElement="4" BaseOffset="1"><DataItem Dimensions="4">1 2 3 4',
        'Type="Quadrilateral" BaseOffset="10"><DataItem Dimensions="4">10 11 12 13',
        'TopologyType="Polygon"><DataItem Dimensions="1 4">0 1 2 3',
    ],
)
def test_nodes_are_counted_from_the_base_offset(tmp_path: Path, cells: str) -> None:
    path = write(tmp_path / "x.xdmf", grid(f"<Topology {cells}</DataItem></Topology>{geometry()}"))
    with open_sequence(path) as read:
        assert read.connectivity.face_indices.tolist() == [0, 1, 2, 3]


DOFS = (
    '<Attribute AttributeType="Vector" Center="Other" ElementCell="triangle" ElementDegree="1" ElementFamily="DG" '
    'ItemType="FiniteElementFunction" Name="{0}"><DataItem Dimensions="1 4" Format="XML" Name="dofs">0 1 2 3</DataItem>'
    '<DataItem Dimensions="4 1" Format="XML">1.0 1.0 1.0 1.0</DataItem></Attribute>'
)


@pytest.mark.parametrize("name", ["u", "w", "displacement"])
def test_degrees_of_freedom_are_no_displacements(tmp_path: Path, name: str) -> None:
    steps = "".join(grid(DOFS.format(name) + QUAD + geometry(), time=time) for time in (0, 1))
    path = write(tmp_path / "x.xdmf", collection(steps))
    assert heights(path) == ([0, 1], flat(0, 0))
    with open_sequence(path) as read:
        assert read.notices == (f"degrees of freedom (FiniteElementFunction) {name!r} are not kept",)
    with pytest.raises(InputError, match=f"has no vectors {name!r} on its nodes"):
        open_sequence(path, displacement=name)


def attribute(name: str, center: str, text: str, item: str = "") -> str:
    """Return an attribute whose number of values is that of its text."""
    at = f' Center="{center}"' if center else ""
    return (
        f'<Attribute Name="{name}"{at}><DataItem Dimensions="{len(text.split())}" {item}>{text}</DataItem></Attribute>'
    )


def test_attributes_are_fields_by_their_center_or_noted_once_by_name(tmp_path: Path) -> None:
    whole = 'NumberType="Int" Precision="8"'
    told = attribute("p", "", "1 2 3 4") + attribute("ids", "Node", f"1 2 3 {2**60 + 1}", whole)
    told += attribute("p", "cell", "9 8") + attribute("mass", "Grid", "5")
    lost = attribute("flux", "Face", "1") + attribute("len", "Edge", "1") + attribute("odd", "Node", "1 2 3")
    first = grid(told + lost + attribute("some", "Node", "1 2 3 4", whole) + QUAD + geometry(), time=0)
    second = grid(told + vectors("late", SQUARE) + QUAD + geometry() + '<Set Name="left"/>', time=1)
    with open_sequence(
        write(tmp_path / "x.xdmf", collection(attribute("energy", "Grid", "0") + first + second))
    ) as read:
        assert [(one.name, one.domain, str(one.dtype), one.components) for one in read.fields] == [
            ("p", "vertex", "float32", 1),
            ("ids", "vertex", "int64", 1),
            ("late", "vertex", "float32", 3),
            ("p (faces)", "face", "float32", 2),
            ("mass", "object", "float32", 1),
        ]
        assert read.read_field("p", 0, 2).tolist() == [[1, 2, 3, 4]] * 2
        assert read.read_field("ids", 1, 2).tolist() == [[1, 2, 3, 2**60 + 1]]
        assert np.isnan(read.read_field("late", 0, 1)).all()
        assert np.array_equal(read.read_field("late", 1, 2)[0], SQUARE)
        assert read.read_field("p (faces)", 0, 1).tolist() == [[[9, 8]]]
        assert read.read_field("mass", 0, 2).tolist() == [[5], [5]]
        assert read.notices[-1] == (
            "data of collections 'energy', face data 'flux', edge data 'len', point data 'odd', 'some' and sets 'left' "
            "are not kept"
        )


@pytest.mark.parametrize("kind", ["<f4", "<f8", "<i1", "<i2", "<i4", "<i8", "<u1", "<u2", "<u4", "<u8"])
@pytest.mark.parametrize("form", ["XML", "HDF", "Binary"])
def test_values_of_every_type_are_read_from_every_kind_of_item(tmp_path: Path, form: str, kind: str) -> None:
    values = np.array([[1, 2], [3, 4], [5, 6], [7, 120]], kind)
    number = {"f": "Float", "i": "Int", "u": "UInt"}[values.dtype.kind]
    text = {"XML": " ".join(map(str, values.flat)), "HDF": "d.h5:/v", "Binary": "d.bin"}[form]
    (tmp_path / "d.bin").write_bytes(values.tobytes())
    with h5py.File(tmp_path / "d.h5", "w") as file:
        file["v"] = values
    item = f'NumberType="{number}" Precision="{values.itemsize}" Format="{form}" Dimensions="4 2"'
    held = f'<Attribute Name="v" AttributeType="Matrix"><DataItem {item}>{text}</DataItem></Attribute>'
    with open_sequence(write(tmp_path / "x.xdmf", grid(held + QUAD + geometry()))) as read:
        assert [(one.name, one.dtype, one.components) for one in read.fields] == [("v", values.dtype, 2)]
        assert read.read_field("v", 0, 1).tolist() == [values.tolist()]


def test_parts_have_their_own_attributes_on_the_surface_of_their_cells(tmp_path: Path) -> None:
    tetrahedra = (
        '<Topology TopologyType="Tetrahedron"><DataItem Dimensions="1 4" NumberType="Int">0 1 2 3</DataItem></Topology>'
    )
    solid = tetrahedra + geometry().replace(text_of(SQUARE), "0 0 0 1 0 0 0 1 0 0 0 1")
    solid += attribute("load", "Cell", "7") + attribute("both", "Node", "1 2 3 4")
    parts = grid(solid, "rock") + grid(QUAD + geometry() + attribute("both", "Node", "5 6 7 8"), "plate")
    with open_sequence(write(tmp_path / "x.xdmf", collection(parts, "Spatial"))) as read:
        load, both = read.field_named("load"), read.field_named("both")
        assert (load.objects, both.objects) == ((0,), None)
        assert read.read_field("load", 0, 1).tolist() == [[7] * 4]
        assert read.read_field("both", 0, 1).tolist() == [[1, 2, 3, 4, 5, 6, 7, 8]]


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        (attribute("v", "Node", "1 2 3 4.5", 'NumberType="Int"'), "has values that are no int32"),
        (attribute("v", "Node", "1 2 3 x", 'NumberType="Int"'), "this frame cannot be read"),
        (attribute("v", "Node", "1 2 3", 'NumberType="Int"').replace('"3"', '"4"'), "its data are 3 numbers"),
    ],
)
def test_damaged_values_of_an_attribute_name_the_frame(tmp_path: Path, bad: str, message: str) -> None:
    good = attribute("v", "Node", "1 2 3 4", 'NumberType="Int"')
    steps = "".join(grid(one + QUAD + geometry(), time=time) for time, one in enumerate((good, bad)))
    with open_sequence(write(tmp_path / "x.xdmf", collection(steps))) as read:
        assert read.read_field("v", 0, 1).tolist() == [[1, 2, 3, 4]]
        assert read.read_frames(0, 2).shape == (2, 4, 3)
        with pytest.raises(InputError, match=message) as caught:
            read.read_field("v", 1, 2)
        assert caught.value.frame == 1


def test_collections_of_the_same_meshes_and_times_are_read_together(tmp_path: Path) -> None:
    pressure = collection(
        "".join(grid(QUAD + geometry() + attribute("p", "Node", f"{t} 1 2 3"), time=t) for t in (0, 1))
    )
    moves = collection(
        "".join(grid(QUAD + geometry() + vectors("u", SQUARE * 0 + t), time=t) for t in (0, 1)), name="u"
    )
    path = write(tmp_path / "x.xdmf", pressure + moves + grid(QUAD + geometry(), "wall"))
    with open_sequence(path, displacement="u") as read:
        assert read.read_frames(0, 2)[:, :, 2].tolist() == flat(0, 1)
        assert read.read_field("p", 0, 2)[:, 0].tolist() == [0, 1]
        assert read.notices == (
            "grids outside the temporal collection are not read: 'wall'",
            "the vectors 'u' are added to the geometry: they move the mesh",
        )
    with open_sequence(path) as read:
        assert [field.name for field in read.fields] == ["p", "u"]


@pytest.mark.parametrize("other", [grid(QUAD + geometry(1), time=0), grid(QUAD + geometry(), time=3)])
def test_among_several_collections_the_one_with_the_displacement_is_read(tmp_path: Path, other: str) -> None:
    moves = collection(grid(QUAD + geometry() + vectors("u", SQUARE * 0 + 1), time=0), name="u")
    path = write(tmp_path / "x.xdmf", collection(other, name="p") + moves)
    with open_sequence(path, displacement="u") as read:
        assert read.read_frames(0, 1)[:, :, 2].tolist() == flat(1)
        assert "of 2 temporal collections 'u' is read, not 'p'" in read.notices
    with open_sequence(path) as read:
        assert "of 2 temporal collections 'p' is read, not 'u'" in read.notices
        assert "point data 'u' are not kept" in read.notices


STEP = grid(QUAD + geometry(), time=0)

REFUSED = {
    "no geometry": (collection(STEP + grid(QUAD, "bare", 1)), "grid 'bare' has no geometry, and neither includes"),
    "no topology": (collection(STEP + grid(geometry(), "bare", 1)), "grid 'bare' has no topology"),
    "no such element": (
        collection(grid('<xi:include xpointer="xpointer(//Grid[@Name=\'x\']/*)"/>')),
        "which does not exist",
    ),
    "includes itself": (
        collection(grid('<xi:include xpointer="xpointer(//Domain/Grid)"/>')),
        "includes itself",
    ),
    "an XPath of another kind": (
        collection(grid('<xi:include xpointer="xpointer(//Grid[count(*)=2]/*)"/>')),
        r"the XPath '//Grid\[count\(\*\)=2\]/\*' is not understood \(predicate 'count\(\*\)=2'\)",
    ),
    "a pointer of another kind": (collection(grid('<xi:include xpointer="part7"/>')), "the pointer 'part7'"),
    "a reference to nothing": (
        grid('<Topology Reference="XML">/Xdmf/Domain/Topology</Topology>' + geometry()),
        "a Topology refers to '/Xdmf/Domain/Topology', which is 0 elements",
    ),
    "a collection in a collection": (collection(collection(STEP + STEP)), "holds another one, which is not read"),
    "a subset": ('<Grid GridType="SubSet" Section="All"/>', "is of type subset, which is not read"),
    "too few times": (
        collection(f'<Time TimeType="List"><DataItem Dimensions="1">1</DataItem></Time>{STEP[:0]}'
                   + grid(QUAD + geometry()) * 2),
        "has 1 times and 2 grids",
    ),
    "more times than grids can be": (
        collection('<Time TimeType="HyperSlab"><DataItem Dimensions="3">0 1 1e18</DataItem></Time>'
                   + grid(QUAD + geometry()) * 2),
        "are no start, stride and count",
    ),
    "a time beyond numbers": (collection(grid(QUAD + geometry(), time=float("inf"))), "a time is not a finite number"),
    "a range of all steps": (
        collection('<Time TimeType="Range"><DataItem Dimensions="2">0 4</DataItem></Time>'
                   + grid(QUAD + geometry()) * 3),
        "is a range, which does not say when each of its grids is",
    ),
    "a step without time": (
        collection(STEP + grid(QUAD + geometry())),
        "grid 1 of the temporal collection 'c' has no time",
    ),
    "steps side by side": (STEP + grid(QUAD + geometry(1), time=1), r"different times \(0, 1\)"),
    "another number of parts": (
        collection(collection(STEP + STEP, "Spatial") + grid(QUAD + geometry(), time=1)),
        "has 1 parts, the first one 2",
    ),
    "an order of nodes": (
        grid(QUAD.replace("NumberOfElements", 'Order="3 2 1 0" NumberOfElements') + geometry()),
        "an Order of its own",
    ),
    "structured": (grid('<Topology TopologyType="3DCoRectMesh" Dimensions="2 2 2"/>' + geometry()), "3dcorectmesh"),
    "origin and step": (grid(QUAD + geometry().replace('"XYZ"', '"ORIGIN_DXDYDZ"')), "type ORIGIN_DXDYDZ"),
    "another function": (
        grid(QUAD + f'<Geometry><DataItem ItemType="Function" Function="$0 + 1" Dimensions="4 3">'
             f'<DataItem Dimensions="4 3">{text_of(SQUARE)}</DataItem></DataItem></Geometry>'),
        r"the function '\$0 \+ 1' is not read",
    ),
    "more numbers than declared": (
        grid(QUAD + geometry().replace("4 3", "3 3")),
        "declares Dimensions '3 3', its data are 12 numbers",
    ),
    "more cells than declared": (
        grid(QUAD.replace('NumberOfElements="1"', 'NumberOfElements="2"') + geometry()),
        "declares 2 cells, and holds 1",
    ),
    "two geometries": (grid(QUAD + geometry() + geometry(1)), "has 2 elements Geometry"),
    "another root": ("</Domain><Domain>", "holds no grid"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_unsupported_elements_are_refused_by_name(tmp_path: Path, name: str) -> None:
    domain, message = REFUSED[name]
    with pytest.raises(InputError, match=message):
        open_sequence(write(tmp_path / "x.xdmf", domain))
