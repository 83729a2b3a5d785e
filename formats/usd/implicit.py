"""Turn USD's implicit shapes (Sphere, Cube, Cylinder, Cone, Capsule, Plane) into polygons.

Points are sums of fixed vectors times the shape's sizes, so that sizes may change with time.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Usd

from pdecodec.formats.base.normals import normal_group
from pdecodec.formats.usd.values import spline_codes
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.sequence import Attribute, Connectivity

SIDES = 32
"""Number of sides of round shapes; their surface is off by half a percent of the radius."""

_AXES = {"X": [2, 0, 1], "Y": [1, 2, 0], "Z": [0, 1, 2]}
"""Order of coordinates that turns a shape along Z to another axis."""

_Solid = tuple[Mapping[str, Float64Array], list[list[int]], list[int]]
"""Vectors (points, 3) for each size, faces, and the number of the smooth part that each face belongs to."""


@dataclass(frozen=True, eq=False)
class Implicit:
    """Points of an implicit shape, with the methods of a USD attribute.

    Attributes
    ----------
    connectivity : Connectivity
    normal_group : Attribute
    """

    connectivity: Connectivity
    normal_group: Attribute
    _sizes: Mapping[Any, Float64Array]
    _axis: list[int]

    def GetTimeSamples(self) -> list[float]:  # noqa: N802 - as USD's attributes have it
        """Return the time codes at which a size is sampled, in order."""
        return sorted({code for attribute in self._sizes for code in attribute.GetTimeSamples()})

    def spline_codes(self, stage: Any) -> list[float]:
        """Return the time codes between which a size follows its spline, in order."""
        return sorted({code for attribute in self._sizes for code in spline_codes(attribute, stage)})

    def Get(self, code: float) -> Float32Array:  # noqa: N802 - as USD's attributes have it
        """Return the points (points, 3) float32 at a time code."""
        points = sum(float(attribute.Get(Usd.TimeCode(code))) * part for attribute, part in self._sizes.items())
        return np.asarray(points)[:, self._axis].astype(np.float32)


def read_implicit(prim: Any) -> Implicit:
    """Return the polygons of an implicit shape, a prim of one of :data:`IMPLICIT_TYPES`."""
    vectors, faces, parts = _SOLIDS[str(prim.GetTypeName())]()
    counts = np.array([len(face) for face in faces], np.int32)
    points = len(next(iter(vectors.values())))
    connectivity = Connectivity(points, counts, np.concatenate([np.array(face, np.int32) for face in faces]))
    axis = prim.GetAttribute("axis").Get() if prim.HasAttribute("axis") else "Z"
    sizes = {prim.GetAttribute(name): part for name, part in vectors.items()}
    return Implicit(connectivity, normal_group(connectivity, np.repeat(parts, counts)), sizes, _AXES[str(axis)])


def _ring() -> Float64Array:
    angle = np.arange(SIDES) * (2 * np.pi / SIDES)
    return np.stack([np.cos(angle), np.sin(angle), np.zeros(SIDES)], axis=1)


def _band(first: int, second: int) -> list[list[int]]:
    """Return the quads between a ring of points and the one above it, given the first point of each."""
    steps = [(k, (k + 1) % SIDES) for k in range(SIDES)]
    return [[first + a, first + b, second + b, second + a] for a, b in steps]


def _fan(ring: int, tip: int, *, up: bool) -> list[list[int]]:
    """Return the triangles between a ring and a point above or below it."""
    steps = [(k, (k + 1) % SIDES) for k in range(SIDES)]
    return [[ring + a, ring + b, tip] if up else [ring + b, ring + a, tip] for a, b in steps]


def _latitudes(angles: NDArray[np.floating]) -> Float64Array:
    """Return rings of the unit sphere at latitudes [radians], one after the other."""
    rings = [np.cos(angle) * _ring() + [0, 0, np.sin(angle)] for angle in angles]
    return np.concatenate(rings)


def _sphere() -> _Solid:
    inner = (np.arange(1, SIDES // 2) / (SIDES // 2) - 0.5) * np.pi
    points = np.concatenate([_latitudes(inner), [[0, 0, -1], [0, 0, 1]]])
    last = len(points) - 2
    faces = [face for k in range(inner.size - 1) for face in _band(k * SIDES, (k + 1) * SIDES)]
    faces += _fan(0, last, up=False) + _fan(last - SIDES, last + 1, up=True)
    return {"radius": points}, faces, [0] * len(faces)


def _capsule(low: str = "radius", high: str = "radius") -> _Solid:
    half = np.arange(SIDES // 4) / (SIDES // 4) * (np.pi / 2)
    rings = 2 * half.size * SIDES
    lower = np.concatenate([_latitudes(-half[::-1]), np.zeros((rings // 2, 3)), [[0, 0, -1], [0, 0, 0]]])
    upper = np.concatenate([np.zeros((rings // 2, 3)), _latitudes(half), [[0, 0, 0], [0, 0, 1]]])
    middle = np.zeros((rings + 2, 3))
    middle[:, 2] = [*[-0.5] * (rings // 2), *[0.5] * (rings // 2), -0.5, 0.5]
    faces = [face for k in range(rings // SIDES - 1) for face in _band(k * SIDES, (k + 1) * SIDES)]
    faces += _fan(0, rings, up=False) + _fan(rings - SIDES, rings + 1, up=True)
    sizes = {low: lower + upper} if low == high else {low: lower, high: upper}
    return {**sizes, "height": middle}, faces, [0] * len(faces)


def _cylinder(low: str = "radius", high: str = "radius") -> _Solid:
    ring, none = _ring(), np.zeros((SIDES, 3))
    lower, upper = np.concatenate([ring, none]), np.concatenate([none, ring])
    height = np.zeros((2 * SIDES, 3))
    height[:, 2] = np.repeat([-0.5, 0.5], SIDES)
    faces = [*_band(0, SIDES), list(range(SIDES))[::-1], list(range(SIDES, 2 * SIDES))]
    sizes = {low: lower + upper} if low == high else {low: lower, high: upper}
    return {**sizes, "height": height}, faces, [0] * SIDES + [1, 2]


def _cone() -> _Solid:
    height = np.zeros((SIDES + 1, 3))
    height[:, 2] = [*[-0.5] * SIDES, 0.5]
    faces = [*_fan(0, SIDES, up=True), list(range(SIDES))[::-1]]
    return {"radius": np.concatenate([_ring(), np.zeros((1, 3))]), "height": height}, faces, [0] * SIDES + [1]


def _cube() -> _Solid:
    points = np.array([[x, y, z] for z in (-0.5, 0.5) for y in (-0.5, 0.5) for x in (-0.5, 0.5)])
    faces = [[0, 2, 3, 1], [4, 5, 7, 6], [0, 1, 5, 4], [2, 6, 7, 3], [0, 4, 6, 2], [1, 3, 7, 5]]
    return {"size": points}, faces, list(range(6))


def _plane() -> _Solid:
    """Width and length lie along X and Y if the axis is Z, along Z and Y if it is X, and along X and Z if it is Y."""
    width, length = np.zeros((4, 3)), np.zeros((4, 3))
    width[:, 0], length[:, 1] = [-0.5, 0.5, 0.5, -0.5], [-0.5, -0.5, 0.5, 0.5]
    return {"width": width, "length": length}, [[0, 1, 2, 3]], [0]


_SOLIDS: Mapping[str, Callable[[], _Solid]] = {
    "Sphere": _sphere,
    "Cube": _cube,
    "Cylinder": _cylinder,
    "Cylinder_1": lambda: _cylinder("radiusBottom", "radiusTop"),
    "Cone": _cone,
    "Capsule": _capsule,
    "Capsule_1": lambda: _capsule("radiusBottom", "radiusTop"),
    "Plane": _plane,
}
"""Functions that return the polygons of each type of shape, along Z."""

IMPLICIT_TYPES = frozenset(_SOLIDS)
"""Types of prims that are implicit shapes."""
