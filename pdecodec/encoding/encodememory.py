"""How much memory an encode takes, and how it takes no more than it may: by shorter groups, and fewer functions."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.coding.spacebasis import MOST_FUNCTIONS
from pdecodec.errors import SettingsError

GROUP_BYTES = 3 * 2**25
"""Memory for the displacements of a group, float64: up to 40 frames of 100,000 vertices."""

SMOOTH_GROUP_BYTES = 3 * 2**26
"""The same where the motion is smooth."""

BASIS_BYTES = 2**29
"""Memory for the functions of all patches, float64: a mesh of millions of vertices gets fewer of them."""

FEWEST_FUNCTIONS = 16
"""Functions of a patch however large the mesh is."""

LONGEST_GROUP = 512
"""Frames of a group at most: principal trajectories take the cube of their number."""

SHORTEST_GROUP = 8
"""Frames of a group however large the mesh is, where nobody sets a limit."""

GROUP_COPIES, SMOOTH_GROUP_COPIES = 13, 4
"""Times the displacements of a group, in float64, that the search of a model holds at most: measured on noise, 13
on 3,000 vertices and 9 on 20,000, where cloth takes 4; and on a swinging rope 3.4."""

FIXED_BYTES = 2**27
"""Of interpreter and libraries."""

VERTEX_BYTES = 600
"""Of a vertex: its faces, reference frame and patches, however few frames there are."""

BASIS_SHARE = 4
"""What of a limit the functions of patches may take, as its part: groups shrink to any length, functions to few."""


@dataclass(frozen=True)
class MemoryPlan:
    """What an encode keeps within.

    Attributes
    ----------
    group_frames, smooth_group_frames : int
        Frames of a group at most, and of a group of smooth motion.
    functions : int
        Functions of a patch at most.
    """

    group_frames: int
    smooth_group_frames: int
    functions: int


def _group_frames(vertices: int, size: int) -> int:
    """Frames of a group at most, of a mesh of so many vertices, whose displacements take so much memory."""
    return min(max(size // (24 * max(1, vertices)), SHORTEST_GROUP), LONGEST_GROUP)


def memory_plan(vertices: int, frames: int, max_memory: int | None) -> MemoryPlan:
    """How a clip is encoded within so many bytes.

    Raises
    ------
    SettingsError
        If a group of one frame takes more.
    """
    vertices = max(1, vertices)
    longest, smooth = (_group_frames(vertices, size) for size in (GROUP_BYTES, SMOOTH_GROUP_BYTES))
    functions = _functions(BASIS_BYTES, vertices)
    if max_memory is None or encoding_bytes(frames, vertices) <= max_memory:
        return MemoryPlan(longest, smooth, functions)
    left = max_memory - FIXED_BYTES - VERTEX_BYTES * vertices
    functions = min(functions, _functions(left // BASIS_SHARE, vertices))
    left -= 8 * functions * vertices
    shortened, smooth_shortened = (left // (copies * 24 * vertices) for copies in (GROUP_COPIES, SMOOTH_GROUP_COPIES))
    if shortened < 1:
        least = FIXED_BYTES + (VERTEX_BYTES + 8 * FEWEST_FUNCTIONS + GROUP_COPIES * 24) * vertices
        raise SettingsError(f"max_memory must be {least} bytes or more for {vertices} vertices, not {max_memory}")
    return MemoryPlan(min(longest, shortened), min(smooth, smooth_shortened), functions)


def _functions(size: int, vertices: int) -> int:
    return min(MOST_FUNCTIONS, max(FEWEST_FUNCTIONS, size // (8 * vertices)))


def encoding_bytes(frames: int, vertices: int) -> int:
    """Memory that encoding a clip takes at most, about [bytes]: however long the clip is, that of its longest group.

    Parameters
    ----------
    frames, vertices : int
    """
    of_a_group = max(
        copies * 24 * vertices * min(frames, _group_frames(vertices, size))
        for copies, size in ((GROUP_COPIES, GROUP_BYTES), (SMOOTH_GROUP_COPIES, SMOOTH_GROUP_BYTES))
    )
    basis = min(BASIS_BYTES, 8 * MOST_FUNCTIONS * vertices)
    return FIXED_BYTES + of_a_group + basis + VERTEX_BYTES * vertices
