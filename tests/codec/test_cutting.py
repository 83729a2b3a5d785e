"""Cut, join and append to files: data copied bit by bit, data coded again, and inputs that are refused."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, InputError, MeshSequence, SettingsError
from pdecodec.cli.main import run
from pdecodec.codec.coded_file import CodedFile
from pdecodec.codec.editing import cut_animation, join_animations
from pdecodec.errors import CorruptFileError
from pdecodec.formats import write_sequence
from pdecodec.mesh.sequence import Attribute, MeshObject
from spec.accepted_fields import runs_with_fields
from spec.decoder import animation as independent
from spec.sealing import table_end, take_apart
from spec.vector_files import accepted_files
from tests.support.decoders import assert_same
from tests.support.mesh_cases import grid
from tests.support.solids import runs_with_cells

Capture = pytest.CaptureFixture[str]
FRAMES = 1100


def waves(frames: int = FRAMES, *, side: int = 5, start: float = 0.0, faces: int = 5) -> ArraySequence:
    """Return a sheet that waves without repeating itself."""
    x, z = np.meshgrid(np.linspace(0, 1, side), np.linspace(0, 2, side), indexing="ij")
    moment = (start + np.arange(frames))[:, None, None]
    height = 0.2 * np.sin(3 * x + 0.31 * moment) + 0.1 * np.sin(5 * z + 0.0011 * moment**1.5)
    points = np.stack(np.broadcast_arrays(x, height, z), axis=-1).reshape(frames, -1, 3)
    colours = Attribute("color:Cd", "vertex", np.linspace(0, 1, 3 * side * side, dtype=np.float32).reshape(-1, 3))
    item = MeshObject("sheet", grid(faces, faces), (colours,))
    return ArraySequence(points, objects=[item], times=(start + np.arange(frames)) / 24, fps=24, metadata={"unit": "m"})


@pytest.fixture(scope="module")
def clip(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Make a file with several groups of frames."""
    path = tmp_path_factory.mktemp("cut") / "clip.pdeanim"
    assert pdecodec.encode(waves(), path, effort="fast").groups > 2
    return path


@pytest.fixture(scope="module")
def paper(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a file in closed form with one group per eleven frames."""
    path = tmp_path_factory.mktemp("cut") / "paper.pdeanim"
    assert pdecodec.encode(waves(60), path, profile="paper", tolerance=1e-3).groups == 6
    return path


@pytest.fixture(params=["clip", "paper"])
def file(request: pytest.FixtureRequest) -> Path:
    found: Path = request.getfixturevalue(request.param)
    return found


def frames_of(path: Path) -> np.ndarray:
    with pdecodec.open(path) as animation:
        animation.verify()
        return animation.read_frames(0, animation.frame_count)


def edges_of(path: Path) -> list[int]:
    with CodedFile(path) as coded:
        return coded.edges


def test_a_part_has_the_very_positions_times_mesh_and_metadata_of_the_whole(file: Path, tmp_path: Path) -> None:
    edges = edges_of(file)
    part, whole = tmp_path / "part.pdeanim", frames_of(file)
    for first, end in ((edges[0], edges[1]), (edges[1], edges[-1]), (edges[1], edges[2])):
        report = cut_animation(file, part, first, end, overwrite=True)
        assert (report.frames, report.coded_again, report.file_bytes) == (end - first, 0, part.stat().st_size)
        assert np.array_equal(frames_of(part), whole[first:end])
        with pdecodec.open(part) as cut, pdecodec.open(file) as animation:
            assert cut.times.tolist() == animation.times[first:end].tolist()
            assert cut.connectivity.same_as(animation.connectivity)
            assert np.array_equal(cut.objects[0].attributes[0].values, animation.objects[0].attributes[0].values)
            assert cut.metadata == animation.metadata
            assert cut.info()["settings"] == animation.info()["settings"]
            assert cut.info()["summary"].endswith(f"; then frames {first} to {end - 1} of {edges[-1]}")


def test_the_independent_decoder_reads_a_part_and_what_is_joined(paper: Path, tmp_path: Path) -> None:
    edges, part = edges_of(paper), tmp_path / "part.pdeanim"
    cut_animation(paper, part, edges[1], edges[3])
    with pdecodec.open(part) as cut:
        assert_same(independent.decode(part.read_bytes()), cut, [*cut.times[::5], 0.5 * (cut.times[0] + cut.times[1])])


def test_parts_that_are_joined_are_the_whole_byte_for_byte(file: Path, tmp_path: Path) -> None:
    edges = edges_of(file)
    parts = [tmp_path / f"{number}.pdeanim" for number in range(3)]
    for path, span in zip(parts, ((0, 1), (1, 2), (2, -1)), strict=True):
        cut_animation(file, path, edges[span[0]], edges[span[1]])
    joined = tmp_path / "joined.pdeanim"
    report = join_animations(parts[0], parts[1:], joined)
    assert (report.frames, report.coded_again) == (edges[-1], 0)
    with CodedFile(file) as before, CodedFile(joined) as after:
        for kind in ("SEQN", "CONN", "ORDR", "REST", "MODL", "GRUP", "TIME", "COEF", "CORR", "ATTR"):
            assert before.section(kind) == after.section(kind), kind
    between = np.linspace(0, 2, 37)
    with pdecodec.open(file) as animation, pdecodec.open(joined) as other:
        assert np.array_equal(animation.sample(between), other.sample(between))


def test_between_frames_a_part_differs_near_its_ends_alone(clip: Path, tmp_path: Path) -> None:
    edges, part = edges_of(clip), tmp_path / "part.pdeanim"
    cut_animation(clip, part, edges[1], edges[2])
    with pdecodec.open(clip) as animation, pdecodec.open(part) as cut:
        between = (cut.times[1:] + cut.times[:-1]) / 2
        off = np.abs(animation.sample(between) - cut.sample(between)).max(axis=(1, 2))
    assert off[0] > 0
    assert off[10] < 1e-4 * off[0]
    assert not off[30:-30].any()


def test_a_cut_through_a_group_is_refused_with_the_nearest_places(clip: Path, tmp_path: Path) -> None:
    edges = edges_of(clip)
    with pytest.raises(SettingsError) as refused:
        cut_animation(clip, tmp_path / "part.pdeanim", edges[1] + 3, edges[-1])
    words = f"frame {edges[1] + 3} is inside one, which begins at {edges[1]} ({edges[1] / 24:g} s) and ends before"
    assert words in str(refused.value)
    assert f" {edges[2]} " in str(refused.value)
    for first, end in ((-1, 5), (5, 5), (0, FRAMES + 1)):
        with pytest.raises(SettingsError, match="there are no frames"):
            cut_animation(clip, tmp_path / "part.pdeanim", first, end)
    assert not (tmp_path / "part.pdeanim").exists()


def test_a_cut_through_groups_codes_their_frames_again_on_request(clip: Path, tmp_path: Path) -> None:
    edges, whole, part = edges_of(clip), frames_of(clip), tmp_path / "part.pdeanim"
    first, end = edges[1] - 20, edges[2] + 30
    report = cut_animation(clip, part, first, end, recode=True, effort="fast")
    assert report.coded_again == 50
    found = frames_of(part)
    assert np.array_equal(found[20:-30], whole[edges[1] : edges[2]])
    bound = 1e-3 * pdecodec.mesh.metrics.frame_scale(waves(1).points[0])
    assert np.linalg.norm(found - whole[first:end], axis=2).max() <= 1.001 * bound
    inside = cut_animation(clip, part, edges[1] + 5, edges[1] + 25, recode=True, effort="fast", overwrite=True)
    assert (inside.frames, inside.coded_again) == (20, 20)
    assert np.linalg.norm(frames_of(part) - whole[edges[1] + 5 : edges[1] + 25], axis=2).max() <= 1.001 * bound


def test_frames_are_appended_within_the_bound_and_nothing_before_them_changes(clip: Path, tmp_path: Path) -> None:
    more, longer = waves(40, start=FRAMES), tmp_path / "longer.pdeanim"
    report = join_animations(clip, [more], longer, effort="fast")
    assert (report.frames, report.coded_again) == (FRAMES + 40, 40)
    found = frames_of(longer)
    assert np.array_equal(found[:FRAMES], frames_of(clip))
    bound = 1e-3 * pdecodec.mesh.metrics.frame_scale(waves(1).points[0])
    assert 0 < np.linalg.norm(found[FRAMES:] - more.points, axis=2).max() <= 1.001 * bound
    with pdecodec.open(longer) as animation:
        assert animation.times.tolist() == waves(FRAMES + 40).times.tolist()


def test_appended_frames_follow_in_time_or_are_shifted(clip: Path, tmp_path: Path) -> None:
    more, longer = waves(10), tmp_path / "longer.pdeanim"
    with pytest.raises(SettingsError, match="begins at 0 s, but the frames before it end at 45"):
        join_animations(clip, [more], longer)
    join_animations(clip, [more], longer, shift=True, effort="fast")
    with pdecodec.open(longer) as animation:
        assert animation.times.tolist() == (np.arange(FRAMES + 10) / 24).tolist()
    uneven = ArraySequence(more.points, objects=more.objects, times=0.1 + np.arange(10) ** 1.1)
    join_animations(clip, [uneven], longer, shift=True, effort="fast", overwrite=True)
    with pdecodec.open(longer) as animation:
        assert np.allclose(animation.times[FRAMES:], FRAMES / 24 + np.arange(10) ** 1.1)


def test_a_file_of_another_mesh_or_reference_is_not_joined(clip: Path, paper: Path, tmp_path: Path) -> None:
    other, longer = tmp_path / "other.pdeanim", tmp_path / "longer.pdeanim"
    pdecodec.encode(waves(20, start=FRAMES), other, effort="fast", tolerance=1e-2)
    with pytest.raises(SettingsError, match=r"other.pdeanim: differs from .*clip.pdeanim in its reference frame"):
        join_animations(clip, [other], longer)
    assert join_animations(clip, [other], longer, recode=True, effort="fast").coded_again == 20
    with pytest.raises(InputError, match="is of another mesh"):
        join_animations(clip, [waves(5, side=6, faces=6, start=FRAMES)], longer, overwrite=True)
    pdecodec.encode(waves(5, side=6, faces=6, start=FRAMES), other, effort="fast", overwrite=True)
    for recode in (False, True):
        with pytest.raises(InputError, match=r"other.pdeanim: is of another mesh than .*clip.pdeanim"):
            join_animations(clip, [other], longer, recode=recode, overwrite=True)
    with pytest.raises(InputError, match="profile paper: no frames can be added to it"):
        join_animations(paper, [waves(20, start=60)], longer, overwrite=True)


def test_a_damaged_group_is_not_passed_on(clip: Path, tmp_path: Path) -> None:
    damaged, part = tmp_path / "damaged.pdeanim", tmp_path / "part.pdeanim"
    data = bytearray(clip.read_bytes())
    parts = take_apart(bytes(data))
    kinds = [part.kind for part in parts]
    data[table_end(parts) + sum(len(part.content) for part in parts[: kinds.index("COEF")])] ^= 1
    damaged.write_bytes(data)
    edges = edges_of(clip)
    cut_animation(damaged, part, edges[1], edges[2])
    with pytest.raises(CorruptFileError, match="frame 0: a group of frames is damaged"):
        cut_animation(damaged, part, 0, edges[1], overwrite=True)


def test_the_command_line_cuts_by_frames_and_times_and_joins(
    clip: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: Capture
) -> None:
    monkeypatch.chdir(tmp_path)
    edges, name = edges_of(clip), str(clip)
    assert run(["cut", name, "--frames", f":{edges[1]}", "-o", "a.pdeanim"]) == 0
    assert f"a.pdeanim: {edges[1]} frames in 1 group, 0 to " in capsys.readouterr().err
    assert run(["cut", name, "--times", f"{edges[1] / 24 - 0.01}:", "-o", "b.pdeanim", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["frames"] == FRAMES - edges[1]
    assert run(["join", "a.pdeanim", "b.pdeanim", "-o", "c.pdeanim"]) == 0
    assert np.array_equal(frames_of(Path("c.pdeanim")), frames_of(clip))
    write_sequence(waves(9), "more.npz")
    assert run(["join", "c.pdeanim", "more.npz", "-o", "d.pdeanim", "--shift", "--effort", "fast"]) == 0
    assert "9 frames coded" in capsys.readouterr().err
    for line, code in (
        (f"cut {name} --frames 1:{edges[1]} -o e.pdeanim", 2),
        (f"cut {name} --frames 9999: -o e.pdeanim", 2),
        (f"cut {name} --frames 1:2:3 -o e.pdeanim", 2),
        (f"cut {name} --times 99:100 -o e.pdeanim", 2),
        (f"cut {name} -o e.pdeanim", 2),
        (f"cut {name} --frames : -o e.npz", 2),
        (f"cut {name} --frames : -o a.pdeanim", 3),
        ("cut more.npz --frames : -o e.pdeanim", 4),
        ("join a.pdeanim a.pdeanim -o a.pdeanim", 2),
        ("join a.pdeanim nothing.npz -o e.pdeanim", 3),
    ):
        assert run(line.split()) == code, line
    assert not Path("e.pdeanim").exists()


@pytest.mark.parametrize("name", ["runs", "file_of_one_run"])
def test_files_of_runs_are_not_joined(tmp_path: Path, name: str) -> None:
    path = accepted_files()[name]
    with pytest.raises(InputError, match="joining such files is not supported") as caught:
        join_animations(path, [path], tmp_path / "out.pdeanim", shift=True)
    assert (caught.value.code, caught.value.path) == ("unsupported-feature", str(path))


def edges_of_run(own: MeshSequence) -> list[int]:
    assert isinstance(own, pdecodec.Animation)
    return list(own.group_edges)


def assert_is_part(part: pdecodec.Animation, whole: pdecodec.Animation, first: int) -> None:
    """Check that a file has the times, positions and fields of consecutive frames of another, to the last bit."""
    end = first + part.frame_count
    assert part.times.tolist() == whole.times[first:end].tolist()
    assert list(part.jumps) == [frame - first for frame in whole.jumps if first < frame < end]
    for cut in part.runs:
        own = whole.run_at(cut.times[0])
        start = int(np.searchsorted(own.times, cut.times[0]))
        stop = start + cut.frame_count
        assert np.array_equal(cut.read_frames(0, cut.frame_count), own.read_frames(start, stop))
        assert [item.name for item in cut.objects] == [item.name for item in own.objects]
        assert cut.connectivity.same_as(own.connectivity)
        assert cut.fields == own.fields
        for field in cut.fields:
            found, expected = cut.read_field(field.name, 0, cut.frame_count), own.read_field(field.name, start, stop)
            np.testing.assert_array_equal(found, expected, field.name)


@pytest.mark.parametrize(
    "name", ["runs", "file_of_one_run", "runs_that_jump", "fields_of_runs", "runs_in_closed_form", "runs_with_cells"]
)
def test_runs_are_cut_between_groups_with_their_fields_and_cells(tmp_path: Path, name: str) -> None:
    path, out = accepted_files().get(name, tmp_path / "whole.pdeanim"), tmp_path / "out.pdeanim"
    if name == "runs_with_cells":
        pdecodec.encode(runs_with_cells(), path, effort="fast")
    with pdecodec.open(path) as whole:
        starts = np.cumsum([0, *(own.frame_count for own in whole.runs)]).tolist()
        groups = zip(starts, whole.runs, strict=False)
        edges = sorted({start + edge for start, own in groups for edge in edges_of_run(own)} | {starts[-1]})
        for first, end in {(edges[0], edges[-1]), (edges[0], edges[1]), (edges[-2], edges[-1]), (edges[1], edges[-1])}:
            if first == end:
                continue
            report = cut_animation(path, out, first, end, overwrite=True)
            assert (report.frames, report.coded_again) == (end - first, 0)
            with pdecodec.open(out) as part:
                assert_is_part(part, whole, first)
            assert pdecodec.check_file(out, deep=True).is_sound
            assert len(independent.decode_runs(out.read_bytes())) >= 1


def test_a_cut_through_groups_of_runs_names_frames_of_the_file_and_codes_them_again(tmp_path: Path) -> None:
    path, out = tmp_path / "runs.pdeanim", tmp_path / "out.pdeanim"
    pdecodec.encode(runs_with_fields(), path, effort="fast", max_error=1e-4, fields={"bits": "exact"})
    with pytest.raises(SettingsError, match=r"frame 5 is inside one, which begins at 4 .* ends before 8, the end"):
        cut_animation(path, out, 2, 5)
    report = cut_animation(path, out, 1, 7, recode=True)
    assert (report.frames, report.coded_again) == (6, 4)
    with pdecodec.open(path) as whole, pdecodec.open(out) as part:
        assert part.run_frames.tolist() == [1, 2, 3]
        for field in part.runs[2].fields:
            found = part.runs[2].read_field(field.name, 0, 3)
            np.testing.assert_array_equal(found, whole.runs[2].read_field(field.name, 0, 3), field.name)
        assert np.abs(part.runs[2].read_frames(0, 3) - whole.runs[2].read_frames(0, 3)).max() <= 2e-4
    with pytest.raises(SettingsError, match="there are no frames 3 to 9; the file has 8"):
        cut_animation(path, out, 3, 9, overwrite=True)
