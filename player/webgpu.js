/**
 * Evaluates positions and normals on the graphics processor (WebGPU).
 *
 * The fields of a group of frames are uploaded once, unchanged, into a storage buffer; each frame then needs a few
 * weights. One compute shader sums the weighted fields and adds the vertex's corrections at the two frames around the
 * time. A second one computes normals from the sums and writes positions and normals in drawing order. Both buffers
 * serve as vertex buffers of any draw call. The decoder evaluates groups that do not fit, and their positions are
 * uploaded.
 */
import {
  GroupedMotion,
  MAX_FIELD_BYTES,
  listVertices,
  sortCorrectionsByVertex,
  findFramesAround,
  packWeights,
} from "./motion.js";

/** Vertices per workgroup: every graphics processor supports it. */
const WORKGROUP_SIZE = 64;

/** Bits of buffer usages and map modes, from the WebGPU standard: Node does not define their names. */
const USAGE = { mapRead: 1, copySource: 4, copyTarget: 8, vertex: 32, uniform: 64, storage: 128 };
const MAP_READ = 1;

const SUM_SHADER = `
struct Frame {
  vertices: u32,
  functions: u32,
  hasAxes: u32,
  hasCorrections: u32,
  frames: vec2f,
  shares: vec2f,
}
@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> weights: array<vec4f>;
@group(0) @binding(2) var<storage, read> fields: array<f32>;
@group(0) @binding(3) var<storage, read> corrections: array<vec4f>;
@group(0) @binding(4) var<storage, read> starts: array<u32>;
@group(0) @binding(5) var<storage, read> before: array<f32>;
@group(0) @binding(6) var<storage, read_write> sums: array<f32>;

fn correctionAt(wanted: f32, first: u32, behind: u32) -> vec3f {
  var begin = first;
  var end = behind;
  while (begin < end) {
    let middle = (begin + end) / 2u;
    let found = corrections[middle];
    if (found.w == wanted) { return found.xyz; }
    if (found.w < wanted) { begin = middle + 1u; } else { end = middle; }
  }
  return vec3f(0.0);
}

@compute @workgroup_size(${WORKGROUP_SIZE})
fn main(@builtin(global_invocation_id) id: vec3u) {
  let vertex = id.x;
  if (vertex >= frame.vertices) { return; }
  var moved = vec3f(0.0);
  if (frame.hasAxes != 0u) {
    for (var k = 0u; k < frame.functions; k++) {
      let at = 3u * (k * frame.vertices + vertex);
      moved += weights[k].x * vec3f(fields[at], fields[at + 1u], fields[at + 2u]);
    }
  } else {
    for (var k = 0u; k < frame.functions; k++) { moved += fields[k * frame.vertices + vertex] * weights[k].xyz; }
  }
  if (frame.hasCorrections != 0u) {
    let begin = starts[vertex];
    let end = starts[vertex + 1u];
    moved += frame.shares.x * correctionAt(frame.frames.x, begin, end);
    if (frame.shares.y > 0.0) { moved += frame.shares.y * correctionAt(frame.frames.y, begin, end); }
  }
  for (var axis = 0u; axis < 3u; axis++) { sums[3u * vertex + axis] = before[3u * vertex + axis] + moved[axis]; }
}`;

const DRAWN_SHADER = `
@group(0) @binding(0) var<storage, read> points: array<f32>;
@group(0) @binding(1) var<storage, read> starts: array<u32>;
@group(0) @binding(2) var<storage, read> others: array<vec2u>;
@group(0) @binding(3) var<storage, read> sources: array<u32>;
@group(0) @binding(4) var<storage, read_write> positions: array<f32>;
@group(0) @binding(5) var<storage, read_write> normals: array<f32>;
@group(0) @binding(6) var<storage, read> fans: array<u32>;
@group(0) @binding(7) var<storage, read> stored: array<f32>;

fn pointAt(vertex: u32) -> vec3f {
  return vec3f(points[3u * vertex], points[3u * vertex + 1u], points[3u * vertex + 2u]);
}

@compute @workgroup_size(${WORKGROUP_SIZE})
fn main(@builtin(global_invocation_id) id: vec3u) {
  let place = id.x;
  if (place >= arrayLength(&sources)) { return; }
  let vertex = sources[place];
  let here = pointAt(vertex);
  var sum = vec3f(0.0);
  let fan = fans[place];
  for (var k = starts[fan]; k < starts[fan + 1u]; k++) {
    sum += cross(pointAt(others[k].x) - here, pointAt(others[k].y) - here);
  }
  let size = length(sum);
  var normal = sum / size;
  if (size == 0.0) {
    normal = vec3f(0.0);
    // Without fans of their own, vertices have no stored normals.
    if (3u * place + 2u < arrayLength(&stored)) {
      normal = vec3f(stored[3u * place], stored[3u * place + 1u], stored[3u * place + 2u]);
    }
  }
  for (var axis = 0u; axis < 3u; axis++) {
    positions[3u * place + axis] = here[axis];
    normals[3u * place + axis] = normal[axis];
  }
}`;

/** Bind a whole buffer. */
const whole = (buffer) => ({ buffer });

/** Positions and normals of one animation (one run of frames) in buffers of a device. */
export class WebGpuMotion extends GroupedMotion {
  /** Whether an animation's positions and faces fit the device's limits on bindings and dispatches. */
  static holds(device, animation) {
    const { maxComputeWorkgroupsPerDimension: most, maxStorageBufferBindingSize: bytes } = device.limits;
    const corners = animation.objects.reduce((sum, { faceIndices }) => sum + faceIndices.length, 0);
    // A fan of n - 2 triangles has fewer than 3 n corners; each lists two other vertices: 8 bytes.
    const largest = Math.max(12 * animation.vertexCount, 8 * 3 * corners);
    return largest <= bytes && Math.max(animation.vertexCount, 3 * corners) <= WORKGROUP_SIZE * most;
  }

  /**
   * @param {GPUDevice} device
   * @param {import("./pdeanim.js").PdeAnimation} animation
   * @param {Uint32Array[]} drawn for each pair of buffers, the vertices to write, in order [default: one pair with all]
   */
  constructor(device, animation, drawn = [listVertices(animation)]) {
    super(animation);
    this.device = device;
    this.#sum = this.#pipeline(SUM_SHADER);
    this.#draw = this.#pipeline(DRAWN_SHADER);
    const { vertexCount } = this;
    this.#reference = this._store(animation.reference());
    this.#sums = [this.#empty(12 * vertexCount), this.#empty(12 * vertexCount)];
    this.#latest = this.#sums[0];
    for (const sources of drawn) this.addDrawn(sources);
    const most = animation.groups.reduce((count, { functionCount }) => Math.max(count, functionCount), 0);
    this.#weights = this.#empty(16 * most);
    this.#frame = device.createBuffer({ size: 32, usage: USAGE.uniform | USAGE.copyTarget });
  }

  #sum;
  #draw;
  #reference;
  #sums;
  #latest;
  #weights;
  #frame;

  /** Whether a group's fields fit into a storage buffer. */
  fits(index) {
    const { functionCount, axisCount } = this.animation.groups[index];
    const most = Math.min(MAX_FIELD_BYTES, this.device.limits.maxStorageBufferBindingSize);
    return 4 * functionCount * axisCount * this.vertexCount <= most;
  }

  _begin() {}

  _uploadPositions(positions) {
    this.#latest = this.#sums[0];
    this._upload(this.#latest, positions);
  }

  _upload(buffer, values) {
    this.device.queue.writeBuffer(buffer, 0, values);
  }

  /** Read the first buffer of positions. */
  async readPositions() {
    const { device } = this;
    const size = 12 * this.drawn[0].count;
    const copy = device.createBuffer({ size, usage: USAGE.mapRead | USAGE.copyTarget });
    const encoder = device.createCommandEncoder();
    encoder.copyBufferToBuffer(this.positions, 0, copy, 0, size);
    device.queue.submit([encoder.finish()]);
    await copy.mapAsync(MAP_READ);
    const found = new Float32Array(copy.getMappedRange().slice(0));
    copy.destroy();
    return found;
  }

  close() {
    super.close();
    for (const buffer of [this.#reference, ...this.#sums, this.#weights, this.#frame]) buffer.destroy();
  }

  _addGroups(time, near) {
    const { animation, vertexCount } = this;
    const { queue } = this.device;
    const { frames, shares } = findFramesAround(animation.times, time);
    let before = this.#reference;
    near.forEach((index, pass) => {
      const { functionCount, hasAxes, hasCorrections, fields, corrections, starts } = this._group(index);
      const frame = new ArrayBuffer(32);
      new Uint32Array(frame, 0, 4).set([vertexCount, functionCount, hasAxes, hasCorrections]);
      new Float32Array(frame, 16, 4).set([...frames, ...shares]);
      // The queue keeps the order of writes and dispatches, so the next group may overwrite these.
      queue.writeBuffer(this.#frame, 0, frame);
      queue.writeBuffer(this.#weights, 0, packWeights(animation, time, index));
      this.#latest = this.#sums[pass % 2];
      const bound = [this.#frame, this.#weights, fields, corrections, starts, before, this.#latest];
      this.#dispatch([[this.#sum, bound.map(whole), vertexCount]]);
      before = this.#latest;
    });
  }

  _writeDrawn(pairs) {
    const runs = pairs.map(({ count, sources, fans, stored, around, positions, normals }) => {
      const common = [this.#latest, around.starts, around.others].map(whole);
      const own = [{ buffer: sources, size: 4 * count }, whole(positions), whole(normals)];
      const others = [whole(fans), stored ? { buffer: stored, size: 12 * count } : { buffer: around.starts, size: 4 }];
      return [this.#draw, [...common, ...own, ...others], count];
    });
    this.#dispatch(runs);
  }

  _uploadGroup(index) {
    const { functionCount, axisCount } = this.animation.groups[index];
    const { starts, rows } = sortCorrectionsByVertex(this.animation, index);
    return {
      functionCount,
      hasAxes: axisCount === 3 ? 1 : 0,
      hasCorrections: rows.length > 0 ? 1 : 0,
      fields: this._store(this.animation.fields(index)),
      corrections: this._store(rows),
      starts: this._store(starts),
    };
  }

  _dropGroup({ fields, corrections, starts }) {
    for (const buffer of [fields, corrections, starts]) buffer.destroy();
  }

  #pipeline(code) {
    const module = this.device.createShaderModule({ code });
    return this.device.createComputePipeline({ layout: "auto", compute: { module, entryPoint: "main" } });
  }

  /** Run pipelines, each with its bindings and its number of vertices. */
  #dispatch(runs) {
    const { device } = this;
    const encoder = device.createCommandEncoder();
    const pass = encoder.beginComputePass();
    for (const [pipeline, bound, count] of runs) {
      if (count === 0) continue;
      const entries = bound.map((resource, binding) => ({ binding, resource }));
      pass.setPipeline(pipeline);
      pass.setBindGroup(0, device.createBindGroup({ layout: pipeline.getBindGroupLayout(0), entries }));
      pass.dispatchWorkgroups(Math.ceil(count / WORKGROUP_SIZE));
    }
    pass.end();
    device.queue.submit([encoder.finish()]);
  }

  _allocate(size) {
    return this.#empty(size, USAGE.vertex);
  }

  _free(buffer) {
    buffer.destroy();
  }

  _storeAround(starts, others) {
    return { starts: this._store(starts), others: this._store(others) };
  }

  _freeAround({ starts, others }) {
    for (const buffer of [starts, others]) buffer.destroy();
  }

  _store(values) {
    const buffer = this.#empty(values.byteLength);
    this.device.queue.writeBuffer(buffer, 0, values);
    return buffer;
  }

  /**
   * Create a buffer that shaders read and write, at least as large as the largest element type that a shader declares.
   */
  #empty(size, usage = 0) {
    const always = USAGE.storage | USAGE.copySource | USAGE.copyTarget;
    return this.device.createBuffer({ size: Math.max(size, 16), usage: always | usage });
  }
}
