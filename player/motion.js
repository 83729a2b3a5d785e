/**
 * Evaluates positions and normals on a graphics processor: the part that WebGL 2 (`gpu.js`) and WebGPU (`webgpu.js`)
 * share.
 *
 * Groups of frames are uploaded when they are first needed, and the latest few stay. At a given time, the fields of the
 * groups around it are multiplied by their weights and summed. If a group does not fit, the decoder evaluates and the
 * positions are uploaded.
 */

import { cornersAround, trianglesOf } from "./mesh.js";

/** Largest size of one group's fields [bytes]. */
export const MAX_FIELD_BYTES = 2 ** 28;

/**
 * Number of groups to keep for each time that is shown. Two contribute at the border between them; the third is the next
 * one.
 */
const MAX_KEPT_GROUPS = 3;

/**
 * Distance [frames] at which float32 cannot resolve a group's weight any more: spline weights shrink by 0.27 per frame.
 */
const NEGLIGIBLE_AFTER_FRAMES = 16;

/**
 * One animation (one run of frames) on a graphics processor.
 *
 * Subclasses offer `fits(index)`, whether a group's fields fit, and extend `close()`. They also implement, for this class:
 * `_begin()`, called before each piece of work; `_uploadGroup(index)` and `_dropGroup(uploaded)`; `_addGroups(time,
 * near)`, which sums groups; `_uploadPositions(positions)`; and `_writeDrawn(pairs)`, which computes normals and fills
 * pairs of buffers. Buffers: `_store(values)`, `_allocate(size)` for vertices, `_upload(buffer, values)`, `_free(buffer)`;
 * `_storeAround(starts, others)` and `_freeAround(stored)` keep the result of `cornersAround`.
 */
export class GroupedMotion {
  /** @param {import("./pdeanim.js").PdeAnimation} animation */
  constructor(animation) {
    this.animation = animation;
    this.vertexCount = animation.vertexCount;
    this.isOnGpu = false;
    this.drawn = [];
  }

  #groups = new Map();
  #around = new Map();
  #time = null;

  /**
   * Add a pair of buffers, for positions and normals of the listed vertices, in order. `fans`: `{ of, stored, triangles,
   * corners, count }`, if not all corners at a vertex share a normal: the fan of each listed vertex and the normal that it
   * keeps where its triangles have no area; the triangles' vertices, the fan of each of their corners, and the number of fans.
   */
  addDrawn(sources, fans = null) {
    this._begin();
    const own = this._store(sources);
    const pair = {
      count: sources.length,
      time: null,
      sources: own,
      fans: fans ? this._store(fans.of) : own,
      stored: fans ? this._store(fans.stored) : null,
      around: this.#uploadAround(fans),
      positions: this._allocate(12 * sources.length),
      normals: this._allocate(12 * sources.length),
    };
    this.drawn.push(pair);
    return pair;
  }

  removeDrawn(pair) {
    this.drawn.splice(this.drawn.indexOf(pair), 1);
    const { sources, fans, stored, positions, normals } = pair;
    for (const buffer of new Set([sources, fans, stored, positions, normals])) if (buffer) this._free(buffer);
  }

  /** Upload the triangles around vertices, or around fans; pairs with the same corners share them. */
  #uploadAround(fans) {
    const key = fans?.corners ?? null;
    if (!this.#around.has(key)) {
      const { animation, vertexCount } = this;
      const { starts, others } = fans
        ? cornersAround(fans.triangles, fans.count, fans.corners)
        : cornersAround(trianglesOf(animation.objects).triangles, vertexCount);
      this.#around.set(key, this._storeAround(starts, others));
    }
    return this.#around.get(key);
  }

  /** Free groups and pairs of buffers. */
  close() {
    for (const index of [...this.#groups.keys()]) this.#drop(index);
    for (const pair of [...this.drawn]) this.removeDrawn(pair);
    for (const stored of this.#around.values()) this._freeAround(stored);
    this.#around.clear();
  }

  /** Positions of the first pair of buffers: all vertices, unless the constructor was given other lists. */
  get positions() {
    return this.drawn[0].positions;
  }

  get normals() {
    return this.drawn[0].normals;
  }

  /** List the groups whose weight at a time float32 can resolve. */
  groupsNear(time) {
    const { animation } = this;
    const [first, behind] = animation.groupsAt(time);
    const frame = findFrame(animation.times, time);
    const near = [];
    for (let index = first; index < behind; index++) {
      const { firstFrame, frameCount } = animation.groups[index];
      const away = Math.max(firstFrame - frame, frame - (firstFrame + frameCount - 1));
      if (away <= NEGLIGIBLE_AFTER_FRAMES) near.push(index);
    }
    return near;
  }

  /** Upload a group before it is needed. */
  prefetch(index) {
    this._begin();
    if (this.fits(index)) this._group(index);
  }

  /** Upload the group that follows a time [s], if there is one. */
  prefetchAfter(time) {
    const { animation } = this;
    const next = animation.groupOf(findFrame(animation.times, time)) + 1;
    if (next < animation.groupCount) this.prefetch(next);
  }

  /** Compute positions and normals at a time [s] into pairs of buffers; by default all. */
  evaluate(time, pairs = this.drawn) {
    this._begin();
    for (const pair of pairs) pair.time = time;
    if (time !== this.#time) {
      const near = this.groupsNear(time);
      this.isOnGpu = near.every((index) => this.fits(index));
      if (this.isOnGpu) this._addGroups(time, near);
      else this._uploadPositions(this.animation.positions(time));
      this.#time = time;
    }
    this._writeDrawn(pairs);
  }

  /** Show the given positions and compute their normals. */
  show(positions) {
    this._begin();
    this._uploadPositions(positions);
    this.#time = null;
    this._writeDrawn(this.drawn);
  }

  /** Fill one pair of buffers with given positions, and normals if there are any, of its vertices. */
  write(pair, positions, normals) {
    this._begin();
    this._upload(pair.positions, positions);
    if (normals) this._upload(pair.normals, normals);
  }

  /** Return a group as `_uploadGroup` returned it. Upload the group only if it is not kept. */
  _group(index) {
    let found = this.#groups.get(index);
    if (found) {
      this.#groups.delete(index);
    } else {
      found = this._uploadGroup(index);
      const times = new Set(this.drawn.map(({ time }) => time));
      if (this.#groups.size >= MAX_KEPT_GROUPS * times.size) this.#drop(this.#groups.keys().next().value);
    }
    this.#groups.set(index, found);  // insertion order: the latest used comes last
    return found;
  }

  #drop(index) {
    this._dropGroup(this.#groups.get(index));
    this.#groups.delete(index);
  }
}

/** List all vertices of an animation, in order. */
export const listVertices = ({ vertexCount }) => Uint32Array.from({ length: vertexCount }, (_, vertex) => vertex);

/** Return the last frame that is not after a time; before the clip, the first frame. */
export function findFrame(times, time) {
  let low = 0;
  let high = times.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return low;
}

/** Return the two frames around a time and their weights: corrections are interpolated linearly. */
export function findFramesAround(times, time) {
  const left = findFrame(times, time);
  const right = Math.min(left + 1, times.length - 1);
  const share = right > left ? Math.min(Math.max((time - times[left]) / (times[right] - times[left]), 0), 1) : 0;
  return { frames: [left, right], shares: [1 - share, share] };
}

/**
 * Return a group's weights at a time, four numbers per function: x, y and z if the axes share a field, otherwise one
 * number.
 */
export function packWeights(animation, time, index, padding = 0) {
  const { functionCount, axisCount } = animation.groups[index];
  const weights = animation.weights(time, index);
  const rows = new Float32Array(4 * (functionCount + padding));
  for (let k = 0; k < functionCount; k++) {
    for (let axis = 0; axis < (axisCount === 3 ? 1 : 3); axis++) rows[4 * k + axis] = weights[axis * functionCount + k];
  }
  return rows;
}

/** Sort corrections by vertex and frame (rows of x, y, z, frame); `starts` gives each vertex's first row. */
export function sortCorrectionsByVertex(animation, index) {
  const { vertexCount } = animation;
  const { frames, vertices, offsets } = animation.corrections(index);
  const starts = new Uint32Array(vertexCount + 1);
  for (const vertex of vertices) starts[vertex + 1]++;
  for (let v = 0; v < vertexCount; v++) starts[v + 1] += starts[v];
  const next = starts.slice();
  const rows = new Float32Array(4 * frames.length);
  for (let k = 0; k < frames.length; k++) {
    const place = 4 * next[vertices[k]]++;
    rows.set(offsets.subarray(3 * k, 3 * k + 3), place);
    rows[place + 3] = frames[k];
  }
  return { starts, rows };
}
