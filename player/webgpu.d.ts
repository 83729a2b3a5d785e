import { GroupedMotion } from "./motion.js";
import type { PdeAnimation } from "./pdeanim.js";

/**
 * Positions and normals of one animation (one run of frames) in vertex and storage buffers: three floats per vertex.
 */
export class WebGpuMotion extends GroupedMotion<GPUBuffer> {
  /** Whether an animation's positions and faces fit the device's limits on bindings and dispatches. */
  static holds(device: GPUDevice, animation: PdeAnimation): boolean;
  /** `drawn`: for each pair of buffers, the vertices to write, in order; by default one pair with all vertices. */
  constructor(device: GPUDevice, animation: PdeAnimation, drawn?: Uint32Array[]);
  readPositions(): Promise<Float32Array>;
}
