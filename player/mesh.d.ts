import type { AnimatedObject, Attribute, PdeAnimation } from "./pdeanim.js";

/** Triangulate faces: vertex indices across all objects, and the face of each triangle. */
export function trianglesOf(objects: AnimatedObject[]): { triangles: Uint32Array; faces: Uint32Array };

/** List the edges of faces (each once) and of lines, two vertices per edge. */
export function edgesOf(objects: AnimatedObject[]): Uint32Array;

/** List the two other vertices of each triangle around each vertex. */
export function cornersAround(
  triangles: Uint32Array,
  vertexCount: number,
): { starts: Uint32Array; others: Uint32Array };

/** Compute unit normals of vertices. */
export function normalsOf(positions: Float32Array, triangles: Uint32Array, out?: Float32Array): Float32Array;

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
): Drawn;

/** Return the UVs of an object that change over time as attributes, as they are at the start of the run. */
export function changingUvs(run: PdeAnimation, object: number): Attribute[];
