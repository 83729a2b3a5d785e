"""Writing OBJ sequences: frames read back with the same numbers to the last bit, whole or not at all."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence, Attribute, MeshObject
from tests.support.mesh_cases import connectivity_of
from tests.support.sequence_cases import assert_same_sequence

TRIANGLE = connectivity_of(3, [[0, 1, 2]])

finite = st.floats(width=32, allow_nan=False, allow_infinity=False)


def names_in(folder: Path) -> list[str]:
    return sorted(str(item.relative_to(folder)) for item in folder.rglob("*") if item.is_file())


def moving(frames: int = 3, *, first_frame: int = 0, fps: float = 24.0) -> ArraySequence:
    points = np.random.default_rng(1).normal(size=(frames, 3, 3)).astype(np.float32)
    times = (first_frame + np.arange(frames)) / fps
    return ArraySequence(points, objects=[MeshObject("mesh", TRIANGLE)], times=times, fps=fps)


def words_of(frame: ArraySequence, folder: Path) -> list[str]:
    """Return the words of the ``v`` lines of a frame."""
    write_sequence(frame, folder / "one.obj")
    lines = (folder / "one.obj").read_text().splitlines()
    return [word for line in lines if line.startswith("v ") for word in line.split()[1:]]


THREE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"

FILES = {
    "quads, lines and points": "o body\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nf 1 2 3 4\nf 1 2 3\nl 1 2 3\np 4\nl 2 4\n",
    "uv seams": f"o a\n{THREE}vt 0 0\nvt .25 1\nvt 3 3\nf 1/1 2/2 3/1\nf 3/3 2/1 1\n",
    "three-number uv": f"o a\n{THREE}vt 0 0 1\nvt .25 1 .125\nf 1/1 2/2 3/1\n",
    "hard edges": f"o a\n{THREE}v 0 0 1\nvn 0 0 1\nvn -.57735 -.57735 -.57735\nf 1//1 2//1 3//1\nf 3//2 2//2 4//2\n",
    "colours": "o a\nv 0 0 0 1 0 .5\nv 1 0 0 0 0 0\n",
    "alpha": "o a\nv 0 0 0 1 0 .5 .25\n",
    "names of faces": f"mtllib m.mtl\no a b\n{THREE}f 1 2 3\ng left arm\nusemtl red\ns 3\n"
    "f 1 2 3\ng right\nf 1 2 3\ng\nusemtl\ns off\nf 1 2 3\ng left arm\nf 3 2 1\n",
    "several objects": f"o a\n{THREE}vt 0 0\ng x\nusemtl red\ns 1\nf 1/1 2/1 3/1\n"
    "o b\nv 0 0 5\nv 1 0 5\nv 0 1 5\ng\nusemtl\ns off\nf 4 5 6\no c\nv 9 9 9\n",
    "objects that share vertices": f"{THREE}f 1 2 3\no a\nf 1 2 3\no b\nf 3 2 1\no a\nf 2 3 1\n",
    "objects that share one object's vertices": f"o a\n{THREE}f 1 2 3\no b\nf 3 2 1\n",
    "points alone": "o cloud\nv 1 2 3\nv 4 5 6\n",
}


@pytest.mark.parametrize("text", FILES.values(), ids=FILES.keys())
def test_everything_in_an_obj_file_comes_back_and_gives_the_same_bytes_again(tmp_path: Path, text: str):
    (tmp_path / "in.obj").write_text(text)
    first = open_sequence(tmp_path / "in.obj")
    write_sequence(first, tmp_path / "out.obj")
    assert_same_sequence(open_sequence(tmp_path / "out.obj"), first)
    write_sequence(open_sequence(tmp_path / "out.obj"), tmp_path / "again.obj")
    assert (tmp_path / "again.obj").read_bytes() == (tmp_path / "out.obj").read_bytes()


@settings(max_examples=80)
@given(st.lists(finite, min_size=18, max_size=18), st.lists(st.floats(1e-3, 1e3), min_size=3, max_size=3))
def test_any_positions_and_times_come_back_to_the_last_bit_in_the_fewest_digits(
    tmp_path_factory: pytest.TempPathFactory, numbers: list[float], steps: list[float]
):
    points = np.array(numbers, np.float32).reshape(3, 2, 3)
    sequence = ArraySequence(points, times=np.cumsum(steps) - 5, fps=30)
    folder = tmp_path_factory.mktemp("any") / "out"
    write_sequence(sequence, folder)
    assert_same_sequence(open_sequence(folder), sequence)
    for word, number in zip(words_of(ArraySequence(points[:1]), folder.parent), points[0].reshape(-1), strict=True):
        if abs(number) >= np.finfo(np.float32).tiny:
            shortest = np.format_float_scientific(number, unique=True)
            mine, other = (one.split("e")[0].strip("-").replace(".", "").strip("0") for one in (word, shortest))
            assert len(mine) <= len(other)


def test_numbers_are_written_as_people_would(tmp_path: Path):
    words = ["0", "-0", "0.1", "-1.5", "100", "123456790", "1e+09", "0.0001", "1.5e-05", "3.4028235e+38", "1e-07", "-7"]
    assert words_of(ArraySequence(np.array(words, np.float32).reshape(1, 4, 3)), tmp_path) == words


@pytest.mark.parametrize(
    ("first", "target", "names"),
    [
        (1001, "walk", ["walk/walk.1001.obj", "walk/walk.1002.obj"]),
        (7, "walk_@@@.obj", ["walk_007.obj", "walk_008.obj"]),
        (-2, "walk.####.obj", ["walk.-001.obj", "walk.-002.obj"]),
    ],
)
def test_frames_are_named_by_their_numbers_and_come_back(tmp_path: Path, first: int, target: str, names: list[str]):
    write_sequence(moving(2, first_frame=first), tmp_path / target)
    assert names_in(tmp_path) == names
    assert_same_sequence(open_sequence(tmp_path / target), moving(2, first_frame=first))


def test_frames_off_the_frame_rate_are_numbered_without_gaps_and_note_their_times_and_rate(tmp_path: Path):
    chosen = FrameSelection(moving(9, first_frame=10), [0, 1, 5, 8])
    write_sequence(chosen, tmp_path / "out", fps=12)
    assert names_in(tmp_path / "out") == [f"out.{number:04d}.obj" for number in (5, 6, 7, 8)]
    read = open_sequence(tmp_path / "out")
    assert (read.times.tolist(), read.fps) == (chosen.times.tolist(), 12)


def test_names_and_colours_that_obj_cannot_hold_are_made_to_fit(tmp_path: Path):
    group = Attribute("group", "face", np.zeros(1, np.int32), labels=("a\nv 0 0 0",))
    color = Attribute("color", "vertex", np.array([[255, 0, 51], [0, 0, 0], [0, 255, 0]], np.uint8))
    item = MeshObject("two\nlines \\", TRIANGLE, (group, color))
    write_sequence(ArraySequence(np.eye(3)[None], objects=[item]), tmp_path / "x.obj")
    (read,) = open_sequence(tmp_path / "x.obj").objects
    assert (read.name, read.connectivity.same_as(TRIANGLE)) == ("two lines", True)
    assert read.attributes[1].labels == ("a v 0 0 0",)
    assert np.allclose(read.attributes[0].values, [[1, 0, 0.2], [0, 0, 0], [0, 1, 0]])


@pytest.mark.parametrize("target", ["walk", "walk/", "walk/walk.####.obj"])
def test_frames_that_are_there_are_replaced_only_on_request_and_other_files_stay(tmp_path: Path, target: str):
    write_sequence(moving(5), tmp_path / "walk")
    (tmp_path / "walk" / "notes.txt").write_text("keep")
    before = (tmp_path / "walk" / "walk.0000.obj").read_bytes()
    with pytest.raises(InputError, match="frames exist already"):
        write_sequence(moving(2, first_frame=1), f"{tmp_path}/{target}")
    assert (tmp_path / "walk" / "walk.0000.obj").read_bytes() == before
    write_sequence(moving(2, first_frame=1), f"{tmp_path}/{target}", overwrite=True)
    assert names_in(tmp_path / "walk") == ["notes.txt", "walk.0001.obj", "walk.0002.obj"]
    assert_same_sequence(open_sequence(tmp_path / "walk"), moving(2, first_frame=1))


@pytest.mark.parametrize(
    ("there", "stay"),
    [
        (["wolf-1.obj"], ["wolf-1.obj"]),
        (["wolf-1.obj", "wolf0007.obj"], ["wolf-1.obj"]),
        (["wolf-001.obj", "wolf0007.obj"], []),
        (["wolf-0001.obj", "wolf-0002.obj"], ["wolf-0001.obj", "wolf-0002.obj"]),
        (["wolf1.obj", "wolf0007.obj"], ["wolf1.obj"]),
        (["wolf1.obj", "wolf10.obj"], []),
    ],
)
def test_frames_of_another_name_stay_where_frames_are_replaced(tmp_path: Path, there: list[str], stay: list[str]):
    for name in there:
        (tmp_path / name).write_text("v 0 0 0\n")
    write_sequence(moving(2, first_frame=1), tmp_path / "wolf####.obj", overwrite=True)
    assert names_in(tmp_path) == sorted([*stay, "wolf0001.obj", "wolf0002.obj"])
    assert open_sequence(tmp_path / "wolf####.obj").frame_count == 2
    with pytest.raises(InputError, match="frames exist already"):
        write_sequence(moving(2, first_frame=5), tmp_path / "wolf####.obj")


@pytest.mark.parametrize(
    ("there", "target", "message"),
    [
        ([], "walk.obj", r"3 frames do not fit in one OBJ file; name it walk\.####\.obj"),
        (["head.obj"], ".", r"holds other OBJ files \(head\.obj\)"),
        (["walk"], "walk", "this folder does not exist; make it first"),
    ],
)
def test_an_output_that_cannot_hold_frames_is_refused(tmp_path: Path, there: list[str], target: str, message: str):
    for name in there:
        (tmp_path / name).write_text("v 0 0 0\n")
    with pytest.raises(InputError, match=message):
        write_sequence(moving(3), tmp_path / target, overwrite=True)
    assert names_in(tmp_path) == there
