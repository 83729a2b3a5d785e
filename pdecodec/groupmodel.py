"""Section MODL of format version 2: what the decoder builds space bases from."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.errors import CorruptFileError
from pdecodec.quantise import LARGEST_STEP
from pdecodec.spacebasis import MOST_FUNCTIONS, MOST_POINTS, SPACE_KINDS, SpaceKind


@dataclass(frozen=True, kw_only=True)
class GroupModelDescription:
    """Section MODL.

    Attributes
    ----------
    space : {"patch", "curve"}
    points, functions : int
        Of a patch at most.
    correction_step : float [scene units]
    columns : int
        Functions of all patches together, as a check.
    """

    space: SpaceKind
    points: int
    functions: int
    correction_step: float
    columns: int

    def to_bytes(self) -> bytes:
        writer = FieldWriter()
        writer.numbers(
            "BHHdQ", SPACE_KINDS.index(self.space), self.points, self.functions, self.correction_step, self.columns
        )
        return writer.to_bytes()

    @classmethod
    def from_bytes(cls, data: bytes) -> GroupModelDescription:
        """Undo :meth:`to_bytes`; CorruptFileError where a field is out of range."""
        reader = FieldReader(data, "MODL")
        kind, points, functions = reader.integers("BHH")
        (correction_step,) = reader.reals("d")
        (columns,) = reader.integers("Q")
        reader.finish()
        if kind >= len(SPACE_KINDS):
            raise CorruptFileError(f"section MODL names space basis {kind}, which is unknown")
        if not (1 <= points <= MOST_POINTS and 1 <= functions <= MOST_FUNCTIONS):
            raise CorruptFileError("section MODL has a size of patches out of range")
        if not 0 < correction_step <= LARGEST_STEP:
            raise CorruptFileError("section MODL has a quantisation step out of range")
        return cls(
            space=SPACE_KINDS[kind],
            points=points,
            functions=functions,
            correction_step=correction_step,
            columns=columns,
        )
