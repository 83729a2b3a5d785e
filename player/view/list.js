/** A list of files, each with a picture of its first frame, drawn when it scrolls into view. */
import { compile, PdeAnimation } from "pdeanim";

import { OrbitCamera } from "pdeanim/view/camera.js";
import { decodeBase64, Clip, gunzip } from "pdeanim/view/clip.js";
import { formatBytes, parseColour } from "pdeanim/view/panel.js";
import { Stage } from "pdeanim/view/stage.js";

const WIDTH = 448;
const HEIGHT = 336;
const POINT_SIZE = 4;

class Pictures {
  constructor() {
    this.canvas = new OffscreenCanvas(WIDTH, HEIGHT);
    this.gl = this.canvas.getContext("webgl2", { antialias: true, preserveDrawingBuffer: true });
    this.stage = new Stage(this.gl);
    this.last = Promise.resolve();
    const style = getComputedStyle(document.documentElement);
    const colour = (name) => parseColour(style.getPropertyValue(name).trim());
    this.mesh = colour("--mesh");
    this.look = { page: colour("--page"), pointSize: POINT_SIZE };
  }

  /** Draw the first frame of a file, after all earlier requests. */
  draw(address, canvas, note) {
    this.last = this.last.then(() => this.#draw(address, canvas, note)).catch((error) => (note.textContent = error.message));
    return this.last;
  }

  async #draw(address, canvas, note) {
    const animation = await PdeAnimation.open(address);
    const { start } = animation;
    await animation.prepare(start);
    const clip = new Clip(this.gl, animation, address);
    clip.show(start);
    const [low, high] = [Array(3).fill(Infinity), Array(3).fill(-Infinity)];
    clip.positions(start).forEach((value, k) => {
      low[k % 3] = Math.min(low[k % 3], value);
      high[k % 3] = Math.max(high[k % 3], value);
    });
    const camera = new OrbitCamera();
    camera.fit(low, high);
    const item = { model: clip.model, object: null, shading: "smooth", colouring: "plain", plain: this.mesh };
    this.stage.draw([{ from: 0, to: 1, items: [item] }], camera, this.look);
    canvas.getContext("2d").drawImage(this.canvas, 0, 0);
    note.textContent += `, ${animation.vertexCount} vertices, ${animation.frameCount} frames`;
    clip.model.close();
    animation.close();
  }
}

async function start({ files, wasm }) {
  await compile(await gunzip(await decodeBase64(wasm)));
  const pictures = new Pictures();
  const waiting = new Map();
  const seen = new IntersectionObserver((entries) => {
    for (const { isIntersecting, target } of entries) {
      if (!isIntersecting || !waiting.has(target)) continue;
      const { address, note } = waiting.get(target);
      waiting.delete(target);
      pictures.draw(address, target, note);
    }
  });
  document.getElementById("summary").textContent = `${files.length} files`;
  for (const { name, size, address } of files) {
    const link = document.createElement("a");
    link.setAttribute("href", `/view/${address}`);
    const canvas = document.createElement("canvas");
    [canvas.width, canvas.height] = [WIDTH, HEIGHT];
    const text = document.createElement("p");
    const note = document.createElement("small");
    note.textContent = formatBytes(size);
    text.append(name, document.createElement("br"), note);
    link.append(canvas, text);
    const entry = document.createElement("li");
    entry.append(link);
    document.getElementById("clips").append(entry);
    waiting.set(canvas, { address: `/file/${address}`, note });
    seen.observe(canvas);
  }
  return pictures;
}

globalThis.pdeanimList = start(JSON.parse(document.getElementById("data").textContent)).catch(console.error);
