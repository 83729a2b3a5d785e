"""Write USD stages: one prim per object, in the tree of the objects' names, with points sampled at every frame.

A file is saved after every block of frames, so that memory does not grow with the clip.
"""

from __future__ import annotations

import os
import shutil
import struct
import time
import zipfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from pdecodec.errors import Notice
from pdecodec.formats.base.attribute_roles import direction_role, is_velocity
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.rigid_motion import rigid_parts
from pdecodec.formats.base.scene_space import UNIT, UP_AXIS, metres_per_unit, up_axis_of
from pdecodec.formats.base.scene_writing import (
    ShapeKey,
    ShapeWriter,
    path_steps,
    renamed,
    shape_keys,
    tree_paths,
    write_shapes,
)
from pdecodec.formats.base.times import codes_of
from pdecodec.formats.base.transforms import matrices_at, transform_of
from pdecodec.formats.usd.attributes import NORMALS
from pdecodec.formats.usd.attributes_writer import ExtrasWriter, FieldsWriter, int_array
from pdecodec.formats.usd.metadata import (
    ADDED,
    METADATA,
    NAME,
    SAMPLED,
    TIME_CODE_RATE,
    TIME_RANGE,
    object_name,
    time_code_rate,
    time_range,
    valid_name,
)
from pdecodec.formats.usd.samples import StaticStart, hold_frames
from pdecodec.formats.usd.shapes import SUBDIVISION_SCHEMES
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import Attribute, MeshObject, MeshSequence
from pdecodec.system.whole_output import check_writable, move_into, partial_folder, write_errors, write_failure

ROOT = "scene"
"""Name of a root prim that is added if the tree has several roots: a stage has one default prim."""

USD_METRES = 0.01
"""Length of a unit [m] if a stage does not state it, by USD's rule."""

MAX_STREAMED_BYTES = 2_000_000_000
"""Bytes of a layer beyond which Python's archives have 64-bit sizes, which USD does not read."""

ZIP_HEADER_BYTES, PACKAGE_ALIGNMENT = 34, 64
"""Bytes before a file's name and padding in an archive, including the padding's own header; and USD's alignment
of data.
"""

PADDING_FIELD = 0x1986
"""Number of the field that pads headers in USD's packages."""

COPIED_BYTES = 2**20
"""Bytes that are copied at a time."""

_SCHEMAS = {"mesh": UsdGeom.Mesh, "curves": UsdGeom.BasisCurves, "points": UsdGeom.Points}

_BASES = {"bezier": "bezier", "bspline": "bspline", "catmullrom": "catmullRom"}


def write_usd(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write a stage: text if the name ends in ``.usda``, else binary; in a package for ``.usdz``."""
    path = output.path
    moved: tuple[str, ...] = ()
    if output.velocities is None and len(sequence.runs) == 1 and not any(map(direction_role, sequence.fields)):
        sequence, moved = rigid_parts(sequence, output.rigid)
    check_writable(path, overwrite=output.overwrite)
    with stage_folder(output) as folder:
        file = layer_file(folder, path)
        # Text is saved whole, so it is made from a binary layer that is saved block by block.
        layer = file.with_suffix(".usdc")
        notices = _Stage(sequence, Usd.Stage.CreateNew(str(layer)), output).write()
        if layer != file:
            Sdf.Layer.FindOrOpen(str(layer)).Export(str(file))
        if file.name != path.name:
            file = packed(file, path, alone=True)
        move_into(file, path, overwrite=output.overwrite)
    return (*moved, *notices)


@contextmanager
def stage_folder(output: Output) -> Iterator[Path]:
    """Provide a folder for incomplete output; turn USD's exceptions into InputError."""
    with partial_folder(output.path) as folder, write_errors(output.path):
        try:
            yield folder
        except Tf.ErrorException as error:
            reason = str(error).strip().splitlines()[-1].strip()
            raise write_failure(output.path, folder, f"USD says {reason}") from error


def layer_file(folder: Path, path: Path) -> Path:
    """Return where in a folder to write the layer that becomes `path`, or that its package holds."""
    return folder / (f"{valid_name(path.stem)}.usdc" if path.suffix.lower() == ".usdz" else path.name)


def packed(file: Path, path: Path, *, alone: bool = False) -> Path:
    """Make the package of a layer, next to it, named like `path`; `alone` if the layer refers to no other file."""
    package = file.with_name(path.name)
    if alone and file.stat().st_size < MAX_STREAMED_BYTES:
        _stream_package(file, package)
        return package
    # Packages store the time at which their files were written; a fixed time makes equal input give equal bytes.
    oldest = time.mktime((1980, 1, 1, 0, 0, 0, 0, 1, -1))
    for one in file.parent.rglob("*"):
        os.utime(one, (oldest, oldest))
    # USD does not report that it could not write the end of the package.
    if not (UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(file)), str(package)) and zipfile.is_zipfile(package)):
        raise write_failure(path, file.parent, "USD says it cannot make this package")
    return package


def _stream_package(file: Path, package: Path) -> None:
    """Write an archive that holds one uncompressed file, aligned: USD's own function maps the file and is slower."""
    entry = zipfile.ZipInfo(file.name)
    entry.file_size = file.stat().st_size
    padding = -(ZIP_HEADER_BYTES + len(file.name.encode())) % PACKAGE_ALIGNMENT
    entry.extra = struct.pack("<HH", PADDING_FIELD, padding) + bytes(padding)
    with zipfile.ZipFile(package, "w") as archive, archive.open(entry, "w") as target, file.open("rb") as source:
        shutil.copyfileobj(source, target, COPIED_BYTES)


class _Stage:
    """A stage that is being written."""

    def __init__(self, sequence: MeshSequence, stage: Any, output: Output) -> None:
        self._sequence, self._stage, self._output = sequence, stage, output
        self.notices: list[str] = []
        keys = shape_keys(sequence)
        paths, _ = tree_paths([key.name for key in keys], valid_name)
        self._rate = time_code_rate(sequence.metadata.get(TIME_CODE_RATE), output.rate)
        self._describe(paths)
        changes = len(sequence.runs) > 1
        prims = [stage.GetPrimAtPath(self._make_path(key, steps)) for key, steps in zip(keys, paths, strict=True)]
        # Report names that USD cannot hold; the original is stored in custom data only if no number was appended.
        self.notices += renamed((key.name, object_name(prim)) for key, prim in zip(keys, prims, strict=True))
        self._shapes = {
            key: _PrimWriter(prim, key, self._rate, changes=changes) for key, prim in zip(keys, prims, strict=True)
        }

    def write(self) -> tuple[str, ...]:
        for times in write_shapes(self._sequence, self._output, "USD", self._shapes):
            hold_frames(self._shapes.values(), codes_of(times, self._rate).tolist())
            self._stage.GetRootLayer().Save()
        told = dict.fromkeys(notice for shape in self._shapes.values() for notice in shape.notices)
        return (*self.notices, *told)

    def _describe(self, paths: Sequence[tuple[str, ...]]) -> None:
        sequence, stage = self._sequence, self._stage
        lasts = time_range(sequence.metadata.get(TIME_RANGE), sequence.times)
        first, last = codes_of(np.array(lasts), self._rate).tolist()
        stage.SetTimeCodesPerSecond(self._rate)
        stage.SetMetadataByDictKey("customLayerData", SAMPLED, True)
        stage.SetFramesPerSecond(self._output.rate)
        stage.SetStartTimeCode(first)
        stage.SetEndTimeCode(last)
        axis, metres = up_axis_of(sequence), metres_per_unit(sequence)
        if axis == "X":
            text = "USD has no up axis X: none is written, and programs assume Y"
            self.notices.append(Notice(text, setting="up_axis", purpose="to turn it"))
        # Metadata that the sequence does not state is not authored, because a reader would take it for a fact.
        if axis in ("Y", "Z"):
            UsdGeom.SetStageUpAxis(stage, axis)
        elif axis is None:
            text = "the up axis is not recorded: programs assume Y"
            self.notices.append(Notice(text, setting="up_axis", purpose="to say it"))
        if metres is not None:
            UsdGeom.SetStageMetersPerUnit(stage, metres)
        else:
            text = f"the length of a unit is not recorded: programs assume {USD_METRES} m, one hundredth of a metre"
            self.notices.append(Notice(text, setting="unit", value="m", purpose="to say it"))
        layer = stage.GetRootLayer()
        data = dict(layer.customLayerData)
        known = {TIME_RANGE, TIME_CODE_RATE} | ({UP_AXIS} if axis in ("Y", "Z") else set())
        known |= {UNIT} if metres is not None else set()
        rest = {key: text for key, text in sequence.metadata.items() if key not in known}
        if rest:
            data[METADATA] = rest
        layer.customLayerData = data
        roots = {steps[0] for steps in paths}
        self._root = Sdf.Path.absoluteRootPath
        if len(roots) > 1:
            root = UsdGeom.Xform.Define(stage, f"/{ROOT}").GetPrim()
            root.SetCustomDataByKey(ADDED, True)
            self._root = root.GetPath()
            stage.SetDefaultPrim(root)

    def _make_path(self, key: ShapeKey, steps: tuple[str, ...]) -> Any:
        """Return the path of a shape's prim; make missing ancestors."""
        path = self._root
        names = path_steps(key.name)
        for index, step in enumerate(steps):
            path = path.AppendChild(step)
            last = index == len(steps) - 1
            prim = self._stage.GetPrimAtPath(path)
            if not prim:
                kind = _SCHEMAS[key.kind] if last else UsdGeom.Xform
                prim = kind.Define(self._stage, path).GetPrim()
                if index < len(names) and valid_name(names[index]) != names[index]:
                    prim.SetCustomDataByKey(NAME, names[index])
                    prim.SetDisplayName(names[index])
            if index == 0 and not self._stage.HasDefaultPrim():
                self._stage.SetDefaultPrim(prim)
        return path


def vectors(rows: Float32Array) -> Any:
    """Return rows (n, 3) as Vt.Vec3fArray."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows))


class _PrimWriter(ShapeWriter):
    """Writer of one shape: its prim, and samples frame by frame.

    If there are several runs, connectivity and attributes are samples at the first frame of each run.
    """

    def __init__(self, prim: Any, key: ShapeKey, rate: float, *, changes: bool) -> None:
        super().__init__(key, "USD", changes=changes)
        self._rate, self._prim = rate, prim
        self._geometry = _SCHEMAS[key.kind](prim)
        self._points = self._geometry.CreatePointsAttr()
        self._extent = self._geometry.CreateExtentAttr()
        self._extras, self._fields = ExtrasWriter(prim), FieldsWriter(prim)
        self._normals: Any = None
        self._transform: Attribute | None = None
        self._op: Any = None
        self.static, self.vertices = StaticStart(), 0
        self._first: Any = None
        """Time code at which the first run begins, or USD's code for values without samples"""
        self._at: Any = None
        """Time code at which this run begins, or USD's code for values without samples"""
        if key.kind == "mesh":
            schemes = {ours: theirs for theirs, ours in SUBDIVISION_SCHEMES.items()}
            self._geometry.CreateSubdivisionSchemeAttr(schemes.get(key.subdivision or "", "none"))
        elif key.kind == "curves":
            self._describe_curves()

    def begin(self, item: MeshObject, times: Float64Array) -> None:
        super().begin(item, times)
        self.vertices = item.vertex_count
        ends = [Usd.TimeCode(code) for code in codes_of(times[[0, -1]], self._rate).tolist()]
        ends = ends[: times.size] if self.changes else [Usd.TimeCode.Default()]
        self._at = ends[0]
        if self._first is None:
            self._first = self._at
        if self.changes and not item.vertex_count:
            self._points.Set(Vt.Vec3fArray(), self._at)
        elif not self.changes:
            self._transform = transform_of(item)
        if self._transform is not None:
            self._geometry.SetResetXformStack(True)
            self._op = self._geometry.AddTransformOp()
        self._describe()
        self.notices += self._extras.write(item, self.drawn, self.in_samples, ends)

    def write(self, points: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        if not points.shape[1]:
            if not self.changes:
                self._points.Set(Vt.Vec3fArray())
            elif speeds is not None:
                self._geometry.CreateVelocitiesAttr().Set(Vt.Vec3fArray(), self._at)
            return
        codes = codes_of(times, self._rate).tolist()
        self._fields.write(
            [one for one in self.fields if speeds is None or not is_velocity(one[0])], codes, self._first
        )
        velocities: Any = None if speeds is None else self._geometry.CreateVelocitiesAttr()
        # Outside of a change block, every value that is set notifies the stage.
        with Sdf.ChangeBlock():
            self._write_points(*self.static.needed(points, codes, every=speeds is not None or self.changes))
            if speeds is not None:
                for code, row in zip(codes, speeds, strict=True):
                    velocities.Set(vectors(row), code)
            if self._transform is None or self._op is None:
                return
            matrices = matrices_at(self._transform, times).reshape(-1, 16).tolist()
            if len(self._transform.values) == 1:
                self._op.Set(Gf.Matrix4d(*matrices[0]))
                return
            for code, numbers in zip(codes, matrices, strict=True):
                self._op.Set(Gf.Matrix4d(*numbers), code)
            self.static.codes = codes

    def hold(self, codes: Sequence[float]) -> None:
        self._write_points(self.static.held(codes), [*codes])

    def _write_points(self, points: Float32Array, codes: list[float]) -> None:
        for frame, (code, normals) in enumerate(zip(codes, self.normals_at(points), strict=True)):
            # Coordinate by coordinate, because minima along rows of three are ten times slower.
            axes = np.ascontiguousarray(points[frame].T)
            self._points.Set(vectors(points[frame]), code)
            self._extent.Set(vectors(np.stack([axes.min(axis=1), axes.max(axis=1)])), code)
            if normals is not None:
                self._normals.Set(vectors(normals), code)

    def _describe(self) -> None:
        """Write faces, curves or ids of points, which are constant within a run."""
        connectivity, geometry, at = self.item.connectivity, self._geometry, self._at
        if self.key.kind == "mesh":
            geometry.CreateFaceVertexCountsAttr().Set(int_array(connectivity.face_counts), at)
            geometry.CreateFaceVertexIndicesAttr().Set(int_array(connectivity.face_indices), at)
            self._describe_normals()
        elif self.key.kind == "curves":
            geometry.CreateCurveVertexCountsAttr().Set(int_array(connectivity.line_counts), at)
        numbers = self.numbered_points(np.iinfo(np.int64).max)
        if numbers is not None:
            geometry.CreateIdsAttr().Set(Vt.Int64Array.FromNumpy(np.ascontiguousarray(numbers, np.int64)), at)

    def _describe_normals(self) -> None:
        """Normals are per vertex if possible; if connectivity changes, always per corner, because their
        interpolation is stored once.
        """
        if self.normals is None:
            if self._normals is not None:
                self._normals.Set(Vt.Vec3fArray(), self._at)
                self._normals.SetIndices(Vt.IntArray(), self._at)
        elif self.normals.is_smooth and not self.changes:
            self._normals = self._geometry.CreateNormalsAttr()
        else:
            if self._normals is None:
                kind = Sdf.ValueTypeNames.Normal3fArray
                self._normals = UsdGeom.PrimvarsAPI(self._geometry).CreatePrimvar(NORMALS, kind, "faceVarying")
                if self._first != self._at:
                    self._normals.Set(Vt.Vec3fArray(), self._first)
                    self._normals.SetIndices(Vt.IntArray(), self._first)
            self._normals.SetIndices(int_array(self.normals.corner_rows), self._at)

    def _describe_curves(self) -> None:
        geometry, basis = self._geometry, self.key.curve_basis or "linear"
        cubic = _BASES.get(basis.removeprefix("cubic "))
        geometry.CreateTypeAttr("cubic" if cubic else "linear")
        if cubic:
            geometry.CreateBasisAttr(cubic)
        elif basis != "linear":
            self.notices.append(f"curves of object {self.key.name!r} are written as lines, not as {basis}")
        wrap = self.key.curve_wrap
        geometry.CreateWrapAttr(wrap if wrap in ("periodic", "pinned") else "nonperiodic")
