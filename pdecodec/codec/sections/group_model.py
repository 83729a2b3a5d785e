"""Section MODL: what the decoder builds its space basis from."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.codec.sections.bytestream import FieldWriter
from pdecodec.codec.sections.space_basis import SPACE_KINDS, SpaceForm


@dataclass(frozen=True, kw_only=True)
class GroupModelDescription:
    """Section MODL.

    Attributes
    ----------
    form : SpaceForm
    residual_step : float [scene units]
    layout : bytes
        Of the functions, see :meth:`pdecodec.codec.sections.space_basis.SpaceBasis.layout`.
    """

    form: SpaceForm
    residual_step: float
    layout: bytes

    def to_bytes(self) -> bytes:
        writer, form = FieldWriter(), self.form
        writer.numbers("B", SPACE_KINDS.index(form.kind))
        writer.count(form.points)
        writer.numbers("BB", form.functions, form.threshold)
        if form.kind == "curve":
            writer.numbers("dB", form.rate, form.affine)
        writer.numbers("d", self.residual_step)
        return writer.to_bytes() + self.layout
