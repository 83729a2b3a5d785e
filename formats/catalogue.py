"""List the formats that come with pdecodec; their modules load at first use."""

from __future__ import annotations

from pdecodec.formats.base.registry import Format

BUILT_IN = (
    Format(
        name="pdeanim",
        title="pdecodec animation",
        extensions=(".pdeanim",),
        magic=(b"\x89PDEANIM\r\n\x1a\n",),
        reader="pdecodec.formats.base.opening:open_pdeanim",
        from_address=True,
        write_with="pdecodec.encode (`pdecodec encode`)",
        holds_transforms=True,
        keeps="whatever its source held",
        loses="positions are within the error bound asked for",
    ),
    Format(
        name="obj",
        title="Wavefront OBJ, one file per frame",
        extensions=(".obj",),
        reader="pdecodec.formats.obj.reader:open_obj",
        writer="pdecodec.formats.obj.writer:write_obj",
        onto="pdecodec.formats.obj.onto:write_obj_onto",
        carrier="pdecodec.formats.obj.scene:ObjFamily",
        frame_per_file=True,
        holds_runs=True,
        holds_fields=True,
        keeps="objects, faces, lines, main UV set with seams, vertex colours, hard edges, groups, materials, smoothing "
        "groups, UVs and vertex colours that change (fields), times (in a comment)",
        loses="other attributes and fields, up axis and unit",
    ),
    Format(
        name="npz",
        title="NumPy archive",
        extensions=(".npz",),
        magic=(b"PK\x03\x04",),
        reader="pdecodec.formats.arrays.npz:NpzSequence",
        from_address=True,
        writer="pdecodec.formats.arrays.npz:write_npz",
        holds_fields=True,
        holds_transforms=True,
        holds_nothing=True,
        keeps="everything",
    ),
    Format(
        name="hdf5",
        title="HDF5",
        extensions=(".h5", ".hdf5"),
        magic=(b"\x89HDF\r\n\x1a\n",),
        reader="pdecodec.formats.arrays.hdf5:Hdf5Sequence",
        from_address=True,
        writer="pdecodec.formats.arrays.hdf5:write_hdf5",
        holds_fields=True,
        holds_transforms=True,
        holds_nothing=True,
        keeps="everything",
    ),
    Format(
        name="mdd",
        title="MDD point cache",
        extensions=(".mdd",),
        reader="pdecodec.formats.caches.point_caches:open_mdd",
        writer="pdecodec.formats.caches.point_caches:write_mdd",
        times="float32",
        options=("mesh",),
        keeps="positions, times (float32)",
        loses="faces, names and attributes; a mesh given with it supplies them",
    ),
    Format(
        name="pc2",
        title="PC2 point cache",
        extensions=(".pc2",),
        magic=(b"POINTCACHE2\0",),
        reader="pdecodec.formats.caches.point_caches:open_pc2",
        writer="pdecodec.formats.caches.point_caches:write_pc2",
        options=("mesh",),
        keeps="positions, start and step in frames",
        loses="the frame rate, irregular times; faces, names and attributes, which a mesh given with it supplies",
    ),
    Format(
        name="alembic",
        title="Alembic",
        extensions=(".abc",),
        magic=(b"Ogawa",),
        shared_magic=(b"\x89HDF\r\n\x1a\n",),
        reader="pdecodec.formats.alembic.reader:open_alembic",
        writer="pdecodec.formats.alembic.writer:write_alembic",
        onto="pdecodec.formats.alembic.onto:write_alembic_onto",
        carrier="pdecodec.formats.alembic.scene:AlembicFamily",
        times="microseconds",
        extra="abc",
        options=("transforms", "skip_unsupported"),
        holds_runs=True,
        holds_transforms=True,
        holds_velocities=True,
        holds_fields=True,
        write_options=("rigid",),
        finds_rigid_parts=True,
        keeps="the tree and its names, faces, subdivision surfaces, curves, points, UV sets with seams, colours, hard "
        "edges, face sets, other parameters, connectivity that changes, with the parameters of each run, ids of points "
        "that come and go, fields (parameters, UVs and colours that change, velocities), transforms (kept apart on "
        "request), instances as objects, irregular times",
        loses="text that changes, 64-bit integers, userProperties, widths, creases, holes, cameras, lights, "
        "transforms without shapes, NURBS, files of the HDF5 kind; notices name whatever is not kept",
    ),
    Format(
        name="usd",
        title="USD",
        extensions=(".usd", ".usda", ".usdc", ".usdz"),
        magic=(b"PXR-USDC", b"#usda 1.0"),
        shared_magic=(b"PK\x03\x04",),
        reader="pdecodec.formats.usd.reader:open_usd",
        companions="pdecodec.formats.usd.layers:layer_files",
        writer="pdecodec.formats.usd.writer:write_usd",
        onto="pdecodec.formats.usd.onto:write_usd_onto",
        carrier="pdecodec.formats.usd.scene:UsdFamily",
        times="microseconds",
        extra="usd",
        options=("transforms", "skip_unsupported"),
        holds_runs=True,
        holds_transforms=True,
        holds_velocities=True,
        holds_fields=True,
        write_options=("rigid",),
        keeps="the tree and its names, faces, subdivision surfaces, curves, points, UV sets with seams, colours, hard "
        "edges, other constant primvars, face subsets and material names, connectivity that changes, with the primvars "
        "of each run, ids of points, fields (primvars that change, velocities, accelerations), transforms (kept apart "
        "on request), irregular times, the stage's range, up axis, unit; UsdSkel and blend shapes are applied, "
        "implicit shapes become polygons, instances become objects",
        loses="text that changes, creases, tetrahedra except for their surface, widths, cameras "
        "and lights, materials except for their names, custom attributes, variants that are not selected, visibility, "
        "NURBS, instances that come and go",
    ),
    Format(
        name="gltf",
        title="glTF",
        extensions=(".glb", ".gltf"),
        magic=(b"glTF",),
        reader="pdecodec.formats.gltf.reader:GltfSequence",
        companions="pdecodec.formats.gltf.file:named_buffers",
        writer="pdecodec.formats.gltf.writer:write_gltf",
        onto="pdecodec.formats.gltf.onto:write_gltf_onto",
        carrier="pdecodec.formats.gltf.scene:GltfFamily",
        times="both",
        options=("clip", "transforms"),
        write_options=("web", "quantize", "meshopt", "straight", "rigid", "motion"),
        finds_rigid_parts=True,
        starts_at_zero=True,
        holds_fields=True,
        keeps="the tree and its names, faces and vertex order (stored next to the triangles), UV sets with seams, "
        "colours, hard edges, material names, face sets (as primitives, named in their extras), lines, points, frame "
        "rate, times (float32); skins, morph targets and moving nodes are applied at the frame rate; colours and UVs "
        "that targets change are fields, written as in the first frame; Draco and meshopt compression are read (pip "
        "install 'pdecodec[gltf]'), quantised values too; GPU instances become objects",
        loses="textures, materials except for their names, cameras, lights, other scenes and animations, extras, "
        "tangents, other attributes, other fields; the scene is turned Y-up",
    ),
    Format(
        name="vat",
        title="vertex animation textures",
        extensions=(".vat",),
        companions="pdecodec.formats.gltf.vertex_textures:named_files",
        written_beside="pdecodec.formats.gltf.vertex_textures:named_files",
        writer="pdecodec.formats.gltf.vertex_textures:write_vertex_textures",
        keeps="in the mesh what glTF keeps; in PNG textures of 16 bits, which OpenVAT's shaders read in Unreal, Unity "
        "and Godot, positions and normals of frames, in parts where these do not fit 4096 x 4096 texels",
        loses="lines, points, fields, irregular times; the scene is turned Y-up",
    ),
    Format(
        name="xdmf",
        title="XDMF and HDF5",
        extensions=(".xdmf", ".xmf"),
        reader="pdecodec.formats.vtk.xdmf:XdmfSequence",
        companions="pdecodec.formats.vtk.file_lists:named_by_xdmf",
        written_beside="pdecodec.formats.vtk.writer:data_file",
        options=("displacement", "solids"),
        writer="pdecodec.formats.vtk.xdmf_writer:write_xdmf",
        holds_fields=True,
        holds_cells=True,
        keeps="faces, lines, times, parts of spatial collections as objects, the surface of solids or all elements as "
        "cells, normals of smooth meshes (written), attributes of nodes, cells and grids (fields; those of temporal "
        "collections of the same meshes and times together); motion is the geometry of each step, or the vectors that "
        "a setting names",
        loses="names of objects (written), attributes of faces and edges of cells, of inner cells and of collections, "
        "degrees of freedom, sets (all named), fields on corners, other attributes, up axis and unit; changing "
        "connectivity",
    ),
    Format(
        name="pvd",
        title="ParaView collection of VTK's files",
        extensions=(".pvd",),
        reader="pdecodec.formats.vtk.files:open_pvd",
        companions="pdecodec.formats.vtk.file_lists:named_files",
        written_beside="pdecodec.formats.vtk.writer:listed_files",
        options=("displacement", "solids"),
        writer="pdecodec.formats.vtk.writer:write_pvd",
        holds_fields=True,
        holds_cells=True,
        holds_runs=True,
        keeps="faces, lines, times, vertex colours (written), normals of smooth meshes (written), data of "
        "points and cells (fields), the surface of solids or all cells; parts are joined; motion is the points of each "
        "step, or the vectors that a setting names",
        loses="names of objects (numbers stay, as point data), other attributes, fields on corners and objects, data "
        "that only some frames or parts have unless they are floats, up axis and unit",
    ),
    Format(
        name="vtu",
        title="VTK unstructured grid, one file per frame",
        extensions=(".vtu",),
        reader="pdecodec.formats.vtk.files:open_frame_files",
        options=("displacement", "solids"),
        writer="pdecodec.formats.vtk.writer:write_vtu",
        holds_fields=True,
        holds_cells=True,
        holds_runs=True,
        frame_per_file=True,
        keeps="faces, lines, vertex colours (written), normals of smooth meshes (written), the surface of solids or "
        "all cells, data of points and cells (fields), times (field data TimeValue, where every file has it); VTK "
        "reads what pdecodec itself cannot (pip install 'pdecodec[vtk]')",
        loses="names of objects (numbers stay, as point data), other attributes, fields on corners and objects",
    ),
    Format(
        name="vtp",
        title="VTK polygonal data, one file per frame",
        extensions=(".vtp",),
        reader="pdecodec.formats.vtk.files:open_frame_files",
        options=("displacement", "solids"),
        frame_per_file=True,
        write_with="a .vtu or .pvd file",
        keeps="faces, lines, points, data of points and cells (fields), times (field data TimeValue); VTK "
        "reads what pdecodec itself cannot (pip install 'pdecodec[vtk]')",
        loses="data of lines and vertices, text, data of files that VTK reads (named)",
    ),
    Format(
        name="vtk",
        title="VTK legacy file, one per frame",
        extensions=(".vtk",),
        reader="pdecodec.formats.vtk.files:open_frame_files",
        options=("displacement", "solids"),
        frame_per_file=True,
        write_with="a .vtu or .pvd file",
        keeps="faces, lines, the surface of solids or all cells, data of points and cells (fields); VTK reads what "
        "pdecodec itself cannot (pip install 'pdecodec[vtk]')",
        loses="text, data of files that VTK reads (named), times (frames are numbered)",
    ),
    Format(
        name="pvtu",
        title="VTK parallel and multi-block files, one per frame",
        extensions=(".pvtu", ".pvtp", ".vtm"),
        reader="pdecodec.formats.vtk.files:open_frame_files",
        companions="pdecodec.formats.vtk.file_lists:named_files",
        options=("displacement", "solids"),
        frame_per_file=True,
        write_with="a .vtu or .pvd file",
        keeps="what their parts keep; parts are joined, ghost cells left out",
        loses="text, data of files that VTK reads (named), times (frames are numbered)",
    ),
    Format(
        name="series",
        title="ParaView file series of VTK's files",
        extensions=(".series",),
        reader="pdecodec.formats.vtk.files:open_series",
        companions="pdecodec.formats.vtk.file_lists:named_files",
        options=("displacement", "solids"),
        write_with="a .pvd file",
        keeps="what its files keep, times",
        loses="data of lines and vertices, text, data of files that VTK reads (named)",
    ),
    Format(
        name="exodus",
        title="Exodus II",
        extensions=(".e", ".exo", ".ex2"),
        shared_magic=(b"\x89HDF\r\n\x1a\n",),
        reader="pdecodec.formats.vtk.exodus:ExodusSequence",
        onto="pdecodec.formats.vtk.exodus_onto:write_exodus_onto",
        carrier="pdecodec.formats.vtk.exodus_scene:ExodusFamily",
        options=("displacement", "solids"),
        writer="pdecodec.formats.vtk.exodus_writer:write_exodus",
        holds_fields=True,
        holds_cells=True,
        keeps="shells, polygons, bars, points, the surface of solids of every order or all elements as cells, nodes' "
        "numbers (attribute node), names of blocks (groups of faces, or the attribute block of cells), times, "
        "displacements (nodal variables of every axis that begin with disp, or those that a setting names), other "
        "nodal variables and element variables on faces or cells (fields; components are gathered to vectors, tensors "
        "and numbered ones); whole numbers stay what they are",
        loses="names of objects (blocks have them), element variables of inner elements and bars, other variables, "
        "names of sets and of blocks of lines (all named), nodes that are not on the surface, elements of splines, "
        "fields on corners and objects, other attributes, up axis and unit; changing connectivity; written lines are "
        "segments",
    ),
    Format(
        name="ply",
        title="PLY, one file per frame",
        extensions=(".ply",),
        reader="pdecodec.formats.obj.ply:open_ply",
        writer="pdecodec.formats.obj.ply_writer:write_ply",
        holds_runs=True,
        holds_fields=True,
        frame_per_file=True,
        keeps="faces, main UV set (of vertices, or of corners as lists of faces), colours of vertices and of faces (8 "
        "bits), normals of smooth meshes, all of which may change, other properties of vertices and faces (fields); "
        "edges as lines and strips are read",
        loses="names of objects, which corners share a UV, lines, other attributes and elements (named), fields on "
        "corners and objects, times (frames are numbered)",
    ),
    Format(
        name="stl",
        title="STL, one file per frame",
        extensions=(".stl",),
        reader="pdecodec.formats.obj.stl_off:open_stl",
        frame_per_file=True,
        write_with="a .ply file",
        keeps="triangles, three vertices each",
        loses="normals, solids and attribute bytes (named), times (frames are numbered)",
    ),
    Format(
        name="off",
        title="OFF, one file per frame",
        extensions=(".off",),
        reader="pdecodec.formats.obj.stl_off:open_off",
        frame_per_file=True,
        write_with="a .ply file",
        keeps="faces and their colours, lines",
        loses="colours of a map or of some faces (named), times (frames are numbered)",
    ),
)
