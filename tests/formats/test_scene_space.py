"""Up axis, unit and scale; transforms that are kept and baked; velocities of positions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.scene_space import DifferencedVelocities, metres_per_unit, place, unit_text
from pdecodec.formats.base.transforms import TRANSFORM, bake_transforms, matrices_at, transform_attribute
from pdecodec.mesh.sequence import ArraySequence, Attribute, Connectivity, MeshObject
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import OUTWARD, TETRAHEDRON, body, needed, scene, volume, written

POINT = np.array([[[1.0, 2.0, 3.0]]], np.float32)


def at(up_axis: str | None, unit: str | None = None) -> ArraySequence:
    metadata = {key: value for key, value in (("up_axis", up_axis), ("unit", unit)) if value}
    return ArraySequence(POINT, metadata=metadata)


@pytest.mark.parametrize(
    ("have", "want", "expected"),
    [
        ("Y", "Z", [1, -3, 2]),
        ("Z", "Y", [1, 3, -2]),
        ("X", "Y", [-2, 1, 3]),
        ("Y", "X", [2, -1, 3]),
        ("Z", "X", [3, -1, -2]),
        ("Z", "Z", [1, 2, 3]),
    ],
)
def test_the_scene_turns_so_that_what_was_up_stays_up_and_its_way_back_is_exact(
    have: str, want: str, expected: list[float]
) -> None:
    turned = place(at(have), up_axis=want)
    assert turned.read_frames(0, 1)[0, 0].tolist() == expected
    assert turned.metadata["up_axis"] == want
    assert POINT[0, 0, "XYZ".index(have)] == turned.read_frames(0, 1)[0, 0, "XYZ".index(want)]
    axes = ArraySequence(np.eye(3)[None], metadata={"up_axis": have})
    turned = place(axes, up_axis=want)
    assert np.linalg.det(turned.read_frames(0, 1)[0]) == 1
    assert np.array_equal(place(turned, up_axis=have).read_frames(0, 1), axes.points)


def test_an_unrecorded_axis_is_assumed_and_noted() -> None:
    placed = place(at(None), up_axis="z")
    assert placed.read_frames(0, 1)[0, 0].tolist() == [1, 2, 3]
    assert placed.metadata["up_axis"] == "Z"
    assert "nothing is turned" in placed.notices[0]


@pytest.mark.parametrize(
    ("unit", "metres"),
    [
        *(("cm", 0.01), ("m", 1.0), ("in", 0.0254), ("2.5 m", 2.5)),
        *((unit, None) for unit in (None, "furlong", "x m", "-1 m", "inf m")),
    ],
)
def test_units_are_read_and_written_and_a_missing_unit_stays_missing(unit: str, metres: float | None) -> None:
    assert metres_per_unit(at("Y", unit)) == metres
    assert metres is None or unit_text(metres) == unit


def test_a_scale_multiplies_positions_and_divides_the_unit() -> None:
    scaled = place(at("Y", "cm"), scale=0.01)
    assert np.allclose(scaled.read_frames(0, 1), POINT * np.float32(0.01))
    assert scaled.metadata["unit"] == "m"


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_must_be_a_positive_number(scale: float) -> None:
    with pytest.raises(SettingsError, match="positive number"):
        place(at("Y"), scale=scale)


def moving(matrices: np.ndarray, times: list[float]) -> ArraySequence:
    """Return two objects of one point at (1, 2, 3), of which matrices move the first."""
    first = MeshObject("moving", Connectivity(1), (transform_attribute(times, matrices),))
    points = np.repeat(np.repeat(POINT, 3, axis=0), 2, axis=1)
    return ArraySequence(points, objects=[first, MeshObject("still", Connectivity(1))], times=[0.0, 1.0, 2.0])


def shifts(*along_x: float) -> np.ndarray:
    matrices = np.repeat(np.eye(4)[None], len(along_x), axis=0)
    matrices[:, 3, 0] = along_x
    return matrices


def test_a_kept_transform_is_applied_to_its_object_alone() -> None:
    baked = bake_transforms(moving(shifts(0, 10, 20), [0, 1, 2]))
    assert baked.read_frames(0, 3)[:, :, 0].tolist() == [[1, 1], [11, 1], [21, 1]]
    assert baked.read_frames(1, 2)[:, :, 0].tolist() == [[11, 1]]
    assert baked.objects[0].attributes == ()
    assert bake_transforms(baked) is baked


def test_transforms_are_straight_lines_between_their_times_and_still_outside() -> None:
    transform = transform_attribute([0, 1], shifts(0, 10))
    assert matrices_at(transform, [-1, 0.25, 5])[:, 3, 0].tolist() == [0, 2.5, 10]


def test_a_transform_that_stands_still_is_kept_once() -> None:
    assert transform_attribute([0, 1, 2], shifts(5, 5, 5)).values.shape == (1, 17)
    assert transform_attribute([0, 1, 2, 3, 4], shifts(5, 5, 6, 7, 7)).values[:, 0].tolist() == [1, 2, 3]


def test_turning_and_scaling_reach_an_object_through_its_transform() -> None:
    clip = moving(shifts(0, 10, 20), [0, 1, 2])
    clip.metadata["up_axis"] = "Y"
    placed = place(clip, up_axis="Z", scale=2)
    assert np.array_equal(placed.read_frames(0, 3)[:, 0], clip.points[:, 0])
    direct = place(bake_transforms(clip), up_axis="Z", scale=2)
    assert np.array_equal(bake_transforms(placed).read_frames(0, 3), direct.read_frames(0, 3))


@pytest.mark.parametrize("scales", [(-1.0, -2.0), (0.0, -1.0), (0.0, -1.0, 0.0)])
def test_faces_that_a_transform_mirrors_are_turned_around_with_their_corners(scales: tuple[float, ...]) -> None:
    mirror = np.stack([np.diag([scale, 1.0, 1.0, 1.0]) for scale in scales])
    corners = np.arange(12, dtype=np.float32)
    attributes = (
        transform_attribute(range(len(scales)), mirror),
        Attribute("mine", "corner", corners),
        Attribute("uv", "corner", np.stack([corners, corners], axis=1), np.arange(12, dtype=np.int32)[::-1].copy()),
        Attribute("heat", "vertex", corners[:4]),
    )
    item = MeshObject("solid", connectivity_of(4, OUTWARD, [[0, 1, 2]]), attributes)
    clip = ArraySequence(np.stack([TETRAHEDRON] * len(scales)), objects=[item], times=np.arange(len(scales)))
    baked = bake_transforms(clip)
    (solid,) = baked.objects
    assert volume(clip) == pytest.approx(1 / 6)
    assert volume(baked, 1) == pytest.approx(abs(scales[1]) / 6)
    assert solid.connectivity.face_indices.tolist() == [corner for face in OUTWARD for corner in face[::-1]]
    assert solid.connectivity.line_indices.tolist() == [0, 1, 2]
    mine, uv, heat = solid.attributes
    turned = [2, 1, 0, 5, 4, 3, 8, 7, 6, 11, 10, 9]
    assert mine.values.tolist() == turned
    assert uv.indices is not None
    assert uv.indices.tolist() == [11 - corner for corner in turned]
    assert heat.values.tolist() == [0, 1, 2, 3]


@pytest.mark.parametrize("scale", [np.inf, np.nan, 1e300])
def test_a_nan_transform_gives_nan_positions_without_a_warning(scale: float) -> None:
    transform = transform_attribute([0], np.diag([scale, 1.0, 1.0, 1.0])[None])
    item = MeshObject("solid", connectivity_of(4, OUTWARD), (transform,))
    baked = bake_transforms(ArraySequence(TETRAHEDRON[None], objects=[item]))
    assert not np.isfinite(baked.read_frames(0, 1)[0, 1, 0])


@pytest.mark.parametrize("extension", ["abc", "usdc"])
def test_faces_under_a_transform_that_mirrors_face_outward_whether_it_is_applied_or_kept(
    tmp_path: Path, extension: str
) -> None:
    needed(extension)
    # The object grows out of nothing and vanishes again.
    mirror = transform_attribute([0, 1, 2], [np.diag([1.0, -1.0, 2.0, 1.0]) * scale for scale in (0, 1, 0)])
    solid = connectivity_of(4, OUTWARD)
    clip = ArraySequence(np.stack([TETRAHEDRON] * 3), objects=[MeshObject("solid", solid, (mirror,))], times=[0, 1, 2])
    with written(clip, tmp_path / f"x.{extension}", transforms="keep") as read:
        assert volume(bake_transforms(read), 1) == pytest.approx(2 / 6)
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert volume(read, 1) == pytest.approx(2 / 6)
    with open_sequence(tmp_path / f"x.{extension}", transforms="keep") as read:
        assert read.connectivity.same_as(solid)
        assert volume(bake_transforms(read), 1) == pytest.approx(2 / 6)


def test_an_attribute_called_transform_that_is_no_transform_is_refused() -> None:
    item = MeshObject("odd", Connectivity(1), (Attribute(TRANSFORM, "object", np.zeros(3)),))
    with pytest.raises(InputError, match="'transform' of object 'odd' is not a list of times and matrices"):
        bake_transforms(ArraySequence(POINT, objects=[item]))


def test_differences_are_the_velocities_of_parabolas_at_irregular_times() -> None:
    times = np.array([0.0, 0.1, 0.4, 0.5, 1.0])
    points = np.stack([3 * times**2 - times, times, np.ones(5)], axis=1)[:, None]
    speeds = DifferencedVelocities(ArraySequence(points, times=times))
    expected = np.stack([6 * times - 1, np.ones(5), np.zeros(5)], axis=1)[:, None]
    assert np.allclose(speeds.read_frames(0, 5)[1:4], expected[1:4], atol=1e-5)
    assert np.array_equal(speeds.read_frames(2, 3), speeds.read_frames(0, 5)[2:3])
    assert not DifferencedVelocities(ArraySequence(POINT)).read_frames(0, 1).any()


def spun(names: str, moving: str) -> ArraySequence:
    """Return objects, some of which rotate and rise."""
    clip = scene([body(name, ()) for name in names.split()])
    turns = np.repeat(np.eye(4)[None], 5, axis=0)
    turns[:, :2, :2] = [[[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]] for t in clip.times]
    turns[:, 3, 2] = np.arange(5)
    turn = transform_attribute(clip.times, turns)
    placed = [MeshObject(one.name, one.connectivity, (turn,) if one.name in moving else ()) for one in clip.objects]
    return ArraySequence(clip.points, objects=placed, times=clip.times, fps=24)


@pytest.mark.parametrize("extension", ["abc", "usdc"])
def test_kept_transforms_come_back_and_bake_to_the_same_positions(tmp_path: Path, extension: str) -> None:
    needed(extension)
    clip = spun("a/one b/two b/c/three", "a/one b/two")
    baked = bake_transforms(clip).read_frames(0, 5)
    with written(clip, tmp_path / f"x.{extension}", transforms="keep") as read:
        assert np.array_equal(read.read_frames(0, 5), clip.points)
        assert np.allclose(bake_transforms(read).read_frames(0, 5), baked, atol=1e-6)
        assert [bool(item.attributes) for item in read.objects] == [True, True, False]
    with open_sequence(tmp_path / f"x.{extension}") as read:
        assert np.allclose(read.read_frames(0, 5), baked, atol=1e-6)
        assert np.array_equal(read.read_frames(3, 5), read.read_frames(0, 5)[3:])


@pytest.mark.parametrize("names", ["a/one four", "a/one a/two"])
def test_alembic_objects_at_the_top_or_side_by_side_keep_transforms_of_their_own(tmp_path: Path, names: str) -> None:
    needed("abc")
    clip = spun(names, names.split()[1])
    assert write_sequence(clip, tmp_path / "x.abc") == ()
    with open_sequence(tmp_path / "x.abc", transforms="keep") as read:
        assert [item.name for item in read.objects] == names.split()
        assert np.array_equal(read.read_frames(0, 5), clip.points)
        expected = bake_transforms(clip).read_frames(0, 5)
        assert np.allclose(bake_transforms(read).read_frames(0, 5), expected, atol=1e-6)


def test_velocities_are_written_with_positions(tmp_path: Path) -> None:
    needed("abc")
    needed("usdc")
    from alembic3d import Abc, AbcGeom
    from pxr import Usd, UsdGeom

    clip = scene([body()])
    speeds = DifferencedVelocities(clip)
    for name in ("x.abc", "x.usdc"):
        write_sequence(clip, tmp_path / name, velocities=speeds)
        with open_sequence(tmp_path / name) as read:
            assert read.notices == ()
            assert np.array_equal(read.read_field("velocities", 0, 5), speeds.read_frames(0, 5))
    top = Abc.IArchive(str(tmp_path / "x.abc")).getTop()
    schema = AbcGeom.IPolyMesh(top.getChild("root").getChild("arm"), "hand").getSchema()
    mesh = UsdGeom.Mesh((stage := Usd.Stage.Open(str(tmp_path / "x.usdc"))).GetPrimAtPath("/root/arm/hand"))
    assert mesh.GetVelocitiesAttr().GetTimeSamples() == [1, 2, 3, 4, 5]
    for frame, time in enumerate(clip.times):
        expected = speeds.read_frames(frame, frame + 1)[0]
        in_abc = schema.getVelocitiesProperty().getValue(Abc.ISampleSelector(float(time)))
        assert np.array_equal(np.asarray(in_abc), expected)
        assert np.array_equal(np.array(mesh.GetVelocitiesAttr().Get(frame + 1)), expected)
    extent = np.array(mesh.GetExtentAttr().Get(3))
    assert extent.tolist() == [clip.points[2].min(axis=0).tolist(), clip.points[2].max(axis=0).tolist()]
    del stage
