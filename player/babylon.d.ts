import type { Vector2 } from "@babylonjs/core/Maths/math.vector.js";

/**
 * Have Babylon.js's glTF loader play the extension PDECODEC_mesh_motion: motions are animation groups. The graphics processor
 * evaluates (WebGL 2, WebGPU), or the decoder if a clip does not fit there. Copies of a mesh share both and have a time of
 * their own. Disposing of all meshes of a file frees everything.
 */
export function registerMeshMotion(): void;

/** What meshes that a motion moves have besides what meshes of Babylon.js have. */
export interface MovedByMotion {
  /** Sum of weighted seconds since the first frame, and sum of weights: animations write them. */
  motionState: Vector2;
  /** Whether the graphics processor computed the shape that is shown. */
  readonly isOnGpu: boolean;
}
