"""Velocities of a sequence: an animation's own, else central differences of its positions."""

from __future__ import annotations

import numpy as np

from pdecodec.sequence import Float32Array, MeshSequence, check_frame_range


def velocities_of(sequence: MeshSequence) -> MeshSequence:
    """Velocities of a sequence at its frames [scene units / s]."""
    from pdecodec.decoder import Animation
    from pdecodec.resample import SampledAnimation

    if isinstance(sequence, Animation):
        return SampledAnimation(sequence, sequence.times, quantity="velocities")
    return DifferencedVelocities(sequence)


class DifferencedVelocities(MeshSequence):
    """Velocities of another sequence at its frames, exact where vertices move by quadratics of time.

    Inside, the slope at a frame of the parabola through it and its neighbours; at the ends, of the line to the next
    frame; zero where there is one frame alone.

    Parameters
    ----------
    source : MeshSequence
    """

    def __init__(self, source: MeshSequence) -> None:
        self._source = source
        self.objects = source.objects
        self.times, self.fps = source.times, source.fps
        self.metadata, self.notices = source.metadata, source.notices

    def read_frames(self, start: int, stop: int) -> Float32Array:
        """(stop - start, vertices, 3) float32 [scene units / s]."""
        check_frame_range(self, start, stop)
        if start == stop or self.frame_count == 1:
            return np.zeros((stop - start, self.vertex_count, 3), np.float32)
        low, high = max(0, start - 1), min(self.frame_count, stop + 1)
        points = self._source.read_frames(low, high).astype(np.float64)
        steps = np.diff(self.times[low:high])[:, None, None]
        slopes = np.diff(points, axis=0) / steps
        inner = (steps[1:] * slopes[:-1] + steps[:-1] * slopes[1:]) / (steps[1:] + steps[:-1])
        every = np.concatenate([slopes[:1], inner, slopes[-1:]])
        with np.errstate(over="ignore"):
            return every[start - low : stop - low].astype(np.float32)

    def close(self) -> None:
        self._source.close()
