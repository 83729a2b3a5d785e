"""Other ways to store a mesh sequence. Each is measured on positions that it decoded from its own bytes.

Most are baselines of the field, written after their papers without the tuning of a product; some call the package
that a pipeline would use. The output of a baseline lives from its encoder to its decoder in one process. It is not a
file format, and its decoders trust their input.

Our versions may take fewer bytes than other implementations of the same papers, by 5 to 20 % on meshes of some
thousand vertices: range coder models adapt from one mode to the next where others send tables, every column takes
the predictor that suits it, and the step that just keeps the bound is searched to 2 %. Versions with corrections
take 20 to 80 % fewer bytes than with a step chosen beforehand: the transform's step is searched, and only vertices
beyond the bound are corrected.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from pdecodec.report.clips.baseline import Baseline


def all_baselines() -> tuple[Baseline, ...]:
    """Return every baseline, its package installed or not, in the order of the tables."""
    from pdecodec.research.baselines.bspline import BSpline
    from pdecodec.research.baselines.packages import Draco, Meshopt, Pcodec, Sperr, Sz3, Zfp
    from pdecodec.research.baselines.quantised import Lorenzo, QuantiseDelta, RawFloat16, RawFloat32
    from pdecodec.research.baselines.skinned import SkinningCosines, SkinningDecomposition
    from pdecodec.research.baselines.transforms import Coddyac, Corrected, CosineInTime, FittedCoddyac, PrincipalShapes

    return (
        *(RawFloat32(), RawFloat16(), QuantiseDelta(), Pcodec(), Meshopt(), Draco(), Zfp(), Sz3(), Sperr()),
        *(BSpline(), Lorenzo()),
        *(CosineInTime(), Corrected(CosineInTime())),
        *(PrincipalShapes(), Corrected(PrincipalShapes())),
        *(Coddyac(), Corrected(Coddyac())),
        *(FittedCoddyac(), Corrected(FittedCoddyac())),
        *(SkinningDecomposition(), SkinningCosines(), Corrected(SkinningCosines())),
    )


def face_baselines() -> tuple[Baseline, ...]:
    """Return available baselines that also code faces, for clips whose connectivity changes."""
    from pdecodec.research.baselines.packages import DracoWithFaces

    return tuple(baseline for baseline in (DracoWithFaces(),) if baseline.missing() is None)


def available_baselines() -> tuple[tuple[Baseline, ...], tuple[str, ...]]:
    """Return the baselines that can run here, and the reasons why the others cannot."""
    reasons = [(baseline, baseline.missing()) for baseline in all_baselines()]
    return (
        tuple(baseline for baseline, reason in reasons if reason is None),
        tuple(reason for _, reason in reasons if reason is not None),
    )
