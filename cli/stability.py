"""`pdecodec stability`: an atlas of where methods lose stability."""

from __future__ import annotations

import time
from pathlib import Path

import click

from pdecodec.cli.console import print_json, progress_bar, put, say
from pdecodec.cli.options import json_option, page_option

SECTIONS = ("fit", "parametrisation", "alignment", "simulation", "codec")
"""Those of :data:`pdecodec.research.stability.atlas.SECTIONS`, which a help page should not load."""


@click.command()
@page_option
@click.option("--only", type=click.Choice(SECTIONS), multiple=True, help="Only this section; may be given repeatedly.")
@click.option("--quick", is_flag=True, help="Coarser axes and smaller clips: a look in seconds.")
@json_option
def stability(*, output: str, only: tuple[str, ...], quick: bool, as_json: bool) -> None:
    """Show where each method breaks: the fit, the parametrisation, the alignment, the simulation, the codec.

    Every method is run beside its alternatives over the range where it goes from fine to broken. DIR gets one HTML
    page that works offline (index.html), and a PNG and a CSV for each of its charts. Files of an earlier atlas in DIR
    are replaced.
    """
    from pdecodec.report.charts.page import write_report
    from pdecodec.report.charts.vegalite import require_package

    require_package("mpmath", what="exact fits need", extra="research")
    from pdecodec.research.stability.atlas import make_atlas

    started = time.perf_counter()
    directory = Path(output)
    directory.mkdir(parents=True, exist_ok=True)
    with progress_bar() as progress:
        report = make_atlas(only, quick=quick, progress=progress)
        page = write_report(report, directory)[0]
    seconds = time.perf_counter() - started
    if as_json:
        lessons = {figure.name: figure.lesson for figure in report.figures}
        print_json({"page": str(page), "seconds": seconds, "figures": lessons})
    else:
        for figure in report.figures:
            put(f"{figure.title}\n  {figure.lesson}\n")
    say(f"{page}: {len(report.figures)} entries, {seconds:.0f} s")
