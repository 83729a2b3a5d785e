"""The container: identifier, header, table of sections, and files that appear whole or not at all."""

from __future__ import annotations

import os
import stat
from pathlib import Path

import pytest

from pdecodec._core import Container
from pdecodec.codec.container import COPY_BYTES, Section, Spool, section_sizes
from pdecodec.codec.container import container_pieces as pieces
from pdecodec.codec.container import write_container as write
from pdecodec.codec.sections.connectivity import core_errors
from pdecodec.errors import CorruptFileError, InputError
from pdecodec.system.whole_output import check_writable
from spec.sealing import Part, seal, table_end, take_apart

PARTS = [Part("ABCD", b"first"), Part("EFGH", b"", flags=0), Part("IJKL", bytes(range(256)) * 2)]
SOUND = seal(PARTS)


MOST_SECTIONS = 64
"""More can only be damage: a run of frames has 9 at most."""


class Declared(Part):
    """A section whose row in the table says another length."""

    @property
    def row(self) -> bytes:
        length = self.content
        return b"ABCD" + bytes([1 | len(length) << 4]) + length + bytes(4)


def reader_of(data: bytes) -> Container:
    with core_errors():
        return Container(data)


def refusal(data: bytes) -> str:
    """What the reader says of these bytes."""
    with pytest.raises(CorruptFileError) as caught:
        reader_of(data)
    return str(caught.value)


def test_a_file_has_the_layout_of_the_specification_and_is_read_back() -> None:
    sections = [Section(part.kind, part.content, required=bool(part.flags)) for part in PARTS]
    assert b"".join(pieces(sections)) == SOUND
    assert take_apart(SOUND) == PARTS
    assert section_sizes(sections) == {"container": table_end(PARTS), "ABCD": 5, "EFGH": 0, "IJKL": 512}
    reader = reader_of(SOUND)
    assert [(name, is_required) for name, is_required, _, _ in reader.sections] == [
        (part.kind, bool(part.flags)) for part in PARTS
    ]
    assert [reader.read(part.kind) for part in PARTS] == [part.content for part in PARTS]
    reader.verify()


def test_spools_are_copied_piece_by_piece_and_give_the_same_file(tmp_path: Path) -> None:
    content = os.urandom(2 * COPY_BYTES + 17)
    spool = Spool(tmp_path)
    for start in range(0, len(content), 100_000):
        spool.append(content[start : start + 100_000])
    assert max(len(piece) for piece in spool.pieces()) <= COPY_BYTES
    write(tmp_path / "a", [Section("DATA", spool)])
    spool.close()
    assert (tmp_path / "a").read_bytes() == seal([Part("DATA", content)])
    reader_of((tmp_path / "a").read_bytes()).verify()


def test_any_minor_version_is_read_and_any_other_major_version_refused() -> None:
    reader_of(seal(PARTS, minor=7)).verify()
    for major in (0, 2, 65535):
        assert f"format version {major}, this decoder reads version 1; update" in refusal(seal(PARTS, major=major))


def test_unknown_sections_are_passed_over_where_their_flag_allows_it() -> None:
    known, ignorable = Part("SEQN", b"x"), Part("EFGH", b"", flags=0)
    reader_of(seal([known, ignorable])).check_known()
    with pytest.raises(CorruptFileError, match="needs section IJKL"), core_errors():
        reader_of(seal([known, ignorable, Part("IJKL", b"")])).check_known()
    # Of the flags this version has one; others mean nothing to it.
    reader = reader_of(seal([Part("ABCD", b"x", flags=14), Part("EFGH", b"", flags=3)]))
    assert [is_required for _, is_required, _, _ in reader.sections] == [False, True]


@pytest.mark.parametrize("data", [b"", b"\x89", SOUND[:11], b"\x89PNG\r\n\x1a\n" + bytes(40), b"solid"])
def test_other_files_are_named_as_such_or_as_too_short(data: bytes) -> None:
    said = refusal(data)
    assert "not a .pdeanim file" in said or "ends inside its header" in said


def test_a_file_that_went_through_a_text_transfer_is_refused() -> None:
    for before, after in ((b"\r\n", b"\n"), (b"\n", b"\r\n")):
        assert "not a .pdeanim file" in refusal(SOUND.replace(before, after))


def test_every_truncation_every_byte_too_many_and_every_flipped_bit_of_the_head_is_refused() -> None:
    for size in range(len(SOUND)):
        refusal(SOUND[:size])
    assert f"is truncated: {len(SOUND) - 1} bytes where the table says {len(SOUND)}" in refusal(SOUND[:-1])
    assert "after its last section" in refusal(SOUND + b"\0")
    for bit in range(8 * table_end(PARTS)):
        damaged = bytearray(SOUND)
        damaged[bit // 8] ^= 1 << bit % 8
        refusal(bytes(damaged))


def test_a_damaged_section_is_refused_when_it_is_read_and_by_verify() -> None:
    reader = reader_of(SOUND[:-1] + b"\0")
    assert reader.read("ABCD") == b"first"
    for read in (lambda: reader.read("IJKL"), reader.verify):
        with pytest.raises(CorruptFileError, match="section IJKL is damaged") as caught, core_errors():
            read()
        assert caught.value.offset == table_end(PARTS) + 5
    with pytest.raises(CorruptFileError, match="has no section WXYZ"), core_errors():
        reader.read("WXYZ")


def test_a_section_that_stands_twice_is_refused() -> None:
    assert "section ABCD stands twice" in refusal(seal([Part("ABCD", b"1"), Part("ABCD", b"2")]))


@pytest.mark.parametrize(
    ("length", "message"),
    [(b"\5", "truncated"), (b"\xff" * 4, "truncated"), (b"\xff" * 8, "truncated"), (bytes(9), "table of sections")],
)
def test_lengths_beyond_the_file_or_of_more_than_eight_bytes_are_refused(length: bytes, message: str) -> None:
    assert message in refusal(seal([Declared("ABCD", length)]))


def test_more_sections_than_can_be_are_refused() -> None:
    most = [Part(f"S{k:03}", b"") for k in range(MOST_SECTIONS)]
    assert len(reader_of(seal(most)).sections) == MOST_SECTIONS
    assert f"declares {MOST_SECTIONS + 1} sections" in refusal(seal([*most, Part("ZZZZ", b"")]))


class _FailingSpool(Spool):
    def pieces(self) -> list[bytes]:  # type: ignore[override]
        raise OSError(28, "No space left on device")


def test_a_failure_while_writing_leaves_nothing_behind_and_the_old_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "out.pdeanim"
    path.write_bytes(b"old")
    spool = _FailingSpool(tmp_path)
    with pytest.raises(InputError, match="No space left"):
        write(path, [Section("ABCD", b"x"), Section("DATA", spool)])
    spool.close()
    assert [item.name for item in tmp_path.iterdir()] == ["out.pdeanim"]
    assert path.read_bytes() == b"old"


def test_an_output_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    write(tmp_path / "a", [])
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_places_that_cannot_become_an_output_are_refused_before_work_starts(tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    for name, message in ((".", "is a folder"), ("there", "exists already"), ("nowhere/a", "folder does not exist")):
        with pytest.raises(InputError, match=message):
            check_writable(tmp_path / name, overwrite=False)
    check_writable(tmp_path / "there", overwrite=True)
    check_writable(tmp_path / "new", overwrite=False)
