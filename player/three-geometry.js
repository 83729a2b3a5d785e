/** A geometry of three.js whose positions and normals come from the decoder or from a graphics processor. */
import { Box3, BufferAttribute, BufferGeometry, Sphere, Vector3 } from "three";

import { DecodedRun, gatherRows, release, retain, turnTangents } from "./decoded.js";

const shapes = new WeakMap();

/** Return the shape of a moving geometry, or of a geometry that took its attributes; otherwise undefined. */
export const shapeOf = (geometry) => shapes.get(geometry.attributes.position);

export class MovingGeometry extends BufferGeometry {
  #wanted = null;
  #graphics = null;
  #motion = null;
  #pair = null;
  #shown = null;
  #isRetained = false;

  /**
   * @param {{ animation: import("./pdeanim.js").PdeAnimation, run: import("./pdeanim.js").PdeAnimation, sources: Uint32Array,
   *     fans?: object, hasNormals?: boolean, tangents?: Float32Array, bounds?: Box3 }} shape the open file and one of its runs of
   *     frames, the run's vertex of each drawn vertex, which corners share a normal (see `GroupedMotion.addDrawn`), whether
   *     there are normals, tangents of the first frame, and a box around all times, if it is known
   */
  constructor(shape) {
    super();
    this.shape = { fans: null, hasNormals: true, tangents: null, bounds: null, ...shape };
    this.isMoving = true;
    this.isStale = false;  // whether buffers were freed since the last shape
    this.decoded = DecodedRun.of(shape.run);
    this.#takeFromDecoder();
  }

  /** Whether the graphics processor computed the shape that is shown. */
  get isOnGpu() {
    return this.#pair !== null && this.#motion.isOnGpu && this.#shown?.weight === 1;
  }

  /** Whether drawing takes buffers of a graphics processor. */
  get hasGpuBuffers() {
    return this.#pair !== null;
  }

  /** Evaluate with `graphicsOf(renderer)` from now on if the clip fits there, otherwise with the decoder. */
  setGraphics(graphics) {
    const { run, sources, fans, hasNormals, tangents } = this.shape;
    if (graphics === this.#wanted) return;
    this.#freeBuffers();
    this.#retain();
    this.#wanted = graphics;
    // Shaders of ours write no tangents.
    this.#graphics = graphics?.holds(run) && !tangents ? graphics : null;
    if (this.#graphics) {
      this.dispatchEvent({ type: "dispose" });  // the renderer's copies of the decoder's arrays
      this.#motion = graphics.borrow(run, this);
      this.#pair = graphics.work(() => this.#motion.addDrawn(sources, fans));
      const attribute = (buffer, read) => graphics.attribute(buffer, sources.length, (k, axis) => read(k, axis));
      this.setAttribute("position", attribute(this.#pair.positions, (k, axis) => this.#points[3 * sources[k] + axis]));
      if (hasNormals) this.setAttribute("normal", attribute(this.#pair.normals, (k, axis) => this.#normal(k, axis)));
    }
    if (this.#shown) this.show(this.#shown.time, this.#shown.weight);
  }

  /** Show the shape at a time [s] of the file; with a `weight`, that share of the way from the first frame's shape. */
  show(time, weight = 1) {
    this.#retain();
    this.isStale = false;
    this.#shown = { time, weight };
    if (this.#pair && weight === 1) {
      this.#graphics.work(() => this.#motion.evaluate(time, [this.#pair]));
    } else if (this.#pair) {
      const count = 3 * this.shape.sources.length;
      const [points, normals] = [new Float32Array(count), new Float32Array(count)];
      this.#gather(points, normals);
      this.#graphics.work(() => this.#motion.write(this.#pair, points, normals));
    } else {
      const { position, normal, tangent } = this.attributes;
      this.#gather(position.array, normal?.array);
      if (this.shape.tangents) turnTangents(tangent.array, this.shape.tangents, normal.array);
      for (const attribute of [position, normal, this.shape.tangents && tangent]) {
        if (attribute) attribute.needsUpdate = true;
      }
    }
    if (this.shape.bounds) return;
    this.boundingSphere = null;
    this.boundingBox = null;
  }

  /** Upload everything again after a lost context. */
  restore() {
    const graphics = this.#wanted;
    this.#wanted = this.#graphics = this.#motion = this.#pair = null;
    this.setGraphics(graphics);
  }

  /** Upload the next group of frames. */
  prefetch() {
    if (this.#pair && this.#shown) this.#graphics.work(() => this.#motion.prefetchAfter(this.#shown.time));
  }

  /** Take index, groups and all attributes but positions and normals from another geometry, and its present shape. */
  copyRest(source) {
    const { position, normal, tangent } = this.attributes;
    for (const [name, attribute] of Object.entries(source.attributes)) {
      if (!this.hasAttribute(name)) this.setAttribute(name, attribute);
    }
    this.setIndex(source.index);
    this.groups = source.groups.map((group) => ({ ...group }));
    Object.assign(this, { name: source.name, userData: source.userData });
    for (const [own, other] of [
      [position, source.attributes.position],
      [normal, source.attributes.normal],
      [tangent, source.attributes.tangent],
    ]) {
      if (own && !source.hasGpuBuffers) for (let k = 0; k < other.count; k++) copyVertex(own, other, k);
    }
  }

  /** Return a geometry with a time of its own that shares everything else. */
  clone() {
    const copy = new MovingGeometry(this.shape);
    copy.copyRest(this);
    if (this.#shown) copy.show(this.#shown.time, this.#shown.weight);
    return copy;
  }

  /** Free everything that the geometry holds until it is shown again; the last one of a file closes its decoder. */
  dispose() {
    super.dispose();
    this.#freeBuffers();
    if (this.#isRetained) release(this.shape.animation);
    this.#isRetained = false;
  }

  #retain() {
    if (!this.#isRetained) retain(this.shape.animation);
    this.#isRetained = true;
  }

  /** Compute the box through the attributes' getters: three.js reads arrays, which are not there on a graphics processor. */
  computeBoundingBox() {
    this.boundingBox = this.shape.bounds?.clone() ?? new Box3().setFromBufferAttribute(this.attributes.position);
  }

  computeBoundingSphere() {
    const { bounds } = this.shape;
    const { position } = this.attributes;
    const box = bounds ?? new Box3().setFromBufferAttribute(position);
    this.boundingSphere = box.getBoundingSphere(new Sphere());
    if (bounds) return;
    const point = new Vector3();
    this.boundingSphere.radius = 0;
    for (let index = 0; index < position.count; index++) {
      const distance = this.boundingSphere.center.distanceTo(point.fromBufferAttribute(position, index));
      this.boundingSphere.radius = Math.max(this.boundingSphere.radius, distance);
    }
  }

  get #points() {
    const { time, weight } = this.#shown;
    return this.decoded.points(time, weight);
  }

  #normal(index, axis) {
    const { sources, fans } = this.shape;
    const { time, weight } = this.#shown;
    const values = this.decoded.normals(time, weight, fans);
    return values[3 * (fans ? fans.of : sources)[index] + axis];
  }

  #gather(points, normals) {
    const { sources, fans } = this.shape;
    const { time, weight } = this.#shown;
    gatherRows(points, this.#points, sources);
    if (normals) gatherRows(normals, this.decoded.normals(time, weight, fans), fans?.of ?? sources, fans?.stored);
  }

  #takeFromDecoder() {
    const { sources, hasNormals, tangents } = this.shape;
    const attribute = (size) => new BufferAttribute(new Float32Array(size * sources.length), size);
    this.setAttribute("position", attribute(3));
    shapes.set(this.attributes.position, this.shape);
    if (hasNormals) this.setAttribute("normal", attribute(3));
    if (tangents) this.setAttribute("tangent", attribute(4));
  }

  #freeBuffers() {
    if (this.#pair) {
      this.#graphics.work(() => this.#motion.removeDrawn(this.#pair));
      this.#graphics.giveBack(this.shape.run, this);
      this.#takeFromDecoder();
      this.isStale = true;
    }
    this.#wanted = this.#graphics = this.#motion = this.#pair = null;
  }
}

function copyVertex(own, other, k) {
  for (let axis = 0; axis < own.itemSize; axis++) own.setComponent(k, axis, other.getComponent(k, axis));
}
