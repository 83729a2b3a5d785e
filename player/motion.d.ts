import type { PdeAnimation } from "./pdeanim.js";

/** What is drawn: positions and normals of vertices in an order, as vertex attributes of three floats. */
export interface DrawnBuffers<Buffer> {
  count: number;
  sources: Buffer;
  positions: Buffer;
  normals: Buffer;
}

/** Positions and normals of one animation (one run of frames), in buffers of a graphics processor. */
export abstract class GroupedMotion<Buffer> {
  readonly animation: PdeAnimation;
  readonly vertexCount: number;
  readonly drawn: DrawnBuffers<Buffer>[];
  /** The first pair of buffers. */
  readonly positions: Buffer;
  readonly normals: Buffer;
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
  close(): void;
}
