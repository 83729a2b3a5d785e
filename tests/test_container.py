"""The container: identifier, header, table of sections, and files that appear whole or not at all."""

from __future__ import annotations

import os
import stat
import struct
import zlib
from pathlib import Path

import pytest

from pdecodec.container import (
    COPY_BYTES,
    MAX_SECTIONS,
    ContainerReader,
    Section,
    Spool,
    write_container,
)
from pdecodec.errors import CorruptFileError, InputError, LimitError, SettingsError
from pdecodec.whole_output import check_writable
from spec.sealing import ENTRY_1, HEADER, Part, seal, take_apart

SECTIONS = [Section("ABCD", b"first"), Section("EFGH", b"", required=False), Section("IJKL", bytes(range(256)))]


def written(path: Path, sections: list[Section] | None = None) -> bytes:
    write_container(path, SECTIONS if sections is None else sections)
    return path.read_bytes()


def reader_of(path: Path, data: bytes) -> ContainerReader:
    path.write_bytes(data)
    return ContainerReader(path.open("rb"), str(path))


def refusal(path: Path, data: bytes) -> str:
    """What the reader says of these bytes."""
    path.write_bytes(data)
    with path.open("rb") as file, pytest.raises(CorruptFileError) as caught:
        ContainerReader(file, str(path))
    assert caught.value.path == str(path)
    return str(caught.value)


def resealed(data: bytearray) -> bytes:
    """The checksums of header and table made right."""
    count = HEADER.unpack_from(data)[3]
    table = bytes(data[HEADER.size : HEADER.size + count * ENTRY_1.size])
    data[20:24] = struct.pack("<I", zlib.crc32(table))
    data[24:28] = struct.pack("<I", zlib.crc32(bytes(data[:24])))
    return bytes(data)


def test_what_is_written_is_read_back_and_sums_to_the_file(tmp_path: Path) -> None:
    sizes = write_container(tmp_path / "a", SECTIONS)
    assert sizes == {"container": HEADER.size + 3 * ENTRY_1.size, "ABCD": 5, "EFGH": 0, "IJKL": 256}
    assert sum(sizes.values()) == (tmp_path / "a").stat().st_size
    with (tmp_path / "a").open("rb") as file:
        reader = ContainerReader(file, "a")
        assert [(entry.type, entry.required) for entry in reader.entries.values()] == [
            ("ABCD", True),
            ("EFGH", False),
            ("IJKL", True),
        ]
        assert [reader.read(kind) for kind in reader.entries] == [b"first", b"", bytes(range(256))]
        reader.verify()


def test_the_layout_is_the_specifications(tmp_path: Path) -> None:
    data = written(tmp_path / "a")
    parts = [Part("ABCD", b"first"), Part("EFGH", b"", flags=0), Part("IJKL", bytes(range(256)))]
    assert data == seal(parts)
    assert take_apart(data) == parts


def test_spools_are_copied_piece_by_piece_and_give_the_same_file(tmp_path: Path) -> None:
    content = os.urandom(2 * COPY_BYTES + 17)
    spool = Spool(tmp_path)
    for start in range(0, len(content), 100_000):
        spool.append(content[start : start + 100_000])
    assert spool.length == len(content)
    assert max(len(piece) for piece in spool.pieces()) <= COPY_BYTES
    assert written(tmp_path / "a", [Section("DATA", spool)]) == written(tmp_path / "b", [Section("DATA", content)])
    spool.close()


def test_any_minor_version_is_read_and_any_other_major_version_refused(tmp_path: Path) -> None:
    parts = take_apart(written(tmp_path / "a"))
    with (tmp_path / "b").open("wb+") as file:
        file.write(seal(parts, minor=7))
        assert ContainerReader(file, "b").minor_version == 7
    for major in (0, 3, 65535):
        assert f"format version {major}" in refusal(tmp_path / "c", seal(parts, major=major))


def test_unknown_ignorable_sections_are_passed_over_and_required_ones_refused(tmp_path: Path) -> None:
    parts = take_apart(written(tmp_path / "a"))
    reader = reader_of(tmp_path / "b", seal(parts))
    with reader._file:
        reader.check_known(frozenset({"ABCD", "IJKL"}))
        with pytest.raises(CorruptFileError, match="needs section IJKL"):
            reader.check_known(frozenset({"ABCD"}))


def test_flags_that_are_unknown_are_ignored(tmp_path: Path) -> None:
    reader = reader_of(tmp_path / "a", seal([Part("ABCD", b"x", flags=0xFFFFFFFE), Part("EFGH", b"", flags=3)]))
    with reader._file:
        assert [entry.required for entry in reader.entries.values()] == [False, True]


@pytest.mark.parametrize("data", [b"", b"\x89", b"\x89PDEANIM\r\n\x1a", b"\x89PNG\r\n\x1a\n" + bytes(40), b"solid"])
def test_other_files_are_named_as_such_or_as_too_short(data: bytes, tmp_path: Path) -> None:
    said = refusal(tmp_path / "a", data)
    assert "not a .pdeanim file" in said or "ends inside its header" in said


def test_a_file_that_went_through_a_text_transfer_is_refused(tmp_path: Path) -> None:
    data = written(tmp_path / "a")
    assert "not a .pdeanim file" in refusal(tmp_path / "b", data.replace(b"\r\n", b"\n"))
    assert "not a .pdeanim file" in refusal(tmp_path / "b", data.replace(b"\n", b"\r\n"))


def test_truncation_says_how_many_bytes_there_should_be(tmp_path: Path) -> None:
    data = written(tmp_path / "a")
    said = refusal(tmp_path / "b", data[:-1])
    assert "truncated" in said
    assert str(len(data)) in said
    assert str(len(data) - 1) in said
    assert "after its last section" in refusal(tmp_path / "b", data + b"\0")


def test_every_truncation_is_refused(tmp_path: Path) -> None:
    data = written(tmp_path / "a")
    for size in range(len(data)):
        refusal(tmp_path / "b", data[:size])


def test_every_flipped_bit_of_header_and_table_is_refused(tmp_path: Path) -> None:
    data = written(tmp_path / "a")
    for at in range(HEADER.size + 3 * ENTRY_1.size):
        for bit in range(8):
            refusal(tmp_path / "b", data[:at] + bytes([data[at] ^ 1 << bit]) + data[at + 1 :])


def test_a_damaged_section_is_refused_when_it_is_read_and_by_verify(tmp_path: Path) -> None:
    data = bytearray(written(tmp_path / "a"))
    data[-1] ^= 1
    reader = reader_of(tmp_path / "b", bytes(data))
    with reader._file:
        assert reader.read("ABCD") == b"first"
        with pytest.raises(CorruptFileError, match="section IJKL is damaged") as caught:
            reader.read("IJKL")
        assert caught.value.offset == HEADER.size + 3 * ENTRY_1.size + 5
        with pytest.raises(CorruptFileError, match="section IJKL is damaged"):
            reader.verify()


def test_sections_that_overlap_leave_gaps_or_stand_twice_are_refused(tmp_path: Path) -> None:
    data = written(tmp_path / "a", [Section("ABCD", b"1234"), Section("EFGH", b"5678")])
    second = HEADER.size + ENTRY_1.size
    for offset in (0, 93, HEADER.size + 2 * ENTRY_1.size, 2**63, 2**64 - 1):
        moved = bytearray(data)
        moved[second + 8 : second + 16] = offset.to_bytes(8, "little")
        assert "is not where the one before it ends" in refusal(tmp_path / "b", resealed(moved))
    assert "stands twice" in refusal(tmp_path / "b", seal([Part("ABCD", b"1"), Part("ABCD", b"2")]))


def test_lengths_beyond_the_file_are_refused(tmp_path: Path) -> None:
    data = written(tmp_path / "a", [Section("ABCD", b"1234")])
    for length in (5, 2**32, 2**63, 2**64 - 1):
        longer = bytearray(data)
        longer[HEADER.size + 16 : HEADER.size + 24] = length.to_bytes(8, "little")
        assert "truncated" in refusal(tmp_path / "b", resealed(longer))


def test_more_sections_than_can_be_are_refused_before_the_table_is_read(tmp_path: Path) -> None:
    most = [Part(f"S{k:03}", b"") for k in range(MAX_SECTIONS)]
    with reader_of(tmp_path / "a", seal(most))._file as file:
        assert len(ContainerReader(file, "a").entries) == MAX_SECTIONS
    assert f"{MAX_SECTIONS + 1} sections" in refusal(tmp_path / "b", seal([*most, Part("ZZZZ", b"")]))
    huge = bytearray(seal(most))
    huge[16:20] = b"\xff\xff\xff\xff"
    assert "4294967295 sections" in refusal(tmp_path / "b", resealed(huge))


class _FailingSpool(Spool):
    def pieces(self) -> list[bytes]:  # type: ignore[override]
        raise OSError(28, "No space left on device")


def test_a_failure_while_writing_leaves_nothing_behind_and_the_old_file_as_it_was(tmp_path: Path) -> None:
    path = tmp_path / "out.pdeanim"
    path.write_bytes(b"old")
    spool = _FailingSpool(tmp_path)
    spool.append(b"12345")
    with pytest.raises(InputError, match="No space left"):
        write_container(path, [Section("ABCD", b"x"), Section("DATA", spool)])
    spool.close()
    assert [item.name for item in tmp_path.iterdir()] == ["out.pdeanim"]
    assert path.read_bytes() == b"old"


def test_an_output_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    (tmp_path / "plain").touch()
    written(tmp_path / "a")
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == stat.S_IMODE((tmp_path / "plain").stat().st_mode)


def test_places_that_cannot_become_an_output_are_refused_before_work_starts(tmp_path: Path) -> None:
    (tmp_path / "there").touch()
    for path, message in (
        (tmp_path, "is a folder"),
        (tmp_path / "there", "exists already"),
        (tmp_path / "nowhere" / "a", "folder does not exist"),
    ):
        with pytest.raises(InputError, match=message):
            check_writable(path, overwrite=False)
    check_writable(tmp_path / "there", overwrite=True)
    check_writable(tmp_path / "new", overwrite=False)


def test_damage_and_limits_have_the_exit_code_of_a_corrupt_file() -> None:
    assert (CorruptFileError("").exit_code, LimitError("").exit_code) == (4, 4)
    assert (InputError("").exit_code, SettingsError("").exit_code) == (3, 2)
