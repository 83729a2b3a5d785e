"""The demonstration: simulate the cube-rope, encode it, decode it at its frames and between them, measure, draw.

The rope is that of Fang et al. 2024, section 5: 24 curves of 832 points, simulated with XPBD.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.codec.encode.encoder import encode
from pdecodec.codec.encode.report import SECTION_TITLES, EncodeReport
from pdecodec.codec.opening import open_animation
from pdecodec.codec.resampling import LinearInterpolation, SampledAnimation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import Distortion, bits_per_vertex_frame, frame_scale, measure_distortion
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence, Progress
from pdecodec.mesh.surface_metrics import SurfaceDistortion, measure_surfaces
from pdecodec.report.charts.drawing import (
    as_seen,
    draw_mesh,
    draw_near,
    heat_map,
    hide_axes,
    quads_of,
    require_drawing,
    write,
)
from pdecodec.report.charts.figure import Canvas
from pdecodec.simulate import build

FRAMES = 61
"""Odd, so that the frames left out of every second one all lie between two that are kept."""

FPS = 24.0

TOLERANCE = 1e-3

RATE_TOLERANCES = (1e-2, 3e-3, TOLERANCE, 3e-4)
"""Tolerances of the picture's rate chart."""

PICTURE_FRAMES = 4
"""Frames shown in the picture, spread over the clip."""


WIDTH, HEIGHT, DOTS_PER_INCH = 13.5, 7.6, 90

CLOSE_UP = 0.14
"""Width of the close-up around the worst vertex, over the diagonal."""

RATE_TICKS = (0.01, 0.03, 0.1, 0.3, 1, 3, 10, 30)

SECTIONS_SHOWN = 5
"""Largest sections of the bar chart; the rest are a few hundred bytes together."""

SIMULATED_COLOUR = (0.36, 0.52, 0.72)
DECODED_COLOUR = (0.86, 0.52, 0.26)


@dataclass(frozen=True)
class Encoding:
    """One `.pdeanim` of the demonstration, and how far its frames are from the simulated ones."""

    name: str
    report: EncodeReport
    decode_seconds: float
    distortion: Distortion
    surface: SurfaceDistortion

    @property
    def bits(self) -> float:
        """Rate in bits per vertex and frame, everything counted."""
        return bits_per_vertex_frame(self.report.file_bytes, vertices=self.report.vertices, frames=self.report.frames)


@dataclass(frozen=True)
class Between:
    """Errors at the frames that were left out, of the codec and of straight lines between the frames kept."""

    decoded: Distortion
    linear: Distortion
    decoded_surface: SurfaceDistortion
    linear_surface: SurfaceDistortion


@dataclass(frozen=True)
class Demonstration:
    """All that the demonstration found: the simulated clip; profile auto at :data:`TOLERANCE` and profile paper;
    profile auto at each of :data:`RATE_TOLERANCES`; errors between frames; and what the first encoding decodes to at
    some frames, (picture frames, vertices, 3) float32 [scene units].
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
    """Run the demonstration and leave its `.pdeanim` files in `directory`, which exists; `frames` is odd.

    `scene_options` are those of the cube-rope, by default the paper's size.
    """
    started = time.perf_counter()
    scene = build("cube-rope", **(scene_options or {}))
    sequence = scene.simulate(frames=frames, fps=FPS).to_array()
    simulate_seconds = time.perf_counter() - started

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


def _encode(
    sequence: ArraySequence, path: Path, name: str, settings: EncodeSettings, progress: Progress | None
) -> Encoding:
    report = encode(sequence, path, settings, overwrite=True, progress=progress)
    with open_animation(path) as animation:
        started = time.perf_counter()
        decoded = animation.to_array()
        seconds = time.perf_counter() - started
    found = measure_distortion(sequence, decoded)
    return Encoding(name, report, seconds, found, measure_surfaces(sequence, decoded, found.scale))


def _between_frames(sequence: ArraySequence, path: Path, progress: Progress | None) -> Between:
    """Encode every second frame, and compare what lies between them with the frames left out."""
    kept = FrameSelection(sequence, range(0, sequence.frame_count, 2))
    left_out = FrameSelection(sequence, range(1, sequence.frame_count, 2))
    encode(kept, path, EncodeSettings(tolerance=TOLERANCE), overwrite=True, progress=progress)
    scale = measure_distortion(sequence, sequence).scale
    with open_animation(path) as animation:
        sampled = SampledAnimation(animation, left_out.times)
        decoded = measure_distortion(left_out, sampled, scale=scale)
        decoded_surface = measure_surfaces(left_out, sampled, scale)
    straight = LinearInterpolation(kept, left_out.times)
    return Between(
        decoded=decoded,
        linear=measure_distortion(left_out, straight, scale=scale),
        decoded_surface=decoded_surface,
        linear_surface=measure_surfaces(left_out, straight, scale),
    )


def draw(demonstration: Demonstration, path: Path) -> None:
    """Write the picture as PNG, replacing it when it exists; MissingExtraError where matplotlib is not installed."""
    require_drawing("matplotlib")
    from matplotlib.figure import Figure

    canvas = Figure(figsize=(WIDTH, HEIGHT), dpi=DOTS_PER_INCH)
    overview = [canvas.add_axes((0.005 + 0.32 * column, 0.44, 0.315, 0.47)) for column in range(3)]
    close = [canvas.add_axes((0.005 + 0.175 * column, 0.03, 0.17, 0.35)) for column in range(3)]
    first = demonstration.encodings[0]
    canvas.suptitle(
        f"{first.report.raw_bytes / 1e6:.1f} MB of motion in {first.report.file_bytes / 1e3:,.0f} kB "
        f"({first.report.raw_bytes / first.report.file_bytes:.0f}:1), "
        f"maximum error {first.distortion.e_m:.2g} of the diagonal",
        fontsize=12,
    )
    _draw_meshes(demonstration, canvas, overview, close)
    _draw_rates(demonstration, canvas.add_axes((0.595, 0.075, 0.165, 0.29)))
    _draw_sections(demonstration, canvas.add_axes((0.845, 0.075, 0.145, 0.29)))
    canvas.savefig(path, metadata={"Software": None})


def _draw_meshes(demonstration: Demonstration, canvas: Canvas, overview: list[Any], close: list[Any]) -> None:
    """Three ways to see the clip: the chosen frames one below the other, and the worst of them close up."""
    sequence = demonstration.sequence
    frames = demonstration.picture_frames
    quads = quads_of(sequence.connectivity)
    diagonal = frame_scale(sequence.points[0])
    simulated = as_seen(sequence.points[list(frames)])
    decoded = as_seen(demonstration.picture_points)
    errors = np.linalg.norm(sequence.points[list(frames)] - demonstration.picture_points.astype(np.float64), axis=2)
    errors /= diagonal
    heat = heat_map(1.0)
    worst, vertex = np.unravel_index(int(errors.argmax()), errors.shape)
    centre = decoded[worst, vertex, :2]
    reach = 0.5 * CLOSE_UP * diagonal
    heights = _stacked(simulated)
    solid = [np.broadcast_to(colour, (len(quads), 3)) for colour in (SIMULATED_COLOUR, DECODED_COLOUR)]
    columns = (
        ("simulated", simulated, [solid[0]] * len(frames)),
        ("decoded", decoded, [solid[1]] * len(frames)),
        ("error", decoded, [heat.to_rgba(row[quads].max(axis=1) / TOLERANCE)[:, :3] for row in errors]),
    )
    for (name, points, colours), wide, near in zip(columns, overview, close, strict=True):
        placed = points.copy()
        placed[..., 1] += heights[:, None]
        for index in range(len(frames)):
            draw_mesh(wide, placed[index], [quads], [colours[index]])
        draw_near(near, points[worst], quads, colours[worst], centre - reach, centre + reach)
        margin = 0.02 * diagonal
        hide_axes(wide, placed[..., :2].min(axis=(0, 1)) - margin, placed[..., :2].max(axis=(0, 1)) + margin)
        wide.set_title(name, fontsize=11)
    for index, frame in enumerate(frames):
        middle = float(np.median(simulated[index, :, 1])) + heights[index]
        left = float(simulated[..., 0].min())
        overview[0].text(left, middle, f"{sequence.times[frame]:.2f} s", fontsize=8, va="center", ha="right")
    close[0].set_title(f"close up at {sequence.times[frames[worst]]:.2f} s", fontsize=10)
    close[2].set_title("around the worst vertex", fontsize=10)
    bar = canvas.colorbar(heat, cax=canvas.add_axes((0.965, 0.5, 0.007, 0.3)), ticks=(0, 0.5, 1))
    bar.ax.tick_params(labelsize=8)
    overview[2].set_xlabel(f"error over the bound of {TOLERANCE:g} of the diagonal", fontsize=9)


def _stacked(seen: Float64Array) -> Float64Array:
    """How far up to move each frame so that it lies just below the one before: (frames,)."""
    tops, bottoms = seen[..., 1].max(axis=1), seen[..., 1].min(axis=1)
    gap = 0.05 * float(np.ptp(seen[..., 0]))
    extents = tops - bottoms + gap
    return np.asarray(-tops - np.concatenate([[0.0], np.cumsum(extents[:-1])]))


def _draw_rates(demonstration: Demonstration, panel: Any) -> None:
    from matplotlib.ticker import NullLocator

    rates = demonstration.rates
    paper = demonstration.encodings[1]
    panel.loglog([item.bits for item in rates], [item.distortion.e_m for item in rates], "o-", color=DECODED_COLOUR)
    panel.loglog(paper.bits, paper.distortion.e_m, "s", color=SIMULATED_COLOUR)
    write(panel, "profile paper", (paper.bits, paper.distortion.e_m), (8, 0), size=8)
    low, high = panel.get_xlim()
    panel.set_xticks([tick for tick in RATE_TICKS if low <= tick <= high], minor=False)
    panel.xaxis.set_major_formatter("{x:g}")
    panel.xaxis.set_minor_locator(NullLocator())
    panel.set_xlabel("bits per vertex and frame (raw: 96)", fontsize=9)
    panel.set_ylabel("maximum error over the diagonal", fontsize=9)
    panel.grid(alpha=0.3)
    panel.tick_params(labelsize=8)
    panel.set_title("rate and distortion", fontsize=10)


def _draw_sections(demonstration: Demonstration, panel: Any) -> None:
    report = demonstration.encodings[0].report
    sections = sorted(report.sections.items(), key=lambda item: item[1])[-SECTIONS_SHOWN:]
    names = [SECTION_TITLES.get(name, name) for name, _ in sections]
    panel.barh(names, [size / 1000 for _, size in sections], color=DECODED_COLOUR)
    panel.set_xlabel("kB", fontsize=9)
    panel.tick_params(labelsize=8)
    panel.grid(alpha=0.3, axis="x")
    panel.set_title(f"where the {report.file_bytes / 1000:,.0f} kB go", fontsize=10)
