"""`pdecodec stability`: an atlas of where methods lose stability."""

from __future__ import annotations

import time
from pathlib import Path

import click

from pdecodec.cli.console import print_json, progress_bar, say
from pdecodec.cli.options import json_option

CHAPTERS = ("fit", "parametrisation", "alignment", "simulation", "codec")
"""Those of :data:`pdecodec.experiments.stability.report.CHAPTERS`, which a help page should not load."""


@click.command()
@click.option("-o", "--output", required=True, metavar="DIR", help="Folder for the page, its charts and its figures.")
@click.option("--only", type=click.Choice(CHAPTERS), multiple=True, help="Only this chapter; may be given repeatedly.")
@click.option("--quick", is_flag=True, help="Coarser axes and smaller clips: a look in seconds.")
@json_option
def stability(*, output: str, only: tuple[str, ...], quick: bool, as_json: bool) -> None:
    """Show where each method breaks: the fit, the parametrisation, the alignment, the simulation, the codec.

    Every method is run beside its alternatives over the range where it goes from fine to broken. DIR gets one HTML
    page that works offline (index.html), and a PNG and a CSV for each of its charts. Files of an earlier atlas in DIR
    are replaced.
    """
    from pdecodec.experiments.report_files import write_report
    from pdecodec.experiments.stability.report import make_atlas

    started = time.perf_counter()
    directory = Path(output)
    directory.mkdir(parents=True, exist_ok=True)
    with progress_bar() as progress:
        report = make_atlas(only, quick=quick, progress=progress)
        page = write_report(report, directory)[0]
    seconds = time.perf_counter() - started
    if as_json:
        lessons = {exhibit.name: exhibit.lesson for exhibit in report.exhibits}
        print_json({"page": str(page), "seconds": seconds, "exhibits": lessons})
    else:
        for exhibit in report.exhibits:
            click.echo(f"{exhibit.title}\n  {exhibit.lesson}\n")
    say(f"{page}: {len(report.exhibits)} entries, {seconds:.0f} s")
