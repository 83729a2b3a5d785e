"""Positions with more digits than float32: how far rounding moves them is recorded, and reported where it matters."""

from __future__ import annotations

import json
from pathlib import Path

import h5py
import numpy as np
import pytest
from plyfile import PlyData, PlyElement

from pdecodec import ArraySequence, encode
from pdecodec.cli.main import run
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.scene_space import place
from pdecodec.formats.base.transforms import bake_transforms, transform_attribute
from pdecodec.mesh.rounding import rounding_noticed, to_float32
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import Connectivity, MeshObject

FAR = 2.0**20
"""A coordinate at which neighbouring float32 numbers differ by an eighth."""

POINTS = FAR + np.random.default_rng(7).uniform(0, 4, size=(5, 30, 3))

LARGEST = float(np.linalg.norm(POINTS - POINTS.astype(np.float32), axis=2).max())


def written(folder: Path, kind: str, points: np.ndarray = POINTS) -> Path:
    """Write a file of float64 positions."""
    if kind == "npz":
        np.savez(folder / "a.npz", points=points)
    elif kind == "h5":
        with h5py.File(folder / "a.h5", "w") as file:
            file["points"] = points
    for frame, rows in enumerate(points):
        path = folder / f"a.{frame:04d}.{kind}"
        if kind == "obj":
            path.write_text("".join(f"v {x!r} {y!r} {z!r}\n" for x, y, z in rows.tolist()))
        elif kind == "ply":
            vertices = np.rec.fromarrays(rows.T, names="x,y,z")
            PlyData([PlyElement.describe(np.asarray(vertices), "vertex")]).write(str(path))
        elif kind == "off":
            lines = [f"OFF\n{len(rows)} 0 0", *(f"{x!r} {y!r} {z!r}" for x, y, z in rows.tolist())]
            path.write_text("\n".join(lines) + "\n")
        elif kind == "stl":
            corners = [f"vertex {x!r} {y!r} {z!r}\n" for x, y, z in rows.tolist()]
            facets = [
                "facet\nouter loop\n" + "".join(corners[k : k + 3]) + "endloop\nendfacet\n" for k in range(0, 30, 3)
            ]
            path.write_text("solid a\n" + "".join(facets) + "endsolid a\n")
    return folder / (f"a.{kind}" if kind in ("npz", "h5") else f"a.####.{kind}")


@pytest.mark.parametrize("kind", ["npz", "h5", "obj", "ply", "off", "stl"])
def test_readers_note_how_far_rounding_moves_positions(tmp_path: Path, kind: str) -> None:
    with open_sequence(written(tmp_path, kind)) as read, rounding_noticed() as rounding:
        found = read.read_frames(0, 5)
    assert np.array_equal(found, POINTS.astype(np.float32))
    assert rounding.largest == pytest.approx(LARGEST, rel=1e-12)


def test_rounding_is_noted_through_any_wrapper_of_a_sequence(tmp_path: Path) -> None:
    for source in (ArraySequence(POINTS), open_sequence(written(tmp_path, "npz"), isolate=True)):
        with source, rounding_noticed() as rounding:
            place(FrameSelection(source, range(5)), scale=0.5).read_frames(0, 5)
        assert rounding.largest == pytest.approx(LARGEST / 2, rel=1e-12)


@pytest.mark.parametrize("dtype", [np.float32, ">f4", np.float16, np.int16])
def test_values_that_float32_holds_are_not_rounded(dtype: str) -> None:
    with rounding_noticed() as rounding:
        assert to_float32((POINTS - FAR).astype(dtype)).dtype == np.float32
    assert rounding.largest == 0


def test_transforms_that_move_far_away_are_noted() -> None:
    matrices = np.eye(4)[None].copy()
    matrices[:, 3, :3] = FAR
    item = MeshObject("a", Connectivity(30), (transform_attribute([0.0], matrices),))
    near = (POINTS - FAR).astype(np.float32)
    with rounding_noticed() as rounding:
        moved = bake_transforms(ArraySequence(near, objects=[item])).read_frames(0, 5)
    assert rounding.largest == pytest.approx(np.linalg.norm(near.astype(np.float64) + FAR - moved, axis=2).max())
    assert rounding.largest > 0.05


def test_text_of_float32_numbers_stands_for_these(tmp_path: Path) -> None:
    write_sequence(ArraySequence(POINTS.astype(np.float32)), tmp_path / "a.####.obj")
    for frame, rows in enumerate(POINTS.astype(np.float32).astype(str)):
        (tmp_path / f"b.{frame}.off").write_text("OFF 30 0 0\n" + "".join(f"{' '.join(row)}\n" for row in rows))
    for name in ("a.####.obj", "b.#.off"):
        with open_sequence(tmp_path / name) as read, rounding_noticed() as rounding:
            assert np.array_equal(read.read_frames(0, 5), POINTS.astype(np.float32))
        assert rounding.largest == 0


def test_the_report_states_rounding_and_the_bound_counts_from_float32() -> None:
    report = encode(ArraySequence(POINTS), tolerance=1e-3)
    assert report.rounding == pytest.approx(LARGEST, rel=1e-12)
    assert report.max_error <= report.bound < report.rounding
    assert [("more than the bound" in warning) for warning in report.warnings] == [True]
    assert not encode(ArraySequence(POINTS), tolerance=0.1).warnings
    assert encode(ArraySequence(POINTS.astype(np.float32))).rounding == 0


def test_a_line_warns_where_rounding_alone_takes_more_than_the_bound(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    source, output = str(written(tmp_path, "npz")), str(tmp_path / "a.pdeanim")
    assert run(["encode", source, output, "--json"]) == 0
    out, said = capsys.readouterr()
    assert json.loads(out)["rounding"] == pytest.approx(LARGEST, rel=1e-12)
    assert f"warning: positions are rounded to float32, which moves them by up to {LARGEST:.3g} scene units" in said
    assert run(["encode", source, output, "--tolerance", "0.1", "--overwrite"]) == 0
    assert "float32" not in capsys.readouterr().err


@pytest.mark.parametrize("far", [True, False])
def test_conversion_and_comparison_tell_of_rounding_far_from_the_origin(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], far: bool
) -> None:
    source = str(written(tmp_path, "npz", POINTS if far else POINTS - FAR))
    assert run(["convert", source, str(tmp_path / "b.h5")]) == 0
    assert ("positions are rounded to float32" in capsys.readouterr().err) == far
    assert run(["compare", source, str(tmp_path / "b.h5")]) == 0
    assert ("positions are rounded to float32" in capsys.readouterr().err) == far


def test_a_batch_notes_where_rounding_takes_more_than_the_bound(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("clips").mkdir()
    for name, points in (("far", POINTS), ("near", POINTS - FAR)):
        written(tmp_path, "npz", points).rename(f"clips/{name}.npz")
    assert run(["batch", "clips", "-o", "out", "--jobs", "1", "--json", "-v"]) == 0
    out, said = capsys.readouterr()
    notes = {row["source"]: " ".join(row["notes"]) for row in json.loads(out)["clips"]}
    assert "rounded to float32" in notes["clips/far.npz"]
    assert "rounded to float32" not in notes["clips/near.npz"]
    assert "far.pdeanim: note: positions are rounded" in said
    assert "warning: rounding to float32 exceeds the bound of 1 clip; -v lists them" in said
