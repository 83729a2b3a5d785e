"""What survives a round trip through each format: one entry per format in :data:`CONTRACT`, checked by `test_contract`.

A new format needs only one more entry here to run all of these tests. It must report everything that it does not
keep as lost.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

import meshio
import numpy as np
from numpy.typing import NDArray

from pdecodec import encode, open_sequence, write_sequence
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import needed, uv_with_seam

SHAPES: Mapping[str, Connectivity] = {
    "vertex": Connectivity(1),
    "points": Connectivity(4),
    "triangles": connectivity_of(4, [[0, 1, 2], [2, 1, 3]]),
    "quads": connectivity_of(6, [[0, 1, 2, 3], [2, 1, 4, 5]]),
    "polygons": connectivity_of(6, [[0, 1, 2], [2, 1, 3, 4], [0, 1, 2, 3, 4], [5, 4, 3]]),
    "odd faces": connectivity_of(6, faces=[[0, 1, 2], [2, 1, 0], [3, 3, 4]]),
    "lines": connectivity_of(4, lines=[[0, 1], [2, 3]]),
    "lines that share": connectivity_of(4, lines=[[3, 1, 0, 2], [0, 1]]),
    "line and points": connectivity_of(4, lines=[[0, 1], [2]]),
    "line alone": connectivity_of(4, lines=[[0, 1]]),
    "faces and lines": connectivity_of(5, faces=[[0, 1, 2]], lines=[[0, 3, 4], [1, 2], [4]]),
}
"""Shapes that objects can have."""

FACES = ("triangles", "quads", "polygons", "odd faces")

_SHARED = np.array([0, 1, 2, 3, 2, 1, 4], np.int32)
_WITHOUT_ONE = np.array([0, 1, 2, 3, -1, 1, 4], np.int32)


def _numbers(*shape: int) -> Any:
    return np.random.default_rng(1).random(shape).astype(np.float32)


ATTRIBUTES: Mapping[str, Attribute] = {
    "uv seam": uv_with_seam(),
    "uv second": uv_with_seam("uv:second"),
    "uv own": Attribute("uv", "corner", _numbers(7, 2)),
    "uv shared": Attribute("uv", "corner", np.eye(5, 2, dtype=np.float32), _SHARED),
    "uv missing": Attribute("uv", "corner", np.eye(5, 2, dtype=np.float32), _WITHOUT_ONE),
    "uv deep": Attribute("uv", "corner", np.eye(5, 3, dtype=np.float32), _WITHOUT_ONE),
    "edges": Attribute("normal_group", "corner", np.array([0, 0, 0, 0, 1, 0, 0], np.int32)),
    "color": Attribute("color", "vertex", _numbers(5, 3)),
    "color alpha": Attribute("color", "vertex", _numbers(5, 4)),
    "color bytes": Attribute("color", "vertex", np.arange(15, dtype=np.uint8).reshape(5, 3)),
    "color corners": Attribute("color", "corner", np.eye(2, 3, dtype=np.float32), _SHARED % 2),
    "color faces": Attribute("color:Cd", "face", np.eye(2, 4, dtype=np.float32)),
    "color object": Attribute("color", "object", np.ones((1, 3), np.float32)),
    "group": Attribute("group", "face", np.array([1, 0], np.int32), labels=("left", "linkes Bein ü")),
    "group overlapping": Attribute("group:sharing faces", "face", np.array([1, 1], np.uint8)),
    "material": Attribute("material", "face", np.array([0, 1], np.int32), labels=("skin", "nail")),
    "material partly": Attribute("material", "face", np.array([-1, 0], np.int32), labels=("skin",)),
    "smoothing": Attribute("smoothing", "face", np.array([3, 0], np.int32)),
    "catmull-clark": Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("catmull-clark",)),
    "loop": Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("loop",)),
    "floats": Attribute("mass", "vertex", np.arange(5, dtype=np.float32)),
    "doubles": Attribute("weight", "object", np.array([2.5])),
    "vectors": Attribute("rest", "vertex", np.eye(5, 3, dtype=np.float32)),
    "double vectors": Attribute("rest", "vertex", np.eye(5, 3)),
    "integers": Attribute("id", "face", np.array([-7, 2**30], np.int32)),
    "long integers": Attribute("id", "face", np.array([-7, 2**40])),
    "bytes": Attribute("mask", "corner", np.arange(7, dtype=np.uint8)),
    "labels": Attribute("patch", "vertex", np.array([0, 1, 1, 0, 2], np.int32), labels=("a", "b ü", "c")),
    "wide": Attribute("wide", "vertex", np.zeros((5, 7), np.float32)),
}
"""Attributes that an object of a quad and a triangle can have."""


@dataclass(frozen=True, kw_only=True)
class Holds:
    """What survives a round trip through a file of a format.

    Attributes
    ----------
    file : str
        Name of such a file: ``x.abc``, ``x.####.ply``, or ``x/`` for a folder.
    write : callable
        Writes a sequence to a path. If pdecodec only reads the format, another program's writer, with `written` false.
    read : mapping
        Options for opening the file, by the path.
    shapes : tuple of str
        Names in :data:`SHAPES`.
    attributes : tuple of str
        Names in :data:`ATTRIBUTES`.
    fields : tuple of str
        Domains of fields.
    names : {"all", "tree", "one"}
        Whether objects keep all names, keep them as paths in a tree, or are joined to one mesh.
    times : {"all", "counted"}
        Whether frames have times, or only numbers.
    metadata, runs, empty, infinite : bool
        Whether these are restored: metadata, changing connectivity, objects without vertices, positions that are not
        finite.
    error, attribute_error : float
        Largest error of positions, divided by the largest coordinate; and of attributes.
    bytes_again : bool
        Whether the same sequence gives the same bytes.
    """

    file: str
    write: Callable[..., Any] = write_sequence
    written: bool = True
    read: Callable[[str], dict[str, Any]] = field(default=lambda path: {})
    shapes: tuple[str, ...] = tuple(SHAPES)
    attributes: tuple[str, ...] = ()
    fields: tuple[str, ...] = ()
    names: Literal["all", "tree", "one"] = "tree"
    times: Literal["all", "counted"] = "all"
    metadata: bool = True
    runs: bool = False
    empty: bool = False
    infinite: bool = True
    error: float = 0.0
    attribute_error: float = 0.0
    bytes_again: bool = True

    def path(self, folder: Path) -> str:
        """Return a path in a folder; skip the test if a library that the format needs is missing."""
        needed(self.file.rpartition(".")[2])
        return f"{folder}/{self.file}"

    def open(self, path: str, **options: Any) -> MeshSequence:
        rate = {"fps": 24} if self.times == "counted" else {}
        return open_sequence(path, **{**rate, **self.read(path), **options})


def _write_cache(sequence: MeshSequence, path: str, **options: Any) -> tuple[str, ...]:
    """Write a point cache, and an NPZ file with the data that it cannot hold."""
    told = write_sequence(sequence, path, **options)
    # The cache is opened with the NPZ file, which has everything but fields.
    return (*(line for line in told if line.startswith("fields")), *write_sequence(sequence, f"{path}.npz", **options))


def _of_cache(path: str) -> dict[str, Any]:
    return {"mesh": f"{path}.npz"}


def _write_frames(frame: Callable[[NDArray[np.float32], Connectivity, Path], None]) -> Callable[..., None]:
    """Return a function that writes a sequence to a pattern, given one that writes a single file."""

    def write(sequence: MeshSequence, path: str) -> None:
        for number, points in zip(
            np.rint(sequence.times * 24), sequence.read_frames(0, sequence.frame_count), strict=True
        ):
            frame(points, sequence.connectivity, Path(path.replace("####", f"{int(number):04d}")))

    return write


def _split(counts: NDArray[np.int32], indices: NDArray[np.int32]) -> list[list[int]]:
    return [part.tolist() for part in np.split(indices, np.cumsum(counts)[:-1])] if counts.size else []


@_write_frames
def _write_stl(points: NDArray[np.float32], whole: Connectivity, path: Path) -> None:
    facets = np.zeros(whole.face_count, [("normal", "<f4", 3), ("corners", "<f4", (3, 3)), ("attribute", "<u2")])
    facets["corners"] = points[whole.face_indices].reshape(-1, 3, 3)
    path.write_bytes(b"solid but binary".ljust(80) + len(facets).to_bytes(4, "little") + facets.tobytes())


@_write_frames
def _write_off(points: NDArray[np.float32], whole: Connectivity, path: Path) -> None:
    rows = _split(whole.face_counts, whole.face_indices) + _split(whole.line_counts, whole.line_indices)
    lines = [f"OFF\n{len(points)} {len(rows)} 0", *(" ".join(map(repr, row)) for row in points.tolist())]
    path.write_text("\n".join([*lines, *(" ".join(map(str, [len(row), *row])) for row in rows)]) + "\n")


@_write_frames
def _write_vtk(points: NDArray[np.float32], whole: Connectivity, path: Path) -> None:
    kinds = {1: "vertex", 2: "line", 3: "triangle", 4: "quad"}
    rows = _split(whole.face_counts, whole.face_indices) + _split(whole.line_counts, whole.line_indices)
    cells = [(kinds.get(size, "polygon"), np.array([*part])) for size, part in groupby(rows, len)]
    meshio.Mesh(points, cells).write(path)


@_write_frames
def _write_vtp(points: NDArray[np.float32], whole: Connectivity, path: Path) -> None:
    def array(kind: str, name: str, values: NDArray[Any]) -> str:
        text = " ".join(map(repr, values.reshape(-1).tolist()))
        return f'<DataArray type="{kind}" Name="{name}" format="ascii">{text}</DataArray>'

    def cells(counts: NDArray[np.int32], indices: NDArray[np.int32]) -> str:
        return array("Int64", "connectivity", indices) + array("Int64", "offsets", np.cumsum(counts))

    path.write_text(
        f'<VTKFile type="PolyData" byte_order="LittleEndian"><PolyData><Piece NumberOfPoints="{len(points)}">'
        f"<Points>{array('Float32', 'Points', points)}</Points>"
        f"<Lines>{cells(whole.line_counts, whole.line_indices)}</Lines>"
        f"<Polys>{cells(whole.face_counts, whole.face_indices)}</Polys></Piece></PolyData></VTKFile>"
    )


@_write_frames
def _write_pvtu(points: NDArray[np.float32], whole: Connectivity, path: Path) -> None:
    times = [int(path.stem.rpartition(".")[2]) / 24]
    one = ArraySequence(points[None], objects=[MeshObject("mesh", whole)], times=times)
    write_sequence(one, path.with_suffix(".vtu"))
    piece = f'<Piece Source="{path.with_suffix(".vtu").name}"/>'
    kind = "PUnstructuredGrid"
    path.write_text(f'<VTKFile type="{kind}"><{kind}>{piece}</{kind}></VTKFile>')


def _write_series(sequence: MeshSequence, path: str) -> None:
    pattern = Path(f"{path}.####.vtu")
    write_sequence(sequence, pattern)
    names = sorted(file.name for file in pattern.parent.glob(f"{Path(path).name}.*.vtu"))
    steps = [{"name": name, "time": time} for name, time in zip(names, sequence.times.tolist(), strict=True)]
    Path(path).write_text(json.dumps({"files": steps}))


def _write_pdeanim(sequence: MeshSequence, path: str) -> None:
    encode(sequence, path, tolerance=1e-6)


_ALL_ATTRIBUTES = tuple(ATTRIBUTES)

_SCENE = (
    *("uv seam", "uv second", "uv own", "uv shared", "edges", "color", "color bytes", "color faces", "group"),
    *("group overlapping", "material", "material partly", "color object", "color alpha", "color corners"),
)
_ABC = (
    *_SCENE,
    *("catmull-clark", "loop", "floats", "doubles", "vectors", "integers", "bytes", "labels", "smoothing"),
)
_USD = (*_ABC, "uv missing", "uv deep", "double vectors", "long integers")
_OBJ = (
    *("uv seam", "uv own", "uv shared", "uv missing", "uv deep", "edges", "color", "color alpha", "color bytes"),
    *("group", "material", "material partly", "smoothing"),
)
_COLORS = ("color", "color alpha", "color bytes")
_PLY = (*_COLORS, "uv own", "uv shared")
_OF_TWO = tuple(name for name in SHAPES if name not in ("lines that share", "faces and lines"))
"""Shapes for formats that distinguish lines from faces by their number of vertices."""

_DOMAINS = ("vertex", "face", "corner", "object")

_CACHE = partial(Holds, write=_write_cache, read=_of_cache, names="all", attributes=_ALL_ATTRIBUTES, empty=True)
_ONE = partial(Holds, names="one", metadata=False)
_COUNTED = partial(_ONE, times="counted", runs=True)
_READ = partial(_COUNTED, written=False)

CONTRACT = (
    Holds(file="x.npz", names="all", attributes=_ALL_ATTRIBUTES, fields=_DOMAINS, empty=True),
    Holds(file="x.h5", names="all", attributes=_ALL_ATTRIBUTES, fields=_DOMAINS, empty=True),
    Holds(file="x.pdeanim", write=_write_pdeanim, written=False, names="all", attributes=_ALL_ATTRIBUTES, runs=True,
          empty=True, infinite=False, error=3e-6),
    _CACHE(file="x.mdd"),
    _CACHE(file="x.pc2", times="counted"),
    Holds(file="x.abc", attributes=_ABC, fields=_DOMAINS, runs=True),
    Holds(file="x.usda", attributes=_USD, fields=_DOMAINS, runs=True),
    Holds(file="x.usdc", attributes=_USD, fields=_DOMAINS, runs=True),
    Holds(file="x.usdz", attributes=_USD, fields=_DOMAINS, runs=True, bytes_again=False),
    Holds(file="x.glb", attributes=(*_SCENE, "uv missing"), infinite=False, error=2.0**-21, attribute_error=1e-7),
    Holds(file="x.gltf", attributes=(*_SCENE, "uv missing"), infinite=False, error=2.0**-21, attribute_error=1e-7),
    Holds(file="x/", attributes=_OBJ, metadata=False, runs=True, infinite=False, attribute_error=1e-7),
    _ONE(file="x.xdmf", fields=("vertex", "face", "object")),
    _ONE(file="x.pvd", runs=True, fields=_DOMAINS[:2]),
    _ONE(file="x.e", shapes=_OF_TWO, attributes=("group",), fields=_DOMAINS[:2]),
    _ONE(file="x.vtu.series", write=_write_series, written=False, runs=True),
    _COUNTED(file="x.####.vtu", fields=_DOMAINS[:2]),
    _COUNTED(file="x.####.ply", shapes=("vertex", "points", *FACES), attributes=_PLY, fields=_DOMAINS[:2],
             attribute_error=1 / 509),
    _READ(file="x.####.vtp", write=_write_vtp),
    _READ(file="x.####.pvtu", write=_write_pvtu),
    _READ(file="x.####.vtk", write=_write_vtk, shapes=_OF_TWO[2:]),
    _READ(file="x.####.off", write=_write_off, shapes=_OF_TWO),
    _READ(file="x.####.stl", write=_write_stl, shapes=()),
)  # fmt: skip
