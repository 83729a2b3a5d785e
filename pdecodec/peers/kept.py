"""Peers' measurements kept from run to run: most of them take longer than the codec does."""

from __future__ import annotations

import hashlib
import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pdecodec.errors import InputError
from pdecodec.metrics import bits_per_vertex_frame, frame_scale
from pdecodec.peers.peer import Peer, UnreachableError
from pdecodec.peers.search import PeerCurve
from pdecodec.sequence import ArraySequence
from pdecodec.whole_output import whole_file


@dataclass(frozen=True)
class PeerCell:
    """One peer on one sequence at one tolerance.

    Attributes
    ----------
    peer : str
    published : bool
        Whether the peer is what its source describes.
    bpvf : float or None
        Bits per vertex and frame, connectivity not counted; None where the peer cannot reach the tolerance.
    reason : str or None
        Why it cannot.
    max_error, rms_error : float or None
        Over frame 0's diagonal.
    kg_error : float or None [%]
    encode_seconds, decode_seconds : float or None
    """

    peer: str
    published: bool
    bpvf: float | None = None
    reason: str | None = None
    max_error: float | None = None
    rms_error: float | None = None
    kg_error: float | None = None
    encode_seconds: float | None = None
    decode_seconds: float | None = None


class KeptCells:
    """Cells by sequence, peer, version of the peer, and tolerance, in a JSON file.

    Parameters
    ----------
    path : Path
        Read if it is there, written after every new cell.
    fresh : bool
        Measure everything anew; what the file holds of it is replaced.

    Attributes
    ----------
    measured, kept : int
        Cells that were measured, and that were in the file.

    Raises
    ------
    InputError
        If the file is not one of these, or cannot be written.
    """

    def __init__(self, path: Path, *, fresh: bool = False) -> None:
        self.measured = self.kept = 0
        self._path = path
        self._cells: dict[str, dict[str, Any]] = {}
        self._curves: tuple[str, dict[str, PeerCurve]] = ("", {})
        if path.exists() and not fresh:
            self._cells = _read(path)

    def cell(
        self, peer: Peer, sequence: ArraySequence, digest: str, tolerance: float, *, curve: PeerCurve | None = None
    ) -> PeerCell:
        """The cell from the file, or measured now and kept.

        Parameters
        ----------
        peer : Peer
        sequence : ArraySequence
        digest : str
            Of the sequence, :func:`sequence_digest`.
        tolerance : float
            Largest Euclidean vertex distance over frame 0's diagonal.
        curve : PeerCurve, optional
            Of this peer on this sequence. Default: one that is made when the first cell is measured, and lives until
            another sequence is measured.
        """
        key = hashlib.sha256(f"{digest} {peer.version()} {tolerance!r}".encode()).hexdigest()[:32]
        if key in self._cells:
            self.kept += 1
            return PeerCell(**self._cells[key])
        found = measure_cell(peer, sequence, tolerance, curve=curve or self._curve(peer, sequence, digest))
        self.measured += 1
        self._cells[key] = asdict(found)
        self._path.parent.mkdir(parents=True, exist_ok=True)
        # Another run may have kept cells in the meantime.
        on_disk = _read(self._path) if self._path.exists() else {}
        with whole_file(self._path, overwrite=True) as partial:
            partial.write_text(json.dumps({**on_disk, **self._cells}, indent=1, sort_keys=True), encoding="utf-8")
        return found

    def _curve(self, peer: Peer, sequence: ArraySequence, digest: str) -> PeerCurve:
        if self._curves[0] != digest:
            self._curves = (digest, {})
        curves = self._curves[1]
        if peer.name not in curves:
            curves[peer.name] = PeerCurve(peer, sequence.points, sequence.connectivity)
        return curves[peer.name]


def measure_cell(peer: Peer, sequence: ArraySequence, tolerance: float, *, curve: PeerCurve) -> PeerCell:
    """Measure one peer on one sequence at one tolerance.

    Parameters
    ----------
    peer : Peer
    sequence : ArraySequence
    tolerance : float
    curve : PeerCurve
        Of this peer on this sequence.
    """
    scale = frame_scale(sequence.points[0])
    try:
        result = curve.reach(tolerance * scale)
    except UnreachableError as refusal:
        return PeerCell(peer.name, peer.published, reason=str(refusal))
    return PeerCell(
        peer=peer.name,
        published=peer.published,
        bpvf=bits_per_vertex_frame(result.size, vertices=sequence.vertex_count, frames=sequence.frame_count),
        max_error=result.distortion.max_error / scale,
        rms_error=result.distortion.rms_error / scale,
        kg_error=result.distortion.to_dict()["kg_error"],
        encode_seconds=result.encode_seconds,
        decode_seconds=result.decode_seconds,
    )


def sequence_digest(sequence: ArraySequence) -> str:
    """Of all that a peer is given: positions, faces and lines."""
    digest = hashlib.sha256(repr(sequence.points.shape).encode())
    digest.update(sequence.points.tobytes())
    connectivity = sequence.connectivity
    for name in ("face_counts", "face_indices", "line_counts", "line_indices"):
        digest.update(f"{name} {getattr(connectivity, name).size} ".encode())
        digest.update(getattr(connectivity, name).tobytes())
    return digest.hexdigest()


def _read(path: Path) -> dict[str, dict[str, Any]]:
    try:
        cells = json.loads(path.read_text(encoding="utf-8"))
        for cell in cells.values():
            PeerCell(**cell)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, AttributeError, TypeError) as error:
        raise InputError("does not hold kept measurements of peers; delete it, or name another", path=path) from error
    kept: dict[str, dict[str, Any]] = cells
    return kept
