"""What every format does: motions and what they keep come back, whole or not at all; damage is our error."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.gltf.motion import EXACT
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.sequence import Attribute, Connectivity, MeshObject, MeshSequence
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import (
    IRREGULAR,
    assert_has_attributes,
    assert_lawful,
    assert_same_connectivity,
    body,
    needed,
    scene,
    uv_with_seam,
)
from tests.support.sequence_cases import Failing

COUNTED = ["x.pc2", "x.####.vtu", "x.####.ply"]
"""Formats that count frames."""

TREES = ["x.abc", "x.usda", "x.usdc", "x.usdz", "x.glb", "x.gltf"]

JOINED = ["x.pvd", "x.xdmf", "x.####.vtu", "x.####.ply"]
"""Formats of one mesh without a name."""

EVERY = ["x/", "x.npz", "x.h5", "x.mdd", *COUNTED, *TREES, "x.pvd", "x.xdmf"]

SPACE = {"up_axis": "Y", "unit": "m"}


@pytest.fixture
def path(request: pytest.FixtureRequest, tmp_path: Path) -> str:
    """Where to write a format's files: a name, whose extension may need an extra."""
    needed(request.param.rpartition(".")[2])
    return f"{tmp_path}/{request.param}"


def for_each(*names: str) -> Any:
    return pytest.mark.parametrize("path", names, indirect=True)


def assert_same_motion(read: MeshSequence, clip: MeshSequence, path: str) -> None:
    """Positions to the bit, in glTF to float32 precision; times."""
    points, expected = read.read_frames(0, read.frame_count), clip.read_frames(0, clip.frame_count)
    assert points.shape == expected.shape
    assert np.abs(points - expected).max() <= (EXACT * np.abs(expected).max() if ".gl" in path else 0)
    assert np.allclose(read.times, clip.times, rtol=2.0**-23, atol=1e-9)
    if not path.endswith(("mdd", "pvd", "xdmf")):
        assert read.fps == pytest.approx(clip.fps, rel=1e-6)


@for_each("x.mdd", "x.glb", "x.abc", "x.usdc")
def test_times_that_would_fall_together_are_refused_and_rounding_is_told(path: str) -> None:
    far, close = 1e6 + np.arange(24) / 24, np.arange(24) * 1e-15
    for fine in [far] * path.endswith(("mdd", "glb")) + [close] * (not path.endswith("mdd")):
        with pytest.raises(
            InputError, match=r"frame \d: its time .* and the one before are one in .*; write \.npz or \.h5"
        ):
            write_sequence(scene(times=fine, frames=24, **SPACE), path)
    if path.endswith(("mdd", "glb")):
        far = 1e4 + np.arange(4) / 24
        told = [line for line in write_sequence(scene(times=far, frames=4, **SPACE), path) if "keeps times" in line]
        title = "glTF" if path.endswith("glb") else "MDD point cache"
        assert told == [f"{title} keeps times as float32: they are up to 0.0003 s off"]


@for_each(*EVERY)
def test_positions_and_times_come_back_in_any_block(path: str) -> None:
    clip = scene(**SPACE)
    write_sequence(clip, path)
    with open_sequence(path, fps=24) as read:
        assert_same_motion(read, clip, path)
        assert np.array_equal(read.read_frames(2, 4), read.read_frames(0, 5)[2:4])
        assert read.read_frames(1, 1).shape == (0, 15, 3)
        with pytest.raises(IndexError):
            read.read_frames(3, 6)


@for_each(*(name for name in EVERY if name not in COUNTED))
@pytest.mark.parametrize("times", [IRREGULAR, np.array([2.5])], ids=["irregular", "one"])
def test_times_come_back_that_no_rate_counts(path: str, times: Float64Array) -> None:
    clip = scene(times=times, frames=times.size, **SPACE)
    write_sequence(clip, path, fps=24)
    with open_sequence(path) as read:
        assert_same_motion(read, clip, path)


@for_each(*TREES, "x.npz", "x.h5")
def test_names_faces_attributes_and_metadata_of_a_scene_come_back(path: str) -> None:
    clip = scene(times=IRREGULAR, artist="Bo", up_axis="Z" if ".usd" in path else "Y", unit="m")
    write_sequence(clip, path)
    with open_sequence(path) as read:
        assert dict(read.metadata) == dict(clip.metadata)
        assert read.notices == ()
        assert [item.name for item in read.objects] == [item.name for item in clip.objects]
        for mine, other in zip(read.objects, clip.objects, strict=True):
            assert_same_connectivity(mine.connectivity, other.connectivity)
            assert len(mine.attributes) == len(other.attributes)
            assert_has_attributes(mine, other.attributes, error=1e-7)
    assert_lawful(path)


@for_each(*(name for name in EVERY if name != "x.usdz"))
def test_the_same_sequence_gives_the_same_bytes(path: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    write_sequence(scene(**SPACE), path)
    files = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    monkeypatch.setattr("time.time", lambda: 4e9)
    write_sequence(scene(**SPACE), path, overwrite=True)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == files


@for_each(*EVERY)
def test_what_is_there_is_replaced_only_on_request(path: str, tmp_path: Path) -> None:
    first, second = scene(), scene(frames=2)
    write_sequence(first, path)
    before = sorted(tmp_path.rglob("*"))
    with open_sequence(path, fps=24), pytest.raises(InputError, match=r"exists already|frames are there already"):
        write_sequence(second, path)
    assert sorted(tmp_path.rglob("*")) == before
    told: list[int] = []
    write_sequence(second, path, overwrite=True, progress=lambda done, total, what: told.append(done))
    assert told[-1] == 2
    with open_sequence(path, fps=24) as read:
        assert_same_motion(read, second, path)


@for_each(*EVERY)
def test_a_source_that_fails_leaves_nothing_behind(path: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match="the source broke"):
        write_sequence(Failing(np.zeros((2, 3, 3))), path)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="this folder does not exist"):
        write_sequence(scene(), path.replace("/x", "/no/where/x"))


@pytest.mark.parametrize("value", [np.nan, np.inf])
@for_each("x/", "x.####.obj", "x.glb")
def test_a_position_that_is_not_finite_leaves_nothing_behind(path: str, value: float, tmp_path: Path) -> None:
    clip = scene()
    clip.points[2, 1, 0] = value
    with pytest.raises(InputError, match="frame 2: vertex 1 is not finite"):
        write_sequence(clip, path)
    assert list(tmp_path.iterdir()) == []


MIXES = [
    connectivity_of(4),
    connectivity_of(4, lines=[[0, 1], [2, 3]]),
    connectivity_of(4, lines=[[3, 1, 0, 2], [0, 1]]),
    connectivity_of(4, lines=[[0, 1], [2]]),
    connectivity_of(4, lines=[[0, 1]]),
    connectivity_of(5, faces=[[0, 1, 2]], lines=[[0, 3, 4], [1, 2], [4]]),
    connectivity_of(6, faces=[[0, 1, 2], [2, 1, 0], [3, 3, 4]]),
]

POLYGONS = [
    connectivity_of(4, [[0, 1, 2], [2, 1, 3]]),
    connectivity_of(6, [[0, 1, 2, 3], [2, 1, 4, 5]]),
    connectivity_of(6, [[0, 1, 2], [2, 1, 3, 4], [0, 1, 2, 3, 4], [5, 4, 3]]),
]


@pytest.mark.parametrize(
    ("path", "connectivity"),
    [(name, one) for name in ("x/", "x.npz", "x.xdmf", "x.abc", "x.usdc", "x.glb") for one in MIXES]
    + [(name, one) for name in EVERY if name not in ("x.mdd", "x.pc2") for one in POLYGONS],
    indirect=["path"],
)
def test_any_mix_of_faces_lines_and_points_comes_back(path: str, connectivity: Connectivity) -> None:
    clip = scene([MeshObject("mesh", connectivity)], frames=2, **SPACE)
    write_sequence(clip, path)
    with open_sequence(path, fps=24) as read:
        assert_same_motion(read, clip, path)
        assert_same_connectivity(read.connectivity, connectivity)
    assert_lawful(path)


SHARED = np.array([0, 1, 2, 3, 2, 1, 4], np.int32)
WITHOUT_ONE = np.array([0, 1, 2, 3, -1, 1, 4], np.int32)

ATTRIBUTES = {
    "abc usdc glb": [
        uv_with_seam("uv:second"),
        Attribute("uv", "corner", np.random.default_rng(1).random((7, 2)).astype(np.float32)),
        Attribute("normal_group", "corner", np.array([0, 0, 0, 0, 1, 0, 0], np.int32)),
    ],
    "usdc glb": [Attribute("uv", "corner", np.eye(5, 2, dtype=np.float32), WITHOUT_ONE)],
    "glb": [
        Attribute("color", "vertex", np.eye(5, 4, dtype=np.float32)),
        Attribute("material", "face", np.array([-1, 0], np.int32), labels=("skin",)),
    ],
    "abc usdc": [
        Attribute("uv", "corner", np.eye(5, 2, dtype=np.float32), SHARED),
        Attribute("color:Cd", "face", np.eye(2, 4, dtype=np.float32)),
        Attribute("color", "corner", np.eye(2, 3, dtype=np.float32), SHARED % 2),
        Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("catmull-clark",)),
        Attribute("mass", "vertex", np.arange(5, dtype=np.float32)),
        Attribute("weight", "object", np.array([2.5])),
        Attribute("rest", "vertex", np.eye(5, 3, dtype=np.float32)),
        Attribute("id", "face", np.array([-7, 2**30], np.int32)),
        Attribute("mask", "corner", np.arange(7, dtype=np.uint8)),
        Attribute("patch", "vertex", np.array([0, 1, 1, 0, 2], np.int32), labels=("a", "b ü", "c")),
        Attribute("group:sharing faces", "face", np.array([1, 1], np.uint8)),
    ],
    "usdc": [
        Attribute("uv", "corner", np.eye(5, 3, dtype=np.float32), WITHOUT_ONE),
        Attribute("color", "object", np.ones((1, 3), np.float32)),
        Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("loop",)),
        Attribute("rest", "vertex", np.eye(5, 3)),
        Attribute("id", "face", np.array([-7, 2**40])),
    ],
}


@pytest.mark.parametrize(
    ("path", "attribute"),
    [(f"x.{end}", one) for ends, some in ATTRIBUTES.items() for one in some for end in ends.split()],
    ids=lambda value: f"{value.name}-{value.domain}" if isinstance(value, Attribute) else None,
    indirect=["path"],
)
def test_an_attribute_comes_back_as_it_was(path: str, attribute: Attribute) -> None:
    beside = [Attribute("group:other", "face", np.array([0, 1], np.uint8))] if "group:" in attribute.name else []
    if attribute.name == "subdivision":
        # A subdivision surface has no normals in a file; its edges are kept all the same.
        beside = [ATTRIBUTES["abc usdc glb"][-1]]
    clip = scene([body(attributes=[attribute, *beside])], **SPACE)
    assert not any("no place" in notice for notice in write_sequence(clip, path))
    with open_sequence(path) as read:
        assert len(read.objects[0].attributes) == 1 + len(beside)
        assert_has_attributes(read.objects[0], clip.objects[0].attributes, error=1e-7 if ".glb" in path else 0)
    assert_lawful(path)


@pytest.mark.parametrize(
    ("path", "notices"),
    [
        ("x.abc", ["Alembic has no place for attributes: wide"]),
        ("x.usdc", ["USD has no place for attributes: wide"]),
        ("x.glb", ["glTF has no place for attributes: wide"]),
        ("x/", ["OBJ has no place for attributes: wide", "OBJ has no place for metadata: up_axis, unit"]),
        *((name, ["objects are one", "no place for attributes: uv, group, material"]) for name in JOINED),
        *((name, ["names, faces and attributes come back with --mesh"]) for name in ("x.mdd", "x.pc2")),
    ],
    indirect=["path"],
)
def test_what_is_lost_is_told_by_name(path: str, notices: list[str]) -> None:
    wide = Attribute("wide", "vertex", np.zeros((5, 7), np.float32))
    clip = scene([body("root/a", (*body().attributes, wide)), body("root/b")], **SPACE)
    told = write_sequence(clip, path)
    assert all(any(notice in one for one in told) for notice in notices), told
    with open_sequence(path, fps=24) as read:
        assert_same_motion(read, clip, path)


@for_each("x.abc", "x.usdc", "x.glb", "x.npz")
def test_several_uv_sets_come_back_beside_each_other(path: str) -> None:
    sets = [uv_with_seam(), uv_with_seam("uv:second"), Attribute("uv:third", "corner", np.eye(7, 2, dtype=np.float32))]
    write_sequence(scene([body("a", sets)], **SPACE), path)
    with open_sequence(path) as read:
        assert_has_attributes(read.objects[0], sets, error=1e-7)


@for_each("x.abc", "x.usdc", "x.glb")
def test_names_that_are_one_or_none_are_told_apart_in_a_tree(path: str) -> None:
    clip = scene([body(name, ()) for name in ("a", "a", "", "a/b")], **SPACE)
    told = [line for line in write_sequence(clip, path) if "names" in line]
    with open_sequence(path) as read:
        names = [item.name for item in read.objects]
    if ".glb" in path:  # whose siblings may have one name
        assert (told, names) == ([], ["a", "a", "mesh", "a/b"])
    else:
        assert told == ["names that had to change: 'a' as 'a_2', 'a' as 'a_3', '' as 'mesh'"]
        assert names == ["a_2", "a_3", "mesh", "a/b"]


STARTS = [
    b"<?xml version='1.0'?><VTKFile/>",
    b"ply\nformat odd 9\n",
    b"#usda 1.0\n(",
    b"PXR-USDC",
    b"PK\x03\x04",
    b"glTF",
]


@pytest.mark.parametrize(
    "content", [b"", b"garbage\n" * 40, b"{}", b"Ogawa", b"\x89HDF\r\n\x1a\n" + bytes(99), *STARTS]
)
@pytest.mark.parametrize(
    "extension",
    [
        "npz",
        "h5",
        "mdd",
        "pc2",
        "abc",
        "usd",
        "usda",
        "usdc",
        "usdz",
        "glb",
        "gltf",
        "xdmf",
        "pvd",
        "vtu",
        "vtp",
        "vtk",
        "ply",
        "stl",
        "off",
        "e",
        "obj",
    ],
)
def test_what_is_none_of_these_files_is_refused_in_one_line(
    tmp_path: Path, extension: str, content: bytes, capsys: pytest.CaptureFixture[str]
) -> None:
    needed(extension)
    (tmp_path / f"x.{extension}").write_bytes(content)
    with pytest.raises(InputError) as caught:
        open_sequence(tmp_path / f"x.{extension}")
    assert caught.value.path is not None
    assert "\n" not in str(caught.value)
    assert capsys.readouterr() == ("", "")


@for_each("x.npz", "x.h5", "x.mdd", "x.pc2", "x.abc", "x.glb", "x.gltf")
def test_a_file_cut_or_changed_anywhere_gives_frames_or_our_error(path: str) -> None:
    write_sequence(scene([body()], frames=2, **SPACE), path)
    whole = Path(path).read_bytes()
    damaged = [whole[:length] for length in range(0, len(whole), max(1, len(whole) // 60))]
    # The binding of Alembic may crash on a file that is damaged inside.
    places = () if ".abc" in path else (*range(32), *range(32, len(whole), max(1, len(whole) // 60)))
    damaged += [whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :] for place in places]
    for number, content in enumerate(damaged):
        Path(path).write_bytes(content)
        with contextlib.suppress(InputError), open_sequence(path, fps=25) as read:
            assert number >= 30
            assert read.read_frames(0, read.frame_count).shape == (read.frame_count, read.vertex_count, 3)


def test_a_format_needs_no_name_that_says_it(tmp_path: Path) -> None:
    needed("abc")
    write_sequence(scene(), tmp_path / "x.abc")
    (tmp_path / "x.abc").rename(tmp_path / "x")
    with open_sequence(tmp_path / "x") as read:
        assert read.vertex_count == 15


@for_each(*EVERY)
@pytest.mark.parametrize("first", [True, False])
def test_objects_without_vertices_stand_in_nobodys_way_and_are_told(path: str, first: bool) -> None:
    parts = [body("rig/full", ()), MeshObject("rig/empty", Connectivity(0))]
    clip = scene(parts[:: -1 if first else 1], **SPACE)
    told = write_sequence(clip, path)
    kept = path.endswith(("npz", "h5"))
    assert ("objects without vertices do not come back: rig/empty" in told) != kept
    with open_sequence(path, fps=24) as read:
        assert_same_motion(read, clip, path)
        assert len(read.objects) == (2 if kept else 1)
    assert_lawful(path)
