"""The encoder of the profile that settings ask for."""

from __future__ import annotations

from pdecodec.encoding.autoprofile import AutoEncoder
from pdecodec.encoding.groupencoder import Encoder
from pdecodec.selection import CodedOrderSequence
from pdecodec.sequence import MeshSequence, Progress
from pdecodec.settings import EncodeSettings


def make_encoder(sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> Encoder:
    """The encoder of a sequence of constant connectivity that settings ask for."""
    if settings.order == "free":
        sequence = CodedOrderSequence(sequence)
    if settings.profile == "paper":
        from pdecodec.encoding.paperprofile import PaperEncoder

        return PaperEncoder(sequence, settings, progress)
    return AutoEncoder(sequence, settings, progress)
