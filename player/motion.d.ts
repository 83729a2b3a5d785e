import type { PdeAnimation } from "./pdeanim.js";

/** Which corners of triangles share a normal: those of one fan. */
export interface Fans {
  /** The fan of each drawn vertex. */
  of: Uint32Array;
  /** Normals of drawn vertices, kept where the triangles of a fan have no area. */
  stored: Float32Array;
  /** Vertices of the triangles, and the fan of each of their corners. */
  triangles: Uint32Array;
  corners: Uint32Array;
  /** Number of fans. */
  count: number;
}

/** One pair of buffers to draw from: positions and normals of listed vertices, as vertex attributes of three floats. */
export interface DrawnBuffers<Buffer> {
  count: number;
  sources: Buffer;
  positions: Buffer;
  normals: Buffer;
}

/** Positions and normals of one animation (one run of frames) in buffers of a graphics processor. */
export abstract class GroupedMotion<Buffer> {
  readonly animation: PdeAnimation;
  readonly vertexCount: number;
  readonly drawn: DrawnBuffers<Buffer>[];
  /** Buffers of the first pair. */
  readonly positions: Buffer;
  readonly normals: Buffer;
  /** Whether the graphics processor, not the decoder, computed the latest positions. */
  readonly isOnGpu: boolean;
  /** Whether a group's fields fit on the graphics processor. */
  fits(group: number): boolean;
  /** Groups whose weight at a time [s] float32 can resolve. */
  groupsNear(time: number): number[];
  /** Upload a group before it is needed. */
  prefetch(group: number): void;
  /** Upload the group that follows a time [s], if there is one. */
  prefetchAfter(time: number): void;
  /** Add a pair of buffers for listed vertices; without `fans`, all corners at a vertex share a normal. */
  addDrawn(sources: Uint32Array, fans?: Fans | null): DrawnBuffers<Buffer>;
  removeDrawn(pair: DrawnBuffers<Buffer>): void;
  /** Compute positions and normals at a time [s] into pairs of buffers; by default all. */
  evaluate(time: number, pairs?: DrawnBuffers<Buffer>[]): void;
  /** Fill one pair of buffers with given positions, and normals if there are any, of its vertices. */
  write(pair: DrawnBuffers<Buffer>, positions: Float32Array, normals: Float32Array | null): void;
  /** Show the given positions and compute their normals. */
  show(positions: Float32Array): void;
  close(): void;
}
