/** Shaders of `gpu.js` (WebGL 2), and the sizes that are part of them. */

/** Width of a texture in vertices. Every graphics processor supports it; any other supported width works as well. */
export const TEXTURE_WIDTH = 1024;

/** Largest number of functions of time in a group: a uniform block holds so many weights on every device. */
export const MAX_FUNCTIONS = 1024;

/** Sums the weighted fields of a group, and adds the corrections at the two frames around the time. */
export const SUM_SHADER = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
precision highp sampler2DArray;
layout(location = 0) in vec3 before;
uniform sampler2DArray fields;
uniform sampler2D corrections;
uniform usampler2D starts;
uniform int functions;
uniform bool hasAxes;
uniform bool hasCorrections;
uniform vec2 frames;
uniform vec2 shares;
layout(std140) uniform Weights { vec4 weights[${MAX_FUNCTIONS}]; };
out vec3 position;

ivec2 place(int index) { return ivec2(index % ${TEXTURE_WIDTH}, index / ${TEXTURE_WIDTH}); }

vec3 correctionAt(float frame, uint begin, uint end) {
  while (begin < end) {
    uint middle = (begin + end) / 2u;
    vec4 found = texelFetch(corrections, place(int(middle)), 0);
    if (found.w == frame) return found.xyz;
    if (found.w < frame) begin = middle + 1u; else end = middle;
  }
  return vec3(0.0);
}

void main() {
  ivec2 here = place(gl_VertexID);
  vec3 moved = vec3(0.0);
  if (hasAxes) {
    for (int k = 0; k < functions; k++) moved += weights[k].x * texelFetch(fields, ivec3(here, k), 0).xyz;
  } else {
    for (int k = 0; k < functions; k += 4) {
      vec4 four = texelFetch(fields, ivec3(here, k / 4), 0);
      moved += four.x * weights[k].xyz + four.y * weights[k + 1].xyz;
      moved += four.z * weights[k + 2].xyz + four.w * weights[k + 3].xyz;
    }
  }
  if (hasCorrections) {
    uint begin = texelFetch(starts, here, 0).x;
    uint end = texelFetch(starts, place(gl_VertexID + 1), 0).x;
    moved += shares.x * correctionAt(frames.x, begin, end);
    if (shares.y > 0.0) moved += shares.y * correctionAt(frames.y, begin, end);
  }
  position = before + moved;
}`;

/** Computes normals, and writes positions and normals in drawing order. */
export const DRAWN_SHADER = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;
uniform sampler2D positions;
uniform usampler2D starts;
uniform usampler2D others;
layout(location = 0) in uint source;
layout(location = 1) in uint fan;
layout(location = 2) in vec3 stored;
out vec3 position;
out vec3 normal;

ivec2 place(int index) { return ivec2(index % ${TEXTURE_WIDTH}, index / ${TEXTURE_WIDTH}); }
vec3 at(uint vertex) { return texelFetch(positions, place(int(vertex)), 0).xyz; }

void main() {
  position = at(source);
  int begin = int(texelFetch(starts, place(int(fan)), 0).x);
  int end = int(texelFetch(starts, place(int(fan) + 1), 0).x);
  vec3 sum = vec3(0.0);
  for (int k = begin; k < end; k++) {
    uvec2 pair = texelFetch(others, place(k), 0).xy;
    sum += cross(at(pair.x) - position, at(pair.y) - position);
  }
  float size = length(sum);
  normal = size > 0.0 ? sum / size : stored;
}`;

export const NO_FRAGMENTS = `#version 300 es
precision highp float;
void main() {}`;
