"""The independent decoder of the specification gives what the library gives, to the last bit."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from mesh_cases import mesh_objects
from sequence_cases import rich_sequence
from test_round_trip import CLIPS

from pdecodec import Animation, ArraySequence, EncodeSettings, MeshObject, encode, open_animation
from pdecodec.curves import extract_curves
from spec.decoder import animation as independent
from spec.decoder import curves as independent_curves
from spec.decoder.mesh import Mesh

ROOT = Path(__file__).resolve().parent.parent


def assert_same(other: independent.Animation, mine: Animation, times: list[float]) -> None:
    """Everything both decode, positions to the last bit."""
    assert other.times == mine.times.tolist()
    assert other.fps == mine.fps
    for mesh, item in zip(other.meshes, mine.objects, strict=True):
        assert (mesh.name, mesh.vertices) == (item.name, item.vertex_count)
        for polygons, counts, indices in (
            (mesh.faces, item.connectivity.face_counts, item.connectivity.face_indices),
            (mesh.lines, item.connectivity.line_counts, item.connectivity.line_indices),
        ):
            assert [len(polygon) for polygon in polygons] == counts.tolist()
            assert [vertex for polygon in polygons for vertex in polygon] == indices.tolist()
        for theirs, ours in zip(mesh.attributes, item.attributes, strict=True):
            assert (theirs.name, theirs.domain, tuple(theirs.labels)) == (ours.name, ours.domain, ours.labels)
            assert np.array_equal(theirs.values, ours.values)
            assert theirs.values.dtype == ours.values.dtype
            assert theirs.indices == (None if ours.indices is None else ours.indices.tolist())
    for time, decoded in zip(times, mine.sample(times), strict=True):
        assert np.array_equal(other.positions(time).view(np.uint32), decoded.view(np.uint32)), time


@pytest.mark.parametrize("name", CLIPS)
@pytest.mark.parametrize(
    "options",
    [
        {"profile": "segments"},
        {"profile": "segments", "alignment": "rotation", "r": 2.5, "alpha": 1.7},
        {"profile": "paper"},
    ],
)
def test_it_decodes_every_clip_to_the_same_bits(name: str, options: dict[str, object], tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    encode(CLIPS[name](), path, EncodeSettings(effort=1, **options))  # type: ignore[arg-type]
    with open_animation(path) as mine:
        first, last = mine.times[0], mine.times[-1]
        between = first + (last - first) * np.array([-0.5, 0.03, 0.51, 0.97, 1.5])
        assert_same(independent.decode_file(path), mine, [*mine.times[:3], *mine.times[-2:], *between])


def test_it_decodes_attributes_and_objects(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    encode(rich_sequence(), path, EncodeSettings(profile="segments"))
    with open_animation(path) as mine:
        assert len(mine.objects[0].attributes) == 4
        assert_same(independent.decode_file(path), mine, mine.times.tolist())


@settings(max_examples=200, deadline=None)
@given(mesh_objects())
def test_it_finds_the_same_curves_on_any_mesh(objects: list[MeshObject]) -> None:
    meshes = []
    for item in objects:
        part = item.connectivity
        faces, lines = (
            [piece.tolist() for piece in np.split(indices, np.cumsum(counts)[:-1])] if counts.size else []
            for counts, indices in ((part.face_counts, part.face_indices), (part.line_counts, part.line_indices))
        )
        meshes.append(Mesh(item.name, item.vertex_count, faces, lines))
    theirs, ours = independent_curves.extract_curves(meshes), extract_curves(objects)
    assert theirs.curves == [curve.tolist() for curve in np.split(ours.order, ours.starts[1:-1])]
    assert tuple(theirs.lonely) == ours.lonely


@settings(max_examples=20, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(mesh_objects(), st.integers(1, 7), st.integers(0, 2**32 - 1))
def test_it_decodes_any_mesh_to_the_same_bits(
    tmp_path: Path, objects: list[MeshObject], frames: int, seed: int
) -> None:
    points = np.random.default_rng(seed).normal(size=(frames, sum(item.vertex_count for item in objects), 3))
    path = tmp_path / "a.pdeanim"
    encode(ArraySequence(points, objects=objects), path, EncodeSettings(profile="segments", effort=1), overwrite=True)
    with open_animation(path) as mine:
        middle = (mine.times[0] + mine.times[-1]) * 0.37
        assert_same(independent.decode_file(path), mine, [*mine.times.tolist(), middle])


def test_it_shares_no_code_with_the_library() -> None:
    modules = sorted((ROOT / "spec" / "decoder").glob("*.py"))
    assert len(modules) >= 6
    allowed = {"numpy", "zstandard", "spec"} | sys.stdlib_module_names
    for module in modules:
        for node in ast.walk(ast.parse(module.read_text("utf-8"))):
            names = [alias.name for alias in node.names] if isinstance(node, ast.Import) else []
            names += [node.module or ""] if isinstance(node, ast.ImportFrom) else []
            assert {name.partition(".")[0] for name in names} <= allowed, module.name


def test_its_command_line_prints_objects_and_positions(tmp_path: Path) -> None:
    path = tmp_path / "a.pdeanim"
    encode(rich_sequence(), path, EncodeSettings(profile="segments"))

    def printed(*arguments: str) -> str:
        command = [sys.executable, "-m", "spec.decoder", str(path), *arguments]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=True).stdout

    assert "body: 5 vertices, 2 faces, 2 lines" in printed()
    with open_animation(path) as mine:
        rows = [[float(number) for number in line.split()] for line in printed("0.05").splitlines()]
        assert np.array_equal(np.array(rows, np.float32), mine.positions(0.05))
