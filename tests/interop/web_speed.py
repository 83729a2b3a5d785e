"""How fast glTF files with morph targets and with motion load and play in a browser: the second table of docs/web.md.

    python -m tests.interop.web_speed DATA/files docs/web.md gltf-transform

The arguments are those of docs/make_web.py; PDECODEC_NODE_MODULES names a folder with three.
"""

from __future__ import annotations

import shutil
import statistics
import subprocess
import sys
import tempfile
from pathlib import Path

from tests.support.browser_pages import README, three_page
from tests.support.browser_tools import node_module
from tests.support.driven_browser import Browser, browsing
from tests.support.remote_server import serving

BEGIN, END = "<!-- speed:begin -->", "<!-- speed:end -->"

SOURCES = {"flower": "abc/gn_flower.abc", "T-shirt": "obj_tshirt"}

RUNS = 5

NO_LIMIT = {"offline": False, "latency": 0, "downloadThroughput": -1, "uploadThroughput": -1}
SLOW_LINE = NO_LIMIT | {"latency": 40, "downloadThroughput": 1_250_000}
"""Delay of answers [ms], bytes per second."""

SCRIPT = """
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { MeshoptDecoder } from "three/addons/libs/meshopt_decoder.module.js";
import { compile } from "pdeanim";
import { GLTFMeshMotionExtension } from "pdeanim/three";

renderer.setSize(640, 480);
const camera = new THREE.PerspectiveCamera(45, 4 / 3);

function stage({ scene: root }) {
  root.updateMatrixWorld();
  const box = new THREE.Box3().setFromObject(root);
  const [centre, size] = [box.getCenter(new THREE.Vector3()), box.getSize(new THREE.Vector3()).length() / 2];
  camera.position.copy(centre).add(new THREE.Vector3(1.1 * size, 0.7 * size, 2.2 * size));
  Object.assign(camera, { near: size / 100, far: 20 * size }).updateProjectionMatrix();
  camera.lookAt(centre);
  return new THREE.Scene().add(new THREE.HemisphereLight(0xffffff, 0x666666, 2), new THREE.DirectionalLight(), root);
}

/** Return the time to the first picture [ms], and the pictures per second of two seconds. */
globalThis.measure = async (name, plays) => {
  const start = performance.now();
  if (name.endsWith("-c.glb")) compile();
  const loader = new GLTFLoader().setMeshoptDecoder(MeshoptDecoder);
  const gltf = await loader.register((parser) => new GLTFMeshMotionExtension(parser)).loadAsync(name);
  const [scene, mixer] = [stage(gltf), new THREE.AnimationMixer(gltf.scene)];
  for (const clip of gltf.animations) mixer.clipAction(clip).play();
  const draw = (time) => {
    mixer.setTime(time);
    renderer.render(scene, camera);
    gl.readPixels(0, 0, 1, 1, gl.RGBA, gl.UNSIGNED_BYTE, new Uint8Array(4));
  };
  draw(0.01);
  const first = performance.now() - start;
  draw(0.02);
  const playing = performance.now();
  let pictures = 0;
  while (plays && performance.now() - playing < 2000) draw(0.03 + pictures++ / 60);
  return [first, (1000 * pictures) / (performance.now() - playing)];
};
"""


def write_files(source: Path, stem: str, transform: str, folder: Path) -> None:
    """Write a clip with morph targets, those compressed by meshoptimizer, and with motion."""
    plain, small, moved = (folder / f"{stem}-{kind}.glb" for kind in "abc")
    convert = [sys.executable, "-m", "pdecodec", "convert", str(source), "--quiet"]
    subprocess.run([*convert, str(plain)], check=True)
    subprocess.run([transform, "meshopt", str(plain), str(small)], check=True, capture_output=True)
    subprocess.run([*convert, str(moved), "--motion", "--tolerance", "1e-3", "--web"], check=True)


def load(browser: Browser, address: str, name: str, *, is_slow: bool) -> list[float]:
    """Load a file in a new page without a cache; return what ``measure`` returns."""

    def command(name: str, **parameters: object) -> None:
        browser.call("POST", "/goog/cdp/execute", {"cmd": f"Network.{name}", "params": parameters})

    command("enable")
    command("setCacheDisabled", cacheDisabled=True)
    command("emulateNetworkConditions", **NO_LIMIT)
    browser.open(address)
    browser.run("while (!globalThis.measure) await new Promise((next) => setTimeout(next, 20));")
    command("emulateNetworkConditions", **SLOW_LINE if is_slow else NO_LIMIT)
    found: list[float] = browser.run("return measure(...arguments_)", name, not is_slow)
    return found


def table(files: Path, transform: str, folder: Path) -> str:
    site = folder / "site"
    (site / "node_modules").mkdir(parents=True)
    (site / "node_modules" / "three").symlink_to(node_module("three"))
    shutil.copytree(README.parent, site / "node_modules" / "pdeanim")
    served = three_page(site, folder / "served", SCRIPT)
    for name, path in SOURCES.items():
        write_files(files / path, name, transform, served)
    names = [f"{name}-{kind}.glb" for name in SOURCES for kind in "abc"]
    times: dict[tuple[str, bool], list[list[float]]] = {(name, slow): [] for name in names for slow in (True, False)}
    with serving(served) as server, browsing(folder / "profile") as browser:
        server.compresses = True
        for _ in range(RUNS):
            for (name, is_slow), found in times.items():
                found.append(load(browser, f"{server.address}/index.html", name, is_slow=is_slow))

    def middle(name: str, is_slow: bool, which: int) -> float:
        return statistics.median(found[which] for found in times[name, is_slow])

    return "\n".join(
        f"| {' | '.join(row)} |"
        for row in (
            ["", *(cell for name in SOURCES for cell in (name, "", ""))],
            ["---"] * (len(names) + 1),
            ["", *["(a)", "(b)", "(c)"] * len(SOURCES)],
            ["file", *(f"{(served / name).stat().st_size / 1000:,.0f} kB" for name in names)],
            ["loaded to first frame, at 10 Mbit/s", *(f"{middle(name, True, 0) / 1000:.2f} s" for name in names)],
            ["the same from this machine", *(f"{middle(name, False, 0) / 1000:.2f} s" for name in names)],
            ["playing, software renderer", *(f"{middle(name, False, 1):.0f} frames/s" for name in names)],
        )
    )


def main(files: str, page: str, transform: str) -> None:
    with tempfile.TemporaryDirectory() as folder:
        made = table(Path(files), transform, Path(folder))
    head, rest = Path(page).read_text("utf-8").split(BEGIN)
    Path(page).write_text(f"{head}{BEGIN}\n{made}\n{END}{rest.split(END)[1]}", "utf-8")


if __name__ == "__main__":
    main(*sys.argv[1:])
