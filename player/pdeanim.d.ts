/** An error, whose kind is given by `code`. */
export class PdeanimError extends Error {
  code:
    | "corrupt"
    | "limit"
    | "argument"
    | "read-failed"
    | "no-memory"
    | "cancelled"
    | "internal"
    | "bytes-missing";
  /** Byte of the file, or -1. */
  offset: number;
  /** Frame index, or -1. */
  frame: number;
}

/** Provides bytes of a file. */
export interface Source {
  readonly size: number;
  readonly isMissing: boolean;
  read(offset: number, size: number): Uint8Array | null;
  fetchMissing?(): Promise<void>;
}

/** A whole file in memory. */
export class MemorySource implements Source {
  constructor(data: ArrayBuffer | ArrayBufferView);
  readonly size: number;
  readonly isMissing: boolean;
  read(offset: number, size: number): Uint8Array;
}

/** A file at a URL, read in parts. */
export class HttpSource implements Source {
  static open(address: string | URL, request?: RequestInit): Promise<HttpSource>;
  readonly size: number;
  readonly isMissing: boolean;
  /** Bytes fetched so far. */
  readonly bytesFetched: number;
  read(offset: number, size: number): Uint8Array | null;
  fetchMissing(): Promise<void>;
}

export interface OpenOptions {
  /** Largest memory that decoding the file may take [bytes; default: 2 GiB]. */
  maxMemory?: number;
  /** Options for `fetch`, such as headers. */
  request?: RequestInit;
  /** The WebAssembly module or its address, if `pdeanim.wasm` is not next to the script. */
  wasm?: BufferSource | string | URL;
}

export interface AnimatedObject {
  name: string;
  firstVertex: number;
  vertexCount: number;
  /** Number of corners of each face. */
  faceSizes: Int32Array;
  /** Vertices of the corners, face after face, counted from 0 within the object. */
  faceIndices: Int32Array;
  lineSizes: Int32Array;
  lineIndices: Int32Array;
}

export interface Attribute {
  name: string;
  domain: "vertices" | "faces" | "corners" | "object" | "cells";
  columns: number;
  /** Row after row. */
  values: Float32Array | Float64Array | Int32Array | BigInt64Array | Uint8Array;
  /** Row of each element, -1 for none; null if element k has row k. */
  indices: Int32Array | null;
  /** Names of the integer values, if they have names. */
  labels: string[];
}

export type FieldValues =
  | Float32Array
  | Float64Array
  | Int8Array
  | Int16Array
  | Int32Array
  | BigInt64Array
  | Uint8Array
  | Uint16Array
  | Uint32Array
  | BigUint64Array;

/** Describes values that change in time. */
export interface Field {
  name: string;
  /** Such as "Pa"; empty if unknown. */
  unit: string;
  domain: "vertices" | "faces" | "corners" | "object" | "cells";
  type: "float32" | "float64" | "int8" | "int16" | "int32" | "int64" | "uint8" | "uint16" | "uint32" | "uint64" | "bool";
  /** Numbers of each row. */
  components: number;
  rows: number;
  /** Smallest and largest value of the source. */
  smallest: number;
  largest: number;
  /** Largest error at frames; 0: values are exact. */
  bound: number;
  /** The objects that have the field, ascending; its rows stand object after object. */
  objects: number[];
}

export interface FrameGroup {
  firstFrame: number;
  frameCount: number;
  functionCount: number;
  /** Components of a field: 1 if all axes share the field, otherwise 3. */
  axisCount: 1 | 3;
}

export interface Corrections {
  frames: Int32Array;
  vertices: Int32Array;
  /** x, y, z of each correction [scene units]. */
  offsets: Float32Array;
}

export interface Section {
  type: string;
  offset: number;
  length: number;
}

export interface EvaluateOptions {
  /** Evaluate the vertices of this object only. */
  object?: number;
  /** Array to write to; it is returned. */
  out?: Float32Array;
}

/** Compile the decoder before the first `open`; `from`: its bytes or address, if it is not next to the script. */
export function compile(from?: BufferSource | string | URL): Promise<WebAssembly.Module>;

/** A deforming mesh that can be evaluated at any time. */
export class PdeAnimation {
  private constructor();
  static open(
    from: ArrayBuffer | ArrayBufferView | string | URL | Source,
    options?: OpenOptions,
  ): Promise<PdeAnimation>;

  readonly frameCount: number;
  readonly vertexCount: number;
  readonly objectCount: number;
  readonly runCount: number;
  readonly groupCount: number;
  /** Nominal frame rate [frames per second]. */
  readonly frameRate: number;
  /** Times of the frames [s]. */
  readonly times: Float64Array;
  /** First and last time [s]. */
  readonly start: number;
  readonly end: number;
  /** Size of the file [bytes]. */
  readonly fileSize: number;

  prepare(time: number, options?: { fields?: string[] }): Promise<void>;
  at(time: number): PdeAnimation;
  firstFrameOfRun(run: number): number;
  run(index: number): PdeAnimation;
  object(index: number): AnimatedObject;
  readonly objects: AnimatedObject[];
  attributes(object: number): Attribute[];

  positions(time: number, options?: EvaluateOptions): Float32Array;
  velocities(time: number, options?: EvaluateOptions): Float32Array;
  accelerations(time: number, options?: EvaluateOptions): Float32Array;

  readonly fieldList: Field[];
  field<Values extends FieldValues = FieldValues>(
    name: string,
    time: number,
    options?: { derivative?: 0 | 1 | 2; out?: Values },
  ): Values;

  readonly groups: FrameGroup[];
  groupOf(frame: number): number;
  reference(): Float32Array;
  groupsAt(time: number): [first: number, behind: number];
  weights(time: number, group: number): Float64Array;
  fields(group: number): Float32Array;
  corrections(group: number): Corrections;
  elements(): Int32Array;
  readonly sections: Section[];

  verify(): void;
  close(): void;
  readonly isClosed: boolean;
  /** Open a closed animation again. */
  reopen(): void;
}
