"""Alembic: the layout in the file, what is refused, and files of real tools."""

from __future__ import annotations

import os
import signal
from pathlib import Path
from random import Random

import numpy as np
import pytest

from pdecodec.codec.encoding import encode
from pdecodec.codec.opening import open_animation
from pdecodec.errors import InputError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.alembic.values import matrix_of
from pdecodec.formats.base.attribute_roles import reversed_corners
from pdecodec.formats.base.isolated import IsolatedSequence
from pdecodec.formats.base.rigid_fit import RIGID_TOLERANCE
from pdecodec.formats.base.scene_space import DifferencedVelocities, place
from pdecodec.formats.base.transforms import bake_transforms, transform_attribute
from pdecodec.mesh.arrays import Float64Array
from pdecodec.mesh.runs import ChangingSequence
from pdecodec.mesh.selection import FrameSelection
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject, MeshSequence
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import (
    array_of,
    assert_same_connectivity,
    assert_same_scene,
    body,
    meaning_of,
    scene,
    turning,
    written,
)

pytest.importorskip("alembic3d", reason="Alembic is not installed here (pip install 'pdecodec[abc]')")

import imath
from alembic3d import Abc, AbcCoreAbstract, AbcGeom

ARRAYS = {
    "dembones_tube": "dembones_tube",
    "destruction": "destruction_fragments",
    "gn_flower": "gn_flower",
    "hypercube": "hypercube",
    "vellum_balloon": "vellum_balloon",
}
"""Alembic files whose animation is also stored as an array, by name."""


def test_faces_run_the_other_way_round_in_the_file(tmp_path: Path) -> None:
    write_sequence(scene([MeshObject("a", connectivity_of(5, [[0, 1, 2, 3], [2, 1, 4]]))]), tmp_path / "x.abc")
    mesh = AbcGeom.IPolyMesh(Abc.IArchive(str(tmp_path / "x.abc")).getTop().getChild("a"), "a")
    assert np.asarray(mesh.getSchema().getValue().getFaceIndices()).tolist() == [3, 2, 1, 0, 4, 1, 2]


@pytest.mark.parametrize("transforms", [False, True])
def test_a_scene_with_z_up_is_turned_with_its_velocities_and_a_note(tmp_path: Path, transforms: bool) -> None:
    clip = scene(up_axis="Z")
    if transforms:
        kept = transform_attribute([0.0, 1.0], [np.eye(4), np.diag([2.0, 2, 2, 1])])
        clip.objects = tuple(MeshObject(f"t/{one.name}", one.connectivity, (kept,)) for one in clip.objects)
    notices = write_sequence(clip, tmp_path / "x.abc", velocities=DifferencedVelocities(clip))
    assert notices[0] == "the scene is turned from Z-up to Y-up, which programs assume for Alembic"
    with open_sequence(tmp_path / "x.abc") as read:
        assert dict(read.metadata) == {"up_axis": "Y"}
        turned = place(bake_transforms(clip), up_axis="Y").read_frames(0, 5)
        assert np.allclose(read.read_frames(0, 5), turned, atol=1e-6)
        assert np.array_equal(turned[..., 1], bake_transforms(clip).read_frames(0, 5)[..., 2])
    if not transforms:
        node = Abc.IArchive(str(tmp_path / "x.abc")).getTop().getChild("root").getChild("arm").getChild("hand")
        stored = AbcGeom.IPolyMesh(node, "hand").getSchema().getVelocitiesProperty()
        speeds = np.asarray(stored.getValue(Abc.ISampleSelector(float(clip.times[1]))))
        expected = DifferencedVelocities(clip).read_frames(1, 2)[0, :5]
        assert np.array_equal(speeds, expected[:, [0, 2, 1]] * np.float32([1, 1, -1]))


SUBDIVIDED = Attribute("subdivision", "object", np.zeros(1, np.int32), labels=("catmull-clark",))
PLACES = np.random.default_rng(1).random((7, 2)).astype(np.float32)
BY_CORNER = Attribute("uv", "corner", PLACES)
BY_VERTEX = Attribute("uv", "corner", PLACES[:5], body().connectivity.face_indices)
HARD = Attribute("normal_group", "corner", np.array([0, 0, 0, 0, 1, 1, 0], np.int32))
KINDS = {
    "mesh": body(),
    "mesh with UVs by corner": body(attributes=[BY_CORNER]),
    "mesh with UVs by vertex": body(attributes=[BY_VERTEX]),
    "mesh with hard edges": body(attributes=[HARD]),
    "subdivision": body(attributes=[SUBDIVIDED, *body().attributes]),
    "subdivision with UVs by corner": body(attributes=[SUBDIVIDED, BY_CORNER]),
    "subdivision with UVs by vertex": body(attributes=[SUBDIVIDED, BY_VERTEX]),
    "curves": MeshObject("hair", connectivity_of(5, lines=[[0, 1, 2], [3, 4]])),
    "points": MeshObject("dust", connectivity_of(5)),
}


@pytest.mark.parametrize("changes", [False, True], ids=["constant", "changing"])
@pytest.mark.parametrize("kind", KINDS)
def test_every_kind_of_sample_is_written_from_arrays_that_are_still_there(
    kind: str, changes: bool, tmp_path: Path
) -> None:
    clip: MeshSequence = scene([KINDS[kind]], frames=3)
    if changes:
        grown = scene([KINDS[kind], MeshObject("more", connectivity_of(3, [[0, 1, 2]]))], frames=2)
        grown.times = clip.times[-1] + grown.times
        clip = ChangingSequence([clip, grown])
    speeds = None if changes else DifferencedVelocities(clip)
    for name in ("one", "other"):
        write_sequence(clip, tmp_path / f"{name}.abc", velocities=speeds)
    assert (tmp_path / "one.abc").read_bytes() == (tmp_path / "other.abc").read_bytes()
    with open_sequence(tmp_path / "one.abc") as read:
        first = read.runs[0].objects[0]
        assert_same_connectivity(first.connectivity, KINDS[kind].connectivity)
        for attribute in KINDS[kind].attributes:
            (found,) = [one for one in first.attributes if one.name == attribute.name]
            assert np.array_equal(meaning_of(found), meaning_of(attribute)), attribute.name


def by_hand(path: Path, samples: list[tuple[list[int], list[int]]], *, points: int = 4) -> None:
    """Write a mesh with the Alembic library itself, with a sample of counts and indices for each frame."""
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


def test_a_requested_rate_keeps_stored_samples_exact(tmp_path: Path) -> None:
    clip = scene(frames=5)
    write_sequence(clip, tmp_path / "x.abc")
    with open_sequence(tmp_path / "x.abc", fps=48) as read:
        assert np.allclose(read.times * 48, 2 + np.arange(9), atol=1e-9)
        assert (read.fps, read.notices) == (48, ())
        points = read.read_frames(0, 9)
    assert np.array_equal(points[::2], clip.points)
    assert np.allclose(points[1::2], (clip.points[1:] + clip.points[:-1]) / 2, atol=1e-6)
    with open_sequence(tmp_path / "x.abc", fps=18) as read:
        assert np.allclose(read.times * 18, 0.75 + np.arange(4), atol=1e-9)
        assert read.notices == ("sampled at 18 frames per second: 3 of 5 times in the file fall between frames",)


def test_damaged_text_in_an_archive_is_one_line(tmp_path: Path) -> None:
    write_sequence(scene(frames=2), tmp_path / "x.abc")
    data = (tmp_path / "x.abc").read_bytes()
    for word in (b"hair", b"nail"):
        assert word in data
        (tmp_path / "y.abc").write_bytes(data.replace(word, b"\xff" + word[1:]))
        with pytest.raises(InputError, match=r"is not an Alembic file, or is damaged .*; export it again"):
            open_sequence(tmp_path / "y.abc")


@pytest.mark.data
def test_a_file_that_ends_the_library_is_one_line_where_it_is_isolated(shared_data: Path, tmp_path: Path) -> None:
    damaged = bytearray((shared_data / "interop" / "abc" / "rotatingCube.abc").read_bytes())
    # The first random damage that makes the library end this process with a segmentation fault.
    random = Random(39)
    for _ in range(random.randint(1, 8)):
        damaged[random.randrange(len(damaged))] = random.randrange(256)
    (tmp_path / "x.abc").write_bytes(damaged)
    with pytest.raises(InputError, match=r"x\.abc: the library that reads this file crashed: the file is damaged"):
        open_sequence(tmp_path / "x.abc", isolate=True)


def test_an_isolated_sequence_is_the_same_and_outlives_no_crash(tmp_path: Path) -> None:
    write_sequence(scene(up_axis="Y", unit="m"), tmp_path / "x.abc")
    with open_sequence(tmp_path / "x.abc") as plain, open_sequence(tmp_path / "x.abc", isolate=True) as read:
        assert_same_scene(read, plain)
        assert (dict(read.metadata), read.notices) == (dict(plain.metadata), plain.notices)
        assert isinstance(read, IsolatedSequence)
        assert read.worker.process_id is not None
        os.kill(read.worker.process_id, signal.SIGKILL)
        with pytest.raises(InputError, match="crashed: the file is damaged") as caught:
            read.read_frames(2, 4)
        assert caught.value.frame == 2
    with pytest.raises(InputError, match=r"there is no such file; check the name"):
        open_sequence(tmp_path / "none.abc", isolate=True)


@pytest.mark.data
def test_visibility_of_a_real_file_is_named(shared_data: Path) -> None:
    path = shared_data / "interop" / "abc" / "mesh_xTranslate_visibilityAnim_15_24fps.abc"
    with open_sequence(path) as read:
        hidden = "hidden in the file, always or at times, but always visible here: 'plane/planeShape'"
        assert read.notices == ("not kept: archive properties (userDescription, statistics)", hidden)


def test_faces_that_change_begin_a_run_of_frames(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([3], [0, 1, 2]), ([3], [0, 1, 2]), ([4], [0, 1, 2, 3]), ([3], [0, 1, 2])])
    with open_sequence(tmp_path / "x.abc") as read:
        assert read.run_starts.tolist() == [0, 2, 3]
        faces = [run.connectivity.face_indices.tolist() for run in read.runs]
        assert faces == [[2, 1, 0], [3, 2, 1, 0], [2, 1, 0]]
        assert [len(block) for _, block in read.blocks()] == [2, 1, 1]
    # Between the samples of two runs, the earlier run is held.
    with open_sequence(tmp_path / "x.abc", fps=48) as read:
        assert read.run_starts.tolist() == [0, 4, 6]
        points = read.runs[0].read_frames(0, 4)
        assert np.array_equal(points[3], points[2])


def test_particles_that_come_and_go_are_runs_and_keep_their_ids(tmp_path: Path) -> None:
    archive = Abc.OArchive(str(tmp_path / "x.abc"))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / 24, 0.0))
    schema = AbcGeom.OPoints(archive.getTop(), "drops", sampling).getSchema()
    births = [[], [0], [0, 1], [0, 1], [1, 7]]
    for ids in births:
        places = np.array([[number, len(ids), 0] for number in ids], np.float32).reshape(-1, 3)
        numbers = imath.IntArrayFromBuffer(np.array(ids, np.int32)) if ids else imath.IntArray(0)
        sample = AbcGeom.OPointsSchemaSample()
        sample.setPositions(imath.V3fArrayFromBuffer(places) if ids else imath.V3fArray(0))
        sample.setIds(numbers)
        schema.set(sample)
    del schema, archive
    with open_sequence(tmp_path / "x.abc") as read:
        assert "1 of 5 frames have no vertices" in read.notices[-1]
        report = encode(read)
    with open_animation(report.data or b"") as animation:
        animation.verify()
        assert animation.run_starts.tolist() == [0, 1, 3]
        kept = [run.objects[0].attributes[0].values.tolist() for run in animation.runs]
        assert kept == [[0], [0, 1], [1, 7]]
        assert np.allclose(animation.positions(4 / 24)[:, 0], [1, 7], atol=0.01)


def test_faces_that_stay_the_same_in_every_sample_are_constant(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([3, 3], [0, 1, 2, 1, 2, 3])] * 3)
    with open_sequence(tmp_path / "x.abc") as read:
        assert read.connectivity.face_indices.tolist() == [2, 1, 0, 3, 2, 1]


def test_faces_of_two_corners_and_hdf5_backed_files_are_refused(tmp_path: Path) -> None:
    by_hand(tmp_path / "x.abc", [([2, 3], [0, 1, 0, 1, 2])])
    with pytest.raises(InputError, match="object 'changing': has a face of 2 corners"):
        open_sequence(tmp_path / "x.abc")
    (tmp_path / "x.abc").write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    with pytest.raises(InputError, match="HDF5-backed Alembic"):
        open_sequence(tmp_path / "x.abc")


def test_objects_sampled_at_times_of_their_own_meet_at_all_of_them(tmp_path: Path) -> None:
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


@pytest.mark.data
@pytest.mark.parametrize("name", ARRAYS)
def test_files_of_real_tools_agree_with_their_arrays_to_the_bit(shared_data: Path, name: str) -> None:
    expected = array_of(shared_data, ARRAYS[name])
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
        with written(read, tmp_path / "x.abc", transforms=transforms) as again:
            # Objects that move rigidly are restored under a transform.
            error = 2 * RIGID_TOLERANCE
            assert_same_scene(
                bake_transforms(again), bake_transforms(read), attributes=transforms == "bake", error=error
            )


@pytest.mark.data
def test_a_file_without_mesh_animation_is_refused_by_a_clear_line(shared_data: Path) -> None:
    reason = "no mesh, curve or point animation: there is 1 camera, 42 other objects"
    with pytest.raises(InputError, match=reason):
        open_sequence(shared_data / "files" / "abc" / "openusd_testAbcCamera.abc")


@pytest.mark.data
def test_an_encoded_scene_of_29_moving_objects_decodes_with_its_tree_and_names(
    shared_data: Path, tmp_path: Path
) -> None:
    with open_sequence(shared_data / "files" / "abc" / "destruction.abc") as whole:
        clip = FrameSelection(whole, range(0, 120, 4))
        report = encode(clip, tmp_path / "x.pdeanim", tolerance=1e-2, scene="drop")
        with open_animation(tmp_path / "x.pdeanim") as animation, written(animation, tmp_path / "x.abc") as read:
            assert len(read.objects) == 29
            error = np.linalg.norm(read.read_frames(0, 30) - clip.read_frames(0, 30), axis=2).max()
            assert report.bound is not None
            assert error <= report.bound
            exact = ArraySequence(read.read_frames(0, 30), objects=clip.objects, times=clip.times, fps=clip.fps)
            assert_same_scene(read, exact)


def turning_wheel(path: Path, matrices: list[Float64Array], rate: float = 12.0) -> Path:
    """Write a triangle below a transform with one sample for each matrix; points are rows."""
    archive = Abc.OArchive(str(path))
    sampling = archive.addTimeSampling(AbcCoreAbstract.TimeSampling(1 / rate, 0.0))
    above = AbcGeom.OXform(archive.getTop(), "wheel", sampling)
    for matrix in matrices:
        sample = AbcGeom.XformSample()
        sample.setMatrix(matrix_of(matrix))
        above.getSchema().set(sample)
    points = imath.V3fArrayFromBuffer(np.array([[1, 0, 0], [0, 0, 2], [0, 0, 0]], np.float32))
    faces = [imath.IntArrayFromBuffer(np.array(numbers, np.int32)) for numbers in ([0, 1, 2], [3])]
    AbcGeom.OPolyMesh(above, "rim").getSchema().set(AbcGeom.OPolyMeshSchemaSample(points, *faces))
    return path


def at_double_rate(path: Path) -> Float64Array:
    with open_sequence(path, fps=24.0) as read:
        return read.read_frames(0, read.frame_count)[:, :2].astype(np.float64)


@pytest.mark.parametrize("size", [1.0, 3.0, -2.0])
@pytest.mark.parametrize("degrees", [30, 90, 175])
def test_a_wheel_keeps_its_radius_between_samples(size: float, degrees: int, tmp_path: Path) -> None:
    moves = turning(4, 2, np.radians(degrees), np.array([0.5, 0.0, 0.0]))
    moves[:, :3, :3] *= size
    found = at_double_rate(turning_wheel(tmp_path / "x.abc", list(moves)))
    assert len(found) == 7
    assert np.allclose(np.linalg.norm(found[:, 0] - [[0.25 * half, 0, 0] for half in range(7)], axis=1), abs(size))
    angles = np.unwrap(np.arctan2(found[:, 0, 1], found[:, 0, 0] - 0.25 * np.arange(7)))
    assert np.allclose(np.diff(angles), np.radians(degrees) / 2, atol=1e-6)


def test_stretch_and_shear_go_straight_between_samples_and_turn_along(tmp_path: Path) -> None:
    sheared = np.eye(4)
    sheared[0, 1] = sheared[1, 0] = 0.5
    halfway = at_double_rate(turning_wheel(tmp_path / "x.abc", [np.eye(4), sheared]))[1]
    assert np.allclose(halfway[0], [1, 0.25, 0], atol=1e-6)
    scaled = np.diag([1.0, 1.0, 5.0, 1.0])
    quarter = turning(2, 2, np.pi / 2, np.zeros(3))[1]
    halfway = at_double_rate(turning_wheel(tmp_path / "y.abc", [np.eye(4), scaled @ quarter]))[1]
    assert np.allclose(halfway, [[np.sqrt(0.5), np.sqrt(0.5), 0], [0, 0, 6]], atol=1e-6)


@pytest.mark.parametrize("last", [np.diag([-1.0, 1, 1, 1]), np.diag([0.0, 0, 0, 1])])
def test_between_matrices_without_a_rotation_numbers_go_straight(last: Float64Array, tmp_path: Path) -> None:
    halfway = at_double_rate(turning_wheel(tmp_path / "x.abc", [np.eye(4), last]))[1]
    assert np.allclose(halfway, np.array([[1, 0, 0], [0, 0, 2]]) @ (np.eye(4) + last)[:3, :3] / 2)
