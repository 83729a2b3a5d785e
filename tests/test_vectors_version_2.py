"""The vectors of version 2 have in them what they are named for, and the means to make them work."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdecodec import open_animation
from pdecodec.groups import GROUP_ENTRY, GroupEntry, read_group_table
from spec.decoder.corrections import CorrectionReader
from spec.decoder.rangecoder import EVEN, RangeDecoder
from spec.sealing import CHUNKS, GROUP, Part, content, counted, even_bits, group_chunks, take_apart

FOLDER = Path(__file__).resolve().parent.parent / "spec" / "vectors" / "accept"


class Vector(NamedTuple):
    """What a vector is made of."""

    parts: list[Part]
    groups: tuple[GroupEntry, ...]
    patches: int

    def chunk(self, kind: str) -> bytes:
        """Of the first group."""
        return group_chunks(self.parts, kind)[0]

    def kinds(self) -> set[tuple[str, bool]]:
        return {(entry.basis, entry.single) for entry in self.groups if entry.functions}

    def byte(self, kind: str, at: int) -> int:
        return content(self.parts, kind)[at]

    def moves(self) -> bool:
        return any(entry.functions for entry in self.groups)

    def is_predicted(self) -> bool:
        data = self.chunk("CORR")
        vertices = 24
        reader = CorrectionReader(RangeDecoder(data), [0, vertices])
        reader.read(self.groups[0].frames, len(data))
        return reader.is_predicted


def vector(name: str) -> Vector:
    data = (FOLDER / f"v2_{name}.pdeanim").read_bytes()
    parts = take_apart(data)
    with open_animation(data) as animation:
        return Vector(parts, read_group_table(content(parts, "GRUP")).entries, animation.info()["patches"])


CLAIMS: dict[str, Callable[[Vector], bool]] = {
    "modes_followed": lambda v: v.chunk("TIME")[0] == 0 and v.kinds() == {("modal", True)},
    "modes_transformed": lambda v: v.chunk("TIME")[0] == 1 and v.kinds() == {("modal", True)},
    "shapes_followed": lambda v: v.chunk("TIME")[0] == 0 and v.kinds() == {("shapes", True)},
    "shapes_transformed": lambda v: v.chunk("TIME")[0] == 1 and v.kinds() == {("shapes", True)},
    "shapes_in_double": lambda v: v.kinds() == {("shapes", False)},
    "groups_of_shapes": lambda v: len(v.groups) == 3 and v.kinds() == {("shapes", True)},
    "times_at_another_rate": lambda v: v.byte("SEQN", 9) in (0, 1),
    "cosines": lambda v: v.kinds() == {("pde", True)},
    "groups": lambda v: len(v.groups) == 3 and len({entry.frames for entry in v.groups}) == 2,
    "groups_of_cosines": lambda v: len(v.groups) == 3 and v.kinds() == {("pde", True)},
    "groups_of_one_frame": lambda v: {entry.frames for entry in v.groups} == {1},
    "groups_in_double": lambda v: ("modal", False) in v.kinds(),
    "cosines_in_double": lambda v: v.kinds() == {("pde", False)},
    "many_patches": lambda v: v.patches >= 8 and v.byte("MODL", 0) == 0,
    "many_pieces": lambda v: v.patches >= 8 and v.byte("MODL", 0) == 1,
    "welded": lambda v: v.byte("REST", 32) == 4,
    "polygons_attributes": lambda v: v.byte("REST", 32) == 3 and v.parts[-1].kind == "ATTR",
    "rest_along_curves": lambda v: v.byte("REST", 32) in (1, 2),
    "one_frame": lambda v: v.groups[0].frames == 1 and not v.moves(),
    "static": lambda v: not v.moves() and v.chunk("CORR") == b"",
    "rigid": lambda v: v.groups[0].functions <= 4 and v.chunk("CORR") == b"",
    "corrections": lambda v: len(v.chunk("CORR")) > 50,
    "explosion": lambda v: len(v.chunk("CORR")) > 12 * 15,
    "irregular_times": lambda v: v.byte("SEQN", 9) == 2,
    "times_by_period": lambda v: v.byte("SEQN", 9) == 4 + 3,
    "long_clip": lambda v: sum(entry.frames for entry in v.groups) > 2 * 46 and len(v.groups) > 2,
    "corrections_predicted": lambda v: v.is_predicted(),
    "corrections_from_end_to_end": lambda v: not v.is_predicted(),
    "modes_of_length_zero": lambda v: v.chunk("TIME") == b"" and v.groups[0].functions > 0,
    "sections_in_another_order": lambda v: [part.kind for part in v.parts[:3]] == list(CHUNKS[::-1]),
    "unknown_ignorable_sections": lambda v: {"XYZW", "\xff\x00ab"} < {part.kind for part in v.parts},
    "without_remarks": lambda v: "META" not in {part.kind for part in v.parts},
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_vector_has_what_it_is_named_for(name: str) -> None:
    assert CLAIMS[name](vector(name))


def test_vectors_of_version_2_stay_small() -> None:
    """The independent decoder is plain Python."""
    assert max(path.stat().st_size for path in FOLDER.parent.rglob("v2_*.pdeanim")) < 4_000


def test_rows_of_groups_are_taken_apart_as_the_library_does() -> None:
    assert GROUP.format == GROUP_ENTRY.format


@given(st.text("01", max_size=200))
def test_even_bits_come_back_from_a_stream_that_ends_with_them(bits: str) -> None:
    coder = RangeDecoder(even_bits(bits))
    assert "".join(str(coder.bit([EVEN], 0)) for _ in bits) == bits
    assert coder.is_finished()


def test_numbers_are_counted_in_digits_first() -> None:
    assert [counted(number) for number in (1, 2, 3, 6)] == ["0", "100", "101", "11010"]
