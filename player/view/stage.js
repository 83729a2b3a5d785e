/** Draws models shaded, as wireframes, or coloured by patch or by values; one, two side by side, or two overlaid. */
import { makeProgram } from "pdeanim/gpu.js";

import { MAPS } from "pdeanim/view/fields.js";
import { parseColour } from "pdeanim/view/panel.js";

const VERTEX = `#version 300 es
precision highp float;
in vec3 position;
in vec3 normal;
in vec4 colour;
in vec2 value;
uniform mat4 projection;
uniform float pointSize;
out vec3 place;
out vec3 direction;
out vec4 own;
out vec2 shown;
void main() {
  gl_Position = projection * vec4(position, 1.0);
  gl_PointSize = pointSize;
  place = position;
  direction = normal;
  own = colour;
  shown = value;
}`;

/** Largest number of colours of a map. */
const MOST_STOPS = 9;

// `shown` is a share of the range, and 1 where there is a value: a triangle with a corner that has none is grey.
const FRAGMENT = `#version 300 es
precision highp float;
in vec3 place;
in vec3 direction;
in vec4 own;
in vec2 shown;
uniform vec3 light;
uniform vec3 plain;
uniform vec3 missing;
uniform int colouring;
uniform int shading;
uniform vec3 stops[${MOST_STOPS}];
uniform int lastStop;
out vec4 result;
vec3 ramp(float share) {
  float at = clamp(share, 0.0, 1.0) * float(lastStop);
  int low = min(int(at), lastStop - 1);
  return mix(stops[low], stops[low + 1], at - float(low));
}
void main() {
  vec3 base = colouring == 1 ? own.rgb : colouring == 0 ? plain : shown.y > 0.999 ? ramp(shown.x) : missing;
  vec3 facing = shading == 1 ? normalize(cross(dFdx(place), dFdy(place))) : normalize(direction);
  float lit = shading == 2 || dot(direction, direction) == 0.0 && shading == 0 ? 1.0 : abs(dot(facing, light));
  // Colours that stand for values are shaded less, so that they can be read.
  lit = colouring == 2 ? 0.8 + 0.2 * lit : 0.35 + 0.65 * lit;
  result = vec4(base * lit, 1.0);
}`;

export const COLOURING = { plain: 0, patches: 1, values: 2 };
const SHADING = { smooth: 0, flat: 1, none: 2 };
const ATTRIBUTES = ["position", "normal", "colour", "value"];

export class Stage {
  constructor(gl) {
    this.gl = gl;
    this.program = makeProgram(gl, VERTEX, FRAGMENT);
    this.array = gl.createVertexArray();
    this.places = Object.fromEntries(ATTRIBUTES.map((name) => [name, gl.getAttribLocation(this.program, name)]));
    this.uniforms = new Map();
  }

  /** Draw `views` on the canvas: each has a horizontal range (fractions of the width) and the items to draw there. */
  draw(views, camera, look) {
    const { gl } = this;
    const { width, height } = gl.canvas;
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.viewport(0, 0, width, height);
    gl.clearColor(...look.page, 1);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    gl.enable(gl.DEPTH_TEST);
    gl.useProgram(this.program);
    gl.uniform3fv(this.#uniform("light"), camera.axes().back);
    for (const { from, to, items } of views) {
      const [left, right] = [Math.round(from * width), Math.round(to * width)];
      gl.viewport(left, 0, right - left, height);
      gl.uniformMatrix4fv(this.#uniform("projection"), false, camera.matrix((right - left) / height));
      for (const item of items) this.#drawItem(item, look);
    }
    gl.bindVertexArray(null);
  }

  #drawItem({ model, object, shading, colouring, map, isSplit, plain }, look) {
    const { gl } = this;
    if (colouring === "values") {
      const stops = MAPS[map].map(parseColour);
      gl.uniform3fv(this.#uniform("stops"), stops.flat());
      gl.uniform1i(this.#uniform("lastStop"), stops.length - 1);
      gl.uniform3fv(this.#uniform("missing"), look.missing);
    }
    gl.uniform1i(this.#uniform("colouring"), COLOURING[colouring]);
    gl.uniform1f(this.#uniform("pointSize"), look.pointSize);
    gl.uniform3fv(this.#uniform("plain"), plain);
    this.#bindAttributes(model, colouring, isSplit);
    if (shading !== "wireframe") {
      gl.enable(gl.POLYGON_OFFSET_FILL);
      gl.polygonOffset(1, 1);
      this.#elements(model, "triangles", gl.TRIANGLES, object, shading === "flat" ? SHADING.flat : SHADING.smooth, isSplit);
      gl.disable(gl.POLYGON_OFFSET_FILL);
    }
    const isWired = shading === "wireframe" || shading === "edges";
    const [, faces] = model.part("triangles", object);
    if (isSplit) this.#bindAttributes(model, "plain", false);
    if (shading === "edges" || isSplit) {
      gl.uniform1i(this.#uniform("colouring"), COLOURING.plain);
      gl.uniform3fv(this.#uniform("plain"), plain.map((value) => (faces ? 0.45 : 1) * value));
    }
    if (isWired || !faces) this.#elements(model, "edges", gl.LINES, object, SHADING.none);
    this.#elements(model, "points", gl.POINTS, object, SHADING.none);
  }

  #bindAttributes(model, colouring, isSplit) {
    const { gl, places } = this;
    const bind = (name, buffer, size, type, isNormalised) => {
      if (places[name] < 0) return;
      if (!buffer) {
        gl.disableVertexAttribArray(places[name]);
        return;
      }
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.enableVertexAttribArray(places[name]);
      gl.vertexAttribPointer(places[name], size, type, isNormalised, 0, 0);
    };
    if (colouring === "patches") model.colourElements();
    gl.bindVertexArray(this.array);
    const { positions, normals } = model.motion.drawn[isSplit ? 1 : 0];
    bind("position", positions, 3, gl.FLOAT, false);
    bind("normal", normals, 3, gl.FLOAT, false);
    bind("colour", colouring === "patches" ? model.colours : null, 4, gl.UNSIGNED_BYTE, true);
    bind("value", isSplit ? model.cornerValues : model.values, 2, gl.FLOAT, false);
    gl.bindBuffer(gl.ARRAY_BUFFER, null);
  }

  #elements(model, name, mode, object, shading, isSplit = false) {
    const { gl } = this;
    const [first, count] = model.part(name, object);
    if (!count) return;
    gl.uniform1i(this.#uniform("shading"), shading);
    if (isSplit) {
      gl.drawArrays(mode, first, count);
      return;
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, model[name].buffer);
    gl.drawElements(mode, count, gl.UNSIGNED_INT, 4 * first);
  }

  #uniform(name) {
    if (!this.uniforms.has(name)) this.uniforms.set(name, this.gl.getUniformLocation(this.program, name));
    return this.uniforms.get(name);
  }
}
