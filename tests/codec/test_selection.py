"""Some objects of a sequence, by name, are a sequence like any other."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from pdecodec import ArraySequence, InputError, MeshObject, ObjectSelection, encode, open_animation
from pdecodec.mesh.selection import FrameSelection
from tests.support.mesh_cases import grid


def three_sheets() -> ArraySequence:
    names = ("left", "middle", "left")
    objects = [MeshObject(name, grid(2, 3 + index)) for index, name in enumerate(names)]
    vertices = sum(item.vertex_count for item in objects)
    return ArraySequence(np.random.default_rng(0).normal(size=(4, vertices, 3)), objects=objects)


def test_objects_keep_their_order_connectivity_and_positions() -> None:
    whole = three_sheets()
    part = ObjectSelection(whole, ["left"])
    assert [item.vertex_count for item in part.objects] == [6, 10]
    assert part.connectivity.vertex_count == 16
    assert np.array_equal(part.read_frames(1, 3), whole.points[1:3][:, [*range(6), *range(14, 24)]])
    assert np.array_equal(part.times, whole.times)


def test_one_object_of_a_decoded_animation_has_the_positions_it_has_in_the_whole() -> None:
    data = encode(three_sheets(), tolerance=1e-2).data
    assert data is not None
    with open_animation(data) as animation:
        part = ObjectSelection(animation, ["middle"])
        assert np.array_equal(part.read_frames(0, 4), animation.read_frames(0, 4)[:, 6:14])


def test_a_selected_object_encodes_alone(tmp_path: Path) -> None:
    report = encode(ObjectSelection(three_sheets(), ["middle"]), tmp_path / "middle.pdeanim", tolerance=1e-2)
    with open_animation(report.path or "") as animation:
        assert [item.name for item in animation.objects] == ["middle"]


@pytest.mark.parametrize(("names", "message"), [(["middle", "right"], "no object 'right'"), ([], "holds no object")])
def test_a_name_that_is_not_there_is_refused_with_those_that_are(names: list[str], message: str) -> None:
    with pytest.raises(InputError, match=message):
        ObjectSelection(three_sheets(), names)


@pytest.mark.parametrize(("frames", "fps"), [(range(20), 60.0), (range(1, 20, 2), 30.0), ([4], 60.0), ([5, 6], 60.0)])
def test_evenly_chosen_frames_keep_the_rate_of_the_source_over_their_step(frames: Sequence[int], fps: float) -> None:
    times = (np.arange(20) / 60).astype(np.float32).astype(np.float64)
    source = ArraySequence(np.zeros((20, 1, 3), np.float32), times=times, fps=60.0)
    assert FrameSelection(source, frames).fps == fps
