/** A clip on the page, with the drawable model of the run that is shown; or the original it is compared with. */
import { findFrame } from "pdeanim/motion.js";

import { Model } from "pdeanim/view/model.js";

/** Decode base64. */
export async function decodeBase64(text) {
  return new Uint8Array(await (await fetch(`data:application/octet-stream;base64,${text}`)).arrayBuffer());
}

/** Decompress gzip. */
export async function gunzip(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

export class Clip {
  constructor(gl, animation, name) {
    Object.assign(this, { gl, animation, name, model: null });
  }

  positions(time) {
    return this.animation.at(time).positions(time);
  }

  /** Prepare the model for drawing at a time; return whether it is a new model (another run). */
  show(time) {
    const isNew = this.#take(time);
    this.model.motion.evaluate(time);
    return isNew;
  }

  /** Upload the group that comes next, when there is time to spare. */
  prefetch(time) {
    const run = this.animation.at(time);
    if (run === this.model?.animation) this.model.motion.prefetchAfter(time);
  }

  #take(time) {
    const run = this.animation.at(time);
    if (this.model?.animation === run) return false;
    this.model?.close();
    this.model = new Model(this.gl, run);
    return true;
  }
}

/** The source of a file, rebuilt from the decoded positions plus stored differences at the frames. */
export class Original {
  /** @param {Int16Array} differences for all frames and vertices, in multiples of `step` [scene units] */
  constructor(gl, clip, differences, step, name) {
    Object.assign(this, { gl, clip, differences, step, name, model: null });
  }

  positions(time) {
    const { animation } = this.clip;
    const found = this.clip.positions(time);
    const frame = findFrame(animation.times, time);
    const next = Math.min(frame + 1, animation.frameCount - 1);
    const gap = animation.times[next] - animation.times[frame];
    const share = gap ? Math.min(Math.max((time - animation.times[frame]) / gap, 0), 1) : 0;
    const size = found.length;
    for (let k = 0; k < size; k++) {
      const [before, after] = [this.differences[frame * size + k], this.differences[next * size + k]];
      found[k] += this.step * (before + share * (after - before));
    }
    return found;
  }

  show(time) {
    const isNew = !this.model;
    this.model ??= new Model(this.gl, this.clip.animation);
    this.model.motion.show(this.positions(time));
    return isNew;
  }

  prefetch() {}
}
