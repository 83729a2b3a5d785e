import type { Group, Loader } from "three";

import type { PdeAnimation } from "./pdeanim.js";

/** A mesh for each object of a file, in its children; materials may be replaced. */
export class DeformingGroup extends Group {
  constructor(animation: PdeAnimation);
  readonly animation: PdeAnimation;
  /** Seconds from the first frame to the last one. */
  readonly duration: number;
  /** Show the shape at a time [s] from the clip's start. */
  setTime(seconds: number): void;
  dispose(): void;
}

/** Loads `.pdeanim` files, as three's own loaders load theirs. */
export class PDEAnimLoader extends Loader<DeformingGroup> {
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
