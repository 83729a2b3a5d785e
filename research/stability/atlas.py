"""Put the stability atlas together; this is the command `pdecodec stability`."""

from __future__ import annotations

from collections.abc import Callable, Sequence

from pdecodec.errors import SettingsError
from pdecodec.mesh.sequence import Progress
from pdecodec.report.charts.figure import Report, Section
from pdecodec.report.charts.vegalite import require_drawing
from pdecodec.research.stability.alignment import alignment_section
from pdecodec.research.stability.codec import codec_section
from pdecodec.research.stability.fit_data import extrapolation_figure, few_figure, gap_figure, noise_figure
from pdecodec.research.stability.fit_rates import condition_figure, error_figure, map_figure
from pdecodec.research.stability.parametrisation import parametrisation_section
from pdecodec.research.stability.simulation import simulation_section


def fit_section(*, quick: bool) -> Section:
    """Return every chart on the fit; `quick` takes coarser axes."""
    return Section(
        "The fit",
        "Eq. 25 fits 32 functions by normal equations. The test motion is a bending wave over a drift, at 104 points "
        "and 11 frames of which every second is a keyframe; alpha and r are over t and u in [0, 1].",
        (
            condition_figure(25 if quick else 97),
            error_figure(17 if quick else 73, 104),
            map_figure(7 if quick else 21, 52 if quick else 104),
            noise_figure(16),
            few_figure(104),
            gap_figure(17 if quick else 65),
            extrapolation_figure(21 if quick else 81),
        ),
    )


SECTIONS: dict[str, Callable[..., Section]] = {
    "fit": fit_section,
    "parametrisation": parametrisation_section,
    "alignment": alignment_section,
    "simulation": simulation_section,
    "codec": codec_section,
}
"""Sections by name, in the order of the page."""


def make_atlas(names: Sequence[str] = (), *, quick: bool = False, progress: Progress | None = None) -> Report:
    """Measure the named sections (all by default) and put them together; `quick` takes coarser axes, for a
    preview.

    Raises
    ------
    SettingsError
        If there is no such section.
    MissingExtraError
        If charts cannot be drawn here.
    """
    unknown = [name for name in names if name not in SECTIONS]
    if unknown:
        raise SettingsError(
            f"there is no section {unknown[0]!r}; choose from {', '.join(SECTIONS)}", code="unknown-name"
        )
    require_drawing()
    chosen = [name for name in SECTIONS if name in names] if names else list(SECTIONS)
    sections = []
    for index, name in enumerate(chosen):
        if progress is not None:
            progress(index, len(chosen), name)
        sections.append(SECTIONS[name](quick=quick))
    return Report(
        title="Where methods lose stability",
        summary=(
            "Every method next to its alternatives, over the range where it goes from fine to broken. The side on "
            "which it fails is shaded. Under each chart: what pdecodec does about it."
        ),
        sections=tuple(sections),
        settings={"sections": list(chosen), "coarse axes": quick},
    )
