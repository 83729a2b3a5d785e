"""Valid files from which the fuzzer of readers begins, several for each reader."""

from __future__ import annotations

import struct
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pdecodec.formats import write_sequence
from pdecodec.mesh.sequence import ArraySequence
from tests.slow.fuzz.mutations import (
    Mutation,
    mixed,
    of_fields,
    of_glb,
    of_hdf5,
    of_json,
    of_npz,
    of_ply,
    of_text,
)
from tests.support.exodus_files import write_exodus
from tests.support.scene_cases import scene

TRIANGLES = np.array([[0, 1, 2], [0, 2, 3], [0, 3, 1], [1, 3, 2]])
CORNERS = np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1.5]])


@dataclass(frozen=True)
class Seed:
    """Files by name. `changed` is the file that is mutated, `opened` the file that is opened."""

    files: dict[str, bytes]
    changed: str
    opened: str


@dataclass(frozen=True)
class Target:
    """A reader to fuzz, and its seeds."""

    seeds: tuple[Seed, ...]
    mutate: Mutation
    ends_process: bool = False
    """Whether damage may crash the library: then the file is read in isolation, which must end in our error."""


def _alone(name: str, data: bytes) -> Seed:
    return Seed({name: data}, name, name)


def _written(sequence: ArraySequence, name: str, **options: bool) -> dict[str, bytes]:
    with tempfile.TemporaryDirectory() as folder:
        write_sequence(sequence, Path(folder) / name, **options)
        return {path.name: path.read_bytes() for path in sorted(Path(folder).iterdir())}


def _obj() -> tuple[Seed, ...]:
    frames = _written(scene(frames=2), "in.####.obj")
    first, second = sorted(name for name in frames if name.endswith(".obj"))
    rich = (
        b"mtllib in.mtl\no a\nv 0 0 0\nv 1 0 0 .5 .5 1\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvn 0 0 1\ng one two\n"
        b"usemtl red\ns 1\nf 1/1/1 2/2/1 3//1 4/1\nf -1 -2 -3\no b\nv 2 2 2\nl 1 2 3 \\\n4\np 5\ns off\nf 5 1 2\n"
    )
    return (
        *(Seed(frames, name, name) for name in (first, second)),
        Seed(frames, second, "in.####.obj"),
        _alone("in.obj", rich),
    )


def _point_caches(extension: str) -> tuple[Seed, ...]:
    sequence = scene(frames=3)
    (mesh,) = _written(scene(frames=1), "mesh.obj").values()
    (data,) = _written(sequence, f"in.{extension}").values()
    name = f"in.{extension}"
    return (_alone(name, data), Seed({name: data, "mesh.obj": mesh}, name, name))


def _stl() -> tuple[Seed, ...]:
    text, binary = b"solid a\n", bytes(80) + struct.pack("<I", len(TRIANGLES))
    for triangle in CORNERS[TRIANGLES]:
        lines = b"".join(b"vertex %g %g %g\n" % tuple(point) for point in triangle)
        text += b"facet normal 0 0 1\nouter loop\n" + lines + b"endloop\nendfacet\n"
        binary += struct.pack("<12fH", 0, 0, 1, *triangle.ravel(), 0)
    return _alone("in.stl", text + b"endsolid a\n"), _alone("in.stl", binary)


def _off() -> tuple[Seed, ...]:
    rows = "".join(f"{x:g} {y:g} {z:g}\n" for x, y, z in CORNERS) + "3 0 1 2 255 0 0\n4 0 1 2 3\n"
    return (
        _alone("in.off", f"OFF\n4 2 0\n# remark\n{rows}".encode()),
        _alone("in.off", f"COFF 4 2 6\n{rows}".encode()),
    )


def _ply() -> tuple[Seed, ...]:
    (binary,) = _written(scene(frames=1), "in.ply").values()
    text = (
        b"ply\nformat ascii 1.0\ncomment x\nelement vertex 4\nproperty float x\nproperty float y\nproperty double z\n"
        b"property uchar red\nproperty uchar green\nproperty uchar blue\nproperty float s\nproperty float t\n"
        b"element face 2\nproperty list uchar int vertex_indices\nelement edge 1\nproperty int vertex1\n"
        b"property int vertex2\nend_header\n0 0 0 1 2 3 0 0\n1 0 0 1 2 3 0 1\n1 1 0 9 9 9 1 1\n0 1 0 4 4 4 1 0\n"
        b"3 0 1 2\n4 0 1 2 3\n0 2\n"
    )
    return _alone("in.ply", binary), _alone("in.ply", text)


def _gltf() -> tuple[Seed, ...]:
    found = []
    for options in ({}, {"quantize": True}, {"meshopt": True}):
        (data,) = _written(scene(frames=4), "in.glb", **options).values()
        found.append(_alone("in.glb", data))
    return tuple(found)


def _gltf_text() -> tuple[Seed, ...]:
    files = _written(scene(frames=3), "in.gltf")
    return tuple(Seed(files, name, "in.gltf") for name in files)


def _container(extension: str) -> tuple[Seed, ...]:
    (data,) = _written(scene(frames=3), f"in.{extension}").values()
    return (_alone(f"in.{extension}", data),)


def _beside(name: str) -> tuple[Seed, ...]:
    """Return seeds of a format of several files: each file is changed in turn, and the first one with its
    extension is opened.
    """
    files = _written(scene(frames=3), name)
    return tuple(Seed(files, changed, name) for changed in files)


def _lists() -> tuple[Seed, ...]:
    """Return lists of VTK files: steps with times, parts, and lists of these."""
    files = _written(scene(frames=2), "in.pvd")
    first = next(name for name in sorted(files) if name.endswith(".vtu"))
    lists = {
        "in.vtm": f'<VTKFile type="vtkMultiBlockDataSet"><vtkMultiBlockDataSet><DataSet index="0" file="{first}"/>'
        "</vtkMultiBlockDataSet></VTKFile>",
        "in.pvtu": f'<VTKFile type="PUnstructuredGrid"><PUnstructuredGrid><Piece Source="{first}"/>'
        "</PUnstructuredGrid></VTKFile>",
        "in.vtu.series": f'{{"files": [{{"name": "in.pvtu", "time": 0}}, {{"name": "{first}", "time": 1.5}}]}}',
    }
    files |= {name: text.encode() for name, text in lists.items()}
    return (*(Seed(files, name, name) for name in ("in.pvd", *lists)), Seed(files, first, "in.pvd"))


def _exodus() -> tuple[Seed, ...]:
    with tempfile.TemporaryDirectory() as folder:
        write_exodus(Path(folder) / "in.e", {f"DISPL{axis}": np.zeros((3, 4)) for axis in "XYZ"})
        return (_alone("in.e", (Path(folder) / "in.e").read_bytes()),)


def _usd() -> tuple[Seed, ...]:
    """Return a stage as text, in binary format and as a package, and a hand-written stage with features that
    our writer does not use.
    """
    identity = "((1,0,0,0),(0,1,0,0),(0,0,1,0),(0,0,0,1))"
    stage = f"""#usda 1.0
(
    defaultPrim = "a"
    upAxis = "Z"
    timeCodesPerSecond = 24
)
def Xform "a" (
    variants = {{ string size = "small" }}
    prepend variantSets = "size"
    prepend references = </base>
)
{{
    matrix4d xformOp:transform.timeSamples = {{ 0: {identity}, 4: None }}
    uniform token[] xformOpOrder = ["xformOp:transform"]
    def Sphere "ball" {{
        double radius.timeSamples = {{ 0: 1, 2: 3 }}
    }}
    variantSet "size" = {{
        "small" {{
            def Cube "cube" {{
            }}
        }}
        "large" {{
        }}
    }}
}}
class "base" {{
    def BasisCurves "hair" {{
        int[] curveVertexCounts = [2, 3]
        point3f[] points = [(0,0,0), (1,0,0), (0,1,0), (0,0,1), (1,1,1)]
        uniform token type = "linear"
    }}
}}
def PointInstancer "many" {{
    rel prototypes = </many/one>
    int[] protoIndices = [0, 0]
    point3f[] positions = [(0,0,0), (5,0,0)]
    quath[] orientations = [(1,0,0,0), (0,1,0,0)]
    def Cube "one" {{
    }}
}}
def SkelRoot "root" {{
    def Skeleton "bones" {{
        uniform token[] joints = ["a", "a/b"]
        uniform matrix4d[] bindTransforms = [{identity}, {identity}]
        uniform matrix4d[] restTransforms = [{identity}, {identity}]
    }}
    def Mesh "skin" (
        prepend apiSchemas = ["SkelBindingAPI"]
    ) {{
        int[] faceVertexCounts = [3]
        int[] faceVertexIndices = [0, 1, 2]
        point3f[] points = [(0,0,0), (1,0,0), (0,1,0)]
        rel skel:skeleton = </root/bones>
        int[] primvars:skel:jointIndices = [0, 1, 1] ( elementSize = 1; interpolation = "vertex" )
        float[] primvars:skel:jointWeights = [1, 1, 1] ( elementSize = 1; interpolation = "vertex" )
    }}
}}
""".encode()
    return (_alone("in.usda", stage), *(_container(extension)[0] for extension in ("usda", "usdc", "usdz")))


def target(reader: str) -> Target:
    """Return a reader of :data:`READERS` as a target, with its seeds."""
    return READERS[reader]()


READERS: Mapping[str, Callable[[], Target]] = {
    "obj": lambda: Target(_obj(), mixed(of_text)),
    "mdd": lambda: Target(_point_caches("mdd"), mixed(of_fields)),
    "pc2": lambda: Target(_point_caches("pc2"), mixed(of_fields)),
    "ply": lambda: Target(_ply(), mixed(of_ply)),
    "stl": lambda: Target(_stl(), mixed(of_text, of_fields)),
    "off": lambda: Target(_off(), mixed(of_text)),
    "glb": lambda: Target(_gltf(), mixed(of_glb)),
    "gltf": lambda: Target(_gltf_text(), mixed(of_json, of_fields)),
    "npz": lambda: Target(_container("npz"), mixed(of_npz)),
    "hdf5": lambda: Target(_container("h5"), mixed(of_hdf5)),
    "xdmf": lambda: Target(_beside("in.xdmf"), mixed(of_text, of_hdf5)),
    "vtk": lambda: Target(_lists(), mixed(of_text)),
    "exodus": lambda: Target(_exodus(), mixed(of_hdf5)),
    "usd": lambda: Target(_usd(), mixed(of_text, of_fields), ends_process=True),
    "alembic": lambda: Target(_container("abc"), mixed(of_fields), ends_process=True),
}
