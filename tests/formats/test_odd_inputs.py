"""Inputs that tempt readers to guess, to lose data silently, to invent times, or to fill in values."""

from __future__ import annotations

import base64
import json
import struct
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence
from tests.support.scene_cases import needed

TRIANGLE = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]], np.float32)

RISING = np.stack([TRIANGLE, TRIANGLE + np.float32([0, 0, 1])])

PLY = """ply
format {format} 1.0
element vertex 3
property float x
property float y
property float z
{more}element face 1
property list uchar int vertex_index
end_header
"""

MESH = """def Mesh "m" {
int[] faceVertexCounts = [3]
int[] faceVertexIndices = [0, 1, 2]
point3f[] points.timeSamples = { 0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], 10: [(10, 0, 0), (1, 0, 0), (0, 1, 0)] }
%s
}
"""

VTU = """<VTKFile type="UnstructuredGrid"><UnstructuredGrid><FieldData>{field}</FieldData>
<Piece NumberOfPoints="3" NumberOfCells="1">
<Points><DataArray type="Float32" NumberOfComponents="3" format="ascii">0 0 0 1 0 0 0 1 0</DataArray></Points>
<Cells><DataArray type="Int64" Name="connectivity" format="ascii">0 1 2</DataArray>
<DataArray type="Int64" Name="offsets" format="ascii">3</DataArray>
<DataArray type="UInt8" Name="types" format="ascii">5</DataArray></Cells></Piece></UnstructuredGrid></VTKFile>"""

XDMF = """<Xdmf Version="3.0"><Domain><Information Name="author" Value="me"/><Grid Name="g">
<Topology TopologyType="Triangle" NumberOfElements="1">
<DataItem Format="XML" Dimensions="1 3">0 1 2</DataItem></Topology>
<Geometry GeometryType="XYZ"><DataItem Format="XML" Dimensions="3 3">0 0 0 1 0 0 0 1 0</DataItem></Geometry>
<Set Name="left" SetType="Cell"><DataItem Format="XML" Dimensions="1">0</DataItem></Set>
</Grid></Domain></Xdmf>"""


def usd(path: Path, body: str, metadata: str = 'defaultPrim = "m"') -> None:
    path.write_text(f"#usda 1.0\n(\nframesPerSecond = 24\ntimeCodesPerSecond = 24\n{metadata}\n)\n{body}")


def ply(path: Path, more: str = "", rest: str = "") -> None:
    rows = "".join(f"{x:g} {y:g} {z:g}{rest}\n" for x, y, z in TRIANGLE)
    path.write_text(PLY.format(format="ascii", more=more) + rows + "3 0 1 2\n")


def hdf5(path: Path, **more: Any) -> None:
    with h5py.File(path, "w") as file:
        file["points"], file["faces"] = RISING, [[0, 1, 2]]
        for name, values in more.items():
            file[name] = values
        file["points"].attrs["units"] = "mm"
        file.attrs["author"] = "me"
        file.create_group("solver").attrs["dt"] = 0.5


def gltf(path: Path, interpolation: str = "", outputs: Any = (), lacking: int = 0) -> None:
    """Write a triangle with an attribute, moved by an animation with two keys at 0 and 1 s."""
    arrays = [TRIANGLE, np.ones((3, 3)), np.array([[0.0], [1.0]]), np.array(outputs or [[0.0, 0, 0]])]
    parts = [np.asarray(one, np.float32).tobytes() for one in arrays]
    starts = np.cumsum([0, *map(len, parts)]).tolist()
    data = b"".join(parts)[: starts[-1] - lacking]
    bounds: list[dict[str, Any]] = [{"min": [0, 0, 0], "max": [1, 1, 0]}, {}, {"min": [0], "max": [1]}, {}]
    sampler = {"input": 2, "output": 3, "interpolation": interpolation}
    channel = {"sampler": 0, "target": {"node": 0, "path": "translation"}}
    root: dict[str, Any] = {
        "asset": {"version": "2.0"},
        "scenes": [{"nodes": [0]}],
        "nodes": [{"mesh": 0}],
        "meshes": [{"primitives": [{"attributes": {"POSITION": 0, "_DISPLACEMENT": 1}}]}],
        "buffers": [
            {"byteLength": len(data), "uri": "data:application/octet-stream;base64," + base64.b64encode(data).decode()}
        ],
        "bufferViews": [
            {"buffer": 0, "byteOffset": start, "byteLength": len(part)}
            for start, part in zip(starts, parts, strict=False)
        ],
        "accessors": [
            {"bufferView": k, "componentType": 5126, "count": len(one), "type": kind} | bounds[k]
            for k, (one, kind) in enumerate(zip(arrays, ("VEC3", "VEC3", "SCALAR", "VEC3"), strict=True))
        ],
    }
    if interpolation:
        root["animations"] = [{"channels": [channel], "samplers": [sampler]}]
    path.write_text(json.dumps(root))


def mdd(path: Path, times: list[float], lacking: int = 0) -> None:
    points = np.tile(TRIANGLE, (len(times), 1, 1)).astype(">f4").tobytes()
    data = struct.pack(">2i", len(times), 3) + np.array(times, ">f4").tobytes() + points
    path.write_bytes(data[: len(data) - lacking])


def opened(tmp_path: Path, name: str, make: Callable[[Path], object]) -> Any:
    needed(name.rpartition(".")[2])
    make(tmp_path / name)
    return open_sequence(tmp_path / name)


@pytest.mark.parametrize(
    ("name", "make", "told"),
    [
        ("x.h5", lambda path: hdf5(path, displacement=RISING), "datasets not kept: displacement"),
        ("x.npz", lambda path: np.savez(path, points=RISING, displacement=RISING), "arrays not kept: displacement"),
        ("x.gltf", gltf, "not kept: _DISPLACEMENT"),
        ("x.ply", lambda path: ply(path, "".join(f"property float d{a}\n" for a in "xyz"), " 5 5 5"), "dx, dy, dz"),
        ("x.usda", lambda path: usd(path, MESH % "vector3f[] displacement = [(5, 5, 5)]"), "attributes (displacement)"),
    ],
)
def test_a_name_alone_does_not_make_a_displacement_and_a_note_says_so(
    tmp_path: Path, name: str, make: Callable[[Path], object], told: str
) -> None:
    with opened(tmp_path, name, make) as read:
        assert np.array_equal(read.read_frames(0, 1)[0], TRIANGLE)
        fields = ", ".join(one.name for one in read.fields)
        assert told in "\n".join((*read.notices, fields))


@pytest.mark.parametrize(
    ("name", "make", "told"),
    [
        ("x.h5", hdf5, "attributes not kept: author, points.units, solver.dt"),
        ("x.npz", lambda path: np.savez(path, points=RISING, mask=[1]), "arrays not kept: mask"),
        ("x.xdmf", lambda path: path.write_text(XDMF), "sets 'left' and information 'author' are not kept"),
        (
            "x.vtu",
            lambda path: path.write_text(
                VTU.format(field='<DataArray type="Int8" Name="run" NumberOfTuples="1" format="ascii">3</DataArray>')
            ),
            "field data 'run' are not kept",
        ),
        ("x.obj", lambda path: path.write_text("v 0 0 0 2\nv 1 0 0 2\nv 0 1 0 2\nf 1 2 3\n"), "the weight of vertices"),
        (
            "x.usda",
            lambda path: usd(path, (MESH % "") + 'def Camera "eye" {}\ndef "empty" {}\n'),
            "not kept: Camera 'eye', prims without geometry 'empty'",
        ),
    ],
)
def test_data_that_are_not_kept_are_noted_by_name(
    tmp_path: Path, name: str, make: Callable[[Path], object], told: str
) -> None:
    with opened(tmp_path, name, make) as read:
        assert told in "\n".join(read.notices)


def below(path: Path, body: str, metadata: str = "") -> None:
    usd(path.with_name("below.usda"), MESH % "")
    usd(path, body, metadata)


def turned(path: Path) -> None:
    steps = (
        "double3 xformOp:translate:pivot.timeSamples = { 0: (1, 0, 0), 10: (2, 0, 0) }",
        "float xformOp:rotateZ = 90",
        'uniform token[] xformOpOrder = ["xformOp:translate:pivot", "xformOp:rotateZ", '
        '"!invert!xformOp:translate:pivot"]',
    )
    still = (MESH % "").replace(", 10: [(10, 0, 0), (1, 0, 0), (0, 1, 0)]", "")
    usd(path, 'def Xform "x" {\n' + "\n".join(steps) + "\n" + still + "}\n", "")


@pytest.mark.parametrize(
    ("name", "make", "times", "places"),
    [
        (
            "x.usda",
            lambda path: below(path, "", "subLayers = [@./below.usda@ (offset = 5; scale = 2)]"),
            [5, 25],
            [0, 10],
        ),
        (
            "x.usda",
            lambda path: below(path, 'def "r" (references = @./below.usda@ (offset = -5)) {}'),
            [-5, 5],
            [0, 10],
        ),
        ("x.usda", turned, [0, 10], [1, 2]),
        ("x.gltf", lambda path: gltf(path, "STEP", [[0, 0, 0], [4, 0, 0]]), [0, 12, 23, 24], [0, 0, 0, 4]),
        (
            "x.gltf",
            lambda path: gltf(path, "CUBICSPLINE", [[0, 0, 0]] * 4 + [[4, 0, 0], [0, 0, 0]]),
            [0, 6, 12, 24],
            [0, 0.625, 2, 4],
        ),
        ("x.mdd", lambda path: mdd(path, [0.5, 1.0, 1.25]), [12, 24, 30], [0, 0, 0]),
        (
            "x.vtu",
            lambda path: path.write_text(
                VTU.format(field='<DataArray type="Float64" Name="TimeValue" NumberOfTuples="1">2.5</DataArray>')
            ),
            [60],
            [0],
        ),
    ],
)
def test_times_and_what_lies_between_are_the_files_own(
    tmp_path: Path, name: str, make: Callable[[Path], object], times: list[float], places: list[float]
) -> None:
    with opened(tmp_path, name, make) as read:
        frames = np.searchsorted(read.times, np.array(times) / 24 - 1e-6)
        assert np.allclose(read.times[frames] * 24, times, atol=1e-5)
        points = read.read_frames(0, read.frame_count)
        assert np.allclose(points[frames, 0, 0], places, atol=1e-5)


def binary_ply(path: Path) -> None:
    head = PLY.format(format="binary_little_endian", more="").encode()
    path.write_bytes(head + TRIANGLE.astype("<f4").tobytes() + struct.pack("<B2i", 3, 0, 1))


@pytest.mark.parametrize(
    ("name", "make", "message"),
    [
        ("x.mdd", lambda path: mdd(path, [0.0, 1.0], lacking=4), "is truncated"),
        ("x.ply", binary_ply, "or is damaged"),
        ("x.gltf", lambda path: gltf(path, "LINEAR", [[0, 0, 0]] * 2, lacking=8), r"x\.gltf"),
        (
            "x.usda",
            lambda path: usd(path, MESH.replace("0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)]", "0: None") % ""),
            "no value at time code 0 ",
        ),
        ("x.usda", lambda path: usd(path, (MESH % "").replace("[0, 1, 2]", "[0, 1, 7]")), "refers to vertex 7"),
    ],
)
def test_missing_data_are_not_filled_in(
    tmp_path: Path, name: str, make: Callable[[Path], object], message: str
) -> None:
    with pytest.raises(InputError, match=message), opened(tmp_path, name, make) as read:
        read.read_frames(0, read.frame_count)
