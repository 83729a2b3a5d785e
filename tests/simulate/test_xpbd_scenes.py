"""Bundled scenes: sizes, meshes and motion; equal options give equal bits."""

from __future__ import annotations

import hashlib
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.errors import SettingsError
from pdecodec.simulate.constraints import Method
from pdecodec.simulate.distance import ChainConstraints
from pdecodec.simulate.meshing import bending_stencils, grid_quads, lattice_surface, lattice_tetrahedra, triangulate
from pdecodec.simulate.scenes import SCENES, build
from pdecodec.simulate.solver import Solver
from pdecodec.simulate.surroundings import Ground
from pdecodec.simulate.tetrahedra import tetrahedron_volumes

SMALL: dict[str, dict[str, Any]] = {
    "cube-rope": {"rings": 40, "sides": 8},
    "cloth": {"columns": 12, "rows": 10},
    "flag": {"columns": 12, "rows": 9},
    "jelly": {"cells": 3},
}


def test_the_cube_rope_is_24_curves_of_832_points_and_its_section_a_turning_square() -> None:
    scene = build("cube-rope")
    assert scene.visible.size == 24 * 832 == 19_968
    assert scene.faces.shape == (24 * 831, 4)
    curves = scene.system.positions[scene.visible].reshape(24, 832, 3)
    # Along a curve x goes from end to end, and neighbours on the curve are the nearest points.
    np.testing.assert_allclose(curves[:, :, 0], np.broadcast_to(np.linspace(0, 20, 832), (24, 832)), atol=1e-12)
    assert scene.frames >= 60
    points = build("cube-rope", rings=9, sides=16, thickness=0.5, turns=0.5).system.positions.reshape(16, 9, 3)
    first, last = points[:, 0, 1:], points[:, -1, 1:]
    np.testing.assert_allclose(np.abs(first).max(axis=1), 0.25, atol=1e-12)
    np.testing.assert_allclose(last, -first, atol=1e-12)


@pytest.mark.parametrize(
    ("name", "options", "vertices", "faces"),
    [
        ("cube-rope", {"rings": 50, "sides": 12}, 600, 12 * 49),
        ("cube-rope", {"rings": 50, "sides": 12, "faces": "triangles"}, 600, 2 * 12 * 49),
        ("cloth", {"columns": 20, "rows": 30}, 600, 19 * 29),
        ("cloth", {"columns": 20, "rows": 30, "faces": "triangles"}, 600, 2 * 19 * 29),
        ("flag", {"columns": 7, "rows": 5}, 35, 24),
        ("jelly", {"cells": 4}, 5**3 - 3**3, 6 * 16),
        ("jelly", {"cells": 4, "faces": "triangles"}, 5**3 - 3**3, 2 * 6 * 16),
    ],
)
def test_options_give_the_size(name: str, options: dict[str, Any], vertices: int, faces: int) -> None:
    simulation = build(name, **options).simulate(frames=2)
    assert simulation.vertex_count == vertices
    assert simulation.connectivity.face_count == faces
    assert set(simulation.connectivity.face_counts) == {3 if options.get("faces") == "triangles" else 4}
    assert simulation.read_frames(0, 2).shape == (2, vertices, 3)


@pytest.mark.parametrize(
    ("name", "options"),
    [
        ("cube-rope", {"rings": 3, "sides": 4}),
        ("cloth", {"columns": 2, "rows": 2}),
        ("cloth", {"columns": 2, "rows": 2, "drape": "sphere"}),
        ("flag", {"columns": 2, "rows": 2}),
        ("jelly", {"cells": 1}),
        ("jelly", {"cells": 3, "material": "springs", "size": 0.05}),
        ("cube-rope", {"rings": 30, "sides": 8, "length": 0.5, "thickness": 0.02, "shake": 0.02}),
    ],
)
def test_the_smallest_sizes_and_other_scales_work(name: str, options: dict[str, Any]) -> None:
    points = build(name, **options).simulate(frames=20).to_array().points
    extent = np.linalg.norm(np.ptp(points[0], axis=0))
    assert np.linalg.norm(points[-1] - points[-1].mean(axis=0), axis=1).max() < 1.5 * extent
    assert np.abs(points[-1] - points[0]).max() > 1e-3 * extent


def test_times_metadata_and_names_are_filled_in() -> None:
    simulation = build("flag", **SMALL["flag"]).simulate(frames=5, fps=30, substeps=4)
    np.testing.assert_allclose(simulation.times, np.arange(5) / 30)
    assert (simulation.fps, simulation.objects[0].name) == (30, "flag")
    assert {"up_axis": "Y", "unit": "m"}.items() <= simulation.metadata.items()
    assert "4 substeps" in simulation.metadata["source"]
    simulation.read_frames(4, 5)
    assert simulation.solver.time == pytest.approx(4 / 30)


def test_substeps_keep_their_length_at_another_frame_rate() -> None:
    slow, fast = (build("cloth", **SMALL["cloth"]).simulate(fps=fps).solver.substep for fps in (24, 96))
    assert slow == pytest.approx(fast)


@pytest.mark.parametrize("faces", ["quads", "triangles"])
def test_the_surface_of_the_jelly_is_closed_and_faces_outwards(faces: str) -> None:
    scene = build("jelly", cells=3, size=2.0, faces=faces)
    points = scene.system.positions[scene.visible]
    size = scene.faces.shape[1]
    triangles = np.concatenate([scene.faces[:, [0, k, k + 1]] for k in range(1, size - 1)])
    assert np.linalg.det((points - points.mean(axis=0))[triangles]).sum() / 6 == pytest.approx(8.0)
    edges = np.concatenate([scene.faces[:, [k, (k + 1) % size]] for k in range(size)])
    one_way = {tuple(edge) for edge in edges.tolist()}
    assert len(one_way) == len(edges)
    assert {(b, a) for a, b in one_way} == one_way


def test_tetrahedra_fill_the_lattice_and_match_at_its_faces() -> None:
    points = np.stack(np.meshgrid(*[np.arange(4.0)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)
    tetrahedra = lattice_tetrahedra(3)
    volumes = tetrahedron_volumes(points, tetrahedra)
    assert volumes.min() > 0.16
    assert volumes.sum() == pytest.approx(27)
    faces = np.sort(np.concatenate([np.delete(tetrahedra, k, axis=1) for k in range(4)]), axis=1)
    _, counts = np.unique(faces, axis=0, return_counts=True)
    assert (counts == 1).sum() == 2 * len(lattice_surface(3))
    assert set(counts) == {1, 2}


def test_bending_stencils_are_the_inner_edges() -> None:
    stencils = bending_stencils(triangulate(grid_quads(3, 2)))
    # Two quads: two diagonals, which alternate, and the edge between the quads.
    assert [tuple(edge) for edge in stencils[:, :2].tolist()] == [(0, 4), (1, 4), (2, 4)]


@pytest.mark.parametrize("name", SCENES)
def test_every_scene_moves_and_stays_in_bounds_under_both_methods(name: str) -> None:
    scene = build(name, **SMALL[name])
    diagonal = np.linalg.norm(np.ptp(scene.system.positions, axis=0))
    ends = {}
    for method in ("xpbd", "pbd"):
        points = scene.simulate(frames=30, method=method).to_array().points
        moved = np.linalg.norm(points[-1] - points[0], axis=1).max()
        assert 0.1 * diagonal < moved < 3 * diagonal
        steps = np.linalg.norm(np.diff(points, axis=0), axis=2)
        assert steps.max() < 0.5 * diagonal
        ends[method] = points[-1]
    assert np.abs(ends["xpbd"] - ends["pbd"]).max() > 1e-4 * diagonal


@pytest.mark.parametrize("name", SCENES)
def test_frames_are_the_same_bits_however_they_are_read(name: str) -> None:
    scene = build(name, **SMALL[name])
    whole = scene.simulate(frames=8).read_frames(0, 8)
    by_blocks = np.concatenate([block for _, block in scene.simulate(frames=8).blocks(3)])
    backwards = scene.simulate(frames=8)
    assert whole.tobytes() == by_blocks.tobytes()
    assert backwards.read_frames(7, 8).tobytes() == whole[7:].tobytes()
    assert backwards.read_frames(0, 2).tobytes() == whole[:2].tobytes()
    assert backwards.read_frames(3, 3).shape == (0, scene.visible.size, 3)


@pytest.mark.parametrize("method", ["xpbd", "pbd"])
def test_substeps_in_one_call_give_the_bits_of_single_ones(method: Method) -> None:
    system = build("cloth", **SMALL["cloth"]).system
    # The ground is too far away to be hit, but contacts are checked after each iteration.
    watched = replace(system, colliders=(Ground(height=-1e6),))
    solvers = [Solver(item, substep=2e-3, iterations=2, method=method) for item in (system, system, watched)]
    solvers[0].advance(30)
    for solver in solvers[1:]:
        for _ in range(30):
            solver.advance()
        for name in ("positions", "previous", "velocities", "time"):
            np.testing.assert_array_equal(getattr(solver, name), getattr(solvers[0], name))
        for found, expected in zip(solver.multipliers, solvers[0].multipliers, strict=True):
            np.testing.assert_array_equal(found, expected)
            assert np.abs(found).max() > 0


def test_another_process_gives_the_same_bits() -> None:
    for name in ("jelly", "flag"):
        script = (
            f"import hashlib; from pdecodec.simulate.scenes import build; scene = build({name!r}, **{SMALL[name]});"
            "print(hashlib.sha256(scene.simulate(frames=10).read_frames(0, 10).tobytes()).hexdigest())"
        )
        command, root = [sys.executable, "-c", script], Path(__file__).resolve().parents[2]
        environment = {**os.environ, "PYTHONHASHSEED": "1"}  # in a process that iterates over sets in another order
        found = subprocess.run(command, capture_output=True, text=True, check=True, cwd=root, env=environment).stdout
        own = build(name, **SMALL[name]).simulate(frames=10).read_frames(0, 10)
        assert found.strip() == hashlib.sha256(own.tobytes()).hexdigest()


def test_the_rope_keeps_its_section_and_is_not_turned_inside_out() -> None:
    sides, rings = 8, 60
    simulation = build("cube-rope", rings=rings, sides=sides).simulate(frames=60)
    faces = simulation.scene.faces
    for _, block in simulation.blocks(20):
        for points in block.astype(np.float64):
            curves = points.reshape(sides, rings, 3)
            width = np.linalg.norm(curves[: sides // 2] - curves[sides // 2 :], axis=2)
            np.testing.assert_allclose(width, np.broadcast_to(width[:, :1], width.shape), rtol=0.1)
            centers = curves.mean(axis=0)
            corners = points[faces]
            normals = np.cross(corners[:, 2] - corners[:, 0], corners[:, 3] - corners[:, 1])
            ring = faces.min(axis=1) % rings
            outwards = corners.mean(axis=1) - 0.5 * (centers[ring] + centers[np.minimum(ring + 1, rings - 1)])
            assert (np.einsum("ij,ij->i", normals, outwards) > 0).all()
    solver = simulation.solver
    links = [batch for batch in solver.system.constraints if isinstance(batch, ChainConstraints)]
    for batch in links:
        assert np.abs(batch.lengths_at(solver.positions) / batch.lengths - 1).max() < 0.5
    assert links


def test_held_ends_of_the_rope_stay_held() -> None:
    for hold, held in (("one", 1), ("both", 2)):
        simulation = build("cube-rope", rings=40, sides=8, hold=hold, shake=0.0).simulate(frames=40)
        points = simulation.to_array().points.reshape(40, 8, 40, 3)
        fallen = points[0, :, :, 1].mean(axis=0) - points[-1, :, :, 1].mean(axis=0)
        assert (np.abs(fallen[[0, -1]]) < 1e-5).sum() == held
        assert fallen.max() > 1.0


def test_a_draped_cloth_rests_on_the_sphere() -> None:
    scene = build("cloth", columns=30, rows=30, drape="sphere")
    last = scene.simulate(frames=80).to_array().points[-2:].astype(np.float64)
    ball, ground = scene.system.colliders
    distances = np.linalg.norm(last[-1] - np.array(ball.center), axis=1)
    assert distances.min() > ball.radius
    assert (distances < ball.radius + 1.01 * ball.thickness).sum() > 50
    assert last[-1][:, 1].min() >= ground.height
    assert np.linalg.norm(last[-1] - last[-2], axis=1).mean() < 0.02


def test_the_falling_jelly_recovers_from_its_impacts() -> None:
    scene = build("jelly", cells=4)
    simulation = scene.simulate(frames=140)
    cells = scene.system.constraints[0].particles
    rest = tetrahedron_volumes(scene.system.positions, cells)
    lowest = []
    for frame in range(140):
        simulation.read_frames(frame, frame + 1)
        shares = tetrahedron_volumes(simulation.solver.positions, cells) / rest
        # Only the corner that strikes the ground is flattened.
        assert (shares < 0.1).mean() < 0.02
        lowest.append(simulation.solver.positions[:, 1].min())
    assert min(lowest) == 0
    assert shares.min() > 0.8
    assert shares.mean() == pytest.approx(1, abs=0.02)


def test_the_flag_is_carried_downwind() -> None:
    options = SMALL["flag"]
    still = build("flag", **options, wind=0.0).simulate(frames=60).to_array().points
    blown = build("flag", **options, wind=12.0).simulate(frames=60).to_array().points
    np.testing.assert_array_equal(still[..., 2], 0)
    free_end = blown[30:, np.arange(12 * 9) % 12 == 11]
    # The wind blows along x, and a quarter as fast along z; gusts swing the free end about its mean.
    assert free_end[..., 2].mean() > 0.1
    assert free_end[..., 2].mean(axis=1).std() > 0.02
    assert free_end[..., 0].mean() > 1.0


def test_a_diverging_simulation_names_the_frame() -> None:
    scene = build("cube-rope", rings=40, sides=8)
    scene.system.velocities[5 * 40 + 5] = 1e300
    with pytest.raises(SettingsError, match=r"frame 1: the simulation ran off .* more substeps"):
        scene.simulate(frames=3).read_frames(0, 3)


def test_options_explain_themselves() -> None:
    for entry in SCENES.values():
        assert entry.description.endswith(".")
        for option in entry.options:
            assert option.help
            assert isinstance(option.default, (int, float, str))
            assert not option.choices or option.default in option.choices


@pytest.mark.parametrize(
    ("name", "options", "request_", "message"),
    [
        ("teapot", {}, {}, "unknown scene 'teapot'; choose from cube-rope, cloth, flag, jelly"),
        ("cloth", {"rings": 5}, {}, "scene cloth has no option 'rings'; choose from columns, rows"),
        ("cloth", {"columns": 1}, {}, "columns must be 2 to 10000, not 1"),
        ("cloth", {"columns": 2.5}, {}, "columns must be a whole number, not 2.5"),
        ("cloth", {"columns": True}, {}, "columns must be a whole number, not True"),
        ("cloth", {"size": "large"}, {}, "size must be a number, not 'large'"),
        ("cloth", {"size": float("nan")}, {}, "size must be 0.01 to 1000, not nan"),
        ("cloth", {"drape": "wall"}, {}, "drape must be one of corners, sphere, not 'wall'"),
        ("cloth", {"columns": 9000, "rows": 9000}, {}, "81000000 particles; the most is"),
        ("cube-rope", {"sides": 10}, {}, "sides must be a multiple of 4, not 10"),
        ("jelly", {"poisson": 0.5}, {}, "poisson must be 0 to 0.49"),
        ("flag", {"wind": -1.0}, {}, "wind must be 0 to 50"),
        ("flag", SMALL["flag"], {"frames": 0}, "frames must be 1 or more"),
        ("flag", SMALL["flag"], {"fps": 0.0}, "fps must be"),
        ("flag", SMALL["flag"], {"fps": float("inf")}, "fps must be"),
        ("flag", SMALL["flag"], {"substeps": 0}, "substeps must be 1 to"),
    ],
)
def test_invalid_arguments_are_refused_in_one_line(
    name: str, options: dict[str, Any], request_: dict[str, Any], message: str
) -> None:
    with pytest.raises(SettingsError) as caught:
        build(name, **options).simulate(**request_)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)
