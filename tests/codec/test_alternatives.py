"""The encoder's alternatives and their cost: computed on request, kept in the file, and shown."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

import pdecodec
from pdecodec import ArraySequence, ChangingSequence, InputError
from pdecodec.cli.main import run
from pdecodec.codec.encode.report import EncodeReport, Question, from_json, to_json
from pdecodec.codec.stored_choices import alternatives_of
from pdecodec.formats import write_sequence
from pdecodec.mesh.sequence import MeshObject
from pdecodec.report.clips.why import alternatives_figure
from pdecodec.simulate.scenes import build
from tests.support.mesh_cases import grid

Capture = pytest.CaptureFixture[str]


def waves(frames: int = 24) -> ArraySequence:
    x, z = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 2, 9), indexing="ij")
    moment = np.arange(frames)[:, None, None]
    height = 0.2 * np.sin(3 * x + 0.31 * moment) + 0.1 * np.sin(5 * z + 0.1 * moment)
    points = np.stack(np.broadcast_arrays(x, height, z), axis=-1).reshape(frames, -1, 3)
    return ArraySequence(points, objects=[MeshObject("sheet", grid(9, 9))], fps=24)


@pytest.fixture(scope="module")
def asked() -> EncodeReport:
    return pdecodec.encode(waves(), why=True)


def taken(question: Question) -> int:
    (size,) = [item.size for item in question.ways if item.chosen]
    return size


def test_each_choice_has_several_ways_of_which_one_was_taken(asked: EncodeReport) -> None:
    assert [question.what for question in asked.alternatives] == [
        "functions of time",
        "displacements from",
        "step of coefficients",
        "functions of space",
        "step of the reference frame",
    ]
    for question in asked.alternatives:
        assert len({item.way for item in question.ways}) == len(question.ways) >= 2
        assert taken(question) > 0


def test_nothing_that_was_looked_at_cost_less_on_a_small_mesh(asked: EncodeReport) -> None:
    for question in asked.alternatives:
        assert taken(question) == min(item.size for item in question.ways), question.what


def test_the_length_of_groups_is_a_choice_where_dividing_them_may_pay() -> None:
    clip = build("cloth", columns=30, rows=30).simulate(frames=24)
    report = pdecodec.encode(clip, tolerance=1e-4, why=True)
    questions = {question.what: question for question in report.alternatives}
    assert report.groups > 1
    assert questions["functions of space"].frames == 24
    ways = questions["frames of a group"].ways
    assert [item.way for item in ways if not item.chosen] == ["24"]


def test_a_file_keeps_its_alternatives_and_decodes_to_the_same_without_them() -> None:
    report, plain = pdecodec.encode(waves(), why=True), pdecodec.encode(waves())
    with pdecodec.open(report.data or b"") as animation, pdecodec.open(plain.data or b"") as other:
        assert from_json(animation.info()["alternatives"]) == report.alternatives
        assert np.array_equal(animation.read_frames(0, 24), other.read_frames(0, 24))
        assert other.info()["alternatives"] is None
    assert plain.alternatives == ()
    different = {name for name, size in report.sections.items() if size != plain.sections[name]}
    assert different <= {"META", "container"}


def test_alternatives_that_a_file_does_not_keep_are_computed_from_its_decoded_frames(asked: EncodeReport) -> None:
    with pdecodec.open(pdecodec.encode(waves()).data or b"") as animation:
        found = alternatives_of(animation)
    for question, exact in zip(found, asked.alternatives, strict=True):
        assert question.what == exact.what
        assert taken(question) == pytest.approx(taken(exact), rel=0.3), question.what


def test_one_frame_leaves_nothing_to_choose() -> None:
    assert pdecodec.encode(waves(1), why=True).alternatives == ()


def test_under_the_papers_profile_a_bound_leaves_the_step_to_choose() -> None:
    assert pdecodec.encode(waves(), profile="paper", why=True).alternatives == ()
    (question,) = pdecodec.encode(waves(), profile="paper", tolerance=1e-3, why=True).alternatives
    assert question.what == "step of coefficients"
    assert taken(question) == min(item.size for item in question.ways)


def test_runs_are_encoded_each_by_itself_and_nothing_else_is_tried() -> None:
    later = waves(3)
    later.times = later.times + 1.0
    for settings in ({"effort": "fast"}, {"profile": "paper"}):
        report = pdecodec.encode(ChangingSequence([waves(3), later]), why=True, **settings)
        assert report.alternatives == ()
    with pdecodec.open(report.data or b"") as animation, pytest.raises(InputError, match="several runs"):
        alternatives_of(animation)


def test_remarks_of_other_programs_are_no_record(asked: EncodeReport) -> None:
    assert from_json(json.loads(json.dumps(to_json(asked.alternatives)))) == asked.alternatives
    for other in (None, 3, "x", [1], [{"what": "x"}], [{"what": "x", "frames": "many", "ways": []}], {"a": 1}):
        assert from_json(other) == ()


def test_encode_and_info_show_why(tmp_path: Path, capsys: Capture) -> None:
    source, target, plain = (str(tmp_path / name) for name in ("a.npz", "a.pdeanim", "b.pdeanim"))
    write_sequence(waves(8), source)
    assert run(["encode", source, "-o", target, "--why"]) == 0
    assert "step of coefficients, 8 frames: " in capsys.readouterr().err
    assert run(["info", target, "--why"]) == 0
    shown = capsys.readouterr()
    assert "instead of" in shown.out
    assert "note" not in shown.err
    assert run(["encode", source, "-o", plain]) == 0
    capsys.readouterr()
    assert run(["info", plain, "--why", "--json"]) == 0
    shown = capsys.readouterr()
    assert json.loads(shown.out)["alternatives"][0]["what"] == "functions of time"
    assert "from encoding it again" in shown.err
    assert run(["info", source, "--why"]) == 2
    assert "--why needs a .pdeanim file" in capsys.readouterr().err


def test_the_report_has_a_row_for_each_way(asked: EncodeReport) -> None:
    table = alternatives_figure(asked.alternatives, 1e-3).table
    assert len(table.rows) == sum(len(question.ways) for question in asked.alternatives)
    assert sum(bool(value) for value in table.column("taken")) == len(asked.alternatives)
