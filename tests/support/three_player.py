"""Play glTF files with three.js in headless Chromium; tests are skipped if one is missing, and name it."""

from __future__ import annotations

import shutil
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pdecodec.mesh.arrays import Float32Array
from tests.support.browser_tools import BROWSER, node_module
from tests.support.driven_browser import browsing
from tests.support.remote_server import serving


@dataclass(frozen=True, eq=False)
class PlayedMesh:
    """A primitive as three.js draws it.

    Attributes
    ----------
    name : str
    kind : str
        ``Mesh``, ``SkinnedMesh``, ``Line``, ``LineSegments``, ``Points``, ...
    points : (times, vertices, 3) float32
        In the scene's space.
    """

    name: str
    kind: str
    points: Float32Array


def play(files: Sequence[tuple[Path, Sequence[float]]], profile: Path, *, draw: bool) -> list[list[PlayedMesh] | str]:
    """Return the primitives of each file at times [s], or the reason why there are none. With `draw`, the page also
    draws them.

    Skips the test if there is no browser or no three.js.
    """
    three = node_module("three")
    found: list[list[PlayedMesh] | str] = []
    with tempfile.TemporaryDirectory() as name, serving(Path(name)) as server, browsing(profile) as browser:
        shutil.copy(BROWSER / "play.html", name)
        Path(name, "three").symlink_to(three)
        browser.open(f"{server.address}/play.html")
        for path, times in files:
            Path(name, "file").unlink(missing_ok=True)
            Path(name, "file").symlink_to(path.resolve())
            meshes = browser.run("return play(...arguments_)", list(times), draw)
            if isinstance(meshes, str):
                found.append(meshes)
                continue
            shapes = [np.array(mesh.pop("points"), np.float32).reshape(len(times), -1, 3) for mesh in meshes]
            found.append([PlayedMesh(**mesh, points=points) for mesh, points in zip(meshes, shapes, strict=True)])
    return found
