"""The specification's independent decoder and the library agree within the margin."""

from __future__ import annotations

import ast
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from pdecodec import (
    ArraySequence,
    ChangingSequence,
    Connectivity,
    CorruptFileError,
    EncodeSettings,
    MeshObject,
    MeshSequence,
    encode,
    open_animation,
)
from pdecodec.codec.sections.space_basis import SpaceKind
from pdecodec.mesh.metrics import frame_scale
from spec.accepted import Choices, encoded
from spec.decoder import animation as independent
from spec.sealing import seal, take_apart
from tests.codec.test_fields import clip_with_fields
from tests.codec.test_round_trip import CLIPS
from tests.support.decoders import assert_same
from tests.support.mesh_cases import mesh_objects
from tests.support.sequence_cases import rich_sequence

ROOT = Path(__file__).resolve().parents[2]


def assert_decodes_alike(sequence: MeshSequence, path: Path, choices: Choices | None = None) -> None:
    if choices is None:
        encode(sequence, path, EncodeSettings(effort="fast"), overwrite=True)
    else:
        path.write_bytes(encoded(sequence, choices))
    other = independent.decode_file(path)
    with open_animation(path) as mine:
        first, last = mine.times[0], mine.times[-1]
        times = [*mine.times, *(first + (last - first) * np.array([-0.5, 0.03, 0.51, 0.97, 1.5]))]
        assert_same(other, mine, times)


@pytest.mark.parametrize("name", CLIPS)
def test_the_plain_decoder_decodes_every_clip(name: str, tmp_path: Path) -> None:
    assert_decodes_alike(CLIPS[name](), tmp_path / "a.pdeanim")


@pytest.mark.parametrize("settings", [{}, {"field_tolerance": 1e-6}, {"fields": {"stress": "exact", "energy": "drop"}}])
def test_the_plain_decoder_decodes_fields_to_the_last_bit(settings: dict[str, Any]) -> None:
    clip = clip_with_fields()
    later = clip_with_fields()
    later.times = later.times + 10
    runs = ChangingSequence([clip, ArraySequence(np.zeros((1, 3, 3)), times=[5.0]), later])
    for sequence in (clip, runs):
        data = encode(sequence, effort="fast", **settings).data
        assert data is not None
        with open_animation(data) as mine:
            for run, other in zip(mine.runs, independent.decode_runs(data), strict=True):
                assert [one.name for one in run.fields] == [one.name for one in other.fields]
                for field, found in zip(run.fields, other.fields, strict=True):
                    values = np.array(found.frames, field.dtype).reshape(field.shape(run.frame_count, run.objects))
                    np.testing.assert_array_equal(values, run.read_field(field.name, 0, run.frame_count))


def test_damaged_headers_of_fields_are_refused_or_read_by_both_decoders() -> None:
    data = encode(clip_with_fields(3), effort="fast").data
    assert data is not None
    parts = take_apart(data)
    number = next(index for index, part in enumerate(parts) if part.kind == "FLDS")
    headers, outcomes = parts[number].content, set()
    for place in range(0, len(headers), 11):
        for value in (headers[place] ^ 1, 255 - headers[place]):
            changed = headers[:place] + bytes([value]) + headers[place + 1 :]
            sealed = seal([*parts[:number], replace(parts[number], content=changed), *parts[number + 1 :]])
            is_read = True
            try:
                with open_animation(sealed) as animation:
                    for field in animation.fields:
                        animation.read_field(field.name, 0, 3)
            except CorruptFileError:
                is_read = False
            outcomes.add(is_read)
            if is_read:
                independent.decode(sealed)
            else:
                with pytest.raises(independent.CorruptFileError):
                    independent.decode(sealed)
    assert outcomes == {True, False}


def bending_strips() -> ArraySequence:
    """Return two separate strips of quads, one of them bending, and a vertex without faces."""
    column, row = (axis.ravel() for axis in np.meshgrid(np.arange(5), np.arange(14), indexing="ij"))
    frame = np.arange(9.0)[:, None]
    strip = np.stack(np.broadcast_arrays(column + 0.0 * frame, row, np.sin(0.3 * row * column + 0.8 * frame)), axis=-1)
    still = strip[:1].repeat(9, axis=0) + np.array([9.0, 0.0, 0.5])
    points = np.concatenate([strip, still, np.ones((9, 1, 3))], axis=1)
    corner = (14 * np.arange(4)[:, None] + np.arange(13)).ravel()
    quads = np.stack([corner, corner + 1, corner + 15, corner + 14], axis=1)
    indices = np.concatenate([quads, quads + 70]).ravel()
    connectivity = Connectivity(141, face_counts=np.full(104, 4), face_indices=indices)
    return ArraySequence(points, objects=[MeshObject("strips", connectivity)])


@pytest.mark.parametrize(("kind", "points"), [("patch", 16), ("patch", 64), ("curve", 16), ("curve", 64)])
def test_many_patches_and_pieces_decode_alike(kind: SpaceKind, points: int, tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    assert_decodes_alike(bending_strips(), path, Choices(space=(kind, points)))
    with open_animation(path) as animation:
        assert animation.info()["space_basis"] == kind
    assert len(independent.decode_file(path).motion.space.patches.elements) >= 3


def test_groups_decode_alike(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    assert_decodes_alike(bending_strips(), path, Choices(longest_group=4))
    with open_animation(path) as animation:
        assert animation.info()["groups"] == 3


def test_attributes_and_objects_come_back_alike(tmp_path: Path) -> None:
    assert_decodes_alike(rich_sequence(), tmp_path / "a.pdeanim")


def test_a_surface_comes_back_in_the_order_it_had(tmp_path: Path) -> None:
    strips = bending_strips()
    random = np.random.default_rng(1)
    name = random.permutation(strips.vertex_count)
    indices = name[strips.connectivity.face_indices.reshape(-1, 4)][random.permutation(strips.connectivity.face_count)]
    mesh = Connectivity(name.size, face_counts=np.full(len(indices), 4), face_indices=indices.ravel())
    path = tmp_path / "a.pdeanim"
    points = strips.read_frames(0, strips.frame_count)[:, np.argsort(name)]
    assert_decodes_alike(ArraySequence(points, objects=[MeshObject("strips", mesh)]), path)
    with open_animation(path) as animation:
        assert animation.connectivity.same_as(mesh)
        assert animation.sections["CONN"] < 40 < 100 < animation.sections["ORDR"]


@settings(max_examples=20, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mesh_objects(), st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_the_plain_decoder_decodes_any_mesh(tmp_path: Path, objects: list[MeshObject], frames: int, seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(frames, sum(item.vertex_count for item in objects), 3))
    assert_decodes_alike(ArraySequence(points, objects=objects), tmp_path / "a.pdeanim")


def test_the_plain_decoder_shares_no_code_with_the_library() -> None:
    modules = sorted((ROOT / "spec" / "decoder").glob("*.py"))
    assert len(modules) >= 6
    allowed = {"numpy", "zstandard", "spec"} | sys.stdlib_module_names
    for module in modules:
        for node in ast.walk(ast.parse(module.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.partition(".")[0] for name in names} <= allowed, module.name


def test_the_command_of_the_plain_decoder_prints_objects_and_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    encode(rich_sequence(), path, EncodeSettings())

    def printed(*arguments: str) -> str:
        command = [sys.executable, "-m", "spec.decoder", str(path), *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout

    assert "body: 5 vertices, 2 faces, 2 lines" in printed()
    with open_animation(path) as mine:
        rows = [[float(number) for number in line.split()] for line in printed("0.05").splitlines()]
        scale = frame_scale(mine.positions(0.0))
        np.testing.assert_allclose(rows, mine.positions(0.05), rtol=1e-6, atol=2.0**-20 * scale)  # the spec's margin
