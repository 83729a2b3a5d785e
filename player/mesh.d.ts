import type { AnimatedObject } from "./pdeanim.js";

/** Triangles, vertices of all objects numbered through, and the face that each is of. */
export function trianglesOf(objects: AnimatedObject[]): { triangles: Uint32Array; faces: Uint32Array };

/** Edges of faces, each once, and of lines: two vertices each. */
export function edgesOf(objects: AnimatedObject[]): Uint32Array;

/** Of each vertex the other two of the triangles around it. */
export function cornersAround(
  triangles: Uint32Array,
  vertexCount: number,
): { starts: Uint32Array; others: Uint32Array };

/** Normals of vertices, of length 1. */
export function normalsOf(positions: Float32Array, triangles: Uint32Array, out?: Float32Array): Float32Array;
