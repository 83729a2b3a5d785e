"""USD stages out: one prim an object, in the tree that names say, its points sampled at every frame.

A file is saved after every block of frames, so that memory does not grow with the clip.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import CURVE_BASIS, CURVE_WRAP, SUBDIVISION, label_of
from pdecodec.formats.registry import Output
from pdecodec.formats.rigid_motion import rigid_parts
from pdecodec.formats.scene_space import UNIT, UP_AXIS, matrices_at, metres_per_unit, transform_of, up_axis_of
from pdecodec.formats.scene_writing import ShapeWriter, drawn_as, steps_of, tree_paths, write_shapes
from pdecodec.formats.times import codes_of
from pdecodec.formats.usd_attributes import (
    ADDED,
    METADATA,
    NAME,
    NORMALS,
    OWN,
    SAMPLED,
    int_array,
    valid_name,
    write_extras,
)
from pdecodec.formats.usd_reader import SUBDIVISION_SCHEMES
from pdecodec.sequence import Float32Array, Float64Array, MeshObject, MeshSequence
from pdecodec.whole_output import check_writable, failure_of, move_into, partial_folder, write_errors

ROOT = "scene"
"""Name of the prim above all others where the tree has several roots: a stage has one default prim."""

USD_METRES = 0.01
"""Length of a unit of a stage that does not say it [m], by USD's rule."""

_SCHEMAS = {"mesh": UsdGeom.Mesh, "curves": UsdGeom.BasisCurves, "points": UsdGeom.Points}

_BASES = {"bezier": "bezier", "bspline": "bspline", "catmullrom": "catmullRom"}


def write_usd(sequence: MeshSequence, output: Output) -> tuple[str, ...]:
    """Write a stage: text where the name ends in ``.usda``, else binary; in a package for ``.usdz``."""
    path = output.path
    if output.velocities is None:
        sequence = rigid_parts(sequence)
    check_writable(path, overwrite=output.overwrite)
    with partial_folder(path) as folder, write_errors(path):
        packed = path.suffix.lower() == ".usdz"
        file = folder / (f"{valid_name(path.stem)}.usdc" if packed else path.name)
        try:
            notices = _Stage(sequence, Usd.Stage.CreateNew(str(file)), output).write()
            if packed:
                package = folder / path.name
                if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(file)), str(package)):
                    raise InputError("USD cannot make this package; write a .usdc file")
                file = package
        except Tf.ErrorException as error:
            reason = str(error).strip().splitlines()[-1].strip()
            reason = failure_of(folder, f"USD says {reason}")
            raise InputError(f"cannot be written ({reason}); check the folder and the free space") from error
        move_into(file, path, overwrite=output.overwrite)
    return notices


class _Stage:
    """A stage that is being written."""

    def __init__(self, sequence: MeshSequence, stage: Any, output: Output) -> None:
        self._sequence, self._stage, self._output = sequence, stage, output
        self.notices: list[str] = []
        paths, _ = tree_paths(sequence.objects, valid_name)
        self._describe(paths)
        self._prims = [
            _PrimWriter(stage.GetPrimAtPath(self._make_path(item, steps)), item, output.rate)
            for item, steps in zip(sequence.objects, paths, strict=True)
        ]

    def write(self) -> tuple[str, ...]:
        for _ in write_shapes(self._sequence, self._output, "USD", self._prims):
            self._stage.GetRootLayer().Save()
        told = dict.fromkeys(notice for prim in self._prims for notice in prim.notices)
        return (*self.notices, *told)

    def _describe(self, paths: Sequence[tuple[str, ...]]) -> None:
        sequence, stage = self._sequence, self._stage
        codes = codes_of(sequence.times, self._output.rate)
        stage.SetTimeCodesPerSecond(self._output.rate)
        stage.SetMetadataByDictKey("customLayerData", SAMPLED, True)
        stage.SetFramesPerSecond(self._output.rate)
        stage.SetStartTimeCode(float(codes[0]))
        stage.SetEndTimeCode(float(codes[-1]))
        axis, metres = up_axis_of(sequence), metres_per_unit(sequence)
        if axis == "X":
            self.notices.append("USD has no up axis X: none is written, programs take it as Y (--up-axis turns)")
        # What nobody stated is not authored: a reader would take it for a fact.
        if axis in ("Y", "Z"):
            UsdGeom.SetStageUpAxis(stage, axis)
        elif axis is None:
            self.notices.append("which axis is up is not recorded: programs take it as Y (--up-axis says it)")
        if metres is not None:
            UsdGeom.SetStageMetersPerUnit(stage, metres)
        else:
            self.notices.append(
                f"the length of a unit is not recorded: programs take it as {USD_METRES} m, a metre as its hundredth "
                "(--unit m says it)"
            )
        layer = stage.GetRootLayer()
        data = dict(layer.customLayerData)
        known = {UP_AXIS} if axis in ("Y", "Z") else set()
        known |= {UNIT} if metres is not None else set()
        rest = {key: text for key, text in sequence.metadata.items() if key not in known}
        if rest:
            data[METADATA] = rest
        layer.customLayerData = data
        # Names that USD cannot hold come back, from the prims' custom data; others do not.
        renamed = [
            f"{item.name!r} as {'/'.join(path)!r}"
            for item, path in zip(sequence.objects, paths, strict=True)
            if tuple(map(valid_name, steps_of(item.name))) != path
        ]
        if renamed:
            self.notices.append(f"names that had to change: {', '.join(renamed)}")
        roots = {steps[0] for steps in paths}
        self._root = Sdf.Path.absoluteRootPath
        if len(roots) > 1:
            root = UsdGeom.Xform.Define(stage, f"/{ROOT}").GetPrim()
            root.SetCustomDataByKey(ADDED, True)
            self._root = root.GetPath()
            stage.SetDefaultPrim(root)

    def _make_path(self, item: MeshObject, steps: tuple[str, ...]) -> Any:
        """The path of an object's prim, those above it made where they are not there yet."""
        path = self._root
        names = steps_of(item.name)
        for index, step in enumerate(steps):
            path = path.AppendChild(step)
            last = index == len(steps) - 1
            prim = self._stage.GetPrimAtPath(path)
            if not prim:
                kind = _SCHEMAS[drawn_as(item.connectivity).kind] if last else UsdGeom.Xform
                prim = kind.Define(self._stage, path).GetPrim()
                if index < len(names) and valid_name(names[index]) == step != names[index]:
                    prim.SetCustomDataByKey(NAME, names[index])
                    prim.SetDisplayName(names[index])
            if index == 0 and not self._stage.HasDefaultPrim():
                self._stage.SetDefaultPrim(prim)
        return path


def vectors(rows: Float32Array) -> Any:
    """(n, 3) as Vt.Vec3fArray."""
    return Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(rows))


class _PrimWriter(ShapeWriter):
    """One object: its prim, and samples as frames come."""

    def __init__(self, prim: Any, item: MeshObject, rate: float) -> None:
        super().__init__(item, "USD")
        self._rate = rate
        self._geometry = _SCHEMAS[self.drawn.kind](prim)
        self._points = self._geometry.CreatePointsAttr()
        self._extent = self._geometry.CreateExtentAttr()
        self._transform = transform_of(item)
        self._op = None
        if self._transform is not None:
            self._geometry.SetResetXformStack(True)
            self._op = self._geometry.AddTransformOp()
        self._normals: Any = None
        self._describe()
        self._write_own(prim)
        self.notices += write_extras(prim, item, self.drawn, self.in_samples)

    def write(self, points: Float32Array, speeds: Float32Array | None, times: Float64Array) -> None:
        if not points.shape[1]:
            self._points.Set(Vt.Vec3fArray())
            return
        # Coordinate by coordinate: minima along rows of three are ten times as slow.
        axes = np.ascontiguousarray(points.transpose(0, 2, 1))
        extents = np.stack([axes.min(axis=2), axes.max(axis=2)], axis=1)
        codes = codes_of(times, self._rate)
        for frame, (code, normals) in enumerate(zip(codes.tolist(), self.normals_at(points), strict=True)):
            self._points.Set(vectors(points[frame]), code)
            self._extent.Set(vectors(extents[frame]), code)
            if normals is not None:
                self._normals.Set(vectors(normals), code)
            if speeds is not None:
                self._geometry.CreateVelocitiesAttr().Set(vectors(speeds[frame]), code)
        if self._transform is None or self._op is None:
            return
        matrices = matrices_at(self._transform, times).reshape(-1, 16).tolist()
        if len(self._transform.values) == 1:
            self._op.Set(Gf.Matrix4d(*matrices[0]))
            return
        for code, numbers in zip(codes.tolist(), matrices, strict=True):
            self._op.Set(Gf.Matrix4d(*numbers), code)

    def _describe(self) -> None:
        """Faces or curves: what does not change."""
        connectivity, geometry = self.item.connectivity, self._geometry
        if self.drawn.kind == "mesh":
            geometry.CreateFaceVertexCountsAttr(int_array(connectivity.face_counts))
            geometry.CreateFaceVertexIndicesAttr(int_array(connectivity.face_indices))
            schemes = {ours: theirs for theirs, ours in SUBDIVISION_SCHEMES.items()}
            geometry.CreateSubdivisionSchemeAttr(schemes.get(label_of(self.item, SUBDIVISION) or "", "none"))
            if self.normals is not None and self.normals.is_smooth:
                self._normals = geometry.CreateNormalsAttr()
            elif self.normals is not None:
                kind = Sdf.ValueTypeNames.Normal3fArray
                self._normals = UsdGeom.PrimvarsAPI(geometry).CreatePrimvar(NORMALS, kind, "faceVarying")
                self._normals.SetIndices(int_array(self.normals.corner_rows))
        elif self.drawn.kind == "curves":
            geometry.CreateCurveVertexCountsAttr(int_array(connectivity.line_counts))
            basis = label_of(self.item, CURVE_BASIS) or "linear"
            cubic = _BASES.get(basis.removeprefix("cubic "))
            geometry.CreateTypeAttr("cubic" if cubic else "linear")
            if cubic:
                geometry.CreateBasisAttr(cubic)
            elif basis != "linear":
                self.notices.append(f"curves of object {self.item.name!r} are written as lines, not as {basis}")
            wrap = label_of(self.item, CURVE_WRAP)
            geometry.CreateWrapAttr(wrap if wrap in ("periodic", "pinned") else "nonperiodic")

    def _write_own(self, prim: Any) -> None:
        """What USD's shapes cannot say, in attributes of our own."""
        connectivity = self.item.connectivity
        arrays = {}
        if self.drawn.gather is not None:
            arrays["vertex"] = self.drawn.gather
        if self.drawn.hidden_lines:
            arrays = {"lineCounts": connectivity.line_counts, "lineIndices": connectivity.line_indices}
        for name, array in arrays.items():
            attribute = prim.CreateAttribute(f"{OWN}:{name}", Sdf.ValueTypeNames.IntArray, True, Sdf.VariabilityUniform)
            attribute.Set(int_array(array))
