import type { PdeAnimation } from "./pdeanim.js";

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
  /** Compute positions and normals at a time [s]. */
  evaluate(time: number): void;
  /** Show the given positions and compute their normals. */
  show(positions: Float32Array): void;
  close(): void;
}
