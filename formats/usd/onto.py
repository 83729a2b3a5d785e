"""Write motion onto USD: stronger opinions about points, normals and velocities, over an unchanged stage.

They go into a copy of the original's root layer, or into a separate layer that has the original as its sublayer.
Transforms stay; points are brought into the space of their prims. Skeletons and blend shapes stay too, but no longer
deform the moved prims; moved instances become separate prims.
"""

from __future__ import annotations

import os
import zipfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Sdf, Usd, UsdGeom, UsdSkel, UsdUtils

from pdecodec.errors import InputError, Notice
from pdecodec.formats.base.normals import NormalRows, normal_rows
from pdecodec.formats.base.onto import Fitted, ShapeOver, ShapePlacement, corner_order, write_over
from pdecodec.formats.base.registry import Output
from pdecodec.formats.base.times import codes_of
from pdecodec.formats.usd.attributes import NORMALS
from pdecodec.formats.usd.attributes_writer import int_array
from pdecodec.formats.usd.composition import warnings_hidden
from pdecodec.formats.usd.implicit import Implicit
from pdecodec.formats.usd.layers import check_package, usd_scope
from pdecodec.formats.usd.metadata import SAMPLED
from pdecodec.formats.usd.reader import UsdSequence
from pdecodec.formats.usd.samples import StaticStart, hold_frames
from pdecodec.formats.usd.writer import layer_file, packed, stage_folder, vectors
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import Connectivity, MeshSequence
from pdecodec.system.whole_output import check_writable, move_into


def write_usd_onto(
    sequence: MeshSequence, original: UsdSequence, fits: Sequence[Fitted], source: Path, output: Output
) -> tuple[str, ...]:
    """Write a copy of the original's root layer that moves its prims, or with ``output.layer`` a layer over it."""
    path = output.path
    check_writable(path, overwrite=output.overwrite)
    to_package, from_package = path.suffix.lower() == ".usdz", source.suffix.lower() == ".usdz"
    if to_package and output.layer:
        raise InputError(
            "a package does not hold a layer over another file; write a .usda or .usdc file", code="unsupported-feature"
        )
    place, below = path.parent.resolve(), original.root_layer
    # In the same folder, names of assets stay as they are.
    names: dict[str, str] = {}

    def anchored(text: str) -> str:
        found = _anchored(below, text)
        if place == source.parent.resolve():
            names[found] = text
        return found

    with warnings_hidden(), stage_folder(output) as folder:  # USD would warn of layers that are elsewhere
        file = layer_file(folder, path)
        if to_package and from_package:
            file = _unpacked(source, folder / "package")
            layer = Sdf.Layer.FindOrOpen(str(file))
        else:
            layer = Sdf.Layer.CreateNew(str(file))
            if output.layer:
                layer.subLayerPaths.append(below.identifier)
                for name in ("defaultPrim", "timeCodesPerSecond", "framesPerSecond", "upAxis", "metersPerUnit"):
                    _copy_setting(below, layer, name)
            else:
                layer.TransferContent(below)
                UsdUtils.ModifyAssetPaths(layer, anchored)
        _Over(sequence, original, fits, Usd.Stage.Open(layer), output).write()
        if to_package:
            check_package(file, usd_scope(source))
            file = packed(file, path)
        else:
            UsdUtils.ModifyAssetPaths(layer, lambda text: names.get(text) or _relative(text, place))
            # A binary file that is saved again would keep its previous content.
            file = file.with_name(f"whole{path.suffix}")
            layer.Export(str(file))
        move_into(file, path, overwrite=output.overwrite)
    return () if to_package else _notice(original, path, of_root=output.layer)


def _notice(original: UsdSequence, path: Path, *, of_root: bool) -> tuple[str, ...]:
    """Return a notice if layers that a new file refers to are outside its folder; `of_root` includes the root layer."""
    place = os.path.join(path.parent.resolve(), "")
    files = [one.realPath for one in original.layers if one.realPath and (of_root or one != original.root_layer)]
    folders = sorted({os.path.dirname(one) for one in map(os.path.realpath, files) if not one.startswith(place)})
    if not folders:
        return ()
    text = "layers that it names lie in another folder"
    return (Notice(text, setting="asset_folders", value=os.path.commonpath(folders), purpose="when it is read"),)


def _copy_setting(below: Any, layer: Any, name: str) -> None:
    """Copy a stage's setting from a layer to the layer over it, because USD ignores settings of sublayers."""
    root, wanted = below.pseudoRoot, layer.pseudoRoot
    if root.HasInfo(name):
        wanted.SetInfo(name, root.GetInfo(name))


def _anchored(layer: Any, text: str) -> str:
    """Return the absolute name of an asset that a layer refers to."""
    if not text or "://" in text or os.path.isabs(text):
        return text
    found: str = layer.ComputeAbsolutePath(text)
    if os.path.isabs(found):
        return found
    # These names are searched for in other places first, or are patterns.
    return os.path.normpath(Path(layer.realPath).parent / text)


def _relative(text: str, folder: Path) -> str:
    """Return the name of an asset relative to the folder that refers to it, if it is absolute."""
    if not os.path.isabs(text.partition("[")[0]):
        return text
    found = Path(os.path.relpath(text, folder)).as_posix()
    return found if found.startswith(".") else f"./{found}"


def _unpacked(source: Path, folder: Path) -> Path:
    """Extract the files of a package into a folder; return its first layer."""
    folder.mkdir()
    with zipfile.ZipFile(source) as package:
        names = package.namelist()
        # USD reads only uncompressed packages, so no file is larger than the package.
        if any(item.compress_type != zipfile.ZIP_STORED for item in package.infolist()):
            raise InputError(
                "is a package with compressed files, which USD does not read", code="unsupported-feature", path=source
            )
        package.extractall(folder)
    return folder / names[0]


class _Over:
    """A stage that is written onto, and its root layer."""

    def __init__(
        self, sequence: MeshSequence, original: UsdSequence, fits: Sequence[Fitted], stage: Any, output: Output
    ) -> None:
        self._sequence, self._stage, self._output = sequence, stage, output
        per_second = stage.GetTimeCodesPerSecond()
        codes = codes_of(sequence.times, per_second)
        if output.is_filled:
            # A carried scene holds instances as they were: their samples are in what they are instances of.
            fits = [one for one in fits if not original.shapes[one.index].is_instance]
        shapes = [original.shapes[one.index] for one in fits]
        of_points = [one.name for one in shapes if one.instances]
        if of_points:
            raise InputError(
                "is an instance of a PointInstancer, which cannot move the vertices of single instances",
                code="unsupported-feature",
                object=of_points[0],
                setting="objects",
                purpose="to leave it out",
            )
        for shape in shapes:
            self._make_editable(shape.prim.GetPath())
        _note_range(stage, codes)
        self._prims = [
            _PrimOver(
                stage.GetPrimAtPath(shape.prim.GetPath()),
                shape,
                one,
                original,
                sequence.times,
                codes,
                is_filled=output.is_filled,
            )
            for shape, one in zip(shapes, fits, strict=True)
        ]

    def _make_editable(self, path: Any) -> None:
        """Make a prim editable by ending the instancing of its ancestors."""
        while self._stage.GetPrimAtPath(path).IsInstanceProxy():
            above = self._stage.GetPrimAtPath(path)
            while above.IsInstanceProxy():
                above = above.GetParent()
            above.SetInstanceable(False)

    def write(self) -> None:
        for frames in write_over(self._prims, self._sequence, self._output, "USD"):
            hold_frames(self._prims, frames)
            self._stage.GetRootLayer().Save()


def _note_range(stage: Any, codes: Float64Array) -> None:
    """Extend the stage's time range to the motion, and note that every frame is a sample."""
    first, last = float(codes[0]), float(codes[-1])
    if stage.HasAuthoredTimeCodeRange():
        first, last = min(first, stage.GetStartTimeCode()), max(last, stage.GetEndTimeCode())
    stage.SetStartTimeCode(first)
    stage.SetEndTimeCode(last)
    stage.SetMetadataByDictKey("customLayerData", SAMPLED, True)


class _PrimOver(ShapeOver):
    """Writer of the stronger opinions about one prim."""

    def __init__(
        self,
        prim: Any,
        shape: Any,
        fit: Fitted,
        original: UsdSequence,
        times: Float64Array,
        codes: Float64Array,
        *,
        is_filled: bool,
    ) -> None:
        self._codes = codes
        is_implicit = isinstance(shape.points, Implicit)
        item = original.objects[fit.index]
        if is_implicit:
            _make_mesh(prim, item.connectivity)
        geometry = UsdGeom.PointBased(prim)
        normals_of = fit.item if is_filled else item
        rows = normal_rows(normals_of) if item.connectivity.face_count else None
        rows = rows if is_implicit or _has_normals(geometry) else None
        placed = ShapePlacement(lambda moments: original.prim_matrices(shape.prim, moments), times, fit.item.name)
        super().__init__(fit.own, placed, rows, None if shape.gather is None else item.connectivity.line_indices)
        if shape.skinning is not None:
            _stop_deforming(prim)
        # A carried scene already has velocities and accelerations of the same motion.
        for attribute in () if is_filled else (geometry.GetVelocitiesAttr(), geometry.GetAccelerationsAttr()):
            _block_value(attribute)
        self._points, self._extent = geometry.CreatePointsAttr(), geometry.CreateExtentAttr()
        for attribute in (self._points, self._extent):
            attribute.Clear()
        self._normals: Any = None if rows is None else _open_normals(geometry, rows, item.connectivity)
        self._geometry = geometry
        self.static, self.vertices = StaticStart(), fit.own.stop - fit.own.start

    def write(self, block: Float32Array, speeds: Float32Array | None, start: int) -> None:
        every = speeds is not None or not self._placed.is_constant
        frames = range(start, start + len(block))
        scene, written = self.static.needed(block[:, self._own], frames, every=every)
        if written:
            self._write(scene, None if speeds is None else speeds[:, self._own], [*map(int, written)])

    def hold(self, codes: Sequence[float]) -> None:
        self._write(self.static.held(codes), None, [*map(int, codes)])

    def _sample(
        self, frame: int, points: Float32Array, speeds: Float32Array | None, normals: Float32Array | None
    ) -> None:
        code = float(self._codes[frame])
        self._points.Set(vectors(points), code)
        self._extent.Set(vectors(np.stack([points.min(axis=0), points.max(axis=0)])), code)
        if normals is not None:
            self._normals.Set(vectors(normals), code)
        if speeds is not None:
            self._geometry.CreateVelocitiesAttr().Set(vectors(speeds), code)


def _block_value(attribute: Any) -> None:
    """Block the value of an attribute, if it has one."""
    if attribute and attribute.HasAuthoredValue():
        attribute.Block()


def _stop_deforming(prim: Any) -> None:
    """Stop joints and blend shapes from deforming a prim; the joints and blend shapes stay."""
    binding = UsdSkel.BindingAPI.Apply(prim)
    for name in (UsdSkel.Tokens.skelSkeleton, UsdSkel.Tokens.skelAnimationSource, UsdSkel.Tokens.skelBlendShapeTargets):
        prim.CreateRelationship(name, custom=False).SetTargets([])
    for attribute in (binding.GetBlendShapesAttr(), binding.GetJointIndicesAttr(), binding.GetJointWeightsAttr()):
        _block_value(attribute)


def _make_mesh(prim: Any, connectivity: Connectivity) -> None:
    """Turn an implicit shape into the mesh that it was read as."""
    prim.SetTypeName("Mesh")
    mesh = UsdGeom.Mesh(prim)
    mesh.CreateFaceVertexCountsAttr(int_array(connectivity.face_counts))
    mesh.CreateFaceVertexIndicesAttr(int_array(connectivity.face_indices))
    mesh.CreateSubdivisionSchemeAttr(UsdGeom.Tokens.none)


def _has_normals(geometry: Any) -> bool:
    primvar = UsdGeom.PrimvarsAPI(geometry).GetPrimvar(NORMALS)
    return bool(geometry.GetNormalsAttr().HasAuthoredValue() or (primvar and primvar.HasAuthoredValue()))


def _open_normals(geometry: Any, rows: NormalRows, connectivity: Connectivity) -> Any:
    """Return the attribute for rows of normals, by vertex or, with hard edges, by corner; the prim's own is blocked."""
    _block_value(geometry.GetNormalsAttr())
    stored = np.array(UsdGeom.Mesh(geometry).GetFaceVertexIndicesAttr().Get(), np.int64)
    order = corner_order(stored, connectivity)
    primvars = UsdGeom.PrimvarsAPI(geometry)
    primvar = primvars.CreatePrimvar(NORMALS, Sdf.ValueTypeNames.Normal3fArray)
    primvar.GetAttr().Clear()
    primvar.SetInterpolation(UsdGeom.Tokens.vertex if rows.is_smooth else UsdGeom.Tokens.faceVarying)
    if rows.is_smooth:
        primvar.BlockIndices()
    else:
        primvar.SetIndices(int_array(rows.corner_rows[order]))
    return primvar
