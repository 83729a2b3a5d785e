/** What loaders of the glTF extension PDECODEC_mesh_motion share (spec/extension): motions, vertices and normals. */
import { PdeanimError } from "./errors.js";
import { PdeAnimation } from "./pdeanim.js";

export const EXTENSION = "PDECODEC_mesh_motion";

/** Largest number of keys of a motion: the JSON may state any frame rate. */
const MAX_KEYS = 2 ** 16;

/** Largest difference between the stated duration and that of the file [s]. */
const DURATION_SLACK = 1e-6;

/** Return the extension's object of a glTF object, or undefined. */
export const extensionOf = (object) => object?.extensions?.[EXTENSION];

/** The motions of one glTF file: each is opened once, when a primitive first asks for it. */
export class Motions {
  /**
   * @param {object} json the glTF file
   * @param {(index: number) => Promise<ArrayBuffer | ArrayBufferView>} readBufferView
   */
  constructor(json, readBufferView) {
    this.list = extensionOf(json)?.motions ?? [];
    this.readBufferView = readBufferView;
  }

  #opened = new Map();

  /** Return the animation of a motion. */
  open(index) {
    if (!this.#opened.has(index)) this.#opened.set(index, this.#open(index));
    return this.#opened.get(index);
  }

  async #open(index) {
    const motion = this.list[index];
    if (!motion) throw new PdeanimError(`there is no motion ${index}`, "argument");
    const animation = await PdeAnimation.open(await this.readBufferView(motion.bufferView));
    const { start, end, runCount } = animation;
    const isAsStated = Math.abs(end - start - motion.duration) <= DURATION_SLACK;
    if (runCount === 1 && isAsStated) return animation;
    animation.close();
    const fault = runCount > 1 ? "its faces change" : `it states ${motion.duration} s, and its file lasts ${end - start} s`;
    throw new PdeanimError(`motion ${index}: ${fault}`, "argument");
  }

  /**
   * Return the times [s] of keys of a motion, and the seconds since its first frame at each: one key per frame if the frame
   * rate is known, so that parts of the animation can be cut out.
   */
  keysOf(index) {
    const { startTime = 0, duration, frameRate } = this.list[index];
    const frames = Math.round(duration * (frameRate ?? 0));
    const steps = frames >= 1 && frames <= MAX_KEYS ? frames : 1;
    const seconds = Array.from({ length: steps + 1 }, (_, k) => (duration * k) / steps);
    return { times: seconds.map((second) => startTime + second), seconds };
  }

  nameOf(index) {
    return this.list[index].name ?? (this.list.length > 1 ? `motion_${index}` : "motion");
  }
}

/**
 * Return the animation's vertex of each vertex of a primitive.
 * @param {{ firstVertex?: number, vertexMap?: number }} own the primitive's extension
 * @param {ArrayLike<number> | null} map values of the accessor `vertexMap`
 */
export function rowsOf(animation, own, map, count) {
  const { firstVertex = 0 } = own;
  if (map && map.length !== count) {
    throw new PdeanimError(`vertexMap has ${map.length} values for ${count} vertices`, "argument");
  }
  const rows = Array.from({ length: count }, (_, k) => firstVertex + (map ? map[k] : k));
  const beyond = rows.find((row) => !(row >= 0 && row < animation.vertexCount));
  if (beyond !== undefined) {
    throw new PdeanimError(`vertex ${beyond} is not one of the motion's ${animation.vertexCount}`, "argument");
  }
  return Uint32Array.from(rows);
}

/**
 * Return the fans of each primitive of a mesh (see `GroupedMotion.addDrawn`): vertices share a normal if they are the same
 * vertex of the motion and have equal values of NORMAL.
 * @param {{ rows: Uint32Array, normals: Float32Array, index: ArrayLike<number> | null }[]} primitives triangles that one
 *     motion moves; `index` has their corners
 */
export function fansOf(primitives) {
  const heads = new Map();
  const next = [];
  const normalOf = [];
  const isSame = (fan, normals, k) =>
    [0, 1, 2].every((axis) => normalOf[fan][0][3 * normalOf[fan][1] + axis] === normals[3 * k + axis]);
  const each = primitives.map(({ rows, normals }) =>
    rows.map((row, k) => {
      let fan = heads.get(row) ?? -1;
      while (fan >= 0 && !isSame(fan, normals, k)) fan = next[fan];
      if (fan >= 0) return fan;
      next.push(heads.get(row) ?? -1);
      heads.set(row, next.length - 1);
      normalOf.push([normals, k]);
      return next.length - 1;
    }),
  );
  const lengths = primitives.map(({ rows, index }) => (index ?? rows).length);
  const triangles = new Uint32Array(lengths.reduce((sum, length) => sum + length, 0));
  const corners = new Uint32Array(triangles.length);
  let at = 0;
  primitives.forEach(({ rows, index }, number) => {
    for (let k = 0; k < lengths[number]; k++) {
      const vertex = index ? index[k] : k;
      triangles[at] = rows[vertex];
      corners[at++] = each[number][vertex];
    }
  });
  return primitives.map(({ normals }, k) => ({ of: each[k], stored: normals, triangles, corners, count: next.length }));
}
