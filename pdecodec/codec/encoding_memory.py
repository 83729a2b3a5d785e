"""Estimate the memory of an encode, and keep it within a limit by shorter groups and fewer functions of space."""

from __future__ import annotations

from dataclasses import dataclass

from pdecodec.codec.encode.tuning import TUNINGS, Tuning
from pdecodec.codec.sections.space_basis import MAX_FUNCTIONS
from pdecodec.codec.settings import EncodeSettings
from pdecodec.errors import SettingsError

BASIS_BYTES = 2**29
"""Memory for the functions of all patches, float64 [bytes]; meshes of millions of vertices get fewer functions."""

FEWEST_FUNCTIONS = 16
"""Smallest number of functions of a patch, used for the largest meshes."""

SEARCHED_COPIES, HEAVY_COPIES, SMOOTH_COPIES = 28, 8, 4
"""Largest memory of a group, as a multiple of its displacements in float64: if the search keeps intermediate
results; if memory matters more than time, or there is no search; and if motion is smooth. Noise takes the most:
at bounds of 1e-5, for which float32 is too coarse, it took 18 to 25 times in the first case and 5 to 8 times in
the second; a swinging sheet took 2 times in the third. Cloth, which needs many functions, takes a quarter to
two thirds of that, but this is not known before it is read.
"""

SHORT_COPIES, COPIES_A_FRAME = 8, 0.5
"""The multiple for a short group, which is divided less often, if there is only one search: a constant, plus an
amount per frame. Noise took 10 with 16 frames and 14 with 24; with effort "best", which repeats the search, 22
with 16.
"""

TABLE_COPIES = 32
"""Memory of tables, as a multiple of the products of functions of time with one another, or with vertices if
there are fewer vertices. Tables are the sums of squares, their decomposition and the functions, for both
origins. With 1,024 vertices and 512 frames they are more than half of the total.
"""

FIXED_BYTES = 9 * 2**23
"""Memory of the interpreter and the libraries [bytes]; measured: 65 to 75 MiB."""

VERTEX_BYTES = 900
"""Memory per vertex that does not depend on the number of frames: faces, reference frame and patches [bytes]."""

BASIS_SHARE = 4
"""The functions of patches may take at most 1 / BASIS_SHARE of a memory limit, because groups can shrink to one
frame but functions cannot shrink.
"""


@dataclass(frozen=True)
class MemoryPlan:
    """Sizes that keep an encode within its memory.

    Attributes
    ----------
    group_frames, smooth_group_frames : int
        Largest number of frames of a group, and of a group of smooth motion.
    functions : int
        Largest number of functions of a patch.
    """

    group_frames: int
    smooth_group_frames: int
    functions: int


def _group_frames(vertices: int, size: int, tuning: Tuning) -> int:
    """Return the largest number of frames of a group whose displacements take `size` bytes."""
    return min(max(size // (24 * max(1, vertices)), tuning.shortest_group), tuning.longest_group)


def _lengths(frames: int, most: int) -> tuple[int, int]:
    """Return the smallest and the largest number of frames of the groups that a clip is divided into."""
    count = -(-frames // most)
    return frames // count, -(-frames // count)


def _group_bytes(frames: int, vertices: int, tuning: Tuning, *, is_searched: bool) -> int:
    """Return the largest memory of a group, whatever its motion [bytes]."""
    displacements, table = 24 * vertices * frames, 24 * frames * min(3 * frames, vertices)
    copies: float = HEAVY_COPIES
    if is_searched and 12 * vertices * frames < tuning.heavy_group_bytes:
        copies = (
            SEARCHED_COPIES if tuning.compared_effort else min(SEARCHED_COPIES, SHORT_COPIES + COPIES_A_FRAME * frames)
        )
    return int(copies * displacements) + TABLE_COPIES * table


class _Need:
    """The memory that a clip takes, as a function of the length of its groups."""

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
        """Return the memory that does not depend on the number of frames [bytes]."""
        return FIXED_BYTES + (VERTEX_BYTES + 8 * functions) * self._vertices

    def of_groups(self, most: int) -> int:
        """Return the memory of groups of at most `most` frames [bytes]."""
        lengths = _lengths(self._frames, most)
        return max(
            _group_bytes(length, self._vertices, self._tuning, is_searched=self._is_searched) for length in lengths
        )

    def of_smooth_groups(self, most: int) -> int:
        """Return the memory of groups of smooth motion of at most `most` frames [bytes]."""
        return SMOOTH_COPIES * 24 * self._vertices * _lengths(self._frames, most)[1]

    @property
    def usual(self) -> int:
        """Memory that encoding the clip takes without a limit [bytes]."""
        return self.of_mesh(self.functions) + max(self.of_groups(self.longest), self.of_smooth_groups(self.smooth))


def memory_plan(vertices: int, frames: int, settings: EncodeSettings) -> MemoryPlan:
    """Choose the sizes with which a clip is encoded within the memory that the settings allow.

    Raises
    ------
    SettingsError
        If even a group of one frame takes more.
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
    """Return the approximate peak memory of an encode [bytes]; it depends on the longest group, not on the
    length of the clip.

    Parameters
    ----------
    frames, vertices : int
    settings : EncodeSettings
    """
    usual = _Need(vertices, frames, settings).usual
    return usual if settings.max_memory is None else min(usual, settings.max_memory)
