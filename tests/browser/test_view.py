"""`pdecodec view`: one page that plays a file, in a headless browser that draws without a graphics card."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from pdecodec import ArraySequence, Connectivity, MeshObject, encode, open_animation
from pdecodec.cli.main import run
from pdecodec.formats import open_sequence
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
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    with browsing(tmp_path_factory.mktemp("profile")) as opened:
        opened.resize(1000, 640)
        yield opened


def written(*arguments: str | Path) -> None:
    assert run(["view", *map(str, arguments)]) == 0


def ready(browser: Browser, page: Path) -> None:
    browser.open(page.resolve().as_uri())
    browser.run("await pdeanimView.ready")
    assert browser.errors() == []
    assert browser.run("return document.getElementById('message').textContent") == ""


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
    browser: Browser, clip: tuple[Path, Path], tmp_path: Path
) -> None:
    source, coded = clip
    page = tmp_path / "page.html"
    written(coded, "--original", source, "-o", page)
    ready(browser, page)
    with open_animation(coded) as animation:
        extent = float(np.ptp(animation.positions(0.0), axis=0).max())
        for time in np.linspace(animation.times[0], animation.times[-1], 10):
            found = browser.run("return pdeanimView.readPositions(arguments_[0])", float(time))
            assert found["isOnGpu"]
            points = np.array(found["positions"], np.float64).reshape(-1, 3)
            scale = extent + np.abs(points).max()
            assert np.abs(points - animation.positions(float(time))).max() <= GPU_MARGIN * scale
    assert browser.errors() == []


@pytest.mark.data
def test_the_page_shows_how_far_the_original_is(browser: Browser, clip: tuple[Path, Path], tmp_path: Path) -> None:
    source, coded = clip
    page = tmp_path / "page.html"
    written(coded, "--original", source, "-o", page)
    ready(browser, page)
    browser.run("pdeanimView.pause(); while (!pdeanimView.errors.isDone) pdeanimView.errors.step()")
    most, worst = browser.run("const { most, worst } = pdeanimView.errors; return [[...most], worst]")
    with open_animation(coded) as animation, open_sequence(source) as original:
        expected = np.linalg.norm(
            original.read_frames(0, FRAMES).astype(np.float64) - animation.read_frames(0, FRAMES), axis=2
        )
    assert np.abs(np.array(most) - expected.max(axis=1)).max() <= 1e-3 * expected.max()
    assert expected[worst["frame"], worst["vertex"]] == pytest.approx(expected.max(), rel=1e-3)
    browser.run("document.getElementById('go').click()")
    assert browser.run("return pdeanimView.time === pdeanimView.animation.times[arguments_[0]]", worst["frame"])
    assert not browser.run("return document.getElementById('mark').hidden")
    keep_picture(browser, coded.stem)
    assert browser.errors() == []


def keep_picture(browser: Browser, name: str) -> None:
    """Save a picture if PDECODEC_PICTURES names a folder; the README shows one."""
    shown = browser.picture()
    assert len(shown) > 10_000, "a picture of something"
    if "PDECODEC_PICTURES" in os.environ:
        (Path(os.environ["PDECODEC_PICTURES"]) / f"{name}.png").write_bytes(shown)


def test_a_page_needs_nothing_but_itself(waves: tuple[Path, Path], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    written(waves[0], "-o", page)
    text = page.read_text("utf-8")
    assert not re.search(r"(src|href)\s*=", text)
    assert not re.search(r"https?://(?!www\.w3\.org/2000/svg)", text)


def test_keys_play_step_and_choose(browser: Browser, waves: tuple[Path, Path], tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    written(waves[0], "-o", page)
    ready(browser, page)
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
    assert browser.errors() == []


def test_two_files_are_shown_side_by_side_and_over_each_other(
    browser: Browser, waves: tuple[Path, Path], tmp_path: Path
) -> None:
    page = tmp_path / "page.html"
    written(*waves, "-o", page)
    ready(browser, page)
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
    assert browser.errors() == []


def test_a_file_whose_faces_change_plays_run_by_run(browser: Browser, tmp_path: Path) -> None:
    page = tmp_path / "page.html"
    written(accepted_files()["runs"], "-o", page)
    ready(browser, page)
    with open_animation(accepted_files()["runs"]) as animation:
        for time in animation.times:
            found = browser.run("return pdeanimView.readPositions(arguments_[0]).positions", float(time))
            expected = animation.positions(float(time))
            assert np.abs(np.array(found).reshape(-1, 3) - expected).max() <= GPU_MARGIN * (1 + np.abs(expected).max())
    assert browser.errors() == []


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
