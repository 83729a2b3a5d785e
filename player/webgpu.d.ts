import { GroupedMotion } from "./motion.js";
import type { PdeAnimation } from "./pdeanim.js";

/** Positions and normals of one animation (one run of frames), in vertex and storage buffers: three floats a vertex. */
export class WebGpuMotion extends GroupedMotion<GPUBuffer> {
  /** Whether positions and faces of an animation fit into what a device binds and dispatches. */
  static holds(device: GPUDevice, animation: PdeAnimation): boolean;
  /** `drawn`: of each pair of buffers the vertices that it holds, in order; all in one where nothing is said. */
  constructor(device: GPUDevice, animation: PdeAnimation, drawn?: Uint32Array[]);
  readPositions(): Promise<Float32Array>;
}
