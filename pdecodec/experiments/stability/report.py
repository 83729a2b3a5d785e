"""The atlas: what `pdecodec stability` writes."""

from __future__ import annotations

from collections.abc import Sequence

from pdecodec.errors import SettingsError
from pdecodec.experiments.exhibit import Report
from pdecodec.experiments.stability.alignment_chapter import alignment_chapter
from pdecodec.experiments.stability.codec_chapter import codec_chapter
from pdecodec.experiments.stability.fit_chapter import fit_chapter
from pdecodec.experiments.stability.parametrisation_chapter import parametrisation_chapter
from pdecodec.experiments.stability.simulation_chapter import simulation_chapter
from pdecodec.sequence import Progress

CHAPTERS = {
    "fit": fit_chapter,
    "parametrisation": parametrisation_chapter,
    "alignment": alignment_chapter,
    "simulation": simulation_chapter,
    "codec": codec_chapter,
}
"""By name, in the order of the page."""


def make_atlas(names: Sequence[str] = (), *, quick: bool = False, progress: Progress | None = None) -> Report:
    """Measure chapters and put them together.

    Parameters
    ----------
    names : sequence of str
        Of :data:`CHAPTERS`; all of them where there is none.
    quick : bool
        Coarser axes: for a look, and for tests.
    progress : callable, optional

    Raises
    ------
    SettingsError
        If there is no such chapter.
    """
    unknown = [name for name in names if name not in CHAPTERS]
    if unknown:
        raise SettingsError(f"there is no chapter {unknown[0]!r}; choose from {', '.join(CHAPTERS)}")
    chosen = [name for name in CHAPTERS if name in names] if names else list(CHAPTERS)
    chapters = []
    for index, name in enumerate(chosen):
        if progress is not None:
            progress(index, len(chosen), name)
        chapters.append(CHAPTERS[name](quick=quick))
    return Report(
        title="Where methods lose stability",
        summary=(
            "Every method beside its alternatives, over the range where it goes from fine to broken. The side on "
            "which it fails is shaded. Under each chart: what pdecodec does about it."
        ),
        chapters=tuple(chapters),
        settings={"chapters": list(chosen), "coarse axes": quick},
    )
