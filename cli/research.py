"""`pdecodec reproduce` and `pdecodec stability`: the paper's experiment, and where methods become unstable."""

from __future__ import annotations

import time
from pathlib import Path

import click

from pdecodec.cli.console import outputs_written, print_json, print_table, progress_bar, put, say
from pdecodec.cli.options import json_option, page_option

SECTIONS = ("fit", "parametrisation", "alignment", "simulation", "codec")
"""The names of :data:`pdecodec.research.stability.atlas.SECTIONS`, which a help page should not load."""


@click.command()
@page_option
@click.option("--rings", type=int, default=832, show_default=True, metavar="N", help="Points per curve.")
@click.option(
    "--sides", type=int, default=24, show_default=True, metavar="N", help="Number of curves, a multiple of 4."
)
@click.option("--fps", type=float, default=8.0, show_default=True, metavar="F", help="Frames per second.")
@json_option
def reproduce(*, output: str, rings: int, sides: int, fps: float, as_json: bool) -> None:
    """Reproduce section 5 of Fang et al. 2024, and judge its claims.

    The cube-rope is simulated and reconstructed by the paper's method and by B-splines, as printed and with only the
    data that a decoder has. DIR receives one HTML page that works offline (index.html), and each of its charts as PNG
    and CSV. Files of an earlier report in DIR are replaced.
    """
    from pdecodec.report.charts.page import write_report
    from pdecodec.report.charts.vegalite import require_drawing
    from pdecodec.research.reproduction.findings import measure
    from pdecodec.research.reproduction.report import make_report
    from pdecodec.research.reproduction.rope import RopeSettings
    from pdecodec.research.reproduction.verdicts import judge

    require_drawing()
    started = time.perf_counter()
    settings = RopeSettings(rings=rings, sides=sides, fps=fps)
    directory = Path(output)
    directory.mkdir(parents=True, exist_ok=True)
    with progress_bar() as progress:
        findings = measure(settings, progress)
    page = write_report(make_report(findings), directory)[0]
    seconds = time.perf_counter() - started
    verdicts = judge(findings)
    with outputs_written():
        if as_json:
            print_json({"page": str(page), "seconds": seconds, "verdicts": [item._asdict() for item in verdicts]})
        else:
            rows = [(item.claim, item.printed, item.found, item.judgement) for item in verdicts]
            print_table(("claim", "paper", "this run", "verdict"), rows, show_lines=True)
    say(f"{page}: {len(verdicts)} claims judged, {seconds:.0f} s")


@click.command()
@page_option
@click.option("--only", type=click.Choice(SECTIONS), multiple=True, help="Run only this section; may be repeated.")
@click.option("--quick", is_flag=True, help="Use coarser axes and smaller clips: a preview in seconds.")
@json_option
def stability(*, output: str, only: tuple[str, ...], quick: bool, as_json: bool) -> None:
    """Show where each method breaks: the fit, the parametrisation, the alignment, the simulation, the codec.

    Every method is compared with its alternatives over the range from stable to broken. DIR receives one HTML page that
    works offline (index.html), and each of its charts as PNG and CSV. Files of an earlier atlas in DIR are replaced.
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
    with outputs_written():
        if as_json:
            lessons = {figure.name: figure.lesson for figure in report.figures}
            print_json({"page": str(page), "seconds": seconds, "figures": lessons})
        else:
            for figure in report.figures:
                put(f"{figure.title}\n  {figure.lesson}\n")
    say(f"{page}: {len(report.figures)} entries, {seconds:.0f} s")
