/** Evaluation on the graphics processor of a three.js renderer, in buffers that its geometries draw from. */
import { BufferAttribute, GLBufferAttribute } from "three";

import { GpuMotion } from "./gpu.js";
import { Graphics } from "./graphics.js";
import { WebGpuMotion } from "./webgpu.js";

const known = new WeakMap();

/** Return the evaluator of a renderer's graphics processor, or null if it cannot evaluate. */
export function graphicsOf(renderer) {
  if (renderer && !known.has(renderer)) {
    const { backend } = renderer;
    if (renderer.isWebGLRenderer && renderer.capabilities.isWebGL2) known.set(renderer, new WebGlGraphics(renderer));
    else if (backend?.isWebGPUBackend && backend.device) known.set(renderer, new WebGpuGraphics(backend));
    else return null;
  }
  return known.get(renderer) ?? null;
}

class WebGlGraphics extends Graphics {
  constructor(renderer) {
    super(GpuMotion, () => renderer.getContext());
    this.renderer = renderer;
    renderer.domElement.addEventListener("webglcontextrestored", () => this.restore(), true);
  }

  #depth = 0;

  attribute(buffer, count, getComponent) {
    const attribute = new GLBufferAttribute(buffer, this.renderer.getContext().FLOAT, 3, 4, count);
    return Object.assign(attribute, makeGetters(getComponent));
  }

  /** Do work in the renderer's context, then make the renderer reset its cached state. */
  work(work) {
    const { renderer } = this;
    if (this.#depth > 0) return work();
    const [target, face, level] = [
      renderer.getRenderTarget(),
      renderer.getActiveCubeFace(),
      renderer.getActiveMipmapLevel(),
    ];
    this.#depth++;
    try {
      return work();
    } finally {
      this.#depth--;
      renderer.resetState();
      renderer.setRenderTarget(target, face, level);
    }
  }
}

/** A lost device of WebGPU does not come back: nothing restores. */
class WebGpuGraphics extends Graphics {
  constructor(backend) {
    super(WebGpuMotion, () => backend.device);
    this.backend = backend;
  }

  /** Make an attribute and give it its buffer before the renderer would create one. */
  attribute(buffer, count, getComponent) {
    const attribute = new BufferAttribute(new Float32Array(0), 3);
    attribute.count = count;
    this.backend.get(attribute).buffer = buffer;
    return Object.assign(attribute, makeGetters(getComponent));
  }
}

/** Return getters for an attribute on the graphics processor, for rays and boxes: they read the decoder's values. */
function makeGetters(getComponent) {
  return {
    getComponent,
    getX: (index) => getComponent(index, 0),
    getY: (index) => getComponent(index, 1),
    getZ: (index) => getComponent(index, 2),
    // three.js reads four components of any attribute that a ray hits, and uses three of a normal.
    getW: () => 0,
  };
}
