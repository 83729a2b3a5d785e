import { Extension, ExtensionProperty, type Animation, type ReaderContext, type WriterContext } from "@gltf-transform/core";

/** Name of the attribute that maps a primitive's vertices to those of the motion, in documents. */
export const VERTEX_ATTRIBUTE: "_PDECODEC_VERTEX";

/** A `.pdeanim` file and its place in time. */
export class Motion extends ExtensionProperty {
  static EXTENSION_NAME: "PDECODEC_mesh_motion";
  extensionName: "PDECODEC_mesh_motion";
  propertyType: "Motion";
  parentTypes: ["MeshMotions", "PrimitiveMotion"];
  init(): void;
  /** The bytes of the file. */
  getData(): Uint8Array;
  setData(data: Uint8Array): this;
  /** `duration` and `startTime` [s], `frameRate` [frames/s]. */
  getSettings(): { duration: number; startTime?: number; frameRate?: number };
  setSettings(settings: { duration: number; startTime?: number; frameRate?: number }): this;
  /** The animation that the motion is a part of, or null. */
  getAnimation(): Animation | null;
  setAnimation(animation: Animation | null): this;
}

/** The motions of a document; the root has them. */
export class MeshMotions extends ExtensionProperty {
  static EXTENSION_NAME: "PDECODEC_mesh_motion";
  extensionName: "PDECODEC_mesh_motion";
  propertyType: "MeshMotions";
  parentTypes: ["Root"];
  init(): void;
  listMotions(): Motion[];
  addMotion(motion: Motion): this;
}

/** Which motion moves a primitive, and its bounds at all times. */
export class PrimitiveMotion extends ExtensionProperty {
  static EXTENSION_NAME: "PDECODEC_mesh_motion";
  extensionName: "PDECODEC_mesh_motion";
  propertyType: "PrimitiveMotion";
  parentTypes: ["Primitive"];
  init(): void;
  getMotion(): Motion | null;
  setMotion(motion: Motion | null): this;
  getSettings(): { min: number[]; max: number[]; firstVertex?: number };
  setSettings(settings: { min: number[]; max: number[]; firstVertex?: number }): this;
}

/** Keeps the extension: `io.registerExtensions([PDECODECMeshMotion])`. */
export class PDECODECMeshMotion extends Extension {
  static EXTENSION_NAME: "PDECODEC_mesh_motion";
  extensionName: "PDECODEC_mesh_motion";
  createMotion(name?: string): Motion;
  createMotions(): MeshMotions;
  createPrimitiveMotion(): PrimitiveMotion;
  read(context: ReaderContext): this;
  write(context: WriterContext): this;
}
