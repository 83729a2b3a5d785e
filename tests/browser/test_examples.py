"""The pages of `examples/web`, built by the bundlers of web applications, look like the original."""

from __future__ import annotations

import base64
import re
import shutil
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from pdecodec.cli.main import run as pdecodec_run
from pdecodec.formats import write_sequence
from spec.extension.make_example import example
from tests.support.browser_tools import bundle, node_module, node_modules
from tests.support.driven_browser import Browser, browsing
from tests.support.remote_server import serving

EXAMPLES = Path(__file__).resolve().parents[2] / "examples" / "web"

EXTERNAL = """
<script type="importmap">
{ "imports": {
    "three": "/node_modules/three/build/three.module.js", "three/addons/": "/node_modules/three/examples/jsm/" } }
</script>
"""

COMPARE = """
const [width, height, ...pictures] = arguments_;
const shown = await Promise.all(pictures.map(async (text) => {
  const image = await createImageBitmap(await (await fetch(`data:image/png;base64,${text}`)).blob());
  const context = new OffscreenCanvas(width, height).getContext("2d");
  context.drawImage(image, 0, 0);
  return context.getImageData(0, 0, width, height).data;
}));
return shown[0].filter((value, k) => Math.abs(value - shown[1][k]) > 24).length / shown[0].length;
"""
"""Returns the share of colour values that differ visibly between two pictures."""

SIZE = 320, 240
MOMENT = 0.5

LIMIT = 2e-3
"""Largest share of colour values that may differ: edges move by a tenth of a pixel."""

MIN_PICTURE_BYTES = 1500
"""Fewer bytes [PNG] show a background alone."""

PATIENCE = 20
"""Time limit of a picture [s]."""


@dataclass(frozen=True)
class Stage:
    """A served folder, its address, and a browser that shows it."""

    folder: Path
    address: str
    browser: Browser

    def differ(self, first: bytes, second: bytes) -> float:
        pictures = (base64.b64encode(picture).decode() for picture in (first, second))
        found: float = self.browser.run(COMPARE, *SIZE, *pictures)
        return found

    def picture(self, page: str, moment: float = MOMENT) -> bytes:
        """Return the picture of a page as soon as it stands still and shows more than a background."""
        self.browser.open(f"{self.address}/{page}?time={moment}")
        before, end = b"", time.monotonic() + PATIENCE
        while time.monotonic() < end:
            now = self.browser.picture()
            if now == before and len(now) > MIN_PICTURE_BYTES:
                break
            before = now
            time.sleep(0.1)
        assert [error for error in self.browser.errors() if "favicon" not in error] == []
        return now


@pytest.fixture(scope="module")
def stage(packed_player: Path, three: Path, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stage]:
    folder: Path = tmp_path_factory.mktemp("examples")
    shutil.copytree(packed_player, folder / "node_modules" / "pdeanim")
    for name in ("three", "@babylonjs"):
        if (node_modules() / name).is_dir():
            (folder / "node_modules" / name).symlink_to(node_modules() / name)
    with serving(folder) as server, browsing(tmp_path_factory.mktemp("profile")) as browser:
        browser.resize(*SIZE)
        yield Stage(folder, server.address, browser)


def build(stage: Stage, name: str, bundler: str) -> Path:
    """Build a page for itself, with three.js outside; return its folder."""
    folder = stage.folder / f"{name}-{bundler}"
    shutil.copytree(EXAMPLES / name, folder / name)
    shutil.copy(EXAMPLES / "clip.glb", folder)
    page = (folder / name / "index.html").read_text().replace('src="main.js"', 'src="built/main.js"')
    (folder / name / "index.html").write_text(page.replace("<script", f"{EXTERNAL}<script"))
    bundle(folder / name, bundler)
    if bundler in ("esbuild", "rollup"):  # these leave addresses as they are
        shutil.copy(EXAMPLES / "clip.glb", folder / name)
        shutil.copy(stage.folder / "node_modules" / "pdeanim" / "pdeanim.wasm", folder / name / "built")
    else:
        assert len(list(folder.glob(f"{name}/built/**/*.wasm"))) == 1
    return folder


@pytest.fixture(scope="module")
def original(stage: Stage, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the clip of the pages with morph targets."""
    path: Path = tmp_path_factory.mktemp("original") / "clip.glb"
    write_sequence(example(), path)
    return path


@pytest.fixture(scope="module")
def expected(stage: Stage, original: Path) -> bytes:
    """Return what the page of three.js shows of the original."""
    folder = build(stage, "three", "esbuild")
    copied = shutil.copytree(folder, stage.folder / "original")
    shutil.copy(original, copied / "three")
    return stage.picture("original/three/index.html")


SLOW = pytest.mark.long
"""On a machine that does other things, these take more than five seconds."""


@pytest.mark.parametrize(
    "bundler", ["esbuild", "vite", pytest.param("webpack", marks=SLOW), pytest.param("rollup", marks=SLOW)]
)
def test_the_page_of_three_s_looks_like_the_original(stage: Stage, expected: bytes, bundler: str) -> None:
    folder = stage.folder / "three-esbuild" if bundler == "esbuild" else build(stage, "three", bundler)
    shown = stage.picture(f"{folder.name}/three/index.html")
    assert stage.differ(shown, expected) < LIMIT
    if bundler == "esbuild":
        assert stage.differ(stage.picture(f"{folder.name}/three/index.html", 0.1), expected) > 2 * LIMIT


def test_the_page_without_a_bundler_looks_like_the_original(stage: Stage, original: Path) -> None:
    for name, clip in (("plain", EXAMPLES / "clip.glb"), ("plain-original", original)):
        shutil.copytree(EXAMPLES / "plain", stage.folder / name / "plain")
        (stage.folder / name / "plain" / "node_modules").symlink_to(stage.folder / "node_modules")
        shutil.copy(clip, stage.folder / name)
    shown, other = (stage.picture(f"{name}/plain/index.html") for name in ("plain", "plain-original"))
    assert stage.differ(shown, other) < LIMIT


def test_the_page_of_babylon_s_looks_like_the_original(stage: Stage, original: Path) -> None:
    node_module("@babylonjs")
    folder = build(stage, "babylon", "esbuild")
    copied = shutil.copytree(folder, stage.folder / "babylon-original")
    shutil.copy(original, copied / "babylon")
    shown, other = (stage.picture(f"{one.name}/babylon/index.html") for one in (folder, copied))
    assert stage.differ(shown, other) < LIMIT


@SLOW
def test_the_page_of_the_tutorial_moves(stage: Stage, monkeypatch: pytest.MonkeyPatch) -> None:
    text = (EXAMPLES.parents[1] / "docs" / "tutorials" / "web-page.md").read_text("utf-8")
    folder = stage.folder / "tutorial"
    folder.mkdir()
    monkeypatch.chdir(folder)
    for command in re.findall(r"^\$ pdecodec (.*)", text, re.MULTILINE):
        assert pdecodec_run(command.split()) == 0
    (folder / "node_modules").symlink_to(stage.folder / "node_modules")
    page = text.split("```html\n")[1].split("```")[0]
    for moment in ("0", "0.9"):
        assert "milliseconds / 1000" in page
        (folder / f"at-{moment}.html").write_text(page.replace("milliseconds / 1000", moment), "utf-8")
    assert stage.differ(stage.picture("tutorial/at-0.html"), stage.picture("tutorial/at-0.9.html")) > 0.05


def test_the_pages_are_short() -> None:
    pages = [path for folder in EXAMPLES.iterdir() if folder.is_dir() for path in folder.iterdir() if path.is_file()]
    assert {len(path.read_text("utf-8").splitlines()) >= 41 for path in pages} == {False}
