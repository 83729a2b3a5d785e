"""The last chapter of every report: on what, and how, it was measured."""

from __future__ import annotations

import os
from collections.abc import Sequence

from pdecodec.experiments.exhibit import Chapter, Exhibit, Table
from pdecodec.experiments.report.between import BETWEEN_TOLERANCE
from pdecodec.experiments.report.measuring import ReportPlan

METHOD = f"""
Every figure is of positions that were decoded again from bytes, ours and the other methods' alike. A tolerance is the
largest Euclidean distance of any vertex in any frame from where it belongs, over the diagonal of frame 0's bounding
box. Profiles are told the tolerance; each other method is given the coarsest setting found by search with which it
keeps it, so that all are compared at equal maximum error.

Bits per vertex and frame leave connectivity and attributes out, for all alike; ratios count everything: those of the
other methods have pdecodec's own bytes of connectivity added. rms: root of the mean square distance. p99: what 99 % of
all distances do not exceed. KG: Karni and Gotsman 2004.

Encoding is timed once, after a few frames of the clip were encoded so that compiling does not count; the search of the
other methods does not count, either. Decoding is the median of five runs for profiles, opening included, and one run
for the others. A decode multiple is that time over the time of a plain copy (np.copyto) of the positions. Profiles were
timed alone, on all cores; the other methods, which use one core each, {{jobs}}.

Between frames, the clip is encoded at {BETWEEN_TOLERANCE:g} without the frames that are asked for then.
"""


def method_chapter(plan: ReportPlan, skipped: Sequence[str]) -> Chapter:
    """How it was measured, and the methods with their sources."""
    jobs = "one at a time" if plan.jobs == 1 else f"up to {plan.jobs} at a time, on {os.cpu_count()} cores"
    absent = "".join(f"\n\nNot measured: {reason}." for reason in skipped)
    exhibit = Exhibit(
        name="methods",
        title="The other methods",
        lesson="Written after their sources, without the tuning of a product; some call the package that a pipeline "
        "would use.",
        table=Table(("method", "source", "as published"), tuple((p.name, p.source, p.published) for p in plan.peers)),
        shows_table=True,
    )
    return Chapter("Data and method", METHOD.strip().format(jobs=jobs) + absent, (exhibit,) if plan.peers else ())
