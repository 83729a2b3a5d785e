"""The encoders of the profiles, by name, and what each makes of the same frames."""

from __future__ import annotations

from pdecodec.codec.container import CONSTANT_SECTIONS
from pdecodec.codec.encode.auto_profile import AutoEncoder
from pdecodec.codec.encode.coded_order import CodedOrderSequence
from pdecodec.codec.encode.group_encoder import Encoder
from pdecodec.codec.encode.paper_profile import PaperEncoder
from pdecodec.codec.encode.report import Alternative, EncodeReport, Question
from pdecodec.codec.settings import EncodeSettings, Profile
from pdecodec.mesh.sequence import ArraySequence, MeshObject, MeshSequence, Progress

PROFILES: dict[Profile, type[Encoder]] = {"auto": AutoEncoder, "paper": PaperEncoder}

COMPARED_FRAMES = 96
"""First frames at most that are encoded under both profiles, to compare the models."""


def make_encoder(sequence: MeshSequence, settings: EncodeSettings, progress: Progress | None) -> Encoder:
    """Return the encoder that `settings` ask for, of a sequence of constant connectivity."""
    if settings.order == "free":
        sequence = CodedOrderSequence(sequence)
    encoder = PROFILES[settings.profile](sequence, settings, progress)
    if settings.why:
        encoder.compare_profiles = compare_profiles
    return encoder


def compare_profiles(sequence: MeshSequence, bound: float | None, chosen: Profile) -> Question:
    """Encode the first frames under both profiles, at the same bound [scene units].

    Without a bound the paper's model stands alone, and the other profile keeps the error that it leaves.
    """
    frames = min(sequence.frame_count, COMPARED_FRAMES)
    objects = [MeshObject(item.name, item.connectivity) for item in sequence.objects]
    first = ArraySequence(
        sequence.read_frames(0, frames), objects=objects, times=sequence.times[:frames], fps=sequence.fps
    )
    paper = _encode(first, EncodeSettings(profile="paper", max_error=bound))
    auto = _encode(first, EncodeSettings(max_error=paper.max_error if bound is None else bound))
    ways = (
        Alternative("auto", _motion_bytes(auto), chosen == "auto"),
        Alternative("paper, in closed form", _motion_bytes(paper), chosen == "paper"),
    )
    return Question("profile", frames, ways)


def _encode(sequence: MeshSequence, settings: EncodeSettings) -> EncodeReport:
    return make_encoder(sequence, settings, None).run(None, overwrite=False)


def _motion_bytes(report: EncodeReport) -> int:
    """Sum all sections but constant ones and remarks."""
    left_out = {*CONSTANT_SECTIONS, "META"}
    return sum(size for name, size in report.sections.items() if name not in left_out)
