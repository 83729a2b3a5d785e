"""Alembic: scenes in and out, in the tree and at the times they have."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.attribute_roles import reversed_corners
from pdecodec.formats.transforms import bake_transforms, transform_attribute
from pdecodec.formats.velocities import DifferencedVelocities
from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.mesh_cases import connectivity_of
from tests.scene_cases import (
    ABC_ARRAYS,
    IRREGULAR,
    array_of,
    assert_same_scene,
    body,
    scene,
    uv_with_seam,
)

pytest.importorskip("alembic3d", reason="Alembic is not installed here (pip install 'pdecodec[abc]')")

from alembic3d import Abc, AbcCoreAbstract, AbcGeom


@pytest.mark.parametrize("times", [None, IRREGULAR], ids=["regular", "irregular"])
def test_a_scene_comes_back_with_its_tree_attributes_and_times(tmp_path: Path, times: np.ndarray | None) -> None:
    clip = scene(times=times, up_axis="Y", unit="cm")
    assert write_sequence(clip, tmp_path / "x.abc") == ()
    with open_sequence(tmp_path / "x.abc") as read:
        assert_same_scene(read, clip)
        assert dict(read.metadata) == {"up_axis": "Y", "unit": "cm"}
        assert read.notices == ()
        assert np.array_equal(read.read_frames(2, 4), clip.points[2:4])


def test_the_same_scene_gives_the_same_bytes(tmp_path: Path) -> None:
    write_sequence(scene(), tmp_path / "a.abc")
    write_sequence(scene(), tmp_path / "b.abc")
    assert (tmp_path / "a.abc").read_bytes() == (tmp_path / "b.abc").read_bytes()


@pytest.mark.parametrize(
    "attribute",
    [
        uv_with_seam("uv:second"),
        Attribute("uv", "corner", np.random.default_rng(1).random((7, 2)).astype(np.float32)),
        Attribute("uv", "corner", np.eye(5, 2, dtype=np.float32), np.array([0, 1, 2, 3, 2, 1, 4], np.int32)),
        Attribute("color:Cd", "face", np.eye(2, 4, dtype=np.float32)),
        Attribute("color", "corner", np.eye(2, 3, dtype=np.float32), np.array([0, 1, 0, 1, 0, 1, 0], np.int32)),
        Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("catmull-clark",)),
        Attribute("mass", "vertex", np.arange(5, dtype=np.float32)),
        Attribute("weight", "object", np.array([2.5])),
        Attribute("rest", "vertex", np.eye(5, 3, dtype=np.float32)),
        Attribute("id", "face", np.array([-7, 2**30], np.int32)),
        Attribute("mask", "corner", np.arange(7, dtype=np.uint8)),
        Attribute("patch", "vertex", np.array([0, 1, 1, 0, 2], np.int32), labels=("a", "b ü", "c")),
    ],
    ids=lambda attribute: f"{attribute.name}-{attribute.domain}",
)
def test_an_attribute_comes_back_as_it_was(tmp_path: Path, attribute: Attribute) -> None:
    clip = scene([body(attributes=[attribute])])
    assert write_sequence(clip, tmp_path / "x.abc") == ()
    with open_sequence(tmp_path / "x.abc") as read:
        assert_same_scene(read, clip)


def test_face_sets_that_share_faces_come_back_as_masks(tmp_path: Path) -> None:
    masks = [
        Attribute(f"group:{name}", "face", np.array(mask, np.uint8)) for name, mask in (("a", [1, 1]), ("b", [0, 1]))
    ]
    clip = scene([body(attributes=masks)])
    write_sequence(clip, tmp_path / "x.abc")
    with open_sequence(tmp_path / "x.abc") as read:
        assert_same_scene(read, clip)


def test_what_has_no_place_is_told_by_name(tmp_path: Path) -> None:
    item = body(attributes=[Attribute("wide", "vertex", np.zeros((5, 7), np.float32))])
    assert write_sequence(scene([item]), tmp_path / "x.abc") == ("Alembic has no place for attributes: wide",)


@pytest.mark.parametrize(
    "connectivity",
    [
        connectivity_of(4),
        connectivity_of(4, lines=[[0, 1], [2, 3]]),
        connectivity_of(4, lines=[[3, 1, 0, 2], [0, 1]]),
        connectivity_of(4, lines=[[0, 1], [2]]),
        connectivity_of(4, lines=[[0, 1]]),
        connectivity_of(4, faces=[[0, 1, 2]], lines=[[0, 3]]),
        connectivity_of(4, faces=[[0, 1, 2], [3, 2, 1, 0]]),
    ],
)
def test_any_mix_of_faces_lines_and_points_comes_back(tmp_path: Path, connectivity: Connectivity) -> None:
    clip = scene([MeshObject("thing", connectivity)])
    write_sequence(clip, tmp_path / "x.abc")
    with open_sequence(tmp_path / "x.abc") as read:
        assert_same_scene(read, clip)


def test_faces_run_the_other_way_round_in_the_file(tmp_path: Path) -> None:
    write_sequence(scene([MeshObject("a", connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]]))]), tmp_path / "x.abc")
    mesh = AbcGeom.IPolyMesh(Abc.IArchive(str(tmp_path / "x.abc")).getTop(), "a")
    assert np.asarray(mesh.getSchema().getValue().getFaceIndices()).tolist() == [3, 2, 1, 0, 4, 1, 2]


def test_names_that_are_one_or_none_are_told_apart(tmp_path: Path) -> None:
    parts = [MeshObject(name, connectivity_of(3, [[0, 1, 2]])) for name in ("a", "a", "", "a/b")]
    notices = write_sequence(scene(parts), tmp_path / "x.abc")
    assert notices[0].startswith("names that had to change: 'a' as 'a_2', 'a' as 'a_3', '' as 'mesh'")
    with open_sequence(tmp_path / "x.abc") as read:
        assert [item.name for item in read.objects] == ["a_2", "a_3", "mesh", "a/b"]


def spun(frames: int = 5) -> ArraySequence:
    """Two objects under one moving step each, one that stands still, one at the top that moves."""
    clip = scene([body("a/one", ()), body("b/two", ()), body("b/c/three", ()), body("four", ())], frames=frames)
    turns = np.repeat(np.eye(4)[None], frames, axis=0)
    turns[:, :2, :2] = [[[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]] for t in clip.times]
    turns[:, 3, 2] = np.arange(frames)
    placed = [
        MeshObject(item.name, item.connectivity, (transform_attribute(clip.times, turns),) if moves else ())
        for item, moves in zip(clip.objects, (True, True, False, True), strict=True)
    ]
    return ArraySequence(clip.points, objects=placed, times=clip.times, fps=24)


def test_kept_transforms_come_back_and_bake_to_the_same_positions(tmp_path: Path) -> None:
    clip = spun()
    notices = write_sequence(clip, tmp_path / "x.abc")
    assert notices == ("transforms applied to positions, as there is no place for them: four",)
    baked = bake_transforms(clip).read_frames(0, 5)
    with open_sequence(tmp_path / "x.abc", transforms="keep") as read:
        kept = read.read_frames(0, 5)
        assert np.array_equal(kept[:, :15], clip.points[:, :15])
        assert np.array_equal(kept[:, 15:], baked[:, 15:])
        assert np.allclose(bake_transforms(read).read_frames(0, 5), baked, atol=1e-6)
        assert [bool(item.attributes) for item in read.objects] == [True, True, False, False]
    with open_sequence(tmp_path / "x.abc") as read:
        assert np.allclose(read.read_frames(0, 5), baked, atol=1e-6)
        assert np.array_equal(read.read_frames(3, 5), read.read_frames(0, 5)[3:])


def test_velocities_are_written_beside_positions(tmp_path: Path) -> None:
    clip = scene([body()])
    speeds = DifferencedVelocities(clip)
    write_sequence(clip, tmp_path / "x.abc", velocities=speeds)
    archive = Abc.IArchive(str(tmp_path / "x.abc"))
    schema = AbcGeom.IPolyMesh(archive.getTop().getChild("root").getChild("arm"), "hand").getSchema()
    stored = schema.getVelocitiesProperty()
    for frame, time in enumerate(clip.times):
        values = np.asarray(stored.getValue(Abc.ISampleSelector(float(time))))
        assert np.array_equal(values, speeds.read_frames(frame, frame + 1)[0])
    with open_sequence(tmp_path / "x.abc") as read:
        assert read.notices == ("not kept: velocities",)


def by_hand(path: Path, samples: list[tuple[list[int], list[int]]], *, points: int = 4) -> None:
    """A mesh written with the library itself, with a sample of counts and indices for each frame."""
    import imath

    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 0.0))
    schema = AbcGeom.OPolyMesh(archive.getTop(), "changing", sampling).getSchema()
    for counts, indices in samples:
        sample = AbcGeom.OPolyMeshSchemaSample(
            imath.V3fArrayFromBuffer(np.random.default_rng(1).random((points, 3)).astype(np.float32)),
            imath.IntArrayFromBuffer(np.array(indices, np.int32)),
            imath.IntArrayFromBuffer(np.array(counts, np.int32)),
        )
        schema.set(sample)


def test_faces_that_change_are_refused_with_the_object_and_the_frame(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([3], [0, 1, 2]), ([3], [0, 1, 2]), ([4], [0, 1, 2, 3])])
    with pytest.raises(InputError, match=r"object 'changing' has faces that change .* --skip-unsupported") as caught:
        open_sequence(tmp_path / "x.abc")
    assert caught.value.frame == 2


def test_what_is_skipped_is_told_and_nothing_left_is_refused(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([3], [0, 1, 2]), ([4], [0, 1, 2, 3])])
    with pytest.raises(InputError, match="nothing is left of it: object 'changing' has faces that change"):
        open_sequence(tmp_path / "x.abc", skip_unsupported=True)


def test_faces_that_stay_the_same_in_every_sample_are_constant(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([3, 3], [0, 1, 2, 1, 2, 3])] * 3)
    with open_sequence(tmp_path / "x.abc") as read:
        assert read.connectivity.face_indices.tolist() == [2, 1, 0, 3, 2, 1]
        assert read.frame_count == 1 or read.times.tolist() == [0, 1 / 24, 2 / 24]


def test_faces_of_two_corners_are_refused(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([2, 3], [0, 1, 0, 1, 2])])
    with pytest.raises(InputError, match="object 'changing' has faces of 2 corners"):
        open_sequence(tmp_path / "x.abc")


def test_objects_sampled_at_times_of_their_own_meet_at_all_of_them(tmp_path: Path) -> None:
    import imath

    archive = Abc.OArchive(str(tmp_path / "x.abc"))
    for name, step in (("slow", 1.0), ("quick", 0.5)):
        sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(step, 0.0))
        schema = AbcGeom.OPoints(archive.getTop(), name, sampling).getSchema()
        for sample in range(int(2 / step) + 1):
            positions = imath.V3fArrayFromBuffer(np.array([[sample * step, 0, 0]], np.float32))
            schema.set(AbcGeom.OPointsSchemaSample(positions, imath.IntArray(0)))
    del schema, archive
    with open_sequence(tmp_path / "x.abc") as read:
        assert read.times.tolist() == [0, 0.5, 1, 1.5, 2]
        assert read.read_frames(0, 5)[:, :, 0].tolist() == [[time, time] for time in (0, 0.5, 1, 1.5, 2)]


@pytest.mark.parametrize("content", [b"", b"Ogawa", b"garbage" * 99])
def test_what_is_no_alembic_file_is_refused(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "x.abc").write_bytes(content)
    with pytest.raises(InputError, match="is no Alembic file, or a damaged one"):
        open_sequence(tmp_path / "x.abc")


def test_an_hdf5_backed_file_is_refused_by_that_name(tmp_path: Path) -> None:
    (tmp_path / "x.abc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match="HDF5-backed Alembic"):
        open_sequence(tmp_path / "x.abc")


def test_a_truncated_file_is_refused(tmp_path: Path) -> None:
    write_sequence(scene(), tmp_path / "x.abc")
    whole = (tmp_path / "x.abc").read_bytes()
    for length in range(0, len(whole), 97):
        (tmp_path / "y.abc").write_bytes(whole[:length])
        with pytest.raises(InputError, match="is no Alembic file, or a damaged one"):
            open_sequence(tmp_path / "y.abc")


@pytest.mark.data
@pytest.mark.parametrize("name", ABC_ARRAYS)
def test_files_of_real_tools_agree_with_their_arrays_to_the_bit(shared_data: Path, name: str) -> None:
    expected = array_of(shared_data, ABC_ARRAYS[name])
    with open_sequence(shared_data / "files" / "abc" / f"{name}.abc") as read:
        assert np.array_equal(read.read_frames(0, read.frame_count), expected["points"])
        assert np.allclose(read.times, expected["times"], rtol=0, atol=1e-12)
        faces = Connectivity.from_padded(read.vertex_count, expected["faces"])
        assert read.connectivity.face_counts.tolist() == faces.face_counts.tolist()
        turned = faces.face_indices[reversed_corners(faces.face_counts)]
        assert read.connectivity.face_indices.tolist() == turned.tolist()


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "kinds"),
    [
        ("cortex_curves", "3 curves"),
        ("cortex_subdPlane", "1 subdivision"),
        ("cortex_varyingPoints", "1 points"),
        ("cortex_velocityCube", "1 mesh"),
        ("openusd_nestedInstancing", "12 mesh"),
        ("openusd_testUsdAbcIsConstant", "2 mesh"),
        ("openusd_testusdtimecode", "1 mesh"),
    ],
)
@pytest.mark.parametrize("transforms", ["bake", "keep"])
def test_files_hard_on_readers_are_read_and_come_back(
    shared_data: Path, tmp_path: Path, name: str, kinds: str, transforms: str
) -> None:
    with open_sequence(shared_data / "files" / "abc" / f"{name}.abc", transforms=transforms) as read:  # type: ignore[arg-type]
        assert len(read.objects) == int(kinds.split()[0])
        write_sequence(read, tmp_path / "x.abc")
        with open_sequence(tmp_path / "x.abc", transforms=transforms) as again:  # type: ignore[arg-type]
            assert_same_scene(again, read, attributes=transforms == "bake")


@pytest.mark.data
@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("cortex_points", "points that come, go or change places"),
        ("openusd_testAbcCamera", "no mesh, curve or point animation: there is 1 camera"),
    ],
)
def test_files_without_mesh_animation_are_refused_by_a_clear_line(shared_data: Path, name: str, reason: str) -> None:
    with pytest.raises(InputError, match=reason):
        open_sequence(shared_data / "files" / "abc" / f"{name}.abc")


@pytest.mark.data
def test_an_encoded_scene_of_29_moving_objects_decodes_with_its_tree_and_names(
    shared_data: Path, tmp_path: Path
) -> None:
    from pdecodec.decoder import open_animation
    from pdecodec.encoder import encode

    source = shared_data / "files" / "abc" / "destruction.abc"
    with open_sequence(source) as clip:
        report = encode(clip, tmp_path / "x.pdeanim", tolerance=1e-2, profile="segments")
        with open_animation(tmp_path / "x.pdeanim") as animation:
            write_sequence(animation, tmp_path / "x.abc")
        with open_sequence(tmp_path / "x.abc") as read:
            assert [item.name for item in read.objects] == [item.name for item in clip.objects]
            assert len(read.objects) == 29
            assert read.times.tolist() == pytest.approx(clip.times.tolist(), abs=1e-9)
            error = np.linalg.norm(read.read_frames(0, 120) - clip.read_frames(0, 120), axis=2).max()
            assert report.bound is not None
            assert error <= report.bound
            for mine, other in zip(read.objects, clip.objects, strict=True):
                assert mine.connectivity.same_as(other.connectivity)
                assert [one.name for one in mine.attributes] == [one.name for one in other.attributes]


def test_a_name_without_a_file_name_works_as_well(tmp_path: Path) -> None:
    write_sequence(scene(), tmp_path / "x.abc")
    shutil.copy(tmp_path / "x.abc", tmp_path / "x")
    with open_sequence(tmp_path / "x") as read:
        assert read.vertex_count == 15
