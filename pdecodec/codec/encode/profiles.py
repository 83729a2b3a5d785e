"""The encoder of the profile that settings ask for."""

from __future__ import annotations

from pdecodec.codec.encode.auto_profile import AutoEncoder
from pdecodec.codec.encode.group_encoder import Encoder
from pdecodec.codec.settings import EncodeSettings
from pdecodec.mesh.selection import CodedOrderSequence
from pdecodec.mesh.sequence import MeshSequence, Progress


def make_encoder(sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> Encoder:
    """The encoder of a sequence of constant connectivity that settings ask for."""
    if settings.order == "free":
        sequence = CodedOrderSequence(sequence)
    if settings.profile == "paper":
        from pdecodec.codec.encode.paper_profile import PaperEncoder

        return PaperEncoder(sequence, settings, progress)
    return AutoEncoder(sequence, settings, progress)
