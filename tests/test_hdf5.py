"""HDF5 files: ours give everything back, plain ones are understood, broken ones are refused."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from sequence_cases import assert_same_sequence, rich_sequence, sequences

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.hdf5 import CHUNK_BYTES, chunk_shape
from pdecodec.sequence import ArraySequence, Connectivity

POINTS = np.arange(2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3)


def save(path: Path, **datasets: Any) -> Path:
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            file[name] = values
    return path


def test_everything_comes_back(tmp_path: Path):
    write_sequence(rich_sequence(), tmp_path / "x.h5")
    with open_sequence(tmp_path / "x.h5") as read:
        assert_same_sequence(read, rich_sequence())


@settings(deadline=None, max_examples=40)
@given(sequences())
def test_any_sequence_comes_back(tmp_path_factory: pytest.TempPathFactory, sequence: ArraySequence):
    path = tmp_path_factory.mktemp("any") / "x.hdf5"
    write_sequence(sequence, path)
    with open_sequence(path) as read:
        assert_same_sequence(read, sequence)


def test_the_file_holds_no_date(tmp_path: Path):
    write_sequence(rich_sequence(), tmp_path / "x.h5")
    with h5py.File(tmp_path / "x.h5") as file:
        dated: list[str] = []
        file.visititems(
            lambda name, item: (
                dated.append(name) if isinstance(item, h5py.Dataset) and h5py.h5o.get_info(item.id).mtime else None
            )
        )
    assert dated == []


def test_the_same_sequence_gives_the_same_bytes(tmp_path: Path):
    for name in ("one.h5", "two.h5"):
        write_sequence(rich_sequence(), tmp_path / name)
    assert (tmp_path / "one.h5").read_bytes() == (tmp_path / "two.h5").read_bytes()


@pytest.mark.parametrize(
    ("frames", "vertices", "chunk"),
    [
        (1000, 100, (873, 100, 3)),
        (10, 100, (10, 100, 3)),
        (1000, 20_000, (4, 20_000, 3)),
        (5, 1_000_000, (1, CHUNK_BYTES // 12, 3)),
        (1, 1, (1, 1, 3)),
    ],
)
def test_a_chunk_is_whole_frames_of_about_a_mebibyte(frames: int, vertices: int, chunk: tuple[int, int, int]):
    assert chunk_shape(frames, vertices) == chunk
    assert np.prod(chunk) * 4 <= CHUNK_BYTES


def test_a_plain_file_is_understood(tmp_path: Path):
    path = save(tmp_path / "x.h5", points=POINTS.astype(">f8"), faces=[[0, 1, 2], [0, 1, -1]], times=[1.0, 1.5], mass=2)
    with open_sequence(path) as sequence:
        assert np.array_equal(sequence.read_frames(0, 2), POINTS)
        assert np.array_equal(sequence.read_frames(1, 2), POINTS[1:])
        assert sequence.connectivity.face_indices.tolist() == [0, 1, 2]
        assert sequence.connectivity.line_indices.tolist() == [0, 1]
        assert sequence.times.tolist() == [1.0, 1.5]
        assert sequence.notices == ("datasets not kept: mass",)


def test_points_alone_are_enough_and_the_rate_is_said_aloud(tmp_path: Path):
    with open_sequence(save(tmp_path / "x.h5", points=POINTS)) as sequence:
        assert sequence.connectivity.same_as(Connectivity(4))
        assert sequence.notices == ("assumed 24 frames per second; pass --fps to change",)


@pytest.mark.parametrize(
    ("datasets", "message"),
    [
        ({"vertices": POINTS}, r"there is no dataset named points \(it holds vertices\)"),
        ({}, r"there is no dataset named points \(it holds nothing\)"),
        ({"points/inner": POINTS}, "there is no dataset named points"),
        ({"points": POINTS[0]}, r"shape \(frames, vertices, 3\), not float32 \(4, 3\)"),
        ({"points": "text"}, r"shape \(frames, vertices, 3\), not object \(\)"),
        ({"points": POINTS[:, :0]}, "points have no vertices"),
        ({"points": POINTS[:0]}, "there are no frames"),
        ({"points": POINTS, "faces": [[0, 1, 9]]}, "face 0 refers to vertex 9"),
        ({"points": POINTS, "times": [1.0, 0.0]}, "times must increase"),
        ({"points": POINTS, "times": "soon"}, "times must be numbers"),
        ({"points": POINTS, "objects/0/name": "a"}, "objects/0/vertex_count is missing"),
    ],
)
def test_datasets_that_do_not_fit_are_refused(tmp_path: Path, datasets: dict[str, Any], message: str):
    path = save(tmp_path / "x.h5", **datasets)
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(path)
    assert caught.value.path == str(path)


@pytest.mark.parametrize("content", [b"", b"\x89HDF\r\n\x1a\n", b"\x89HDF\r\n\x1a\n" + bytes(500), b"text" * 100])
def test_what_is_not_hdf5_is_refused_in_one_line(tmp_path: Path, content: bytes):
    (tmp_path / "x.h5").write_bytes(content)
    with pytest.raises(InputError, match="cannot be read as HDF5") as caught:
        open_sequence(tmp_path / "x.h5")
    assert "\n" not in str(caught.value)


def test_a_file_cut_anywhere_is_refused(tmp_path: Path):
    write_sequence(ArraySequence(np.ones((300, 40, 3))), tmp_path / "whole.h5")
    whole = (tmp_path / "whole.h5").read_bytes()
    for length in range(0, len(whole), max(1, len(whole) // 60)):
        (tmp_path / "x.h5").write_bytes(whole[:length])
        with pytest.raises(InputError):
            open_sequence(tmp_path / "x.h5")


def test_reading_after_close_is_an_error_of_ours(tmp_path: Path):
    sequence = open_sequence(save(tmp_path / "x.h5", points=POINTS, fps=24.0))
    sequence.close()
    with pytest.raises(InputError, match="cannot be read as HDF5"):
        sequence.read_frames(0, 1)


def test_a_file_that_is_there_is_replaced_only_on_request(tmp_path: Path):
    path = tmp_path / "x.h5"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_sequence(rich_sequence(), path)
    assert path.read_text() == "mine"
    write_sequence(rich_sequence(), path, overwrite=True)
    with open_sequence(path) as read:
        assert_same_sequence(read, rich_sequence())


def test_a_source_that_fails_leaves_nothing_behind(tmp_path: Path):
    class Failing(ArraySequence):
        def read_frames(self, start: int, stop: int) -> np.ndarray:
            raise InputError("the source broke", frame=start)

    with pytest.raises(InputError, match="the source broke"):
        write_sequence(Failing(POINTS), tmp_path / "x.h5")
    assert list(tmp_path.iterdir()) == []


def test_a_sequence_is_written_by_blocks_of_whole_chunks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pdecodec.sequence.BLOCK_BYTES", 5 * 12 * 7)
    monkeypatch.setattr("pdecodec.formats.hdf5.CHUNK_BYTES", 2 * 12 * 7)
    told: list[int] = []
    source = rich_sequence(7)
    write_sequence(source, tmp_path / "x.h5", progress=lambda done, total, what: told.append(done))
    assert told == [4, 7]
    with open_sequence(tmp_path / "x.h5") as read:
        assert np.array_equal(read.read_frames(0, 7), source.points)
        assert np.array_equal(read.read_frames(3, 5), source.points[3:5])
