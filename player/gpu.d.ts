import type { PdeAnimation } from "./pdeanim.js";

/** Positions and normals of one animation (one run of frames), in WebGL buffers: vertex attributes of three floats. */
export class GpuMotion {
  /** Whether positions and faces of an animation fit into textures. */
  static holds(gl: WebGL2RenderingContext, animation: PdeAnimation): boolean;
  /** `drawn`: of each pair of buffers the vertices that it holds, in order; all in one where nothing is said. */
  constructor(gl: WebGL2RenderingContext, animation: PdeAnimation, drawn?: Uint32Array[]);
  readonly vertexCount: number;
  readonly drawn: { count: number; sources: WebGLBuffer; positions: WebGLBuffer; normals: WebGLBuffer }[];
  /** The first pair of buffers. */
  readonly positions: WebGLBuffer;
  readonly normals: WebGLBuffer;
  /** Whether the last positions were made by the graphics processor, not by the decoder. */
  readonly isOnGpu: boolean;
  /** Whether a group's fields fit. */
  fits(group: number): boolean;
  /** Groups that count at a time [s] as far as float32 goes. */
  groupsNear(time: number): number[];
  /** Upload a group ahead of its time. */
  prefetch(group: number): void;
  /** Upload the group that comes after a time [s], if there is one. */
  prefetchAfter(time: number): void;
  /** Make positions and normals at a time [s]. */
  evaluate(time: number): void;
  /** Take positions from elsewhere, and make normals of them. */
  show(positions: Float32Array): void;
  readPositions(): Float32Array;
  close(): void;
}

/** A program of two shaders; `outputs`: what the first one writes to buffers. */
export function makeProgram(
  gl: WebGL2RenderingContext,
  vertex: string,
  fragment: string,
  outputs?: string[],
): WebGLProgram;

/** The last frame that is not after a time; the first one before all. */
export function frameAt(times: Float64Array, time: number): number;
