"""Fields that a decoder computes: from another field, or from the motion."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, ChangingSequence, CorruptFileError, Field, MeshSequence
from pdecodec.codec.container import Section, container_pieces
from pdecodec.codec.encode.field import computed
from pdecodec.codec.sections.fields import FieldEntry, computed_group, encode_field_headers
from spec.decoder import animation as independent
from spec.sealing import seal, take_apart

CODES = {"copy": 3, "magnitude": 4, "velocity": 5, "displacement": 6}


def wave(frames: int = 24, noise: float = 0.0) -> ArraySequence:
    """Return a wave with its velocity, displacement, copies, a component, and an exact vector with its magnitude."""
    time, place = np.arange(frames)[:, None] / 24, np.linspace(0, 6, 40)
    points = np.stack([0 * time + place, np.sin(place - 3 * time), np.cos(2 * place + 2 * time)], axis=-1)
    slopes = np.stack([0 * time + 0 * place, -3 * np.cos(place - 3 * time), -2 * np.sin(2 * place + 2 * time)], axis=-1)
    slopes[-1, 7] += noise
    whole = np.rint(100 * np.sin(place + time)).astype(np.int32)
    force = (np.random.default_rng(1).random((frames, 40, 3)) - 0.5).astype(np.float32)
    force[2, 3] = [np.nan, np.inf, 1.0]
    points = points.astype(np.float32)
    length = np.sqrt((force.astype(np.float64) ** 2).sum(axis=-1)).astype(np.float32)
    return ArraySequence(
        points,
        fps=24,
        fields=[
            (Field("force", "vertex", components=3), force),
            (Field("length", "vertex"), length),
            (Field("up", "vertex"), force[..., 1]),
            (Field("whole", "vertex", np.int32), whole),
            (Field("again", "vertex", np.int32), whole),
            (Field("speed", "vertex", np.float64, 3), slopes),
            (Field("moved", "vertex", components=3), points - points[0]),
        ],
    )


def codings(animation: pdecodec.Animation) -> dict[str, set[int]]:
    return {one.name: {group.code for group in one.groups} for one in animation.stored_fields}


COMPUTED = {"length": {4}, "up": {3}, "again": {3}, "speed": {5}, "moved": {6}}


@pytest.fixture(scope="module")
def coded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("computed") / "x.pdeanim"
    pdecodec.encode(wave(), path, fields={"force": "exact"}, max_error=1e-4, field_tolerance=1e-2, group_frames=6)
    return path


def test_computable_fields_are_not_stored_and_keep_the_bound(coded: Path) -> None:
    clip = wave()
    with pdecodec.open(coded) as animation:
        found = codings(animation)
        assert {name: found[name] for name in COMPUTED} == COMPUTED
        facts = {one["name"]: one for one in animation.info()["fields"]}
        assert all(facts[name]["bytes"] == 0 for name in COMPUTED)
        assert facts["speed"]["computed"] == "velocity of the motion"
        assert facts["up"]["computed"] == "copy of 'force', from component 1"
        for stored in animation.stored_fields:
            wanted = clip.read_field(stored.name, 0, 24)
            values = animation.read_field(stored.name, 0, 24)
            finite = np.isfinite(wanted)
            np.testing.assert_array_equal(values[~finite], wanted[~finite])
            assert np.abs(values[finite].astype(np.float64) - wanted[finite]).max() <= stored.bound
        np.testing.assert_array_equal(animation.field("up", 0.31), animation.field("force", 0.31)[:, 1])
        animation.verify()


def assert_decoded_alike(animation: MeshSequence, other: independent.Animation) -> None:
    """Compare the values at 24 frames from both decoders; values computed from the motion may differ by rounding."""
    for field, found in zip(animation.fields, other.fields, strict=True):
        values = np.array(found.frames, field.dtype).reshape(field.shape(24, animation.objects))
        mine = animation.read_field(field.name, 0, 24)
        is_free = field.name in ("speed", "moved")
        np.testing.assert_allclose(values, mine, rtol=0, atol=1e-5 if is_free else 0, err_msg=field.name)


def test_both_decoders_compute_the_same(coded: Path) -> None:
    with pdecodec.open(coded) as animation:
        assert_decoded_alike(animation, independent.decode(coded.read_bytes()))


def test_a_single_value_beyond_the_bound_keeps_the_field() -> None:
    report = pdecodec.encode(wave(noise=0.5), max_error=1e-4, field_tolerance=1e-2)
    assert report.data is not None
    with pdecodec.open(report.data) as animation:
        assert codings(animation)["speed"] == {2}
    reasons = {one.name: one.coding for one in report.fields}
    assert "the velocity of the motion misses the bound" in reasons["speed"]
    assert reasons["moved"].startswith("not stored: displacement from frame 0")


def test_candidates_are_compared_with_files_of_what_they_need(monkeypatch: pytest.MonkeyPatch) -> None:
    sizes: list[int] = []

    def pieces(sections: Sequence[Section]) -> Iterator[bytes]:
        sizes.append(sections[-1].length)
        return container_pieces(sections)

    monkeypatch.setattr(computed, "container_pieces", pieces)
    report = pdecodec.encode(wave(), fields={"force": "exact"}, max_error=1e-4, field_tolerance=1e-2)
    stored = {one.name: one.bytes for one in report.fields if one.bytes}
    assert sorted(sizes) == sorted(
        [0, *stored.values()]
    )  # the sizes of the motion, counted once, and of each stored field from which others are computed


def test_cut_and_joined_files_keep_computed_values_to_the_last_bit(coded: Path, tmp_path: Path) -> None:
    with pdecodec.open(coded) as whole:
        wanted = {one.name: whole.read_field(one.name, 0, 24) for one in whole.fields}
        edge = whole.group_edges[1]
    parts = [tmp_path / "a.pdeanim", tmp_path / "b.pdeanim"]
    for path, begin, end in zip(parts, (0, edge), (edge, 24), strict=True):
        pdecodec.cut_animation(coded, path, begin, end)
    pdecodec.join_animations(parts[0], parts[1:], tmp_path / "c.pdeanim")
    with pdecodec.open(tmp_path / "c.pdeanim") as joined:
        assert {name: codings(joined)[name] for name in ("length", "up", "again")} == {
            name: COMPUTED[name] for name in ("length", "up", "again")
        }
        for name, values in wanted.items():
            np.testing.assert_array_equal(joined.read_field(name, 0, 24), values, name)


def test_runs_compute_their_own_fields() -> None:
    later = wave()
    later.times = later.times + 5
    data = pdecodec.encode(ChangingSequence([wave(), later]), max_error=1e-4, field_tolerance=1e-2).data
    assert data is not None
    with pdecodec.open(data) as animation:
        for run, other in zip(animation.runs, independent.decode_runs(data), strict=True):
            assert codings(run)["speed"] == {5}
            assert_decoded_alike(run, other)


@pytest.mark.parametrize(
    ("name", "code", "source", "component", "message"),
    [
        ("up", "copy", 0, 3, "of components or a type that its source does not give"),
        ("up", "copy", 9, 0, "computed from a missing field"),
        ("up", "copy", 1, 0, "computed from one that is computed from a field"),
        ("whole", "copy", 0, 0, "differs from its source in domain, type or objects"),
        ("whole", "magnitude", 0, 0, "differs from its source in domain, type or objects"),
        ("force", "magnitude", 0, 0, "of components or a type that its source does not give"),
        ("up", "velocity", 0, 0, "must have 3 components per vertex"),
    ],
)
def test_fields_that_cannot_be_computed_are_refused(
    coded: Path, name: str, code: str, source: int, component: int, message: str
) -> None:
    parts = take_apart(coded.read_bytes())
    with pdecodec.open(coded) as animation:
        fields = {one.name: one for one in animation.fields}
    plain = {
        "force": computed_group(24, 5),
        "length": computed_group(24, 4),
        name: computed_group(24, CODES[code], source, component),
    }
    entries = [FieldEntry(fields[one], 0.0, 1.0, 1.0, [group]) for one, group in plain.items()]
    changed = {"FLDS": encode_field_headers(entries), "FDAT": b""}
    sealed = seal([replace(part, content=changed[part.kind]) if part.kind in changed else part for part in parts])
    with pytest.raises(CorruptFileError, match=message), pdecodec.open(sealed) as animation:
        animation.stored_fields  # noqa: B018
    with pytest.raises(independent.CorruptFileError):
        independent.decode(sealed)
