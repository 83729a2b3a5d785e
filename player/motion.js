/**
 * Positions and normals at any time on a graphics processor: what WebGL 2 (`gpu.js`) and WebGPU (`webgpu.js`) have in common.
 *
 * Groups of frames are uploaded when they are first needed, and the latest are kept. At a time the fields of the groups near it
 * are multiplied by their weights and added up; a group that does not fit is evaluated by the decoder and uploaded.
 */

/** Fields of one group [bytes] at most. */
export const MOST_FIELD_BYTES = 2 ** 28;

/** Groups whose fields are kept. Two count at the border between them; a third one is the next. */
const MOST_GROUPS = 3;

/** From so many frames away a group's share is below what float32 can add: the spline's weights shrink by 0.27 a frame. */
const FAR_FRAMES = 16;

/**
 * One animation (one run of frames) on a graphics processor.
 *
 * A class that extends it has `fits(index)`, whether a group's fields fit, and `close()`; and for this one `_begin()`, called
 * before each piece of work, `_uploadGroup(index)` and `_dropGroup(uploaded)`, `_addGroups(time, near)`, which adds groups up,
 * `_uploadPositions(positions)`, and `_writeDrawn()`, which makes normals and fills the buffers of `drawn`.
 */
export class GroupedMotion {
  /** @param {import("./pdeanim.js").PdeAnimation} animation */
  constructor(animation) {
    this.animation = animation;
    this.vertexCount = animation.vertexCount;
    this.isOnGpu = false;
  }

  #groups = new Map();

  /** The first pair of buffers: of all vertices where the constructor was told nothing else. */
  get positions() {
    return this.drawn[0].positions;
  }

  get normals() {
    return this.drawn[0].normals;
  }

  /** Groups that count at a time as far as float32 goes. */
  groupsNear(time) {
    const { animation } = this;
    const [first, behind] = animation.groupsAt(time);
    const frame = frameAt(animation.times, time);
    const near = [];
    for (let index = first; index < behind; index++) {
      const { firstFrame, frameCount } = animation.groups[index];
      const away = Math.max(firstFrame - frame, frame - (firstFrame + frameCount - 1));
      if (away <= FAR_FRAMES) near.push(index);
    }
    return near;
  }

  /** Upload a group ahead of its time. */
  prefetch(index) {
    this._begin();
    if (this.fits(index)) this._group(index);
  }

  /** Upload the group that comes after a time [s], if there is one. */
  prefetchAfter(time) {
    const { animation } = this;
    const next = animation.groupOf(frameAt(animation.times, time)) + 1;
    if (next < animation.groupCount) this.prefetch(next);
  }

  /** Make positions and normals at a time [s]: the buffers of `drawn` hold them. */
  evaluate(time) {
    this._begin();
    const near = this.groupsNear(time);
    this.isOnGpu = near.every((index) => this.fits(index));
    if (this.isOnGpu) {
      this._addGroups(time, near);
    } else {
      this._uploadPositions(this.animation.positions(time));
    }
    this._writeDrawn();
  }

  /** Take positions from elsewhere, and make normals of them. */
  show(positions) {
    this._begin();
    this._uploadPositions(positions);
    this._writeDrawn();
  }

  /** What `_uploadGroup` made of a group, now or before. */
  _group(index) {
    let found = this.#groups.get(index);
    if (found) {
      this.#groups.delete(index);
    } else {
      found = this._uploadGroup(index);
      if (this.#groups.size >= MOST_GROUPS) this.#drop(this.#groups.keys().next().value);
    }
    this.#groups.set(index, found); // the latest comes last
    return found;
  }

  _dropGroups() {
    for (const index of [...this.#groups.keys()]) this.#drop(index);
  }

  #drop(index) {
    this._dropGroup(this.#groups.get(index));
    this.#groups.delete(index);
  }
}

/** The vertices of an animation, in order. */
export const allVertices = ({ vertexCount }) => Uint32Array.from({ length: vertexCount }, (_, vertex) => vertex);

/** The last frame that is not after a time; the first one before all. */
export function frameAt(times, time) {
  let low = 0;
  let high = times.length;
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= time) low = middle;
    else high = middle;
  }
  return low;
}

/** The two frames around a time, and the share of each: corrections go from one to the other in a straight line. */
export function framesAround(times, time) {
  const left = frameAt(times, time);
  const right = Math.min(left + 1, times.length - 1);
  const share = right > left ? Math.min(Math.max((time - times[left]) / (times[right] - times[left]), 0), 1) : 0;
  return { frames: [left, right], shares: [1 - share, share] };
}

/** Weights of a group at a time, four numbers a function: of x, y and z where axes have fields in common, else one. */
export function weightRows(animation, time, index, padding = 0) {
  const { functionCount, axisCount } = animation.groups[index];
  const weights = animation.weights(time, index);
  const rows = new Float32Array(4 * (functionCount + padding));
  for (let k = 0; k < functionCount; k++) {
    for (let axis = 0; axis < (axisCount === 3 ? 1 : 3); axis++) rows[4 * k + axis] = weights[axis * functionCount + k];
  }
  return rows;
}

/** Corrections by vertex, of each vertex by frame (x, y, z and the frame), and where each vertex's begin. */
export function correctionsByVertex(animation, index) {
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
