"""Mesh sequences in memory: which are accepted, completed and refused; and selections of frames and objects."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pdecodec import encode, encode_to_size, open_animation, open_sequence, write_sequence
from pdecodec.errors import InputError
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.selection import FrameSelection, ObjectSelection
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from pdecodec.mesh.times import check_times
from tests.support.mesh_cases import grid

TRIANGLE = Connectivity(3, face_counts=np.array([3]), face_indices=np.array([0, 1, 2]))


def moving(frames: int = 5, vertices: int = 4, **options: object) -> ArraySequence:
    points = np.arange(frames * vertices * 3, dtype=np.float32).reshape(frames, vertices, 3)
    return ArraySequence(points, **options)  # type: ignore[arg-type]


def test_padded_rows_become_faces_and_short_rows_become_lines():
    padded = np.array([[0, 1, 2, -1], [0, 3, -1, -1], [0, 1, 2, 3], [2, -1, -1, -1]])
    connectivity = Connectivity.from_padded(4, padded)
    assert connectivity.face_counts.tolist() == [3, 4]
    assert connectivity.face_indices.tolist() == [0, 1, 2, 0, 1, 2, 3]
    assert connectivity.line_counts.tolist() == [2, 1]
    assert connectivity.line_indices.tolist() == [0, 3, 2]
    assert (connectivity.face_count, connectivity.line_count) == (2, 2)


@pytest.mark.parametrize(
    ("faces", "message"),
    [
        (np.array([[0, -1, 2]]), "padded with -1 before their end"),
        (np.array([[-1, -1, -1]]), "face 0 has no vertices"),
        (np.array([[0.0, 1.0, 2.0]]), "two-dimensional integer array"),
        (np.array([0, 1, 2]), "two-dimensional integer array"),
        (np.array([[0, 1, 7]]), "face 0 refers to vertex 7, but there are 4 vertices"),
        (np.array([[0, 1, 2], [0, 1, -2]]), "face 1 refers to vertex -2"),
        (np.array([[0, 1, 2**32 + 1]]), "beyond 32 bits"),
    ],
)
def test_padded_faces_that_cannot_be_are_refused(faces: np.ndarray, message: str):
    with pytest.raises(InputError, match=message):
        Connectivity.from_padded(4, faces)


def test_counts_and_indices_must_add_up():
    with pytest.raises(InputError, match="face counts add up to 3, indices are 4"):
        Connectivity(4, face_counts=np.array([3]), face_indices=np.array([0, 1, 2, 3]))
    with pytest.raises(InputError, match="face 0 has 2 points, but needs 3"):
        Connectivity(4, face_counts=np.array([2]), face_indices=np.array([0, 1]))
    with pytest.raises(InputError, match="line 1 has 0 points, but needs 1"):
        Connectivity(4, line_counts=np.array([1, 0]), line_indices=np.array([0]))


def test_connectivity_is_the_same_only_with_the_same_order():
    other = Connectivity(3, face_counts=np.array([3]), face_indices=np.array([1, 2, 0]))
    assert TRIANGLE.same_as(Connectivity.from_padded(3, np.array([[0, 1, 2]])))
    assert not TRIANGLE.same_as(other)
    assert not TRIANGLE.same_as(Connectivity(4, face_counts=np.array([3]), face_indices=np.array([0, 1, 2])))


def test_objects_stand_one_after_the_other_in_the_joint_connectivity():
    edge = Connectivity(2, line_counts=np.array([2]), line_indices=np.array([1, 0]))
    sequence = moving(2, 5, objects=[MeshObject("a", TRIANGLE), MeshObject("b", edge)])
    assert sequence.vertex_count == 5
    assert sequence.connectivity.face_indices.tolist() == [0, 1, 2]
    assert sequence.connectivity.line_indices.tolist() == [4, 3]


def test_objects_must_have_as_many_vertices_as_the_points():
    with pytest.raises(InputError, match="objects have 3 vertices, but points have 4"):
        moving(2, 4, objects=[MeshObject("a", TRIANGLE)])


@pytest.mark.parametrize(
    ("attribute", "message"),
    [
        (Attribute("color", "vertex", np.zeros((2, 3))), "has 2 rows, but there are 3 of its domain, vertex"),
        (Attribute("group", "face", np.zeros(3, np.int32)), "has 3 rows, but there are 1 of its domain, face"),
        (
            Attribute("uv", "corner", np.zeros((9, 2)), indices=np.zeros(2, np.int32)),
            "there are 3 of its domain, corner",
        ),
        (Attribute("uv", "corner", np.zeros((2, 2)), indices=np.array([0, 1, 2], np.int32)), "outside its 2 values"),
        (Attribute("uv", "corner", np.zeros((2, 2)), indices=np.array([0, 1, -2], np.int32)), "outside its 2 values"),
    ],
)
def test_an_attribute_must_fit_its_object(attribute: Attribute, message: str):
    with pytest.raises(InputError, match=message):
        MeshObject("a", TRIANGLE, (attribute,))


@pytest.mark.parametrize("points", [np.zeros((2, 3)), np.zeros((2, 4, 2)), np.zeros((1, 1, 3), complex), [["a"]]])
def test_points_of_another_shape_or_kind_are_refused(points: object):
    with pytest.raises(InputError, match=r"shape \(frames, vertices, 3\)"):
        ArraySequence(points)  # type: ignore[arg-type]


def test_no_frame_and_no_vertex_are_refused():
    with pytest.raises(InputError, match="no frames"):
        ArraySequence(np.zeros((0, 4, 3)))
    with pytest.raises(InputError, match="no vertices"):
        ArraySequence(np.zeros((2, 0, 3)))


def test_doubles_are_rounded_and_overflow_becomes_infinite():
    sequence = ArraySequence(np.array([[[0.1, 1e300, -1e-300]]]))
    assert sequence.points.dtype == np.float32
    assert sequence.points[0, 0, 0] == np.float32(0.1)
    assert sequence.points[0, 0, 1] == np.inf
    assert sequence.points[0, 0, 2] == 0


def test_times_default_to_the_frame_rate_and_the_rate_to_the_times():
    times, fps = check_times(3, None, None)
    assert (times.tolist(), fps) == ([0.0, 1 / 24, 2 / 24], 24.0)
    times, fps = check_times(3, [1.0, 1.04, 1.08], None)
    assert (times.tolist(), fps) == ([1.0, 1.04, 1.08], 25.0)
    assert check_times(1, [7.0], None)[1] == 24.0


@pytest.mark.parametrize(
    ("times", "fps", "message"),
    [
        ([0.0, 1.0], None, "there are 3 frames, but times have shape"),
        ([0.0, 1.0, 1.0], None, "frame 2: times must increase"),
        ([0.0, np.nan, 1.0], None, "frame 1: a time is not a finite number"),
        (None, 0.0, "positive number, not 0.0"),
        (None, np.nan, "positive number, not nan"),
        (None, np.inf, "positive number, not inf"),
    ],
)
def test_times_and_rates_that_cannot_be_are_refused(times: list[float] | None, fps: float | None, message: str):
    with pytest.raises(InputError, match=message):
        check_times(3, times, fps)


def test_blocks_cover_every_frame_once_in_order():
    sequence = moving(7)
    blocks = list(sequence.blocks(3))
    assert [start for start, _ in blocks] == [0, 3, 6]
    assert np.array_equal(np.concatenate([block for _, block in blocks]), sequence.points)


@pytest.mark.parametrize(("start", "stop"), [(-1, 2), (3, 2), (0, 6)])
def test_frames_outside_the_sequence_are_an_index_error(start: int, stop: int):
    with pytest.raises(IndexError, match="of a sequence of 5"):
        moving(5).read_frames(start, stop)


def test_a_selection_reads_the_frames_it_names_at_their_times():
    source = moving(9, fps=30.0)
    chosen = FrameSelection(source, range(1, 9, 3))
    assert np.array_equal(chosen.read_frames(0, 3), source.points[[1, 4, 7]])
    assert np.array_equal(chosen.read_frames(1, 3), source.points[[4, 7]])
    assert chosen.times.tolist() == source.times[[1, 4, 7]].tolist()
    assert chosen.fps == 10.0
    assert chosen.read_frames(2, 2).shape == (0, 4, 3)


def test_a_selection_of_one_frame_keeps_the_frame_rate():
    assert FrameSelection(moving(3, fps=30.0), [1]).fps == 30.0


@pytest.mark.parametrize("frames", [[], [-1], [0, 5], [2, 1], [1, 1]])
def test_a_selection_must_increase_within_its_source(frames: list[int]):
    with pytest.raises(InputError):
        FrameSelection(moving(5), frames)


def test_closing_is_passed_on_by_a_selection():
    class Closing(ArraySequence):
        closed = False

        def close(self) -> None:
            self.closed = True

    source = Closing(np.zeros((2, 3, 3)))
    with FrameSelection(source, [0]):
        assert not source.closed
    assert source.closed


def three_sheets() -> ArraySequence:
    names = ("left", "middle", "left")
    objects = [MeshObject(name, grid(2, 3 + index)) for index, name in enumerate(names)]
    vertices = sum(item.vertex_count for item in objects)
    return ArraySequence(np.random.default_rng(0).normal(size=(4, vertices, 3)), objects=objects)


def test_objects_keep_their_order_connectivity_and_positions() -> None:
    whole = three_sheets()
    part = ObjectSelection(whole, ["left"])
    assert [item.vertex_count for item in part.objects] == [6, 10]
    assert part.connectivity.vertex_count == 16
    assert np.array_equal(part.read_frames(1, 3), whole.points[1:3][:, [*range(6), *range(14, 24)]])
    assert np.array_equal(part.times, whole.times)


def test_one_object_of_a_decoded_animation_has_the_positions_it_has_in_the_whole() -> None:
    data = encode(three_sheets(), tolerance=1e-2).data
    assert data is not None
    with open_animation(data) as animation:
        part = ObjectSelection(animation, ["middle"])
        assert np.array_equal(part.read_frames(0, 4), animation.read_frames(0, 4)[:, 6:14])


def test_a_selected_object_encodes_alone(tmp_path: Path) -> None:
    report = encode(ObjectSelection(three_sheets(), ["middle"]), tmp_path / "middle.pdeanim", tolerance=1e-2)
    with open_animation(report.path or "") as animation:
        assert [item.name for item in animation.objects] == ["middle"]


@pytest.mark.parametrize(("names", "message"), [(["middle", "right"], "no object 'right'"), ([], "holds no object")])
def test_a_name_that_is_not_there_is_refused_with_those_that_are(names: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ObjectSelection(three_sheets(), names)


@pytest.mark.parametrize(("frames", "fps"), [(range(20), 60.0), (range(1, 20, 2), 30.0), ([4], 60.0), ([5, 6], 60.0)])
def test_evenly_chosen_frames_keep_the_rate_of_the_source_over_their_step(frames: Sequence[int], fps: float) -> None:
    times = (np.arange(20) / 60).astype(np.float32).astype(np.float64)
    source = ArraySequence(np.zeros((20, 1, 3), np.float32), times=times, fps=60.0)
    assert FrameSelection(source, frames).fps == fps


def test_faces_are_an_array_or_a_list_for_each_polygon() -> None:
    points = np.random.default_rng(3).random((2, 6, 3))
    for faces, counts in (
        (np.array([[0, 1, 2], [3, 4, 5]], np.uint16), [3, 3]),
        (np.array([[0, 1, 2, 3], [3, 4, 5, -1]]), [4, 3]),
        ([[0, 1, 2], [0, 1, 2, 3, 4], (3, 4, 5, 0)], [3, 5, 4]),
        ([], []),
    ):
        sequence = ArraySequence(points, faces=faces)
        assert sequence.connectivity.face_counts.tolist() == counts
        assert sequence.connectivity.face_indices.tolist() == [one for row in faces for one in row if one >= 0]
    for faces, message in (
        ([[0, 1, 2], [0, 1, 2, 9]], "face 1 refers to vertex 9, but there are 6"),
        ([[0.5, 1, 2], [0, 1, 2, 3]], "two-dimensional integer array"),
    ):
        with pytest.raises(InputError, match=message):
            ArraySequence(points, faces=faces)
    with pytest.raises(InputError, match="give either objects or faces"):
        ArraySequence(points, objects=[MeshObject("a", Connectivity(6))], faces=[[0, 1, 2]])


def test_an_array_and_a_path_are_encoded_as_the_sequence_that_they_are(tmp_path: Path) -> None:
    points = np.cumsum(np.random.default_rng(3).random((6, 20, 3)), axis=0)
    expected = encode(ArraySequence(points)).data
    write_sequence(ArraySequence(points), tmp_path / "a.npz")
    assert encode(points).data == encode(points.tolist()).data == expected
    for path in (tmp_path / "a.npz", str(tmp_path / "a.npz")):
        with open_sequence(path) as opened:
            assert encode(path, tolerance=1e-2).data == encode(opened, tolerance=1e-2).data
    encode_to_size(tmp_path / "a.npz", 2000, tmp_path / "a.pdeanim")
    assert encode(tmp_path / "a.pdeanim", rms=0.01).frames == 6
    with pytest.raises(
        InputError, match=r"points must be numbers of shape \(frames, vertices, 3\), not float64 \(6, 60\)"
    ):
        encode(points.reshape(6, 60))
    with pytest.raises(FileNotFoundError, match="there is no such file"):
        encode(tmp_path / "b.npz")


def test_a_sequence_describes_its_contents(tmp_path: Path) -> None:
    sequence = moving(5, 4)
    assert repr(sequence) == "<ArraySequence: 1 object, 4 vertices, 5 frames, 0.1667 s>"
    report = encode(sequence, tmp_path / "a.pdeanim")
    with open_animation(tmp_path / "a.pdeanim") as animation:
        said = f"<Animation: 1 object, 4 vertices, 5 frames, 0.1667 s, {report.file_bytes:,} bytes>"
        assert repr(animation) == said
    assert repr(animation) == said  # after closing
    changing = ChangingSequence([moving(2, 1200, times=[0, 1]), moving(1, 3, times=[2])])
    data = encode(changing).data
    assert data is not None
    with open_animation(data) as animation:
        assert repr(animation).endswith(f": 2 runs, at most 1,200 vertices, 3 frames, 2 s, {len(data):,} bytes>")
