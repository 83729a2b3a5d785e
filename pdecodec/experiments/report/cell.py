"""One measured point: a coder on a clip at a tolerance."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field
from typing import Any, Literal

from pdecodec.errors import InputError
from pdecodec.metrics import bits_per_vertex_frame

Kind = Literal["profile", "peer"]


@dataclass(frozen=True, kw_only=True)
class Cell:
    """What one coder made of one clip at one tolerance; all of it is None where the coder cannot keep the tolerance.

    Attributes
    ----------
    clip : str
    coder : str
        A profile of pdecodec, or a peer's name.
    kind : {"profile", "peer"}
    published : bool
        False where a peer has a stage that its source does not describe.
    tolerance : float
        Largest Euclidean vertex distance allowed, over frame 0's diagonal.
    refusal : str or None
        Why the coder cannot keep the tolerance.
    frames, vertices : int
    size : int or None [bytes]
        All that a decoder needs but connectivity and attributes.
    constant_size : int [bytes]
        Connectivity, order and attributes as pdecodec keeps them: the same for every coder.
    max_error, rms_error, p99_error : float or None
        Over frame 0's diagonal, of what came back from the bytes.
    within : float or None
        Share of positions within the tolerance.
    kg_error : float or None [%]
        None, too, where every frame is a single point.
    encode_seconds, decode_seconds, copy_seconds, random_seconds : float or None
        Of encoding; of opening and decoding all; of `np.copyto` of the same positions; of one frame at a random time
        of an open file (None for peers, which have no times).
    coefficients : int or None
        Numbers that the motion is made of (profiles).
    sections : dict of str to int [bytes]
        Of the file (profiles); the sum is the file.
    summary : str
        What model was taken and why (profiles).
    """

    clip: str
    coder: str
    kind: Kind
    published: bool = True
    tolerance: float
    refusal: str | None = None
    frames: int
    vertices: int
    size: int | None = None
    constant_size: int = 0
    max_error: float | None = None
    rms_error: float | None = None
    p99_error: float | None = None
    within: float | None = None
    kg_error: float | None = None
    encode_seconds: float | None = None
    decode_seconds: float | None = None
    copy_seconds: float | None = None
    random_seconds: float | None = None
    coefficients: int | None = None
    sections: Mapping[str, int] = field(default_factory=dict)
    summary: str = ""

    @property
    def reached(self) -> bool:
        """Whether there are bytes that keep the tolerance."""
        return self.size is not None and self.max_error is not None and self.max_error <= self.tolerance

    @property
    def raw_size(self) -> int:
        """Bytes of the positions as float32."""
        return 12 * self.frames * self.vertices

    @property
    def bpvf(self) -> float | None:
        """Bits per vertex and frame, connectivity and attributes left out."""
        if self.size is None:
            return None
        return bits_per_vertex_frame(self.size, vertices=self.vertices, frames=self.frames)

    @property
    def ratio(self) -> float | None:
        """Raw positions over everything that is stored, connectivity and attributes included."""
        return None if self.size is None else self.raw_size / (self.size + self.constant_size)

    @property
    def encode_rate(self) -> float | None:
        """Raw float32 taken in [MB/s]."""
        return None if not self.encode_seconds else self.raw_size / 1e6 / self.encode_seconds

    @property
    def decode_rate(self) -> float | None:
        """Raw float32 given back, opening included [MB/s]."""
        return None if not self.decode_seconds else self.raw_size / 1e6 / self.decode_seconds

    @property
    def decode_multiple(self) -> float | None:
        """Time of opening and decoding all, over that of a copy of the result."""
        if not self.decode_seconds or not self.copy_seconds:
            return None
        return self.decode_seconds / self.copy_seconds

    def to_dict(self) -> dict[str, Any]:
        """Fields and what follows from them, ready for JSON."""
        return asdict(self) | {name: getattr(self, name) for name in DERIVED}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Cell:
        """Undo :meth:`to_dict`.

        Raises
        ------
        InputError
            If the values are not a cell's.
        """
        try:
            cell = cls(**{name: value for name, value in values.items() if name not in DERIVED})
        except (TypeError, AttributeError) as error:
            raise InputError("holds a measured point that is not one of a report") from error
        for name, kinds in _KINDS.items():
            if not isinstance(getattr(cell, name), kinds):
                raise InputError(f"holds a measured point whose {name} is {getattr(cell, name)!r}")
        return cell


DERIVED = ("bpvf", "ratio", "encode_rate", "decode_rate", "decode_multiple")
"""Properties of a cell that are written, too."""

_NUMBER = (int, float, type(None))

_KINDS: dict[str, tuple[type, ...]] = {
    "clip": (str,),
    "coder": (str,),
    "kind": (str,),
    "published": (bool,),
    "tolerance": (int, float),
    "refusal": (str, type(None)),
    "frames": (int,),
    "vertices": (int,),
    "constant_size": (int,),
    "sections": (dict,),
    "summary": (str,),
    **dict.fromkeys(("size", "max_error", "rms_error", "p99_error", "within", "kg_error", "coefficients"), _NUMBER),
    **dict.fromkeys(("encode_seconds", "decode_seconds", "copy_seconds", "random_seconds"), _NUMBER),
}


def best_peer(cells: Iterable[Cell], tolerance: float, *, published: bool = False) -> Cell | None:
    """The peer with the fewest bytes that keeps a tolerance, of all or of those that are as published."""
    able = [
        cell
        for cell in cells
        if cell.kind == "peer" and cell.tolerance == tolerance and cell.reached and (cell.published or not published)
    ]
    return min(able, key=lambda cell: cell.size or 0, default=None)
