"""The chapter on the codec: every profile on clips that are hard for a reason."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.experiments.charts import BLUE, FAILING, GREY, ORANGE, label_ends, mark_failing_above, mark_failing_right
from pdecodec.experiments.exhibit import Cell, Chapter, Exhibit, Table
from pdecodec.experiments.stability.nasty_clips import FPS, NASTY, far_away, impact, teleport
from pdecodec.metrics import bits_per_vertex_frame, frame_scale, measure_distortion
from pdecodec.sequence import ArraySequence
from pdecodec.settings import Alignment, EncodeSettings

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Float64Array = NDArray[np.float64]

TOLERANCE = 1e-3

PROFILES: dict[str, tuple[EncodeSettings, str]] = {
    "auto": (EncodeSettings(tolerance=TOLERANCE), BLUE),
    "segments": (EncodeSettings(tolerance=TOLERANCE, profile="segments"), GREY),
    "paper": (EncodeSettings(profile="paper"), ORANGE),
}
"""Settings and colour. Profile paper has no bound of its own: 32 functions a curve, and whatever error that leaves."""

RAW_BITS = 96.0
"""Of float32 positions, a vertex and frame: above, a file is larger than its input."""

UNCOUNTED = ("CONN", "ORDR", "ATTR")
"""Sections of connectivity and attributes, which are left out of rates."""


def coded(clip: ArraySequence, settings: EncodeSettings) -> tuple[float, float]:
    """Rate in bits a vertex and frame, and largest error over the tolerance, of the decoded bytes."""
    report = encode(clip, settings=settings)
    assert report.data is not None  # no path was given
    with open_animation(report.data) as animation:
        found = measure_distortion(clip, animation.to_array())
    counted = report.file_bytes - sum(report.sections.get(name, 0) for name in UNCOUNTED)
    bits = bits_per_vertex_frame(counted, vertices=clip.vertex_count, frames=clip.frame_count)
    bound = TOLERANCE * frame_scale(clip.points[0])
    return bits, found.max_error / bound


def stress(side: int, frames: int) -> Exhibit:
    """Every nasty clip with every profile.

    Parameters
    ----------
    side : int
        Vertices along a side of the sheet.
    frames : int
    """
    found = {
        name: {profile: coded(make(side, frames), settings) for profile, (settings, _) in PROFILES.items()}
        for name, make in NASTY.items()
    }
    rows = tuple((name, profile, *values) for name, item in found.items() for profile, values in item.items())

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2, sharey=True)
        heights = np.arange(len(found))[::-1]
        for panel, index in ((left, 0), (right, 1)):
            panel.set(xscale="log", ylim=(-0.6, len(found) - 0.1))
            panel.set_xlim(*((0.02, 600) if index == 0 else (3e-4, 1e9)))
            for profile, (_, colour) in PROFILES.items():
                values = np.maximum([item[profile][index] for item in found.values()], 4e-4)
                marker = {"auto": "o", "segments": "s", "paper": "D"}[profile]
                panel.plot(values, heights, marker, color=colour, markersize=6.5)
            panel.grid(axis="y", alpha=0.4)
        # Named where the three are apart.
        row, apart = len(found) - 1 - list(found).index("topology soup"), found["topology soup"]
        beside = {"auto": ((0, 10), "center"), "segments": ((8, 0), "left"), "paper": ((-8, 0), "right")}
        for profile, (_, colour) in PROFILES.items():
            left.annotate(
                profile,
                (apart[profile][0], row),
                xytext=beside[profile][0],
                textcoords="offset points",
                ha=beside[profile][1],
                va="center",
                color=colour,
                fontsize=8.5,
            )
        left.set_yticks(heights, list(found))
        left.set_xlabel("bits a vertex and frame")
        right.set_xlabel("largest error over the tolerance of 1e-3")
        mark_failing_right(left, RAW_BITS, "larger\nthan raw", height=0.12)
        mark_failing_right(right, 1.0 + 1e-9, "fails: beyond the bound", height=0.05)

    worst = {
        profile: max(((item[profile][1], name) for name, item in found.items()), key=lambda pair: pair[0])
        for profile in PROFILES
    }
    dearest = max(((item["auto"][0], name) for name, item in found.items()), key=lambda pair: pair[0])
    return Exhibit(
        name="codec-stress",
        title="Clips that are hard for a reason",
        lesson=(
            f"Profiles auto and segments hold their bound on every clip (largest error {worst['auto'][0]:.5f} and "
            f"{worst['segments'][0]:.5f} of it); what is hard costs bits, up to {dearest[0]:.3g} a vertex and frame "
            f"for auto ({dearest[1]}), where raw float32 takes 96. Profile paper, the model alone, has no bound and "
            f"leaves up to {worst['paper'][0]:.2g} times the tolerance ({worst['paper'][1]})."
        ),
        table=Table(("clip", "profile", "bits a vertex and frame", "largest error over the tolerance"), rows),
        draw=draw,
        size=(10.5, 4.4),
        consequence=(
            "auto takes whatever is cheapest at the bound, and corrects single vertices where no model holds; profile "
            "paper is for comparison and says in its report what error it leaves."
        ),
    )  # fmt: skip


def alignments(side: int, frames: int) -> Exhibit:
    """Profile paper with and without the rotation of Eqs. 19 to 23, and as it chooses."""
    choices: dict[str, tuple[Alignment, str]] = {
        "a rotation removed": ("rotation", ORANGE),
        "nothing removed": ("none", GREY),
        "chosen by error": ("auto", BLUE),
    }
    clips = {name: make(side, frames) for name, make in NASTY.items() if name != "jitter of one bit"}
    found = {
        name: {
            label: coded(clip, EncodeSettings(profile="paper", alignment=alignment))
            for label, (alignment, _) in choices.items()
        }
        for name, clip in clips.items()
    }
    rows = tuple((name, label, *values) for name, item in found.items() for label, values in item.items())

    def draw(figure: Figure) -> None:
        panel = figure.subplots()
        heights = np.arange(len(found))[::-1]
        panel.set(xscale="log", ylim=(-0.6, len(found) - 0.1))
        for (label, (_, colour)), shift in zip(choices.items(), (0.16, 0.0, -0.16), strict=True):
            values = [item[label][1] for item in found.values()]
            panel.plot(values, heights + shift, "o", color=colour, markersize=6.5)
            panel.annotate(
                label,
                (values[0], heights[0] + shift),
                xytext=(8, 25 * shift),
                textcoords="offset points",
                va="center",
                color=colour,
                fontsize=8.5,
            )
        panel.set_yticks(heights, list(found))
        panel.set_xlabel("largest error of profile paper over 1e-3 of the diagonal")

    gains = {name: item["a rotation removed"][1] / item["chosen by error"][1] for name, item in found.items()}
    best = max(gains, key=lambda name: gains[name])
    return Exhibit(
        name="codec-alignment",
        title="Transformation elimination that makes it worse",
        lesson=(
            "A curve that is nearly straight at some frames turns about itself by chance there, and four functions of "
            f'time cannot follow: removing a rotation as in Eqs. 19 to 23 makes the error of clip "{best}" '
            f"{gains[best]:.0f} times as large as leaving it in."
        ),
        table=Table(("clip", "alignment", "bits a vertex and frame", "largest error over 1e-3"), rows),
        draw=draw,
        size=(9.5, 3.6),
        consequence=(
            "under profile paper, alignment auto measures both and takes the one that leaves less; profile segments "
            "also tries the affine functions."
        ),
    )


def between(side: int, samples: int) -> Exhibit:
    """One vertex over time through an impact and through a jump.

    Parameters
    ----------
    side : int
    samples : int
        Times looked at.
    """
    frames = 24
    clips = {"fast impact": (impact(side, frames), 1), "teleporting": (teleport(side, frames), 0)}
    vertex = side * side // 2
    found: dict[str, dict[str, Float64Array]] = {}
    windows: dict[str, Float64Array] = {}
    overshoot: dict[str, dict[str, float]] = {}
    for name, (clip, axis) in clips.items():
        path = clip.points[:, vertex, axis].astype(np.float64)
        jump = int(np.abs(np.diff(np.diff(path))).argmax()) + 1
        times = np.linspace(max(0, jump - 5) / FPS, min(frames - 1, jump + 5) / FPS, samples)
        windows[name] = times
        found[name], overshoot[name] = {}, {}
        size = float(np.ptp(path))
        for profile, (settings, _) in PROFILES.items():
            report = encode(clip, settings=settings)
            assert report.data is not None  # no path was given
            with open_animation(report.data) as animation:
                values = animation.sample(times)[:, vertex, axis].astype(np.float64)
            found[name][profile] = values
            left = np.minimum(np.floor(times * FPS + 1e-9).astype(int), frames - 2)
            low, high = np.minimum(path[left], path[left + 1]), np.maximum(path[left], path[left + 1])
            overshoot[name][profile] = float(np.maximum(values - high, low - values).max()) / size
    rows: tuple[tuple[Cell, ...], ...] = tuple(
        (name, float(t), *(float(found[name][profile][i]) for profile in PROFILES))
        for name in found
        for i, t in enumerate(windows[name])
    )

    def draw(figure: Figure) -> None:
        panels = figure.subplots(1, 2)
        for panel, (name, (clip, axis)) in zip(panels, clips.items(), strict=True):
            times = windows[name] * FPS
            for profile, (_, colour) in PROFILES.items():
                panel.plot(times, found[name][profile], color=colour)
            inside = np.arange(np.ceil(times[0]), np.floor(times[-1]) + 1).astype(int)
            panel.plot(inside, clip.points[inside, vertex, axis], "ko", markersize=4)
            panel.set(title=name, xlabel="frame", ylabel=f"{'xyz'[axis]} of one vertex, sheet of side 1")
            panel.set_xlim(times[0], times[-1] + 0.32 * (times[-1] - times[0]))
            label_ends(
                panel,
                [(times[-1], float(found[name][p][-1]), p, colour) for p, (_, colour) in PROFILES.items()]
                + [(times[-1], float(clip.points[inside[-1], vertex, axis]), "frames (dots)", "black")],
            )

    jumpy = overshoot["teleporting"]
    return Exhibit(
        name="codec-between",
        title="Between frames, where the motion has a corner",
        lesson=(
            "No smooth motion turns a corner: between the frames around an impact the decoded motion leaves the span "
            f"of its two frames by up to {overshoot['fast impact']['auto']:.1%} (auto) and "
            f"{overshoot['fast impact']['segments']:.1%} (segments) of the fall; around a jump by {jumpy['auto']:.1%} "
            f"and {jumpy['segments']:.1%} of the jump. At the frames themselves the bound holds; profile paper misses "
            f"the frames too, by up to {jumpy['paper']:.0%} of the jump."
        ),
        table=Table(("clip", "time [s]", *PROFILES), rows),
        draw=draw,
        size=(10.5, 4.2),
        consequence=(
            "the bound is promised at the input's frames and nowhere else; encode at a higher frame rate where "
            "impacts matter."
        ),
    )


def distance(side: int, frames: int, count: int) -> Exhibit:
    """The same clip farther and farther from the origin."""
    offsets = np.geomspace(1.0, 1e7, count)
    found = [coded(far_away(side, frames, float(offset)), PROFILES["auto"][0]) for offset in offsets]
    spacing = [float(np.spacing(np.float32(offset))) / (TOLERANCE * np.sqrt(2.0)) for offset in offsets]
    rows = tuple((float(o), *pair, s) for o, pair, s in zip(offsets, found, spacing, strict=True))

    def draw(figure: Figure) -> None:
        left, right = figure.subplots(1, 2)
        for panel in (left, right):
            panel.set(xscale="log", xlabel="distance from the origin, over the clip's size", xlim=(1, 1e7))
        left.plot(offsets, [pair[1] for pair in found], "o-", color=BLUE)
        left.set(ylabel="largest error over the bound", ylim=(0, 1.25), title="the bound")
        mark_failing_above(left, 1.0, "fails")
        right.plot(offsets, [pair[0] for pair in found], "o-", color=BLUE)
        right.set(ylabel="bits a vertex and frame", title="what it costs")
        right.set_ylim(0, 1.35 * max(pair[0] for pair in found))
        beyond = next((o for o, s in zip(offsets, spacing, strict=True) if s > 1), offsets[-1])
        for panel in (left, right):
            panel.axvspan(beyond, 1e7, color=FAILING, zorder=0, linewidth=0)
        right.annotate(
            "float32 coarser\nthan the bound",
            (beyond, right.get_ylim()[1]),
            xytext=(4, -4),
            textcoords="offset points",
            va="top",
            fontsize=8.5,
            color="#8A3300",
        )

    return Exhibit(
        name="codec-distance",
        title="Far from the origin",
        lesson=(
            f"The bound holds at every distance (largest error {max(pair[1] for pair in found):.5f} of it). It costs "
            f"{found[0][0]:.2g} bits a vertex and frame near the origin and up to {max(pair[0] for pair in found):.2g} "
            "where the spacing of float32 comes near the bound: the input itself is a staircase there, and its steps "
            "are what is encoded. Farther out few steps are left to encode."
        ),
        table=Table(
            (
                "distance over size",
                "bits a vertex and frame",
                "largest error over the bound",
                "float32 spacing over the bound",
            ),
            rows,
        ),
        draw=draw,
        size=(10.0, 4.0),
        consequence=(
            "the last bits of float32 are budgeted in the bound; move a clip to the origin before encoding where you "
            "can."
        ),
    )


def codec_chapter(*, quick: bool) -> Chapter:
    """Every exhibit of the codec.

    Parameters
    ----------
    quick : bool
        Smaller clips, and fewer of them.
    """
    side, frames = (8, 16) if quick else (28, 36)
    return Chapter(
        "The codec",
        f"Clips of {side * side} vertices and {frames} frames, at a tolerance of 1e-3 of frame 0's diagonal. Rates "
        "leave connectivity out.",
        (
            stress(side, frames),
            alignments(side, frames),
            between(side, 101 if quick else 601),
            distance(side, frames, 3 if quick else 8),
        ),
    )
