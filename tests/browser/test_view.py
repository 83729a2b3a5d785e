"""`pdecodec view`: one page that plays a file, in a headless browser that draws without a graphics card."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import pytest

from pdecodec import ArraySequence, Connectivity, Field, MeshObject, encode, open_animation
from pdecodec.cli.main import run
from pdecodec.formats import open_sequence, write_sequence
from spec.vector_files import accepted_files
from tests.support.driven_browser import Browser, browsing

CLIPS = {"cloth": "pypbd_cloth100_xpbd", "character": "pdance", "rope": "rope24x832"}
FRAMES = 40
"""Frames per clip: enough for motion, few enough to be encoded in seconds."""

GROUP_FRAMES = 18
"""Frames per group: so few that there are borders between groups, where two groups contribute."""

GPU_MARGIN = 4e-6
"""Largest rounding error of sums of some fifty products in float32, as a fraction of the extent."""


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browsing(tmp_path_factory.mktemp("profile")) as browser:
        browser.resize(1000, 640)
        yield browser


@pytest.fixture
def show(opened: Browser, tmp_path: Path) -> Iterator[Callable[..., Browser]]:
    """Return a function that shows the page that ``view`` writes of its arguments; there must be no errors."""

    def show(*arguments: str | Path) -> Browser:
        page = tmp_path / "page.html"
        assert run(["view", *map(str, arguments), "-o", str(page)]) == 0
        opened.open(page.resolve().as_uri())
        opened.run("await pdeanimView.ready")
        assert opened.run("return document.getElementById('message').textContent") == ""
        return opened

    yield show
    assert opened.errors() == []


@pytest.fixture(scope="module", params=CLIPS)
def clip(
    request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory
) -> tuple[Path, Path]:
    """Return a part of a real clip, and its file with several groups of frames."""
    folder: Path = tmp_path_factory.mktemp(request.param)
    source, coded = folder / "source.npz", folder / f"{request.param}.pdeanim"
    with np.load(shared_data / "sequences" / f"{CLIPS[request.param]}.npz") as whole:
        part = {"points": whole["points"][:FRAMES], "times": whole["times"][:FRAMES], "faces": whole["faces"]}
    np.savez(source, **part)
    with open_sequence(source) as sequence:
        encode(sequence, coded, tolerance=1e-3, effort="fast", group_frames=GROUP_FRAMES)
    return source, coded


@pytest.fixture(scope="module")
def waves(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """Return a small clip of two objects, encoded at two bounds."""
    folder: Path = tmp_path_factory.mktemp("waves")
    fine, coarse = folder / "fine.pdeanim", folder / "coarse.pdeanim"
    for path, tolerance in ((fine, 1e-5), (coarse, 3e-2)):
        encode(two_sheets(), path, tolerance=tolerance)
    return fine, coarse


def two_sheets() -> ArraySequence:
    side, time = np.linspace(0, 1, 12), np.arange(30) / 24
    x, z = (part.ravel() for part in np.meshgrid(side, side))
    points = np.zeros((30, 288, 3), np.float32)
    for k in range(2):
        height = 0.2 * np.sin(5 * x + (3 + k) * time[:, None]) * np.cos(3 * z)
        points[:, 144 * k : 144 * (k + 1)] = np.stack([x + 1.2 * k + 0 * height, height, z + 0 * height], axis=2)
    corner = (np.arange(11)[:, None] * 12 + np.arange(11)).ravel()
    faces = np.stack([corner, corner + 1, corner + 13, corner + 12], axis=1)
    part = Connectivity.from_padded(144, faces)
    objects = [MeshObject("left", part), MeshObject("right <b>", part)]
    return ArraySequence(points, objects=objects, times=time)


@pytest.mark.data
def test_the_graphics_processor_has_the_positions_that_the_library_has(
    show: Callable[..., Browser], clip: tuple[Path, Path]
) -> None:
    source, coded = clip
    browser = show(coded, "--original", source)
    with open_animation(coded) as animation:
        extent = float(np.ptp(animation.positions(0.0), axis=0).max())
        for time in np.linspace(animation.times[0], animation.times[-1], 10):
            found = browser.run("return pdeanimView.readPositions(arguments_[0])", float(time))
            assert found["isOnGpu"]
            points = np.array(found["positions"], np.float64).reshape(-1, 3)
            scale = extent + np.abs(points).max()
            assert np.abs(points - animation.positions(float(time))).max() <= GPU_MARGIN * scale


@pytest.mark.data
def test_the_page_shows_how_far_the_original_is(show: Callable[..., Browser], clip: tuple[Path, Path]) -> None:
    source, coded = clip
    browser = show(coded, "--original", source)
    browser.run("pdeanimView.pause(); while (!pdeanimView.errors.isDone) pdeanimView.errors.step()")
    most, worst = browser.run("const { most, worst } = pdeanimView.errors; return [[...most], worst]")
    with open_animation(coded) as animation, open_sequence(source) as original:
        expected = np.linalg.norm(
            original.read_frames(0, FRAMES).astype(np.float64) - animation.read_frames(0, FRAMES), axis=2
        )
    assert np.abs(np.array(most) - expected.max(axis=1)).max() <= 1e-3 * expected.max()
    assert expected[worst["frame"], worst["element"]] == pytest.approx(expected.max(), rel=1e-3)
    browser.run("document.getElementById('go').click()")
    assert browser.run("return pdeanimView.time === pdeanimView.animation.times[arguments_[0]]", worst["frame"])
    assert not browser.run("return document.getElementById('mark').hidden")
    keep_picture(browser, coded.stem)


def keep_picture(browser: Browser, name: str) -> None:
    """Save a picture if PDECODEC_PICTURES names a folder; the README shows one."""
    shown = browser.picture()
    assert len(shown) > 10_000, "a picture of something"
    if "PDECODEC_PICTURES" in os.environ:
        (Path(os.environ["PDECODEC_PICTURES"]) / f"{name}.png").write_bytes(shown)


def test_a_page_needs_nothing_but_itself(waves: tuple[Path, Path], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    assert run(["view", str(waves[0]), "-o", str(page)]) == 0
    text = page.read_text("utf-8")
    assert not re.search(r"(src|href)\s*=", text)
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)


def test_keys_play_step_and_choose(show: Callable[..., Browser], waves: tuple[Path, Path]) -> None:
    browser = show(waves[0])
    state = "const { time, isPlaying, object } = pdeanimView; return [time, isPlaying, object]"
    press = "document.dispatchEvent(new KeyboardEvent('keydown', { key: arguments_[0] }));"
    browser.run(press, "Home")
    assert browser.run(state) == [0, False, None]
    browser.run(press, "ArrowRight")
    assert browser.run(state)[0] == pytest.approx(1 / 24)
    browser.run(press + press, "o")
    assert browser.run(state)[2] == 1
    names = "return [...document.getElementById('object').options].map((option) => option.text)"
    assert browser.run(names) == ["all", "left", "right <b>"]
    for key, what, chosen in (
        *(("s", "shading", name) for name in ("flat", "edges", "wireframe", "smooth")),
        ("c", "colour", "patches"),
        ("]", "speed", "2"),
        ("[", "speed", "1"),
        ("[", "speed", "0.5"),
    ):
        browser.run(press, key)
        assert browser.run("return document.getElementById(arguments_[0]).value", what) == chosen
    distance = browser.run("return pdeanimView.camera.distance")
    browser.run("pdeanimView.camera.distance *= 9; " + press, "f")
    assert browser.run("return pdeanimView.camera.distance") == pytest.approx(distance)
    browser.run(press, " ")
    assert browser.run(state)[1]


def test_two_files_are_shown_side_by_side_and_over_each_other(
    show: Callable[..., Browser], waves: tuple[Path, Path]
) -> None:
    browser = show(*waves)
    browser.run(
        "pdeanimView.pause(); pdeanimView.seek(0.51); while (!pdeanimView.errors.isDone) pdeanimView.errors.step()"
    )
    pictures = set()
    for view in ("side", "a", "b", "over", "change"):
        browser.run(
            "const view = document.getElementById('compare'); view.value = arguments_[0]; view.onchange()", view
        )
        pictures.add(browser.picture())
    assert len(pictures) == 5
    with open_animation(waves[0]) as fine, open_animation(waves[1]) as coarse:
        expected = np.linalg.norm(fine.positions(0.51).astype(np.float64) - coarse.positions(0.51), axis=1)
    found = browser.run("return pdeanimView.worstVertexNow()")
    assert found["value"] == pytest.approx(expected.max(), rel=1e-4)


def test_a_file_whose_faces_change_plays_run_by_run(show: Callable[..., Browser]) -> None:
    browser = show(accepted_files()["runs"])
    with open_animation(accepted_files()["runs"]) as animation:
        for time in animation.times:
            found = browser.run("return pdeanimView.readPositions(arguments_[0]).positions", float(time))
            expected = animation.positions(float(time))
            assert np.abs(np.array(found).reshape(-1, 3) - expected).max() <= GPU_MARGIN * (1 + np.abs(expected).max())


SHADES = {"low": (0x44, 0x01, 0x54), "high": (0xFD, 0xE7, 0x25), "cold": (0x3B, 0x4C, 0xC0), "grey": (0xDD, 0xDD, 0xDD)}
"""Ends of viridis; the cold end and the middle of the diverging map."""

LOOK_ALONG_Z = "const v = pdeanimView; v.pause(); Object.assign(v.camera, { yaw: 0, pitch: 0 }); v.fit();"

CHOOSE = """
    const e = document.getElementById("colour");
    e.value = [...e.options].find((option) => option.text === arguments_[0]).value;
    e.onchange();
"""

PIXEL = """
    const { gl } = v, { width, height } = gl.canvas, [x, y] = v.camera.projector(width / height)(arguments_[1]);
    const found = new Uint8Array(4);
    gl.readPixels(Math.round(x * width), Math.round((1 - y) * height), 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, found);
    return [...found].slice(0, 3);
"""

UNDER = """
    const canvas = document.getElementById("canvas"), { left, top, width, height } = canvas.getBoundingClientRect();
    canvas.setPointerCapture = () => {};
    const [x, y] = v.camera.projector(width / height)(arguments_[1]);
    const place = { clientX: left + x * width, clientY: top + y * height, pointerId: 1 };
    for (const type of ["pointerdown", "pointerup"]) canvas.dispatchEvent(new PointerEvent(type, place));
    while (v.history && !v.history.isDone) v.history.step();
    const under = document.getElementById("under");
    const lines = under.hidden ? null : [...under.children].map((line) => line.textContent);
    return [lines, v.history && v.history.series.map((own) => [...own.values].map(String))];
"""


def three_squares() -> ArraySequence:
    """Return three squares in a row in the xy plane, two objects, with fields of every domain."""
    part = [
        Connectivity.from_padded(2 * n + 2, np.array([[2 * k, 2 * k + 2, 2 * k + 3, 2 * k + 1] for k in range(n)]))
        for n in (2, 1)
    ]
    points = np.array([[x, y, 0] for x in (0, 1, 2, 2, 3) for y in (0, 1)], np.float32)
    time = np.arange(6)
    heat = np.linspace(300, 400, 10) + 0 * time[:, None]
    stress = np.array([-5.0, np.nan, 8.0]) * (1 + time[:, None]) / 6
    corner = np.tile(np.array([0.0] * 4 + [1.0] * 4), (6, 1))
    fields = [
        (Field("heat", "vertex", unit="K"), heat.astype(np.float32)),
        (Field("stress <i>", "face", unit="Pa"), stress.astype(np.float32)),
        (Field("paint", "corner", objects=(0,)), corner.astype(np.float32)),
        (Field("is on", "object", bool), np.array([[False, True]] * 6)),
        (Field("flow", "vertex", components=2), np.stack([3 + 0 * heat, 4 + 0 * heat], axis=2).astype(np.float32)),
    ]  # fmt: skip
    objects = [MeshObject("two", part[0]), MeshObject("one", part[1])]
    return ArraySequence(np.tile(points, (6, 1, 1)), objects=objects, times=time / 2, fields=fields)


def test_colours_stand_for_values_of_a_field(show: Callable[..., Browser], tmp_path: Path) -> None:
    coded = tmp_path / "squares.pdeanim"
    encode(three_squares(), coded)
    browser = show(coded)
    names = "return [...document.getElementById('colour').options].map((option) => option.text)"
    choices = ["heat", "stress <i>", "paint", "is on", "flow, magnitude", "flow x", "flow y"]
    assert browser.run(names) == ["one colour", "by patch or curve", *choices]
    middles = [[0.5, 0.5, 0], [1.5, 0.5, 0], [2.5, 0.5, 0]]
    missing = browser.run("return pdeanimView.look.missing.map((part) => 255 * part)")
    for name, shades in {
        "stress <i>": (None, missing, None),
        "paint": (SHADES["low"], SHADES["high"], missing),
        "is on": (SHADES["low"], SHADES["low"], SHADES["high"]),
    }.items():
        for middle, shade in zip(middles, shades, strict=True):
            found = browser.run(LOOK_ALONG_Z + CHOOSE + PIXEL, name, middle)
            assert shade is None or np.abs(np.subtract(found, shade)).max() <= 2, (name, middle)
    browser.run(LOOK_ALONG_Z + CHOOSE + "v.seek(2.5)", "stress <i>")
    legend = browser.run("return document.getElementById('legend').textContent")
    assert legend == "stress <i> [Pa]-808"
    ends = [browser.run(LOOK_ALONG_Z + CHOOSE + PIXEL, "stress <i>", middle) for middle in middles]
    assert ends[0][2] > ends[0][0], "below zero is blue"
    assert ends[2][0] > ends[2][2], "above zero is red"
    assert browser.run("return document.getElementById('none').hidden") is False


def test_fields_of_cells_are_not_offered(show: Callable[..., Browser]) -> None:
    browser = show(accepted_files()["solids"])
    names = "return [...document.getElementById('colour').options].map((option) => option.text)"
    assert browser.run(names) == ["one colour", "by patch or curve"]
    assert browser.run("return pdeanimView.animation.fieldList.map(({ domain }) => domain)") == ["cells"]
    assert browser.run("return pdeanimView.animation.attributes(0).map(({ domain }) => domain)") == ["cells"]


def test_the_value_under_the_pointer_is_that_of_the_library(show: Callable[..., Browser], tmp_path: Path) -> None:
    source, coded = tmp_path / "squares.npz", tmp_path / "squares.pdeanim"
    write_sequence(three_squares(), source)
    encode(three_squares(), coded, field_tolerance=1e-2)
    browser = show(coded, "--original", source)
    with open_animation(coded) as animation, open_sequence(source) as original:
        for name, place, element, row in (
            ("heat", [0.9, 0.1, 0], "vertex 2 of two", 2),
            ("stress <i>", [2.5, 0.4, 0], "face 0 of one", 2),
            ("paint", [1.9, 0.9, 0], "corner 6 of two", 6),
            ("is on", [2.5, 0.5, 0], "one", 1),
        ):
            lines, history = browser.run(LOOK_ALONG_Z + CHOOSE + "v.seek(1);" + UNDER, name, place)
            assert lines[-1] == element
            decoded, given = (one.read_field(name, 0, 6)[:, row].astype(float) for one in (animation, original))
            assert float(lines[0].removeprefix(f"{name}: ").split()[0]) == pytest.approx(decoded[2], rel=1e-3)
            error = float(lines[1].removeprefix("error: ").split()[0])
            assert error == pytest.approx(abs(decoded[2] - given[2]), rel=1e-2, abs=1e-4)
            ours = np.array(history, float)
            np.testing.assert_allclose(ours[1], decoded)
            np.testing.assert_allclose(ours[0], given, atol=1e-4 * np.abs(given).max())
            browser.run("while (!pdeanimView.errors.isDone) pdeanimView.errors.step()")
            apart = np.abs(animation.read_field(name, 0, 6).astype(float) - original.read_field(name, 0, 6))
            worst = browser.run("return pdeanimView.errors.worst.value")
            assert worst == pytest.approx(np.nanmax(apart), rel=1e-3, abs=1e-6)
        browser.run(LOOK_ALONG_Z + CHOOSE, "flow, magnitude")
        lines, _ = browser.run(LOOK_ALONG_Z + CHOOSE + UNDER, "flow, magnitude", [0.1, 0.1, 0])
        assert lines[:2] == ["flow, magnitude: 5", "x 3, y 4"]
        assert browser.run(LOOK_ALONG_Z + CHOOSE + UNDER, "heat", [5.0, 5.0, 0]) == [None, None]


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["a.pdeanim", "b.pdeanim", "--original", "c.npz"], 2, "not both"),
        (["a.pdeanim", "-o", "page.png"], 2, "extension .html"),
        (["none.pdeanim"], 3, "none.pdeanim"),
        (["clip.h5"], 4, "not a .pdeanim file (its first bytes differ); pdecodec encode makes one"),
    ],
)
def test_a_file_that_cannot_be_shown_is_reported_in_one_line(
    arguments: list[str],
    code: int,
    message: str,
    capsys: pytest.CaptureFixture[str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("clip.h5").write_bytes(b"frames of another format")
    Path("clip.html").write_text("a page")
    assert run(["view", *arguments]) == code
    assert message in capsys.readouterr().err
    assert [path.name for path in tmp_path.glob("*.html")] == ["clip.html"]


def test_an_original_of_other_frames_is_refused(
    waves: tuple[Path, Path], capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    whole = two_sheets()
    np.savez(tmp_path / "short.npz", points=whole.read_frames(0, 7), times=whole.times[:7])
    assert run(["view", str(waves[0]), "--original", str(tmp_path / "short.npz"), "-o", str(tmp_path / "p.html")]) == 3
    assert "has 7 frames, the .pdeanim file 30" in capsys.readouterr().err


def test_an_original_is_read_with_the_options_it_was_encoded_with(tmp_path: Path) -> None:
    whole = two_sheets()
    np.savez(tmp_path / "whole.npz", points=whole.read_frames(0, 7), times=whole.times[:7])
    coded, page = str(tmp_path / "coded.pdeanim"), str(tmp_path / "page.html")
    chosen = ["--frames", "2:6", "--scale", "3", "--fps", "12"]
    assert run(["encode", str(tmp_path / "whole.npz"), coded, *chosen]) == 0
    assert run(["view", coded, "--original", str(tmp_path / "whole.npz"), *chosen, "-o", page]) == 0
    assert run(["view", coded, *chosen, "-y", "-o", page]) == 2
