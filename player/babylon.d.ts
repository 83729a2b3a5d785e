import type { Vector2 } from "@babylonjs/core/Maths/math.vector.js";

/**
 * Have Babylon.js's glTF loader play the extension PDECODEC_mesh_motion: motions are animation groups. The decoder evaluates;
 * copies of a mesh share it and have a time of their own. Disposing of all meshes of a file frees it.
 */
export function registerMeshMotion(): void;

/** What meshes that a motion moves have besides what meshes of Babylon.js have. */
export interface MovedByMotion {
  /** Sum of weighted seconds since the first frame, and sum of weights: animations write them. */
  motionState: Vector2;
}
