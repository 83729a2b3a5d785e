"""The corpus table holds what was measured on decoded files."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from mesh_cases import grid

from pdecodec.experiments.corpus import main, measure
from pdecodec.formats import write_sequence
from pdecodec.sequence import ArraySequence, MeshObject
from pdecodec.settings import EncodeSettings


def write_wave(path: Path) -> None:
    u = np.linspace(0, 1, 40)
    times = np.arange(16) / 24.0
    points = np.zeros((16, 5, 40, 3))
    points[..., 0] = u
    points[..., 1] = 0.2 * np.arange(5)[:, None]
    points[..., 2] = 0.1 * np.sin(5 * u - 6 * times[:, None])[:, None]
    sheet = MeshObject("sheet", grid(5, 40))
    write_sequence(ArraySequence(points.reshape(16, -1, 3), objects=[sheet], times=times), path)


def test_a_row_keeps_the_tolerance_and_counts_the_whole_file(tmp_path: Path) -> None:
    write_wave(tmp_path / "wave.npz")
    row = measure(tmp_path / "wave.npz", EncodeSettings(tolerance=2e-3))
    assert (row.name, row.frames, row.vertices) == ("wave", 16, 200)
    assert 0 < row.rms_error < row.max_error <= 2e-3
    assert 0.8 * 96 / row.bpvf < row.ratio < 96 / row.bpvf  # connectivity counts in the one and not in the other


def test_the_table_has_a_row_a_sequence_and_their_mean(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for name in ("first.npz", "second.npz"):
        write_wave(tmp_path / name)
    assert main([str(tmp_path)]) == 0
    rows = capsys.readouterr().out.splitlines()
    assert [row.split("|")[1].strip() for row in rows] == ["sequence", "---", "first", "second", "geometric mean"]


def test_a_folder_without_sequences_is_bad_input(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main([str(tmp_path)]) == 3
    assert "no .npz sequence" in capsys.readouterr().err
