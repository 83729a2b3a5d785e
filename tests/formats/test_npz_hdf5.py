"""NPZ and HDF5: files of our writer restore everything, plain files are understood, damaged files are refused."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.object_arrays import arrays_of
from pdecodec.mesh.sequence import ArraySequence, Connectivity, MeshObject
from tests.support.mesh_cases import connectivity_of
from tests.support.sequence_cases import assert_same_sequence, rich_sequence, sequences

POINTS = np.arange(2 * 4 * 3, dtype=np.float32).reshape(2, 4, 3)


def save_hdf5(path: Path, **datasets: Any) -> None:
    with h5py.File(path, "w") as file:
        for name, values in datasets.items():
            array = np.asarray(values)
            file[name] = array.astype(h5py.string_dtype()) if array.dtype.kind == "U" else array


SAVE: dict[str, Callable[..., None]] = {"x.npz": np.savez, "x.h5": save_hdf5}
KIND = {"x.npz": "array", "x.h5": "dataset"}

each_format = pytest.mark.parametrize("name", SAVE)


@settings(max_examples=30)
@given(sequences())
def test_any_sequence_comes_back(tmp_path_factory: pytest.TempPathFactory, sequence: ArraySequence) -> None:
    for name in SAVE:
        path = tmp_path_factory.mktemp("any") / name
        write_sequence(sequence, path)
        with open_sequence(path) as read:
            assert_same_sequence(read, sequence)


@pytest.mark.parametrize(
    ("vertices", "chunk"), [(100, (300, 100, 3)), (20_000, (4, 20_000, 3)), (90_000, (1, 87_381, 3))]
)
def test_an_hdf5_file_holds_no_date_and_chunks_of_about_a_mebibyte(
    tmp_path: Path, vertices: int, chunk: tuple[int, int, int]
) -> None:
    write_sequence(ArraySequence(np.zeros((300 if vertices == 100 else 5, vertices, 3), np.float32)), tmp_path / "x.h5")
    with h5py.File(tmp_path / "x.h5") as file:
        assert file["points"].chunks == chunk
        for name in ("points", "times", "objects/0/name"):
            assert h5py.h5o.get_info(file[name].id).mtime == 0


@pytest.mark.parametrize(("name", "expected"), [("x.npz", [0, 5, 7]), ("x.h5", [0, 4, 7])])
def test_a_sequence_is_written_and_read_by_blocks_of_whole_chunks(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, name: str, expected: list[int]
) -> None:
    monkeypatch.setattr("pdecodec.mesh.sequence.BLOCK_BYTES", 5 * 12 * 7)
    monkeypatch.setattr("pdecodec.formats.base.registry.WRITTEN_BYTES", 5 * 12 * 7)
    monkeypatch.setattr("pdecodec.formats.arrays.hdf5.CHUNK_BYTES", 2 * 12 * 7)
    told: list[int] = []
    source = rich_sequence(7)
    write_sequence(source, tmp_path / name, progress=lambda done, total, what: told.append(done))
    assert told == expected
    with open_sequence(tmp_path / name) as read:
        blocks = dict(read.blocks(3))
        assert list(blocks) == [0, 3, 6]
        assert np.array_equal(np.concatenate(list(blocks.values())), source.points)


@each_format
def test_a_plain_file_is_understood(tmp_path: Path, name: str) -> None:
    faces = np.array([[0, 1, 2], [0, 1, -1]], np.int64)
    SAVE[name](tmp_path / name, points=POINTS.astype(">f8"), faces=faces, times=[1.0, 1.5], mass=2)
    with open_sequence(tmp_path / name) as sequence:
        assert np.array_equal(sequence.read_frames(0, 2), POINTS)
        assert np.array_equal(sequence.read_frames(1, 2), POINTS[1:])
        assert sequence.connectivity.face_indices.tolist() == [0, 1, 2]
        assert sequence.connectivity.line_indices.tolist() == [0, 1]
        assert (sequence.times.tolist(), sequence.fps) == ([1.0, 1.5], 2.0)
        assert sequence.notices == (f"{KIND[name]}s not kept: mass",)


@each_format
@pytest.mark.parametrize(
    "other", [["a", "b"], np.zeros((3, 7)), np.zeros((0, 4)), np.zeros(5), np.zeros((2, 4), complex), 3.0]
)
def test_an_array_that_is_no_field_does_not_set_the_number_of_frames(tmp_path: Path, name: str, other: object) -> None:
    SAVE[name](tmp_path / name, points=POINTS[:1], times=[0.0], fps=24.0, field_names=other)
    with open_sequence(tmp_path / name) as sequence:
        assert (sequence.frame_count, sequence.fields) == (1, ())
        assert sequence.notices == (f"{KIND[name]}s not kept: field_names",)


def test_python_objects_named_as_a_field_are_not_kept(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", allow_pickle=True, points=POINTS, fps=24.0, field_names=np.array([{}], dtype=object))
    with open_sequence(tmp_path / "x.npz") as sequence:
        assert sequence.notices == ("arrays not kept: field_names",)


@each_format
def test_a_field_of_several_frames_repeats_points_of_one(tmp_path: Path, name: str) -> None:
    arrays = {"field_warm": np.arange(12.0).reshape(3, 4), "field_short": np.zeros((2, 4)), "field_more": [1, 2, 3, 4]}
    SAVE[name](tmp_path / name, points=POINTS[:1], fps=24.0, **arrays)
    with open_sequence(tmp_path / name) as sequence:
        assert np.array_equal(sequence.read_frames(0, 3), np.repeat(POINTS[:1], 3, axis=0))
        assert np.array_equal(sequence.read_field("warm", 1, 3), arrays["field_warm"][1:])
        assert set(sequence.notices[0].removeprefix(f"{KIND[name]}s not kept: ").split(", ")) == {
            "field_short",
            "field_more",
        }


KEPT = "the times stored in the file are kept; 30 frames per second is only the nominal rate"


@each_format
@pytest.mark.parametrize(
    ("arrays", "fps", "times", "rate", "notices"),
    [
        ({}, None, [0, 1 / 24], 24, ("assumed 24 frames per second; set fps to change it",)),
        ({}, 10, [0, 0.1], 10, ()),
        ({"fps": 50}, None, [0, 0.02], 50, ()),
        ({"times": [1.0, 1.5]}, 30, [1.0, 1.5], 30, (KEPT,)),
    ],
    ids=["points alone", "a rate asked for", "a stored rate", "stored times"],
)
def test_stored_times_come_before_a_given_rate_and_that_before_a_stored_rate(
    tmp_path: Path, name: str, arrays: dict[str, Any], fps: float, times: object, rate: float, notices: object
) -> None:
    SAVE[name](tmp_path / name, points=POINTS, **arrays)
    with open_sequence(tmp_path / name, fps=fps) as read:
        assert (read.times.tolist(), read.fps, read.notices) == (times, rate, notices)
        assert read.connectivity.same_as(Connectivity(4))


RICH = {"points": rich_sequence().points, **arrays_of(rich_sequence(), 24.0)}


@each_format
@pytest.mark.parametrize(
    ("arrays", "message"),
    [
        (
            {"vertices": POINTS},
            "has no {kind} named points, .*; it has vertices; rename",
        ),
        ({}, "has no {kind} named points, .*; it is empty"),
        ({"points/inner": POINTS}, "has no {kind} named points"),
        ({"points": POINTS[0]}, r"shape \(frames, vertices, 3\), not float32 \(4, 3\)"),
        ({"points": POINTS[:, :, :2]}, r"not float32 \(2, 4, 2\)"),
        ({"points": POINTS.astype(complex)}, "not complex128"),
        ({"points": "text"}, r"shape \(frames, vertices, 3\), not (object|<U4) \(\)"),
        ({"points": POINTS[:0]}, "there are no frames"),
        ({"points": POINTS[:, :0]}, "points have no vertices"),
        ({"points": POINTS, "times": [0.0]}, "there are 2 frames, but times have shape"),
        ({"points": POINTS, "times": [1.0, 0.0]}, "times must increase"),
        ({"points": POINTS, "times": "soon"}, "times must be numbers"),
        ({"points": POINTS, "fps": [1.0, 2.0]}, "fps must be one number"),
        ({"points": POINTS, "fps": -1.0}, "frames per second must be a positive number"),
        ({"points": POINTS, "faces": [[0, 1, 4]]}, "face 0 refers to vertex 4, but there are 4 vertices"),
        ({"points": POINTS, "faces": [[0.0, 1.0, 2.0]]}, "two-dimensional integer array"),
        ({"points": POINTS, "metadata": [1, 2]}, "metadata must be pairs of text"),
        ({"points": POINTS, "objects/0/name": "a"}, "objects/0/vertex_count is missing"),
        ({"points": POINTS, "objects/0/name": 7, "objects/0/vertex_count": 4}, "objects/0/face_counts is missing"),
        ({"points": POINTS, "objects/0/name": "a", "objects/0/vertex_count": -4}, "whole number, 0 or more"),
        ({**RICH, "objects/0/name": 3}, "objects/0/name must be text"),
        ({**RICH, "objects/1/vertex_count": 3}, "objects have 8 vertices, but points have 7"),
        ({**RICH, "objects/0/face_indices": [0, 1, 2, 3, 2, 1, 5]}, "face 1 refers to vertex 5"),
        ({**RICH, "objects/0/line_counts": [3, 2]}, "line counts add up to 5, indices are 4"),
        ({**RICH, "objects/0/attributes/0/domain": "edge"}, "is 'edge', not one of vertex, face, corner, object"),
        ({**RICH, "objects/0/attributes/0/values": [[["a"]]]}, "must be numbers in one or two dimensions"),
        ({**RICH, "objects/0/attributes/0/indices": [0, 1]}, "has 2 rows, but there are 7 of its domain, corner"),
        ({**RICH, "objects/0/attributes/0/indices": [0.5] * 7}, "must be one row of integers"),
        ({**RICH, "objects/0/attributes/0/indices": [9] * 7}, "refers to rows outside its 4 values"),
        ({**RICH, "objects/0/attributes/1/labels": [1, 2]}, "must be one row of text"),
    ],
)
def test_arrays_that_do_not_fit_are_refused(tmp_path: Path, name: str, arrays: dict[str, Any], message: str) -> None:
    SAVE[name](tmp_path / name, **arrays)
    with pytest.raises(InputError, match=message.replace("{kind}", KIND[name])) as caught:
        open_sequence(tmp_path / name)
    assert caught.value.path == str(tmp_path / name)


def test_numpy_alone_reads_what_others_need(tmp_path: Path) -> None:
    padded = np.array([[0, 1, 2, 3], [0, 1, 2, -1], [2, 3, -1, -1]])
    item = MeshObject("a", Connectivity.from_padded(4, padded))
    write_sequence(ArraySequence(POINTS, objects=[item], fps=30), tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as archive:
        assert np.array_equal(archive["points"], POINTS)
        assert np.array_equal(archive["faces"], padded)
        assert (archive["times"].tolist(), archive["fps"]) == ([0.0, 1 / 30], 30)


@pytest.mark.parametrize(
    "connectivity",
    [connectivity_of(4, [], [[0, 1, 2]]), connectivity_of(4, [[k % 4 for k in range(60)], *[[0, 1, 2]] * 50])],
    ids=["a line of three points", "one wide face among many small ones"],
)
def test_padded_faces_are_left_out_where_they_would_mislead_or_grow(tmp_path: Path, connectivity: Connectivity) -> None:
    write_sequence(ArraySequence(POINTS, objects=[MeshObject("a", connectivity)]), tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as archive:
        assert "faces" not in archive.files
    assert open_sequence(tmp_path / "x.npz").connectivity.same_as(connectivity)


@pytest.mark.parametrize("save", [np.savez, np.savez_compressed])
@pytest.mark.parametrize("dtype", [np.float32, np.float64, ">f4", np.float16, np.int16])
@pytest.mark.parametrize("order", ["C", "F"])
def test_points_of_any_number_type_and_order_are_read(tmp_path: Path, save: Any, dtype: Any, order: str) -> None:
    save(tmp_path / "x.npz", points=np.asarray(POINTS.astype(dtype), order=order))  # type: ignore[call-overload]
    sequence = open_sequence(tmp_path / "x.npz")
    assert sequence.read_frames(0, 2).dtype == np.float32
    assert np.array_equal(sequence.read_frames(0, 2), POINTS)
    assert np.array_equal(sequence.read_frames(1, 2), POINTS[1:])
    assert sequence.read_frames(1, 1).shape == (0, 4, 3)


@pytest.mark.parametrize("name", ["points", "faces", "times"])
def test_python_objects_are_never_loaded(tmp_path: Path, name: str) -> None:
    arrays = {"points": POINTS, name: np.array([{"a": 1}], dtype=object)}
    np.savez(tmp_path / "x.npz", allow_pickle=True, **arrays)
    with pytest.raises(InputError, match="holds Python objects, which are never loaded"):
        open_sequence(tmp_path / "x.npz")


def test_a_header_that_claims_more_than_the_file_holds_is_refused(tmp_path: Path) -> None:
    member = io.BytesIO()
    header = {"descr": "<f4", "fortran_order": False, "shape": (10**9, 1000, 3)}
    np.lib.format.write_array_header_1_0(member, header)
    with zipfile.ZipFile(tmp_path / "x.npz", "w") as archive:
        archive.writestr("points.npy", member.getvalue())
    with pytest.raises(InputError, match="its length is not what its header says"):
        open_sequence(tmp_path / "x.npz")


def test_a_file_that_shrinks_or_closes_while_it_is_read_is_our_error(tmp_path: Path) -> None:
    np.savez(tmp_path / "x.npz", points=np.zeros((50, 4, 3), np.float32))
    sequence = open_sequence(tmp_path / "x.npz")
    (tmp_path / "x.npz").write_bytes((tmp_path / "x.npz").read_bytes()[:1000])
    with pytest.raises(InputError, match="the file ends early"):
        sequence.read_frames(0, 50)
    save_hdf5(tmp_path / "x.h5", points=POINTS, fps=24.0)
    closed = open_sequence(tmp_path / "x.h5")
    closed.close()
    with pytest.raises(InputError, match="cannot be read as HDF5"):
        closed.read_frames(0, 1)


@pytest.mark.data
def test_every_shared_sequence_is_read(shared_data: Path) -> None:
    paths = sorted((shared_data / "sequences").glob("*.npz"))
    assert paths
    for path in paths:
        with np.load(path) as known, open_sequence(path) as sequence:
            assert np.array_equal(sequence.read_frames(3, 9), known["points"][3:9])
            assert np.array_equal(sequence.times, known["times"])
            assert sequence.connectivity.face_count + sequence.connectivity.line_count == len(known["faces"])


def test_an_hdf5_name_that_is_not_utf8_is_refused_without_an_address_in_memory(tmp_path: Path) -> None:
    path = tmp_path / "a.h5"
    with h5py.File(path, "w") as file:
        file["points"], file["strange_name"] = np.zeros((2, 3, 3), np.float32), np.zeros(3)
    path.write_bytes(path.read_bytes().replace(b"strange_name", b"strang\xff_name"))
    with pytest.raises(InputError, match="cannot be read as HDF5") as caught:
        open_sequence(path)
    assert "0x" not in str(caught.value)


def test_text_that_is_not_unicode_is_refused(tmp_path: Path) -> None:
    name = np.array([0x110000], np.uint32).view("U1").reshape(())
    np.savez(tmp_path / "x.npz", **RICH, **{"objects/9/name": name})
    with pytest.raises(InputError, match=r"objects/9/name.npy has characters that Unicode does not have"):
        open_sequence(tmp_path / "x.npz")
