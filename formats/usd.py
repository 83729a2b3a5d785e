"""USD stages: meshes, curves and points, with UsdSkel, blend shapes and transforms applied, read when asked for.

Frames stand at every time code at which something of the scene is sampled. What is not sampled there is USD's own
value at that code, a straight line between its samples. Faces of left-handed meshes are turned around.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import (
    CURVE_BASIS,
    CURVE_WRAP,
    SUBDIVISION,
    label_attribute,
    reversed_corners,
)
from pdecodec.formats.registry import Transforms
from pdecodec.formats.sample_times import merged_times, rate_or_default, snapped_times
from pdecodec.formats.scene_space import UNIT, UP_AXIS, unit_text
from pdecodec.formats.transforms import apply_matrices, transform_attribute
from pdecodec.formats.unsupported import Refusals
from pdecodec.formats.usd_attributes import UsdExtras, read_extras
from pdecodec.formats.usd_names import ASSUMED, METADATA, object_name
from pdecodec.formats.usd_skinning import Skinning, find_skinning
from pdecodec.sequence import (
    Attribute,
    Connectivity,
    Float32Array,
    Float64Array,
    MeshObject,
    MeshSequence,
    check_frame_range,
)

SUBDIVISION_SCHEMES = {"catmullClark": "catmull-clark", "loop": "loop", "bilinear": "bilinear"}
"""USD's names of subdivision schemes, and ours."""

_PURPOSES = ("default", "render")
"""Purposes of prims that are read; proxies and guides stand beside what they stand for."""


def open_usd(
    path: Path, *, fps: float | None, transforms: Transforms = "bake", skip_unsupported: bool = False
) -> MeshSequence:
    """Open a USD stage: ``.usd``, ``.usda``, ``.usdc`` or ``.usdz``.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
        Nominal rate; time codes a second where the stage does not say.
    transforms : {"bake", "keep"}
    skip_unsupported : bool
        See :func:`pdecodec.formats.open_sequence`.

    Raises
    ------
    InputError
        If it is no USD file, holds no geometry, or an object changes its connectivity.
    """
    return UsdSequence(path, fps=fps, transforms=transforms, skip_unsupported=skip_unsupported)


@dataclass(frozen=True)
class _Shape:
    """A prim that can be read."""

    prim: Any
    points: Any
    connectivity: Connectivity
    attributes: tuple[Attribute, ...]
    gather: NDArray[np.int64] | None
    left_out: tuple[str, ...]
    skinning: Skinning | None

    @property
    def placed_by(self) -> Any:
        """The prim in whose space the points are."""
        return self.skinning.skeleton_prim if self.skinning is not None and self.skinning.has_joints else self.prim

    def time_codes(self) -> list[Float64Array]:
        """Lists of codes at which its points and the transforms above it are sampled."""
        lists = [self.points.GetTimeSamples()]
        if self.skinning is not None:
            lists.append(self.skinning.time_codes())
        prim = self.placed_by
        while prim and not prim.IsPseudoRoot():
            xformable = UsdGeom.Xformable(prim)
            if xformable:
                lists.append(xformable.GetTimeSamples())
                if xformable.GetResetXformStack():
                    break
            prim = prim.GetParent()
        return [np.asarray(codes, np.float64) for codes in lists if len(codes)]


class UsdSequence(MeshSequence):
    """The geometry of a USD stage, which stays open until :meth:`close`.

    Parameters
    ----------
    path : pathlib.Path
    fps : float, optional
    transforms : {"bake", "keep"}
    skip_unsupported : bool
    """

    def __init__(
        self,
        path: Path,
        *,
        fps: float | None = None,
        transforms: Transforms = "bake",
        skip_unsupported: bool = False,
    ) -> None:
        self._path = path
        with _stage_errors(path):
            self._stage = _open_stage(path)
            refusals = Refusals(skip=skip_unsupported)
            others: Counter[str] = Counter()
            self._shapes = _find_shapes(self._stage, refusals, others)
            there = ", ".join(f"{count} {kind}{'s' * (count != 1)}" for kind, count in others.items())
            refusals.check_left(len(self._shapes), there)
            self._codes, self.times, self.fps, notices = self._find_times(fps)
            self._keep = transforms == "keep"
            self.objects = tuple(self._object(shape) for shape in self._shapes)
            self.metadata = _metadata(self._stage)
        names = dict.fromkeys(name for shape in self._shapes for name in shape.left_out)
        self.unsupported = tuple(refusals.found)
        self.notices = (
            *notices,
            *refusals.notices,
            *([f"not read: {there}"] if there else []),
            *([f"not kept: {', '.join(names)}"] if names else []),
        )

    def _find_times(self, fps: float | None) -> tuple[Float64Array, Float64Array, float, tuple[str, ...]]:
        stage = self._stage
        # A stage that does not say has 24 by USD's rule, but nobody said so here.
        says = any(stage.HasAuthoredMetadata(name) for name in ("timeCodesPerSecond", "framesPerSecond"))
        rate = stage.GetTimeCodesPerSecond() if says else None
        per_second, notices = rate_or_default(rate, None if says else fps)
        nominal = float(stage.GetFramesPerSecond()) if stage.HasAuthoredMetadata("framesPerSecond") else per_second
        if says and fps is not None:
            nominal, notices = rate_or_default(nominal, fps)
        lists = [codes for shape in self._shapes for codes in shape.time_codes()]
        if not lists:
            code = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
            return np.array([code]), np.array([code / per_second]), nominal, notices if says else ()
        codes = merged_times([codes / per_second for codes in lists]) * per_second
        whole = np.rint(codes)
        codes = np.where(np.abs(codes - whole) < 1e-9 * np.maximum(1, np.abs(whole)), whole, codes)
        return codes, snapped_times(codes / per_second, per_second), nominal, notices

    def _object(self, shape: _Shape) -> MeshObject:
        attributes = shape.attributes
        if self._keep:
            matrices = self._matrices(shape, self._codes)
            if not np.array_equal(matrices, np.broadcast_to(np.eye(4), matrices.shape)):
                attributes = (*attributes, transform_attribute(self.times, matrices))
        return MeshObject(object_name(shape.prim), shape.connectivity, attributes)

    def _matrices(self, shape: _Shape, codes: Float64Array) -> Float64Array:
        """(codes, 4, 4) float64: from where the points are to the scene, for points that are rows."""
        found = []
        cache = UsdGeom.XformCache()
        for code in codes:
            cache.SetTime(Usd.TimeCode(float(code)))
            found.append(np.array(cache.GetLocalToWorldTransform(shape.placed_by), np.float64))
        return np.array(found, np.float64).reshape(-1, 4, 4)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        check_frame_range(self, start, stop)
        points = np.empty((stop - start, self.vertex_count, 3), np.float32)
        codes = self._codes[start:stop]
        first = 0
        with _stage_errors(self._path):
            for shape in self._shapes:
                own = points[:, first : first + shape.connectivity.vertex_count]
                for row, code in enumerate(codes):
                    own[row] = self._points(shape, float(code), start + row)
                if not self._keep:
                    own[:] = apply_matrices(own, self._matrices(shape, codes))
                first += shape.connectivity.vertex_count
        return points

    def _points(self, shape: _Shape, code: float, frame: int) -> Float32Array:
        points: Float32Array = np.asarray(shape.points.Get(code), np.float32).reshape(-1, 3)
        if shape.gather is not None and len(points) > int(shape.gather.max(initial=-1)):
            points = points[shape.gather]
        if len(points) != shape.connectivity.vertex_count:
            raise InputError(
                f"object {object_name(shape.prim)!r} has {len(points)} points, its first frame has "
                f"{shape.connectivity.vertex_count}; every frame must have the connectivity of the first",
                path=self._path,
                frame=frame,
            )
        return points if shape.skinning is None else shape.skinning.deform(points, code)

    def close(self) -> None:
        # The stage closes when nothing refers to it any more.
        self._shapes = []
        self._stage = None


@contextmanager
def _stage_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except Tf.ErrorException as error:
        lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        reason = lines[-1] if lines else "unknown"
        raise InputError(f"is no USD file, or a damaged one ({reason}); export it again", path=path) from error


def _open_stage(path: Path) -> Any:
    known = Sdf.Layer.Find(str(path))
    if known is not None:
        # USD keeps files that are open: this one may have been written again since.
        known.Reload()
    return Usd.Stage.Open(str(path))


def _find_shapes(stage: Any, refusals: Refusals, others: Counter[str]) -> list[_Shape]:
    skinned = find_skinning(stage)
    shapes = []
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        name = object_name(prim)
        imageable = UsdGeom.Imageable(prim)
        if imageable and prim.IsA(UsdGeom.Gprim) and imageable.ComputePurpose() not in _PURPOSES:
            others[f"prim of purpose {imageable.ComputePurpose()}"] += 1
            continue
        opened = None
        if prim.IsA(UsdGeom.Mesh):
            opened = _open_mesh(prim, name, refusals, skinned.get(str(prim.GetPath())))
        elif prim.IsA(UsdGeom.BasisCurves):
            opened = _open_curves(prim, name, refusals)
        elif prim.IsA(UsdGeom.Points):
            opened = _open_points(prim, name, refusals)
        elif prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer):
            refusals.refuse(name, f"the type {prim.GetTypeName()}, which is no mesh, curve or point set; convert it")
        elif prim.IsA(UsdGeom.Camera):
            others["camera"] += 1
        if opened is not None and opened.connectivity.vertex_count:
            shapes.append(opened)
    return shapes


def first_change(attributes: Sequence[Any]) -> float | None:
    """First time code at which one of several array attributes is not what it was."""
    changes = []
    for attribute in attributes:
        codes = attribute.GetTimeSamples()
        if len(codes) < 2:
            continue
        first = np.asarray(attribute.Get(codes[0]))
        changed = next((code for code in codes[1:] if not np.array_equal(np.asarray(attribute.Get(code)), first)), None)
        if changed is not None:
            changes.append(changed)
    return min(changes, default=None)


def value(attribute: Any) -> Any:
    """An attribute's value at its first sample, else its default."""
    codes = attribute.GetTimeSamples()
    return attribute.Get(codes[0]) if codes else attribute.Get()


def integers(attribute: Any) -> NDArray[np.int32]:
    """An integer array attribute's first value; empty where it has none."""
    found = value(attribute)
    return np.zeros(0, np.int32) if found is None else np.array(found, np.int32).reshape(-1)


def _vertex_count(points: Any) -> int:
    found = value(points)
    return 0 if found is None else len(found)


def _open_mesh(prim: Any, name: str, refusals: Refusals, skinning: Skinning | None) -> _Shape | None:
    mesh = UsdGeom.Mesh(prim)
    changed = first_change([mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()])
    if changed is not None:
        refusals.refuse(name, f"faces that change at time code {changed:g} (heterogeneous topology)")
        return None
    counts, indices = integers(mesh.GetFaceVertexCountsAttr()), integers(mesh.GetFaceVertexIndicesAttr())
    if int(counts.sum(dtype=np.int64)) != indices.size or (counts < 3).any():
        refusals.refuse(name, f"faces of {int(counts.min(initial=3))} corners, or counts that do not fit the indices")
        return None
    turned = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    order = reversed_corners(counts) if turned else np.arange(indices.size)
    faces = Connectivity(_vertex_count(mesh.GetPointsAttr()), face_counts=counts, face_indices=indices[order])
    extras = read_extras(prim, faces, order)
    scheme = SUBDIVISION_SCHEMES.get(str(mesh.GetSubdivisionSchemeAttr().Get()))
    if scheme is not None:
        extras.attributes.append(label_attribute(SUBDIVISION, scheme))
    for what, attribute in (
        ("creases", mesh.GetCreaseIndicesAttr()),
        ("corners", mesh.GetCornerIndicesAttr()),
        ("holes", mesh.GetHoleIndicesAttr()),
    ):
        if attribute.HasAuthoredValue() and len(value(attribute) or ()):
            extras.left_out.append(what)
    connectivity = Connectivity(faces.vertex_count, faces.face_counts, faces.face_indices, *_own_lines(extras))
    return _shape(prim, mesh, connectivity, extras, None, skinning)


def _open_curves(prim: Any, name: str, refusals: Refusals) -> _Shape | None:
    curves = UsdGeom.BasisCurves(prim)
    changed = first_change([curves.GetCurveVertexCountsAttr()])
    if changed is not None:
        refusals.refuse(name, f"curves whose numbers of points change at time code {changed:g}")
        return None
    counts, points = integers(curves.GetCurveVertexCountsAttr()), _vertex_count(curves.GetPointsAttr())
    if int(counts.sum(dtype=np.int64)) != points or (counts < 1).any():
        refusals.refuse(name, "curves whose numbers of points do not add up")
        return None
    extras = read_extras(prim, Connectivity(points), np.zeros(0, np.int64))
    if curves.GetTypeAttr().Get() == UsdGeom.Tokens.cubic:
        basis = str(curves.GetBasisAttr().Get()).lower()
        extras.attributes.append(label_attribute(CURVE_BASIS, f"cubic {basis}"))
    wrap = str(curves.GetWrapAttr().Get())
    if wrap != "nonperiodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, wrap))
    gather, indices = None, np.arange(points, dtype=np.int32)
    if extras.own.get("vertex", indices).size == points and "vertex" in extras.own:
        indices = extras.own["vertex"]
        _, gather = np.unique(indices, return_index=True)
    connectivity = Connectivity(points if gather is None else gather.size, line_counts=counts, line_indices=indices)
    return _shape(prim, curves, connectivity, extras, gather, None)


def _open_points(prim: Any, name: str, refusals: Refusals) -> _Shape | None:
    points = UsdGeom.Points(prim)
    changed = first_change([points.GetIdsAttr()])
    if changed is not None:
        refusals.refuse(name, f"points that come, go or change places at time code {changed:g} (their ids change)")
        return None
    count = _vertex_count(points.GetPointsAttr())
    extras = read_extras(prim, Connectivity(count), np.zeros(0, np.int64))
    none = np.zeros(0, np.int32)
    return _shape(prim, points, Connectivity(count, none, none, *_own_lines(extras)), extras, None, None)


def _shape(
    prim: Any,
    schema: Any,
    connectivity: Connectivity,
    extras: UsdExtras,
    gather: NDArray[np.int64] | None,
    skinning: Skinning | None,
) -> _Shape:
    for what, attribute in (("normals", schema.GetNormalsAttr()), ("velocities", schema.GetVelocitiesAttr())):
        if attribute.HasAuthoredValue():
            extras.left_out.append(what)
    attributes, left_out = tuple(extras.attributes), tuple(extras.left_out)
    return _Shape(prim, schema.GetPointsAttr(), connectivity, attributes, gather, left_out, skinning)


def _own_lines(extras: UsdExtras) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    """Lines that our writer left beside faces or points."""
    none = np.zeros(0, np.int32)
    return extras.own.get("lineCounts", none), extras.own.get("lineIndices", none)


def _metadata(stage: Any) -> dict[str, str]:
    data = stage.GetRootLayer().customLayerData
    stored = data.get(METADATA, {})
    metadata = {str(key): str(text) for key, text in stored.items()} if isinstance(stored, dict) else {}
    assumed = set(data.get(ASSUMED, "").split())
    if stage.HasAuthoredMetadata("upAxis") and UP_AXIS not in assumed:
        metadata[UP_AXIS] = str(UsdGeom.GetStageUpAxis(stage))
    if stage.HasAuthoredMetadata("metersPerUnit") and UNIT not in assumed:
        metadata[UNIT] = unit_text(float(UsdGeom.GetStageMetersPerUnit(stage)))
    return metadata
