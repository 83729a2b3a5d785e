/** What renderers share that take positions and normals from the decoder, and who still uses an animation. */
import { normalsOf, trianglesOf } from "./mesh.js";

const users = new WeakMap();

/** Count one more user of an animation; open it again if its last user closed it. */
export function retain(animation) {
  if (animation.isClosed) animation.reopen();
  users.set(animation, (users.get(animation) ?? 0) + 1);
}

/** Count one user less; the last one closes the animation. */
export function release(animation) {
  users.set(animation, users.get(animation) - 1);
  if (users.get(animation) === 0) animation.close();
}

/** The latest positions and normals of a run of frames: all meshes that show the run at one time share them. */
export class DecodedRun {
  static #all = new WeakMap();

  /** Return the one of an animation with a single run of frames. */
  static of(run) {
    if (!DecodedRun.#all.has(run)) DecodedRun.#all.set(run, new DecodedRun(run));
    return DecodedRun.#all.get(run);
  }

  constructor(run) {
    this.run = run;
  }

  #points = null;
  #time = null;
  #weight = null;
  #first = null;
  #triangles = null;
  #normals = new WeakMap();
  #version = 0;

  /** Return x, y, z of all vertices at a time [s]; with a `weight`, that share of the way from the first frame's shape. */
  points(time, weight = 1) {
    if (time === this.#time && weight === this.#weight) return this.#points;
    this.#points = this.run.positions(time, { out: this.#points ?? undefined });
    if (weight !== 1) {
      this.#first ??= this.run.positions(this.run.start);
      const first = this.#first;
      for (let k = 0; k < first.length; k++) this.#points[k] = first[k] + weight * (this.#points[k] - first[k]);
    }
    this.#time = time;
    this.#weight = weight;
    this.#version++;
    return this.#points;
  }

  /** Return the normal of each fan (see `GroupedMotion.addDrawn`), or without fans of each vertex. */
  normals(time, weight, fans = null) {
    const points = this.points(time, weight);
    const { triangles, corners, count } = fans ?? this.#ownFans;
    const found = this.#normals.get(corners) ?? { values: new Float32Array(3 * count), version: 0 };
    this.#normals.set(corners, found);
    if (found.version !== this.#version) normalsOf(points, triangles, found.values, corners);
    found.version = this.#version;
    return found.values;
  }

  get #ownFans() {
    const { run } = this;
    this.#triangles ??= trianglesOf(run.objects).triangles;
    return { triangles: this.#triangles, corners: this.#triangles, count: run.vertexCount };
  }
}

/** Fill x, y, z of each drawn vertex: those of row `rows[k]`, or where they are all zero those of `instead`. */
export function gatherRows(array, values, rows, instead = null) {
  for (let k = 0; k < rows.length; k++) {
    const from = 3 * rows[k];
    const isMissing = instead && values[from] === 0 && values[from + 1] === 0 && values[from + 2] === 0;
    for (let axis = 0; axis < 3; axis++) array[3 * k + axis] = isMissing ? instead[3 * k + axis] : values[from + axis];
  }
}

/** Turn stored tangents with their normals: subtract the part along the normal, and keep the sign of the bitangent. */
export function turnTangents(array, stored, normals) {
  for (let at = 0, from = 0; at < stored.length; at += 4, from += 3) {
    let [along, square] = [0, 0];
    for (let axis = 0; axis < 3; axis++) along += stored[at + axis] * normals[from + axis];
    for (let axis = 0; axis < 3; axis++) {
      const value = stored[at + axis] - along * normals[from + axis];
      array[at + axis] = value;
      square += value * value;
    }
    const length = Math.sqrt(square) || 1;
    for (let axis = 0; axis < 3; axis++) array[at + axis] /= length;
    array[at + 3] = stored[at + 3];
  }
}
