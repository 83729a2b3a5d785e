"""The benchmark of rate and distortion measures decoded bytes, checks the bound itself, and keeps what peers took."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from mesh_cases import grid

from pdecodec.encoder import encode
from pdecodec.experiments import rate_distortion
from pdecodec.experiments.rate_distortion import (
    BetweenRow,
    Row,
    cubic_spline,
    find_sources,
    line_of,
    line_of_between,
    main,
    mean_ratios,
    measure,
    measure_between,
)
from pdecodec.formats import write_sequence
from pdecodec.peers.delta import QuantiseDelta
from pdecodec.peers.kept import PeerCell
from pdecodec.peers.raw import RawFloat32
from pdecodec.sequence import ArraySequence, MeshObject

PEERS = (RawFloat32(), QuantiseDelta())


def wave_sequence(frames: int = 16) -> ArraySequence:
    u, times = np.linspace(0, 1, 40), np.arange(frames) / 24.0
    points = np.zeros((frames, 5, 40, 3))
    points[..., 0] = u
    points[..., 1] = 0.2 * np.arange(5)[:, None]
    points[..., 2] = 0.1 * np.sin(5 * u - 6 * times[:, None])[:, None]
    return ArraySequence(points.reshape(frames, -1, 3), objects=[MeshObject("sheet", grid(5, 40))], times=times)


ROW = Row("a", 10, 20, 1e-3, 2.0, 9e-4, 3e-4, 0.1, True, 5.0, 12.0, "because", {})

CELLS = (
    PeerCell("coarse", published=True, reason="too coarse"),
    PeerCell("plain", published=True, bpvf=5.0),
    PeerCell("improved", published=False, bpvf=4.0),
)


def test_a_row_keeps_the_tolerance_and_counts_all_but_connectivity_and_attributes() -> None:
    sequence = wave_sequence()
    row = measure("wave", sequence, tolerance=2e-3, effort=1)
    sections = encode(sequence, tolerance=2e-3, effort=1).sections
    counted = sum(sections.values()) - sections["CONN"] - sections.get("ORDR", 0)
    assert (row.sequence, row.frames, row.vertices) == ("wave", 16, 200)
    assert row.bound_holds
    assert 0 < row.rms_error < row.max_error <= 2e-3
    assert row.bpvf == pytest.approx(8 * counted / (16 * 200))
    assert row.sections == sections


def test_the_best_peer_is_the_smallest_that_reaches_the_tolerance() -> None:
    row = replace(ROW, peers=CELLS)
    found = [row.best_peer(published=published) for published in (False, True)]
    assert [None if cell is None else cell.peer for cell in found] == ["improved", "plain"]
    assert replace(ROW, peers=CELLS[:1]).best_peer(published=False) is None


def test_a_line_has_rate_errors_speed_and_both_ratios() -> None:
    assert line_of(replace(ROW, peers=CELLS, peers_measured=1), with_peers=True) == (
        "| a | 0.001 | 2.000 | 0.900 | 3.0e-04 | 0.100 | 5.0 | 12.0 | improved | 4.000 | 0.50 | plain | 5.000 | 0.40 "
        "| 1, 2 |"
    )
    assert line_of(replace(ROW, kg_error=None), with_peers=False) == (
        "| a | 0.001 | 2.000 | 0.900 | 3.0e-04 | - | 5.0 | 12.0 |"
    )
    assert "| none |  |  | none |" in line_of(replace(ROW, peers=CELLS[:1]), with_peers=True)


def test_a_broken_bound_is_said_in_its_line() -> None:
    assert "1.200 BROKEN" in line_of(replace(ROW, max_error=1.2e-3, bound_holds=False), with_peers=False)


def test_ratios_are_averaged_geometrically_tolerance_by_tolerance() -> None:
    rows = [replace(ROW, bpvf=bpvf, peers=CELLS) for bpvf in (1.0, 4.0)]
    assert mean_ratios([*rows, replace(ROW, tolerance=0.5)]) == ["0.001: 0.50 times the best peer, mean of 2 sequences"]


def test_the_spline_is_exact_on_cubic_motion_at_uneven_times() -> None:
    knots, times = np.array([0.0, 0.5, 0.8, 1.7, 2.0]), np.array([0.1, 0.7, 1.0, 1.9])

    def motion(t: np.ndarray) -> np.ndarray:
        return np.stack([t**3 - t, 2 * t**2, 1 + t], axis=-1)[:, None, :]

    found = cubic_spline(knots, motion(knots).astype(np.float32), times)
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, motion(times), atol=2e-6)


def test_between_frames_both_errors_are_measured_at_the_frames_left_out() -> None:
    row = measure_between("wave", wave_sequence(16), effort=1)
    assert row is not None
    assert row.frames == 7  # 1, 3 ... 13: the last frame kept is 14
    assert 0 < row.spline_rms_error <= row.spline_max_error < 1e-3
    assert 0 < row.rms_error <= row.max_error < 5e-2


@pytest.mark.parametrize("frames", [1, 2])
def test_clips_without_a_frame_between_two_kept_have_no_such_row(frames: int) -> None:
    assert measure_between("short", wave_sequence(frames), effort=1) is None


def test_a_line_between_frames_has_both_ratios_or_none_where_the_spline_is_exact() -> None:
    row = BetweenRow("a", 7, 1e-4, 2e-4, 2e-4, 0.0)
    assert line_of_between(row) == "| a | 7 | 1.00e-04 | 2.00e-04 | 0.500 | 2.00e-04 | 0.00e+00 | - |"


def test_sources_are_the_files_given_or_those_of_the_data_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "sequences").mkdir()
    inside = [tmp_path / "sequences" / name for name in ("a.npz", "b.npz")]
    for path in inside:
        path.touch()
    monkeypatch.delenv("PDECODEC_DATA", raising=False)
    assert find_sources([]) == []
    monkeypatch.setenv("PDECODEC_DATA", str(tmp_path))
    assert find_sources([]) == inside
    assert find_sources([tmp_path / "x.obj", tmp_path / "sequences"]) == [tmp_path / "x.obj", *inside]


def test_tables_and_json_come_out_and_peers_are_measured_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rate_distortion, "available_peers", lambda: (PEERS, ("zfp needs zfpy",)))
    write_sequence(wave_sequence(), tmp_path / "wave.npz")
    arguments = ["--sequences", str(tmp_path / "wave.npz"), "--tolerance", "0.01", "0.001", "--effort", "1"]
    arguments += ["--kept", str(tmp_path / "cells.json"), "--json", str(tmp_path / "out.json")]
    for said in ("4 measured now, 0 kept", "0 measured now, 4 kept"):
        assert main(arguments) == 0
        text = capsys.readouterr().out
        assert said in text
        assert text.splitlines()[0] == "not measured: zfp needs zfpy"
        assert [line.count("|") for line in text.splitlines() if line.startswith("| wave |")] == [16, 16, 9]
    assert main([*arguments, "--fresh"]) == 0
    assert "4 measured now" in capsys.readouterr().out
    written = json.loads((tmp_path / "out.json").read_text(encoding="utf-8"))
    assert [row["tolerance"] for row in written["rows"]] == [0.01, 0.001]
    assert [cell["peer"] for cell in written["rows"][0]["peers"]] == [peer.name for peer in PEERS]
    assert written["between"][0]["frames"] == 7
    assert written["skipped"] == ["zfp needs zfpy"]


def test_without_peers_there_are_no_columns_for_them(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    write_sequence(wave_sequence(), tmp_path / "wave.npz")
    arguments = ["--sequences", str(tmp_path), "--tolerance", "0.01", "--effort", "1", "--no-peers"]
    assert main([*arguments, "--kept", str(tmp_path / "cells.json")]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.count("|") for line in lines[:3]] == [9, 9, 9]
    assert not (tmp_path / "cells.json").exists()


def test_a_broken_bound_fails_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(rate_distortion, "measure", lambda *_, **__: replace(ROW, bound_holds=False))
    write_sequence(wave_sequence(), tmp_path / "wave.npz")
    assert main(["--sequences", str(tmp_path), "--tolerance", "0.01", "--effort", "1", "--no-peers"]) == 1
    assert "BROKEN" in capsys.readouterr().out


@pytest.mark.parametrize(
    ("arguments", "code", "said"),
    [([], 3, "no .npz sequence"), (["none.npz"], 3, "none.npz"), (["wave.npz", "--tolerance", "-1"], 2, "tolerance")],
)
def test_what_cannot_be_measured_is_said_in_a_line(
    arguments: list[str], code: int, said: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    if arguments:
        write_sequence(wave_sequence(), tmp_path / "wave.npz")
        arguments = [str(tmp_path / arguments[0]), *arguments[1:]]
    assert main(["--sequences", *(arguments or [str(tmp_path)]), "--no-peers"]) == code
    assert said in capsys.readouterr().err
