"""The contract of every format: what :mod:`tests.formats.contract` declares to survive a round trip does survive."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from pdecodec import (
    ArraySequence,
    Attribute,
    ChangingSequence,
    Connectivity,
    Field,
    InputError,
    MeshObject,
    MeshSequence,
    PdecodecError,
)
from pdecodec.formats import list_formats, open_sequence, write_sequence
from pdecodec.formats.base import registry
from pdecodec.mesh.arrays import Float32Array
from tests.formats.contract import ATTRIBUTES, CONTRACT, SHAPES, Holds
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import (
    IRREGULAR,
    SPACE,
    assert_lawful,
    assert_same_connectivity,
    body,
    meaning_of,
    needed,
    scene,
)
from tests.support.sequence_cases import Failing, assert_same_attributes

SOUP = connectivity_of(6, [[0, 1, 2], [3, 4, 5]])
"""A shape that every format can hold: triangles without shared vertices."""

NAMES = [
    *(
        "with space",
        "a/b c",
        "ü 二",
        'quo"te',
        "it's",
        "back\\slash",
        "semi;colon=1",
        "x" * 300,
        "tab\tname",
        "new\nline",
    ),
    *("", ".", "..", "a/../b", "%04d", "a.####", "<&>", "0start", "trailing/", "/leading", "a//b", "a", "end\\"),
]


def each_format(*unlike: str, **wanted: Any) -> Any:
    """Parametrise a test with every format whose entry has certain values, except for some files."""
    chosen = [one for one in CONTRACT if one.file not in unlike]
    chosen = [one for one in chosen if all(getattr(one, name) == value for name, value in wanted.items())]
    return pytest.mark.parametrize("held", chosen, ids=lambda one: one.file)


def clip(frames: int = 5, times: NDArray[np.float64] | None = None) -> ArraySequence:
    return scene([MeshObject("mesh", SOUP)], times, frames=frames, **SPACE)


def assert_same_motion(read: MeshSequence, expected: MeshSequence, held: Holds) -> None:
    """Assert that positions agree within the error of the format, and times within a nanosecond or to float32."""
    points, wanted = read.read_frames(0, read.frame_count), expected.read_frames(0, expected.frame_count)
    assert points.shape == wanted.shape
    assert np.abs(points - wanted).max() <= held.error * np.abs(wanted).max()
    assert np.allclose(read.times, expected.times, rtol=2.0**-23, atol=1e-9)


def scenes(held: Holds, objects: Sequence[MeshObject]) -> Iterator[ArraySequence]:
    """Yield the objects as one scene or, if the format joins objects, one scene for each."""
    for part in [objects] if held.names != "one" else [[one] for one in objects]:
        yield scene(part, frames=2, **SPACE)


def by_object(sequence: MeshSequence) -> list[tuple[MeshObject, NDArray[np.float32]]]:
    points = sequence.read_frames(0, sequence.frame_count)
    ends = np.cumsum([item.vertex_count for item in sequence.objects])
    return list(zip(sequence.objects, np.split(points, ends[:-1], axis=1), strict=True))


def assert_same_attribute(held: Holds, found: Attribute, expected: Attribute) -> None:
    """Assert that attributes are equal: bit by bit if a format keeps everything, otherwise in meaning."""
    if held.names == "all":
        assert_same_attributes([found], [expected])
        return
    assert found.domain == expected.domain
    mine, other = meaning_of(found), meaning_of(expected)
    if mine.dtype.kind == "U":
        assert mine.tolist() == other.tolist()
    else:
        # The format may add an alpha of one to colours.
        assert np.abs(mine[..., : other.shape[-1]] - other).max() <= held.attribute_error
    if expected.indices is not None and expected.name.startswith("uv"):
        assert found.indices is not None
        assert found.indices.tolist() == expected.indices.tolist()


def test_every_format_that_is_read_is_in_the_contract() -> None:
    ends = {Path(one.file).suffix or ".obj" for one in CONTRACT}
    assert [entry.name for entry in list_formats() if entry.reads and not ends & set(entry.extensions)] == []


@each_format()
def test_positions_times_and_order_come_back_in_any_block(held: Holds, tmp_path: Path) -> None:
    expected, path = clip(), held.path(tmp_path)
    held.write(expected, path)
    with held.open(path) as read:
        assert_same_motion(read, expected, held)
        assert read.fps == pytest.approx(24, rel=1e-6)
        assert_same_connectivity(read.connectivity, SOUP)
        assert [item.name for item in read.objects] == ["mesh"]
        assert np.array_equal(read.read_frames(2, 4), read.read_frames(0, 5)[2:4])
        assert read.read_frames(1, 1).shape == (0, 6, 3)
        with pytest.raises(IndexError):
            read.read_frames(3, 6)


@each_format(times="all")
@pytest.mark.parametrize("times", [IRREGULAR, np.array([2.5])], ids=["irregular", "one"])
def test_times_come_back_that_no_rate_counts(held: Holds, times: NDArray[np.float64], tmp_path: Path) -> None:
    expected, path = clip(times.size, times), held.path(tmp_path)
    held.write(expected, path)
    with held.open(path) as read:
        assert_same_motion(read, expected, held)


@each_format("x.npz", "x.h5", "x/", "x.pvd", "x.xdmf", "x.e", times="all", written=True)
def test_times_that_would_fall_together_are_refused_and_rounding_is_noted(held: Holds, tmp_path: Path) -> None:
    path, is_float32 = held.path(tmp_path), held.file.endswith(("mdd", "glb", "gltf"))
    # glTF stores times relative to the first one.
    far, close = np.append(0, 1e6 + np.arange(23) / 24), np.arange(24) * 1e-15
    for fine in [far] * is_float32 + [close] * (not path.endswith("mdd")):
        with pytest.raises(InputError, match=r"frame \d: its time .* equals the previous one in .*; write \.npz"):
            write_sequence(clip(24, fine), path)
    if is_float32:
        told = [
            line
            for line in write_sequence(clip(5, np.append(0, 1e4 + np.arange(4) / 24)), path)
            if "keeps times" in line
        ]
        title = "MDD point cache" if path.endswith("mdd") else "glTF"
        assert told == [f"{title} keeps times as float32: they are up to 0.0003 s off"]


@each_format()
@pytest.mark.parametrize("scale", [1e-36, 1e36])
def test_positions_of_any_size_come_back(held: Holds, scale: float, tmp_path: Path) -> None:
    expected, path = clip(2), held.path(tmp_path)
    expected.points *= np.float32(scale)
    held.write(expected, path)
    with held.open(path) as read:
        assert_same_motion(read, expected, held)


@each_format()
def test_positions_that_are_not_finite_come_back_or_leave_no_file(held: Holds, tmp_path: Path) -> None:
    expected, path = clip(), held.path(tmp_path)
    for value in (np.nan, np.inf):
        expected.points[2, 1, 0] = value
        if not held.infinite:
            with pytest.raises(InputError, match="finite") as caught:
                held.write(expected, path)
            assert caught.value.frame == 2
            assert list(tmp_path.iterdir()) == []
    if held.infinite:
        held.write(expected, path)
        with held.open(path) as read:
            assert np.array_equal(read.read_frames(0, 5), expected.points, equal_nan=True)


@each_format()
def test_any_mix_of_faces_lines_and_points_comes_back(held: Holds, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    for number, expected in enumerate(scenes(held, [MeshObject(name, SHAPES[name]) for name in held.shapes])):
        place = path.replace("/x", f"/x{number}")
        held.write(expected, place)
        with held.open(place) as read:
            assert_same_motion(read, expected, held)
            for mine, other in zip(read.objects, expected.objects, strict=True):
                assert_same_connectivity(mine.connectivity, other.connectivity)
                assert held.names == "one" or mine.name == other.name
        assert_lawful(place)


def told_objects() -> Mapping[str, MeshObject]:
    """Return an object for each attribute, with other attributes if that attribute needs them."""
    others = {
        "group overlapping": [Attribute("group:other", "face", np.array([0, 1], np.uint8))],
        # A subdivision surface has no normals in a file, but its hard edges are kept.
        "catmull-clark": [ATTRIBUTES["edges"]],
    }
    return {name: body(name, [one, *others.get(name, [])]) for name, one in ATTRIBUTES.items()}


@each_format()
def test_attributes_and_metadata_come_back_or_are_named(held: Holds, tmp_path: Path) -> None:
    path, objects = held.path(tmp_path), told_objects()
    kept = objects if held.written else {name: objects[name] for name in held.attributes}
    for number, expected in enumerate(scenes(held, list(kept.values()))):
        expected.metadata |= {"artist": "Bo"}
        place = path.replace("/x", f"/x{number}")
        told = " ".join(held.write(expected, place) or ())
        with held.open(place) as read:
            assert_same_motion(read, expected, held)
            if held.metadata:
                assert dict(read.metadata) == dict(expected.metadata)
            told += " ".join(read.notices)
            for mine, other in zip(read.objects, expected.objects, strict=True):
                found = {one.name: one for one in mine.attributes}
                if other.name not in held.attributes:
                    (one,) = other.attributes[:1]
                    if one.name in [field.name for field in read.fields]:  # the format may store it as a field
                        shown = one.values / np.float32(255) if one.values.dtype == np.uint8 else one.values
                        assert np.array_equal(read.read_field(one.name, 0, 1)[0], shown)
                    else:
                        assert one.name in told
                    continue
                for one in other.attributes:
                    assert_same_attribute(held, found[one.name], one)
                assert not found.keys() - {one.name for one in other.attributes} - {"normal_group"}
        assert held.metadata or not held.written or "artist" in told
        assert_lawful(place)


@each_format()
def test_fields_come_back_or_are_named(held: Holds, tmp_path: Path) -> None:
    if not held.written:
        return
    frames, body_of = 3, MeshObject("mesh", connectivity_of(5, [[0, 1, 2], [2, 1, 3, 4]]))
    rows = {"vertex": 5, "face": 2, "corner": 7, "object": 1}
    random = np.random.default_rng(2)
    fields = [
        (Field(f"{domain} {dtype} <&>", domain, np.dtype(dtype), width),
         random.integers(0, 100, (frames, count, width)[: 3 if width > 1 else 2]).astype(dtype))
        for domain, count in rows.items() for dtype, width in (("f4", 1), ("f8", 3), ("i4", 1), ("u1", 2))
    ]  # fmt: skip
    fields[0][1][1, 2] = np.nan
    points = np.random.default_rng(1).random((frames, 5, 3)).astype(np.float32)
    given = ArraySequence(points, objects=[body_of], times=np.arange(frames) / 24, fields=fields)
    path = held.path(tmp_path)
    told = " ".join(held.write(given, path) or ())
    with held.open(path) as read:
        found = {field.name: field for field in read.fields}
        for field, values in fields:
            if field.domain not in held.fields:
                assert field.name in told
                assert field.name not in found
                continue
            assert found[field.name] == field
            np.testing.assert_array_equal(read.read_field(field.name, 1, frames), values[1:])


@each_format()
def test_odd_names_come_back_or_are_noted(held: Holds, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    expected = scene([MeshObject(name, SOUP) for name in NAMES], frames=1, **SPACE)
    told = "".join(held.write(expected, path) or ())
    with held.open(path) as read:
        if held.names == "one":
            assert_same_motion(read, expected, held)
            return
        # Objects below one branch of a tree are consecutive.
        left = by_object(read)
        assert len(left) == len(NAMES)
        for item, points in by_object(expected):
            near = [np.abs(points - other).max() for _, other in left]
            found, _ = left.pop(int(np.argmin(near)))
            assert min(near) <= 10 * held.error * np.abs(points).max()
            assert found.name == item.name or (held.names == "tree" and f"{item.name!r} as {found.name!r}" in told)
    assert_lawful(path)


@each_format(names="tree")
def test_equal_names_and_names_of_branches_are_made_distinct(held: Holds, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    told = "".join(held.write(scene([body(name, ()) for name in ("a", "a", "a/b")], **SPACE), path))
    with held.open(path) as read:
        names = [item.name for item in read.objects]
        told += "".join(read.notices)
    if held.file == "x/":
        assert names == ["mesh"]
        assert "several objects are called 'a': the file is one object" in told
    elif ".gl" in path:  # in these formats siblings may have equal names
        assert names == ["a", "a", "a/b"]
    else:
        assert names == ["a_2", "a_3", "a/b"]
        assert "names that had to change: 'a' as 'a_2', 'a' as 'a_3'" in told


@each_format()
def test_connectivity_that_changes_comes_back_or_is_refused(held: Holds, tmp_path: Path) -> None:
    path, runs, first = held.path(tmp_path), [], 1
    for frames, count in ((2, 2), (1, 3), (2, 1)):
        faces = MeshObject("mesh", connectivity_of(3 * count, np.arange(3 * count).reshape(-1, 3)))
        points = np.random.default_rng(first).normal(size=(frames, 3 * count, 3))
        runs.append(ArraySequence(points, objects=[faces], times=(first + np.arange(frames)) / 24))
        first += frames
    changing = ChangingSequence(runs, metadata=SPACE)
    if not held.runs:
        with pytest.raises(InputError, match="connectivity") as caught:
            held.write(changing, path)
        assert caught.value.frame == 2
        return
    for part in [changing] if held.written or held.times == "all" else runs:
        held.write(part, path)
    with held.open(path) as read:
        assert read.run_starts.tolist() == [0, 2, 3]
        for mine, other in zip(read.runs, runs, strict=True):
            assert_same_motion(mine, other, held)
            assert_same_connectivity(mine.connectivity, other.connectivity)


@each_format()
@pytest.mark.parametrize("first", [True, False])
def test_objects_without_vertices_are_kept_or_noted_and_harm_no_other(held: Holds, first: bool, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    parts = [MeshObject("rig/full", SOUP), MeshObject("rig/empty", Connectivity(0))]
    expected = scene(parts[:: -1 if first else 1], **SPACE)
    told = held.write(expected, path) or ()
    assert ("objects without vertices are lost: rig/empty" in told) == (held.written and not held.empty)
    with held.open(path) as read:
        assert_same_motion(read, expected, held)
        assert len(read.objects) == (2 if held.empty else 1)
    assert_lawful(path)


@each_format(written=True, bytes_again=True)
def test_the_same_sequence_gives_the_same_bytes(held: Holds, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = held.path(tmp_path)
    held.write(clip(), path)
    files = {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()}
    monkeypatch.setattr("time.time", lambda: 4e9)
    held.write(clip(), path, overwrite=True)
    assert {file: file.read_bytes() for file in tmp_path.rglob("*") if file.is_file()} == files


@each_format(written=True)
def test_an_existing_file_is_replaced_only_on_request(held: Holds, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    first, second = clip(), clip(2)
    held.write(first, path)
    before = sorted(tmp_path.rglob("*"))
    with held.open(path), pytest.raises(InputError, match=r"exists already|frames exist already"):
        held.write(second, path)
    assert sorted(tmp_path.rglob("*")) == before
    told: list[int] = []
    held.write(second, path, overwrite=True, progress=lambda done, total, what: told.append(done))
    assert told[-1] == 2
    with held.open(path) as read:
        assert_same_motion(read, second, held)


@each_format(written=True)
def test_a_source_that_fails_leaves_nothing_behind(held: Holds, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    with pytest.raises(InputError, match="the source broke"):
        held.write(Failing(np.zeros((2, 3, 3))), path)
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(InputError, match="this folder does not exist"):
        held.write(clip(), path.replace("/x", "/no/where/x"))


STARTS = [
    *(b"", b"garbage\n" * 40, b"{}", b"Ogawa", b"\x89HDF\r\n\x1a\n" + bytes(99), b"<?xml version='1.0'?><VTKFile/>"),
    *(b"ply\nformat odd 9\n", b"#usda 1.0\n(", b"PXR-USDC", b"PK\x03\x04", b"glTF"),
]


@pytest.mark.parametrize("extension", [end for entry in list_formats() for end in entry.extensions])
def test_files_of_other_content_are_refused_in_one_line(
    tmp_path: Path, extension: str, capsys: pytest.CaptureFixture[str]
) -> None:
    needed(extension[1:])
    for content in STARTS:
        (tmp_path / f"x{extension}").write_bytes(content)
        with pytest.raises(PdecodecError) as caught:
            open_sequence(tmp_path / f"x{extension}")
        assert caught.value.path is not None
        assert "\n" not in str(caught.value)
    assert capsys.readouterr() == ("", "")


@each_format("x.usda", "x.usdc", "x.usdz")
def test_a_file_cut_or_changed_anywhere_gives_frames_or_our_error(held: Holds, tmp_path: Path) -> None:
    path = held.path(tmp_path)
    held.write(scene([body() if held.attributes else MeshObject("mesh", SOUP)], frames=2, **SPACE), path)
    file = next(one for one in sorted(tmp_path.rglob("*")) if one.is_file())
    whole = file.read_bytes()
    step = max(1, len(whole) // 25)
    damaged = [whole[:length] for length in range(0, len(whole), step)]
    # Alembic's Python binding may crash on a file that is damaged inside.
    places = () if ".abc" in path else (*range(16), *range(16, len(whole), step))
    damaged += [whole[:place] + bytes([whole[place] ^ 0xFF]) + whole[place + 1 :] for place in places]
    for content in damaged:
        file.write_bytes(content)
        with contextlib.suppress(PdecodecError), held.open(path) as read:
            assert read.read_frames(0, read.frame_count).shape == (read.frame_count, read.vertex_count, 3)


@each_format("x.npz", "x.h5", written=True)
def test_writers_take_a_few_frames_at_a_time(held: Holds, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    taken = []

    class Watched(ArraySequence):
        def read_frames(self, start: int, stop: int) -> Float32Array:
            taken.append(stop - start)
            return super().read_frames(start, stop)

    moving = clip(frames=24)
    monkeypatch.setattr(registry, "WRITTEN_BYTES", 3 * moving.points[0].nbytes)
    held.write(Watched(moving.points, objects=moving.objects, fps=24, metadata=SPACE), held.path(tmp_path))
    assert sum(taken) >= 24
    assert max(taken) <= 3


def test_a_format_is_recognised_whatever_the_name_of_the_file(tmp_path: Path) -> None:
    needed("abc")
    write_sequence(scene(), tmp_path / "x.abc")
    (tmp_path / "x.abc").rename(tmp_path / "x")
    with open_sequence(tmp_path / "x") as read:
        assert read.vertex_count == 15
