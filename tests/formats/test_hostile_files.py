"""Malicious files for every reader: each is refused in one line, with little time and memory.

`make fuzz-readers` searches for more of them; `test_file_scope.py` has files that name other files.
"""

from __future__ import annotations

import base64
import bz2
import io
import json
import resource
import signal
import struct
import sys
import time
import zipfile
import zlib
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from pdecodec import InputError, open_sequence
from pdecodec.errors import LONGEST_MESSAGE
from pdecodec.formats import write_sequence
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from tests.support.scene_cases import needed

MAX_SECONDS = 10
"""Limit of processor time [s], which does not depend on the load of the machine."""

MAX_MEMORY = 2**29
"""Address space that may be used in addition to that of the process [bytes]."""

HUGE = 10**12


@contextmanager
def little(memory: int = MAX_MEMORY) -> Iterator[None]:
    """Limit time and memory in this block; Python raises an error if they are exceeded."""

    def too_slow(number: int, frame: object) -> None:
        raise TimeoutError(f"took more than {MAX_SECONDS} s")

    taken = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0]) * resource.getpagesize()
    before, handler = resource.getrlimit(resource.RLIMIT_AS), signal.signal(signal.SIGPROF, too_slow)
    resource.setrlimit(resource.RLIMIT_AS, (taken + memory, before[1]))
    signal.setitimer(signal.ITIMER_PROF, MAX_SECONDS)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
        signal.signal(signal.SIGPROF, handler)
        resource.setrlimit(resource.RLIMIT_AS, before)


def gltf(**changes: Any) -> bytes:
    root = {
        "asset": {"version": "2.0"},
        "buffers": [{"uri": "data:;base64," + "A" * 64, "byteLength": 48}],
        "bufferViews": [{"buffer": 0, "byteLength": 48}],
        "accessors": [{"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}],
        "meshes": [{"primitives": [{"mode": 0, "attributes": {"POSITION": 0}}]}],
        "nodes": [{"mesh": 0}],
        "scenes": [{"nodes": [0]}],
    }
    return json.dumps({**root, **changes}).encode()


def npz(shape: str, data: bytes = b"", method: int = zipfile.ZIP_DEFLATED) -> bytes:
    header = f"{{'descr': '<f4', 'fortran_order': False, 'shape': {shape}, }}".encode()
    header += b" " * (-(len(header) + 11) % 64) + b"\n"
    held = io.BytesIO()
    with zipfile.ZipFile(held, "w", method) as archive:
        archive.writestr("points.npy", b"\x93NUMPY\x01\x00" + struct.pack("<H", len(header)) + header + data)
    return held.getvalue()


def hdf5(put: Callable[[h5py.File], object]) -> bytes:
    held = io.BytesIO()
    with h5py.File(held, "w") as file:
        put(file)
    return held.getvalue()


def xdmf(dimensions: str, text: str = "0 0 0", more: str = "", *, form: str = "XML") -> bytes:
    item = f'<DataItem Format="{form}" Dimensions="{dimensions}" {more}>{text}</DataItem>'
    topology = '<Topology TopologyType="Polyvertex" NumberOfElements="1"/>'
    return f"<Xdmf><Domain><Grid>{topology}<Geometry>{item}</Geometry></Grid></Domain></Xdmf>".encode()


def vtu(points: object, array: str = "0 0 0", more: str = 'format="ascii"', head: str = "") -> bytes:
    return (
        f'<VTKFile type="UnstructuredGrid" {head}><UnstructuredGrid><Piece NumberOfPoints="{points}" NumberOfCells="0">'
        f'<Points><DataArray type="Float32" NumberOfComponents="3" {more}>{array}</DataArray></Points><Cells>'
        '<DataArray type="Int32" Name="connectivity" format="ascii"/><DataArray type="Int32" Name="offsets" '
        'format="ascii"/><DataArray type="UInt8" Name="types" format="ascii"/></Cells></Piece></UnstructuredGrid>'
        "</VTKFile>"
    ).encode()


PLY = "ply\nformat {} 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n{}end_header\n{}"
USDA = '#usda 1.0\ndef Mesh "M"\n{{\n    int[] faceVertexCounts = {}\n    int[] faceVertexIndices = {}\n{}}}\n'
POINTS = "    point3f[] points = [(0, 0, 0), (1, 0, 0), (0, 1, 0)]\n"

BOMB = "<!DOCTYPE x [" + "<!ENTITY a0 'aaaaaaaaaa'>" + "".join(
    f"<!ENTITY a{k} '{f'&a{k - 1};' * 10}'>" for k in range(1, 10)
) + "]>"  # fmt: skip


FILES: dict[str, tuple[str, bytes | Callable[[], bytes], str]] = {}
"""For each fault: the name of a file, its bytes, and words of the expected message."""


def case(name: str, what: str, data: bytes | Callable[[], bytes], words: str) -> None:
    FILES[f"{name} {what}"] = name, data, words


def packed_vtu() -> bytes:
    packed = zlib.compress(bytes(10**6))
    blocks = base64.b64encode(struct.pack("<4I", 1, 2**31 - 1, 0, len(packed))) + base64.b64encode(packed)
    return vtu(1, blocks.decode(), 'format="binary"', 'compressor="vtkZLibDataCompressor"')


case(
    "x.ply",
    "of many vertices",
    PLY.format("binary_little_endian", HUGE, "", "").encode(),
    "declares more rows than it has bytes",
)
case(
    "x.ply",
    "of many vertices as text",
    PLY.format("ascii", HUGE, "", "0 0 0\n").encode(),
    "declares more rows than it has bytes",
)
case(
    "x.ply",
    "with a count beyond all",
    PLY.format("ascii", 10**400, "", "0 0 0\n").encode(),
    "declares more rows than it has bytes",
)
case(
    "x.ply",
    "with a long list",
    PLY.format("binary_little_endian", 1, "element face 1\nproperty list uint int vertex_indices\n", "").encode()
    + bytes(12)
    + b"\xff" * 8,
    "early end-of-file",
)
case("x.ply", "without an end of its header", b"ply\nformat ascii 1.0\n" + b"comment x\n" * 2000, "early end-of-file")
case("x.ply", "with a negative count", PLY.format("ascii", -1, "", "").encode(), "negative dimensions")
case("x.obj", "with an index beyond all", b"v 0 0 0\nf 1 1 " + b"9" * 400 + b"\n", "expected a vertex index")
case("x.obj", "of one long line", b"v 0 0 0\nf " + b"1 " * 10 + b"/" * 10**6, "expected a vertex index")
case("x.obj", "of zeros", bytes(10**6), "holds zero bytes")
case("x.stl", "of many triangles", bytes(80) + b"\xff" * 4, "or is truncated")
case("x.stl", "of text without numbers", b"solid a\nfacet normal x\n", "is not an STL file")
case("x.off", "of many vertices", f"OFF\n{HUGE} 1 0\n0 0 0\n".encode(), "are declared")
case("x.off", "with a count beyond all", f"OFF\n{10**400} 1 0\n0 0 0\n".encode(), "are declared")
case("x.off", "with a face of many corners", b"OFF\n1 1 0\n0 0 0\n" + b"9" * 30 + b" 0 0 0\n", "that it declares")
case("x.mdd", "of many frames", struct.pack(">ii", 2**31 - 1, 2**31 - 1) + bytes(100), "its header says")
case(
    "x.pc2",
    "of many frames",
    struct.pack("<12siiffi", b"POINTCACHE2\0", 1, 2**31 - 1, 0, 1, 2**31 - 1) + bytes(100),
    "is truncated",
)
case(
    "x.pc2",
    "with an infinite start",
    struct.pack("<12siiffi", b"POINTCACHE2\0", 1, 1, float("inf"), 1, 1) + bytes(100),
    "from inf by 1",
)
case("x.npz", "of many points", lambda: npz(f"({HUGE}, {HUGE}, 3)"), "its length is not what its header says")
case("x.npz", "with a shape beyond all", lambda: npz(f"({10**400}, 1, 3)"), "its length is not what its header says")
case("x.npz", "with a negative shape", lambda: npz("(-1, 1, 3)"), "its length is not what its header says")
case(
    "x.npz",
    "that unpacks to more than it says",
    lambda: npz("(1, 1, 3)", bytes(10**8)),
    "its length is not what its header says",
)
case("x.npz", "whose header nests", lambda: npz("(" * 3000 + ")" * 3000), "Cannot parse header")
case(
    "x.h5",
    "of chunks that are not there",
    lambda: hdf5(lambda f: f.create_dataset("points", (10**9, 10**6, 3), "<f4", chunks=(1, 1000, 3))),
    "were never written",
)
case(
    "x.h5",
    "of a link to itself",
    lambda: hdf5(lambda f: f.__setitem__("points", h5py.SoftLink("/points"))),
    "is behind more than 16 links",
)
case(
    "x.h5", "of text in place of points", lambda: hdf5(lambda f: f.__setitem__("points", "x")), "points must be numbers"
)
case(
    "x.h5",
    "of objects in place of points",
    lambda: hdf5(lambda f: f.create_dataset("points", (1, 1, 3), h5py.vlen_dtype(np.float32))),
    "was never written",
)
case(
    "x.h5",
    "of times that are text",
    lambda: hdf5(lambda f: (f.__setitem__("points", np.zeros((2, 1, 3), "f4")), f.__setitem__("times", ["a", "b"]))),
    "times must be numbers",
)
case(
    "x.h5",
    "of one million times for two frames",
    lambda: hdf5(
        lambda f: (
            f.__setitem__("points", np.zeros((2, 1, 3), "f4")),
            f.create_dataset("times", (10**9,), "f8", chunks=(1000,)),
        )
    ),
    "were never written",
)
ACCESSOR = {"bufferView": 0, "componentType": 5126, "count": 4, "type": "VEC3"}
case("x.gltf", "of lists in lists", b"[" * 10**5, "recursion depth")
case(
    "x.gltf",
    "with a count beyond all",
    gltf(accessors=[{**ACCESSOR, "count": 10**400}]),
    "accessors[0].count is no whole number, or out of range",
)
case(
    "x.gltf",
    "with many zeros",
    gltf(accessors=[{"componentType": 5126, "count": 2**40, "type": "VEC3"}]),
    "rows of zeros",
)
case(
    "x.gltf",
    "with a length beyond all",
    gltf(buffers=[{"uri": "x.bin", "byteLength": 10**30}]),
    "buffers[0].byteLength is no whole number, or out of range",
)
case("x.gltf", "with a NUL in a name", gltf(buffers=[{"uri": "a\0b", "byteLength": 48}]), "which is not a valid name")
case("x.gltf", "whose nodes go round", gltf(nodes=[{"mesh": 0, "children": [0]}]), "is its own ancestor")
case(
    "x.gltf",
    "with a huge number",
    gltf(nodes=[{"mesh": 0, "translation": [10**400, 0, 0]}]),
    "nodes[0].translation is no number, or out of range",
)
case(
    "x.gltf",
    "with an infinite number",
    gltf(nodes=[{"mesh": 0, "translation": [float("inf"), 0, 0]}]),
    "nodes[0].translation is no number, or out of range",
)
case("x.gltf", "with digits without end", b'{"asset":{"version":"2.0"},"x":' + b"9" * 10**4 + b"}", "Exceeds the limit")
case("x.glb", "longer than it is", b"glTF" + struct.pack("<II", 2, 2**32 - 1) + b"\xff" * 100, "its chunks do not fit")
case(
    "x.glb",
    "of a chunk longer than it is",
    b"glTF" + struct.pack("<II", 2, 40) + struct.pack("<I4s", 2**32 - 1, b"JSON") + bytes(20),
    "its chunks do not fit",
)
case("x.xdmf", "of many numbers", xdmf(f"{HUGE} 3"), "its data are 3 numbers")
case("x.xdmf", "with dimensions beyond all", xdmf(f"{10**400} 3"), "its data are 3 numbers")
case("x.xdmf", "with long dimensions", xdmf("9" * 10**4), "Exceeds the limit")
case("x.xdmf", "of entities in entities", (BOMB + "<Xdmf>&a9;</Xdmf>").encode(), "amplification factor")
case("x.xdmf", "of elements in elements", b"<Xdmf>" + b"<Grid>" * 10**5 + b"</Grid>" * 10**5 + b"</Xdmf>", "no domain")
case(
    "x.xdmf",
    "of binary data at a place beyond all",
    xdmf("1 3", "x.bin", f'NumberType="Float" Precision="4" Seek="{10**30}"', form="Binary"),
    "is damaged",
)
case(
    "x.xdmf",
    "of numbers of a million bytes",
    xdmf("1 3", "x.bin", 'NumberType="Float" Precision="1000000"', form="Binary"),
    "not understood",
)
case(
    "x.xdmf",
    "of a part of what is not there",
    xdmf("1 3", "x.h5:/a|0 0|1 1|1 99999999999|9 9", form="HDF"),
    "names 'x.h5', which is missing",
)
case(
    "x.pvd",
    "that lists itself",
    b'<VTKFile><Collection><DataSet timestep="0" file="x.pvd"/></Collection></VTKFile>',
    "are not read as part of a list",
)
case(
    "x.pvd",
    "of times that are text",
    b'<VTKFile><Collection><DataSet timestep="soon" file="x.vtu"/></Collection></VTKFile>',
    "could not convert",
)
case(
    "x.pvd",
    "of a time beyond all",
    b'<VTKFile><Collection><DataSet timestep="1e999" file="x.vtu"/></Collection></VTKFile>',
    "lists no files with times",
)
case("x.vtu.series", "of a time beyond all", b'{"files":[{"name":"x.vtu","time":' + b"9" * 400 + b"}]}", "too large")
case("x.vtu.series", "of lists in lists", b'{"files":' + b"[" * 10**5, "recursion depth")
case("x.vtu.series", "of a name that is a number", b'{"files":[{"name":5,"time":0}]}', "there is no such file")
case(
    "x.vtm",
    "that lists itself",
    b'<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet>'
    + b'<DataSet file="x.vtm"/>' * 2
    + b"</vtkMultiBlockDataSet></VTKFile>",
    "more than 8 lists",
)
case(
    "x.pvtu",
    "that lists itself many times",
    b'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid>'
    + b'<Piece Source="x.pvtu"/>' * 3000
    + b"</PUnstructuredGrid></VTKFile>",
    "more than 8 lists",
)
case(
    "x.vtu",
    "of data at a place beyond all",
    vtu(1, "", f'format="appended" offset="{10**30}"'),
    "meshio cannot read it",
)
case("x.vtu", "that unpacks to much", packed_vtu, "meshio cannot read it")
case(
    "x.vtp",
    "of entities in entities",
    (BOMB + "<VTKFile type='PolyData'>&a9;</VTKFile>").encode(),
    "amplification factor",
)
case(
    "x.vtk",
    "of many points",
    f"# vtk DataFile Version 3.0\nx\nASCII\nDATASET UNSTRUCTURED_GRID\nPOINTS {HUGE} float\n0 0 0\n".encode(),
    "meshio cannot read it",
)
case(
    "x.vtk",
    "of binary points that are not there",
    f"# vtk DataFile Version 3.0\nx\nBINARY\nDATASET UNSTRUCTURED_GRID\nPOINTS {HUGE} float\n".encode(),
    "meshio cannot read it",
)
case(
    "x.e",
    "of nodes that are not there",
    lambda: hdf5(lambda f: f.create_dataset("coordx", (10**11,), "f8", chunks=(1000,))),
    "were never written",
)
case(
    "x.e",
    "of netCDF with a huge dimension",
    b"CDF\x01" + struct.pack(">6I", 0, 10, 1, 1, 0x78000000, 0x7FFFFFFF) + bytes(60),
    "is not an Exodus file",
)
case(
    "x.e",
    "of netCDF with a long list",
    b"CDF\x01" + struct.pack(">3I", 0, 10, 0x7FFFFFFF) + bytes(60),
    "is not an Exodus file",
)
case("x.usda", "of negative counts", USDA.format("[-3]", "[0, 1, 2]", POINTS).encode(), "has a face of -3 corners")
case(
    "x.usda",
    "of corners that are not there",
    USDA.format("[3]", "[0, 1, 99999]", POINTS).encode(),
    "refers to vertex 99999",
)
case("x.usda", "of a count beyond all", USDA.format("[2147483647]", "[0, 1, 2]", POINTS).encode(), "2147483647 corners")
case(
    "x.usda",
    "of times beyond all",
    USDA.format(
        "[3]",
        "[0, 1, 2]",
        "    point3f[] points.timeSamples = { 1e300: [(0,0,0),(1,0,0),(0,1,0)], -1e300: [(0,0,0),(1,0,0),(0,1,0)] }\n",
    ).encode(),
    "times must lie within",
)
case(
    "x.usda",
    "of a rate of nothing",
    USDA.replace("1.0\n", "1.0\n(\n    timeCodesPerSecond = 0\n)\n").format("[3]", "[0, 1, 2]", POINTS).encode(),
    "must be a positive number",
)
case("x.usda", "of prims in prims", b"#usda 1.0\n" + b'def Xform "x"\n{\n' * 3000 + b"}\n" * 3000, "holds no mesh")
case("x.usdc", "of random bytes", b"PXR-USDC" + bytes(range(256)) * 40, "is not a USD file")
case("x.usdz", "that is no package", b"PK\x03\x04" + bytes(1000), "is not a USD file")
case("x.abc", "of nothing behind its beginning", b"Ogawa\xff\x00\x01" + bytes(8), "is not an Alembic file")
case(
    "x.abc",
    "of a group at a place beyond all",
    b"Ogawa\xff\x00\x01" + struct.pack("<QQ", 16, 2**62) + b"\xff" * 100,
    "is not an Alembic file",
)


@pytest.mark.skipif(sys.platform != "linux", reason="memory is measured as on Linux")
@pytest.mark.parametrize("what", FILES)
def test_a_file_made_to_be_bad_is_refused_in_one_line_with_little_time_and_memory(what: str, tmp_path: Path) -> None:
    name, data, words = FILES[what]
    # USD and Alembic reserve address space that they do not use, and end the process if there is none.
    in_library = name.endswith((".usda", ".usdc", ".usdz", ".abc"))
    if in_library:
        needed(name.rpartition(".")[2])
    path = tmp_path / name
    path.write_bytes(data() if callable(data) else data)
    (tmp_path / "x.bin").write_bytes(bytes(12))
    with (
        pytest.raises(InputError) as caught,
        little(2**40 if in_library else MAX_MEMORY),
        open_sequence(path) as found,
    ):
        found.read_frames(0, 1)
    message = str(caught.value)
    assert words in message
    assert "\n" not in message
    assert len(message) < LONGEST_MESSAGE + 200


@pytest.mark.parametrize("packing", ["Zlib", "BZip2"])
def test_no_more_is_unpacked_of_binary_data_than_is_declared(packing: str, tmp_path: Path) -> None:
    data = bytes(2**26)
    pack = zlib.compress if packing == "Zlib" else bz2.compress
    (tmp_path / "x.bin").write_bytes(pack(data, 1))
    more = f'NumberType="Float" Precision="4" Compression="{packing}"'
    (tmp_path / "x.xdmf").write_bytes(xdmf("1 3", "x.bin", more, form="Binary"))
    del data
    with little(2**24), open_sequence(tmp_path / "x.xdmf") as found:
        assert not found.read_frames(0, 1).any()


# --- values of unlimited length and number


def many_objects(count: int) -> ArraySequence:
    one = Connectivity.from_padded(3, [[0, 1, 2]])
    objects = [MeshObject(f"group{number % 100}/part{number}", one) for number in range(count)]
    return ArraySequence(np.random.default_rng(0).normal(size=(2, 3 * count, 3)).astype(np.float32), objects=objects)


def written(name: str) -> Callable[[Path, int], Path]:
    def write(folder: Path, count: int) -> Path:
        write_sequence(many_objects(count), folder / name)
        return folder / name

    return write


def of_text(name: str, text: Callable[[int], str]) -> Callable[[Path, int], Path]:
    def write(folder: Path, count: int) -> Path:
        (folder / name).write_text(text(count))
        return folder / name

    return write


def ply_of(count: int, header: str) -> str:
    return PLY.format("ascii", 1, "", "0 0 0\n").replace("element vertex", header * count + "element vertex", 1)


def pvd_of(count: int) -> str:
    rows = "".join(f'<DataSet timestep="0" part="{number}" file="x.vtu"/>' for number in range(count))
    return f"<VTKFile><Collection>{rows}</Collection></VTKFile>"


def spatial_grids(count: int) -> str:
    whole = xdmf("1 3").decode()
    grid = whole[whole.index("<Grid>") : whole.index("</Domain>")]
    grids = "".join(grid.replace("<Grid>", f'<Grid Name="g{number}">') for number in range(count))
    return f'<Xdmf><Domain><Grid GridType="Collection" CollectionType="Spatial">{grids}</Grid></Domain></Xdmf>'


LONG: dict[str, tuple[Callable[[Path, int], Path], int]] = {
    **{f"objects of {name}": (written(name), 10_000) for name in ("x.####.obj", "x.glb", "x.npz", "x.usdc", "x.abc")},
    "objects of x.h5": (written("x.h5"), 2_000),
    "header lines of x.ply": (of_text("x.ply", lambda count: ply_of(count, "comment x\n")), 100_000),
    "groups of x.obj": (of_text("x.obj", lambda count: "v 0 0 0\n" * 3 + "".join(
        f"g a{number}\nusemtl m{number}\nf 1 2 3\n" for number in range(count))), 100_000),
    "parts of x.pvd": (of_text("x.pvd", pvd_of), 4_000),
    "grids of x.xdmf": (of_text("x.xdmf", spatial_grids), 10_000),
}  # fmt: skip


@pytest.mark.long
@pytest.mark.parametrize("what", LONG)
def test_four_times_as_much_takes_about_four_times_as_long(
    what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    write, count = LONG[what]
    needed(what.rpartition(".")[2])
    taken = []
    for number in (count // 4, count):
        (tmp_path / str(number)).mkdir()
        (tmp_path / str(number) / "x.vtu").write_bytes(vtu(1))
        path = write(tmp_path / str(number), number)
        started = time.process_time()
        with open_sequence(path) as found:
            found.read_frames(0, 1)
        taken.append(time.process_time() - started)
    with capsys.disabled():
        print(f"\n  {count:,} {what}: {taken[1]:.2f} s, a quarter {taken[0]:.2f} s")
    assert taken[1] < 8 * taken[0] + 0.5
