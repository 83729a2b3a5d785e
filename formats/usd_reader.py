"""USD stages: meshes, curves and points, with UsdSkel, blend shapes and transforms applied, read when asked for.

Frames stand at every time code at which something of the scene is sampled, and, where transforms or skeletons move
along no straight line, between those at the stage's frame rate; or at the rate that is asked for alone. What is not
sampled there is USD's own value at that code. Faces of left-handed meshes are turned around.
"""

from __future__ import annotations

import dataclasses
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom

from pdecodec.errors import InputError
from pdecodec.formats.attribute_roles import CURVE_BASIS, CURVE_WRAP, SUBDIVISION, label_attribute, reversed_corners
from pdecodec.formats.registry import Transforms
from pdecodec.formats.scene_reading import MOST_INSTANCED, Extras, Refusals, SceneSequence, Shape
from pdecodec.formats.scene_space import UNIT, UP_AXIS, mirrors, unit_text
from pdecodec.formats.times import (
    Timing,
    codes_of,
    merged_times,
    rate_or_default,
    resampled,
    snapped_times,
    without_gaps,
)
from pdecodec.formats.usd_attributes import METADATA, SAMPLED, first_value, object_name, read_extras
from pdecodec.formats.usd_implicit import Implicit, read_implicit
from pdecodec.formats.usd_instances import Instancer, open_instancer
from pdecodec.formats.usd_skinning import Skinning, find_skinning
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
    skinning: Skinning | None
    instancer: Instancer | None = None
    instance: int = 0

    @property
    def placed_by(self) -> Any:
        """The prim in whose space the points are."""
        return self.skinning.skeleton_prim if self.skinning is not None and self.skinning.has_joints else self.prim

    def time_codes(self) -> tuple[list[Float64Array], list[Float64Array]]:
        """Lists of codes at which its points and the transforms above it are sampled.

        Of the first lists, points move in straight lines between codes; of the second they need not.
        """
        straight: list[Any] = [self.points.GetTimeSamples()]
        curved: list[Any] = []
        if self.skinning is not None:
            (straight if self.skinning.is_linear else curved).append(self.skinning.time_codes())
        prim = self.placed_by
        if self.instancer is not None:
            straight.append(self.instancer.arrays.GetPositionsAttr().GetTimeSamples())
            curved += [one.GetTimeSamples() for one in self.instancer.turning]
            above_it = self.instancer.prim
            prims = [*_up(prim, self.instancer.roots[self.instancer.prototypes[self.instance]]), *_up(above_it)]
        else:
            prims = _up(prim)
        for prim in prims:
            xformable = UsdGeom.Xformable(prim)
            if xformable:
                moving = [op for op in xformable.GetOrderedXformOps() if op.GetNumTimeSamples() > 1]
                shifts = all(op.GetOpType() == UsdGeom.XformOp.TypeTranslate for op in moving)
                (straight if shifts else curved).append(xformable.GetTimeSamples())
        first, second = (
            [np.asarray(codes, np.float64) for codes in lists if len(codes)] for lists in (straight, curved)
        )
        return first, second


def _up(prim: Any, last: Any = None) -> list[Any]:
    """A prim and those above it whose transforms place it, up to the last one if that is given."""
    found = []
    while prim and not prim.IsPseudoRoot():
        found.append(prim)
        xformable = UsdGeom.Xformable(prim)
        if prim == last or (xformable and xformable.GetResetXformStack()):
            break
        prim = prim.GetParent()
    return found


class UsdSequence(SceneSequence):
    """The geometry of a USD stage (``.usd``, ``.usda``, ``.usdc``, ``.usdz``), which stays open until :meth:`close`.

    Where `fps` is given, frames stand at that rate from the first sample to the last; where the stage does not say
    how many time codes are a second, it is that instead.

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
            if shape.instancer is None:
                found.append(np.array(cache.GetLocalToWorldTransform(shape.placed_by), np.float64))
            else:
                found.append(shape.instancer.placed(shape.instance, shape.placed_by, cache))
        return np.array(found, np.float64).reshape(-1, 4, 4)

    def read_frames(self, start: int, stop: int) -> Float32Array:
        with _stage_errors(self._path):
            return super().read_frames(start, stop)

    def _read(self, shape: _Shape, start: int, stop: int, out: Float32Array) -> None:
        for row, code in enumerate(self._codes[start:stop].tolist()):
            points: Float32Array = np.asarray(shape.points.Get(code), np.float32).reshape(-1, 3)
            if shape.skinning is not None:
                points = shape.skinning.deform(points, code)
            out[row] = shape.fitted(points, self._path, start + row)

    @property
    def root_layer(self) -> Any:
        """The layer that the stage begins with."""
        return self._stage.GetRootLayer()

    def prim_matrices(self, prim: Any, times: Float64Array) -> Float64Array:
        """(times, 4, 4) from the space of a prim of the stage to the scene's at times [s], for points that are rows."""
        cache, found = UsdGeom.XformCache(), []
        for code in codes_of(times, self._stage.GetTimeCodesPerSecond()).tolist():
            cache.SetTime(Usd.TimeCode(code))
            found.append(np.array(cache.GetLocalToWorldTransform(prim), np.float64))
        return np.array(found, np.float64).reshape(-1, 4, 4)

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
    found = [shape.time_codes() for shape in shapes]
    straight = [codes / per_second for one, _ in found for codes in one]
    curved = [codes / per_second for _, one in found for codes in one]
    if not straight and not curved:
        code = stage.GetStartTimeCode() if stage.HasAuthoredTimeCodeRange() else 0.0
        return np.array([code]), (np.array([code / per_second]), nominal, notices if says else ())
    stored = merged_times(straight + curved)
    if says and fps is not None:
        times, notices = resampled(stored, fps)
    else:
        sampled = bool(stage.GetRootLayer().customLayerData.get(SAMPLED))
        times = without_gaps(stored, nominal) if curved and not sampled else stored
    codes = codes_of(times, per_second)
    return codes, (snapped_times(codes / per_second, per_second), nominal, notices)


@contextmanager
def _stage_errors(path: Path) -> Iterator[None]:
    try:
        yield
    except (Tf.ErrorException, UnicodeDecodeError) as error:
        try:
            lines = [line.strip() for line in str(error).splitlines() if line.strip()]
        except UnicodeDecodeError:
            # USD's message quotes the file.
            lines = ["its text is not UTF-8"]
        reason = lines[-1] if lines else "unknown"
        raise InputError(f"is no USD file, or a damaged one ({reason}); export it again", path=path) from error


def _open_stage(path: Path) -> Any:
    known = Sdf.Layer.Find(str(path))
    if known is not None:
        # USD keeps files that are open: this one may have been written again since.
        known.Reload()
    return Usd.Stage.Open(str(path))


def _find_shapes(stage: Any, refusals: Refusals) -> list[_Shape]:
    shapes = _shapes_below(stage.GetPseudoRoot(), find_skinning(stage), refusals)
    counts = Counter(shape.prim.GetTypeName() for shape in shapes if isinstance(shape.points, Implicit))
    refusals.tessellated.update(counts)
    return shapes


def _shapes_below(root: Any, skinned: Mapping[str, Skinning], refusals: Refusals) -> list[_Shape]:
    """Shapes at and below a prim; those of instancers once for each instance."""
    shapes: list[_Shape] = []
    prims = iter(Usd.PrimRange(root, Usd.TraverseInstanceProxies()))
    for prim in prims:
        name = object_name(prim)
        imageable = UsdGeom.Imageable(prim)
        skinning = skinned.get(str(prim.GetPath()))
        opened = None
        if imageable and prim.IsA(UsdGeom.Gprim) and imageable.ComputePurpose() not in _PURPOSES:
            refusals.others[f"prim of purpose {imageable.ComputePurpose()}"] += 1
        elif prim.IsA(UsdGeom.PointInstancer):
            # Prototypes below it stand nowhere by themselves.
            prims.PruneChildren()
            shapes += _instances(prim, name, skinned, refusals)
        elif prim.IsA(UsdGeom.Mesh):
            opened = _open_mesh(prim, name, refusals, skinning)
        elif prim.IsA(UsdGeom.BasisCurves):
            opened = _open_curves(prim, name, refusals, skinning)
        elif prim.IsA(UsdGeom.Points):
            opened = _open_points(prim, name, refusals, skinning)
        elif (implicit := read_implicit(prim)) is not None:
            opened = _open_implicit(prim, name, implicit, skinning)
        elif prim.IsA(UsdGeom.Gprim):
            refusals.refuse(name, f"the type {prim.GetTypeName()}, which is no mesh, curve or point set; convert it")
        elif prim.IsA(UsdGeom.Camera):
            refusals.others["camera"] += 1
        if opened is not None and opened.connectivity.vertex_count:
            opened.hidden = _is_hidden(prim)
            shapes.append(opened)
    return shapes


def _open_implicit(prim: Any, name: str, implicit: Implicit, skinning: Skinning | None) -> _Shape:
    extras = read_extras(prim, implicit.connectivity, np.arange(implicit.connectivity.face_indices.size))
    extras.attributes.append(implicit.normal_group)
    return _Shape(
        name=name,
        connectivity=implicit.connectivity,
        attributes=extras.attributes,
        left_out=extras.left_out,
        prim=prim,
        points=implicit,
        skinning=skinning,
    )


def _instances(prim: Any, name: str, skinned: Mapping[str, Skinning], refusals: Refusals) -> list[_Shape]:
    """A shape for each instance and each shape of its prototype."""
    arrays = UsdGeom.PointInstancer(prim)
    what = "instances that come, go or change places {}"
    if _changes(name, [arrays.GetProtoIndicesAttr(), arrays.GetIdsAttr()], what, refusals):
        return []
    instancer = open_instancer(prim)
    if isinstance(instancer, str):
        refusals.refuse(name, instancer)
        return []
    found: dict[int, list[_Shape]] = {}
    for number in np.unique(instancer.prototypes[instancer.shown]).tolist():
        found[number] = _shapes_below(instancer.roots[number], skinned, refusals)
        odd = [one for one in found[number] if one.instancer or (one.skinning is not None and one.skinning.has_joints)]
        if odd:
            refusals.refuse(name, f"a prototype with instances or joints of its own ({odd[0].name}); convert it")
            return []
    numbers = np.flatnonzero(instancer.shown).tolist()
    vertices = sum(one.connectivity.vertex_count for k in numbers for one in found[int(instancer.prototypes[k])])
    if vertices > MOST_INSTANCED:
        refusals.refuse(name, f"instances of {vertices:,} vertices, more than {MOST_INSTANCED:,}; thin them out")
        return []
    shapes = []
    for number in numbers:
        prototype = int(instancer.prototypes[number])
        root = object_name(instancer.roots[prototype])
        for one in found[prototype]:
            inner = f"{name}/{number}{one.name.removeprefix(root)}"
            hidden = one.hidden or bool(instancer.hidden[number])
            shapes.append(dataclasses.replace(one, name=inner, instancer=instancer, instance=number, hidden=hidden))
    return shapes


def _is_hidden(prim: Any) -> bool:
    """Whether a prim or one above it is invisible, always or at times."""
    while prim and not prim.IsPseudoRoot():
        visibility = UsdGeom.Imageable(prim).GetVisibilityAttr() if prim.IsA(UsdGeom.Imageable) else None
        if visibility and visibility.HasAuthoredValue():
            codes = [Usd.TimeCode(code) for code in visibility.GetTimeSamples()] or [Usd.TimeCode.Default()]
            if any(visibility.Get(code) == UsdGeom.Tokens.invisible for code in codes):
                return True
        prim = prim.GetParent()
    return False


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


def _moves(schema: Any, skinning: Skinning | None) -> bool:
    """Whether points move in the shape's own space."""
    return skinning is not None or schema.GetPointsAttr().GetNumTimeSamples() > 1


def _open_mesh(prim: Any, name: str, refusals: Refusals, skinning: Skinning | None) -> _Shape | None:
    mesh = UsdGeom.Mesh(prim)
    faces = [mesh.GetFaceVertexCountsAttr(), mesh.GetFaceVertexIndicesAttr()]
    if _changes(name, faces, "faces that change {} (heterogeneous topology)", refusals):
        return None
    counts, indices = map(_integers, faces)
    if int(counts.sum(dtype=np.int64)) != indices.size or (counts < 3).any():
        refusals.refuse(name, f"faces of {int(counts.min(initial=3))} corners, or counts that do not fit the indices")
        return None
    turned = mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded
    if skinning is not None and skinning.has_joints:
        # Where the mesh stands itself says which side of it is outside; its points come out where the skeleton stands.
        cache = UsdGeom.XformCache(Usd.TimeCode.EarliestTime())
        own, joints = (cache.GetLocalToWorldTransform(one) for one in (prim, skinning.skeleton_prim))
        turned ^= mirrors([np.array(own * joints, np.float64)])
    order = reversed_corners(counts) if turned else np.arange(indices.size)
    whole = Connectivity(_points_alone(mesh).vertex_count, face_counts=counts, face_indices=indices[order])
    extras = read_extras(prim, whole, order, moves=_moves(mesh, skinning))
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


def _open_curves(prim: Any, name: str, refusals: Refusals, skinning: Skinning | None) -> _Shape | None:
    curves = UsdGeom.BasisCurves(prim)
    if _changes(name, [curves.GetCurveVertexCountsAttr()], "curves whose numbers of points change {}", refusals):
        return None
    counts, points = _integers(curves.GetCurveVertexCountsAttr()), _points_alone(curves)
    if int(counts.sum(dtype=np.int64)) != points.vertex_count or (counts < 1).any():
        refusals.refuse(name, "curves whose numbers of points do not add up")
        return None
    extras = read_extras(prim, points, np.zeros(0, np.int64), moves=_moves(curves, skinning))
    if curves.GetTypeAttr().Get() == UsdGeom.Tokens.cubic:
        basis = str(curves.GetBasisAttr().Get()).lower()
        extras.attributes.append(label_attribute(CURVE_BASIS, f"cubic {basis}"))
    wrap = str(curves.GetWrapAttr().Get())
    if wrap != "nonperiodic":
        extras.attributes.append(label_attribute(CURVE_WRAP, wrap))
    connectivity, gather = extras.curves(counts)
    return _shape(name, curves, connectivity, extras, gather=gather, skinning=skinning)


def _open_points(prim: Any, name: str, refusals: Refusals, skinning: Skinning | None) -> _Shape | None:
    points = UsdGeom.Points(prim)
    what = "points that come, go or change places {} (their ids change)"
    if _changes(name, [points.GetIdsAttr()], what, refusals):
        return None
    extras = read_extras(prim, _points_alone(points), np.zeros(0, np.int64), moves=_moves(points, skinning))
    return _shape(name, points, extras.own_lines("lineCounts", "lineIndices"), extras, skinning=skinning)


def _shape(
    name: str,
    schema: Any,
    connectivity: Connectivity,
    extras: Extras,
    *,
    gather: NDArray[np.int64] | None = None,
    skinning: Skinning | None = None,
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
