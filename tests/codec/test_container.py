"""The container: identifier, header and table of sections, read through :func:`pdecodec.open`."""

from __future__ import annotations

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, CorruptFileError
from spec.sealing import Part, seal, take_apart

CLIP = ArraySequence(np.random.default_rng(3).normal(size=(4, 12, 3)).astype(np.float32))
SOUND = pdecodec.encode(CLIP, effort="fast").data or b""
PARTS = take_apart(SOUND)

MAX_SECTIONS = 64
"""Largest number of sections: a larger one means damage."""


class Declared(Part):
    """A section whose row in the table declares another length."""

    @property
    def row(self) -> bytes:
        length = self.content
        return b"ABCD" + bytes([1 | len(length) << 4]) + length + bytes(4)


def frames_of(data: bytes) -> np.ndarray:
    with pdecodec.open(data) as animation:
        animation.verify()
        return animation.read_frames(0, 4)


def refusal(data: bytes) -> str:
    """Return the message with which a file is refused."""
    with pytest.raises(CorruptFileError) as caught:
        frames_of(data)
    return str(caught.value)


def test_a_file_has_the_layout_of_the_specification() -> None:
    assert seal(PARTS) == SOUND
    with pdecodec.open(SOUND) as animation:
        sizes = animation.sections
    assert sum(sizes.values()) == len(SOUND)
    assert {part.kind: len(part.content) for part in PARTS} == {
        name: size for name, size in sizes.items() if name != "container"
    }
    assert [part.kind for part in PARTS if not part.flags] == ["META"]


def test_any_minor_version_is_read_and_any_other_major_version_refused() -> None:
    assert np.array_equal(frames_of(seal(PARTS, minor=7)), frames_of(SOUND))
    for major in (0, 2, 65535):
        assert f"format version {major}, this decoder reads version 1; update" in refusal(seal(PARTS, major=major))


def test_unknown_sections_are_passed_over_where_their_flag_allows_it() -> None:
    # This version defines one flag, and ignores the others.
    for flags in (0, 14):
        assert np.array_equal(frames_of(seal([*PARTS, Part("EFGH", b"x", flags=flags)])), frames_of(SOUND))
    for flags in (1, 3):
        assert "section IJKL is required, but this version does not know it" in refusal(
            seal([*PARTS, Part("IJKL", b"", flags=flags)])
        )


@pytest.mark.parametrize("data", [b"", b"\x89", SOUND[:11], b"\x89PNG\r\n\x1a\n" + bytes(40), b"solid"])
def test_other_files_are_named_as_such_or_as_too_short(data: bytes) -> None:
    said = refusal(data)
    assert "not a .pdeanim file" in said or "ends inside its header" in said


def test_a_file_that_went_through_a_text_transfer_is_refused() -> None:
    for before, after in ((b"\r\n", b"\n"), (b"\n", b"\r\n")):
        assert "not a .pdeanim file" in refusal(SOUND.replace(before, after))


def test_a_damaged_section_is_named_with_its_place() -> None:
    place = len(SOUND) - sum(len(part.content) for part in PARTS[2:])
    with pytest.raises(CorruptFileError, match=f"section {PARTS[2].kind} is damaged") as caught:
        frames_of(SOUND[:place] + bytes([SOUND[place] ^ 1]) + SOUND[place + 1 :])
    assert caught.value.offset == place


@pytest.mark.parametrize(
    ("length", "message"),
    [(b"\xff" * 4, "truncated"), (b"\xff" * 8, "truncated"), (bytes(9), "table of sections")],
)
def test_lengths_beyond_the_file_or_of_more_than_eight_bytes_are_refused(length: bytes, message: str) -> None:
    assert message in refusal(seal([*PARTS, Declared("ABCD", length)]))


def test_repeated_sections_and_too_many_are_refused() -> None:
    assert f"section {PARTS[2].kind} appears twice" in refusal(seal([*PARTS, PARTS[2]]))
    most = [*PARTS, *(Part(f"S{k:03}", b"", flags=0) for k in range(MAX_SECTIONS - len(PARTS)))]
    assert np.array_equal(frames_of(seal(most)), frames_of(SOUND))
    assert f"declares {MAX_SECTIONS + 1} sections" in refusal(seal([*most, Part("ZZZZ", b"", flags=0)]))
