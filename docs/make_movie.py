"""Make the moving picture of the README: a simulated cloth next to the same cloth decoded from its `.pdeanim` file.

``python -m docs.make_movie docs/cloth.webp``, in the root of the repository; needs Chromium and chromedriver.
"""

from __future__ import annotations

import base64
import io
import subprocess
import sys
import tempfile
from pathlib import Path

from PIL import Image, ImageDraw, ImageFont

from tests.support.driven_browser import Browser, browsing

SIMULATED = ("simulate", "cloth", "--drape", "sphere", "--columns", "100", "--rows", "100", "--frames")

FRAMES = 72
"""Number of frames of the clip, at 24 frames per second."""

PANEL_SIZE = (400, 310)
"""Size of each of the two pictures [pixels]."""

CAPTION_HEIGHT = 34
"""Height of the line below them [pixels]."""

FRAME_STEP = 2
"""Frames of the clip to a picture; at 24 frames per second, 12 pictures a second play at real speed."""

CAMERA_DISTANCE = 0.86
"""Distance of the camera, relative to the page's first view."""

DRAW = """
const page = pdeanimView, choose = document.getElementById("compare");
page.pause();
page.time = page.animation.times[arguments_[0]];
choose.value = arguments_[1];
choose.dispatchEvent(new Event("change"));
page.gl.finish();
return page.gl.canvas.toDataURL();
"""


def draw(browser: Browser, frame: int, view: str) -> Image.Image:
    """Return the picture of one clip at a frame: `view` is `a` for the decoded one, `b` for the original."""
    text = browser.run(DRAW, frame, view).split(",")[1]
    return Image.open(io.BytesIO(base64.b64decode(text))).convert("RGB").resize(PANEL_SIZE, Image.Resampling.LANCZOS)


def size_text(size: int) -> str:
    """Return a file's size in words."""
    return f"{size / 1e6:.1f} MB" if size >= 1e6 else f"{size / 1e3:.0f} kB"


def main(path: Path) -> None:
    """Simulate, encode, and film the page of `pdecodec view` with both clips."""
    with tempfile.TemporaryDirectory() as name:
        source, coded, page = (Path(name) / f"cloth.{kind}" for kind in ("abc", "pdeanim", "html"))
        for arguments in (
            [*SIMULATED, str(FRAMES), "-o", str(source)],
            ["encode", str(source), "-o", str(coded)],
            ["view", str(coded), "--original", str(source), "-o", str(page)],
        ):
            subprocess.run([sys.executable, "-m", "pdecodec", *arguments], check=True)
        sizes = [file.stat().st_size for file in (source, coded)]
        captions = [f"original, Alembic: {size_text(sizes[0])}"]
        captions += [f"decoded, .pdeanim: {size_text(sizes[1])}, {sizes[0] / sizes[1]:.0f} times smaller"]
        font = ImageFont.load_default(16)
        pictures = []
        with browsing(Path(name) / "profile") as browser:
            browser.resize(1100, 760)
            browser.open(page.as_uri())
            browser.run("while (!globalThis.pdeanimView?.second) await new Promise((next) => setTimeout(next, 50));")
            browser.run("pdeanimView.camera.distance *= arguments_[0]", CAMERA_DISTANCE)
            for frame in range(0, FRAMES, FRAME_STEP):
                picture = Image.new("RGB", (2 * PANEL_SIZE[0], PANEL_SIZE[1] + CAPTION_HEIGHT), "white")
                for place, view in enumerate("ba"):
                    picture.paste(draw(browser, frame, view), (place * PANEL_SIZE[0], 0))
                    middle = (place * PANEL_SIZE[0] + PANEL_SIZE[0] // 2, PANEL_SIZE[1] + CAPTION_HEIGHT // 2)
                    ImageDraw.Draw(picture).text(middle, captions[place], "black", font, "mm")
                pictures.append(picture)
        pictures[0].save(
            path,
            save_all=True,
            append_images=pictures[1:],
            duration=1000 * FRAME_STEP // 24,
            loop=0,
            quality=70,
            method=6,
        )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
