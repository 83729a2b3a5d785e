"""Measuring a whole clip: profiles one after the other alone, peers beside each other, what is known from before kept.

Profiles use every core themselves and are timed alone. Peers use one core each; so many run at a time as the plan says,
in processes of their own.
"""

from __future__ import annotations

import multiprocessing
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass, replace

from pdecodec.errors import InputError
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.report.kept import KeptCells, cell_key, clip_digest, codec_version
from pdecodec.experiments.report.measurement import WARM_UP_FRAMES, measure_peer, measure_profile, warm_up
from pdecodec.peers.peer import Peer
from pdecodec.selection import FrameSelection
from pdecodec.sequence import ArraySequence, Progress
from pdecodec.settings import EncodeSettings, Profile

TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)
"""From what is seen in the background to what an archive wants: two a decade."""

PROFILES: tuple[Profile, ...] = ("auto", "segments", "paper")

JOBS = 2
"""Peers measured at a time."""


@dataclass(frozen=True, kw_only=True)
class ReportPlan:
    """What is measured.

    Attributes
    ----------
    tolerances : tuple of float
        From coarse to fine.
    profiles : tuple of str
    peers : tuple of Peer
        Those that can run here.
    effort : int
        Of profile "auto".
    jobs : int
        Peers measured at a time.
    """

    tolerances: tuple[float, ...] = TOLERANCES
    profiles: tuple[Profile, ...] = PROFILES
    peers: tuple[Peer, ...] = ()
    effort: int = EncodeSettings().effort
    jobs: int = JOBS

    @property
    def cells(self) -> int:
        """How many cells a clip has."""
        return (len(self.profiles) + len(self.peers)) * len(self.tolerances)


def measure_clip(
    clip: str, sequence: ArraySequence, plan: ReportPlan, kept: KeptCells, *, progress: Progress | None = None
) -> list[Cell]:
    """Every cell of a clip, in the order of the plan: profiles and then peers, each from coarse to fine.

    Parameters
    ----------
    clip : str
        Name for tables.
    sequence : ArraySequence
    plan : ReportPlan
    kept : KeptCells
        Cells that it has are not measured again; new ones are added as soon as they are there.
    progress : callable, optional

    Raises
    ------
    InputError
        If a process that measures peers ended, as happens where memory runs out.
    """
    digest = clip_digest(sequence)
    found: dict[tuple[str, float], Cell] = {}

    def take(version: str, cell: Cell) -> None:
        kept.keep(cell_key(digest, version, cell.tolerance), cell)
        tell(cell)

    def tell(cell: Cell) -> None:
        found[cell.coder, cell.tolerance] = cell
        if progress is not None:
            progress(len(found), plan.cells, f"{clip}: {cell.coder}")

    for profile in plan.profiles:
        version = f"{codec_version()} {profile} {plan.effort}"
        missing = _missing(kept, digest, version, clip, plan.tolerances, tell)
        if missing:
            warm_up(sequence, profile=profile, tolerances=missing, effort=plan.effort)
        for tolerance in missing:
            cell = measure_profile(clip, sequence, profile=profile, tolerance=tolerance, effort=plan.effort)
            take(version, cell)
    constant_size = found[plan.profiles[0], plan.tolerances[0]].constant_size
    tasks = {}
    for peer in plan.peers:
        missing = _missing(kept, digest, peer.version(), clip, plan.tolerances, tell)
        if missing:
            tasks[peer] = missing
    for peer, cells in _measure_peers(clip, sequence, tasks, jobs=plan.jobs):
        for cell in cells:
            take(peer.version(), cell)
    coders = [*plan.profiles, *(peer.name for peer in plan.peers)]
    every = [found[coder, tolerance] for coder in coders for tolerance in plan.tolerances]
    return [cell if cell.kind == "profile" else replace(cell, constant_size=constant_size) for cell in every]


def _missing(
    kept: KeptCells,
    digest: str,
    version: str,
    clip: str,
    tolerances: Sequence[float],
    tell: Callable[[Cell], None],
) -> list[float]:
    """Tolerances without a kept cell; cells that are there are told of."""
    missing = []
    for tolerance in tolerances:
        cell = kept.find(cell_key(digest, version, tolerance), clip)
        if cell is None:
            missing.append(tolerance)
        else:
            tell(cell)
    return missing


def _measure_peers(
    clip: str, sequence: ArraySequence, tasks: Mapping[Peer, list[float]], *, jobs: int
) -> Iterator[tuple[Peer, list[Cell]]]:
    """Peers with their cells, each as soon as it is done."""
    if jobs == 1 or len(tasks) < 2:
        for peer, tolerances in tasks.items():
            yield peer, _peer_cells(clip, sequence, peer, tolerances)
        return
    # Started anew, not forked: numba's threads do not survive a fork.
    pool = ProcessPoolExecutor(jobs, mp_context=multiprocessing.get_context("spawn"))
    try:
        running = {pool.submit(_peer_cells, clip, sequence, peer, missing): peer for peer, missing in tasks.items()}
        for future in as_completed(running):
            yield running[future], future.result()
    except BrokenProcessPool as error:
        raise InputError(
            f"{clip}: a process that measured other methods ended, as happens where memory runs out; "
            "what was measured is kept: run it again with --jobs 1, or with --no-peers"
        ) from error
    finally:
        pool.shutdown(cancel_futures=True)


def _peer_cells(clip: str, sequence: ArraySequence, peer: Peer, tolerances: Sequence[float]) -> list[Cell]:
    start = FrameSelection(sequence, range(min(WARM_UP_FRAMES, sequence.frame_count))).to_array()
    for _ in measure_peer(clip, start, peer, tolerances[:1]):
        pass
    return list(measure_peer(clip, sequence, peer, tolerances))
