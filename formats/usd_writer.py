"""USD stages out: one prim an object, in the tree that names say, its points sampled at every frame.

A file is saved after every block of frames, so that memory does not grow with the clip.
"""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Gf, Sdf, Tf, Usd, UsdGeom, UsdUtils, Vt

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import CURVE_BASIS, CURVE_WRAP, SUBDIVISION, label_of
from pdecodec.formats.object_tree import Drawn, TreePaths, drawn_as, tree_paths
from pdecodec.formats.scene_space import UNIT, UP_AXIS, metres_per_unit, up_axis_of
from pdecodec.formats.transforms import matrices_at, transform_of
from pdecodec.formats.usd import SUBDIVISION_SCHEMES
from pdecodec.formats.usd_attribute_writer import write_attributes
from pdecodec.formats.usd_names import ADDED, ASSUMED, METADATA, NAME, OWN, valid_name
from pdecodec.sequence import Float32Array, Float64Array, MeshObject, MeshSequence, Progress
from pdecodec.whole_output import check_writable, partial_folder, write_errors

ROOT = "scene"
"""Name of the prim above all others where the tree has several roots: a stage has one default prim."""

USD_UP, USD_METRES = "Y", 0.01
"""What a stage is taken to be where it does not say."""

_BASES = {"bezier": "bezier", "bspline": "bspline", "catmullrom": "catmullRom"}


def write_usd(
    sequence: MeshSequence,
    path: Path,
    *,
    overwrite: bool = False,
    fps: float | None = None,
    velocities: MeshSequence | None = None,
    progress: Progress | None = None,
) -> tuple[str, ...]:
    """Write a sequence as a stage: text where the name ends in ``.usda``, else binary; in a package for ``.usdz``.

    Parameters
    ----------
    sequence : MeshSequence
    path : pathlib.Path
    overwrite : bool
    fps : float, optional
        Time codes and frames a second.
    velocities : MeshSequence, optional
        [scene units / s]
    progress : callable, optional

    Returns
    -------
    tuple of str
        What USD could not hold.

    Raises
    ------
    InputError
        If the place is taken or cannot be written to.
    """
    check_writable(path, overwrite=overwrite)
    rate = sequence.fps if fps is None else fps
    with partial_folder(path) as folder, write_errors(path):
        packed = path.suffix.lower() == ".usdz"
        file = folder / (f"{valid_name(path.stem)}.usdc" if packed else path.name)
        try:
            notices = _Stage(sequence, file, rate).write(velocities, progress)
            if packed:
                package = folder / path.name
                if not UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(file)), str(package)):
                    raise InputError("USD cannot make this package; write a .usdc file")
                file = package
        except Tf.ErrorException as error:
            reason = str(error).strip().splitlines()[-1].strip()
            raise InputError(f"USD cannot write this ({reason}); check the folder and the free space") from error
        os.replace(file, path)
    return notices


class _Stage:
    """A stage that is being written."""

    def __init__(self, sequence: MeshSequence, file: Path, rate: float) -> None:
        self._sequence, self._rate = sequence, rate
        self._stage = Usd.Stage.CreateNew(str(file))
        self.notices: list[str] = []
        tree = tree_paths(sequence.objects, valid_name)
        self._describe(tree)
        self._prims = [
            _PrimWriter(self._stage, item, self._make_path(item, steps))
            for item, steps in zip(sequence.objects, tree.paths, strict=True)
        ]

    def write(self, velocities: MeshSequence | None, progress: Progress | None) -> tuple[str, ...]:
        sequence = self._sequence
        layer = self._stage.GetRootLayer()
        for start, block in sequence.blocks():
            speeds = None if velocities is None else velocities.read_frames(start, start + len(block))
            times = sequence.times[start : start + len(block)]
            codes = _codes(times, self._rate)
            first = 0
            for prim in self._prims:
                place = slice(first, first + prim.vertex_count)
                prim.write(block[:, place], None if speeds is None else speeds[:, place], times, codes)
                first = place.stop
            layer.Save()
            if progress is not None:
                progress(start + len(block), sequence.frame_count, "writing USD")
        told = dict.fromkeys(notice for prim in self._prims for notice in prim.notices)
        return (*self.notices, *told)

    def _describe(self, tree: TreePaths) -> None:
        sequence, stage = self._sequence, self._stage
        codes = _codes(sequence.times, self._rate)
        stage.SetTimeCodesPerSecond(self._rate)
        stage.SetFramesPerSecond(self._rate)
        stage.SetStartTimeCode(float(codes[0]))
        stage.SetEndTimeCode(float(codes[-1]))
        axis, metres = up_axis_of(sequence), metres_per_unit(sequence)
        if axis == "X":
            self.notices.append("USD has no up axis X: written as Y, nothing is turned (--up-axis turns)")
        UsdGeom.SetStageUpAxis(stage, axis if axis in ("Y", "Z") else USD_UP)
        UsdGeom.SetStageMetersPerUnit(stage, USD_METRES if metres is None else metres)
        assumed = []
        if axis is None:
            assumed.append(UP_AXIS)
            self.notices.append(f"which axis is up is not recorded: written as {USD_UP}, USD's own (--up-axis says it)")
        if metres is None:
            assumed.append(UNIT)
            self.notices.append(f"the length of a unit is not recorded: written as {USD_METRES} m, USD's own")
        layer = stage.GetRootLayer()
        data = dict(layer.customLayerData)
        if assumed:
            data[ASSUMED] = " ".join(assumed)
        known = {UP_AXIS} if axis in ("Y", "Z") else set()
        known |= {UNIT} if metres is not None else set()
        rest = {key: text for key, text in sequence.metadata.items() if key not in known}
        if rest:
            data[METADATA] = rest
        layer.customLayerData = data
        self._renamed(tree)
        roots = {steps[0] for steps in tree.paths}
        self._root = Sdf.Path.absoluteRootPath
        if len(roots) > 1:
            root = UsdGeom.Xform.Define(stage, f"/{ROOT}").GetPrim()
            root.SetCustomDataByKey(ADDED, True)
            self._root = root.GetPath()
            stage.SetDefaultPrim(root)

    def _renamed(self, tree: TreePaths) -> None:
        """Tell of names that do not come back: those that USD cannot hold do, from the prims' custom data."""
        taken = [
            f"{item.name!r} as {'/'.join(path)!r}"
            for item, path in zip(self._sequence.objects, tree.paths, strict=True)
            if tuple(map(valid_name, _steps(item))) != path
        ]
        if taken:
            self.notices.append(f"names that had to change: {', '.join(taken)}")

    def _make_path(self, item: MeshObject, steps: tuple[str, ...]) -> Any:
        """The path of an object's prim, those above it made where they are not there yet."""
        path = self._root
        names = _steps(item)
        for index, step in enumerate(steps):
            path = path.AppendChild(step)
            last = index == len(steps) - 1
            prim = self._stage.GetPrimAtPath(path)
            if not prim:
                kinds = {"mesh": UsdGeom.Mesh, "curves": UsdGeom.BasisCurves, "points": UsdGeom.Points}
                kind = kinds[drawn_as(item.connectivity).kind] if last else UsdGeom.Xform
                prim = kind.Define(self._stage, path).GetPrim()
                if index < len(names) and valid_name(names[index]) == step != names[index]:
                    prim.SetCustomDataByKey(NAME, names[index])
                    prim.SetDisplayName(names[index])
            if index == 0 and not self._stage.HasDefaultPrim():
                self._stage.SetDefaultPrim(prim)
        return path


def _steps(item: MeshObject) -> tuple[str, ...]:
    return tuple(step for step in item.name.split("/") if step)


def _codes(times: Float64Array, rate: float) -> Float64Array:
    """Time codes of times, whole where they are whole but for rounding."""
    codes = times * rate
    whole = np.rint(codes)
    found: Float64Array = np.where(np.abs(codes - whole) <= 1e-9 * np.maximum(1.0, np.abs(whole)), whole, codes)
    return found


class _PrimWriter:
    """One object: its prim, and samples as frames come."""

    def __init__(self, stage: Any, item: MeshObject, path: Any) -> None:
        self._item = item
        self.vertex_count = item.vertex_count
        self.notices: list[str] = []
        self._drawn: Drawn = drawn_as(item.connectivity)
        prim = stage.GetPrimAtPath(path)
        schema = {"mesh": UsdGeom.Mesh, "curves": UsdGeom.BasisCurves, "points": UsdGeom.Points}[self._drawn.kind]
        self._geometry = schema(prim)
        self._points = self._geometry.CreatePointsAttr()
        self._extent = self._geometry.CreateExtentAttr()
        self._transform = transform_of(item)
        self._op = None
        if self._transform is not None:
            self._geometry.SetResetXformStack(True)
            self._op = self._geometry.AddTransformOp()
        self._describe()
        self._write_own(prim)
        self.notices += write_attributes(stage, prim, item, self._drawn)

    def write(
        self, points: Float32Array, speeds: Float32Array | None, times: Float64Array, codes: Float64Array
    ) -> None:
        """Samples of a block of frames."""
        # Coordinate by coordinate: minima along rows of three are ten times as slow.
        axes = np.ascontiguousarray(points.transpose(0, 2, 1))
        extents = np.stack([axes.min(axis=2), axes.max(axis=2)], axis=1)
        if self._drawn.gather is not None:
            points = points[:, self._drawn.gather]
            speeds = None if speeds is None else speeds[:, self._drawn.gather]
        for frame, code in enumerate(codes.tolist()):
            self._points.Set(Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points[frame])), code)
            self._extent.Set(Vt.Vec3fArray.FromNumpy(extents[frame]), code)
            if speeds is not None:
                velocity = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(speeds[frame]))
                self._geometry.CreateVelocitiesAttr().Set(velocity, code)
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
        connectivity, geometry = self._item.connectivity, self._geometry
        if self._drawn.kind == "mesh":
            geometry.CreateFaceVertexCountsAttr(Vt.IntArray.FromNumpy(connectivity.face_counts))
            geometry.CreateFaceVertexIndicesAttr(Vt.IntArray.FromNumpy(connectivity.face_indices))
            schemes = {ours: theirs for theirs, ours in SUBDIVISION_SCHEMES.items()}
            geometry.CreateSubdivisionSchemeAttr(schemes.get(label_of(self._item, SUBDIVISION) or "", "none"))
        elif self._drawn.kind == "curves":
            geometry.CreateCurveVertexCountsAttr(Vt.IntArray.FromNumpy(connectivity.line_counts))
            basis = label_of(self._item, CURVE_BASIS) or "linear"
            cubic = _BASES.get(basis.removeprefix("cubic "))
            geometry.CreateTypeAttr("cubic" if cubic else "linear")
            if cubic:
                geometry.CreateBasisAttr(cubic)
            elif basis != "linear":
                self.notices.append(f"curves of object {self._item.name!r} are written as lines, not as {basis}")
            wrap = label_of(self._item, CURVE_WRAP)
            geometry.CreateWrapAttr(wrap if wrap in ("periodic", "pinned") else "nonperiodic")

    def _write_own(self, prim: Any) -> None:
        """What USD's shapes cannot say, in attributes of our own."""
        connectivity = self._item.connectivity
        arrays = {}
        if self._drawn.gather is not None:
            arrays["vertex"] = self._drawn.gather
        if self._drawn.hidden_lines:
            arrays = {"lineCounts": connectivity.line_counts, "lineIndices": connectivity.line_indices}
            self.notices.append(f"lines of object {self._item.name!r} show in pdecodec alone: USD's curves are apart")
        for name, array in arrays.items():
            attribute = prim.CreateAttribute(f"{OWN}:{name}", Sdf.ValueTypeNames.IntArray, True, Sdf.VariabilityUniform)
            attribute.Set(Vt.IntArray.FromNumpy(np.ascontiguousarray(array)))
