"""The formats that come with pdecodec, one registration each."""

from __future__ import annotations

from pdecodec.formats.registry import Format, register_format


def register_built_in_formats() -> None:
    """Register every format of this package; their modules load when they are first used."""
    register_format(
        Format(
            name="pdeanim",
            title="pdecodec animation",
            extensions=(".pdeanim",),
            magic=(b"\x89PDEANIM\r\n\x1a\n",),
            reader="pdecodec.formats.pdeanim:open_pdeanim",
            write_with="pdecodec.encoder.encode (`pdecodec encode`)",
            holds_transforms=True,
            keeps="whatever its source held",
            loses="positions are within the error bound asked for",
        )
    )
    register_format(
        Format(
            name="obj",
            title="Wavefront OBJ, one file a frame",
            extensions=(".obj",),
            reader="pdecodec.formats.obj:open_obj",
            writer="pdecodec.formats.obj_writer:write_obj",
            frame_per_file=True,
            keeps="objects, faces, lines, main UV set with seams, vertex colours, groups, materials, smoothing groups, "
            "times (in a comment)",
            loses="other attributes, up axis and unit",
        )
    )
    register_format(
        Format(
            name="npz",
            title="NumPy archive",
            extensions=(".npz",),
            magic=(b"PK\x03\x04",),
            reader="pdecodec.formats.npz:open_npz",
            writer="pdecodec.formats.npz:write_npz",
            holds_transforms=True,
            keeps="everything",
        )
    )
    register_format(
        Format(
            name="hdf5",
            title="HDF5",
            extensions=(".h5", ".hdf5"),
            magic=(b"\x89HDF\r\n\x1a\n",),
            reader="pdecodec.formats.hdf5:open_hdf5",
            writer="pdecodec.formats.hdf5:write_hdf5",
            holds_transforms=True,
            keeps="everything",
        )
    )
    register_format(
        Format(
            name="mdd",
            title="MDD point cache",
            extensions=(".mdd",),
            reader="pdecodec.formats.mdd:open_mdd",
            writer="pdecodec.formats.mdd:write_mdd",
            options=("mesh",),
            keeps="positions, times (float32)",
            loses="faces, names and attributes; they come from --mesh",
        )
    )
    register_format(
        Format(
            name="pc2",
            title="PC2 point cache",
            extensions=(".pc2",),
            magic=(b"POINTCACHE2\0",),
            reader="pdecodec.formats.pc2:open_pc2",
            writer="pdecodec.formats.pc2:write_pc2",
            options=("mesh",),
            keeps="positions, start and step in frames",
            loses="the frame rate, irregular times; faces, names and attributes come from --mesh",
        )
    )
    register_format(
        Format(
            name="alembic",
            title="Alembic",
            extensions=(".abc",),
            magic=(b"Ogawa",),
            shared_magic=(b"\x89HDF\r\n\x1a\n",),
            reader="pdecodec.formats.alembic:open_alembic",
            writer="pdecodec.formats.alembic_writer:write_alembic",
            extra="abc",
            options=("transforms", "skip_unsupported"),
            holds_transforms=True,
            holds_velocities=True,
            keeps="the tree and its names, faces, subdivision surfaces, curves, points, UV sets with seams, colours, "
            "face sets, constant parameters, transforms (--transforms keep), instances as objects, irregular "
            "times, velocities (written)",
            loses="normals, stored velocities, parameters that change, cameras and lights, NURBS, changing "
            "connectivity, files of the HDF5 kind",
        )
    )
    register_format(
        Format(
            name="usd",
            title="USD",
            extensions=(".usd", ".usda", ".usdc", ".usdz"),
            magic=(b"PXR-USDC", b"#usda 1.0"),
            shared_magic=(b"PK\x03\x04",),
            reader="pdecodec.formats.usd:open_usd",
            writer="pdecodec.formats.usd_writer:write_usd",
            extra="usd",
            options=("transforms", "skip_unsupported"),
            holds_transforms=True,
            holds_velocities=True,
            keeps="the tree and its names, faces, subdivision surfaces, curves, points, UV sets with seams, colours, "
            "other constant primvars, face subsets and material names, transforms (--transforms keep), irregular "
            "times, up axis, unit, velocities (written); UsdSkel and blend shapes are applied",
            loses="normals, stored velocities, primvars that change, creases, cameras and lights, materials but for "
            "their names, implicit shapes, point instancers, changing connectivity",
        )
    )
    register_format(
        Format(
            name="gltf",
            title="glTF",
            extensions=(".glb", ".gltf"),
            magic=(b"glTF",),
            reader="pdecodec.formats.gltf:open_gltf",
            writer="pdecodec.formats.gltf_writer:write_gltf",
            options=("clip", "transforms"),
            keeps="the tree and its names, faces and vertex order (noted beside the triangles), UV sets with seams, "
            "vertex colours, material names, lines, points, frame rate, times (float32); skins, morph targets and "
            "moving nodes are applied at --fps",
            loses="face groups, normals, other attributes; the scene is turned Y-up",
        )
    )
    _register_scientific_formats()


def _register_scientific_formats() -> None:
    register_format(
        Format(
            name="xdmf",
            title="XDMF and HDF5",
            extensions=(".xdmf", ".xmf"),
            reader="pdecodec.formats.xdmf:open_xdmf",
            writer="pdecodec.formats.xdmf:write_xdmf",
            keeps="faces, lines, times",
            loses="names of objects, attributes, up axis and unit; changing connectivity",
        )
    )
    register_format(
        Format(
            name="pvd",
            title="ParaView collection of VTU files",
            extensions=(".pvd",),
            reader="pdecodec.formats.pvd:open_pvd",
            writer="pdecodec.formats.vtu_writer:write_pvd",
            keeps="faces, lines, times, vertex colours (written)",
            loses="names of objects (numbers stay, as point data), other attributes, up axis and unit",
        )
    )
    register_format(
        Format(
            name="vtu",
            title="VTK unstructured grid, one file a frame",
            extensions=(".vtu",),
            reader="pdecodec.formats.meshio_files:open_vtu",
            writer="pdecodec.formats.vtu_writer:write_vtu",
            frame_per_file=True,
            keeps="faces, lines, vertex colours (written)",
            loses="names of objects (numbers stay, as point data), other attributes, times (frames are numbered)",
        )
    )
    register_format(
        Format(
            name="vtp",
            title="VTK polygonal data, one file a frame",
            extensions=(".vtp",),
            reader="pdecodec.formats.vtp:open_vtp",
            frame_per_file=True,
            write_with="a .vtu or .pvd file",
            keeps="faces, lines, points",
            loses="data of points and cells, triangle strips, times (frames are numbered)",
        )
    )
    register_format(
        Format(
            name="vtk",
            title="VTK legacy file, one a frame",
            extensions=(".vtk",),
            reader="pdecodec.formats.meshio_files:open_vtk",
            frame_per_file=True,
            write_with="a .vtu or .pvd file",
            keeps="faces, lines",
            loses="data of points and cells, times (frames are numbered)",
        )
    )
    register_format(
        Format(
            name="exodus",
            title="Exodus II",
            extensions=(".e", ".exo", ".ex2"),
            shared_magic=(b"\x89HDF\r\n\x1a\n",),
            reader="pdecodec.formats.exodus:open_exodus",
            write_with="a .xdmf file",
            keeps="shells, surfaces and bars, times, displacements",
            loses="other variables, names of blocks, volume elements",
        )
    )
    register_format(
        Format(
            name="ply",
            title="PLY, one file a frame",
            extensions=(".ply",),
            reader="pdecodec.formats.meshio_files:open_ply",
            writer="pdecodec.formats.ply_writer:write_ply",
            frame_per_file=True,
            keeps="faces, vertex colours (8 bits)",
            loses="names of objects, UVs, lines, other attributes, times (frames are numbered)",
        )
    )
    register_format(
        Format(
            name="stl",
            title="STL, one file a frame",
            extensions=(".stl",),
            reader="pdecodec.formats.soup_files:open_stl",
            frame_per_file=True,
            write_with="a .ply file",
            keeps="triangles, three vertices each",
            loses="normals, times (frames are numbered)",
        )
    )
    register_format(
        Format(
            name="off",
            title="OFF, one file a frame",
            extensions=(".off",),
            reader="pdecodec.formats.soup_files:open_off",
            frame_per_file=True,
            write_with="a .ply file",
            keeps="faces, lines",
            loses="colours and normals, times (frames are numbered)",
        )
    )
