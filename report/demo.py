"""The demonstration: simulate the cube-rope, encode it, decode it at its frames and between them, measure, draw.

The rope is that of Fang et al. 2024, section 5: 24 curves of 832 points, simulated with XPBD.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from pdecodec.codec.encode.report import SECTION_TITLES, EncodeReport
from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.codec.resampling import LinearInterpolation, SampledAnimation
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.arrays import Float32Array, Float64Array
from pdecodec.mesh.metrics import Distortion, bits_per_vertex_frame, frame_scale, measure_distortion
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence, Progress
from pdecodec.mesh.surface_metrics import SurfaceDistortion, measure_surfaces
from pdecodec.report.charts.pictures import Picture, as_seen, extent, heat_colours, polygons_of
from pdecodec.report.charts.plots import BLUE, ORANGE, Axis, Panel, side_by_side
from pdecodec.report.charts.vegalite import Chart, as_png, require_drawing
from pdecodec.simulate import build

FRAMES = 61
"""Number of frames; odd, so that every frame that is left out lies between two kept frames."""

FPS = 24.0

TOLERANCE = 1e-3

RATE_TOLERANCES = (1e-2, 3e-3, TOLERANCE, 3e-4)
"""Tolerances of the picture's rate chart."""

PICTURE_FRAMES = 4
"""Frames shown in the picture, spread over the clip."""


WIDTH, HEIGHT = 1230, 690
"""Size of the picture [pixels]."""

CLOSE_UP = 0.14
"""Width of the close-up around the worst vertex, over the diagonal."""

SECTIONS_SHOWN = 5
"""Largest sections shown in the bar chart; the others take a few hundred bytes together."""

SIMULATED_COLOUR = (0.36, 0.52, 0.72)
DECODED_COLOUR = (0.86, 0.52, 0.26)


@dataclass(frozen=True)
class Encoding:
    """One `.pdeanim` of the demonstration, and the errors of its frames."""

    name: str
    report: EncodeReport
    decode_seconds: float
    distortion: Distortion
    surface: SurfaceDistortion

    @property
    def bits(self) -> float:
        """Bits per vertex and frame of the whole file."""
        return bits_per_vertex_frame(self.report.file_bytes, vertices=self.report.vertices, frames=self.report.frames)


@dataclass(frozen=True)
class Between:
    """Errors at the frames left out: of the codec, and of linear interpolation between the kept frames."""

    decoded: Distortion
    linear: Distortion
    decoded_surface: SurfaceDistortion
    linear_surface: SurfaceDistortion


@dataclass(frozen=True)
class Demonstration:
    """Results of the demonstration.

    The simulated clip; profile auto at :data:`TOLERANCE` and profile paper; profile auto at each of
    :data:`RATE_TOLERANCES`; errors between frames; and the first encoding decoded at some frames, (picture frames,
    vertices, 3) float32 [scene units].
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

    `scene_options` are those of the cube-rope; they default to the paper's size.
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
    """Encode every second frame, and compare the other frames with positions decoded at their times."""
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
    """Write the picture as PNG, replacing an existing one; raise MissingExtraError if it cannot be drawn."""
    require_drawing()
    picture = Picture(WIDTH, HEIGHT)
    first = demonstration.encodings[0]
    picture.text(
        WIDTH / 2,
        22,
        f"{first.report.raw_bytes / 1e6:.1f} MB of motion in {first.report.file_bytes / 1e3:,.0f} kB "
        f"({first.report.raw_bytes / first.report.file_bytes:.0f}:1), "
        f"maximum error {first.distortion.e_m:.2g} of the diagonal",
        size=16,
        anchor="middle",
    )
    _draw_meshes(demonstration, picture)
    picture.chart(_rates_chart(demonstration), 690, 420)
    picture.chart(_sections_chart(demonstration), 960, 420)
    path.write_bytes(as_png(picture.svg()))


def _draw_meshes(demonstration: Demonstration, picture: Picture) -> None:
    """Draw three views of the clip: the chosen frames, one below the other, and a close-up of the worst of them."""
    sequence = demonstration.sequence
    frames = demonstration.picture_frames
    quads = polygons_of(sequence.connectivity)[0]
    diagonal = frame_scale(sequence.points[0])
    simulated = as_seen(sequence.points[list(frames)])
    decoded = as_seen(demonstration.picture_points)
    errors = np.linalg.norm(sequence.points[list(frames)] - demonstration.picture_points.astype(np.float64), axis=2)
    errors /= diagonal
    worst, vertex = np.unravel_index(int(errors.argmax()), errors.shape)
    centre = decoded[worst, vertex, :2]
    reach = 0.5 * CLOSE_UP * diagonal
    moved = np.stack([0 * (heights := _stacked(simulated)), heights, 0 * heights], axis=-1)[:, None]
    solid = [np.broadcast_to(colour, (len(quads), 3)) for colour in (SIMULATED_COLOUR, DECODED_COLOUR)]
    columns = (
        ("simulated", f"close up at {sequence.times[frames[worst]]:.2f} s", simulated, [solid[0]] * len(frames)),
        ("decoded", "", decoded, [solid[1]] * len(frames)),
        ("error", "around the worst vertex", decoded, [heat_colours(e[quads].max(axis=1) / TOLERANCE) for e in errors]),
    )
    for column, (name, remark, points, colours) in enumerate(columns):
        placed = points + moved
        wide = picture.view((10 + 385 * column, 60, 375, 320), extent(placed, margin=0.02 * diagonal), name)
        for index in range(len(frames)):
            wide.mesh(placed[index], [quads], [colours[index]])
        low, high = centre - reach, centre + reach
        near = picture.view((10 + 215 * column, 430, 205, 250), (low, high), remark)
        is_near = np.all((points[worst][:, :2] > low) & (points[worst][:, :2] < high), axis=1)[quads].any(axis=1)
        near.mesh(points[worst], [quads[is_near]], [colours[worst][is_near]], lines=True)
        if column == 0:
            for index, frame in enumerate(frames):
                middle = np.array([placed[..., 0].min(), float(np.median(placed[index, :, 1]))])
                wide.text(middle, f"{sequence.times[frame]:.2f} s", anchor="end")
    picture.colour_bar(f"error over\n{TOLERANCE:g} of the\ndiagonal", ("0", "0.5", "1"), x=1150, y=130, height=180)


def _stacked(seen: Float64Array) -> Float64Array:
    """Return how far to move each frame up so that it lies just below the one before: (frames,)."""
    tops, bottoms = seen[..., 1].max(axis=1), seen[..., 1].min(axis=1)
    gap = 0.05 * float(np.ptp(seen[..., 0]))
    extents = tops - bottoms + gap
    return np.asarray(-tops - np.concatenate([[0.0], np.cumsum(extents[:-1])]))


def _rates_chart(demonstration: Demonstration) -> Chart:
    rates, paper = demonstration.rates, demonstration.encodings[1]
    bits, errors = [item.bits for item in rates], [item.distortion.e_m for item in rates]
    x = Axis.around("bits per vertex and frame (raw: 96)", [*bits, paper.bits], log=True)
    y = Axis.around("maximum error over the diagonal", [*errors, paper.distortion.e_m], log=True)
    panel = Panel(x, y, title="rate and distortion", width=190, height=190)
    panel.line(bits, errors, ORANGE, dots=40)
    panel.dots([paper.bits], [paper.distortion.e_m], BLUE, shape="square")
    panel.text(paper.bits, paper.distortion.e_m, "profile paper", BLUE, dx=8)
    return side_by_side(panel)


def _sections_chart(demonstration: Demonstration) -> Chart:
    report = demonstration.encodings[0].report
    sections = sorted(report.sections.items(), key=lambda item: -item[1])[:SECTIONS_SHOWN]
    x = Axis("kB", 0, 1.05 * sections[0][1] / 1000)
    y = Axis.of_rows([SECTION_TITLES.get(name, name) for name, _ in sections])
    panel = Panel(x, y, title=f"where the {report.file_bytes / 1000:,.0f} kB go", width=130, height=190)
    panel.boxes((0, size / 1000, row - 0.35, row + 0.35, ORANGE) for row, (_, size) in enumerate(sections))
    return side_by_side(panel)
