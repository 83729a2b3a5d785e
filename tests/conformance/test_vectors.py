"""The vectors of the specification: accepted vectors decode to the recorded bits; refused vectors cause the
recorded error.
"""

from __future__ import annotations

import fnmatch
import hashlib
import re
import zlib
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pdecodec import Animation, CorruptFileError, Field, LimitError, MeshSequence, open_animation
from pdecodec.codec.editing import cut_animation, join_animations
from spec.decoder import animation as independent
from spec.decoder.fieldchunks import HAS_KINDS, IS_TRANSFORMED
from spec.decoder.fields import CorruptFileError as IndependentCorruptFileError
from spec.decoder.groups import CLOSED_FORM, COSINES, PRECISE, SHAPES, TRAJECTORIES
from spec.decoder.mesh import Attribute
from spec.decoder.rangecoder import RangeDecoder
from spec.decoder.residuals import ResidualReader
from spec.decoder.storedfields import COPY, DISPLACEMENT, DOMAINS, MAGNITUDE, TYPES, VELOCITY
from spec.example import section
from spec.make_vectors import MAX_LISTED_VERTICES, describe, hash_integers
from spec.sealing import (
    CHUNKS,
    Part,
    Row,
    ScriptedCoder,
    content,
    counted,
    group_chunks,
    seal,
    take_apart,
    take_rows,
    take_runs,
)
from spec.vector_files import accepted_files, accepted_vectors, read_manifest, refused_vectors
from tests.support.decoders import assert_close, assert_same
from tests.support.shaken_arithmetic import decoder, shaker, trace

SPEC = Path(__file__).resolve().parents[2] / "spec"
MANIFEST = read_manifest()
REFUSED = refused_vectors()


def sha256(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


@pytest.mark.parametrize(("kind", "files"), [("accept", accepted_vectors()), ("reject", REFUSED)])
def test_the_manifest_lists_every_vector_and_its_bytes_have_not_changed(kind: str, files: dict[str, bytes]) -> None:
    assert files.keys() == MANIFEST[kind].keys()
    assert len(files) >= 20
    for name, data in files.items():
        assert sha256(data) == MANIFEST[kind][name]["sha256"], name


def test_the_vectors_stay_small() -> None:
    sizes = [len(data) for data in (*accepted_vectors().values(), *REFUSED.values())]
    assert max(sizes) < 5_000
    assert sum(sizes) < 200_000


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_the_library_and_the_plain_decoder_agree_with_the_manifest(name: str) -> None:
    expected = MANIFEST["accept"][name]
    path = accepted_files()[name]
    plain = independent.decode_runs(path.read_bytes())
    assert describe(path.read_bytes()) == expected
    with open_animation(path) as animation:
        animation.verify()
        sizes = [(run.vertex_count, run.frame_count) for run in animation.runs]
        expected_sizes = (expected["vertices"], expected["frames"])
        vertices, frames = ([value] if isinstance(value, int) else value for value in expected_sizes)
        assert sizes == list(zip(vertices, frames, strict=True))
        asked = {row[0] for row in expected["positions"]}
        for other, run in zip(plain, animation.runs, strict=True):
            assert isinstance(run, Animation)
            times = {*run.times, *(time for time in asked if animation.run_at(time) is run)}
            assert_same(other, run, sorted(times))
        of_fields = expected.get("fields", [])
        for own, run in zip(
            [of_fields] if len(plain) == 1 else of_fields or [[]] * len(plain), animation.runs, strict=True
        ):
            check_fields(own, run)
        for time in sorted({*animation.times, *asked}):
            other = independent.run_at(plain, time)
            assert_close(animation.positions(time), other, min(time, other.times[-1]))


def check_fields(expected: list[dict[str, Any]], run: MeshSequence) -> None:
    """Check fields of a run against the manifest."""
    assert isinstance(run, Animation)
    for one, own, stored in zip(expected, run.fields, run.stored_fields, strict=True):
        dtype = np.dtype("bool" if one["type"] == "boolean" else one["type"])
        objects = tuple(one["objects"]) or None
        assert own == Field(one["name"], one["domain"], dtype, one["components"], one["unit"], objects)
        assert [[stored.smallest, stored.largest], stored.bound] == [one["range"], one["bound"]]
        if "sha256" in one:
            assert sha256(run.read_field(own.name, 0, run.frame_count).tobytes()) == one["sha256"]
        for time, *values in one["values"]:
            found = run.field(own.name, time).ravel()
            shown = found[:: -(-found.size // MAX_LISTED_VERTICES) or 1]
            listed = np.array([(float if dtype.kind == "f" else int)(text) for text in values], dtype)
            np.testing.assert_allclose(shown, listed, rtol=1e-4 if dtype.kind == "f" else 0, atol=one["bound"] / 100)


@pytest.mark.parametrize("name", MANIFEST["reject"])
def test_a_refused_vector_ends_in_the_pinned_error(name: str, tmp_path: Path) -> None:
    expected = MANIFEST["reject"][name]
    path = tmp_path / f"{name}.pdeanim"
    path.write_bytes(REFUSED[name])

    with pytest.raises(CorruptFileError) as caught:
        verify(path)
    assert (type(caught.value) is LimitError) == (expected["error"] == "limit")
    assert caught.value.exit_code == expected["exit_code"]
    assert str(caught.value).startswith(str(path))


@pytest.mark.parametrize("name", [name for name, vector in MANIFEST["reject"].items() if vector["error"] == "corrupt"])
def test_the_independent_decoder_refuses_what_is_corrupt(name: str) -> None:
    def decode_all() -> None:
        for run in independent.decode_runs(REFUSED[name]):
            for index in range(len(run.motion.groups)):
                run.motion.group(index)

    with pytest.raises(IndependentCorruptFileError):
        decode_all()


Parsed = tuple[list[tuple[int, int]], dict[str, str], list[tuple[Any, ...]]]


@pytest.fixture(scope="module")
def parsers() -> Iterator[tuple[Callable[[bytes], Parsed], Callable[[bytes], Parsed]]]:
    """Yield two functions that read a file: with the plain decoder, and with that decoder when every
    floating-point result is off by one unit.
    """
    with decoder(None) as usual, decoder(shaker(1), exempt=set()) as shaken:
        yield parser(usual), parser(shaken)


def parser(modules: dict[str, ModuleType]) -> Callable[[bytes], Parsed]:
    """Return a function that decodes files: every bit with its probability, the integers listed in the
    manifest, and attributes.
    """
    read = trace(modules)

    def parse(data: bytes) -> Parsed:
        read.clear()
        runs = modules["animation"].decode_runs(data)
        found = hash_integers(runs)
        attributes = [item for run in runs for mesh in run.meshes for item in mesh.attributes]
        of_each = [(item.name, item.domain, item.indices, item.labels, item.values.tobytes()) for item in attributes]
        return list(read), found, of_each

    return parse


@pytest.mark.parametrize("name", MANIFEST["accept"])
def test_no_result_of_floating_point_arithmetic_decides_how_bytes_are_read(
    name: str, parsers: tuple[Callable[[bytes], Parsed], Callable[[bytes], Parsed]]
) -> None:
    data = accepted_vectors()[name]
    usual, shaken = (parse(data) for parse in parsers)
    assert usual[1] == MANIFEST["accept"][name]["integers"]
    assert usual == shaken


def test_the_links_inside_the_specification_lead_somewhere() -> None:
    text = (SPEC / "pdeanim.md").read_text("utf-8")
    titles = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    anchors = {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}
    links = set(re.findall(r"\]\(#([^)]+)\)", text))
    assert links
    assert links <= anchors


def test_the_example_is_written_as_its_file_is() -> None:
    written = section(accepted_vectors()["example"])
    assert written in (SPEC / "pdeanim.md").read_text("utf-8")


def test_every_reason_names_a_section_of_the_specification() -> None:
    text = (SPEC / "pdeanim.md").read_text("utf-8")
    numbers = {number for _, number in sections_of(text)}
    for name, vector in MANIFEST["reject"].items():
        (number,) = re.findall(r"\((\d+(?:\.\d+)*)\)$", vector["reason"])
        assert number in numbers, name


class Vector(NamedTuple):
    """The parts of a vector."""

    parts: list[Part]
    rows: list[Row]
    patches: int
    attributes: list[Attribute]

    def chunk(self, kind: str) -> bytes:
        """Return a chunk of the first group."""
        return group_chunks(self.parts, kind)[0]

    def is_of(self, basis: int, *, double: bool | None = None, groups: int = 1) -> bool:
        kinds = {row.kind & ~PRECISE if double is None else row.kind for row in self.rows if row.functions}
        return kinds == {basis + PRECISE * bool(double)} and len(self.rows) == groups

    def byte(self, kind: str, at: int) -> int:
        return content(self.parts, kind)[at]

    def moves(self) -> bool:
        return any(row.functions for row in self.rows)

    def is_predicted(self) -> bool:
        reader = ResidualReader(self.chunk("CORR"), [0, 24])
        reader.read(self.rows[0].frames)
        return reader.is_predicted


def vector(name: str) -> Vector:
    data = accepted_vectors()[name]
    parts = take_apart(data)
    animation = independent.decode(data)
    patches = len(animation.motion.space.patches.elements)
    return Vector(parts, take_rows(content(parts, "GRUP"))[0], patches, animation.meshes[0].attributes)


def test_vectors_of_runs_have_what_they_are_named_for() -> None:
    found = {}
    for name in ("runs", "runs_of_one_frame", "runs_in_closed_form", "file_of_one_run"):
        parts = take_apart(accepted_vectors()[name])
        assert {"RUNS", "RDAT", "SEQN"} <= {part.kind for part in parts} <= {"META", "RUNS", "RDAT", "SEQN"}
        found[name] = take_runs(parts)
    assert {len(runs) for runs in found.values()} == {5, 1}
    assert len(found["file_of_one_run"]) == 1
    shared = {kind for run in found["runs"] for kind, section in run.sections.items() if section is None}
    assert {"NAME", "CONN", "ATTR"} <= shared
    assert all(run.sections["CORR"] == b"" for run in found["runs_of_one_frame"])
    groups = [run.sections["GRUP"] for run in found["runs_in_closed_form"]]
    assert {table[2] & ~PRECISE for table in groups if table} == {CLOSED_FORM}


def test_vectors_with_fields_have_what_they_are_named_for() -> None:
    runs = {name: independent.decode_runs(data) for name, data in accepted_vectors().items() if "field" in name}
    every = runs["fields"][0].fields
    assert {one.type for one in every} == set(TYPES)
    (solids,) = independent.decode_runs(accepted_vectors()["solids"])
    assert {one.domain for one in (*every, *solids.fields)} == set(DOMAINS)
    assert {tuple(one.objects) for one in every} == {(), (0,), (1,)}
    codes = [{group.code for group in one.computed} for one in runs["fields_computed"][0].fields]
    assert codes == [set(), {MAGNITUDE}, {COPY}, {VELOCITY}, {MAGNITUDE}, {DISPLACEMENT}]
    assert [len(run.fields) for run in runs["fields_of_runs"]] == [14, 0, 6]
    assert runs["fields_none"][0].fields == []
    heads = {name: content(take_apart(accepted_vectors()[name]), "FDAT")[:2] for name in runs}
    assert heads["fields"] == bytes([HAS_KINDS, 1])
    assert heads["fields_predicted_between_frames"] == bytes([HAS_KINDS + 6, 15])
    assert heads["fields_of_few_functions_of_time"][0] == IS_TRANSFORMED


CLAIMS: dict[str, Callable[[Vector], bool]] = {
    "trajectories_predicted": lambda v: v.chunk("TIME")[0] == 0 and v.is_of(TRAJECTORIES),
    "trajectories_transformed": lambda v: v.chunk("TIME")[0] == 1 and v.is_of(TRAJECTORIES),
    "trajectories_in_straight_runs": lambda v: v.chunk("TIME")[0] == 2 and v.is_of(TRAJECTORIES),
    "shapes_predicted": lambda v: v.chunk("TIME")[0] == 0 and v.is_of(SHAPES),
    "shapes_transformed": lambda v: v.chunk("TIME")[0] == 1 and v.is_of(SHAPES),
    "shapes_in_double": lambda v: v.is_of(SHAPES, double=True),
    "groups_of_shapes": lambda v: v.is_of(SHAPES, groups=3),
    "cosines": lambda v: v.is_of(COSINES, double=False),
    "groups": lambda v: v.is_of(TRAJECTORIES, groups=3) and len({row.frames for row in v.rows}) == 2,
    "groups_of_cosines": lambda v: v.is_of(COSINES, groups=3),
    "groups_of_one_frame": lambda v: {row.frames for row in v.rows} == {1},
    "groups_in_double": lambda v: TRAJECTORIES + PRECISE in {row.kind for row in v.rows},
    "cosines_in_double": lambda v: v.is_of(COSINES, double=True),
    "closed_form": lambda v: v.byte("MODL", 0) == 1 and {row.kind & ~PRECISE for row in v.rows} == {CLOSED_FORM},
    "closed_form_on_pieces": lambda v: v.byte("MODL", 1) == 6 and len(v.rows) == 2,
    "closed_form_and_residuals": lambda v: v.byte("MODL", 1) == 255 and v.chunk("CORR") != b"",
    "closed_form_of_one_frame": lambda v: v.rows[0].frames == 1,
    "closed_form_at_irregular_times": lambda v: v.byte("SEQN", 2) % 4 == 2 and len(v.rows) >= 2,
    "many_patches": lambda v: v.patches >= 8 and v.byte("MODL", 0) == 0,
    "many_pieces": lambda v: v.patches >= 8 and v.byte("MODL", 0) == 1,
    "welded": lambda v: v.byte("REST", 32) & ~4 == 1,
    "smoothed": lambda v: v.byte("REST", 32) & 5 == 4,
    "smoothed_across_welds": lambda v: v.byte("REST", 32) & 5 == 5,
    "polygons_attributes": lambda v: v.byte("REST", 32) == 0 and v.parts[-1].kind == "ATTR",
    "mapped": lambda v: len(v.attributes) == 6,
    "order_kept": lambda v: "ORDR" in {part.kind for part in v.parts},
    "order_free": lambda v: "ORDR" not in {part.kind for part in v.parts},
    "one_frame": lambda v: v.rows[0].frames == 1 and not v.moves(),
    "static": lambda v: not v.moves() and v.chunk("CORR") == b"",
    "rigid": lambda v: v.rows[0].functions <= 4 and len(v.chunk("CORR")) < 8,
    "residuals": lambda v: len(v.chunk("CORR")) > 50,
    "raw_vertices": lambda v: len(v.chunk("CORR")) > 12 * 15,
    "irregular_times": lambda v: v.byte("SEQN", 2) % 4 == 2,
    "times_at_another_rate": lambda v: v.byte("SEQN", 2) % 8 in (0, 1),
    "times_by_period": lambda v: v.byte("SEQN", 2) % 8 == 4 + 3,
    "long_clip": lambda v: sum(row.frames for row in v.rows) > 2 * 46 and len(v.rows) > 2,
    "residuals_predicted": lambda v: v.is_predicted(),
    "residuals_from_end_to_end": lambda v: not v.is_predicted(),
    "functions_of_length_zero": lambda v: v.chunk("TIME") == b"" and v.rows[0].functions > 0,
    "sections_in_another_order": lambda v: [part.kind for part in v.parts[:3]] == list(CHUNKS[::-1]),
    "unknown_ignorable_sections": lambda v: {"XYZW", "\xff\x00ab"} < {part.kind for part in v.parts},
    "count_of_nine_bytes": lambda v: v.byte("SEQN", 7) == 0x80,
    "minor_version_1": lambda v: {"PREV", "a_pp", "SCEN", "META"} < {part.kind for part in v.parts},
    "chunks_of_no_fields": lambda v: "FLDS" not in {part.kind for part in v.parts},
    "scene": lambda v: v.byte("SCEN", 0) == len("gltf"),
    "without_remarks": lambda v: "META" not in {part.kind for part in v.parts},
}


@pytest.mark.parametrize("name", CLAIMS)
def test_a_vector_has_what_it_is_named_for(name: str) -> None:
    assert CLAIMS[name](vector(name))


@given(st.text("01", max_size=200), st.integers(0, 2**32 - 1))
def test_scripted_bits_come_back_whatever_their_probability(bits: str, seed: int) -> None:
    random = np.random.default_rng(seed).integers(32, 65505, len(bits)).tolist()
    writer = ScriptedCoder(bits)
    for probability in random:
        writer.bit_with(probability)
    reader = RangeDecoder(writer.to_bytes())
    assert "".join(str(reader.bit_with(probability)) for probability in random) == bits
    assert reader.is_finished()


def test_numbers_are_counted_in_digits_first() -> None:
    assert [counted(number) for number in (1, 2, 3, 6)] == ["0", "100", "101", "11010"]


def sections_of(text: str) -> list[tuple[int, str]]:
    """Return where each numbered section of the specification begins in its text, and its number."""
    return [
        (found.start(), found[1].rstrip(".")) for found in re.finditer(r"^(?:#+ |\*\*)(\d[\d.]*)", text, re.MULTILINE)
    ]


def test_the_table_of_rules_has_every_must_of_the_specification_and_every_refused_vector() -> None:
    text, table = ((SPEC / name).read_text("utf-8") for name in ("pdeanim.md", "rules.md"))
    sections = sections_of(text)
    of_words = [text.index("MUST, MUST NOT"), text.index("MUST NOT, SHOULD"), text.index("MUST or lies")]
    without_row = {found.start() for found in re.finditer(r"\bMUST\b", text)} - set(of_words)
    refused: set[str] = set()
    for line in re.findall(r"^\| \d.*$", table, re.MULTILINE):
        number, rule, *vectors = [cell.strip().replace("\\|", "|") for cell in re.split(r"(?<!\\)\|", line)[1:-1]]
        places = re.finditer(r"\s+".join(map(re.escape, rule.split())), text)
        of_section = [found for found in places if [own for at, own in sections if at <= found.start()][-1] == number]
        assert of_section or "MUST" not in rule, f"section {number} lacks {rule!r}"
        for found in of_section:
            without_row -= {found.start() + must.start() for must in re.finditer("MUST", found[0])}
        named = [re.findall(r"`([^`]+)`", cell) for cell in vectors]
        assert any(named) or vectors[0] in ("(encoders)", "(programs)"), f"{rule!r} has no vector"
        for kind, patterns in zip(("accept", "reject"), named, strict=True):
            for pattern in patterns:
                known = fnmatch.filter(MANIFEST[kind], pattern)
                assert known, f"{pattern} is no vector"
                refused.update(known if kind == "reject" and pattern != "*" else ())
    assert not without_row, [text[at - 60 : at + 60] for at in sorted(without_row)]
    assert set(MANIFEST["reject"]) == refused


def test_no_minor_version_changes_what_is_read_and_what_is_refused() -> None:
    for data in accepted_vectors().values():
        with open_animation(data) as animation, open_animation(with_minor_version(data)) as other:
            other.verify()
            assert np.array_equal(
                other.positions(other.times[-1]), animation.positions(animation.times[-1]), equal_nan=True
            )
    for data in REFUSED.values():
        if data[24:28] == zlib.crc32(data[:24]).to_bytes(4, "little"):
            with pytest.raises(CorruptFileError):
                verify(with_minor_version(data))


def verify(file: bytes | Path) -> None:
    with open_animation(file) as animation:
        animation.verify()


def with_minor_version(data: bytes, minor: int = 1) -> bytes:
    """Return a file with another minor version."""
    head = data[:14] + minor.to_bytes(2, "little") + data[16:24]
    return head + zlib.crc32(head).to_bytes(4, "little") + data[28:]


UNKNOWN = {
    "flags_of_another_minor_version": ("XYZW", "xyzw"),
    "unknown_ignorable_sections": ("XYZW", "\\xff\0ab"),
    "minor_version_1": ("PREV", "a_pp"),
}


@pytest.mark.parametrize("name", UNKNOWN)
def test_files_with_unknown_sections_are_cut_and_give_their_motion_alone(tmp_path: Path, name: str) -> None:
    data = accepted_files()[name].read_bytes()
    with open_animation(data) as whole, open_animation(whole.motion_alone()) as alone:
        assert np.array_equal(alone.positions(whole.times), whole.positions(whole.times))
        (tmp_path / "a.pdeanim").write_bytes(data)
        report = cut_animation(tmp_path / "a.pdeanim", tmp_path / "b.pdeanim", 0, whole.frame_count)
        assert report.lost_sections == UNKNOWN[name]
        assert whole.notices == (f"sections not kept: {', '.join(UNKNOWN[name])}; this version does not know them",)
        with open_animation(tmp_path / "b.pdeanim") as part:
            assert np.array_equal(part.positions(whole.times), whole.positions(whole.times))
            assert part.carried == whole.carried
        of_both = [independent.decode((tmp_path / f"{k}.pdeanim").read_bytes()).remarks for k in "ab"]
        assert of_both[0].get("provenance") == of_both[1].get("provenance")


def test_a_file_of_runs_with_a_single_run_shows_the_sections_of_the_file() -> None:
    one, scene = (take_apart(accepted_vectors()[name]) for name in ("file_of_one_run", "minor_version_1"))
    data = seal([*(part for part in scene if part.kind in ("SCEN", "PREV")), *one], minor=1)
    with open_animation(data) as whole, open_animation(whole.motion_alone()) as alone:
        assert np.array_equal(alone.positions(whole.times), whole.positions(whole.times))
        assert whole.notices == ("sections not kept: PREV; this version does not know them",)
        assert whole.carried is not None
        assert {*whole.sections} == {"container", "SCEN", "PREV", "SEQN", "RUNS", "RDAT"}
        assert sum(whole.sections.values()) == len(data)


def test_runs_with_unknown_sections_are_cut_and_joined_without_them(tmp_path: Path) -> None:
    for name, frames in (("runs_of_minor_version_1", 3), ("minor_version_1", 4)):
        source, first, rest, joined = (tmp_path / f"{name}{k}.pdeanim" for k in range(4))
        source.write_bytes(accepted_vectors()[name])
        with open_animation(source) as whole:
            for path, begin, end in ((first, 0, frames), (rest, frames, whole.frame_count)):
                assert cut_animation(source, path, begin, end).lost_sections == ("PREV", "a_pp")
            if name == "minor_version_1":
                first.write_bytes(seal([*take_apart(first.read_bytes()), Part("PREV", b"", 0)], minor=1))
                assert join_animations(first, [rest], joined).lost_sections == ("PREV",)
