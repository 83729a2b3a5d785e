"""Pages for tests of the player: three.js with each graphics interface, served to a browser."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from tests.support.browser_tools import BROWSER
from tests.support.driven_browser import Browser, browsing
from tests.support.remote_server import serving

README = BROWSER.parents[1] / "player" / "README.md"

HELPERS = """
/** Read three floats for each of `count` vertices from a buffer. */
function readFromContext(gl, buffer, count) {
  const found = new Float32Array(3 * count);
  gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
  gl.getBufferSubData(gl.ARRAY_BUFFER, 0, found);
  gl.bindBuffer(gl.ARRAY_BUFFER, null);
  return found;
}

/** Count what is made and not freed in a context after each of four rounds of work. */
async function countLeft(gl, work) {
  const live = new Set();
  const kinds = ["Buffer", "Texture", "Program", "Shader", "VertexArray", "TransformFeedback"];
  for (const kind of kinds) {
    const [make, free] = [gl[`create${kind}`].bind(gl), gl[`delete${kind}`].bind(gl)];
    gl[`create${kind}`] = (...given) => {
      const one = make(...given);
      live.add(one);
      return one;
    };
    gl[`delete${kind}`] = (one) => {
      live.delete(one);
      free(one);
    };
  }
  const left = [];
  for (let k = 0; k < 4; k++) {
    await work();
    left.push(live.size);
  }
  for (const kind of kinds) {
    delete gl[`create${kind}`];
    delete gl[`delete${kind}`];
  }
  return left;
}

globalThis.countLeft = countLeft;

async function readFromDevice(device, buffer, count) {
  const size = 12 * count;
  const copy = device.createBuffer({ size, usage: GPUBufferUsage.MAP_READ | GPUBufferUsage.COPY_DST });
  const encoder = device.createCommandEncoder();
  encoder.copyBufferToBuffer(buffer, 0, copy, 0, size);
  device.queue.submit([encoder.finish()]);
  await copy.mapAsync(GPUMapMode.READ);
  return new Float32Array(copy.getMappedRange());
}
"""

GRAPHICS = {
    "WebGL": """
import { GpuMotion as Motion } from "pdeanim/gpu";
const renderer = new THREE.WebGLRenderer();
const gl = renderer.getContext();
globalThis.gl = gl;
const error = () => gl.getError();
const pixelsOf = (target, width, height) =>
  renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height, new Uint8Array(4 * width * height));
const buffered = ({ buffer, count }) => readFromContext(gl, buffer, count);
""",
    "WebGPU": """
import { WebGpuMotion as Motion } from "pdeanim/webgpu";
const renderer = new THREE.WebGPURenderer();
await renderer.init();
const { device } = renderer.backend;
let errors = 0;
device?.addEventListener("uncapturederror", () => errors++);
const error = () => errors;
const pixelsOf = (target, width, height) => renderer.readRenderTargetPixelsAsync(target, 0, 0, width, height);
const buffered = (attribute) => readFromDevice(device, renderer.backend.get(attribute).buffer, attribute.count);
""",
}
"""The parts of the JavaScript that differ between three.js' graphics interfaces, by the name of the interface."""


def readme_block(language: str, wanted: str = "") -> str:
    """Return the only block of the player's README in a language that contains `wanted`."""
    blocks = README.read_text("utf-8").split("```")[1::2]
    (found,) = [block for block in blocks if block.startswith(f"{language}\n") and wanted in block]
    return found.removeprefix(f"{language}\n")


def three_page(site: Path, folder: Path, script: str, graphics: str = "WebGL") -> Path:
    """Copy `site` to a new folder with an ``index.html``, whose `script` has ``THREE`` and a ``renderer``."""
    own = "three/webgpu" if graphics == "WebGPU" else "three"
    module = f'import * as THREE from "{own}";\n{HELPERS}{GRAPHICS[graphics]}{script}'
    shutil.copytree(site, folder, symlinks=False)
    text = f'<!doctype html>\n{readme_block("html")}\n<script type="module">\n{module}</script>\n'
    (folder / "index.html").write_text(text)
    return folder


@contextmanager
def showing(folder: Path, address: str, wanted: str, graphics: str = "") -> Iterator[Browser]:
    """Serve a folder and show one of its pages until the expression `wanted` is true; there must be no errors."""
    with serving(folder) as server, browsing(folder.parent / f"{folder.name}-profile") as browser:
        browser.open(f"{server.address}/{address}")
        if graphics == "WebGPU" and not browser.run("return Boolean(await navigator.gpu?.requestAdapter())"):
            pytest.skip("this browser has no WebGPU")
        browser.run(f"while (!({wanted})) await new Promise((next) => setTimeout(next, 20));")
        yield browser
        assert [error for error in browser.errors() if "favicon" not in error] == []
