"""One measured point, a coder on a clip at a tolerance; and points kept from run to run.

Kept points let an interrupted report resume.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass, field, replace
from functools import cache
from pathlib import Path
from types import UnionType
from typing import Any, Literal, get_args, get_origin, get_type_hints

import pdecodec
from pdecodec import _core
from pdecodec.errors import InputError, damaged
from pdecodec.mesh.metrics import bits_per_vertex_frame
from pdecodec.mesh.sequence import ArraySequence
from pdecodec.system.whole_output import whole_file

Kind = Literal["profile", "baseline"]


@dataclass(frozen=True, kw_only=True)
class Measurement:
    """One coder's result for one clip at one tolerance; all values are None if the coder cannot keep the tolerance.

    Attributes
    ----------
    clip : str
    coder : str
        A profile of pdecodec, or a baseline's name.
    kind : {"profile", "baseline"}
    published : bool
        False if a baseline has a stage that its source does not describe.
    tolerance : float
        Largest Euclidean vertex distance allowed, over frame 0's diagonal.
    refusal : str or None
        Why the coder cannot keep the tolerance.
    frames, vertices : int
    size : int or None [bytes]
        Everything that a decoder needs except connectivity and attributes.
    constant_size : int [bytes]
        Connectivity, order and attributes as pdecodec stores them: the same for every coder.
    max_error, rms_error, p99_error : float or None
        Over frame 0's diagonal, of the positions decoded from the bytes.
    within : float or None
        Fraction of positions within the tolerance.
    kg_error : float or None [%]
        None, too, if every frame is a single point.
    normal_error, normal_p99 : float or None [degrees]
        Mean and 99th percentile of the angle between normals; None without faces.
    sted : float or None
        Spatio-temporal edge difference (:mod:`pdecodec.mesh.surface_metrics`); None without edges.
    encode_seconds, decode_seconds, copy_seconds, random_seconds : float or None
        Of encoding; of opening and decoding all; of `np.copyto` of the same positions; of one frame at a random time of
        an open file (None for baselines, which have no times).
    coefficients : int or None
        Numbers that the motion is made of (profiles).
    sections : dict of str to int [bytes]
        Bytes by section (profiles); they add up to the file.
    summary : str
        Which model was chosen and why (profiles).
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
    normal_error: float | None = None
    normal_p99: float | None = None
    sted: float | None = None
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
    def whole_size(self) -> int:
        """Bytes of everything that is stored, connectivity and attributes included."""
        return (self.size or 0) + self.constant_size

    @property
    def bpvf(self) -> float | None:
        """Bits per vertex and frame, without connectivity and attributes."""
        if self.size is None:
            return None
        return bits_per_vertex_frame(self.size, vertices=self.vertices, frames=self.frames)

    @property
    def ratio(self) -> float | None:
        """Raw positions over everything that is stored."""
        return None if self.size is None else self.raw_size / self.whole_size

    @property
    def encode_rate(self) -> float | None:
        """Raw float32 encoded per second [MB/s]."""
        return None if not self.encode_seconds else self.raw_size / 1e6 / self.encode_seconds

    @property
    def decode_rate(self) -> float | None:
        """Raw float32 decoded per second, opening included [MB/s]."""
        return None if not self.decode_seconds else self.raw_size / 1e6 / self.decode_seconds

    @property
    def decode_multiple(self) -> float | None:
        """Time to open and decode everything, over that of a copy of the result."""
        if not self.decode_seconds or not self.copy_seconds:
            return None
        return self.decode_seconds / self.copy_seconds

    def to_dict(self) -> dict[str, Any]:
        """Return fields and derived values, ready for JSON."""
        return asdict(self) | {name: getattr(self, name) for name in DERIVED}

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> Measurement:
        """Undo :meth:`to_dict`.

        Raises
        ------
        InputError
            If the values are not a measurement's.
        """
        try:
            point = cls(**{name: value for name, value in values.items() if name not in DERIVED})
        except (TypeError, AttributeError) as error:
            raise damaged("holds a measured point that is not one of a report") from error
        for name, hint in get_type_hints(cls).items():
            if not isinstance(getattr(point, name), _kinds(hint)):
                raise damaged(f"holds a measured point whose {name} is {getattr(point, name)!r}")
        return point


DERIVED = ("bpvf", "ratio", "encode_rate", "decode_rate", "decode_multiple")
"""Properties of a measurement that are written too."""


def _kinds(hint: Any) -> tuple[type, ...]:
    """Return the types that a field of some annotation may have in JSON, where whole numbers lack a point."""
    parts = get_args(hint) if isinstance(hint, UnionType) else (hint,)
    plain = [str if get_origin(part) is Literal else get_origin(part) or part for part in parts]
    return (*plain, *([int] if float in plain else []))


def best_baseline(points: Iterable[Measurement], tolerance: float, *, published: bool = False) -> Measurement | None:
    """Return the baseline of fewest bytes that keeps a tolerance, among all or among those as published."""
    able = [
        point
        for point in points
        if point.kind == "baseline"
        and point.tolerance == tolerance
        and point.reached
        and (point.published or not published)
    ]
    return min(able, key=lambda point: point.size or 0, default=None)


def size_ratio(point: Measurement, other: Measurement | None) -> float | None:
    """Return the ratio of the bytes of two measurements, without connectivity."""
    return None if other is None or not other.size or point.size is None else point.size / other.size


class KeptMeasurements:
    """Measurements by key, in a JSON file that is written after every new one; counts new and found ones.

    With `fresh`, everything is measured anew. Raises InputError if the file is of another kind.
    """

    def __init__(self, path: Path, *, fresh: bool = False) -> None:
        self.measured = self.kept = 0
        self._path = path
        self._points: dict[str, dict[str, Any]] = _read(path) if path.exists() and not fresh else {}

    def find(self, key: str, clip: str) -> Measurement | None:
        """Return the measurement of a key (:func:`measurement_key`), under the clip's present name."""
        if key not in self._points:
            return None
        self.kept += 1
        return replace(Measurement.from_dict(self._points[key]), clip=clip)

    def keep(self, key: str, point: Measurement) -> None:
        """Add a measurement, and write the file."""
        self.measured += 1
        self._points[key] = point.to_dict()
        # Another run may have added measurements in the meantime.
        on_disk = _read(self._path) if self._path.exists() else {}
        with whole_file(self._path, overwrite=True) as partial:
            partial.write_text(json.dumps({**on_disk, **self._points}, indent=1, sort_keys=True), encoding="utf-8")


def _read(path: Path) -> dict[str, dict[str, Any]]:
    try:
        kept: dict[str, dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))
        for point in kept.values():
            Measurement.from_dict(point)
    except (OSError, UnicodeDecodeError, json.JSONDecodeError, AttributeError, InputError) as error:
        raise damaged("does not hold kept measurements; delete it, or name another folder", path=path) from error
    return kept


def measurement_key(digest: str, version: str, tolerance: float) -> str:
    """Return the key of a measurement: a clip's digest, its coder's version, and the tolerance."""
    return hashlib.sha256(f"{digest} {version} {tolerance!r}".encode()).hexdigest()[:32]


def clip_digest(sequence: ArraySequence) -> str:
    """Return a digest of everything that coders are given: positions, times, faces, lines, names and attributes."""
    digest = hashlib.sha256(repr(sequence.points.shape).encode())
    digest.update(sequence.points.tobytes())
    digest.update(sequence.times.tobytes())
    for item in sequence.objects:
        digest.update(f"{item.name!r} {[attribute.name for attribute in item.attributes]!r}".encode())
        faces = item.connectivity
        arrays = (faces.face_counts, faces.face_indices, faces.line_counts, faces.line_indices)
        for array in (*arrays, *(attribute.values for attribute in item.attributes)):
            digest.update(f"{array.shape} {array.dtype} ".encode())
            digest.update(array.tobytes())
    return digest.hexdigest()


@cache
def codec_version() -> str:
    """Return a digest of the codec's code and its native core; it changes when files or speed may."""
    digest = hashlib.sha256(Path(str(_core.__file__)).read_bytes())
    folder = Path(pdecodec.__file__).parent
    for path in sorted([*folder.glob("codec/**/*.py"), *folder.glob("mesh/*.py")]):
        digest.update(path.read_bytes())
    return digest.hexdigest()[:16]
