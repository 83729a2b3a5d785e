"""The USD plug-in shows the prims, names and values that `pdecodec decode` writes, and the motion between them.

The Python that runs this has pdecodec and a USD with the plug-in on PXR_PLUGINPATH_NAME: `make test-plugins`.
"""

from __future__ import annotations

import os
import shutil
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st
from pxr import Sdf, Tf, Usd, UsdUtils

import pdecodec
from pdecodec.codec.resampling import sampled
from pdecodec.formats import write_sequence
from pdecodec.formats.base.attribute_roles import direction_role
from pdecodec.mesh.sequence import Attribute, AttributeDomain, MeshObject
from pdecodec.mesh.times import times_at_rate
from spec.vector_files import accepted_vectors, refused_vectors
from tests.plugins.usd_tools import assert_same_attribute, assert_same_stage, message_of, opened, value_at
from tests.support.mesh_cases import connectivity_of
from tests.support.scene_cases import body, scene, turning


@pytest.fixture(scope="module")
def vectors(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("vectors")
    for name, data in accepted_vectors().items():
        (folder / f"{name}.pdeanim").write_bytes(data)
    return folder


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A sheet of 24 frames in four groups."""
    path = tmp_path_factory.mktemp("clip") / "sheet.pdeanim"
    u, v = (one.ravel() for one in np.meshgrid(np.linspace(0, 1, 20), np.linspace(0, 1, 20)))
    times = np.arange(24) / 24
    heights = 0.1 * np.sin(7 * u + 9 * times[:, None])
    points = np.stack([np.broadcast_to(u, heights.shape), np.broadcast_to(v, heights.shape), heights], axis=2)
    corners = np.arange(380)[np.arange(380) % 20 < 19]
    faces = np.stack([corners, corners + 1, corners + 21, corners + 20], axis=1)
    pdecodec.encode(pdecodec.ArraySequence(points.astype(np.float32), faces=faces, fps=24), path, group_frames=6)
    return path


def written(path: Path, where: Path, fps: float | None = None) -> Any:
    """Return the stage that a file decodes to, with velocities: then no rigid object moves by a transform."""
    with pdecodec.open(path) as animation:
        has_own = any(map(direction_role, animation.runs[0].fields))
        times = animation.times if fps is None else times_at_rate(animation.times[0], animation.times[-1], fps)
        frames = animation if fps is None else sampled(animation, times)
        # Several runs are sampled run by run.
        is_one = len(animation.runs) == 1 and not has_own
        velocities = sampled(animation, times, quantity="velocities") if is_one else None
        write_sequence(frames, where, velocities=velocities, scene="drop")
    return Usd.Stage.Open(str(where))


def assert_matches_written(path: Path, where: Path, fps: float | None = None) -> None:
    found = opened(path) if fps is None else opened(path, fps=fps)
    assert_same_stage(found, written(path, where / f"{path.stem}.usdc", fps))


@pytest.mark.parametrize("name", sorted(accepted_vectors()))
def test_a_vector_opens_as_the_stage_that_it_decodes_to(vectors: Path, tmp_path: Path, name: str) -> None:
    assert_matches_written(vectors / f"{name}.pdeanim", tmp_path)


def hard_edges() -> list[Attribute]:
    return [
        Attribute("normal_group", "corner", np.array([0, 0, 0, 0, 1, 0, 0], np.int32)),
        Attribute("shared_normal", "vertex", np.array([1, 1, 0, 0, 0], np.int32)),
        Attribute(
            "uv:light map", "corner", np.arange(10, dtype=np.float32).reshape(5, 2), np.array([0, 1, 2, 3, 2, 1, 4])
        ),
        Attribute("color:skin", "corner", np.arange(8, dtype=np.uint8).reshape(2, 4), np.array([0, 1, 0, -1, 1, 1, 0])),
        Attribute("material:both", "face", np.array([1, 1], np.uint8)),
        Attribute("material:one", "face", np.array([0, 1], np.uint8)),
        Attribute("weights", "vertex", np.linspace(0, 1, 10).reshape(5, 2)),
    ]


def matrices(frames: int, *scale: float) -> Attribute:
    found = turning(frames, 2, 0.3, np.array(scale or (1, 1, 1))).reshape(frames, 16)
    return Attribute("transform", "object", np.column_stack([np.arange(1, frames + 1) / 24, found]))


def label(name: str, text: str) -> Attribute:
    return Attribute(name, "object", np.zeros(1, np.int32), labels=(text,))


def labels(name: str, domain: AttributeDomain, *rows: int) -> Attribute:
    values = np.arange(1 if domain == "object" else 2, dtype=np.int32)
    return Attribute(name, domain, values, np.array(rows, np.int32), labels=("bilinear", "loop"))


def curve(name: str, *attributes: Attribute) -> MeshObject:
    return MeshObject(name, connectivity_of(5, lines=[[4, 1, 2], [3, 0]]), attributes)


SCENES: dict[str, list[MeshObject]] = {
    "usual": [],
    "hard edges": [body("root/arm/hand", hard_edges()), body("root/arm", ())],
    "smooth": [body("a", [Attribute("normal_group", "corner", np.zeros(7, np.int32))])],
    "smoothing groups": [body("a", [Attribute("smoothing", "face", np.array([1, 0], np.int32))])],
    "odd names": [body("1st/a b"), body("1st/a b"), body("1st/a_b"), body(""), body("ü/😀")],
    "no labels": [
        body("a", [labels("material", "face", 1, -1), labels("group", "face", -1, -1), labels("kind", "face", -1, 1)]),
        body("b", [labels("subdivision", "object", -1), labels("v", "vertex", 0, 1, 0, 1, 1)]),
    ],
    "subdivision": [body("a", [label("subdivision", "catmull-clark"), *hard_edges()[:1]])],
    "transforms": [body("a", [matrices(5)]), body("b/c")],
    "mirrored": [
        body("a", [matrices(5, -1, 1, 2), *hard_edges()]),
        body("b", [matrices(5, -1, -1, -1), label("subdivision", "loop")]),
    ],
    "curves": [curve("a"), curve("b", label("curve_basis", "cubic bspline"), label("curve_wrap", "periodic"))],
}


@pytest.mark.parametrize("name", SCENES)
def test_a_scene_opens_as_the_stage_that_it_decodes_to(tmp_path: Path, name: str) -> None:
    path = tmp_path / "scene.pdeanim"
    pdecodec.encode(scene(SCENES[name] or None, up_axis="Z", unit="2.5 m", source="a program"), path)
    assert_matches_written(path, tmp_path)


def test_the_argument_fps_is_that_of_decoding(clip: Path, vectors: Path, tmp_path: Path) -> None:
    assert_matches_written(clip, tmp_path, fps=30)
    assert_matches_written(vectors / "polygons_attributes.pdeanim", tmp_path, fps=7.5)
    with pytest.raises(Tf.ErrorException, match="more than the memory limit allows"):
        opened(clip, memory=0.001)


@given(
    name=st.sampled_from(["fps", "cache", "memory"]),
    value=st.one_of(st.floats().map(repr), st.integers().map(str), st.text("0123456789.,+-eExinfa \t", max_size=8)),
)
@example("fps", "1e12")
@example("cache", "1e300")
@example("memory", "1e-300")
@example("memory", "30,5")
@settings(suppress_health_check=[HealthCheck.function_scoped_fixture], deadline=None, database=None)
def test_an_argument_is_a_number_in_its_range_or_named_in_one_line(clip: Path, name: str, value: str) -> None:
    message = message_of(clip, partial(opened, clip, **{name: value}))
    try:
        is_fit = 1e-9 <= float(value) <= 1e9
    except ValueError:
        is_fit = False
    if is_fit and not message:
        return
    assert f"argument '{name}'" in message or "memory limit" in message


@pytest.mark.parametrize(
    "name", ["groups", "polygons_attributes", "several_objects", "runs", "jumps", "irregular_times"]
)
def test_values_between_frames_are_those_of_the_decoder(vectors: Path, name: str) -> None:
    path = vectors / f"{name}.pdeanim"
    stage = opened(path)
    # Objects without vertices have no motion.
    prims = [prim for prim in stage.TraverseAll() if prim.GetAttribute("velocities").HasAuthoredValue()]
    with pdecodec.open(path) as animation:
        times = animation.times
        whens = np.random.default_rng(3).uniform(times[0] - 0.1, times[-1] + 0.1, 20)
        for when in [*whens, *times]:
            run = animation.run_at(when) if len(animation.runs) > 1 else animation
            inside = min(max(when, times[0]), times[-1])
            code = Usd.TimeCode(when * stage.GetTimeCodesPerSecond())
            for quantity in ("positions", "velocities", "accelerations"):
                expected = getattr(run, quantity)(inside, outside="clamp")
                name = quantity.replace("positions", "points")
                found = [np.array(prim.GetAttribute(name).Get(code)).reshape(-1, 3) for prim in prims]
                np.testing.assert_array_equal(np.concatenate(found), expected)


def test_fields_between_frames_are_those_of_the_decoder(vectors: Path) -> None:
    path = vectors / "fields.pdeanim"
    stage = opened(path)
    with pdecodec.open(path) as animation:
        times = np.linspace(animation.times[0], animation.times[-1], 9)
        for field in animation.fields:
            names = (f"primvars:{field.name}", field.name)
            attributes = [
                one
                for prim in stage.TraverseAll()
                for one in prim.GetAuthoredAttributes()
                if one.GetName() in names or one.GetCustomDataByKey("pdecodec:name") == field.name
            ]
            rate = stage.GetTimeCodesPerSecond()
            found = [[np.ravel(one.Get(time * rate)) for time in times] for one in attributes]
            # Several times at once are summed in another order.
            expected = [np.ravel(animation.field(field.name, time)) for time in times]
            np.testing.assert_allclose(np.concatenate(found, axis=1), expected, rtol=1e-12, err_msg=field.name)


def test_a_reference_with_an_offset_shows_the_motion_at_its_times(clip: Path) -> None:
    stage = Usd.Stage.CreateInMemory()
    stage.SetTimeCodesPerSecond(24)
    prim = stage.DefinePrim("/walk")
    prim.GetReferences().AddReference(f"{clip}:SDF_FORMAT_ARGS:fps=30", "/mesh", Sdf.LayerOffset(100, 0.5))
    with pdecodec.open(clip) as animation:
        # The layer's 30 codes a second are scaled to the stage's 24, then by the offset.
        np.testing.assert_allclose(prim.GetAttribute("points").Get(106.2), animation.positions(12.4 / 24), atol=1e-6)
        assert len(prim.GetAttribute("points").GetTimeSamples()) == 29


def test_a_layer_evaluates_when_it_is_asked(clip: Path, tmp_path: Path) -> None:
    layer = Sdf.Layer.FindOrOpen(str(clip))
    assert not layer.IsDetached()
    assert not layer.GetFileFormat().SupportsWriting()
    assert not layer.GetFileFormat().SupportsEditing()
    path = "/mesh.points"
    assert layer.ListTimeSamplesForPath(path) == pytest.approx(list(range(24)))
    assert layer.GetNumTimeSamplesForPath(path) == 24
    assert layer.GetBracketingTimeSamplesForPath(path, 3.3) == (True, 3.3, 3.3)
    assert layer.GetBracketingTimeSamplesForPath(path, -5) == (True, 0, 0)
    assert layer.GetBracketingTimeSamplesForPath(path, 99) == (True, 23, 23)
    assert layer.QueryTimeSample("/mesh.faceVertexCounts", 1) is None
    # A copy holds all samples.
    layer.Export(str(tmp_path / "copy.usdc"))
    copy, stage = Usd.Stage.Open(str(tmp_path / "copy.usdc")), opened(clip)
    assert_same_attribute(stage.GetAttributeAtPath(path), copy.GetAttributeAtPath(path))


def test_a_package_holds_a_clip(clip: Path, tmp_path: Path) -> None:
    (tmp_path / "root.usda").write_text(f'#usda 1.0\ndef "a" (references = @{clip}@</mesh>) {{}}\n')
    assert UsdUtils.CreateNewUsdzPackage(Sdf.AssetPath(str(tmp_path / "root.usda")), str(tmp_path / "a.usdz"))
    points = value_at(tmp_path / "a.usdz", "/a.points", 3.5)
    np.testing.assert_array_equal(points, value_at(clip, "/mesh.points", 3.5))


def read_at_random(stage: Any, seed: int, count: int) -> list[tuple[str, float, Any]]:
    random = np.random.default_rng(seed)
    names = ("points", "velocities", "extent", "normals", "primvars:normals")
    attributes = [one for prim in stage.TraverseAll() for one in prim.GetAuthoredAttributes() if one.GetName() in names]
    found = []
    for _ in range(count):
        one = attributes[random.integers(len(attributes))]
        code = float(random.uniform(stage.GetStartTimeCode(), stage.GetEndTimeCode()))
        found.append((str(one.GetPath()), code, np.array(one.Get(code))))
    return found


def test_eight_threads_read_what_one_does(clip: Path, vectors: Path) -> None:
    count = int(os.environ.get("PDECODEC_USD_READS", "40"))
    # A cache of a kilobyte: threads throw out what others decode.
    stages = [opened(clip, cache=0.001), opened(vectors / "runs.pdeanim"), opened(vectors / "several_objects.pdeanim")]
    with ThreadPoolExecutor(8) as pool:
        jobs = [pool.submit(read_at_random, stages[seed % 3], seed, count) for seed in range(8)]
        results = [job.result() for job in jobs]
    for seed, values in enumerate(results):
        for path, code, value in values[:40]:
            expected = opened(clip) if seed % 3 == 0 else stages[seed % 3]
            np.testing.assert_array_equal(value, np.array(expected.GetAttributeAtPath(path).Get(code)))


def test_a_replaced_file_is_read_to_its_end_and_shown_by_reload(clip: Path, vectors: Path, tmp_path: Path) -> None:
    path = tmp_path / "clip.pdeanim"
    shutil.copy(clip, path)
    stage = opened(path)
    expected = value_at(clip, "/mesh.points", 20.5)
    shutil.copy(vectors / "groups.pdeanim", tmp_path / "new")
    (tmp_path / "new").replace(path)
    np.testing.assert_array_equal(stage.GetAttributeAtPath("/mesh.points").Get(20.5), expected)
    stage.GetRootLayer().Reload(force=True)
    new = opened(vectors / "groups.pdeanim")
    assert [prim.GetPath() for prim in stage.TraverseAll()] == [prim.GetPath() for prim in new.TraverseAll()]
    points = f"{stage.GetDefaultPrim().GetPath()}.points"
    np.testing.assert_array_equal(stage.GetAttributeAtPath(points).Get(1), new.GetAttributeAtPath(points).Get(1))
    # Overwritten in place, an open file can only be refused.
    path.write_bytes(path.read_bytes()[:300])
    with pytest.raises(Tf.ErrorException, match=str(path)):
        stage.GetRootLayer().Reload(force=True)


def values_of(path: Path) -> list[object]:
    """Return every value of a file."""
    stage = opened(path)
    attributes = [one for prim in stage.TraverseAll() for one in prim.GetAuthoredAttributes()]
    return [one.Get(code) for one in attributes for code in one.GetTimeSamples()]


def test_damage_is_named_in_one_line_with_the_file(clip: Path, tmp_path: Path) -> None:
    data = clip.read_bytes()
    with pdecodec.open(clip) as animation:
        expected = animation.positions(animation.times)
    places = dict[str, list[int]](opening=[], decoding=[])
    for place in range(9, len(data), len(data) // 40):
        path = tmp_path / f"damaged{place}.pdeanim"
        path.write_bytes(data[:place] + bytes([data[place] ^ 255]) + data[place + 1 :])
        if message_of(path, partial(opened, path)):
            places["opening"].append(place)
            continue
        stage = opened(path)
        points = stage.GetAttributeAtPath("/mesh.points")
        lines = [message_of(path, partial(points.Get, frame)) for frame in range(24)]
        for frame in range(24):
            if lines[frame]:
                assert f"</mesh.points> at time code {frame}" in lines[frame]
                places["decoding"].append(place)
            else:
                np.testing.assert_array_equal(points.Get(frame), expected[frame])
    assert all(places.values())


# The plug-in does not read the scene around the motion, nor its damage.
@pytest.mark.parametrize("name", sorted(name for name in refused_vectors() if "scene" not in name)[::7])
def test_a_refused_vector_raises_an_error_that_names_it(tmp_path: Path, name: str) -> None:
    path = tmp_path / "refused.pdeanim"
    path.write_bytes(refused_vectors()[name])
    assert message_of(path, partial(values_of, path))


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(Tf.ErrorException, match=r"none\.pdeanim"):
        Usd.Stage.Open(str(tmp_path / "none.pdeanim"))
