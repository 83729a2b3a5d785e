import { GroupedMotion } from "./motion.js";
import type { PdeAnimation } from "./pdeanim.js";

/** Positions and normals of one animation (one run of frames), in WebGL buffers: vertex attributes of three floats. */
export class GpuMotion extends GroupedMotion<WebGLBuffer> {
  /** Whether positions and faces of an animation fit into textures. */
  static holds(gl: WebGL2RenderingContext, animation: PdeAnimation): boolean;
  /** `drawn`: of each pair of buffers the vertices that it holds, in order; all in one where nothing is said. */
  constructor(gl: WebGL2RenderingContext, animation: PdeAnimation, drawn?: Uint32Array[]);
  readPositions(): Float32Array;
}

/** A program of two shaders; `outputs`: what the first one writes to buffers. */
export function makeProgram(
  gl: WebGL2RenderingContext,
  vertex: string,
  fragment: string,
  outputs?: string[],
): WebGLProgram;
