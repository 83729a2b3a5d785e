"""What KHR_mesh_quantization keeps of a mesh: positions in 16 bits, normals that targets add in 8."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pdecodec.formats.gltf.motion import Motion, largest_angle
from pdecodec.mesh.arrays import Float32Array, Float64Array


@dataclass(frozen=True)
class Lattice:
    """Where 16-bit positions stand: ``offset + scale * fraction``, fractions between -1 and 1.

    Attributes
    ----------
    scale : float [scene units]
    offset : (3,) float64 [scene units]
    error : float [scene units]
        Largest distance along an axis that a vertex is moved by, at a sample.
    """

    scale: float
    offset: Float64Array
    error: float

    def fractions(self, points: Float32Array) -> Float64Array:
        """Of positions (vertices, 3)."""
        return np.clip((points.astype(np.float64) - self.offset) / self.scale, -1, 1)


def lattice_of(motion: Motion, *, centred: bool) -> Lattice:
    """The finest lattice for a motion's shapes, which are multiples of its scale; `centred` about the origin."""
    low, high = motion.rest.min(axis=0).astype(np.float64), motion.rest.max(axis=0).astype(np.float64)
    offset = np.zeros(3) if centred else ((low + high) / 2).astype(np.float32).astype(np.float64)
    reach = max(float(np.abs(one).max(initial=0)) for one in (low - offset, high - offset, motion.targets))
    scale = float(np.nextafter(np.float32(reach), np.float32(np.inf))) or 1.0
    step = scale / np.iinfo(np.int16).max

    def rounding(shapes: NDArray[np.floating]) -> Float64Array:
        return np.asarray(np.rint(shapes / step) * step - shapes)

    rest, targets = rounding(motion.rest - offset), rounding(motion.targets.astype(np.float64))
    if motion.functions is None:
        moved = rest + np.concatenate([np.zeros((1, *rest.shape)), targets])
    else:
        functions = motion.functions if len(targets) else np.zeros((1, 0))
        moved = rest + np.tensordot(functions, targets, 1)
    return Lattice(scale, offset, float(np.abs(moved).max(initial=0)))


def with_rounded_normals(motion: Motion) -> tuple[Motion, float]:
    """A motion whose normals fractions hold, and the largest angle at a sample by which they turn [degrees].

    Those at rest have 16 bits, and those that targets add 8. What a target adds must be between -1 and 1. Where each
    frame is a target, normals turn farther than that: a further target, of 16 bits too, takes those at rest away, and
    each frame's has its own normals whole, which are rounded once. Of functions of time few targets add more than 1:
    these stay as they are.
    """
    if motion.normals is None or motion.normal_targets is None:
        return motion, 0.0
    # Toward 0: Blender takes for flat what is longer than 1 along the normal of its triangle.
    rest, before = _fractions(motion.normals, np.int16, np.trunc), motion.turned_normals()
    if motion.functions is None and len(motion.targets):
        rounded = dataclasses.replace(
            motion,
            targets=np.concatenate([motion.targets, np.zeros_like(motion.targets[:1])]),
            normals=rest,
            normal_targets=np.concatenate([_fractions(before[1:], np.int8, np.rint), -rest[None]]),
            is_away_from_rest=True,
        )
    else:
        fits = np.abs(motion.normal_targets).max(axis=(1, 2), initial=0) <= 1
        targets = np.where(
            fits[:, None, None], _fractions(motion.normal_targets, np.int8, np.rint), motion.normal_targets
        )
        rounded = dataclasses.replace(motion, normals=rest, normal_targets=targets)
    return rounded, largest_angle(rounded.turned_normals(), before)


def _fractions(values: NDArray[np.floating], dtype: type[np.signedinteger[Any]], rounding: np.ufunc) -> Float32Array:
    largest = np.iinfo(dtype).max
    return np.asarray(rounding(values.astype(np.float64) * largest) / largest, np.float32)
