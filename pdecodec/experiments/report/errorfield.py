"""Where errors are: over time and over the mesh."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.metrics import Distortion, DistortionMeter, frame_scale
from pdecodec.sequence import ArraySequence, Float32Array, Float64Array


@dataclass(frozen=True, eq=False)
class ErrorField:
    """Errors of one decoded file, over the diagonal of frame 0.

    Attributes
    ----------
    tolerance : float
    distortion : Distortion
        Of everything; it names the worst frame and vertex.
    average_by_frame, maximum_by_frame : (frames,) float64
        E_An and E_Mn of Eqs. 26 and 27.
    maximum_by_vertex : (vertices,) float64
        Over all frames.
    at_worst_frame : (vertices,) float64
    worst_points : (vertices, 3) float32 [scene units]
        What was decoded at the worst frame.
    """

    tolerance: float
    distortion: Distortion
    average_by_frame: Float64Array
    maximum_by_frame: Float64Array
    maximum_by_vertex: Float64Array
    at_worst_frame: Float64Array
    worst_points: Float32Array


def measure_field(sequence: ArraySequence, *, tolerance: float, effort: int) -> ErrorField:
    """Encode under profile "auto", decode, and keep where the errors are."""
    report = encode(sequence, tolerance=tolerance, effort=effort)
    scale = frame_scale(sequence.points[0])
    meter = DistortionMeter(scale=scale)
    by_vertex = np.zeros(sequence.vertex_count)
    with open_animation(report.data or b"") as animation:
        for start, block in sequence.blocks():
            decoded = animation.read_frames(start, start + len(block))
            meter.add(block, decoded)
            for before, after in zip(block, decoded, strict=True):
                np.maximum(by_vertex, _distances(before, after), out=by_vertex)
        distortion = meter.result()
        worst = distortion.worst_frame
        worst_points = animation.read_frames(worst, worst + 1)[0]
    return ErrorField(
        tolerance=tolerance,
        distortion=distortion,
        average_by_frame=np.array(meter.average_by_frame) / scale,
        maximum_by_frame=np.array(meter.maximum_by_frame) / scale,
        maximum_by_vertex=by_vertex / scale,
        at_worst_frame=_distances(sequence.points[worst], worst_points) / scale,
        worst_points=worst_points,
    )


def _distances(reference: Float32Array, other: Float32Array) -> Float64Array:
    return np.asarray(np.linalg.norm(reference.astype(np.float64) - other, axis=1))
