import type { AnimatedObject, Attribute, PdeAnimation } from "./pdeanim.js";

/** Triangulate faces: vertex indices across all objects, and the face of each triangle. */
export function trianglesOf(objects: AnimatedObject[]): { triangles: Uint32Array; faces: Uint32Array };

/** List the edges of faces (each once) and of lines, two vertices per edge. */
export function edgesOf(objects: AnimatedObject[]): Uint32Array;

/**
 * List the two other vertices of each triangle around each vertex, or around each of `count` fans: the corners at a vertex
 * that share a normal. `fans`: the fan of each corner of the triangles.
 */
export function cornersAround(
  triangles: Uint32Array,
  count: number,
  fans?: Uint32Array,
): { starts: Uint32Array; others: Uint32Array };

/** Compute unit normals of vertices, or of the fans that corners of triangles belong to. */
export function normalsOf(
  positions: Float32Array,
  triangles: Uint32Array,
  out?: Float32Array,
  fans?: Uint32Array,
): Float32Array;

/** Return which corner of the faces each corner of the triangles is. */
export function listTriangleCorners(object: AnimatedObject): number[];

/** What a graphics processor draws of an object: the source of each vertex, indices, UVs and corners, or null. */
export interface Drawn {
  kind: "Mesh" | "LineSegments" | "Points";
  sources: Uint32Array;
  index: Uint32Array | null;
  uvs: Float32Array | null;
  corners?: Uint32Array | number[] | null;
}

/** Describe an object that has only lines or only vertices. */
export function describeFaceless(object: AnimatedObject): Drawn;

/** Split vertices at UV seams; `isSplit`: give each corner of each triangle a vertex of its own. */
export function splitAtUvSeams(
  attributes: Attribute[],
  object: AnimatedObject,
  triangles: Uint32Array,
  isSplit: boolean,
  order?: Uint32Array | null,
): Drawn;

/** List an object's materials, the order of its triangles that puts those of one material together, and their corners. */
export function materialsOf(
  attributes: Attribute[],
  faces: Uint32Array,
): {
  names: string[];
  order: Uint32Array | null;
  groups: { start: number; count: number; materialIndex: number }[];
};

/** Return the UVs of an object that change over time as attributes, as they are at the start of the run. */
export function changingUvs(run: PdeAnimation, object: number): Attribute[];
