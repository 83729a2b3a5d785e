"""Measuring coders: encode, decode the bytes again, compare; nothing is believed that did not come back from bytes."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.encodereport import CONSTANT_SECTIONS
from pdecodec.experiments.report.cell import Cell
from pdecodec.experiments.timing import copy_seconds, median_seconds, random_frame_seconds
from pdecodec.metrics import Distortion, frame_scale, measure_distortion
from pdecodec.peers.peer import Peer, UnreachableError
from pdecodec.peers.search import PeerCurve
from pdecodec.selection import FrameSelection
from pdecodec.sequence import ArraySequence
from pdecodec.settings import EncodeSettings, Profile

WARM_UP_FRAMES = 8
"""Encoded and decoded once before anything is timed, so that compiling is not."""


def measure_profile(
    clip: str, sequence: ArraySequence, *, profile: Profile, tolerance: float, effort: int = EncodeSettings().effort
) -> Cell:
    """Encode under a profile, decode the bytes, compare.

    Parameters
    ----------
    clip : str
    sequence : ArraySequence
    profile : str
    tolerance : float
    effort : int

    Raises
    ------
    AssertionError
        If connectivity came back otherwise.
    """
    started = time.perf_counter()
    report = encode(sequence, profile=profile, tolerance=tolerance, effort=effort)
    encode_seconds = time.perf_counter() - started
    data = report.data or b""
    decoded = np.empty_like(sequence.points)

    def decode() -> None:
        with open_animation(data) as animation:
            animation.sample(animation.times, out=decoded)

    decode_seconds = median_seconds(decode)
    with open_animation(data) as animation:
        if not animation.connectivity.same_as(sequence.connectivity):
            raise AssertionError(f"{clip}: connectivity came back otherwise")
        scale = frame_scale(sequence.points[0])
        found = measure_distortion(sequence, animation, scale=scale, limit=tolerance * scale)
        random_seconds = random_frame_seconds(animation)
    constant = sum(size for section, size in report.sections.items() if section in CONSTANT_SECTIONS)
    return Cell(
        clip=clip,
        coder=profile,
        kind="profile",
        tolerance=tolerance,
        frames=sequence.frame_count,
        vertices=sequence.vertex_count,
        size=report.file_bytes - constant,
        constant_size=constant,
        within=found.within,
        **_errors(found, scale),
        encode_seconds=encode_seconds,
        decode_seconds=decode_seconds,
        copy_seconds=copy_seconds(decoded),
        random_seconds=random_seconds,
        coefficients=report.coefficients,
        sections=report.sections,
        summary=report.summary,
    )


def measure_peer(clip: str, sequence: ArraySequence, peer: Peer, tolerances: Sequence[float]) -> Iterator[Cell]:
    """Search the fewest bytes with which a peer keeps each tolerance; a cell for each, in the order given.

    Parameters
    ----------
    clip : str
    sequence : ArraySequence
    peer : Peer
    tolerances : sequence of float
    """
    scale = frame_scale(sequence.points[0])
    copied = copy_seconds(sequence.points)
    curve = PeerCurve(peer, sequence.points, sequence.connectivity)
    for tolerance in tolerances:
        empty = Cell(
            clip=clip,
            coder=peer.name,
            kind="peer",
            published=peer.published,
            tolerance=tolerance,
            frames=sequence.frame_count,
            vertices=sequence.vertex_count,
        )
        yield _peer_cell(empty, curve, tolerance, scale, copied)


def _peer_cell(empty: Cell, curve: PeerCurve, tolerance: float, scale: float, copied: float) -> Cell:
    try:
        result = curve.reach(tolerance * scale)
    except UnreachableError as refusal:
        return replace(empty, refusal=str(refusal))
    found = result.distortion
    return replace(
        empty,
        size=result.size,
        # The search takes nothing that is not within the bound everywhere.
        within=1.0,
        **_errors(found, scale),
        encode_seconds=result.encode_seconds,
        decode_seconds=result.decode_seconds,
        copy_seconds=copied,
    )


def _errors(found: Distortion, scale: float) -> dict[str, Any]:
    """A cell's errors, lengths over the diagonal `scale`."""
    return {
        "max_error": found.max_error / scale,
        "rms_error": found.rms_error / scale,
        "p99_error": found.p99_error / scale,
        "kg_error": found.to_dict()["kg_error"],
    }


def warm_up(sequence: ArraySequence, *, profile: Profile, tolerances: Sequence[float], effort: int) -> None:
    """Encode and decode a few frames: what compiles, compiles now."""
    start = FrameSelection(sequence, range(min(WARM_UP_FRAMES, sequence.frame_count)))
    for tolerance in {min(tolerances), max(tolerances)}:
        report = encode(start, profile=profile, tolerance=tolerance, effort=effort)
        with open_animation(report.data or b"") as animation:
            animation.read_frames(0, animation.frame_count)
