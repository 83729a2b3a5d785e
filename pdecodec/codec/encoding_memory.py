"""How much memory an encode takes, and how it takes no more than it may: by shorter groups, and fewer functions."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.sections.space_basis import MAX_FUNCTIONS
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import SettingsError

BASIS_BYTES = 2**29
"""Memory for the functions of all patches, float64: a mesh of millions of vertices gets fewer of them."""

FEWEST_FUNCTIONS = 16
"""Functions of a patch however large the mesh is."""

SEARCHED_COPIES, HEAVY_COPIES, SMOOTH_COPIES = 28, 8, 4
"""Times the displacements of a group, in float64, that are held at most: where what is found of it is kept for the
search; where memory counts more than time, or nothing is searched; and where motion is smooth. Noise takes most: at
bounds of 1e-5, for which float32 is too coarse, 18 to 25 times as much, 5 to 8, and a sheet that swings 2. Cloth, of
which little is left beside few functions, takes a quarter to two thirds of that: nobody knows before it is read."""

SHORT_COPIES, COPIES_A_FRAME = 8, 0.5
"""The same of a short group, which is not divided as often, where one search is done: so many, and more for each frame.
Noise took 10 in 16 frames and 14 in 24; under "best", which searches again with what was found, 22 in 16."""

TABLE_COPIES = 32
"""Times the table of what functions of time have to do with one another, or with vertices where those are fewer: the
sums of squares, what they are decomposed into, the functions themselves, from either origin. Of 1,024 vertices over 512
frames it is more than half of all."""

FIXED_BYTES = 9 * 2**23
"""Of interpreter and libraries: 65 to 75 MiB."""

VERTEX_BYTES = 900
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


def _group_frames(vertices: int, size: int, tuning: Tuning) -> int:
    """Frames of a group at most, of a mesh of so many vertices, whose displacements take so much memory."""
    return min(max(size // (24 * max(1, vertices)), tuning.shortest_group), tuning.longest_group)


def _lengths(frames: int, most: int) -> tuple[int, int]:
    """Frames of the groups that a clip is divided into, of so many at most: they are equal but for one."""
    count = -(-frames // most)
    return frames // count, -(-frames // count)


def _group_bytes(frames: int, vertices: int, tuning: Tuning, *, is_searched: bool) -> int:
    """Memory that a group takes at most, however it moves."""
    displacements, table = 24 * vertices * frames, 24 * frames * min(3 * frames, vertices)
    copies: float = HEAVY_COPIES
    if is_searched and 12 * vertices * frames < tuning.heavy_group_bytes:
        copies = (
            SEARCHED_COPIES if tuning.compared_effort else min(SEARCHED_COPIES, SHORT_COPIES + COPIES_A_FRAME * frames)
        )
    return int(copies * displacements) + TABLE_COPIES * table


class _Need:
    """What a clip takes, by the frames of its groups."""

    def __init__(self, vertices: int, frames: int, settings: EncodeSettings) -> None:
        self._vertices, self._frames = max(1, vertices), max(1, frames)
        self._tuning = tuning = TUNINGS[settings.effort]
        self._is_searched = self._frames * self._vertices <= tuning.searched_positions
        self.functions = _functions(BASIS_BYTES, self._vertices)
        self.longest, self.smooth = (
            min(_group_frames(self._vertices, size, tuning), settings.group_frames or tuning.longest_group)
            for size in (tuning.group_bytes, tuning.smooth_group_bytes)
        )

    def of_mesh(self, functions: int) -> int:
        """However few frames there are."""
        return FIXED_BYTES + (VERTEX_BYTES + 8 * functions) * self._vertices

    def of_groups(self, most: int) -> int:
        """Of groups of so many frames at most."""
        lengths = _lengths(self._frames, most)
        return max(
            _group_bytes(length, self._vertices, self._tuning, is_searched=self._is_searched) for length in lengths
        )

    def of_smooth_groups(self, most: int) -> int:
        """The same, of smooth motion."""
        return SMOOTH_COPIES * 24 * self._vertices * _lengths(self._frames, most)[1]

    @property
    def usual(self) -> int:
        """Of all of it, where nobody sets a limit."""
        return self.of_mesh(self.functions) + max(self.of_groups(self.longest), self.of_smooth_groups(self.smooth))


def memory_plan(vertices: int, frames: int, settings: EncodeSettings) -> MemoryPlan:
    """How a clip is encoded within the memory that settings allow.

    Raises
    ------
    SettingsError
        If a group of one frame takes more.
    """
    need, limit = _Need(vertices, frames, settings), settings.max_memory
    if limit is None or need.usual <= limit:
        return MemoryPlan(need.longest, need.smooth, need.functions)
    functions = min(need.functions, _functions((limit - need.of_mesh(0)) // BASIS_SHARE, max(1, vertices)))
    left = limit - need.of_mesh(functions)
    group, smooth = (
        next((most for most in range(longest, 0, -1) if taken(most) <= left), 0)
        for longest, taken in ((need.longest, need.of_groups), (need.smooth, need.of_smooth_groups))
    )
    if not group:
        least = need.of_mesh(FEWEST_FUNCTIONS) + need.of_groups(1)
        raise SettingsError(f"must be {least} bytes or more for {vertices} vertices, not {limit}", setting="max_memory")
    return MemoryPlan(group, smooth, functions)


def _functions(size: int, vertices: int) -> int:
    return min(MAX_FUNCTIONS, max(FEWEST_FUNCTIONS, size // (8 * vertices)))


def encoding_bytes(frames: int, vertices: int, settings: EncodeSettings) -> int:
    """Memory that encoding a clip takes at most, about [bytes]: however long the clip is, that of its longest group.

    Parameters
    ----------
    frames, vertices : int
    settings : EncodeSettings
    """
    usual = _Need(vertices, frames, settings).usual
    return usual if settings.max_memory is None else min(usual, settings.max_memory)
