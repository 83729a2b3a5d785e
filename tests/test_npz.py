"""NPZ archives: ours give everything back, plain ones are understood, broken ones are refused."""

from __future__ import annotations

import io
import zipfile
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from sequence_cases import assert_same_sequence, rich_sequence, sequences

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.sequence import ArraySequence, Connectivity, MeshObject

POINTS = np.arange(2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3)


def test_everything_comes_back(tmp_path: Path):
    write_sequence(rich_sequence(), tmp_path / "x.npz")
    assert_same_sequence(open_sequence(tmp_path / "x.npz"), rich_sequence())


@settings(deadline=None, max_examples=60)
@given(sequences())
def test_any_sequence_comes_back(tmp_path_factory: pytest.TempPathFactory, sequence: ArraySequence):
    path = tmp_path_factory.mktemp("any") / "x.npz"
    write_sequence(sequence, path)
    assert_same_sequence(open_sequence(path), sequence)


def test_the_same_sequence_gives_the_same_bytes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    write_sequence(rich_sequence(), tmp_path / "one.npz")
    monkeypatch.setattr("time.time", lambda: 4e9)
    write_sequence(rich_sequence(), tmp_path / "two.npz")
    assert (tmp_path / "one.npz").read_bytes() == (tmp_path / "two.npz").read_bytes()


def test_numpy_alone_reads_what_others_need(tmp_path: Path):
    padded = np.array([[0, 1, 2, 3], [0, 1, 2, -1], [2, 3, -1, -1]])
    item = MeshObject("a", Connectivity.from_padded(4, padded))
    write_sequence(ArraySequence(POINTS, objects=[item], fps=30), tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as archive:
        assert np.array_equal(archive["points"], POINTS)
        assert np.array_equal(archive["faces"], padded)
        assert archive["times"].tolist() == [0.0, 1 / 30]
        assert archive["fps"] == 30


@pytest.mark.parametrize(
    "connectivity",
    [
        Connectivity(4, line_counts=np.array([3]), line_indices=np.array([0, 1, 2])),
        Connectivity(4, face_counts=np.array([60, *[3] * 50]), face_indices=np.arange(210) % 4),
    ],
    ids=["a line of three points", "one wide face among many small ones"],
)
def test_padded_faces_are_left_out_where_they_would_mislead_or_grow(tmp_path: Path, connectivity: Connectivity):
    write_sequence(ArraySequence(POINTS, objects=[MeshObject("a", connectivity)]), tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as archive:
        assert "faces" not in archive.files
    assert open_sequence(tmp_path / "x.npz").connectivity.same_as(connectivity)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, ">f4", np.float16, np.int16])
@pytest.mark.parametrize("order", ["C", "F"])
def test_points_of_any_number_type_and_order_are_read(tmp_path: Path, save: Any, dtype: Any, order: str):
    save(tmp_path / "x.npz", points=np.asarray(POINTS.astype(dtype), order=order))  # type: ignore[call-overload]
    sequence = open_sequence(tmp_path / "x.npz")
    assert sequence.read_frames(0, 2).dtype == np.float32
    assert np.array_equal(sequence.read_frames(0, 2), POINTS)
    assert np.array_equal(sequence.read_frames(1, 2), POINTS[1:])
    assert sequence.read_frames(1, 1).shape == (0, 4, 3)


def test_a_plain_archive_is_understood(tmp_path: Path):
    faces = np.array([[0, 1, 2], [0, 1, -1]], np.int64)
    np.savez(tmp_path / "x.npz", points=POINTS, faces=faces, times=[1.0, 1.5], curve_counts=[4])
    sequence = open_sequence(tmp_path / "x.npz")
    assert sequence.connectivity.face_indices.tolist() == [0, 1, 2]
    assert sequence.connectivity.line_indices.tolist() == [0, 1]
    assert sequence.times.tolist() == [1.0, 1.5]
    assert sequence.fps == 2.0
    assert sequence.notices == ("arrays not kept: curve_counts",)


def test_points_alone_are_enough_and_the_rate_is_said_aloud(tmp_path: Path):
    np.savez(tmp_path / "x.npz", points=POINTS)
    sequence = open_sequence(tmp_path / "x.npz")
    assert sequence.connectivity.same_as(Connectivity(4))
    assert sequence.notices == ("assumed 24 frames per second; pass --fps to change",)
    given_rate = open_sequence(tmp_path / "x.npz", fps=10)
    assert (given_rate.times.tolist(), given_rate.notices) == ([0.0, 0.1], ())


def test_a_stored_rate_places_the_frames(tmp_path: Path):
    np.savez(tmp_path / "x.npz", points=POINTS, fps=50)
    sequence = open_sequence(tmp_path / "x.npz")
    assert (sequence.times.tolist(), sequence.fps, sequence.notices) == ([0.0, 0.02], 50.0, ())


def test_stored_times_are_kept_over_a_given_rate_with_a_notice(tmp_path: Path):
    np.savez(tmp_path / "x.npz", points=POINTS, times=[1.0, 1.5])
    sequence = open_sequence(tmp_path / "x.npz", fps=30)
    assert (sequence.times.tolist(), sequence.fps) == ([1.0, 1.5], 30.0)
    assert sequence.notices == (
        "the file stores its times, they are kept; 30 frames per second is only the nominal rate",
    )


@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        ({"vertices": POINTS}, r"there is no array named points \(it holds vertices\)"),
        ({}, r"there is no array named points \(it holds nothing\)"),
        ({"points": POINTS[0]}, r"shape \(frames, vertices, 3\), not float32 \(4, 3\)"),
        ({"points": POINTS[:, :, :2]}, r"not float32 \(2, 4, 2\)"),
        ({"points": POINTS.astype(complex)}, "not complex128"),
        ({"points": POINTS[:0]}, "there are no frames"),
        ({"points": POINTS[:, :0]}, "points have no vertices"),
        ({"points": POINTS, "times": [0.0]}, "there are 2 frames, but times have shape"),
        ({"points": POINTS, "times": [1.0, 0.0]}, "times must increase"),
        ({"points": POINTS, "times": ["a", "b"]}, "times must be numbers"),
        ({"points": POINTS, "fps": [1.0, 2.0]}, "fps must be one number"),
        ({"points": POINTS, "fps": -1.0}, "frames per second must be a positive number"),
        ({"points": POINTS, "faces": [[0, 1, 4]]}, "face 0 refers to vertex 4, but there are 4 vertices"),
        ({"points": POINTS, "faces": [[0.0, 1.0, 2.0]]}, "two-dimensional integer array"),
        ({"points": POINTS, "metadata": [1, 2]}, "metadata must be pairs of text"),
        ({"points": POINTS, "objects/0/name": "a"}, "objects/0/vertex_count is missing"),
        ({"points": POINTS, "objects/0/name": 7, "objects/0/vertex_count": 4}, "objects/0/face_counts is missing"),
        ({"points": POINTS, "objects/0/name": "a", "objects/0/vertex_count": -4}, "whole number, 0 or more"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, arrays: dict[str, Any], message: str):
    np.savez(tmp_path / "x.npz", **arrays)
    with pytest.raises(InputError, match=message) as caught:
        open_sequence(tmp_path / "x.npz")
    assert caught.value.path == str(tmp_path / "x.npz")


@pytest.mark.parametrize(
    ("name", "value", "message"),
    [
        ("objects/0/name", 3, "objects/0/name must be text"),
        ("objects/1/vertex_count", 3, "objects have 8 vertices, points have 7"),
        ("objects/0/face_indices", [0, 1, 2, 3, 2, 1, 5], "face 1 refers to vertex 5"),
        ("objects/0/line_counts", [3, 2], "line counts add up to 5, indices are 4"),
        ("objects/0/attributes/0/domain", "edge", "is 'edge', not one of vertex, face, corner, object"),
        ("objects/0/attributes/0/values", ["a"], "must be numbers in one or two dimensions"),
        ("objects/0/attributes/0/indices", [0, 1], "has 2 rows, but there are 7 of its domain, corner"),
        ("objects/0/attributes/0/indices", [0.5] * 7, "must be one row of integers"),
        ("objects/0/attributes/0/indices", [9] * 7, "refers to rows outside its 4 values"),
        ("objects/0/attributes/1/labels", [1, 2], "must be one row of text"),
    ],
)
def test_a_damaged_layout_is_refused(tmp_path: Path, name: str, value: Any, message: str):
    write_sequence(rich_sequence(), tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as archive:
        arrays = dict(archive)
    np.savez(tmp_path / "x.npz", **{**arrays, name: np.asarray(value)})
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "x.npz")


@pytest.mark.parametrize("name", ["points", "faces", "times"])
def test_python_objects_are_never_loaded(tmp_path: Path, name: str):
    arrays = {"points": POINTS, name: np.array([{"a": 1}], dtype=object)}
    np.savez(tmp_path / "x.npz", allow_pickle=True, **arrays)
    with pytest.raises(InputError, match="holds Python objects, which are never loaded"):
        open_sequence(tmp_path / "x.npz")


@pytest.mark.parametrize("content", [b"", b"PK\x03\x04", b"not a zip" * 20, bytes(500)])
def test_what_is_no_archive_is_refused(tmp_path: Path, content: bytes):
    (tmp_path / "x.npz").write_bytes(content)
    with pytest.raises(InputError, match="is not a readable NumPy archive"):
        open_sequence(tmp_path / "x.npz")


def test_an_archive_cut_anywhere_is_refused(tmp_path: Path):
    np.savez_compressed(tmp_path / "whole.npz", points=POINTS)
    whole = (tmp_path / "whole.npz").read_bytes()
    for length in range(len(whole)):
        (tmp_path / "x.npz").write_bytes(whole[:length])
        with pytest.raises(InputError):
            open_sequence(tmp_path / "x.npz")


@settings(deadline=None, max_examples=300)
@given(st.booleans(), st.integers(0, 10**6), st.integers(1, 255))
def test_a_changed_byte_is_refused_or_changes_values_only(
    tmp_path_factory: pytest.TempPathFactory, compressed: bool, place: int, change: int
):
    buffer = io.BytesIO()
    (np.savez_compressed if compressed else np.savez)(buffer, points=POINTS, faces=[[0, 1, 2]], times=[0.0, 1.0])
    content = bytearray(buffer.getvalue())
    content[place % len(content)] ^= change
    path = tmp_path_factory.mktemp("changed") / "x.npz"
    path.write_bytes(content)
    try:
        sequence = open_sequence(path)
    except InputError:
        return
    frames = sequence.read_frames(0, sequence.frame_count)
    assert frames.shape == (sequence.frame_count, sequence.vertex_count, 3)


def test_a_header_that_claims_more_than_the_file_holds_is_refused(tmp_path: Path):
    member = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": (10**9, 1000, 3)}
    np.lib.format.write_array_header_1_0(member, header)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("points.npy", member.getvalue())
    with pytest.raises(InputError, match="its length is not what its header says"):
        open_sequence(tmp_path / "x.npz")


def test_a_file_that_shrinks_while_open_is_told_at_the_frame(tmp_path: Path):
    path = tmp_path / "x.npz"
    np.savez(path, points=np.zeros((50, 4, 3), np.float32))
    sequence = open_sequence(path)
    path.write_bytes(path.read_bytes()[:1000])
    with pytest.raises(InputError, match="the file ends early"):
        sequence.read_frames(0, 50)


def test_an_archive_that_is_there_is_replaced_only_on_request(tmp_path: Path):
    path = tmp_path / "x.npz"
    path.write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_sequence(rich_sequence(), path)
    assert path.read_text() == "mine"
    write_sequence(rich_sequence(), path, overwrite=True)
    assert_same_sequence(open_sequence(path), rich_sequence())


def test_a_source_that_fails_leaves_nothing_behind(tmp_path: Path):
    class Failing(ArraySequence):
        def read_frames(self, start: int, stop: int) -> np.ndarray:
            raise InputError("the source broke", frame=start)

    with pytest.raises(InputError, match="the source broke"):
        write_sequence(Failing(POINTS), tmp_path / "x.npz")
    assert list(tmp_path.iterdir()) == []


def test_a_sequence_is_written_and_read_by_blocks(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    monkeypatch.setattr("pdecodec.sequence.BLOCK_BYTES", 2 * 12 * 7)
    told: list[int] = []
    source = rich_sequence(5)
    write_sequence(source, tmp_path / "x.npz", progress=lambda done, total, what: told.append(done))
    assert told == [2, 4, 5]
    blocks = dict(open_sequence(tmp_path / "x.npz").blocks())
    assert list(blocks) == [0, 2, 4]
    assert np.array_equal(np.concatenate(list(blocks.values())), source.points)


@pytest.mark.data
def test_every_shared_sequence_is_read(shared_data: Path):
    for path in sorted((shared_data / "sequences").glob("*.npz")):
        with np.load(path) as known, open_sequence(path) as sequence:
            assert np.array_equal(sequence.read_frames(3, 9), known["points"][3:9])
            assert np.array_equal(sequence.times, known["times"])
            assert sequence.connectivity.face_count + sequence.connectivity.line_count == len(known["faces"])
