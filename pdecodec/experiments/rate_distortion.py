"""Bytes against error, beside the best peer, and errors between frames: ``make bench-rd``.

``python -m pdecodec.experiments.rate_distortion [--sequences FILE...] [--tolerance 0.01 0.001] [--no-peers]``
encodes every sequence at every tolerance, decodes the bytes again with the public decoder, checks the bound on what
came back, and prints a row beside the best peer at the same bound. Then every second frame is left out of the
encoding, and the error at these is set beside that of a cubic spline through the original frames kept.

A tolerance is the largest Euclidean vertex distance over the diagonal of frame 0's bounding box. Rates (bpvf, bits
per vertex and frame) count everything but connectivity and attributes, of the codec and of the peers alike.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from pdecodec.decoder import open_animation
from pdecodec.encoder import encode
from pdecodec.encodereport import CONSTANT_SECTIONS
from pdecodec.errors import InputError, PdecodecError
from pdecodec.formats import open_sequence
from pdecodec.metrics import Distortion, DistortionMeter, bits_per_vertex_frame, frame_scale, measure_distortion
from pdecodec.peers.catalogue import available_peers
from pdecodec.peers.kept import KeptCells, PeerCell, sequence_digest
from pdecodec.peers.peer import Peer
from pdecodec.selection import FrameSelection
from pdecodec.sequence import ArraySequence, Float32Array, Float64Array
from pdecodec.settings import EncodeSettings
from pdecodec.whole_output import whole_file

TOLERANCES = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)

BETWEEN_TOLERANCE = 1e-4
"""So tight that what is seen between frames is the interpolation, not the quantisation."""

RUNS = 5
"""Of decoding and of copying; the median counts."""

WARM_UP_FRAMES = 8
"""Encoded and decoded once before anything is timed, so that compiling is not."""

SCENE_FRAMES = 61
"""Of the simulated rope that stands in where there are no sequences."""

KEPT_CELLS = Path("out/peer_cells.json")


@dataclass(frozen=True)
class Row:
    """One sequence at one tolerance; errors are over the diagonal of frame 0.

    Attributes
    ----------
    bound_holds : bool
        Whether no vertex of any decoded frame is farther away than the tolerance allows.
    kg_error : float or None [%]
        None where every frame is a single point.
    encode_rate : float [MB/s]
        Of raw float32.
    decode_multiple : float
        Time of opening and decoding everything, over that of `np.copyto` of the same positions.
    sections : dict of str to int
        Bytes; the sum is the file.
    peers_measured : int
        Of `peers`, those that were measured in this run; the others were kept from an earlier one.
    """

    sequence: str
    frames: int
    vertices: int
    tolerance: float
    bpvf: float
    max_error: float
    rms_error: float
    kg_error: float | None
    bound_holds: bool
    encode_rate: float
    decode_multiple: float
    summary: str
    sections: dict[str, int]
    peers: tuple[PeerCell, ...] = ()
    peers_measured: int = 0

    def best_peer(self, *, published: bool) -> PeerCell | None:
        """The smallest of the peers that reach the tolerance, of all or of those published as they are."""
        able = [cell for cell in self.peers if cell.bpvf is not None and (cell.published or not published)]
        return min(able, key=lambda cell: cell.bpvf or 0.0, default=None)


@dataclass(frozen=True)
class BetweenRow:
    """Errors at the frames left out, over the diagonal of frame 0: of the codec and of a cubic spline."""

    sequence: str
    frames: int
    rms_error: float
    max_error: float
    spline_rms_error: float
    spline_max_error: float


def measure(name: str, sequence: ArraySequence, *, tolerance: float, effort: int) -> Row:
    """Encode, decode the bytes again, compare.

    Parameters
    ----------
    name : str
    sequence : ArraySequence
    tolerance : float
    effort : int

    Raises
    ------
    AssertionError
        If connectivity came back otherwise.
    """
    started = time.perf_counter()
    report = encode(sequence, tolerance=tolerance, effort=effort)
    encode_seconds = time.perf_counter() - started
    data = report.data or b""
    decoded = np.empty_like(sequence.points)

    def decode() -> None:
        with open_animation(data) as animation:
            animation.sample(animation.times, out=decoded)

    decode_seconds = _median_seconds(decode)
    with open_animation(data) as animation:
        if not animation.connectivity.same_as(sequence.connectivity):
            raise AssertionError(f"{name}: connectivity came back otherwise")
        found = measure_distortion(sequence, animation)
    target = np.empty_like(decoded)
    counted = sum(size for section, size in report.sections.items() if section not in CONSTANT_SECTIONS)
    return Row(
        sequence=name,
        frames=sequence.frame_count,
        vertices=sequence.vertex_count,
        tolerance=tolerance,
        bpvf=bits_per_vertex_frame(counted, vertices=sequence.vertex_count, frames=sequence.frame_count),
        max_error=found.max_error / found.scale,
        rms_error=found.rms_error / found.scale,
        kg_error=found.to_dict()["kg_error"],
        bound_holds=found.max_error <= tolerance * found.scale,
        encode_rate=sequence.points.nbytes / 1e6 / encode_seconds,
        decode_multiple=decode_seconds / _median_seconds(partial(np.copyto, target, decoded)),
        summary=report.summary,
        sections=report.sections,
    )


def measure_between(name: str, sequence: ArraySequence, *, effort: int) -> BetweenRow | None:
    """Leave every second frame out and compare; None where fewer than three frames are there.

    Frames after the last one kept are not between frames and do not count.
    """
    kept = np.arange(0, sequence.frame_count, 2)
    left_out = np.arange(1, int(kept[-1]), 2)
    if left_out.size == 0:
        return None
    report = encode(FrameSelection(sequence, kept.tolist()), tolerance=BETWEEN_TOLERANCE, effort=effort)
    times = sequence.times[left_out]
    with open_animation(report.data or b"") as animation:
        codec = _distortion(sequence, left_out, animation.sample(times))
    spline = _distortion(sequence, left_out, cubic_spline(sequence.times[kept], sequence.points[kept], times))
    return BetweenRow(
        sequence=name,
        frames=int(left_out.size),
        rms_error=codec.rms_error / codec.scale,
        max_error=codec.max_error / codec.scale,
        spline_rms_error=spline.rms_error / spline.scale,
        spline_max_error=spline.max_error / spline.scale,
    )


def cubic_spline(knots: Float64Array, points: Float32Array, times: Float64Array) -> Float32Array:
    """Positions at `times` of the cubic spline (not-a-knot) through `points` at `knots`.

    Parameters
    ----------
    knots : (kept,) float64 [s]
    points : (kept, vertices, 3) float32 [scene units]
    times : (n,) float64 [s]

    Returns
    -------
    (n, vertices, 3) float32 [scene units]
    """
    from scipy.interpolate import CubicSpline

    positions: Float32Array = CubicSpline(knots, points.astype(np.float64), axis=0)(times).astype(np.float32)
    return positions


def _distortion(sequence: ArraySequence, frames: np.ndarray, positions: Float32Array) -> Distortion:
    meter = DistortionMeter(scale=frame_scale(sequence.points[0]))
    meter.add(sequence.points[frames], positions)
    return meter.result()


def _median_seconds(work: Callable[[], object]) -> float:
    work()
    seconds = []
    for _ in range(RUNS):
        started = time.perf_counter()
        work()
        seconds.append(time.perf_counter() - started)
    return statistics.median(seconds)


def run(
    sources: Iterable[tuple[str, ArraySequence]],
    *,
    tolerances: Sequence[float] = TOLERANCES,
    effort: int = EncodeSettings().effort,
    peers: Sequence[Peer] = (),
    cells: KeptCells | None = None,
) -> Iterator[Row | BetweenRow]:
    """Measure everything, giving each row when it is done: of each sequence its tolerances, then between frames.

    Parameters
    ----------
    sources : iterable of (name, ArraySequence)
    tolerances : sequence of float
    effort : int
    peers : sequence of Peer
    cells : KeptCells, optional
        Where the peers' measurements are kept; without it no peer is measured.
    """
    for name, sequence in sources:
        _warm_up(sequence, tolerances, effort)
        digest = sequence_digest(sequence)
        for tolerance in tolerances:
            row = measure(name, sequence, tolerance=tolerance, effort=effort)
            if cells is not None:
                before = cells.measured
                found = tuple(cells.cell(peer, sequence, digest, tolerance) for peer in peers)
                row = replace(row, peers=found, peers_measured=cells.measured - before)
            yield row
        between = measure_between(name, sequence, effort=effort)
        if between is not None:
            yield between


def _warm_up(sequence: ArraySequence, tolerances: Sequence[float], effort: int) -> None:
    start = FrameSelection(sequence, range(min(WARM_UP_FRAMES, sequence.frame_count)))
    for tolerance in {min(tolerances), max(tolerances)}:
        report = encode(start, tolerance=tolerance, effort=effort)
        with open_animation(report.data or b"") as animation:
            animation.read_frames(0, animation.frame_count)


HEAD = (
    "| sequence | tolerance | bpvf | max / bound | rms | KG % | encode MB/s | decode / copy "
    "| best peer | bpvf | ratio | best as published | bpvf | ratio | peers now, kept |",
    "|---|---|---|---|---|---|---|---|---|---|---|---|---|---|---|",
)

HEAD_WITHOUT_PEERS = tuple("|".join(line.split("|")[:9]) + "|" for line in HEAD)

HEAD_BETWEEN = (
    "| sequence | frames left out | rms | spline rms | ratio | max | spline max | ratio |",
    "|---|---|---|---|---|---|---|---|",
)


def line_of(row: Row, *, with_peers: bool) -> str:
    """A row of the table in Markdown."""
    cells = [
        row.sequence,
        f"{row.tolerance:g}",
        f"{row.bpvf:.3f}",
        f"{row.max_error / row.tolerance:.3f}" + ("" if row.bound_holds else " BROKEN"),
        f"{row.rms_error:.1e}",
        "-" if row.kg_error is None else f"{row.kg_error:.3f}",
        f"{row.encode_rate:.1f}",
        f"{row.decode_multiple:.1f}",
    ]
    if with_peers:
        for published in (False, True):
            best = row.best_peer(published=published)
            if best is None or best.bpvf is None:
                cells += ["none", "", ""]
            else:
                cells += [best.peer, f"{best.bpvf:.3f}", f"{row.bpvf / best.bpvf:.2f}"]
        cells.append(f"{row.peers_measured}, {len(row.peers) - row.peers_measured}")
    return f"| {' | '.join(cells)} |"


def line_of_between(row: BetweenRow) -> str:
    """A row of the table of errors between frames in Markdown."""
    cells = [row.sequence, str(row.frames)]
    for mine, spline in ((row.rms_error, row.spline_rms_error), (row.max_error, row.spline_max_error)):
        cells += [f"{mine:.2e}", f"{spline:.2e}", f"{mine / spline:.3f}" if spline else "-"]
    return f"| {' | '.join(cells)} |"


def mean_ratios(rows: Sequence[Row]) -> list[str]:
    """Of each tolerance, the geometric mean over the sequences of the bytes over the best peer's."""
    lines = []
    for tolerance in sorted({row.tolerance for row in rows}, reverse=True):
        pairs = [(row, row.best_peer(published=False)) for row in rows if row.tolerance == tolerance]
        logarithms = [math.log(row.bpvf / best.bpvf) for row, best in pairs if best is not None and best.bpvf]
        if logarithms:
            mean = math.exp(statistics.fmean(logarithms))
            lines.append(f"{tolerance:g}: {mean:.2f} times the best peer, mean of {len(logarithms)} sequences")
    return lines


def find_sources(given: Sequence[Path]) -> list[Path]:
    """Sequence files: those given (the .npz files of a folder), else those of ``$PDECODEC_DATA/sequences``.

    Raises
    ------
    InputError
        If a given folder has none.
    """
    folder = Path(os.environ.get("PDECODEC_DATA", "")) / "sequences"
    if not given:
        return sorted(folder.glob("*.npz")) if "PDECODEC_DATA" in os.environ else []
    found = []
    for path in given:
        inside = sorted(path.glob("*.npz")) if path.is_dir() else [path]
        if not inside:
            raise InputError("there is no .npz sequence in this folder; name the files", path=path)
        found += inside
    return found


def open_sources(paths: Sequence[Path]) -> Iterator[tuple[str, ArraySequence]]:
    """Each sequence by name, in memory one after the other; a simulated rope where there is no path."""
    if not paths:
        from pdecodec.xpbd import build

        yield "simulated cube-rope", build("cube-rope").simulate(frames=SCENE_FRAMES, fps=24.0).to_array()
    for path in paths:
        with open_sequence(path) as opened:
            yield path.stem, opened.to_array()


def main(arguments: Sequence[str]) -> int:
    """Print the tables; returns the exit code, 1 where a bound is broken."""
    parser = argparse.ArgumentParser(description="Bytes against error, beside the best peer.")
    parser.add_argument("--sequences", type=Path, nargs="+", default=[], help="files, or folders of .npz files")
    parser.add_argument("--tolerance", type=float, nargs="+", default=list(TOLERANCES))
    parser.add_argument("--effort", type=int, default=EncodeSettings().effort)
    parser.add_argument("--no-peers", action="store_true", help="measure the codec alone")
    parser.add_argument("--fresh", action="store_true", help="measure the peers anew, whatever was kept")
    parser.add_argument("--kept", type=Path, default=KEPT_CELLS, help="where peers' measurements are kept")
    parser.add_argument("--json", type=Path, help="write every figure to this file as well")
    chosen = parser.parse_args(arguments)
    try:
        return _print_tables(chosen)
    except PdecodecError as error:
        print(error, file=sys.stderr)
        return error.exit_code


def _print_tables(chosen: argparse.Namespace) -> int:
    peers, skipped = ((), ()) if chosen.no_peers else available_peers()
    for reason in skipped:
        print(f"not measured: {reason}")
    cells = None if chosen.no_peers else KeptCells(chosen.kept, fresh=chosen.fresh)
    paths = find_sources(chosen.sequences)
    rows: list[Row] = []
    between: list[BetweenRow] = []
    print("\n".join(HEAD_WITHOUT_PEERS if chosen.no_peers else HEAD))
    found = run(open_sources(paths), tolerances=chosen.tolerance, effort=chosen.effort, peers=peers, cells=cells)
    for item in found:
        if isinstance(item, Row):
            rows.append(item)
            print(line_of(item, with_peers=not chosen.no_peers), flush=True)
        else:
            between.append(item)
    print("", *mean_ratios(rows), sep="\n")
    if cells is not None:
        print(f"peers: {cells.measured} measured now, {cells.kept} kept from earlier runs in {chosen.kept}")
    print(f"\nbetween frames, every second one left out, at tolerance {BETWEEN_TOLERANCE:g}:\n")
    print("\n".join([*HEAD_BETWEEN, *map(line_of_between, between)]))
    if chosen.json is not None:
        everything = {"rows": [asdict(row) for row in rows], "between": [asdict(row) for row in between]}
        with whole_file(chosen.json, overwrite=True) as partial_path:
            partial_path.write_text(json.dumps({**everything, "skipped": skipped}, indent=1), encoding="utf-8")
    return 0 if all(row.bound_holds for row in rows) else 1


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
