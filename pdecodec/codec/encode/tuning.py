"""Every tuned constant of the encoder, with its unit and what it does: one frozen :class:`Tuning`, one for each effort.

`docs/encoder.md` has the measured effect of each; ``python -m pdecodec.research.ablation FOLDER`` measures it again.
Constants that follow from the file format, from float32 or from a definition are not tuned and stand where they are
used; so do the tables of the paper's profile and the model of how much memory an encode takes.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

from pdecodec.codec.sections.space_basis import SpaceKind
from pdecodec.codec.settings import EffortName

SpaceBases = tuple[tuple[SpaceKind, int], ...]
"""Kinds of elements and their points."""

DeadZone = tuple[float, float]
"""How far (in steps) beyond a whole number a coefficient is rounded up, and one whose neighbours are all zero."""


@dataclass(frozen=True, kw_only=True)
class Tuning:
    """What the encoder of profile "auto" tries, and the constants that it decides by.

    A *unit* is the bound, or the spacing of float32 where that is coarser. *Positions* are vertices times frames.

    Attributes
    ----------
    spatial_bases : tuple of (kind, points)
        Spatial bases that are compared; the first is usual.
    small_mesh_spatial_bases : tuple of (kind, points)
        More of them on small meshes.
    large_patch_gain : float [share of bits]
        What patches larger than usual must save on large meshes: their functions take a decoder the square of their
        number.
    small_mesh_vertices : int [vertices]
        Meshes up to this size are fitted in full for every candidate; larger ones are estimated from a sample.
    reference_step : float [units]
        Usual step of the reference frame.
    smoothed_reference_step : float [units]
        The same where smoothing in the decoder brings the reference frame much nearer to the points.
    finest_reference_step : float [units]
    restart_gain : float [share of bits]
        All else is searched again where another reference frame saves more.
    searches_small_references : bool
        Whether this step is searched on small meshes, too, where each takes a full fit.
    usual_step : float [units]
        Step of coefficients that the search begins with.
    finest_step, coarsest_step : float [units]
        Steps that are chosen without a search lie between these.
    step_stride : int [quarter octaves]
        From one step that is tried to the next, and the range of the steps of functions of time about these.
    mean_error, mean_error_of_dense : float [units]
        Root mean square error that a step chosen without a search leaves, and how much more times the root of the
        coefficients for each position.
    early_exit_ratio : float
        A candidate that costs more than this many times the best one is not looked at further.
    untuned_exit_ratio : float
        The same of candidates and divisions whose steps are the usual ones.
    bits_worth_dividing : float [bits a position]
        Groups that take less are not divided.
    divides_groups : bool
        Whether shorter groups are tried, and steps are searched closely.
    shortest_group, longest_group : int [frames]
        Groups are not divided below; the cube of the length bounds the work above.
    group_bytes, smooth_group_bytes : int [bytes]
        Displacements of a group in float64, and of a group of smooth motion.
    smooth_bits : float [bits a position]
        Motion is smooth where the first frames take less.
    dense_group : int [frames]
        Length of groups in cosines, where frames have little in common and nothing is searched.
    dense_share : float
        Share of all trajectories that there can be from which on motion is dense.
    searched_groups : int [groups]
        Groups at the beginning, then one in twice as many, that are searched; others are taken as the one before.
    residual_share : float [bytes of residuals a byte of coefficients]
        Where a step costs least: the next group's is finer or coarser by as many indices as this is off by octaves.
    searched_positions : float [positions]
        Clips beyond are encoded by rule, without a search.
    small_clip_positions : int [positions]
        Clips up to this size are encoded within `tighter_bounds`, too.
    tighter_bounds : tuple of float
        How many times tighter bounds are, whose models are candidates: a looser bound then takes no more bytes.
    sample_vertices : int [vertices]
    sample_share : float
        What estimates look at: so many vertices, but this share of the mesh at least.
    sample_frames : int [frames]
        Of longer groups, residuals of half of the frames are looked at.
    sample_part : int [vertices]
        Where spatial bases are compared, nodes of the partition tree of at most this size are taken whole.
    tail : float [units]
        What functions of time that are left out may add to the error, as root mean square.
    most_time_functions : int
        Of a group: decoding costs their number.
    pose_share : float
        Share of the frames that may be poses.
    span_block, span_blocks : int
        Signed sums of vertices that find few trajectories of many, in a block, and blocks of them.
    dead_zones : tuple of (float, float)
        Roundings that are compared; the first is usual.
    aim, aim_from : float [units]
        Vertices that are off by `aim_from` are brought to `aim`.
    push : float
        How many times what a vertex is off too much is added to what coefficients describe.
    refined_residual_share : float [residuals a position]
        Coefficients are not refined where there are more residuals.
    refining_passes : tuple of int
        Passes of refinement after each of which the better part of the candidates stays; none, one, or several.
    refining_gain : float [share of bits]
        A pass that saves less is the last one.
    refined_steps : tuple of int [quarter octaves]
        Steps about the chosen one that are fitted in full.
    compared_effort : str or None
        An effort whose model is another candidate.
    heavy_group_bytes : int [bytes]
        Positions of a group from which on memory counts more than time.
    """

    spatial_bases: SpaceBases = (("patch", 64), ("patch", 32), ("patch", 128))
    small_mesh_spatial_bases: SpaceBases = (("patch", 256), ("patch", 8))
    large_patch_gain: float = 0.02
    small_mesh_vertices: int = 2048
    reference_step: float = 0.4
    smoothed_reference_step: float = 0.6
    finest_reference_step: float = 1.0 / 32.0
    restart_gain: float = 0.1
    searches_small_references: bool = True
    usual_step: float = 2.8
    finest_step: float = 0.7
    coarsest_step: float = 8.0
    step_stride: int = 2
    mean_error: float = 0.3
    mean_error_of_dense: float = 0.4
    early_exit_ratio: float = 1.02
    untuned_exit_ratio: float = 1.1
    bits_worth_dividing: float = 0.65
    divides_groups: bool = True
    shortest_group: int = 8
    longest_group: int = 512
    group_bytes: int = 3 * 2**25
    smooth_group_bytes: int = 3 * 2**26
    smooth_bits: float = 0.5
    dense_group: int = 12
    dense_share: float = 0.7
    searched_groups: int = 3
    residual_share: float = 0.35
    searched_positions: float = float("inf")
    small_clip_positions: int = 2**16
    tighter_bounds: tuple[float, ...] = (1.1, 1.21)
    sample_vertices: int = 1024
    sample_share: float = 1 / 8
    sample_part: int = 128
    sample_frames: int = 128
    tail: float = 0.06
    most_time_functions: int = 768
    pose_share: float = 0.25
    span_block: int = 64
    span_blocks: int = 8
    dead_zones: tuple[DeadZone, ...] = ((0.6, 0.75),)
    aim: float = 0.8
    aim_from: float = 0.85
    push: float = 1.5
    refined_residual_share: float = 0.03
    refining_passes: tuple[int, ...] = (3,)
    refining_gain: float = 0.004
    refined_steps: tuple[int, ...] = (0,)
    compared_effort: EffortName | None = None
    heavy_group_bytes: int = 2**25

    def refined_like(self, other: Tuning) -> Tuning:
        """Return the same search, its coefficients refined as another tuning does it."""
        names = ("dead_zones", "refining_passes", "refining_gain", "refined_steps")
        changes: dict[str, Any] = {name: getattr(other, name) for name in names}
        return replace(self, **changes)


TUNINGS: dict[EffortName, Tuning] = {
    "fast": Tuning(
        spatial_bases=(("patch", 64), ("patch", 128)),
        searches_small_references=False,
        divides_groups=False,
        refining_passes=(),
        tighter_bounds=(),
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
"""By the name of the effort that settings have."""
