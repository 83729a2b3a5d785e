/** Evaluation on the graphics processor of a Babylon.js engine, in buffers that its meshes draw from. */
import { Buffer, VertexBuffer } from "@babylonjs/core/Buffers/buffer.js";
import { WebGLDataBuffer } from "@babylonjs/core/Meshes/WebGL/webGLDataBuffer.js";
import { WebGPUDataBuffer } from "@babylonjs/core/Meshes/WebGPU/webgpuDataBuffer.js";

import { GpuMotion } from "./gpu.js";
import { Graphics } from "./graphics.js";
import { WebGpuMotion } from "./webgpu.js";

const known = new WeakMap();

/** Return the evaluator of an engine's graphics processor, or null if it cannot evaluate. */
export function graphicsOf(engine) {
  if (!engine.isWebGPU && !(engine._gl && engine.webGLVersion >= 2)) return null;
  if (!known.has(engine)) known.set(engine, new EngineGraphics(engine));
  return known.get(engine);
}

class EngineGraphics extends Graphics {
  constructor(engine) {
    if (engine.isWebGPU) super(WebGpuMotion, () => engine._device);
    else super(GpuMotion, () => engine._gl);
    this.engine = engine;
    engine.onContextRestoredObservable.add(() => this.restore());
  }

  /** Do work in the engine's context, then make the engine forget the state that it cached. */
  work(work) {
    try {
      return work();
    } finally {
      if (!this.engine.isWebGPU) this.engine.wipeCaches(true);
    }
  }

  /** Return a vertex buffer of three floats on the graphics processor, which Babylon.js frees; `read` returns its values. */
  vertexBuffer(kind, buffer, read) {
    const DataBuffer = this.engine.isWebGPU ? WebGPUDataBuffer : WebGLDataBuffer;
    const data = Object.assign(new DataBuffer(buffer), { references: 1 });
    const options = { type: VertexBuffer.FLOAT, size: 3, takeBufferOwnership: true };
    return new VertexBuffer(this.engine, new ReadBuffer(this.engine, data, read), kind, options);
  }
}

/** A buffer whose values rays, boxes and copies read from elsewhere. */
class ReadBuffer extends Buffer {
  constructor(engine, data, read) {
    super(engine, data, false, 3);
    this.getData = read;
  }

  /** Leave a lost buffer: another one replaces it. */
  _rebuild() {}
}
