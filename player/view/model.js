/** Buffers to draw one run of frames: positions and normals, triangles and edges by object, colours. */
import { GpuMotion } from "pdeanim/gpu.js";
import { edgesOf, trianglesOf } from "pdeanim/mesh.js";
import { listVertices } from "pdeanim/motion.js";

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
    this.values = this.#buffer(gl.ARRAY_BUFFER, new Float32Array(2 * animation.vertexCount));
    this.cornerValues = null;
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

  /**
   * Set the values that drawn vertices show, as shares of a range: the value of a row for each, no value for row -1.
   * With `isSplit`, drawn vertices are the corners of triangles. Return whether positions have to be computed again.
   */
  setValues(values, { low, high }, rows = null, isSplit = false) {
    const count = rows?.length ?? values.length;
    const pairs = new Float32Array(2 * count);
    for (let k = 0; k < count; k++) {
      const value = rows ? values?.[rows[k]] : values[k];
      if (!Number.isFinite(value)) continue;
      pairs[2 * k] = (value - low) / (high - low || 1);
      pairs[2 * k + 1] = 1;
    }
    const isNew = isSplit && this.#split();
    this.gl.bindBuffer(this.gl.ARRAY_BUFFER, isSplit ? this.cornerValues : this.values);
    this.gl.bufferData(this.gl.ARRAY_BUFFER, pairs, this.gl.DYNAMIC_DRAW);
    return isNew;
  }

  /** Have positions of the corners of triangles, too; return whether that is new. */
  #split() {
    if (this.cornerValues) return false;
    this.cornerValues = this.#buffer(this.gl.ARRAY_BUFFER, new Float32Array(0));
    this.motion.close();
    const { triangles } = trianglesOf(this.animation.objects);
    this.motion = new GpuMotion(this.gl, this.animation, [listVertices(this.animation), triangles]);
    return true;
  }

  close() {
    for (const name of ["triangles", "edges", "points"]) this.gl.deleteBuffer(this[name].buffer);
    for (const buffer of [this.values, this.cornerValues, this.colours]) this.gl.deleteBuffer(buffer);
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
