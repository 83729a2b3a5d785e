"""Every tuned constant of the encoder, with its unit and effect: one frozen :class:`Tuning` per effort.

`docs/encoder.md` has the measured effect of each; ``python -m pdecodec.research.ablation FOLDER`` measures it again.
Constants that follow from the file format, from float32 or from a definition are not tuned and are defined where
they are used, as are the tables of the paper's profile and the model of an encode's memory.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from pdecodec.codec.sections.space_basis import SpaceKind
from pdecodec.codec.settings import EffortName

SpaceBases = tuple[tuple[SpaceKind, int], ...]
"""Kinds of elements, and their largest number of vertices."""

DeadZone = tuple[float, float]
"""Fractions of a step from which a coefficient is rounded up: usually, and if its neighbours are all zero."""


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """What the encoder of profile "auto" tries, and the constants that it decides by.

    A *unit* is the bound, or the spacing of float32 where that is coarser. *Positions* are vertices times frames.

    Attributes
    ----------
    spatial_bases : tuple of (kind, points)
        Spatial bases that are compared; the first is the usual one.
    small_mesh_spatial_bases : tuple of (kind, points)
        Spatial bases that are compared on small meshes in addition.
    large_patch_gain : float [share of bits]
        Saving that patches larger than usual need on large meshes: decoding takes the square of their functions.
    small_mesh_vertices : int [vertices]
        Largest mesh on which every candidate is fitted in full; on larger ones its cost is estimated.
    reference_step : float [units]
        Usual step of the reference frame.
    smoothed_reference_step : float [units]
        Usual step of the reference frame if smoothing in the decoder brings it much closer to the points.
    finest_reference_step : float [units]
        Finest step of the reference frame.
    usual_step : float [units]
        Step of coefficients that the search begins with.
    coarsest_step : float [units]
        Limit of steps that are chosen without a search.
    step_stride : int [quarter octaves]
        Distance from one step that is tried to the next.
    mean_error, mean_error_of_dense : float [units]
        Root mean square error that a step chosen without a search leaves: `mean_error` plus `mean_error_of_dense` times
        the root of the coefficients per position.
    early_exit_ratio : float
        Cost over the best one's beyond which a candidate or division is dropped.
    untuned_exit_ratio : float
        Cost over the best one's beyond which a temporal basis or origin is dropped before steps are searched.
    restart_gain : float [share of bits]
        Saving of another reference frame from which on all else is searched again.
    is_thorough : bool
        Whether shorter groups are tried, steps are tuned, and that of the reference frame is searched on small meshes,
        too, where each takes a full fit; on small clips it is searched in any case.
    shortest_group, longest_group : int [frames]
        Limit of the length of a group; work grows with the cube of the length.
    group_bytes, smooth_group_bytes : int [bytes]
        Largest size of a group's displacements in float64: usually, and if the motion is smooth.
    smooth_bits : float [bits per position]
        Cost below which motion is smooth: a group is then not divided, and the groups of a clip are longer.
    dense_group : int [frames]
        Length of groups in cosines, if motion is dense (frames have little in common) and nothing is searched.
    dense_share : float
        Share of all possible trajectories from which on motion is dense.
    searched_groups : int [groups]
        Number of groups at the beginning that are searched; later, one in twice as many is.
    searched_positions : float [positions]
        Largest clip that is searched; larger ones are encoded by rule.
    small_clip_positions : int [positions]
        Largest clip that is searched in full: every step of the reference frame, no candidate dropped early.
    sample_vertices : int [vertices]
        Smallest sample of an estimate.
    sample_share : float
        Smallest share of the mesh in the sample of an estimate.
    sample_frames : int [frames]
        Longest group whose residuals are estimated from all frames; of longer ones, half of the frames are taken.
    tail : float [units]
        Root mean square error that functions of time that are left out may add.
    dead_zones : tuple of (float, float)
        Dead zones that are compared; the first is the usual one.
    aim : float [units]
        Refinement adds to what coefficients describe by how much vertices are off by more than this.
    refining_passes : tuple of int
        Numbers of refinement passes, after each of which the better half of the candidates stays.
    refining_gain : float [share of bits]
        Saving below which a pass is the last one.
    refined_steps : tuple of int [quarter octaves]
        Distances to the chosen step of the steps that are fitted in full.
    compared_effort : str or None
        Effort whose model is another candidate.
    heavy_group_bytes : int [bytes]
        Size of a group's positions from which on saving memory is worth time.
    """

    spatial_bases: SpaceBases = (("patch", 64), ("patch", 32), ("patch", 128))
    small_mesh_spatial_bases: SpaceBases = (("patch", 256), ("patch", 8))
    large_patch_gain: float = 0.02
    small_mesh_vertices: int = 2048
    reference_step: float = 0.4
    smoothed_reference_step: float = 0.6
    finest_reference_step: float = 1.0 / 32.0
    usual_step: float = 2.8
    coarsest_step: float = 8.0
    step_stride: int = 2
    mean_error: float = 0.3
    mean_error_of_dense: float = 0.4
    early_exit_ratio: float = 1.02
    untuned_exit_ratio: float = 1.25
    restart_gain: float = 0.1
    is_thorough: bool = True
    shortest_group: int = 8
    longest_group: int = 512
    group_bytes: int = 3 * 2**25
    smooth_group_bytes: int = 3 * 2**26
    smooth_bits: float = 0.65
    dense_group: int = 12
    dense_share: float = 0.7
    searched_groups: int = 3
    searched_positions: float = float("inf")
    small_clip_positions: int = 2**16
    sample_vertices: int = 1024
    sample_share: float = 1 / 8
    sample_frames: int = 128
    tail: float = 0.06
    dead_zones: tuple[DeadZone, ...] = ((0.6, 0.75),)
    aim: float = 0.75
    refining_passes: tuple[int, ...] = (3,)
    refining_gain: float = 0.004
    refined_steps: tuple[int, ...] = (0,)
    compared_effort: EffortName | None = None
    heavy_group_bytes: int = 2**25

    def refined_like(self, other: Tuning) -> Tuning:
        """Return this tuning with the refinement constants of another one."""
        names = ("dead_zones", "refining_passes", "refining_gain", "refined_steps")
        changes: dict[str, Any] = {name: getattr(other, name) for name in names}
        return replace(self, **changes)


TUNINGS: dict[EffortName, Tuning] = {
    "fast": Tuning(
        spatial_bases=(("patch", 64), ("patch", 128)),
        is_thorough=False,
        refining_passes=(),
        searched_positions=2**19,
    ),
    "default": Tuning(),
    "best": Tuning(
        spatial_bases=(("patch", 64), ("patch", 32), ("patch", 128), ("patch", 16), ("curve", 64), ("curve", 128)),
        large_patch_gain=0.0,
        dead_zones=((0.7, 1.0), (0.65, 0.85)),
        refining_passes=(4, 24, 32),
        refining_gain=0.0,
        refined_steps=(-1, 0, 1),
        compared_effort="default",
    ),
}
"""Tuning by the name of the effort in the settings."""
