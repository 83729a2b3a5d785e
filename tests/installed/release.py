"""Every file of a release works by itself: `make test-release` after `make release`.

The lines of `dist/INSTALL.md` (docs/install.md) run as they stand there, in an environment of their own, in a folder
that holds the files of `dist/` and no checkout. Then what they made is compared with the installed package.
"""

from __future__ import annotations

import json
import os
import re
import shlex
import shutil
import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from spec.vector_files import MANIFEST, read_manifest
from tests.support.driven_browser import browsing

ROOT = Path(__file__).resolve().parents[2]
DIST = ROOT / "dist"
PAGE = DIST / "INSTALL.md"

if not PAGE.exists():
    pytest.skip("dist/ has no release: make release", allow_module_level=True)

TEXT = PAGE.read_text(encoding="utf-8")

BETWEEN = 0.4371
"""A time between two frames of the clip [s]."""

POSITIONS = f"""
import json, pdecodec
with pdecodec.open("cloth.pdeanim") as animation:
    print(json.dumps([animation.positions(at).tolist() for at in (0, {BETWEEN}, animation.times[-1])]))
"""


class Place:
    """A folder with the files of a release, and a virtual environment without packages."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        shutil.copytree(DIST, folder)
        subprocess.run([sys.executable, "-m", "venv", folder / "venv"], check=True)
        kept = {name: value for name, value in os.environ.items() if not name.startswith(("PYTHON", "VIRTUAL_ENV"))}
        self.environment = {**kept, "PATH": f"{folder}/venv/bin:{folder}/bin:{kept['PATH']}"}

    def run(self, line: str, expected: int = 0) -> str:
        """Run a line in the shell; return what it prints."""
        done = subprocess.run(
            ["bash", "-ec", line],
            cwd=self.folder, env=self.environment, capture_output=True, text=True, timeout=1800, check=False,
        )  # fmt: skip
        assert done.returncode == expected, f"{line}\n{done.stdout}{done.stderr}"
        return done.stdout

    def python(self, code: str) -> str:
        (self.folder / "code.py").write_text(code, encoding="utf-8")
        return self.run("python code.py")

    def follow(self, title: str) -> list[str]:
        """Do what a part of the page says: write its files, run its Python and its lines; return what they print.

        A server runs forever, so it is left to the test.
        """
        part = TEXT.split(f"\n## {title}\n")[1].split("\n## ")[0]
        printed = list[str]()
        for name, language, code in re.findall(
            r"(?:`(\S+)`:\n\n)?```(\w+)\n(.*?)^```$", part, re.MULTILINE | re.DOTALL
        ):
            if name:
                (self.folder / name).write_text(code, encoding="utf-8")
            elif language == "python":
                printed.append(self.python(code))
            else:
                lines = [line.removeprefix("$ ") for line in code.splitlines()]
                assert len(lines) <= 5, "a part of the page has at most five lines"
                printed += [self.run(line) for line in lines if "http.server" not in line]
        return printed


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Place:
    """Return a place where the first part of the page has been followed."""
    place = Place(tmp_path_factory.mktemp("release") / "files")
    shape = place.follow("Encode, look, decode")[-1]
    assert shape == "24 (900, 3)\n"
    return place


@pytest.fixture(scope="module")
def positions(place: Place) -> np.ndarray:
    """Return the positions at the first frame, at a time between frames and at the last frame."""
    return np.array(json.loads(place.python(POSITIONS)))


def file_of(pattern: str) -> Path:
    """Return a file of the release; skip the test if there is none."""
    found = sorted(DIST.glob(pattern))
    if not found:
        pytest.skip(f"dist/ has no {pattern}: `make release` says why")
    return found[0]


def program(name: str) -> str:
    found = shutil.which(name)
    if found is None:
        pytest.skip(f"{name} is not here")
    return found


def test_the_page_lists_every_file_and_the_checksums_are_right() -> None:
    listed = [name for row in re.findall(r"^\| (`.*?`) \|", TEXT, re.MULTILINE) for name in re.findall(r"`(.*?)`", row)]
    patterns = [re.escape(name).replace("PLATFORM", r"[\w.-]+") for name in listed]
    files = sorted(path.name for path in DIST.iterdir() if path.is_file())
    assert [name for name in files if not any(re.fullmatch(pattern, name) for pattern in patterns)] == []
    sums = (DIST / "SHA256SUMS").read_text(encoding="utf-8")
    assert sorted(line.split()[1] for line in sums.splitlines()) == [name for name in files if name != "SHA256SUMS"]
    subprocess.run([program("sha256sum"), "--quiet", "--check", "SHA256SUMS"], cwd=DIST, check=True)


def test_the_wheel_encodes_shows_and_decodes(place: Place) -> None:
    where = place.run("cd / && python -c 'import pdecodec; print(pdecodec.__file__)'")
    assert where.startswith(str(place.folder / "venv"))
    place.run("pdecodec compare cloth.####.obj decoded.####.obj --tolerance 0.00101")
    assert re.search(r"^frames +24\b", place.run("pdecodec info cloth.pdeanim"), re.MULTILINE)
    with browsing(place.folder / "profile") as browser:
        browser.open((place.folder / "cloth.html").as_uri())
        wait_for_motion(browser)
        assert browser.errors() == []


def test_the_source_builds_and_encodes_the_same_bytes(place: Place, tmp_path: Path) -> None:
    program("c++")
    other = Place(tmp_path / "source")
    other.run(f"pip install --quiet ./{file_of('pdecodec-*.tar.gz').name}")
    other.run("pdecodec simulate cloth -o cloth.####.obj --columns 30 --rows 30 --frames 24")
    other.run("pdecodec encode cloth.####.obj -o cloth.pdeanim")
    assert (other.folder / "cloth.pdeanim").read_bytes() == (place.folder / "cloth.pdeanim").read_bytes()


def wait_for_motion(browser: Any) -> None:
    """Wait until two pictures of a page differ, each of which shows more than one colour."""
    first = None
    for _ in range(60):
        picture = browser.picture()
        if len(picture) > 8000:
            first = first or picture
            if picture != first:
                return
        time.sleep(0.5)
    pytest.fail("nothing moves on the page")


@contextmanager
def served(place: Place) -> Iterator[str]:
    """Serve the page's folder by the page's line, at a free port; yield the address."""
    (line,) = re.findall(r"^\$ (.*http\.server.*) 8000$", TEXT, re.MULTILINE)
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    server = subprocess.Popen(
        ["bash", "-c", f"exec {line} {port}"], cwd=place.folder, env=place.environment, stderr=subprocess.DEVNULL
    )
    try:
        address = f"http://127.0.0.1:{port}"
        for _ in range(100):
            try:
                urllib.request.urlopen(address).close()
                break
            except urllib.error.URLError:
                time.sleep(0.1)
        yield address
    finally:
        server.terminate()
        server.wait()


def test_the_npm_package_plays_on_a_page_and_decodes_in_node(place: Place, positions: np.ndarray) -> None:
    file_of("pdeanim-*.tgz")
    program("npm")
    place.follow("Show it on a web page")
    (place.folder / "decode.mjs").write_text(
        'import { readFile } from "node:fs/promises";\nimport { PdeAnimation } from "pdeanim";\n'
        'const clip = await PdeAnimation.open(await readFile("cloth.pdeanim"));\n'
        f"console.log(JSON.stringify([clip.start, {BETWEEN}, clip.end].map((time) => [...clip.positions(time)])));\n",
        encoding="utf-8",
    )
    found = np.array(json.loads(place.run("node decode.mjs"))).reshape(positions.shape)
    np.testing.assert_allclose(found, positions, rtol=0, atol=1e-6)
    with browsing(place.folder / "profile_of_page") as browser, served(place) as address:
        browser.open(address)
        wait_for_motion(browser)
        assert [error for error in browser.errors() if "favicon" not in error] == []


@pytest.mark.parametrize("compiler", ["c++", "clang++"])
def test_the_decoder_in_one_file_compiles_and_a_program_writes_the_frames(
    place: Place, positions: np.ndarray, compiler: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    compilers = place.folder / "bin"
    compilers.mkdir(exist_ok=True)
    (compilers / "c++").unlink(missing_ok=True)
    (compilers / "c++").symlink_to(program(compiler))
    for name in ("pdeanim.h", "pdeanim.cpp", "play.c", "LICENSE"):
        (place.folder / name).unlink(missing_ok=True)
    shutil.rmtree(place.folder / "frames", ignore_errors=True)
    place.follow("Use it in a C program")
    frames = sorted((place.folder / "frames").iterdir())
    assert len(frames) == 24
    for path, expected in ((frames[0], positions[0]), (frames[-1], positions[-1])):
        rows = [line.split()[1:] for line in path.read_text(encoding="utf-8").splitlines() if line.startswith("v ")]
        np.testing.assert_allclose(np.array(rows, float), expected, rtol=0, atol=1e-6)


SHOWN = f"""
import json
bpy.context.scene.frame_set(int({BETWEEN} * 24), subframe={BETWEEN} * 24 % 1)
cloth = next(thing for thing in bpy.context.scene.objects if thing.type == "MESH" and len(thing.data.vertices) == 900)
shown = cloth.evaluated_get(bpy.context.evaluated_depsgraph_get())
print("SHOWN", json.dumps([list(vertex.co) for vertex in shown.data.vertices]))
"""


def test_the_extension_plays_in_blender(place: Place, positions: np.ndarray) -> None:
    file_of("blender-pdecodec-*-linux-x64.zip")
    python = os.environ.get("PDECODEC_BLENDER")
    if python is None:
        pytest.skip("PDECODEC_BLENDER does not name a Python with bpy")
    blender = place.folder / "bin" / "blender"
    blender.parent.mkdir(exist_ok=True)
    # Stands in for the program, of which the package bpy is all but the command.
    code = f"import sys; exec(open(sys.argv[1]).read() + {SHOWN!r})"
    blender.write_text(f"#!/bin/sh\nexec '{python}' -c {shlex.quote(code)} \"$3\"\n", encoding="utf-8")
    blender.chmod(0o755)
    place.environment["BLENDER_USER_RESOURCES"] = str(place.folder / "blender")
    printed = "".join(place.follow("Play it in Blender"))
    assert (place.folder / "cloth.blend").exists()
    found = np.array(json.loads(printed.split("SHOWN ")[1].splitlines()[0]))
    np.testing.assert_allclose(found, positions[1], rtol=0, atol=1e-5)


def test_the_usd_plug_in_opens_the_clip(place: Place, positions: np.ndarray, tmp_path: Path) -> None:
    file_of("pdecodec_usd-*.whl")
    other = Place(tmp_path / "usd")
    shutil.copy(place.folder / "cloth.pdeanim", other.folder)
    assert "def Mesh" in "".join(other.follow("Open it in USD"))
    found = other.python(
        "import json\nfrom pxr import Usd, UsdGeom\nstage = Usd.Stage.Open('cloth.pdeanim')\n"
        "(mesh,) = [UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh)]\n"
        f"points = mesh.GetPointsAttr().Get({BETWEEN} * stage.GetTimeCodesPerSecond())\n"
        "print(json.dumps([list(point) for point in points]))"
    )
    np.testing.assert_allclose(np.array(json.loads(found)), positions[1], rtol=0, atol=1e-6)


def test_the_specification_has_every_section_on_its_pages(place: Place) -> None:
    file_of("pdeanim-format-*.pdf")
    place.run("pip install --quiet pypdf")
    pages = json.loads(
        place.python(
            "import json, glob, pypdf\n(path,) = glob.glob('*.pdf')\n"
            "print(json.dumps([page.extract_text() for page in pypdf.PdfReader(path).pages]))"
        )
    )
    assert len(pages) > 30
    assert min(map(len, pages)) > 100
    text = " ".join("".join(pages[2:]).split())
    for name in ("pdeanim.md", "rules.md", "extension/README.md"):
        headings = re.findall(r"^##+ (.*)", (ROOT / "spec" / name).read_text(encoding="utf-8"), re.MULTILINE)
        assert [heading for heading in headings if heading.replace("`", "") not in text] == []


def test_the_vectors_decode_as_their_manifest_says(place: Place) -> None:
    place.follow("Test a decoder of your own")
    vectors = place.folder / "vectors"
    assert (vectors / "manifest.json").read_bytes() == MANIFEST.read_bytes()
    manifest = read_manifest()
    for kind in ("accept", "reject"):
        assert {path.stem for path in (vectors / kind).iterdir()} == manifest[kind].keys()
    checked = json.loads(
        place.python(
            "import json, pathlib, pdecodec\nfound = {}\n"
            "manifest = json.loads(pathlib.Path('vectors/manifest.json').read_text('utf-8'))\n"
            "for name, entry in manifest['accept'].items():\n"
            "    if isinstance(entry['frames'], int):\n"
            "        with pdecodec.open(f'vectors/accept/{name}.pdeanim') as animation:\n"
            "            rows = entry['positions']\n"
            "            found[name] = [animation.positions(row[0])[row[1]].tolist() for row in rows]\n"
            "print(json.dumps(found))"
        )
    )
    assert len(checked) > 50
    for name, found in checked.items():
        expected = np.array([row[2:] for row in manifest["accept"][name]["positions"]])
        size = max(1.0, np.abs(expected).max())
        np.testing.assert_allclose(np.array(found), expected, rtol=0, atol=1e-5 * size, err_msg=name)
    refused = place.run("pdecodec check --deep vectors/reject/*.pdeanim || true")
    missing = [name for name in manifest["reject"] if f"reject/{name}.pdeanim" not in refused]
    assert missing == []
