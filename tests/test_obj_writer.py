"""OBJ sequences out: what was written comes back, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.selection import FrameSelection
from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence

TRIANGLE = Connectivity(3, face_counts=np.array([3]), face_indices=np.array([0, 1, 2]))


def names_in(folder: Path) -> list[str]:
    return sorted(item.name for item in folder.iterdir())


def moving(frames: int = 3, *, first_frame: int = 0, fps: float = 24.0) -> ArraySequence:
    points = np.random.default_rng(1).normal(size=(frames, 3, 3)).astype(np.float32)
    times = (first_frame + np.arange(frames)) / fps
    return ArraySequence(points, objects=[MeshObject("mesh", TRIANGLE)], times=times, fps=fps)


def assert_same(read: MeshSequence, written: MeshSequence) -> None:
    frames = written.frame_count
    assert np.array_equal(read.read_frames(0, frames).view(np.uint32), written.read_frames(0, frames).view(np.uint32))
    assert (read.times.tolist(), read.fps, dict(read.metadata)) == (
        written.times.tolist(),
        written.fps,
        dict(written.metadata),
    )
    assert [item.name for item in read.objects] == [item.name for item in written.objects]
    for mine, other in zip(read.objects, written.objects, strict=True):
        assert mine.connectivity.same_as(other.connectivity)
        assert [item.name for item in mine.attributes] == [item.name for item in other.attributes]
        for attribute, expected in zip(mine.attributes, other.attributes, strict=True):
            assert (attribute.domain, attribute.labels) == (expected.domain, expected.labels)
            assert np.array_equal(attribute.values, expected.values)
            assert (attribute.indices is None) == (expected.indices is None)
            if attribute.indices is not None:
                assert np.array_equal(attribute.indices, expected.indices)


FILES = {
    "quads, lines and points": "o body\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 3\nl 1 2 3\np 4\nl 2 4\n",
    "uv seams": "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt .25 1\nvt 3 3\nf 1/1 2/2 3/1\nf 3/3 2/1 1\n",
    "three-number uv": "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0 1\nvt .25 1 .125\nf 1/1 2/2 3/1\n",
    "colours": "o a\nv 0 0 0 1 0 .5\nv 1 0 0 0 0 0\n",
    "colours here and there": "o a\nv 0 0 0 1 0 .5\nv 1 0 0\nv 2 0 0 .1 .2 .3\n",
    "alpha": "o a\nv 0 0 0 1 0 .5 .25\n",
    "names of faces": "mtllib m.mtl\no a b\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\ng left arm\nusemtl red\ns 3\n"
    "f 1 2 3\ng right\nf 1 2 3\ng\nusemtl\ns off\nf 1 2 3\ng left arm\nf 3 2 1\n",
    "several objects": "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\ng x\nusemtl red\ns 1\nf 1/1 2/1 3/1\n"
    "o b\nv 0 0 5\nv 1 0 5\nv 0 1 5\ng\nusemtl\ns off\nf 4 5 6\no c\nv 9 9 9\n",
    "objects that share vertices": "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no a\nf 1 2 3\no b\nf 3 2 1\no a\nf 2 3 1\n",
    "objects that share one object's vertices": "o a\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\no b\nf 3 2 1\n",
    "points alone": "o cloud\nv 1 2 3\nv 4 5 6\n",
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES.keys())
def test_everything_an_obj_file_says_comes_back(tmp_path: Path, text: str):
    (tmp_path / "in.obj").write_text(text)
    first = open_sequence(tmp_path / "in.obj")
    write_sequence(first, tmp_path / "out.obj")
    assert_same(open_sequence(tmp_path / "out.obj"), first)


def test_writing_what_was_read_gives_the_same_bytes(tmp_path: Path):
    (tmp_path / "in.obj").write_text(FILES["names of faces"])
    write_sequence(open_sequence(tmp_path / "in.obj"), tmp_path / "one.obj")
    write_sequence(open_sequence(tmp_path / "one.obj"), tmp_path / "two.obj")
    assert (tmp_path / "one.obj").read_bytes() == (tmp_path / "two.obj").read_bytes()


@settings(deadline=None, max_examples=60)
@given(
    st.integers(1, 3).flatmap(
        lambda vertices: st.lists(
            st.lists(
                st.floats(width=32, allow_nan=False, allow_infinity=False), min_size=3 * vertices, max_size=3 * vertices
            ),
            min_size=1,
            max_size=3,
        )
    ),
    st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=3),
)
def test_any_positions_and_times_come_back_to_the_last_bit(
    tmp_path_factory: pytest.TempPathFactory, frames: list[list[float]], steps: list[float]
):
    points = np.array(frames, np.float32).reshape(len(frames), -1, 3)
    sequence = ArraySequence(points, times=np.cumsum(steps)[: len(frames)] - 5, fps=30)
    folder = tmp_path_factory.mktemp("any") / "out"
    write_sequence(sequence, folder)
    assert_same(open_sequence(folder), sequence)


def test_a_folder_holds_frames_named_after_it_by_their_numbers(tmp_path: Path):
    write_sequence(moving(3, first_frame=1001), tmp_path / "walk")
    assert names_in(tmp_path / "walk") == ["walk.1001.obj", "walk.1002.obj", "walk.1003.obj"]
    assert names_in(tmp_path) == ["walk"]


def test_a_pattern_names_the_frames(tmp_path: Path):
    write_sequence(moving(2, first_frame=7), tmp_path / "walk_@@@.obj")
    assert names_in(tmp_path) == ["walk_007.obj", "walk_008.obj"]
    assert_same(open_sequence(tmp_path / "walk_%03d.obj"), moving(2, first_frame=7))


def test_frames_before_time_zero_come_back_in_order(tmp_path: Path):
    sequence = moving(4, first_frame=-2)
    write_sequence(sequence, tmp_path / "walk.####.obj")
    assert_same(open_sequence(tmp_path / "walk.####.obj"), sequence)


def test_frames_off_the_frame_rate_are_numbered_without_gaps(tmp_path: Path):
    chosen = FrameSelection(moving(9, first_frame=10), [0, 1, 5, 8])
    write_sequence(chosen, tmp_path / "out", fps=24)
    assert names_in(tmp_path / "out") == [f"out.{number:04d}.obj" for number in (10, 11, 12, 13)]
    assert open_sequence(tmp_path / "out").times.tolist() == chosen.times.tolist()


def test_a_frame_rate_given_when_writing_is_the_one_noted(tmp_path: Path):
    write_sequence(moving(2), tmp_path / "out", fps=12)
    assert open_sequence(tmp_path / "out").fps == 12


def test_names_that_obj_cannot_hold_are_made_to_fit(tmp_path: Path):
    group = Attribute("group", "face", np.zeros(1, np.int32), labels=("a\nv 0 0 0",))
    item = MeshObject("two\nlines \\", TRIANGLE, (group,))
    write_sequence(ArraySequence(np.eye(3)[None], objects=[item]), tmp_path / "x.obj")
    (read,) = open_sequence(tmp_path / "x.obj").objects
    assert read.name == "two lines"
    assert read.connectivity.same_as(TRIANGLE)
    assert read.attributes[0].labels == ("a v 0 0 0",)


def test_colours_in_bytes_are_written_as_parts_of_one(tmp_path: Path):
    color = Attribute("color", "vertex", np.array([[255, 0, 51], [0, 0, 0], [0, 255, 0]], np.uint8))
    write_sequence(ArraySequence(np.eye(3)[None], objects=[MeshObject("a", TRIANGLE, (color,))]), tmp_path / "x.obj")
    read = open_sequence(tmp_path / "x.obj").objects[0].attributes[0]
    assert np.allclose(read.values, [[1, 0, 0.2], [0, 0, 0], [0, 1, 0]])


def test_progress_ends_at_the_number_of_frames(tmp_path: Path):
    told: list[tuple[int, int, str]] = []
    write_sequence(moving(3), tmp_path / "out", progress=lambda *args: told.append(args))
    assert told[-1] == (3, 3, "writing OBJ")


def test_several_frames_to_one_file_are_refused_with_the_pattern_to_use(tmp_path: Path):
    with pytest.raises(InputError, match=r"3 frames do not fit one OBJ file; name it walk\.####\.obj"):
        write_sequence(moving(3), tmp_path / "walk.obj")
    assert names_in(tmp_path) == []


@pytest.mark.parametrize("target", ["walk", "walk/", "walk/walk.####.obj"])
def test_frames_that_are_there_are_replaced_only_on_request(tmp_path: Path, target: str):
    write_sequence(moving(5), tmp_path / "walk")
    before = (tmp_path / "walk" / "walk.0000.obj").read_bytes()
    path = f"{tmp_path}/{target}"
    with pytest.raises(InputError, match="frames are there already"):
        write_sequence(moving(2, first_frame=1), path)
    assert (tmp_path / "walk" / "walk.0000.obj").read_bytes() == before
    write_sequence(moving(2, first_frame=1), path, overwrite=True)
    assert names_in(tmp_path / "walk") == ["walk.0001.obj", "walk.0002.obj"]
    assert_same(open_sequence(tmp_path / "walk"), moving(2, first_frame=1))


def test_one_file_that_is_there_is_replaced_only_on_request(tmp_path: Path):
    (tmp_path / "x.obj").write_text("mine")
    with pytest.raises(InputError, match="exists already"):
        write_sequence(moving(1), tmp_path / "x.obj")
    assert (tmp_path / "x.obj").read_text() == "mine"
    write_sequence(moving(1), tmp_path / "x.obj", overwrite=True)
    assert_same(open_sequence(tmp_path / "x.obj"), moving(1))


def test_a_folder_of_other_obj_files_is_not_mixed_with_frames(tmp_path: Path):
    (tmp_path / "head.obj").write_text("v 0 0 0\n")
    with pytest.raises(InputError, match=r"holds other OBJ files \(head\.obj\)"):
        write_sequence(moving(2), tmp_path, overwrite=True)
    assert names_in(tmp_path) == ["head.obj"]


def test_other_files_in_the_folder_stay(tmp_path: Path):
    (tmp_path / "notes.txt").write_text("keep")
    write_sequence(moving(2), tmp_path, overwrite=True)
    assert (tmp_path / "notes.txt").read_text() == "keep"
    assert open_sequence(tmp_path).frame_count == 2


@pytest.mark.parametrize("value", [np.nan, np.inf])
@pytest.mark.parametrize("target", ["out", "out.####.obj"])
def test_a_position_that_is_not_finite_leaves_nothing_behind(tmp_path: Path, value: float, target: str):
    sequence = moving(3)
    sequence.points[2, 1, 0] = value
    with pytest.raises(InputError, match="frame 2: vertex 1 is not finite"):
        write_sequence(sequence, tmp_path / target)
    assert names_in(tmp_path) == []


def test_a_source_that_fails_leaves_the_old_frames(tmp_path: Path):
    class Failing(ArraySequence):
        def read_frames(self, start: int, stop: int) -> np.ndarray:
            raise InputError("the source broke", frame=start)

    write_sequence(moving(2), tmp_path / "walk")
    with pytest.raises(InputError, match="the source broke"):
        write_sequence(Failing(np.zeros((2, 3, 3))), tmp_path / "walk", overwrite=True)
    assert_same(open_sequence(tmp_path / "walk"), moving(2))
    assert names_in(tmp_path) == ["walk"]


@pytest.mark.parametrize("target", ["no/where/x", "no/where/x.####.obj", "no/where/x.obj"])
def test_a_place_that_does_not_exist_is_refused(tmp_path: Path, target: str):
    with pytest.raises(InputError, match="this folder does not exist"):
        write_sequence(moving(1), tmp_path / target)


def test_a_file_in_the_way_of_a_folder_is_refused(tmp_path: Path):
    (tmp_path / "walk").write_text("a file")
    with pytest.raises(InputError):
        write_sequence(moving(2), tmp_path / "walk")
    assert (tmp_path / "walk").read_text() == "a file"
    assert names_in(tmp_path) == ["walk"]
