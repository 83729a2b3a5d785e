"""Section MODL: what the decoder builds its space basis from."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.basis import MAX_RATE
from pdecodec.bytestream import FieldReader, FieldWriter
from pdecodec.errors import CorruptFileError
from pdecodec.limits import LARGEST_STEP
from pdecodec.spacebasis import MOST_FUNCTIONS, MOST_POINTS, SPACE_KINDS, THRESHOLDS, SpaceForm


@dataclass(frozen=True, kw_only=True)
class GroupModelDescription:
    """Section MODL.

    Attributes
    ----------
    form : SpaceForm
    correction_step : float [scene units]
    masks : bytes
        Of the partition tree's nodes, see :meth:`pdecodec.spacebasis.SpaceBasis.encode_masks`.
    """

    form: SpaceForm
    correction_step: float
    masks: bytes

    def to_bytes(self) -> bytes:
        writer, form = FieldWriter(), self.form
        writer.numbers("B", SPACE_KINDS.index(form.kind))
        writer.count(form.points)
        writer.numbers("BB", form.functions, form.threshold)
        if form.kind == "curve":
            writer.numbers("dB", form.rate, form.affine)
        writer.numbers("d", self.correction_step)
        return writer.to_bytes() + self.masks

    @classmethod
    def from_bytes(cls, data: bytes) -> GroupModelDescription:
        """Undo :meth:`to_bytes`; CorruptFileError where a field is out of range."""
        reader = FieldReader(data, "MODL")
        (number,) = reader.integers("B")
        if number >= len(SPACE_KINDS):
            raise CorruptFileError(f"section MODL names space basis {number}, which is unknown")
        kind, points = SPACE_KINDS[number], reader.count()
        functions, threshold = reader.integers("BB")
        rate, affine = 0.0, 1
        if kind == "curve":
            (rate,) = reader.reals("d")
            (affine,) = reader.integers("B")
        (correction_step,) = reader.reals("d")
        if not (1 <= points <= MOST_POINTS[kind] and 1 <= functions <= MOST_FUNCTIONS):
            raise CorruptFileError("section MODL has a size of patches out of range")
        if threshold >= THRESHOLDS or affine > 1 or not 0 <= rate <= MAX_RATE:
            raise CorruptFileError("section MODL has a threshold, a rate or a sort of pieces out of range")
        if not 0 < correction_step <= LARGEST_STEP:
            raise CorruptFileError("section MODL has a quantisation step out of range")
        form = SpaceForm(kind, points, functions, threshold, rate, bool(affine))
        return cls(form=form, correction_step=correction_step, masks=reader.rest())
