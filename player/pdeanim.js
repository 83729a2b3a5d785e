/**
 * Evaluates the deforming meshes of `.pdeanim` files at any time.
 *
 *     const animation = await PdeAnimation.open("cloth.pdeanim");
 *     await animation.prepare(1.25);
 *     const points = animation.positions(1.25); // x, y, z of each vertex in turn
 *
 * Vertices of all objects are numbered in one row: first those of the first object, then those of the second, and so
 * on.
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

const ALL_OBJECTS = -1n;
const DOMAINS = ["vertices", "faces", "corners", "object", "cells"];
const TYPES = [Float32Array, Float64Array, Int32Array, BigInt64Array, Uint8Array];
const WORDS_PER_CORRECTION = 5;

/** Types of a field's values in the order of the C interface, each with its array. */
const FIELD_TYPES = [
  ["float32", Float32Array],
  ["float64", Float64Array],
  ["int8", Int8Array],
  ["int16", Int16Array],
  ["int32", Int32Array],
  ["int64", BigInt64Array],
  ["uint8", Uint8Array],
  ["uint16", Uint16Array],
  ["uint32", Uint32Array],
  ["uint64", BigUint64Array],
  ["bool", Uint8Array],
];

export class PdeAnimation {
  /**
   * Open a file, given its bytes, its URL or a source. From a URL only the headers are read.
   * @param {ArrayBuffer | ArrayBufferView | string | URL | MemorySource | HttpSource} from
   * @param {{ maxMemory?: number, request?: RequestInit, wasm?: BufferSource | string | URL }} options most memory [bytes]
   *     that decoding may take; options for `fetch`; the WebAssembly module or its address, if it is not next to this script
   * @returns {Promise<PdeAnimation>}
   */
  static async open(from, options = {}) {
    const core = await Core.start(await makeSource(from, options.request), options.wasm);
    const handle = await core.retryUntilFetched(() => core.open(options.maxMemory));
    return new PdeAnimation(core, handle);
  }

  #core;
  #pointer;
  #runs = new Map();
  #objects = new Map();
  #groups = null;
  #stored = null;

  /** Called by `open` and `run` only. */
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

  /** Size of the file [bytes]. */
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
   * Fetch everything that positions, velocities and accelerations at a time [s] need, and the mesh and its attributes.
   * Returns at once if the file is in memory.
   * @param {number} time
   * @param {{ fields?: string[] }} options names of fields whose values at the time are fetched, too
   */
  async prepare(time, { fields = [] } = {}) {
    await this.#core.retryUntilFetched(() => {
      const run = this.at(time);
      for (let object = 0; object < run.objectCount; object++) {
        run.object(object);
        run.attributes(object);
      }
      if (run.vertexCount > 0) run.accelerations(time);
      run.positions(time);
      for (const name of fields) run.field(name, time);
    });
  }

  /**
   * Return the run of frames, with its own faces, that is shown at a time [s]; most files have one run and return
   * themselves.
   */
  at(time) {
    return this.runCount === 1 ? this : this.run(Number(this.#core.functions.pdeanim_run_at(this.#handle, time)));
  }

  /** Return the first frame of a run; for `runCount`, the number of frames. */
  firstFrameOfRun(run) {
    return Number(this.#core.functions.pdeanim_first_frame_of_run(this.#handle, BigInt(run)));
  }

  /** Open one run of frames; it stays open until this animation is closed. */
  run(index) {
    if (!this.#runs.has(index)) {
      const core = this.#core;
      core.call("open_run", this.#handle, BigInt(index), core.scratch);
      this.#runs.set(index, new PdeAnimation(core, core.pointer(core.scratch)));
    }
    return this.#runs.get(index);
  }

  /**
   * Return an object: its name, its range of vertices, its faces and lines. Sizes count the corners of each face or
   * line; indices are the corners' vertices, counted from 0 within the object.
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
   * Return the attributes of an object, such as UVs: name, domain, rows of values, and the row of each element (-1 for
   * none), or null if element k has row k. Labels name integer values.
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
   * Return the positions [scene units] of all vertices, or of one object's: x, y, z of each in turn. The mesh rests before the
   * first frame and after the last one.
   * @param {number} time [s]
   * @param {{ object?: number, out?: Float32Array }} options
   * @returns {Float32Array}
   */
  positions(time, options = {}) {
    return this.#evaluate(POSITIONS, time, options);
  }

  /** Return velocities [scene units / s], laid out like positions. */
  velocities(time, options = {}) {
    return this.#evaluate(VELOCITIES, time, options);
  }

  /** Return accelerations [scene units / s^2], laid out like positions. */
  accelerations(time, options = {}) {
    return this.#evaluate(ACCELERATIONS, time, options);
  }

  #evaluate(quantity, time, { object, out }) {
    const core = this.#core;
    const vertices = object === undefined ? this.vertexCount : this.object(object).vertexCount;
    const which = object === undefined ? ALL_OBJECTS : BigInt(object);
    core.view.setFloat64(core.scratch, time, true);
    const work = (at) => core.call("evaluate", this.#handle, quantity, core.scratch, 1, which, at);
    return core.readArray(Float32Array, 3 * vertices, work, out);
  }

  /**
   * Fields: values on vertices, faces, corners, objects or cells that change in time, such as stresses. Each has a
   * name, a unit ("" if unknown), a domain, a type, numbers per row (components), rows, the smallest and largest value
   * of the source, the largest error at frames (0: exact), and the objects that have it; rows stand object after object.
   */
  get fieldList() {
    this.#stored ??= this.#readFields();
    return this.#stored;
  }

  #readFields() {
    const core = this.#core;
    const at = core.scratch;
    core.call("field_count", this.#handle, at);
    return Array.from({ length: core.number(at) }, (_, index) => {
      core.call("get_field", this.#handle, BigInt(index), at);
      const { view } = core;
      const [smallest, largest, bound] = [40, 48, 56].map((place) => view.getFloat64(at + place, true));
      const count = core.number(at + 64);
      const objects = [...core.copy(BigInt64Array, core.pointer(at + 72), count)].map(Number);
      return {
        name: core.text(core.pointer(at)),
        unit: core.text(core.pointer(at + 4)),
        domain: DOMAINS[view.getInt32(at + 8, true)],
        type: FIELD_TYPES[view.getInt32(at + 12, true)][0],
        rows: core.number(at + 16),
        components: core.number(at + 24),
        smallest,
        largest,
        bound,
        objects: count ? objects : Array.from({ length: this.objectCount }, (_, object) => object),
      };
    });
  }

  /**
   * Return the values of a field at a time [s], row after row. Between frames floats follow a smooth curve; other types
   * keep the values of the frame before.
   * @param {string} name
   * @param {number} time [s]
   * @param {{ derivative?: 0 | 1 | 2, out?: ArrayBufferView }} options derivatives of floats [1 / s, 1 / s^2]; array of
   *     the field's type to write to
   * @returns {ArrayBufferView} an array of the field's type; bytes 0 and 1 for "bool"
   */
  field(name, time, { derivative = 0, out } = {}) {
    const core = this.#core;
    const index = this.fieldList.findIndex((field) => field.name === name);
    if (index < 0) throw new PdeanimError(`there is no field "${name}"`, "argument");
    const { type, rows, components } = this.fieldList[index];
    const Type = FIELD_TYPES.find(([own]) => own === type)[1];
    const count = rows * components;
    const bytes = count * Type.BYTES_PER_ELEMENT;
    core.view.setFloat64(core.scratch, time, true);
    const work = (at) => core.call("evaluate_field", this.#handle, BigInt(index), core.scratch, 1, derivative, at, bytes);
    return core.readArray(Type, count, work, out);
  }

  /** Groups of frames: their frames, their number of functions of time, and the components (1 or 3) of their fields. */
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

  /** Return the group of a frame. */
  groupOf(frame) {
    return this.groups.findIndex((group) => frame < group.firstFrame + group.frameCount);
  }

  /** Return the reference frame [scene units]: x, y, z of each vertex in turn. */
  reference() {
    return this.#core.readArray(Float32Array, 3 * this.vertexCount, (at) => this.#core.call("reference", this.#handle, at));
  }

  /** Return the groups that contribute to positions at a time: the first, and one past the last. */
  groupsAt(time) {
    const core = this.#core;
    core.call("groups_at", this.#handle, POSITIONS, time, core.scratch, core.scratch + 8);
    const first = core.number(core.scratch);
    return [first, first + core.number(core.scratch + 8)];
  }

  /**
   * Return the weights of a group's functions for positions at a time; if axes share a field, all weights of x, then y,
   * then z.
   */
  weights(time, group) {
    const { functionCount, axisCount } = this.groups[group];
    const count = axisCount === 3 ? functionCount : 3 * functionCount;
    const work = (at) => this.#core.call("weights", this.#handle, POSITIONS, time, BigInt(group), at);
    return this.#core.readArray(Float64Array, count, work);
  }

  /** Return the fields of a group [scene units]: function by function, vertex by vertex, component by component. */
  fields(group) {
    const { functionCount, axisCount } = this.groups[group];
    const work = (at) => this.#core.call("fields", this.#handle, BigInt(group), at);
    return this.#core.readArray(Float32Array, functionCount * axisCount * this.vertexCount, work);
  }

  /**
   * Return the corrections that are added to the fields at frames of a group: frames, vertices, and x, y, z of each.
   */
  corrections(group) {
    const core = this.#core;
    core.call("corrections", this.#handle, BigInt(group), core.scratch, core.scratch + 8);
    const count = core.number(core.scratch + 8);
    const place = core.pointer(core.scratch);
    const whole = core.copy(Int32Array, place, WORDS_PER_CORRECTION * count);
    const single = new Float32Array(whole.buffer);
    const frames = new Int32Array(count);
    const vertices = new Int32Array(count);
    const offsets = new Float32Array(3 * count);
    for (let k = 0; k < count; k++) {
      frames[k] = whole[WORDS_PER_CORRECTION * k];
      vertices[k] = whole[WORDS_PER_CORRECTION * k + 1];
      offsets.set(single.subarray(WORDS_PER_CORRECTION * k + 2, WORDS_PER_CORRECTION * (k + 1)), 3 * k);
    }
    return { frames, vertices, offsets };
  }

  /** Return the patch, or the piece of a curve, that each vertex belongs to. */
  elements() {
    return this.#core.readArray(Int32Array, this.vertexCount, (at) => this.#core.call("elements", this.#handle, at));
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

  /** Check every byte, and that everything decodes; throw if not. */
  verify() {
    this.#core.call("verify", this.#handle);
  }

  /** Free what is decoded, and close all runs that were opened. */
  close() {
    for (const run of this.#runs.values()) run.close();
    this.#runs.clear();
    if (this.#pointer) this.#core.functions.pdeanim_close(this.#pointer);
    this.#pointer = 0;
  }

  get isClosed() {
    return this.#pointer === 0;
  }

  /** Open a closed animation again. Its bytes, or those of its address that were fetched, are still there. */
  reopen() {
    if (this.isClosed) this.#pointer = this.#core.open();
  }

  get #handle() {
    if (!this.#pointer) throw new PdeanimError("the animation is closed; open it again", "argument");
    return this.#pointer;
  }
}

async function makeSource(from, request) {
  if (typeof from === "string" || from instanceof URL) return HttpSource.open(from, request);
  if (from instanceof ArrayBuffer || ArrayBuffer.isView(from)) return new MemorySource(from);
  if (typeof from?.read === "function") return from;
  throw new PdeanimError("open takes bytes, a URL or a source of bytes", "argument");
}
