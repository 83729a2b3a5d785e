"""Write the table of formats as Markdown: `python docs/make_formats.py docs/formats.md` (or `make docs`)."""

from __future__ import annotations

import sys
from pathlib import Path

from pdecodec.formats import Format, list_formats
from pdecodec.formats.specifications import SPECIFICATIONS

HEAD = """\
# Formats

Written by `make docs` from the registry of formats; do not edit.

A file's format is found by its extension, or else by its first bytes. When a file is written, notes name everything
that its format cannot store. Positions and times are preserved to float32 precision or better, unless noted.

| format | extensions | read | write | needs |
|---|---|---|---|---|
"""

CONVENTIONS = """\
## What passes between formats

- **Names.** An object of a scene tree is named by its path, `root/arm/hand`. Formats with trees turn it into a tree.
- **UVs.** The main set is the attribute `uv`, others are `uv:NAME`; both belong to corners. Corners that share a
  row still share it afterwards, so seams are preserved. The origin is at the bottom (glTF's is flipped).
- **Colours** are `color` and `color:NAME`, of vertices, faces, corners or the object. **Face sets** are `group`, one
  number per face with names, or, if sets share faces, `group:NAME`, one or zero per face; **materials** are `material`.
- **Hard edges** are `normal_group`, one number per corner: corners of a vertex with equal numbers share a normal.
  Normals themselves are computed from the positions of each frame, and written if the source had normals or smoothing
  groups. Otherwise glTF, which shows faces without normals flat, gets smooth normals, or none if all faces are flat
  triangles. glTF cuts vertices at hard edges, UV seams and material borders. They stay cut. Vertices that a glTF, USD,
  Alembic, OBJ or PLY file cuts, and that are together and share a normal at all times, have one number in
  `shared_normal` and share a normal in every frame. USD, Alembic, OBJ and PLY are looked at at four frames. A note
  gives the number of normals of a glTF, USD or Alembic file that differ by more than 5 degrees from those computed
  from its faces. Formats with one normal per vertex get normals only for meshes without hard edges. No conversion
  keeps normals that were made by hand or taken from another mesh: positions change from frame to frame, and such
  normals belong to the frame that stores them.
- **Size of glTF.** Unless the motion has few functions of time, each frame is a morph target. Positions and normals of
  targets are float32 there, and viewers do not compute smooth normals: 24 bytes per row and frame, twice the positions.
  `--quantize` (KHR_mesh_quantization, which viewers must support) makes it 12: positions of 16 bits, normals of 8, at
  most 0.4 degrees off, each in rows of a multiple of four bytes; with `--meshopt`, 2 to 8. Where targets are functions
  of time, rounding adds up (to 5.8 degrees in the shared sequences): normals of such targets have 16 bits where 8 are
  more than 0.4 degrees off, and are at most 0.03 degrees off there. A note gives the error, and another one tells if a
  file is larger than its source; `--web` is `--quantize --meshopt --rigid`.
- **Motion inside glTF.** With `--motion`, meshes that change shape have no targets: a `.pdeanim` file in a buffer
  view moves them ([PDECODEC_mesh_motion](../spec/extension/README.md)), within `--tolerance` or `--max-error`.
  Vertices that are together at all frames are welded in it; the glTF file's vertices and triangles stand in its
  order. So polygons come back as triangles, vertices cut at seams stay cut, and their order is another one. Rigid
  objects stay moving nodes; with `--no-rigid` the motion moves them, too, which often makes smaller files. With
  `--web`, the shape that other viewers show is rounded within the bound, UVs to 1/4096 and normals to 8 bits;
  the motion keeps its bound. That of a `.pdeanim` file is stored without encoding it again, unless a bound is given.
  It goes into the scene that the file carries, or into ORIGINAL of `--onto`. These files are read like any other.
  Sizes: [web](web.md).
- **Materials of glTF**: `convert` from glTF to glTF keeps them with textures, images and extensions, by their names,
  and so does `decode --onto`. If several materials share a name, the first is used.
- **Faces** run counterclockwise seen from outside; faces of Alembic and of left-handed USD meshes are reversed,
  and so are those of objects whose applied transform mirrors them.
- **Time** is in seconds. The frame rate is the file's (in glTF the one that all keys show, from 12 a second), else
  `--fps`, else 24 with a note. Irregular times stay irregular. glTF's animations are written to start at
  0 s: another first time is stored there and restored, with a note. Scenes have a value at any time: glTF's
  animations are sampled at the rate, their last key included, and a note counts keys between frames;
  Alembic and USD give the samples that they store, USD's transforms and skeletons also what lies between these at the
  stage's frame rate, and both are sampled at `--fps` where it is given, exact where a stored sample is on a frame. In
  `wolf-1.obj` the hyphen belongs to the name; it is a minus sign after `.` or `_`, or next to frames without one.
- **Transforms** above objects are applied to positions, or stored (`--transforms keep`) as the attribute `transform`:
  rows of a time and a matrix. Meshes that move rigidly, to two units in the last place of float32, are written to glTF,
  USD and Alembic as one shape under transforms; with `--rigid` those of a `.pdeanim` file that do so within its bound,
  too. For Alembic and glTF this is the default (`--no-rigid` turns it off). Between frames, glTF's nodes move straight
  and turn evenly, and a mesh of several such parts, each of connected faces, becomes a skin whose joints are the parts:
  1,309 frames of 34,159 vertices of a robot take 4.4 MB and no morph target. Formats without transforms get positions
  with transforms applied, and faces reversed where one mirrors. `pdecodec.bake_transforms` does so at any time.
- **Alembic as programs show it**: each shape has a transform of its own right above it, by which programs name the
  object; one that was added for that does not show in names here. Colours of a mesh are of its vertices, or of its
  corners with a lookup, where programs know no others; those of faces and objects come back as what they were. Face
  sets are materials, as Blender shows them; groups of a mesh that has materials are a parameter. Where face sets of
  another program share faces, the last one by name is the material of a face, and the sets are groups besides.
- **Onto an original** (`decode --onto`, `write_onto`): glTF, USD, Alembic, OBJ and Exodus files are written again with
  all that they have, whether it is read here or not, and another motion. Objects must be those of the original; those
  of one name are taken in order. Normals are computed anew where it has some; transforms stay, and positions are
  brought into the spaces of their shapes. Skeletons and blend shapes stay and no longer deform what is moved. USD: the
  root layer is copied, other files are named from the new place; `--layer` writes points, normals and velocities
  alone, over the original as a sublayer. glTF: meshes under nodes that move, and those that move rigidly, go to the
  scene's root, and tangents are left out. Alembic: properties that its Python library has no type for, and bounds of
  children, are left out, with a note; moved instances become separate objects. OBJ: every frame is the original's
  first with other numbers. Exodus: nodes keep their coordinates and get other displacements; other variables have the
  values of the original's step before.
- **Positions** are float32; what is stored as float64, as text, or comes from transforms is rounded. `encode`,
  `convert` and `compare` print how far that moves positions if it exceeds the bound, or a millionth of the diagonal,
  as in scenes far from their origin. It is not measured for OFF and STL text, nor for OBJ nearer to the origin.
- **What moves a simulation** (VTK, XDMF, Exodus): geometry that the file stores for every step; in Exodus the nodal
  variables that its own programs take for displacements (of every axis, beginning with `disp`); or the vectors on
  nodes that `--displacement NAME` adds to the geometry, `none` for none. Nothing else does, whatever its name: a note
  lists the vectors that could, and says which ones moved it.
- **Values that were never written** (missing sources of virtual HDF5 datasets, chunks that no program wrote, netCDF's
  fill value) are refused; HDF5 would give zeros for them.
- **Connectivity that changes** is runs of frames, each of one connectivity: Alembic, USD, OBJ, PLY, VTU and PVD are
  read as such and written from them. Between the last frame of a run and the first of the next one, the mesh keeps the
  last positions. Frames without vertices are left out, with a note. In Alembic and USD an object is one shape, empty
  where a run does not have it; its transforms are applied, points have ids, and attributes are samples of their run.
- **Vertex animation textures.** `decode walk.pdeanim -o walk.vat` and `convert walk.abc walk.vat` write, next to a list
  of the files, the mesh `walk.glb` in its first frame, and what [OpenVAT](https://github.com/sharpen3d/openvat) writes
  for its shaders in Unreal, Unity and Godot: offsets of positions `walk_vat.png`, separate normals `walk_vnrm.png`, and
  the range of the offsets `walk-remap_info.json`. The second UV set points to the texels; objects share the textures.
  Positions are within half a step of 16 bits of the range. Import the textures as linear data, without compression,
  mipmaps or filtering. Long clips become parts `walk_1`, `walk_2`, ... for the same mesh, each with a range of its own;
  each begins with the last frame of the part before. Tests evaluate the textures as the shaders do; no engine was run.
- **Time that writing takes**, relative to decoding and writing raw float32 positions (200 frames of 35,400 vertices in
  59 objects, measured as time of the processor): point caches, NPZ, HDF5, XDMF and PLY as long, VTU 1.6 times (each
  file repeats the faces), Alembic 2 times, OBJ, which is text, 9 times. Normals are as many bytes again and are
  computed: 5 times with XDMF and PLY, 6 with Alembic and VTU.
- **Up axis and unit** are the metadata `up_axis` and `unit`, if a file states them. `--up-axis` rotates the scene,
  `--scale` scales it and its unit, `--unit` gives a unit that the file does not state. USD files state only what is
  known; glTF and Alembic are Y-up, so other scenes are rotated, with a note.
"""


HELD = """\
## What each format can hold, and what becomes of it

The features of each format, in the words of its own specification, and what happens to them when a file is read. Coded:
kept, also through `.pdeanim` files. Carried: kept from a file to another of the same format (`convert`), otherwise
dropped. Dropped: left out, and a note names it. Refused: the file is refused, or with `--skip-unsupported` the object
is left out. Implied: it follows from the rest, or is meant for people who read the file. Tests read files with these
features and compare the results.

| format | coded | carried | dropped, by name | refused | implied |
|---|---|---|---|---|---|
"""


def formats_page() -> str:
    """Return the table of formats, then for each format what it keeps and loses."""
    entries = list_formats()
    rows = "".join(_row(entry) for entry in entries)
    parts = "\n".join(_part(entry) for entry in entries)
    held = "".join(_held(entry) for entry in entries if entry.name in SPECIFICATIONS)
    return f"{HEAD}{rows}\n{CONVENTIONS}\n{HELD}{held}\n## What each format keeps\n\n{parts}"


def _held(entry: Format) -> str:
    one = SPECIFICATIONS[entry.name]
    cells = (one.coded, one.carried, one.dropped, one.refused, one.implied)
    return f"| {entry.title} | {' | '.join(', '.join(cell) for cell in cells)} |\n"


def _row(entry: Format) -> str:
    extensions = ", ".join(f"`{extension}`" for extension in entry.extensions)
    writes = "yes" if entry.writes else entry.write_with or "no"
    needs = f"`pip install 'pdecodec[{entry.extra}]'`" if entry.extra else ""
    return f"| {entry.title} | {extensions} | {'yes' if entry.reads else 'no'} | {writes} | {needs} |\n"


def _part(entry: Format) -> str:
    lines = [f"### {entry.title}", "", f"Kept: {entry.keeps}."]
    if entry.loses:
        lines.append(f"Not kept: {entry.loses}.")
    if entry.options:
        names = ", ".join(f"`--{option.replace('_', '-')}`" for option in entry.options)
        lines.append(f"Reading takes {names}.")
    if entry.write_options:
        names = ", ".join(f"`--{option}`" for option in entry.write_options)
        lines.append(f"Writing takes {names}.")
    if entry.holds_velocities:
        lines.append("Velocities are written on request (`--velocities`).")
    return "\n".join([*lines, ""])


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(formats_page(), encoding="utf-8")
