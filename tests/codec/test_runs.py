"""Sequences whose connectivity changes: encoded, decoded, selected and written run by run."""

from __future__ import annotations

import pickle
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from pdecodec import (
    Animation,
    ArraySequence,
    Attribute,
    ChangingSequence,
    CorruptFileError,
    DecodeLimits,
    EncodeSettings,
    InputError,
    LimitError,
    MeshObject,
    MeshSequence,
    SettingsError,
    encode,
    encode_to_size,
    open_animation,
    open_sequence,
    write_sequence,
)
from pdecodec.cli.main import run
from pdecodec.codec.resampling import sampled
from pdecodec.mesh.metrics import frame_scale, measure_distortion
from pdecodec.mesh.runs import changed
from pdecodec.mesh.selection import ObjectSelection, select
from spec.accepted import connectivity, grid, noise, runs, runs_of_one_frame, wave
from spec.decoder import animation as independent
from spec.sealing import content, take_apart, take_runs
from tests.support.damage import place_in_run
from tests.support.decoders import assert_same

SHAPES: tuple[tuple[int, int], ...] = ((2, 3), (4, 5), (3, 7), (6, 2))


def run_of(frames: int, shape: tuple[int, int], first: int, **options: Any) -> ArraySequence:
    return ArraySequence(
        wave(first + frames, *shape)[first:],
        objects=[MeshObject("mesh", grid(*shape))],
        times=(first + np.arange(frames)) / 24,
        **options,
    )


def fluid(lengths: Sequence[tuple[int, int]]) -> ChangingSequence:
    """Return runs with these numbers of frames and shapes."""
    first, parts = 0, []
    for frames, shape in lengths:
        parts.append(run_of(frames, SHAPES[shape], first))
        first += frames
    return ChangingSequence(parts)


def frames_of(sequence: MeshSequence) -> list[np.ndarray[Any, Any]]:
    """Return the positions of every frame."""
    return [points for _, block in sequence.blocks() for points in block]


def decoded(sequence: MeshSequence, **options: Any) -> Animation:
    data = encode(sequence, **options).data
    assert data is not None
    return open_animation(data)


@settings(max_examples=10)
@given(
    st.lists(st.tuples(st.integers(1, 4), st.integers(0, 3)), min_size=1, max_size=5),
    st.sampled_from([1e-2, 1e-4]),
)
def test_any_runs_come_back_within_the_bound_with_their_faces(lengths: list[tuple[int, int]], tolerance: float) -> None:
    sequence = fluid(lengths)
    report = encode(sequence, tolerance=tolerance, effort="fast")
    assert report.bound == tolerance * frame_scale(sequence.runs[0].read_frames(0, 1)[0])
    assert report.file_bytes == len(report.data or b"")
    assert encode(sequence, tolerance=tolerance, effort="fast").data == report.data
    with open_animation(report.data or b"") as animation:
        animation.verify()
        assert np.array_equal(animation.times, sequence.times)
        assert len(animation.runs) == len(lengths)
        largest = 0.0
        for frame, (time, points) in enumerate(zip(sequence.times.tolist(), frames_of(sequence), strict=True)):
            found = animation.positions(time)
            largest = max(largest, float(np.linalg.norm(found.astype(np.float64) - points, axis=1).max()))
            assert np.array_equal(found, animation.read_frames(frame, frame + 1)[0])
            assert animation.run_at(time).connectivity.same_as(sequence.run_at(time).connectivity)
        assert largest == pytest.approx(report.max_error, rel=1e-6, abs=1e-12)
        assert largest <= (report.bound or 0.0)
        assert sum(animation.sections.values()) == report.file_bytes
        plain = independent.decode_runs(report.data or b"")
        for other, mine in zip(plain, animation.runs, strict=True):
            assert isinstance(mine, Animation)
            assert_same(other, mine, mine.times.tolist())


def test_a_sequence_of_one_run_is_encoded_as_the_run_is_but_for_the_table_of_runs() -> None:
    alone = run_of(5, (4, 5), 0)
    with decoded(ChangingSequence([alone])) as animation, decoded(alone) as usual:
        assert np.array_equal(animation.read_frames(0, 5), usual.read_frames(0, 5))
        assert animation.vertex_count == 20
        assert animation.objects[0].connectivity.same_as(alone.connectivity)


def test_times_between_two_runs_hold_the_earlier_one_and_nothing_moves_there() -> None:
    sequence = fluid([(3, 0), (1, 1), (2, 2)])
    with decoded(sequence) as animation:
        for time, frame in ((2.5 / 24, 2), (3.9 / 24, 3), (4.0 / 24, 4), (9.0, 5), (-1.0, 0)):
            assert np.array_equal(animation.positions(time), animation.read_frames(frame, frame + 1)[0])
        assert np.any(animation.velocities(0.5 / 24))
        for time in (2.5 / 24, 3.5 / 24, -1.0, 9.0):
            assert not np.any(animation.velocities(time))
            assert not np.any(animation.accelerations(time))
        assert animation.run_number_at(2.99 / 24) == 0
        assert animation.run_number_at(3 / 24) == 1
        looped = animation.positions(6.0 / 24, outside="loop")
        assert np.allclose(looped, animation.positions(1.0 / 24), atol=1e-5)
        with pytest.raises(SettingsError, match="outside the clip"):
            animation.positions(9.0, outside="refuse")
        with pytest.raises(SettingsError, match="several runs of frames"):
            animation.sample([0.0, 4.0 / 24])
        assert animation.sample([0.01, 0.02]).shape == (2, 6, 3)
        assert animation.sample([]).shape == (0, 6, 3)


def test_calls_that_need_constant_connectivity_fail_with_one_line(tmp_path: Path) -> None:
    sequence = fluid([(2, 0), (1, 1)])
    with decoded(sequence) as animation:
        for ask in (
            lambda: animation.objects,
            lambda: animation.vertex_count,
            lambda: animation.connectivity,
            lambda: animation.read_frames(0, 3),
            lambda: sequence.to_array(),
            lambda: animation.meshes,
        ):
            with pytest.raises(InputError, match="its connectivity changes") as caught:
                ask()
            assert caught.value.frame == 2
        with pytest.raises(SettingsError, match="to one run"):
            animation.coefficients(0)
    for extension in ("mdd", "pc2", "npz", "h5", "xdmf", "glb"):
        with pytest.raises(InputError, match=r"cannot hold connectivity that changes; write \.obj") as refused:
            write_sequence(sequence, tmp_path / f"x.{extension}")
        assert refused.value.frame == 2
        assert not list(tmp_path.iterdir())


def test_sections_that_are_those_of_the_run_before_are_stored_once() -> None:
    shared = take_runs(take_apart(encode(fluid([(1, 0)] * 6)).data or b""))
    for row in shared[1:]:
        assert [row.sections[kind] for kind in ("NAME", "CONN", "MODL")] == [None] * 3
    names = [row.sections["NAME"] for row in take_runs(take_apart(encode(runs()).data or b""))]
    assert names[1] is names[2] is None
    assert names[3] is not None


def test_only_the_requested_run_is_read(tmp_path: Path) -> None:
    sequence = fluid([(2, k % 4) for k in range(12)])
    data = encode(sequence, tmp_path / "x.pdeanim").path
    assert data is not None

    class File:
        def __init__(self) -> None:
            self.content, self.at, self.read_places = (tmp_path / "x.pdeanim").read_bytes(), 0, set[int]()

        def seek(self, offset: int, whence: int = 0) -> int:
            self.at = offset if whence == 0 else len(self.content) + offset
            return self.at

        def read(self, size: int) -> bytes:
            found = self.content[self.at : self.at + size]
            self.read_places.update(range(self.at, self.at + len(found)))
            return found

    file = File()
    with open_animation(file) as animation:  # type: ignore[arg-type]
        parts = take_apart(file.content)
        begin = len(file.content) - len(content(parts, "RDAT"))
        assert not {place for place in file.read_places if place >= begin}
        file.read_places.clear()
        animation.positions(float(animation.times[-1]))
        rows = take_runs(parts)
        own = len(rows[-1].data)
        assert {place for place in file.read_places if place >= len(file.content) - own}
        assert len(file.read_places) < 3 * own


def test_limits_count_all_runs_together() -> None:
    data = encode(fluid([(2, 1)] * 4)).data or b""
    assert open_animation(data, limits=DecodeLimits(max_output=12 * 8 * 20)).frame_count == 8
    with pytest.raises(LimitError, match="1920 bytes of positions"):
        open_animation(data, limits=DecodeLimits(max_output=12 * 8 * 20 - 1))
    with pytest.raises(LimitError, match=r"runs of frames.*raise max_memory if you trust the file"):
        open_animation(data, limits=DecodeLimits(max_memory=2_500))


def test_an_animation_of_runs_and_each_of_its_runs_are_pickled(tmp_path: Path) -> None:
    encode(fluid([(2, 0), (1, 1)]), tmp_path / "x.pdeanim")
    with open_animation(tmp_path / "x.pdeanim") as animation:
        again, run = pickle.loads(pickle.dumps((animation, animation.runs[1])))
        assert np.array_equal(again.positions(0.01), animation.positions(0.01))
        assert np.array_equal(run.read_frames(0, 1), animation.read_frames(2, 3))
        again.close()
        run.close()
        with pytest.raises(InputError, match="is closed"):
            again.positions(0.01)


def test_damage_in_a_run_is_found_there_and_named_by_its_frame(tmp_path: Path) -> None:
    data = bytearray(encode(fluid([(2, 0), (3, 1)]), tolerance=1e-4).data or b"")
    data[place_in_run(bytes(data), 1, "COEF")[0]] ^= 1
    with open_animation(bytes(data)) as animation:
        animation.positions(0.0)
        with pytest.raises(CorruptFileError, match="damaged") as caught:
            animation.positions(3 / 24)
        assert caught.value.frame == 2


def test_runs_are_selected_turned_and_resampled_as_other_sequences_are() -> None:
    sequence = fluid([(3, 0), (1, 1), (2, 2)])
    every = frames_of(sequence)
    some = select(sequence, [1, 3, 5])
    assert [len(points) for points in frames_of(some)] == [6, 20, 21]
    assert all(np.array_equal(points, every[frame]) for points, frame in zip(frames_of(some), (1, 3, 5), strict=True))
    one = select(sequence, range(4, 6))
    assert (one.vertex_count, one.times.tolist()) == (21, [4 / 24, 5 / 24])
    with pytest.raises(InputError, match="frames must increase"):
        select(sequence, [7])
    same = changed(sequence, lambda run: ObjectSelection(run, ["mesh"]))
    assert measure_distortion(sequence, same).max_error == 0
    with decoded(sequence) as animation:
        times = np.arange(11) / 48
        found = sampled(animation, times)
        assert np.array_equal(found.times, times)
        for time, points in zip(times.tolist(), frames_of(found), strict=True):
            assert np.array_equal(points, animation.positions(time))
        speeds = frames_of(sampled(animation, [-1.0, 0.01, 2.5 / 24], quantity="velocities", outside="clamp"))
        assert [bool(np.any(speed)) for speed in speeds] == [False, True, False]


def test_the_paper_profile_and_a_free_order_hold_for_each_run() -> None:
    for options in ({"profile": "paper", "tolerance": 0.05}, {"order": "free"}):
        report = encode(runs(), **options)
        with open_animation(report.data or b"") as animation:
            animation.verify()
            assert [run.vertex_count for run in animation.runs] == [12, 15, 15, 30, 9]
            assert animation.info()["settings"] == EncodeSettings(**options).changed()


def test_a_size_is_looked_for_over_all_runs() -> None:
    report = encode_to_size(runs_of_one_frame(), 700)
    assert report.file_bytes <= 700
    assert report.runs == 5


def test_bad_positions_are_named_by_the_frame_of_the_whole() -> None:
    sequence = fluid([(2, 0), (3, 1)])
    broken = run_of(3, SHAPES[1], 2)
    broken.points[1, 4] = np.nan
    with pytest.raises(InputError, match="vertex 4 of object 'mesh'") as caught:
        encode(ChangingSequence([sequence.runs[0], broken]))
    assert caught.value.frame == 3


def test_runs_must_follow_one_another() -> None:
    with pytest.raises(InputError, match="no runs"):
        ChangingSequence([])
    with pytest.raises(InputError, match="times must increase"):
        ChangingSequence([run_of(2, SHAPES[0], 5), run_of(2, SHAPES[1], 0)])


PATTERNS = ("x/", "x.####.ply", "x.####.vtu", "x.pvd")


@pytest.mark.parametrize("name", PATTERNS)
def test_runs_are_written_and_read_again_with_their_faces_and_times(name: str, tmp_path: Path) -> None:
    sequence = fluid([(2, 0), (1, 1), (1, 2), (2, 0)])
    write_sequence(sequence, f"{tmp_path}/{name}")
    with open_sequence(tmp_path / name, fps=24 if "#" in name else None) as read:
        assert read.run_starts.tolist() == [0, 2, 3, 4]
        assert np.allclose(read.times, sequence.times)
        assert all(np.array_equal(a, b) for a, b in zip(frames_of(read), frames_of(sequence), strict=True))
        for mine, other in zip(read.runs, sequence.runs, strict=True):
            assert mine.connectivity.same_as(other.connectivity)


def test_runs_keep_names_uvs_lines_and_points_through_obj(tmp_path: Path) -> None:
    uv = Attribute("uv", "corner", noise(8, 2).astype(np.float32), np.arange(24, dtype=np.int32) % 8)
    first = [MeshObject("sheet", grid(3, 4), (uv,)), MeshObject("string", connectivity(3, lines=[(0, 1, 2)]))]
    second = [MeshObject("drops", connectivity(5, lines=[(k,) for k in range(5)]))]
    parts = [
        ArraySequence(noise(2, 15, 3), objects=first, times=[0, 1 / 24]),
        ArraySequence(noise(1, 5, 3), objects=second, times=[2 / 24]),
    ]
    write_sequence(ChangingSequence(parts), f"{tmp_path}/x/")
    with open_sequence(tmp_path / "x") as read:
        report = encode(read, tolerance=1e-5)
    with open_animation(report.data or b"") as animation:
        assert [[item.name for item in run.objects] for run in animation.runs] == [["sheet", "string"], ["drops"]]
        (found,) = animation.runs[0].objects[0].attributes
        assert np.array_equal(found.values[found.indices], uv.values[uv.indices])
        assert animation.runs[1].objects[0].connectivity.same_as(second[0].connectivity)


def test_every_command_takes_runs(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    write_sequence(fluid([(2, 0), (1, 1), (3, 2)]), "x/")

    def said(*arguments: str, code: int = 0) -> str:
        assert run(arguments) == code
        return "".join(capsys.readouterr())

    assert '"runs": 3' in said("encode", "x", "x.pdeanim", "--json")
    assert "in 3 runs" in said("encode", "x", "y.pdeanim", "--dry-run")
    assert "changes at frame 2" in said("info", "x.pdeanim")
    assert "changes at frame 2" in said("info", "x", "--all-frames")
    said("decode", "x.pdeanim", "y/")
    said("compare", "x", "y", "--tolerance", "1e-3")
    said("compare", "x", "x.pdeanim", "--at-frames", "--tolerance", "1e-3")
    said("compare", "x", "x.pdeanim", "--tolerance", "1e-9", code=1)
    said("decode", "x.pdeanim", "z.pvd", "--fps", "48", "--velocities")
    assert len(list(tmp_path.glob("z.0*.vtu"))) == 11
    said("decode", "x.pdeanim", "m.obj", "--at", "0.1")
    said("convert", "x", "x.####.vtu", "--up-axis", "Z", "--scale", "2")
    said("convert", "x.pdeanim", "first.npz", "--frames", ":2")
    assert "choose frames of one connectivity" in said("convert", "x.pdeanim", "all.npz", code=3)
    write_sequence(fluid([(2, 0), (1, 2), (3, 2)]), "other/")
    assert '"connectivity_equal": false' in said("compare", "x", "other", "--json", code=1)
