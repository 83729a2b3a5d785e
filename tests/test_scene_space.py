"""Up axis, unit and scale; transforms kept and baked; velocities of positions."""

from __future__ import annotations

import numpy as np
import pytest

from pdecodec.errors import InputError, SettingsError
from pdecodec.formats.scene_space import metres_per_unit, place, unit_text
from pdecodec.formats.transforms import TRANSFORM, bake_transforms, matrices_at, transform_attribute
from pdecodec.formats.velocities import DifferencedVelocities
from pdecodec.sequence import ArraySequence, Attribute, Connectivity, MeshObject

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
def test_the_scene_turns_so_that_what_was_up_stays_up(have: str, want: str, expected: list[float]) -> None:
    turned = place(at(have), up_axis=want)
    assert turned.read_frames(0, 1)[0, 0].tolist() == expected
    assert turned.metadata["up_axis"] == want
    assert POINT[0, 0, "XYZ".index(have)] == turned.read_frames(0, 1)[0, 0, "XYZ".index(want)]


@pytest.mark.parametrize("have", "XYZ")
@pytest.mark.parametrize("want", "XYZ")
def test_every_turn_is_a_rotation_and_its_way_back_is_exact(have: str, want: str) -> None:
    axes = ArraySequence(np.eye(3)[None], metadata={"up_axis": have})
    turned = place(axes, up_axis=want)
    assert np.linalg.det(turned.read_frames(0, 1)[0]) == 1
    assert np.array_equal(place(turned, up_axis=have).read_frames(0, 1), axes.points)


def test_an_axis_that_nobody_recorded_is_taken_as_given_and_told() -> None:
    placed = place(at(None), up_axis="z")
    assert placed.read_frames(0, 1)[0, 0].tolist() == [1, 2, 3]
    assert placed.metadata["up_axis"] == "Z"
    assert "nothing is turned" in placed.notices[0]


@pytest.mark.parametrize(("unit", "metres"), [("cm", 0.01), ("m", 1.0), ("in", 0.0254), ("2.5 m", 2.5)])
def test_units_are_read_and_written(unit: str, metres: float) -> None:
    assert metres_per_unit(at("Y", unit)) == metres
    assert unit_text(metres) == unit


@pytest.mark.parametrize("unit", [None, "furlong", "x m", "-1 m", "inf m"])
def test_a_unit_that_says_nothing_is_none(unit: str | None) -> None:
    assert metres_per_unit(at("Y", unit)) is None


def test_a_scale_multiplies_positions_and_divides_the_unit() -> None:
    scaled = place(at("Y", "cm"), scale=0.01)
    assert np.allclose(scaled.read_frames(0, 1), POINT * np.float32(0.01))
    assert scaled.metadata["unit"] == "m"


@pytest.mark.parametrize("scale", [0.0, -1.0, float("nan"), float("inf")])
def test_a_scale_must_be_a_positive_number(scale: float) -> None:
    with pytest.raises(SettingsError, match="positive number"):
        place(at("Y"), scale=scale)


def moving(matrices: np.ndarray, times: list[float]) -> ArraySequence:
    """Two objects of one point at (1, 2, 3); the first moves by matrices."""
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


def test_transforms_are_straight_lines_between_their_times_and_still_outside() -> None:
    transform = transform_attribute([0, 1], shifts(0, 10))
    assert matrices_at(transform, [-1, 0.25, 5])[:, 3, 0].tolist() == [0, 2.5, 10]


def test_a_transform_that_stands_still_is_kept_once() -> None:
    assert transform_attribute([0, 1, 2], shifts(5, 5, 5)).values.shape == (1, 17)
    assert transform_attribute([0, 1, 2, 3, 4], shifts(5, 5, 6, 7, 7)).values[:, 0].tolist() == [1, 2, 3]


def test_a_sequence_without_transforms_is_baked_already() -> None:
    clip = at("Y")
    assert bake_transforms(clip) is clip


def test_turning_and_scaling_reach_an_object_through_its_transform() -> None:
    clip = moving(shifts(0, 10, 20), [0, 1, 2])
    clip.metadata["up_axis"] = "Y"
    placed = place(clip, up_axis="Z", scale=2)
    assert np.array_equal(placed.read_frames(0, 3)[:, 0], clip.points[:, 0])
    direct = place(bake_transforms(clip), up_axis="Z", scale=2)
    assert np.array_equal(bake_transforms(placed).read_frames(0, 3), direct.read_frames(0, 3))


def test_an_attribute_called_transform_that_is_none_is_refused() -> None:
    item = MeshObject("odd", Connectivity(1), (Attribute(TRANSFORM, "object", np.zeros(3)),))
    with pytest.raises(InputError, match="'transform' of object 'odd' is no list of times and matrices"):
        bake_transforms(ArraySequence(POINT, objects=[item]))


def test_differences_are_the_velocities_of_parabolas_at_irregular_times() -> None:
    times = np.array([0.0, 0.1, 0.4, 0.5, 1.0])
    points = np.stack([3 * times**2 - times, times, np.ones(5)], axis=1)[:, None]
    speeds = DifferencedVelocities(ArraySequence(points, times=times))
    expected = np.stack([6 * times - 1, np.ones(5), np.zeros(5)], axis=1)[:, None]
    assert np.allclose(speeds.read_frames(0, 5)[1:4], expected[1:4], atol=1e-5)
    assert np.array_equal(speeds.read_frames(2, 3), speeds.read_frames(0, 5)[2:3])


def test_one_frame_alone_stands_still() -> None:
    assert not DifferencedVelocities(ArraySequence(POINT)).read_frames(0, 1).any()
