"""USD stages: meshes, curves and points, with UsdSkel, blend shapes and transforms applied, read when asked for.

Frames stand at every time code at which something of the scene is sampled. What is not sampled there is USD's own
value at that code, a straight line between its samples. Faces of left-handed meshes are turned around.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom, UsdSkel, Vt

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import CURVE_BASIS, CURVE_WRAP, SUBDIVISION, label_attribute, reversed_corners
from pdecodec.formats.registry import Transforms
from pdecodec.formats.scene_reading import Extras, Refusals, SceneSequence, Shape
from pdecodec.formats.scene_space import UNIT, UP_AXIS, unit_text
from pdecodec.formats.times import Timing, merged_times, rate_or_default, snapped_times
from pdecodec.formats.usd_attributes import METADATA, first_value, object_name, read_extras
from pdecodec.sequence import Connectivity, Float32Array, Float64Array

SUBDIVISION_SCHEMES = {"catmullClark": "catmull-clark", "loop": "loop", "bilinear": "bilinear"}
"""USD's names of subdivision schemes, and ours."""

_PURPOSES = ("default", "render")
"""Purposes of prims that are read; proxies and guides stand beside what they stand for."""


@dataclass(kw_only=True, eq=False)
class _Shape(Shape):
    """A prim that can be read, its attribute of points, and what deforms them."""

    prim: Any
    points: Any
    skinning: _Skinning | None

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


class UsdSequence(SceneSequence):
    """The geometry of a USD stage (``.usd``, ``.usda``, ``.usdc``, ``.usdz``), which stays open until :meth:`close`.

    `fps` is the nominal rate; time codes a second where the stage does not say.

    Raises
    ------
    InputError
        If it is no USD file, holds no geometry, or an object changes its connectivity.
    """

    def __init__(
        self, path: Path, *, fps: float | None, transforms: Transforms = "bake", skip_unsupported: bool = False
    ) -> None:
        self._path = path
        with _stage_errors(path):
            self._stage = _open_stage(path)
            refusals = Refusals(skip=skip_unsupported)
            shapes = _find_shapes(self._stage, refusals)
            notices = refusals.notices(shapes)
            self._codes, (self.times, self.fps, time_notices) = _timing(self._stage, shapes, fps)
            self._take(shapes, transforms)
            self.metadata = _metadata(self._stage)
        self.unsupported = tuple(refusals.found)
        self.notices = (*time_notices, *notices)

    def _matrices(self, shape: _Shape, start: int, stop: int) -> Float64Array:
        found = []
        cache = UsdGeom.XformCache()
        for code in self._codes[start:stop].tolist():
            cache.SetTime(Usd.TimeCode(code))
            found.append(np.array(cache.GetLocalToWorldTransform(shape.placed_by), np.float64))
        return np.array(found, np.float64).reshape(-1, 4, 4)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        with _stage_errors(self._path):
            return super().read_frames(start, stop)

    def _read(self, shape: _Shape, start: int, stop: int, out: Float32Array) -> None:
        for row, code in enumerate(self._codes[start:stop].tolist()):
            points: Float32Array = np.asarray(shape.points.Get(code), np.float32).reshape(-1, 3)
            points = shape.fitted(points, self._path, start + row)
            out[row] = points if shape.skinning is None else shape.skinning.deform(points, code)

    def close(self) -> None:
        # The stage closes when nothing refers to it any more.
        self._shapes = []
        self._stage = None


def _timing(stage: Any, shapes: Sequence[_Shape], fps: float | None) -> tuple[Float64Array, Timing]:
    """Time codes of the frames, and their times."""
    # A stage that does not say has 24 by USD's rule, but nobody said so here.
    says = any(stage.HasAuthoredMetadata(name) for name in ("timeCodesPerSecond", "framesPerSecond"))
    rate = stage.GetTimeCodesPerSecond() if says else None
    per_second, notices = rate_or_default(rate, None if says else fps)
    nominal = float(stage.GetFramesPerSecond()) if stage.HasAuthoredMetadata("framesPerSecond") else per_second
    if says and fps is not None:
        nominal, notices = rate_or_default(nominal, fps)
    lists = [codes for shape in shapes for codes in shape.time_codes()]
    if not lists:
        code = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
        return np.array([code]), (np.array([code / per_second]), nominal, notices if says else ())
    codes = merged_times([codes / per_second for codes in lists]) * per_second
    whole = np.rint(codes)
    codes = np.where(np.abs(codes - whole) < 1e-9 * np.maximum(1, np.abs(whole)), whole, codes)
    return codes, (snapped_times(codes / per_second, per_second), nominal, notices)


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


def _find_shapes(stage: Any, refusals: Refusals) -> list[_Shape]:
    skinned = _find_skinning(stage)
    shapes = []
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), Usd.TraverseInstanceProxies()):
        name = object_name(prim)
        imageable = UsdGeom.Imageable(prim)
        opened = None
        if imageable and prim.IsA(UsdGeom.Gprim) and imageable.ComputePurpose() not in _PURPOSES:
            refusals.others[f"prim of purpose {imageable.ComputePurpose()}"] += 1
        elif prim.IsA(UsdGeom.Mesh):
            opened = _open_mesh(prim, name, refusals, skinned.get(str(prim.GetPath())))
        elif prim.IsA(UsdGeom.BasisCurves):
            opened = _open_curves(prim, name, refusals)
        elif prim.IsA(UsdGeom.Points):
            opened = _open_points(prim, name, refusals)
        elif prim.IsA(UsdGeom.Gprim) or prim.IsA(UsdGeom.PointInstancer):
            refusals.refuse(name, f"the type {prim.GetTypeName()}, which is no mesh, curve or point set; convert it")
        elif prim.IsA(UsdGeom.Camera):
            refusals.others["camera"] += 1
        if opened is not None and opened.connectivity.vertex_count:
            shapes.append(opened)
    return shapes


def _changes(name: str, attributes: Sequence[Any], what: str, refusals: Refusals) -> bool:
    """Whether one of several array attributes is not always what it was first; a shape of which one is, is refused."""
    changed: list[float] = []
    for attribute in attributes:
        codes = attribute.GetTimeSamples()
        if len(codes) > 1:
            first = np.asarray(attribute.Get(codes[0]))
            changed += next(
                ([code] for code in codes[1:] if not np.array_equal(np.asarray(attribute.Get(code)), first)), []
            )
    if changed:
        refusals.refuse(name, what.format(f"at time code {min(changed):g}"))
    return bool(changed)


def _integers(attribute: Any) -> NDArray[np.int32]:
    """An integer array attribute's first value; empty where it has none."""
    found = first_value(attribute)
    return np.zeros(0, np.int32) if found is None else np.array(found, np.int32).reshape(-1)


def _points_alone(schema: Any) -> Connectivity:
    found = first_value(schema.GetPointsAttr())
    return Connectivity(0 if found is None else len(found))


def _open_mesh(prim: Any, name: str, refusals: Refusals, skinning: _Skinning | None) -> _Shape | None:
    mesh = UsdGeom.Mesh(prim)
    faces = [mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()]
    if _changes(name, faces, "faces that change {} (heterogeneous topology)", refusals):
        return None
    counts, indices = map(_integers, faces)
    if int(counts.sum(dtype=np.int64)) != indices.size or (counts < 3).any():
        refusals.refuse(name, f"faces of {int(counts.min(initial=3))} corners, or counts that do not fit the indices")
        return None
    turned = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    order = reversed_corners(counts) if turned else np.arange(indices.size)
    whole = Connectivity(_points_alone(mesh).vertex_count, face_counts=counts, face_indices=indices[order])
    extras = read_extras(prim, whole, order)
    scheme = SUBDIVISION_SCHEMES.get(str(mesh.GetSubdivisionSchemeAttr().Get()))
    if scheme is not None:
        extras.attributes.append(label_attribute(SUBDIVISION, scheme))
    for what, attribute in (
        ("creases", mesh.GetCreaseIndicesAttr()),
        ("corners", mesh.GetCornerIndicesAttr()),
        ("holes", mesh.GetHoleIndicesAttr()),
    ):
        if attribute.HasAuthoredValue() and len(first_value(attribute) or ()):
            extras.left_out.append(what)
    return _shape(name, mesh, extras.own_lines("lineCounts", "lineIndices"), extras, skinning=skinning)


def _open_curves(prim: Any, name: str, refusals: Refusals) -> _Shape | None:
    curves = UsdGeom.BasisCurves(prim)
    if _changes(name, [curves.GetCurveVertexCountsAttr()], "curves whose numbers of points change {}", refusals):
        return None
    counts, points = _integers(curves.GetCurveVertexCountsAttr()), _points_alone(curves)
    if int(counts.sum(dtype=np.int64)) != points.vertex_count or (counts < 1).any():
        refusals.refuse(name, "curves whose numbers of points do not add up")
        return None
    extras = read_extras(prim, points, np.zeros(0, np.int64))
    if curves.GetTypeAttr().Get() == UsdGeom.Tokens.cubic:
        basis = str(curves.GetBasisAttr().Get()).lower()
        extras.attributes.append(label_attribute(CURVE_BASIS, f"cubic {basis}"))
    wrap = str(curves.GetWrapAttr().Get())
    if wrap != "nonperiodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, wrap))
    connectivity, gather = extras.curves(counts)
    return _shape(name, curves, connectivity, extras, gather=gather)


def _open_points(prim: Any, name: str, refusals: Refusals) -> _Shape | None:
    points = UsdGeom.Points(prim)
    what = "points that come, go or change places {} (their ids change)"
    if _changes(name, [points.GetIdsAttr()], what, refusals):
        return None
    extras = read_extras(prim, _points_alone(points), np.zeros(0, np.int64))
    return _shape(name, points, extras.own_lines("lineCounts", "lineIndices"), extras)


def _shape(
    name: str,
    schema: Any,
    connectivity: Connectivity,
    extras: Extras,
    *,
    gather: NDArray[np.int64] | None = None,
    skinning: _Skinning | None = None,
) -> _Shape:
    if schema.GetNormalsAttr().HasAuthoredValue() and not connectivity.face_count:
        extras.left_out.append("normals")
    if schema.GetVelocitiesAttr().HasAuthoredValue():
        extras.left_out.append("velocities")
    return _Shape(
        name=name,
        connectivity=connectivity,
        attributes=extras.attributes,
        gather=gather,
        left_out=extras.left_out,
        prim=schema.GetPrim(),
        points=schema.GetPointsAttr(),
        skinning=skinning,
    )


def _metadata(stage: Any) -> dict[str, str]:
    data = stage.GetRootLayer().customLayerData
    stored = data.get(METADATA, {})
    metadata = {str(key): str(text) for key, text in stored.items()} if isinstance(stored, dict) else {}
    if stage.HasAuthoredMetadata("upAxis"):
        metadata[UP_AXIS] = str(UsdGeom.GetStageUpAxis(stage))
    if stage.HasAuthoredMetadata("metersPerUnit"):
        metadata[UNIT] = unit_text(float(UsdGeom.GetStageMetersPerUnit(stage)))
    return metadata


class _Skinning:
    """UsdSkel's blend shapes and joints, which deform one prim."""

    def __init__(self, query: Any, skeleton: Any) -> None:
        self._query, self._skeleton = query, skeleton
        self.skeleton_prim = skeleton.GetPrim()
        self._animation = skeleton.GetAnimQuery()
        self._shapes = None
        if query.HasBlendShapes() and self._animation:
            self._shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(query.GetPrim()))
            self._shape_indices = self._shapes.ComputeBlendShapePointIndices()
            self._shape_offsets = self._shapes.ComputeSubShapePointOffsets()

    @property
    def has_joints(self) -> bool:
        """Whether points end up in the skeleton's space."""
        return bool(self._query.HasJointInfluences())

    def time_codes(self) -> list[float]:
        """Time codes at which the animation is sampled."""
        if not self._animation:
            return []
        codes = list(self._animation.GetJointTransformTimeSamples())
        if self._shapes is not None:
            codes += self._animation.GetBlendShapeWeightTimeSamples()
        return codes

    def deform(self, points: Float32Array, code: float) -> Float32Array:
        """Points (vertices, 3) at rest in the prim's space, moved to a time code.

        They end up in the skeleton's space where :attr:`has_joints`, else in the prim's.
        """
        moved = Vt.Vec3fArray.FromNumpy(np.ascontiguousarray(points))
        if self._shapes is not None:
            weights = self._animation.ComputeBlendShapeWeights(code)
            mapper = self._query.GetBlendShapeMapper()
            if mapper is not None and not mapper.IsIdentity():
                weights = mapper.Remap(weights, Vt.FloatArray(self._shapes.GetNumBlendShapes()))
            sub_weights, shapes, sub_shapes = self._shapes.ComputeSubShapeWeights(weights)
            self._shapes.ComputeDeformedPoints(
                sub_weights, shapes, sub_shapes, self._shape_indices, self._shape_offsets, moved
            )
        if self.has_joints:
            self._query.ComputeSkinnedPoints(self._skeleton.ComputeSkinningTransforms(code), moved, code)
        return np.array(moved, np.float32)


def _find_skinning(stage: Any) -> dict[str, _Skinning]:
    """What deforms each skinned prim of a stage, by the prim's path."""
    cache = UsdSkel.Cache()
    predicate = Usd.TraverseInstanceProxies()
    found = {}
    for prim in Usd.PrimRange(stage.GetPseudoRoot(), predicate):
        if not prim.IsA(UsdSkel.Root):
            continue
        root = UsdSkel.Root(prim)
        cache.Populate(root, predicate)
        for binding in cache.ComputeSkelBindings(root, predicate):
            skeleton = cache.GetSkelQuery(binding.GetSkeleton())
            for query in binding.GetSkinningTargets():
                if skeleton and (query.HasJointInfluences() or query.HasBlendShapes()):
                    found[str(query.GetPrim().GetPath())] = _Skinning(query, skeleton)
    return found
