/** Evaluation on the graphics processor of a three.js renderer, in buffers that its geometries draw from. */
import { BufferAttribute, GLBufferAttribute } from "three";

import { GpuMotion } from "./gpu.js";
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

/** Motions by run of frames, each shared by all geometries that show the run. */
class Graphics {
  #motions = new Map();

  /** Return the motion of a run; its geometries call `restore` again when a lost context is back. */
  borrow(run, geometry) {
    if (!this.#motions.has(run)) {
      this.#motions.set(run, { motion: this.work(() => this.makeMotion(run)), users: new Set() });
    }
    const { motion, users } = this.#motions.get(run);
    users.add(geometry);
    return motion;
  }

  giveBack(run, geometry) {
    const found = this.#motions.get(run);
    if (!found?.users.delete(geometry) || found.users.size > 0) return;
    this.work(() => found.motion.close());
    this.#motions.delete(run);
  }

  /** Upload everything again after a lost context. */
  restore() {
    const users = [...this.#motions.values()].flatMap((found) => [...found.users]);
    this.#motions.clear();
    for (const geometry of users) geometry.restore();
  }
}

class WebGlGraphics extends Graphics {
  constructor(renderer) {
    super();
    this.renderer = renderer;
    renderer.domElement.addEventListener("webglcontextrestored", () => this.restore(), true);
  }

  #depth = 0;

  holds(run) {
    return GpuMotion.holds(this.renderer.getContext(), run);
  }

  makeMotion(run) {
    return new GpuMotion(this.renderer.getContext(), run, []);
  }

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
    super();
    this.backend = backend;
  }

  holds(run) {
    return WebGpuMotion.holds(this.backend.device, run);
  }

  makeMotion(run) {
    return new WebGpuMotion(this.backend.device, run, []);
  }

  /** Make an attribute and give it its buffer before the renderer would create one. */
  attribute(buffer, count, getComponent) {
    const attribute = new BufferAttribute(new Float32Array(0), 3);
    attribute.count = count;
    this.backend.get(attribute).buffer = buffer;
    return Object.assign(attribute, makeGetters(getComponent));
  }

  work(work) {
    return work();
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
