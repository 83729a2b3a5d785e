"""OBJ files that cannot be used: one line that says what is wrong, where, and what to do."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence

THREE = "v 0 0 0\nv 1 0 0\nv 0 1 0\n"


def refused(path: Path, text: str | bytes) -> InputError:
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    with pytest.raises(InputError) as caught:
        open_sequence(path)
    assert caught.value.path == str(path)
    assert "\n" not in str(caught.value)
    return caught.value


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("v 0 0 zero\n", "line 1: expected a number, found 'zero'"),
        (THREE + "v 1,5 0 0\n", "line 4: expected a number, found '1,5'"),
        (THREE + "vt x 0\n", "line 4: expected a number, found 'x'"),
        (THREE + "v 0 0\n", "line 4: 'v' has an unusual count of numbers"),
        (THREE + "v 0 0 0 1 2\n", "line 4: 'v' has an unusual count of numbers"),
        (THREE + "v 0 0 0 1 2 3 4 5\n", "line 4: 'v' has an unusual count of numbers"),
        (THREE + "vt\n", "line 4: 'vt' has an unusual count of numbers"),
        (THREE + "f 1 2 4\n", "line 4: '4' refers to a vertex that is not there, the file has 3"),
        (THREE + "f 1 2 -4\n", "line 4: '-4' refers to a vertex that is not there"),
        (THREE + "f 1 2 99999999999999999999\n", "line 4: expected a vertex index"),
        (THREE + "f 1 2 4294967297\n", "line 4: '4294967297' refers to a vertex that is not there"),
        (THREE + "f 0 1 2\n", "line 4: index 0 in '0'"),
        (THREE + "vt 0 0\nf 1/0 2/1 3/1\n", "line 5: index 0 in '1/0'"),
        (THREE + "vn 0 0 1\nf 1//0 2//1 3//1\n", "line 5: index 0 in '1//0'"),
        (THREE + "vt 0 0\nf 1/2 2/1 3/1\n", "line 5: '1/2' refers to a texture vertex that is not there"),
        (THREE + "vt 0 0\nf 1/-2 2/1 3/1\n", "line 5: '1/-2' refers to a texture vertex that is not there"),
        (THREE + "f 1 2\n", "line 4: 'f' has too few vertices"),
        (THREE + "f\n", "line 4: 'f' has too few vertices"),
        (THREE + "l 1\n", "line 4: 'l' has too few vertices"),
        (THREE + "p\n", "line 4: 'p' has too few vertices"),
        (THREE + "f 1 2 three\n", "line 4: expected a vertex index, found 'three'"),
        (THREE + "f 1 2 3.5\n", "line 4: expected a vertex index, found '3.5'"),
        (THREE + "f 1/1/1/1 2 3\n", "line 4: expected a vertex index, found '1/1/1/1'"),
        (THREE + "f 1//1/1 2 3\n", "line 4: expected a vertex index, found '1//1/1'"),
        (THREE + "f 1 2 \\\n\\\n x\n", "line 6: expected a vertex index, found 'x'"),
        (THREE + "s green\n", "line 4: a smoothing group is a number or off, not 'green'"),
        (THREE + "curv 0 1 1 2\n", r"line 4: curves and surfaces \(curv\) are not read"),
        (THREE + "<xml>\n", "line 4: '<xml>' is not an OBJ statement"),
        ("f 1 2 3\n", "there are no vertices"),
        ("o name\n", "there are no vertices"),
        ("", "the file is empty"),
        (" \n\n", "the file is empty"),
        (b"\x88HDX\r\n\x1a\n\0\0\0\0", "not OBJ text, it holds zero bytes"),
        (THREE.encode("utf-16"), "not OBJ text, it holds zero bytes"),
    ],
)
def test_a_broken_file_is_refused_with_its_line(tmp_path: Path, text: str | bytes, message: str):
    assert refused(tmp_path / "mesh.obj", text).frame == 0
    with pytest.raises(InputError, match=message):
        open_sequence(tmp_path / "mesh.obj")


def test_what_is_not_there_is_refused(tmp_path: Path):
    for name, message in [
        ("missing.obj", "there is no such file"),
        ("missing.####.obj", "no frame matches"),
        ("nowhere/missing.####.obj", "this folder does not exist"),
        (".", "this folder holds no frames"),
    ]:
        with pytest.raises(InputError, match=message):
            open_sequence(tmp_path / name)


def test_a_folder_named_like_a_file_without_frames_is_refused(tmp_path: Path):
    (tmp_path / "mesh.obj").mkdir()
    with pytest.raises(InputError, match="holds no frames"):
        open_sequence(tmp_path / "mesh.obj")


@settings(deadline=None, max_examples=150)
@given(st.binary(max_size=200))
def test_random_bytes_are_refused(tmp_path_factory: pytest.TempPathFactory, noise: bytes):
    path = tmp_path_factory.mktemp("noise") / "mesh.obj"
    path.write_bytes(noise)
    with pytest.raises(InputError):
        open_sequence(path)


@settings(deadline=None, max_examples=300)
@given(
    st.integers(0, 10**6),
    st.sampled_from([b"\n", b"/", b"-", b" ", b"v", b"f", b"#", b"\\", b"9", b"e", b".", b"\xff", b"\r", b""]),
)
def test_a_file_with_one_byte_changed_is_refused_or_read_with_indices_in_range(
    tmp_path_factory: pytest.TempPathFactory, place: int, byte: bytes
):
    text = (THREE + "vt 0 0\nvn 0 0 1\no a\ng b\nusemtl c\ns 1\nf 1/1/1 2/1/1 -1/-1/-1\nl 1 2\np 3\n").encode()
    place %= len(text)
    path = tmp_path_factory.mktemp("changed") / "mesh.obj"
    path.write_bytes(text[:place] + byte + text[place + 1 :])
    try:
        sequence = open_sequence(path)
    except InputError:
        return
    points = sequence.read_frames(0, 1)
    assert points.shape == (1, sequence.vertex_count, 3)
    used = np.concatenate([sequence.connectivity.face_indices, sequence.connectivity.line_indices])
    assert ((used >= 0) & (used < points.shape[1])).all()


def test_a_file_cut_at_any_byte_is_refused_or_read(tmp_path: Path):
    text = (THREE + "vt 0 0\no a\ng b\nf 1/1 2/1 3/1\n").encode()
    path = tmp_path / "mesh.obj"
    read = 0
    for length in range(len(text)):
        path.write_bytes(text[:length])
        try:
            sequence = open_sequence(path)
        except InputError:
            continue
        read += 1
        assert 1 <= sequence.read_frames(0, 1).shape[1] <= 3
    assert 0 < read < len(text)
