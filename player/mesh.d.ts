import type { AnimatedObject } from "./pdeanim.js";

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
