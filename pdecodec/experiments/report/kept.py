"""Measured cells kept from run to run, so that a report that was cut off goes on where it was."""

from __future__ import annotations

import hashlib
import json
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import pdecodec
from pdecodec.errors import InputError
from pdecodec.experiments.report.cell import Cell
from pdecodec.sequence import ArraySequence
from pdecodec.whole_output import whole_file


class KeptCells:
    """Cells by what they are of, in a JSON file.

    Parameters
    ----------
    path : Path
        Read if it is there, written after every new cell.
    fresh : bool
        Measure everything anew; what the file holds of it is replaced.

    Attributes
    ----------
    measured, kept : int
        Cells that were added, and that were found.

    Raises
    ------
    InputError
        If the file is not one of these.
    """

    def __init__(self, path: Path, *, fresh: bool = False) -> None:
        self.measured = self.kept = 0
        self._path = path
        self._cells: dict[str, dict[str, Any]] = {}
        if path.exists() and not fresh:
            self._cells = _read(path)

    def find(self, key: str, clip: str) -> Cell | None:
        """The cell of a key (:func:`cell_key`), under the name that its clip has now."""
        if key not in self._cells:
            return None
        self.kept += 1
        return replace(Cell.from_dict(self._cells[key]), clip=clip)

    def keep(self, key: str, cell: Cell) -> None:
        """Add a cell, and write the file."""
        self.measured += 1
        self._cells[key] = cell.to_dict()
        # Another run may have kept cells in the meantime.
        on_disk = _read(self._path) if self._path.exists() else {}
        with whole_file(self._path, overwrite=True) as partial:
            partial.write_text(json.dumps({**on_disk, **self._cells}, indent=1, sort_keys=True), encoding="utf-8")


def cell_key(digest: str, version: str, tolerance: float) -> str:
    """What a cell is kept under: a clip's digest, its coder's version, and the tolerance."""
    return hashlib.sha256(f"{digest} {version} {tolerance!r}".encode()).hexdigest()[:32]


def clip_digest(sequence: ArraySequence) -> str:
    """Of all that coders are given: positions, times, faces, lines, names and attributes."""
    digest = hashlib.sha256(repr(sequence.points.shape).encode())
    digest.update(sequence.points.tobytes())
    digest.update(sequence.times.tobytes())
    for item in sequence.objects:
        digest.update(f"{item.name!r} {[attribute.name for attribute in item.attributes]!r}".encode())
        arrays = [
            getattr(item.connectivity, name) for name in ("face_counts", "face_indices", "line_counts", "line_indices")
        ]
        for array in (*arrays, *(attribute.values for attribute in item.attributes)):
            digest.update(f"{array.shape} {array.dtype} ".encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


@cache
def codec_version() -> str:
    """Changes when what pdecodec writes, or how fast, may: a digest of its code."""
    digest = hashlib.sha256()
    folder = Path(pdecodec.__file__).parent
    for path in sorted([*folder.glob("*.py"), *folder.glob("kernels/*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]


def _read(path: Path) -> dict[str, dict[str, Any]]:
    try:
        cells = json.loads(path.read_text(encoding="utf-8"))
        for cell in cells.values():
            Cell.from_dict(cell)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, AttributeError, InputError) as error:
        raise InputError("does not hold kept measurements; delete it, or name another folder", path=path) from error
    kept: dict[str, dict[str, Any]] = cells
    return kept
