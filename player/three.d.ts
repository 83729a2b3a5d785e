import type { Group, Loader, WebGLRenderer } from "three";
import type { WebGPURenderer } from "three/webgpu";

import type { PdeAnimation } from "./pdeanim.js";

/** A mesh (or line segments, or points) for each object of a file, in its children; materials may be replaced. */
export class DeformingGroup extends Group {
  /**
   * With a renderer (a `WebGPURenderer` after its `init()`), its graphics processor evaluates; the decoder does where there is
   * none, and what does not fit.
   */
  constructor(animation: PdeAnimation, options?: { renderer?: WebGLRenderer | WebGPURenderer | null });
  readonly animation: PdeAnimation;
  /** Seconds from the first frame to the last one. */
  readonly duration: number;
  /** Show the shape at a time [s] from the clip's start. */
  setTime(seconds: number): void;
  /** Whether the graphics processor made the shape that is shown. */
  readonly isOnGpu: boolean;
  /** Upload the frames that come after those of now, when there is time for it. */
  prefetch(): void;
  dispose(): void;
}

/** Loads `.pdeanim` files, as three's own loaders load theirs. */
export class PDEAnimLoader extends Loader<DeformingGroup> {
  /** Evaluate on the graphics processor of a renderer, the one that will draw; null for the decoder. */
  setRenderer(renderer: WebGLRenderer | WebGPURenderer | null): this;
  load(
    url: string,
    onLoad: (group: DeformingGroup) => void,
    onProgress?: (event: ProgressEvent) => void,
    onError?: (error: unknown) => void,
  ): void;
  parse(
    data: ArrayBuffer | ArrayBufferView,
    onLoad: (group: DeformingGroup) => void,
    onError?: (error: unknown) => void,
  ): void;
  parseAsync(data: ArrayBuffer | ArrayBufferView): Promise<DeformingGroup>;
}
