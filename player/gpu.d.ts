import { GroupedMotion } from "./motion.js";
import type { PdeAnimation } from "./pdeanim.js";

/** Positions and normals of one animation (one run of frames) in WebGL buffers: vertex attributes of three floats. */
export class GpuMotion extends GroupedMotion<WebGLBuffer> {
  /** Whether an animation's positions and faces fit into textures. */
  static holds(gl: WebGL2RenderingContext, animation: PdeAnimation): boolean;
  /** `drawn`: for each pair of buffers, the vertices to write, in order; by default one pair with all vertices. */
  constructor(gl: WebGL2RenderingContext, animation: PdeAnimation, drawn?: Uint32Array[]);
  readPositions(): Float32Array;
}

/** Compile and link a program; `outputs` names the variables that transform feedback captures. */
export function makeProgram(
  gl: WebGL2RenderingContext,
  vertex: string,
  fragment: string,
  outputs?: string[],
): WebGLProgram;
