"""The demonstration: simulate the cube-rope, encode it, decode it at its frames and between them, and measure.

The rope is that of Fang et al. 2024, section 5: 24 curves of 832 points, simulated with XPBD.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.encodereport import EncodeReport
from pdecodec.metrics import Distortion, bits_per_vertex_frame, measure_distortion
from pdecodec.resample import LinearInterpolation, SampledAnimation
from pdecodec.selection import FrameSelection
from pdecodec.sequence import ArraySequence, Float32Array, Progress
from pdecodec.settings import EncodeSettings
from pdecodec.xpbd import build

FRAMES = 61
"""Odd, so that the frames left out of every second one all lie between two that are kept."""

FPS = 24.0

TOLERANCE = 1e-3

RATE_TOLERANCES = (1e-2, 3e-3, TOLERANCE, 3e-4)
"""Tolerances of the picture's rate chart."""

PICTURE_FRAMES = 4
"""Frames shown in the picture, spread over the clip."""


@dataclass(frozen=True)
class Encoding:
    """One `.pdeanim` of the demonstration, and how far its frames are from the simulated ones."""

    name: str
    report: EncodeReport
    decode_seconds: float
    distortion: Distortion

    @property
    def bits(self) -> float:
        """Rate in bits per vertex and frame, everything counted."""
        return bits_per_vertex_frame(self.report.file_bytes, vertices=self.report.vertices, frames=self.report.frames)


@dataclass(frozen=True)
class Between:
    """Errors at the frames that were left out, of the codec and of straight lines between the frames kept."""

    decoded: Distortion
    linear: Distortion


@dataclass(frozen=True)
class Demonstration:
    """All that the demonstration found.

    Attributes
    ----------
    sequence : ArraySequence
        The simulated clip.
    simulate_seconds : float
    encodings : tuple of Encoding
        Profile "auto" at :data:`TOLERANCE` first, then profile "paper".
    rates : tuple of Encoding
        Profile "auto" at each of :data:`RATE_TOLERANCES`.
    between : Between
    picture_frames : tuple of int
    picture_points : (picture frames, vertices, 3) float32 [scene units]
        Decoded positions of the first encoding at those frames.
    """

    sequence: ArraySequence
    simulate_seconds: float
    encodings: tuple[Encoding, ...]
    rates: tuple[Encoding, ...]
    between: Between
    picture_frames: tuple[int, ...]
    picture_points: Float32Array


def demonstrate(
    directory: Path,
    *,
    scene_options: dict[str, Any] | None = None,
    frames: int = FRAMES,
    progress: Progress | None = None,
) -> Demonstration:
    """Run the demonstration and leave its `.pdeanim` files in `directory`.

    Parameters
    ----------
    directory : Path
        Exists; files of the same names in it are replaced.
    scene_options : dict, optional
        Options of the cube-rope; default: the paper's size.
    frames : int
        Odd.
    progress : callable, optional
    """
    started = time.perf_counter()
    scene = build("cube-rope", **(scene_options or {}))
    sequence = scene.simulate(frames=frames, fps=FPS).to_array()
    simulate_seconds = time.perf_counter() - started

    _compile(sequence)

    def encoded(name: str, settings: EncodeSettings) -> Encoding:
        return _encode(sequence, directory / f"{name}.pdeanim", name, settings, progress)

    encodings = (
        encoded("rope", EncodeSettings(tolerance=TOLERANCE)),
        encoded("rope-paper", EncodeSettings(profile="paper")),
    )
    rates = tuple(
        encodings[0] if tolerance == TOLERANCE else encoded(f"rope-{tolerance:g}", EncodeSettings(tolerance=tolerance))
        for tolerance in RATE_TOLERANCES
    )
    shown = tuple(np.linspace(0, frames - 1, PICTURE_FRAMES + 1).astype(int)[1:].tolist())
    with open_animation(directory / "rope.pdeanim") as animation:
        points = np.concatenate([animation.read_frames(frame, frame + 1) for frame in shown])
    return Demonstration(
        sequence=sequence,
        simulate_seconds=simulate_seconds,
        encodings=encodings,
        rates=rates,
        between=_between_frames(sequence, directory / "rope-every-second.pdeanim", progress),
        picture_frames=shown,
        picture_points=points,
    )


def _compile(sequence: ArraySequence) -> None:
    """Run everything once on a few frames, so that the times shown are not those of compiling."""
    for settings in (EncodeSettings(), EncodeSettings(profile="paper")):
        report = encode(FrameSelection(sequence, range(8)), settings=settings)
        with open_animation(report.data or b"") as animation:
            animation.read_frames(0, animation.frame_count)


def _encode(
    sequence: ArraySequence, path: Path, name: str, settings: EncodeSettings, progress: Progress | None
) -> Encoding:
    report = encode(sequence, path, settings, overwrite=True, progress=progress)
    with open_animation(path) as animation:
        started = time.perf_counter()
        decoded = animation.to_array()
        seconds = time.perf_counter() - started
    return Encoding(name, report, seconds, measure_distortion(sequence, decoded))


def _between_frames(sequence: ArraySequence, path: Path, progress: Progress | None) -> Between:
    """Encode every second frame, and compare what lies between them with the frames left out."""
    kept = FrameSelection(sequence, range(0, sequence.frame_count, 2))
    left_out = FrameSelection(sequence, range(1, sequence.frame_count, 2))
    encode(kept, path, EncodeSettings(tolerance=TOLERANCE), overwrite=True, progress=progress)
    scale = measure_distortion(sequence, sequence).scale
    with open_animation(path) as animation:
        decoded = measure_distortion(left_out, SampledAnimation(animation, left_out.times), scale=scale)
    linear = measure_distortion(left_out, LinearInterpolation(kept, left_out.times), scale=scale)
    return Between(decoded, linear)
