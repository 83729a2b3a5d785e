import type { Group, Loader, Mesh, Object3D, WebGLRenderer } from "three";
import type { GLTF, GLTFLoaderPlugin, GLTFParser } from "three/addons/loaders/GLTFLoader.js";
import type { WebGPURenderer } from "three/webgpu";

import type { PdeAnimation } from "./pdeanim.js";

export interface FieldColourOptions {
  /**
   * Default "viridis"; or CSS colours at equal distances. null: no colours; `geometry.attributes.field` holds the numbers,
   * NaN for vertices without a value.
   */
  colormap?: "viridis" | "coolwarm" | string[] | null;
  /** Values at both ends of the colours [default: those of the source; for a magnitude, from 0]. */
  range?: [low: number, high: number];
  /** The component to show [default: the only one, or the magnitude of all]. */
  component?: number;
}

/**
 * Holds a mesh (or line segments, or points) for each object of a file as children; you may replace their materials.
 */
export class DeformingGroup extends Group {
  /**
   * `renderer`: evaluate on its graphics processor (a `WebGPURenderer` only after its `init()`). Without one, or if the
   * clip does not fit there, the decoder evaluates.
   */
  constructor(animation: PdeAnimation, options?: { renderer?: WebGLRenderer | WebGPURenderer | null });
  readonly animation: PdeAnimation;
  /** Seconds from the first frame to the last one. */
  readonly duration: number;
  /** Show the shape at a time [s], counted from the start of the clip. */
  setTime(seconds: number): void;
  /**
   * Colour all meshes by a field (`animation.fieldList`); null ends it. Sets `vertexColors` of their materials; materials
   * that you set later need it, too. Objects without the field, and values that are no numbers, are grey.
   */
  setField(name: string | null, options?: FieldColourOptions): void;
  /** The vertex of the file's object that each vertex of a mesh is. */
  sourcesOf(mesh: Object3D): Uint32Array;
  /**
   * Take materials from a glTF file that `GLTFLoader` has loaded: by their names, or by the names of meshes. UVs turn to
   * glTF's convention (V down), which its textures expect.
   */
  useMaterialsFrom(gltf: Pick<GLTF, "scene">): void;
  /** Return a group that shares the decoder and the materials, with a time of its own. */
  clone(recursive?: boolean): this;
  /** Whether the graphics processor computed the shape that is shown. */
  readonly isOnGpu: boolean;
  /** Upload the next group of frames, when there is time to spare. */
  prefetch(): void;
  dispose(): void;
}

/** What objects that a motion of a glTF file moves have besides what meshes (lines, points) of three.js have. */
export interface MovedByMotion {
  /** Sum of weighted seconds since the first frame, and sum of weights: an `AnimationMixer` writes them. */
  motionState: [sum: number, weight: number];
  /** Seconds since the first frame, for programs without a mixer. */
  motionTime: number;
  readonly isOnGpu: boolean;
  /** Bring the geometry to the current time; drawing and rays do it. */
  updateMotion(): void;
}

/**
 * The glTF extension PDECODEC_mesh_motion: `loader.register((parser) => new GLTFMeshMotionExtension(parser))`. Motions are
 * clips of `gltf.animations`. Disposing of all geometries of a file frees its decoders.
 */
export class GLTFMeshMotionExtension implements GLTFLoaderPlugin {
  constructor(parser: GLTFParser);
  readonly name: string;
  loadMesh(index: number): Promise<Group | Mesh> | null;
  afterRoot(result: GLTF): null;
}

/** Loads `.pdeanim` files with the interface of three.js loaders. */
export class PDEAnimLoader extends Loader<DeformingGroup> {
  /** Evaluate on the graphics processor of this renderer, which must be the one that draws; null: use the decoder. */
  setRenderer(renderer: WebGLRenderer | WebGPURenderer | null): this;
  /** Give what is loaded from now on the materials of a glTF file; null: none. See `DeformingGroup`. */
  useMaterialsFrom(gltf: Pick<GLTF, "scene"> | null): this;
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
