"""Time in USD: values are those of USD at a time code, however they are stored; what does not change is constant."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from pdecodec import ArraySequence, InputError, encode
from pdecodec.formats import open_sequence, write_sequence
from pdecodec.formats.base.transforms import transform_attribute
from pdecodec.mesh.sequence import Connectivity, MeshObject, MeshSequence

pytest.importorskip("pxr", reason="OpenUSD is not installed here (pip install 'pdecodec[usd]')")

QUAD = (
    "int[] faceVertexCounts = [4]",
    "int[] faceVertexIndices = [0, 1, 2, 3]",
    "point3f[] points = [(0, 0, 0), (1, 0, 0), (1, 1, 0), (0, 1, 0)]",
    'uniform token subdivisionScheme = "none"',
)
RATES = "framesPerSecond = 24\ntimeCodesPerSecond = 24"
ZIGZAG = "{\n1: 0; post linear,\n13: 6; post linear,\n25: 3; post linear,\n}"
EASED = "{\n1: 0; post curve (4, 0.5),\n25: 90; pre (4, 0.5); post held,\n}"


def stage(path: Path, body: str, metadata: str = RATES) -> Path:
    path.write_text(f"#usda 1.0\n(\n{metadata}\n)\n{body}")
    return path


def prim(kind: str, name: str, *lines: str) -> str:
    body = "\n".join(lines)
    return f'def {kind} "{name}" {{\n{body}\n}}\n'


def splined(**steps: str) -> str:
    """Return the text of a quad below a transform whose operations each follow a spline."""
    lines = [f"double xformOp:{name}.spline = {spline}" for name, spline in steps.items()]
    order = ", ".join(f'"xformOp:{name}"' for name in steps)
    return prim("Xform", "ball", *lines, f"uniform token[] xformOpOrder = [{order}]", prim("Mesh", "shape", *QUAD))


def moving(*more: str, middle: str = "") -> str:
    """Return the text of a triangle with two samples of points, and optionally more between them."""
    samples = f"0: [(0, 0, 0), (1, 0, 0), (0, 1, 0)], {middle} 10: [(5, 0, 1), (1, 0, 1), (0, 1, 1)]"
    faces = ("int[] faceVertexCounts = [3]", "int[] faceVertexIndices = [0, 1, 2]")
    return prim("Mesh", "m", *faces, *more, f"point3f[] points.timeSamples = {{ {samples} }}")


def first_x(path: Path, **options: Any) -> tuple[list[float], list[float]]:
    """Return the times, and the x coordinate of the first vertex at each."""
    with open_sequence(path, **options) as read:
        return read.times.tolist(), read.read_frames(0, read.frame_count)[:, 0, 0].tolist()


def test_a_transform_follows_its_spline(tmp_path: Path) -> None:
    times, x = first_x(stage(tmp_path / "x.usda", splined(translateX=ZIGZAG)))
    assert np.allclose(times, np.arange(1, 26) / 24)
    assert np.allclose(x, [*np.linspace(0, 6, 13), *np.linspace(6, 3, 13)[1:]])


def test_a_spline_moves_too_if_another_object_has_samples(tmp_path: Path) -> None:
    samples = ", ".join(f"{code}: (0, {code / 10}, 0)" for code in range(1, 26))
    order = 'uniform token[] xformOpOrder = ["xformOp:translate"]'
    lines = (f"double3 xformOp:translate.timeSamples = {{ {samples} }}", order, prim("Mesh", "shape", *QUAD))
    _, x = first_x(stage(tmp_path / "x.usda", splined(translateX=ZIGZAG) + prim("Xform", "other", *lines)))
    assert (x[0], x[12], x[24]) == (0.0, 6.0, 3.0)


def test_a_turn_follows_a_curved_spline_as_usd_evaluates_it(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    path = stage(tmp_path / "x.usda", splined(rotateZ=EASED, translateX=ZIGZAG))
    opened = Usd.Stage.Open(str(path))
    with open_sequence(path) as read:
        points = read.read_frames(0, read.frame_count)
        assert read.frame_count == 25
        for time, found in zip(read.times, points, strict=True):
            cache = UsdGeom.XformCache(Usd.TimeCode(round(time * 24)))
            matrix = cache.GetLocalToWorldTransform(opened.GetPrimAtPath("/ball/shape"))
            assert np.allclose(found[2], matrix.Transform((1, 1, 0)), atol=1e-5)
    assert np.abs(np.diff(points[:, 2], n=2, axis=0)).max() > 0.01


def test_the_size_of_a_sphere_follows_its_spline(tmp_path: Path) -> None:
    sphere = prim("Sphere", "ball", "double radius.spline = {\n1: 1; post linear,\n11: 3; post held,\n}")
    with open_sequence(stage(tmp_path / "x.usda", sphere)) as read:
        radius = np.linalg.norm(read.read_frames(0, read.frame_count), axis=2).max(axis=1)
    assert np.allclose(radius, np.linspace(1, 3, 11), rtol=1e-6)


@pytest.mark.parametrize(("lasts", "frames"), [("", 5), ("startTimeCode = 1\nendTimeCode = 9\n", 9)])
def test_a_spline_that_goes_on_moves_as_long_as_the_stage_lasts(lasts: str, frames: int, tmp_path: Path) -> None:
    line = "{\npost: linear,\n1: 0; post linear,\n5: 4; post linear,\n}"
    _, x = first_x(stage(tmp_path / "x.usda", splined(translateX=line), lasts + RATES))
    assert np.allclose(x, np.arange(frames))


@pytest.mark.parametrize("rate", ["0", "-1", "nan"])
@pytest.mark.parametrize("below", [False, True])
def test_a_rate_that_is_not_positive_is_refused(rate: str, below: bool, tmp_path: Path) -> None:
    path = stage(tmp_path / "x.usda", moving(), f"timeCodesPerSecond = {rate}")
    if below:
        path = stage(tmp_path / "above.usda", "", "subLayers = [@./x.usda@]")
    expected = rf"timeCodesPerSecond of layer x.usda is {rate}; it must be a positive number"
    with pytest.raises(InputError, match=expected) as caught:
        open_sequence(path)
    assert caught.value.path == str(path)


def test_a_rate_is_not_applied_to_codes_that_composition_has_scaled(tmp_path: Path) -> None:
    stage(tmp_path / "below.usda", moving(), "timeCodesPerSecond = 10")
    path = stage(tmp_path / "x.usda", "", "subLayers = [@./below.usda@]")
    assert first_x(path)[0][-1] == first_x(path, fps=5.0)[0][-1] == pytest.approx(1.0)
    unsaid = stage(tmp_path / "unsaid.usda", moving(), 'doc = "no rate"')
    assert first_x(unsaid, fps=5.0)[0][-1] == pytest.approx(2.0)


def test_points_that_are_blocked_at_a_code_are_refused_by_name_and_code(tmp_path: Path) -> None:
    with open_sequence(stage(tmp_path / "x.usda", moving(middle="5: None,"))) as read:
        assert np.isfinite(read.read_frames(0, 1)).all()
        with pytest.raises(InputError, match=r"points of /m have no value at time code 5") as caught:
            read.read_frames(0, read.frame_count)
    assert caught.value.frame == 1


@pytest.mark.parametrize(
    ("samples", "is_kept"),
    [
        ("{ 1: [(1, 0, 0)] }", True),
        ("{ 1: [(1, 0, 0)], 2: [(1, 0, 0)], 7: [(1, 0, 0)] }", True),
        ("{ 1: [(1, 0, 0)], 2: [(1, 0, 0)], 7: [(1, 0.5, 0)] }", False),
    ],
)
def test_a_primvar_of_equal_samples_is_constant(samples: str, is_kept: bool, tmp_path: Path) -> None:
    name = "color3f[] primvars:displayColor"
    lines = (f'{name} (\ninterpolation = "constant"\n)', f"{name}.timeSamples = {samples}")
    with open_sequence(stage(tmp_path / "x.usda", moving(*lines))) as read:
        found = {one.name: one.values.tolist() for one in read.objects[0].attributes}
        assert found.get("color") == ([[1, 0, 0]] if is_kept else None)
        assert [one.name for one in read.fields] == ([] if is_kept else ["color"])


def test_a_subset_that_changes_is_noted(tmp_path: Path) -> None:
    lines = ('uniform token elementType = "face"', "int[] indices.timeSamples = { 0: [], 10: [0] }")
    with open_sequence(stage(tmp_path / "x.usda", moving(prim("GeomSubset", "burnt", *lines)))) as read:
        assert any("subset burnt" in notice for notice in read.notices)


LONG = "startTimeCode = -5\nendTimeCode = 200\nframesPerSecond = 24\ntimeCodesPerSecond = 48"


def says(path: Path) -> tuple[float, ...]:
    from pxr import Usd

    opened = Usd.Stage.Open(str(path))
    rates = opened.GetFramesPerSecond(), opened.GetTimeCodesPerSecond()
    return opened.GetStartTimeCode(), opened.GetEndTimeCode(), *rates


@pytest.mark.parametrize(
    ("lasts", "expected"),
    [
        (LONG, (-5, 200, 24, 48)),
        ("startTimeCode = 3\nendTimeCode = 4\n" + RATES, (3, 4, 24, 24)),
        ("startTimeCode = 9\nendTimeCode = 4\n" + RATES, (0, 10, 24, 24)),
        ("startTimeCode = 0\nendTimeCode = inf\n" + RATES, (0, 10, 24, 24)),
        ("startTimeCode = -24\n" + RATES, (-24, 10, 24, 24)),
        (RATES, (0, 10, 24, 24)),
    ],
)
def test_the_range_and_rates_of_a_stage_come_back_through_a_pdeanim(
    lasts: str, expected: tuple[float, ...], tmp_path: Path
) -> None:
    encode(stage(tmp_path / "x.usda", moving(), lasts), tmp_path / "x.pdeanim", tolerance=1e-3)
    with open_sequence(tmp_path / "x.pdeanim") as read:
        write_sequence(read, tmp_path / "y.usdc")
    assert says(tmp_path / "y.usdc") == expected
    with open_sequence(tmp_path / "y.usdc") as again:
        assert np.allclose(again.times * expected[3], [0, 10])


def test_frames_that_are_cut_off_take_the_range_of_the_stage_with_them(tmp_path: Path) -> None:
    with open_sequence(stage(tmp_path / "x.usda", moving(), LONG)) as read:
        points = read.read_frames(1, 2)
        clip = ArraySequence(points, objects=read.objects, times=read.times[1:], fps=24, metadata=read.metadata)
        write_sequence(clip, tmp_path / "y.usda")
    assert says(tmp_path / "y.usda") == (10, 10, 24, 48)


def test_points_under_a_moving_transform_are_written_while_they_move_alone(tmp_path: Path) -> None:
    from pxr import Usd, UsdGeom

    points = np.zeros((9, 3, 3), np.float32) + np.eye(3, dtype=np.float32)
    points[6:, 0, 2] = [1, 2, 3]
    matrices = np.tile(np.eye(4), (9, 1, 1))
    matrices[:, 3, 0] = np.arange(9)
    times = np.arange(9) / 24
    objects = [
        MeshObject(name, Connectivity(3, [3], [0, 1, 2]), (transform_attribute(times, matrices),))
        for name in ("later", "never")
    ]
    clip = ArraySequence(
        np.concatenate([points, points[:1].repeat(9, 0)], axis=1), objects=objects, times=times, fps=24
    )
    with clip, pytest.MonkeyPatch.context() as patch:
        patch.setattr(ArraySequence, "blocks", lambda self, frames=None: MeshSequence.blocks(self, 2))
        write_sequence(clip, tmp_path / "x.usdc")
    stage = Usd.Stage.Open(str(tmp_path / "x.usdc"))
    paths = ("/scene/later", "/scene/never")
    samples = [UsdGeom.Mesh(stage.GetPrimAtPath(path)).GetPointsAttr().GetTimeSamples() for path in paths]
    assert samples == [[0, 5, 6, 7, 8], [0]]
    with open_sequence(tmp_path / "x.usdc", transforms="keep") as read:
        assert np.array_equal(read.times, times)
        assert np.array_equal(read.read_frames(0, 9)[:, :3], points)
