/** A clip on the page, with the drawable model of the run that is shown; or the original it is compared with. */
import { findFramesAround } from "pdeanim/motion.js";

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

  /** Values of a field at a time, row after row; null if the run that is shown does not have it. */
  field(name, time) {
    const run = this.animation.at(time);
    return run.fieldList.some((field) => field.name === name) ? run.field(name, time) : null;
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

/** The source of a file, rebuilt from the decoded values plus stored differences at the frames. */
export class Original {
  /**
   * @param {Int16Array} differences of positions for all frames and vertices, in multiples of `step` [scene units]
   * @param {Map<string, { differences: Int16Array | null, step: number }>} fields the same of fields, null without any
   */
  constructor(gl, clip, { name, step, differences, fields }) {
    Object.assign(this, { gl, clip, name, step, differences, fields, model: null });
    this.isStill = differences.every((value) => value === 0);
  }

  positions(time) {
    return this.#restored(this.clip.positions(time), time, this);
  }

  field(name, time) {
    const found = this.clip.field(name, time);
    const own = this.fields.get(name);
    return found && own && (own.differences ? this.#restored(found, time, own) : found);
  }

  #restored(found, time, { differences, step }) {
    const { frames, shares } = findFramesAround(this.clip.animation.times, time);
    const [before, after] = frames.map((frame) => frame * found.length);
    return found.map((value, k) => value + step * (shares[0] * differences[before + k] + shares[1] * differences[after + k]));
  }

  show(time) {
    const isNew = !this.model;
    this.model ??= new Model(this.gl, this.clip.animation);
    this.model.motion.show(this.positions(time));
    return isNew;
  }

  prefetch() {}
}
