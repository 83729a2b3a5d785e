/**
 * Evaluates positions and normals on the graphics processor (WebGL 2).
 *
 * The fields of a group of frames are uploaded once, as layers of a texture; each frame then needs a few weights,
 * passed as uniforms. One vertex shader sums the weighted fields, adds the vertex's corrections at the two frames
 * around the time, and writes the sums into a buffer (transform feedback). A second one computes normals from the sums
 * and writes positions and normals in drawing order. Both buffers serve as vertex attributes of any draw call. The
 * decoder evaluates groups that do not fit, and their positions are uploaded.
 */
import {
  GroupedMotion,
  MAX_FIELD_BYTES,
  listVertices,
  sortCorrectionsByVertex,
  findFramesAround,
  packWeights,
} from "./motion.js";
import { PdeanimError } from "./errors.js";
import { DRAWN_SHADER, MAX_FUNCTIONS, NO_FRAGMENTS, SUM_SHADER, TEXTURE_WIDTH } from "./gpu-shaders.js";

/** Extra zero weights after the last function: the shader takes four weights at once. */
const WEIGHT_PADDING = 3;

const refusalOf = (log) =>
  new PdeanimError(`the graphics processor refuses a shader: ${log ?? "its context is lost"}`, "internal");

/** Compile and link a program; `outputs` names the variables that transform feedback captures. */
export function makeProgram(gl, vertex, fragment, outputs = []) {
  const program = gl.createProgram();
  for (const [type, source] of [
    [gl.VERTEX_SHADER, vertex],
    [gl.FRAGMENT_SHADER, fragment],
  ]) {
    const shader = gl.createShader(type);
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw refusalOf(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
    gl.deleteShader(shader);  // as soon as the program is
  }
  if (outputs.length) gl.transformFeedbackVaryings(program, outputs, gl.SEPARATE_ATTRIBS);
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw refusalOf(gl.getProgramInfoLog(program));
  return program;
}

const countTextureRows = (count) => Math.max(Math.ceil(count / TEXTURE_WIDTH), 1);

/** Positions and normals of one animation (one run of frames) in WebGL buffers. */
export class GpuMotion extends GroupedMotion {
  /** Whether an animation's positions and faces fit into textures. */
  static holds(gl, animation) {
    const corners = animation.objects.reduce((sum, { faceIndices }) => sum + faceIndices.length, 0);
    // A fan of n - 2 triangles has fewer than 3 n corners.
    return countTextureRows(Math.max(animation.vertexCount + 1, 3 * corners)) <= gl.getParameter(gl.MAX_TEXTURE_SIZE);
  }

  /**
   * @param {WebGL2RenderingContext} gl
   * @param {import("./pdeanim.js").PdeAnimation} animation
   * @param {Uint32Array[]} drawn for each pair of buffers, the vertices to write, in order [default: one pair with all]
   */
  constructor(gl, animation, drawn = [listVertices(animation)]) {
    super(animation);
    this.gl = gl;
    this.#sum = makeProgram(gl, SUM_SHADER, NO_FRAGMENTS, ["position"]);
    this.#draw = makeProgram(gl, DRAWN_SHADER, NO_FRAGMENTS, ["position", "normal"]);
    this.#feedback = gl.createTransformFeedback();
    // The sums are copied to a texture in whole rows.
    const size = 12 * TEXTURE_WIDTH * countTextureRows(this.vertexCount);
    this.#reference = this.#buffer(size, animation.reference());
    this.#sums = [this.#buffer(size), this.#buffer(size)];
    this.#latest = this.#sums[0];
    // The last binding point: other users of a shared context are unlikely to take it.
    this.#block = gl.getParameter(gl.MAX_UNIFORM_BUFFER_BINDINGS) - 1;
    this.#weights = gl.createBuffer();
    gl.bindBuffer(gl.UNIFORM_BUFFER, this.#weights);
    gl.bufferData(gl.UNIFORM_BUFFER, 16 * MAX_FUNCTIONS, gl.DYNAMIC_DRAW);
    gl.uniformBlockBinding(this.#sum, gl.getUniformBlockIndex(this.#sum, "Weights"), this.#block);
    this.#array = gl.createVertexArray();
    this._begin();
    this.#positionTexture = this.#texture(gl.RGB32F, gl.RGB, gl.FLOAT, new Float32Array(3 * this.vertexCount), 3);
    for (const sources of drawn) this.addDrawn(sources);
  }

  #sum;
  #draw;
  #feedback;
  #reference;
  #sums;
  #latest;
  #copied = null;
  #block;
  #weights;
  #array;
  #positionTexture;

  /** Whether a group's fields fit into a texture. */
  fits(index) {
    const { functionCount, axisCount } = this.animation.groups[index];
    const layers = axisCount === 3 ? functionCount : Math.ceil(functionCount / 4);
    const bytes = layers * countTextureRows(this.vertexCount) * TEXTURE_WIDTH * (axisCount === 3 ? 12 : 16);
    return (
      functionCount <= MAX_FUNCTIONS - WEIGHT_PADDING &&
      layers <= this.gl.getParameter(this.gl.MAX_ARRAY_TEXTURE_LAYERS) &&
      countTextureRows(this.vertexCount + 1) <= this.gl.getParameter(this.gl.MAX_TEXTURE_SIZE) &&
      bytes <= MAX_FIELD_BYTES
    );
  }

  _uploadPositions(positions) {
    this.#latest = this.#sums[0];
    this.#copied = null;
    this._upload(this.#latest, positions);
  }

  _upload(buffer, values) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
  }

  /** Read the first buffer of positions. */
  readPositions() {
    const { gl } = this;
    const found = new Float32Array(3 * this.drawn[0].count);
    gl.bindBuffer(gl.ARRAY_BUFFER, this.positions);
    gl.getBufferSubData(gl.ARRAY_BUFFER, 0, found);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    return found;
  }

  close() {
    const { gl } = this;
    super.close();
    for (const buffer of [this.#reference, ...this.#sums, this.#weights]) gl.deleteBuffer(buffer);
    gl.deleteTexture(this.#positionTexture);
    gl.deleteVertexArray(this.#array);
    gl.deleteTransformFeedback(this.#feedback);
    gl.deleteProgram(this.#sum);
    gl.deleteProgram(this.#draw);
  }

  _addGroups(time, near) {
    const { gl, animation } = this;
    const { frames, shares } = findFramesAround(animation.times, time);
    const program = this.#sum;
    const uniform = (name) => gl.getUniformLocation(program, name);
    let before = this.#reference;
    this.#copied = null;
    near.forEach((index, pass) => {
      const group = this._group(index);
      gl.useProgram(program);
      this.#attributes([before, 3]);
      gl.bindBufferBase(gl.UNIFORM_BUFFER, this.#block, this.#weights);
      gl.bufferSubData(gl.UNIFORM_BUFFER, 0, packWeights(animation, time, index, WEIGHT_PADDING));
      this.#bind(program, "fields", 0, gl.TEXTURE_2D_ARRAY, group.fields);
      this.#bind(program, "corrections", 1, gl.TEXTURE_2D, group.corrections);
      this.#bind(program, "starts", 2, gl.TEXTURE_2D, group.starts);
      gl.uniform1i(uniform("functions"), group.functionCount);
      gl.uniform1i(uniform("hasAxes"), group.axisCount === 3 ? 1 : 0);
      gl.uniform1i(uniform("hasCorrections"), group.hasCorrections ? 1 : 0);
      gl.uniform2f(uniform("frames"), ...frames);
      gl.uniform2f(uniform("shares"), ...shares);
      this.#latest = this.#sums[pass % 2];
      this.#run(this.vertexCount, this.#latest);
      before = this.#latest;
    });
    gl.bindBufferBase(gl.UNIFORM_BUFFER, this.#block, null);
  }

  _writeDrawn(pairs) {
    const { gl } = this;
    const program = this.#draw;
    if (this.#copied !== this.#latest) {
      gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, this.#latest);
      gl.activeTexture(gl.TEXTURE0);
      gl.bindTexture(gl.TEXTURE_2D, this.#positionTexture);
      gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, TEXTURE_WIDTH, countTextureRows(this.vertexCount), gl.RGB, gl.FLOAT, 0);
      gl.bindBuffer(gl.PIXEL_UNPACK_BUFFER, null);
      this.#copied = this.#latest;
    }
    gl.useProgram(program);
    this.#bind(program, "positions", 0, gl.TEXTURE_2D, this.#positionTexture);
    for (const { count, sources, fans, stored, around, positions, normals } of pairs) {
      this.#bind(program, "starts", 1, gl.TEXTURE_2D, around.starts);
      this.#bind(program, "others", 2, gl.TEXTURE_2D, around.others);
      this.#attributes([sources, 1], [fans, 1], [stored, 3]);
      this.#run(count, positions, normals);
    }
  }

  /** Bind buffers to the first locations of attributes: integers with one component, floats with three. */
  #attributes(...bound) {
    const { gl } = this;
    gl.bindVertexArray(this.#array);
    for (let place = 0; place < 3; place++) {
      const [buffer, components] = bound[place] ?? [];
      if (!buffer) {
        gl.disableVertexAttribArray(place);
        gl.vertexAttrib3f(place, 0, 0, 0);
        continue;
      }
      gl.enableVertexAttribArray(place);
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      if (components === 1) gl.vertexAttribIPointer(place, 1, gl.UNSIGNED_INT, 0, 0);
      else gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 0, 0);
    }
  }

  /** Run the current program once per vertex; write each output to its own buffer. */
  #run(count, ...into) {
    const { gl } = this;
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    if (count > 0) {
      gl.enable(gl.RASTERIZER_DISCARD);
      gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, this.#feedback);
      into.forEach((buffer, output) => gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, output, buffer));
      gl.beginTransformFeedback(gl.POINTS);
      gl.drawArrays(gl.POINTS, 0, count);
      gl.endTransformFeedback();
      into.forEach((_, output) => gl.bindBufferBase(gl.TRANSFORM_FEEDBACK_BUFFER, output, null));
      gl.bindTransformFeedback(gl.TRANSFORM_FEEDBACK, null);
      gl.disable(gl.RASTERIZER_DISCARD);
    }
    gl.bindVertexArray(null);
  }

  /** Reset how pixels are unpacked: other users of a shared context may have changed it. */
  _begin() {
    const { gl } = this;
    gl.pixelStorei(gl.UNPACK_FLIP_Y_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_PREMULTIPLY_ALPHA_WEBGL, false);
    gl.pixelStorei(gl.UNPACK_ALIGNMENT, 4);
  }

  #bind(program, name, unit, target, texture) {
    const { gl } = this;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(target, texture);
    gl.uniform1i(gl.getUniformLocation(program, name), unit);
  }

  _dropGroup({ fields, corrections, starts }) {
    for (const texture of [fields, corrections, starts]) this.gl.deleteTexture(texture);
  }

  _uploadGroup(index) {
    const { gl, animation, vertexCount } = this;
    const { functionCount, axisCount } = animation.groups[index];
    const fields = animation.fields(index);
    const layers = axisCount === 3 ? functionCount : Math.ceil(functionCount / 4);
    const texture = gl.createTexture();
    const rows = countTextureRows(vertexCount);
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D_ARRAY, texture);
    const [inside, outside] = axisCount === 3 ? [gl.RGB32F, gl.RGB] : [gl.RGBA32F, gl.RGBA];
    gl.texStorage3D(gl.TEXTURE_2D_ARRAY, 1, inside, TEXTURE_WIDTH, rows, Math.max(layers, 1));
    const columns = axisCount === 3 ? 3 : 4;
    const layer = new Float32Array(TEXTURE_WIDTH * rows * columns);
    for (let k = 0; k < layers; k++) {
      if (axisCount === 3) {
        layer.set(fields.subarray(3 * k * vertexCount, 3 * (k + 1) * vertexCount));
      } else {
        for (let column = 0; column < 4; column++) {
          const from = (4 * k + column) * vertexCount;
          const is = 4 * k + column < functionCount;
          for (let v = 0; v < vertexCount; v++) layer[4 * v + column] = is ? fields[from + v] : 0;
        }
      }
      gl.texSubImage3D(gl.TEXTURE_2D_ARRAY, 0, 0, 0, k, TEXTURE_WIDTH, rows, 1, outside, gl.FLOAT, layer);
    }
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D_ARRAY, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return { functionCount, axisCount, fields: texture, ...this.#uploadCorrections(index) };
  }

  #uploadCorrections(index) {
    const { gl } = this;
    const { starts, rows } = sortCorrectionsByVertex(this.animation, index);
    return {
      hasCorrections: rows.length > 0,
      corrections: this.#texture(gl.RGBA32F, gl.RGBA, gl.FLOAT, rows, 4),
      starts: this.#texture(gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, starts, 1),
    };
  }

  _store(values) {
    return this.#buffer(values.byteLength, values);
  }

  _allocate(size) {
    return this.#buffer(size);
  }

  _free(buffer) {
    this.gl.deleteBuffer(buffer);
  }

  _storeAround(starts, others) {
    const { gl } = this;
    return {
      starts: this.#texture(gl.R32UI, gl.RED_INTEGER, gl.UNSIGNED_INT, starts, 1),
      others: this.#texture(gl.RG32UI, gl.RG_INTEGER, gl.UNSIGNED_INT, others, 2),
    };
  }

  _freeAround({ starts, others }) {
    for (const texture of [starts, others]) this.gl.deleteTexture(texture);
  }

  #buffer(size, values) {
    const { gl } = this;
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
    gl.bufferData(gl.ARRAY_BUFFER, size, gl.DYNAMIC_COPY);
    if (values) gl.bufferSubData(gl.ARRAY_BUFFER, 0, values);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
    return buffer;
  }

  #texture(inside, outside, type, values, columns) {
    const { gl } = this;
    const rows = countTextureRows(values.length / columns);
    const padded = new values.constructor(TEXTURE_WIDTH * rows * columns);
    padded.set(values);
    const texture = gl.createTexture();
    gl.activeTexture(gl.TEXTURE0);
    gl.bindTexture(gl.TEXTURE_2D, texture);
    gl.texImage2D(gl.TEXTURE_2D, 0, inside, TEXTURE_WIDTH, rows, 0, outside, type, padded);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, gl.NEAREST);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, gl.NEAREST);
    return texture;
  }
}
