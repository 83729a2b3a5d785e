/** Buffers to draw one run of frames: positions and normals, triangles and edges by object, colours. */
import { GpuMotion } from "pdeanim/gpu.js";
import { edgesOf, trianglesOf } from "pdeanim/mesh.js";

/** Hues of consecutive elements are a golden angle apart [degrees], so that neighbours differ. */
const GOLDEN_ANGLE = 137.508;

export class Model {
  constructor(gl, animation) {
    this.gl = gl;
    this.animation = animation;
    this.motion = new GpuMotion(gl, animation);
    const { objects } = animation;
    this.#makeIndices("triangles", objects, (object) => trianglesOf([object]).triangles);
    this.#makeIndices("edges", objects, (object) => edgesOf([object]));
    this.#makeIndices("points", objects, listLoosePoints);
    this.errors = this.#buffer(gl.ARRAY_BUFFER, new Float32Array(animation.vertexCount));
    this.colours = null;
  }

  /** Return the range (first, count) of an index buffer for one object, or for all. */
  part(name, object) {
    const { ends } = this[name];
    return object === null ? [0, ends.at(-1)] : [ends[object], ends[object + 1] - ends[object]];
  }

  /** Colour each vertex by its patch or curve, once. */
  colourElements() {
    if (this.colours) return;
    const bytes = new Uint8Array(4 * this.animation.vertexCount);
    this.animation.elements().forEach((element, vertex) => bytes.set(colourOfElement(element), 4 * vertex));
    this.colours = this.#buffer(this.gl.ARRAY_BUFFER, bytes);
  }

  setErrors(values) {
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, this.errors);
    this.gl.bufferSubData(this.gl.ARRAY_BUFFER, 0, values);
  }

  close() {
    for (const name of ["triangles", "edges", "points"]) this.gl.deleteBuffer(this[name].buffer);
    this.gl.deleteBuffer(this.errors);
    if (this.colours) this.gl.deleteBuffer(this.colours);
    this.motion.close();
  }

  #makeIndices(name, objects, make) {
    const parts = objects.map(make);
    const ends = [0];
    for (const part of parts) ends.push(ends.at(-1) + part.length);
    const all = new Uint32Array(ends.at(-1));
    parts.forEach((part, index) => all.set(part, ends[index]));
    this[name] = { ends, buffer: this.#buffer(this.gl.ELEMENT_ARRAY_BUFFER, all) };
  }

  #buffer(target, values) {
    const buffer = this.gl.createBuffer();
    this.gl.bindVertexArray(null);
    this.gl.bindBuffer(target, buffer);
    this.gl.bufferData(target, values, this.gl.DYNAMIC_DRAW);
    return buffer;
  }
}

/** List the vertices of an object that has neither faces nor lines. */
function listLoosePoints({ firstVertex, vertexCount, faceSizes, lineSizes }) {
  if (faceSizes.length || lineSizes.some((size) => size > 1)) return new Uint32Array(0);
  return Uint32Array.from({ length: vertexCount }, (_, vertex) => firstVertex + vertex);
}

function colourOfElement(element) {
  const hue = (element * GOLDEN_ANGLE) % 360;
  const channel = (shift) => {
    const place = (shift + hue / 30) % 12;
    return Math.round(255 * (0.62 - 0.3 * Math.max(-1, Math.min(place - 3, 9 - place, 1))));
  };
  return [channel(0), channel(8), channel(4), 255];
}
