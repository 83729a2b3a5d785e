/**
 * Deforming meshes of `.pdeanim` files, at any time.
 *
 *     const animation = await PdeAnimation.open("cloth.pdeanim");
 *     await animation.prepare(1.25);
 *     const points = animation.positions(1.25); // x, y, z of one vertex after the other
 *
 * Vertices of all objects are numbered through: those of the first object, then those of the second.
 */
import { Core } from "./core.js";
import { PdeanimError } from "./errors.js";
import { HttpSource, MemorySource } from "./source.js";

export { compile } from "./core.js";
export { PdeanimError } from "./errors.js";
export { HttpSource, MemorySource } from "./source.js";

const POSITIONS = 0;
const VELOCITIES = 1;
const ACCELERATIONS = 2;

/** What a file may ask for, where nothing is said: half of what WebAssembly can address. */
const MOST_BYTES = 2 ** 31;

const ALL_OBJECTS = -1n;
const DOMAINS = ["vertices", "faces", "corners", "object"];
const TYPES = [Float32Array, Float64Array, Int32Array, BigInt64Array, Uint8Array];
const CORRECTION_NUMBERS = 5;

export class PdeAnimation {
  /**
   * Open a file: its bytes, its address, or a source of them. Of an address only headers are read.
   * @param {ArrayBuffer | ArrayBufferView | string | URL | MemorySource | HttpSource} from
   * @param {{ maxMemory?: number, request?: RequestInit, wasm?: BufferSource }} options bytes that the file may ask for;
   *     what requests are made with; the module, where it is not beside this one
   * @returns {Promise<PdeAnimation>}
   */
  static async open(from, options = {}) {
    const core = await Core.start(await sourceOf(from, options.request), options.wasm);
    const handle = await core.fetched(() => core.open(options.maxMemory ?? MOST_BYTES));
    return new PdeAnimation(core, handle);
  }

  #core;
  #pointer;
  #runs = new Map();
  #objects = new Map();
  #groups = null;

  /** For `open` and `run` alone. */
  constructor(core, handle) {
    this.#core = core;
    this.#pointer = handle;
    const { functions } = core;
    this.frameCount = Number(functions.pdeanim_frame_count(handle));
    this.vertexCount = Number(functions.pdeanim_vertex_count(handle));
    this.objectCount = Number(functions.pdeanim_object_count(handle));
    this.runCount = Number(functions.pdeanim_run_count(handle));
    this.groupCount = Number(functions.pdeanim_group_count(handle));
    this.frameRate = functions.pdeanim_frame_rate(handle);
    this.times = core.copy(Float64Array, functions.pdeanim_times(handle), this.frameCount);
  }

  /** Bytes of the file. */
  get fileSize() {
    return this.#core.source.size;
  }

  /** First and last time [s]. */
  get start() {
    return this.times[0];
  }

  get end() {
    return this.times[this.frameCount - 1];
  }

  /**
   * Read from the file's address what positions, velocities and accelerations at a time need, with mesh and attributes.
   * Of a file in memory nothing is left to do.
   */
  async prepare(time) {
    await this.#core.fetched(() => {
      const run = this.at(time);
      for (let object = 0; object < run.objectCount; object++) {
        run.object(object);
        run.attributes(object);
      }
      if (run.vertexCount > 0) run.accelerations(time);
      run.positions(time);
    });
  }

  /** The run of frames that holds at a time [s], with faces of its own: of most files it is this one. */
  at(time) {
    return this.runCount === 1 ? this : this.run(Number(this.#core.functions.pdeanim_run_at(this.#handle, time)));
  }

  /** The first frame of a run; of the number of runs the number of frames. */
  firstFrameOfRun(run) {
    return Number(this.#core.functions.pdeanim_first_frame_of_run(this.#handle, BigInt(run)));
  }

  /** One run of frames, which stays open as long as this is. */
  run(index) {
    if (!this.#runs.has(index)) {
      const core = this.#core;
      core.call("open_run", this.#handle, BigInt(index), core.scratch);
      this.#runs.set(index, new PdeAnimation(core, core.pointer(core.scratch)));
    }
    return this.#runs.get(index);
  }

  /**
   * An object: its name, its place among the vertices, and its faces and lines: how many corners each has, and the corners'
   * vertices, from 0 within the object.
   */
  object(index) {
    if (!this.#objects.has(index)) {
      const core = this.#core;
      const at = core.scratch;
      core.call("get_object", this.#handle, BigInt(index), at);
      const list = (pointer, count) => core.copy(Int32Array, core.pointer(at + pointer), core.number(at + count));
      this.#objects.set(index, {
        name: core.text(core.pointer(at)),
        firstVertex: core.number(at + 8),
        vertexCount: core.number(at + 16),
        faceSizes: list(56, 24),
        faceIndices: list(60, 32),
        lineSizes: list(64, 40),
        lineIndices: list(68, 48),
      });
    }
    return this.#objects.get(index);
  }

  /** All objects. */
  get objects() {
    return Array.from({ length: this.objectCount }, (_, index) => this.object(index));
  }

  /**
   * Attributes of an object, such as UVs: of each its name, domain, rows of so many columns, and the row of each element
   * (-1 for none), or null where element k has row k; labels are what integers stand for.
   */
  attributes(object) {
    const core = this.#core;
    const at = core.scratch;
    core.call("attribute_count", this.#handle, BigInt(object), at);
    const count = core.number(at);
    const found = [];
    for (let index = 0; index < count; index++) {
      core.call("get_attribute", this.#handle, BigInt(object), BigInt(index), at);
      const view = core.view;
      const Type = TYPES[view.getInt32(at + 8, true)];
      const [rows, columns, indices, labels] = [16, 24, 40, 56].map((field) => core.number(at + field));
      const [values, places, texts] = [32, 48, 64].map((field) => core.pointer(at + field));
      found.push({
        name: core.text(core.pointer(at)),
        domain: DOMAINS[view.getInt32(at + 4, true)],
        columns,
        values: core.copy(Type, values, rows * columns),
        indices: indices ? core.copy(Int32Array, places, indices) : null,
        labels: Array.from({ length: labels }, (_, k) => core.text(core.pointer(texts + 4 * k))),
      });
    }
    return found;
  }

  /**
   * Positions [scene units] of all vertices, or of one object's: x, y, z of one after the other. Before the first frame and
   * after the last one the mesh stands still.
   * @param {number} time [s]
   * @param {{ object?: number, out?: Float32Array }} options
   * @returns {Float32Array}
   */
  positions(time, options = {}) {
    return this.#evaluate(POSITIONS, time, options);
  }

  /** Velocities [scene units / s], as `positions` gives positions. */
  velocities(time, options = {}) {
    return this.#evaluate(VELOCITIES, time, options);
  }

  /** Accelerations [scene units / s^2]. */
  accelerations(time, options = {}) {
    return this.#evaluate(ACCELERATIONS, time, options);
  }

  #evaluate(quantity, time, { object, out }) {
    const core = this.#core;
    const vertices = object === undefined ? this.vertexCount : this.object(object).vertexCount;
    const which = object === undefined ? ALL_OBJECTS : BigInt(object);
    core.view.setFloat64(core.scratch, time, true);
    const work = (at) => core.call("evaluate", this.#handle, quantity, core.scratch, 1, which, at);
    return core.filled(Float32Array, 3 * vertices, work, out);
  }

  /** Groups of frames: of each its frames, its functions of time, and the axes of their fields, 1 or 3. */
  get groups() {
    this.#groups ??= Array.from({ length: this.groupCount }, (_, index) => {
      const core = this.#core;
      core.call("get_group", this.#handle, BigInt(index), core.scratch);
      const [firstFrame, frameCount, functionCount, axisCount] = [0, 8, 16, 24].map((field) =>
        core.number(core.scratch + field),
      );
      return { firstFrame, frameCount, functionCount, axisCount };
    });
    return this.#groups;
  }

  /** The group of a frame. */
  groupOf(frame) {
    return this.groups.findIndex((group) => frame < group.firstFrame + group.frameCount);
  }

  /** The reference frame [scene units]: x, y, z of one vertex after the other. */
  reference() {
    return this.#core.filled(Float32Array, 3 * this.vertexCount, (at) => this.#core.call("reference", this.#handle, at));
  }

  /** Groups that count for positions at a time: the first, and one behind the last. */
  groupsAt(time) {
    const core = this.#core;
    core.call("groups_at", this.#handle, POSITIONS, time, core.scratch, core.scratch + 8);
    const first = core.number(core.scratch);
    return [first, first + core.number(core.scratch + 8)];
  }

  /** Weights of a group's functions for positions at a time: of each axis one after the other where fields have one. */
  weights(time, group) {
    const { functionCount, axisCount } = this.groups[group];
    const count = axisCount === 3 ? functionCount : 3 * functionCount;
    const work = (at) => this.#core.call("weights", this.#handle, POSITIONS, time, BigInt(group), at);
    return this.#core.filled(Float64Array, count, work);
  }

  /** Fields of a group [scene units]: of each function all vertices, of each vertex its axes. */
  fields(group) {
    const { functionCount, axisCount } = this.groups[group];
    const work = (at) => this.#core.call("fields", this.#handle, BigInt(group), at);
    return this.#core.filled(Float32Array, functionCount * axisCount * this.vertexCount, work);
  }

  /** What the fields lack at frames of a group: frames, vertices, and x, y, z of each. */
  corrections(group) {
    const core = this.#core;
    core.call("corrections", this.#handle, BigInt(group), core.scratch, core.scratch + 8);
    const count = core.number(core.scratch + 8);
    const place = core.pointer(core.scratch);
    const whole = core.copy(Int32Array, place, CORRECTION_NUMBERS * count);
    const single = new Float32Array(whole.buffer);
    const frames = new Int32Array(count);
    const vertices = new Int32Array(count);
    const offsets = new Float32Array(3 * count);
    for (let k = 0; k < count; k++) {
      frames[k] = whole[CORRECTION_NUMBERS * k];
      vertices[k] = whole[CORRECTION_NUMBERS * k + 1];
      offsets.set(single.subarray(CORRECTION_NUMBERS * k + 2, CORRECTION_NUMBERS * (k + 1)), 3 * k);
    }
    return { frames, vertices, offsets };
  }

  /** The patch, or the piece of a curve, that each vertex belongs to. */
  elements() {
    return this.#core.filled(Int32Array, this.vertexCount, (at) => this.#core.call("elements", this.#handle, at));
  }

  /** Sections of the file: type, offset and length [bytes]. */
  get sections() {
    const core = this.#core;
    const count = Number(core.functions.pdeanim_section_count(this.#handle));
    return Array.from({ length: count }, (_, index) => {
      core.call("get_section", this.#handle, BigInt(index), core.scratch);
      const [offset, length] = [8, 16].map((field) => core.number(core.scratch + field));
      return { type: core.text(core.pointer(core.scratch)), offset, length };
    });
  }

  /** Check every byte, and that everything decodes. */
  verify() {
    this.#core.call("verify", this.#handle);
  }

  /** Give back what is decoded. Runs that were opened go with it. */
  close() {
    for (const run of this.#runs.values()) run.close();
    this.#runs.clear();
    if (this.#pointer) this.#core.functions.pdeanim_close(this.#pointer);
    this.#pointer = 0;
  }

  get #handle() {
    if (!this.#pointer) throw new PdeanimError("the animation is closed; open it again", "argument");
    return this.#pointer;
  }
}

async function sourceOf(from, request) {
  if (typeof from === "string" || from instanceof URL) return HttpSource.open(from, request);
  if (from instanceof ArrayBuffer || ArrayBuffer.isView(from)) return new MemorySource(from);
  if (typeof from?.read === "function") return from;
  throw new PdeanimError("open takes bytes, an address or a source", "argument");
}
