"""What each format can hold by its own specification, in its own words, and what happens to it when it is read.

`docs/formats.md` shows this; `tests/formats/test_specifications.py` reads a file with each of these things and
compares.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass


@dataclass(frozen=True)
class Specification:
    """The things that a format can hold, by what happens to them.

    Attributes
    ----------
    coded : tuple of str
        Kept, also through `.pdeanim` files.
    carried : tuple of str
        Kept from a file to another one of the same format; otherwise dropped.
    dropped : tuple of str
        Not kept; a notice names those that a file has.
    refused : tuple of str
        Files with them are refused; on request, the objects with them are left out instead.
    implied : tuple of str
        Ignored, because they follow from what is kept, or are for people who read the file.
    """

    coded: tuple[str, ...]
    dropped: tuple[str, ...] = ()
    refused: tuple[str, ...] = ()
    implied: tuple[str, ...] = ()
    carried: tuple[str, ...] = ()


_ARRAYS = Specification(("points", "times", "fps", "faces", "objects", "metadata"), ("other arrays",))

_VTK = Specification(
    ("Points", "Cells", "TimeValue", "vectors chosen as the displacement", "PointData", "CellData"), ("FieldData",)
)

_OBJ_KEPT = "f l p o g s usemtl mtllib"

_OBJ_LEFT_OUT = """vp maplib usemap lod bevel c_interp d_interp shadow_obj trace_obj mg cstype deg bmat step parm trim
hole scrv sp con ctech stech end"""

SPECIFICATIONS: Mapping[str, Specification] = {
    "obj": Specification(
        ("v", "colours of v", "vt", "vn (which corners share one)", *_OBJ_KEPT.split()),
        (*_OBJ_LEFT_OUT.split(), "g and usemtl of l and p"),
        ("curv", "curv2", "surf", "res", "call", "csh", "bsp"),
        ("comments",),
    ),
    "npz": _ARRAYS,
    "hdf5": _ARRAYS,
    "mdd": Specification(("times", "positions")),
    "pc2": Specification(("start and step", "positions")),
    "alembic": Specification(
        (
            "Xform (as matrices)",
            "PolyMesh",
            "SubD",
            "Curves",
            "Points",
            "FaceSet",
            "P",
            "uv",
            "N (which corners share one)",
            "pointIds",
            "arbGeomParams",
            "velocities",
            "visible (a line names what is hidden)",
            "time samplings",
        ),
        (
            "parameters of text that change",
            "parameters of 64-bit integers and boxes",
            "userProperties",
            "widths",
            "creases and corners",
            "holes",
            "options of subdivision",
            "cameras",
            "lights",
            "objects of other schemas",
            "transforms without shapes",
            "properties of objects",
            "archive properties",
        ),
        ("NuPatch", "HDF5-backed archives"),
        ("bounds", "sample counts", "animChans"),
    ),
    "usd": Specification(
        (
            "Mesh",
            "BasisCurves",
            "Points",
            "primvars",
            "velocities and accelerations",
            "names of materials",
            "GeomSubset",
            "skeletons (applied)",
            "implicit shapes (as polygons)",
            "instances (as objects)",
            "upAxis and metersPerUnit",
        ),
        (
            "shaders",
            "textures",
            "properties of materials",
            "lights",
            "Camera",
            "widths",
            "creases",
            "primvars of text that change",
            "other attributes",
            "relationships",
            "API schemas",
            "prims of purpose proxy and guide",
            "prims without geometry",
            "inactive prims",
            "variants that are not selected",
            "metadata of prims",
            "metadata of the stage",
        ),
        ("NurbsPatch",),
        ("extent",),
    ),
    "gltf": Specification(
        (
            "triangles",
            "points",
            "lines",
            "NORMAL (which corners share one)",
            "TEXCOORD_n",
            "COLOR_n",
            "names of materials",
            "skins (applied)",
            "morph targets (applied)",
            "animations",
        ),
        (
            "cameras",
            "other scenes",
            "meshes that the scene does not show",
            "nodes without meshes",
            "extensions that are not read",
            "extras",
            "asset.copyright",
        ),
        carried=("textures", "properties of materials"),
    ),
    "xdmf": Specification(
        ("Geometry", "Topology", "Time", "spatial collections", "Attribute of nodes, cells and grids"),
        ("Attribute of faces and edges", "Set", "Information"),
        ("Polyhedron",),
    ),
    **dict.fromkeys(("vtu", "vtp", "vtk", "pvtu", "pvd", "series"), _VTK),
    "exodus": Specification(
        (
            "coord",
            "connect",
            "node_num_map",
            "time_whole",
            "displacements",
            "eb_names",
            "nodal variables",
            "element variables",
        ),
        (
            "variables of sets, edges and the whole",
            "node sets",
            "side sets",
            "element attributes",
            "info_records",
            "qa_records",
            "other arrays",
        ),
    ),
    "ply": Specification(
        (
            "vertex x, y, z",
            "vertex nx, ny, nz (which corners share one)",
            "vertex red, green, blue",
            "vertex s, t",
            "face vertex_indices",
            "face texcoord",
            "face red, green, blue",
            "other properties of vertex",
            "other properties of face",
            "edge",
            "tristrips",
        ),
        ("other lists", "properties of edge", "other elements", "obj_info"),
        (),
        ("comments",),
    ),
    "stl": Specification(("facets",), ("names of solids", "attribute bytes"), (), ("normals of facets",)),
    "off": Specification(("vertices", "faces", "colours of faces"), (), ("COFF, NOFF, STOFF, 4OFF",), ("comments",)),
}
