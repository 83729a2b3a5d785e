/**
 * Shows deforming meshes in three.js.
 *
 *     const animation = await new PDEAnimLoader().setRenderer(renderer).loadAsync("cloth.pdeanim");
 *     scene.add(animation);
 *     animation.setTime(seconds); // in the render loop
 *
 * With a renderer, the graphics processor computes positions and normals into buffers that serve as ordinary attributes
 * of the geometries, so every material and shadow works. Without one, the decoder computes them.
 */
import {
  Box3,
  BufferAttribute,
  BufferGeometry,
  DoubleSide,
  FileLoader,
  GLBufferAttribute,
  Group,
  LineBasicMaterial,
  LineSegments,
  Loader,
  Mesh,
  MeshStandardMaterial,
  Points,
  PointsMaterial,
  Sphere,
  Vector3,
} from "three";

import { FieldColours, rowsOfDrawn } from "./colours.js";
import { GpuMotion } from "./gpu.js";
import { changingUvs, describeFaceless, normalsOf, splitAtUvSeams, trianglesOf } from "./mesh.js";
import { PdeAnimation } from "./pdeanim.js";
import { WebGpuMotion } from "./webgpu.js";

/** Loads `.pdeanim` files with the interface of three.js loaders. */
export class PDEAnimLoader extends Loader {
  #renderer = null;

  /** Evaluate on the graphics processor of this renderer, which must be the one that draws; null: use the decoder. */
  setRenderer(renderer) {
    this.#renderer = renderer;
    return this;
  }

  /** Fetch a file; `onLoad` receives a `DeformingGroup`. */
  load(url, onLoad, onProgress, onError) {
    const loader = new FileLoader(this.manager);
    loader.setPath(this.path);
    loader.setResponseType("arraybuffer");
    loader.setRequestHeader(this.requestHeader);
    loader.setWithCredentials(this.withCredentials);
    const fail = (error) => {
      if (onError) onError(error);
      else console.error(error);
      this.manager.itemError(url);
    };
    loader.load(url, (data) => this.parse(data, onLoad, fail), onProgress, fail);
  }

  /** Build a `DeformingGroup` from the bytes of a file; `onLoad` receives it. */
  parse(data, onLoad, onError) {
    this.parseAsync(data).then(onLoad, onError ?? console.error);
  }

  /** @returns {Promise<DeformingGroup>} */
  async parseAsync(data) {
    if (this.#renderer?.isWebGPURenderer) await this.#renderer.init();
    return new DeformingGroup(await PdeAnimation.open(data), { renderer: this.#renderer });
  }
}

/** A mesh for each object of a file; line segments for an object of lines only, points for one of vertices only. */
export class DeformingGroup extends Group {
  /**
   * @param {PdeAnimation} animation
   * @param {{ renderer?: import("three").WebGLRenderer | import("three/webgpu").WebGPURenderer | null }} options evaluate on
   *     this renderer's graphics processor (a `WebGPURenderer` only after its `init()`); without one the decoder evaluates
   */
  constructor(animation, { renderer = null } = {}) {
    super();
    this.animation = animation;
    this.duration = animation.end - animation.start;
    this.time = null;
    this.#graphics = makeGraphics(renderer);
    this.#graphics?.onRestored(this.#restore, true);
    this.setTime(0);
  }

  #graphics;
  #run = null;
  #motion = null;
  #colours = null;

  /** Whether the graphics processor computed the shape that is shown. */
  get isOnGpu() {
    return this.#motion !== null && this.#motion.isOnGpu;
  }

  /** Show the shape at a time [s], counted from the start of the clip. */
  setTime(seconds) {
    const time = this.animation.start + seconds;
    if (time === this.time) return;
    this.time = time;
    const run = this.animation.at(time);
    if (run !== this.#run) this.#build(run);
    if (this.#motion) this.#graphics.work(() => this.#motion.evaluate(time));
    for (const mesh of this.children) {
      const { attributes } = mesh.geometry;
      const { shape, sources } = mesh.userData.pdeanim;
      shape.time = time;
      if (!this.#motion) {
        gatherVertices(attributes.position, shape.points, sources);
        gatherVertices(attributes.normal, shape.normals, sources);
      }
      mesh.geometry.boundingSphere = null;
      mesh.geometry.boundingBox = null;
    }
    this.#colour();
  }

  /**
   * Colour all meshes by a field; null ends it. Fills `geometry.attributes.color` at every `setTime`, and sets
   * `vertexColors` of the materials; materials that you set later need it, too.
   * @param {string | null} name
   * @param {{ colormap?: string | string[] | null, range?: [number, number], component?: number | null }} options
   *     "viridis" (default), "coolwarm" or colours at equal distances; null: no colours, but the numbers themselves in
   *     `geometry.attributes.field`. The values at both ends of the colours; by default those of the source. The component to
   *     show; by default the magnitude of all.
   */
  setField(name, options = {}) {
    const wasSplit = this.#isSplit;
    const before = this.#colours;
    this.#colours = name === null ? null : new FieldColours(this.animation, name, options);
    for (const { geometry, material } of this.children) {
      if (before) geometry.deleteAttribute(before.attribute.name);
      if (before || this.#colours) this.#setVertexColors(material);
    }
    if (this.#isSplit === wasSplit) {
      for (const mesh of this.children) this.#addFieldTo(mesh);
      this.#colour();
    } else {
      this.#build(this.#run);
      this.#showAgain();
    }
  }

  get #isSplit() {
    return this.#colours?.splits(this.#run) ?? false;
  }

  #setVertexColors(material) {
    const hasColours = Boolean(this.#colours?.table);
    for (const own of [material].flat()) {
      if (own.vertexColors !== hasColours) own.needsUpdate = true;  // another shader
      own.vertexColors = hasColours;
    }
  }

  #addFieldTo({ geometry, userData }) {
    if (!this.#colours) return;
    const { name, size } = this.#colours.attribute;
    const { sources, corners, shape } = userData.pdeanim;
    geometry.setAttribute(name, new BufferAttribute(new Float32Array(size * sources.length), size));
    userData.pdeanim.rows = rowsOfDrawn(this.#colours.in(this.#run), this.#run, shape.object, sources, corners);
  }

  /** Fill the field's attribute at the current time. */
  #colour() {
    const colours = this.#colours;
    if (!colours) return;
    const values = colours.in(this.#run) ? colours.values(this.#run, this.time) : [];
    for (const { geometry, userData } of this.children) {
      const attribute = geometry.attributes[colours.attribute.name];
      colours.fill(attribute.array, values, userData.pdeanim.rows);
      attribute.needsUpdate = true;
    }
  }

  /** Upload the next group of frames, when there is time to spare. */
  prefetch() {
    if (this.#motion) this.#graphics.work(() => this.#motion.prefetchAfter(this.time));
  }

  /** Free geometries, materials and everything decoded. */
  dispose() {
    this.#graphics?.onRestored(this.#restore, false);
    this.#clear();
    this.animation.close();
  }

  /** Upload everything again after a lost context. */
  #restore = () => {
    this.#run = null;
    this.#showAgain();
  };

  /** Show the same time in new geometries. */
  #showAgain() {
    const { time } = this;
    this.time = null;
    this.setTime(time - this.animation.start);
  }

  #clear() {
    for (const mesh of [...this.children]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
      this.remove(mesh);
    }
    this.#motion?.close();
    this.#motion = null;
  }

  #build(run) {
    const before = this.children.map(({ type, material }) => ({ type, material }));
    this.#clear();
    this.#run = run;
    const parts = run.objects.map((object, index) => {
      const own = { ...object, firstVertex: 0 };
      const { triangles } = trianglesOf([own]);
      const split = (attributes) => splitAtUvSeams(attributes, own, triangles, this.#isSplit);
      const drawn = triangles.length ? split([...run.attributes(index), ...changingUvs(run, index)]) : describeFaceless(own);
      return { shape: new DecodedShape(run, index, triangles), ...drawn };
    });
    if (this.#graphics?.holds(run)) {
      const drawn = parts.map(({ sources }, index) => sources.map((vertex) => run.object(index).firstVertex + vertex));
      this.#graphics.work(() => (this.#motion = this.#graphics.motion(run, drawn)));
    }
    parts.forEach(({ shape, kind, sources, index: indices, uvs, corners }, index) => {
      const drawn = this.#motion?.drawn[index];
      const geometry = drawn ? new GpuGeometry() : new BufferGeometry();
      if (indices) geometry.setIndex(new BufferAttribute(indices, 1));
      for (const [name, values] of [
        ["position", "points"],
        ["normal", "normals"],
      ]) {
        const attribute = drawn
          ? this.#graphics.attribute(drawn[`${name}s`], sources, () => shape[values])
          : new BufferAttribute(new Float32Array(3 * sources.length), 3);
        geometry.setAttribute(name, attribute);
      }
      if (uvs) geometry.setAttribute("uv", new BufferAttribute(uvs, 2));
      const material = before[index]?.type === kind ? before[index].material : MATERIALS[kind]();
      const mesh = new OBJECTS[kind](geometry, material);
      mesh.name = run.object(index).name;
      // Culling needs a bounding sphere per frame, which only the decoder could compute; drawing unseen vertices is
      // cheaper.
      mesh.frustumCulled = !drawn;
      mesh.userData.pdeanim = { shape, sources, corners };
      if (this.#colours) this.#setVertexColors(material);
      this.#addFieldTo(mesh);
      this.add(mesh);
    });
  }
}

const OBJECTS = { Mesh, LineSegments, Points };
const MATERIALS = {
  Mesh: () => new MeshStandardMaterial({ side: DoubleSide }),
  LineSegments: () => new LineBasicMaterial(),
  Points: () => new PointsMaterial({ sizeAttenuation: false, size: 3 }),  // pixels: files store no point size
};

/** Lazily decoded positions and normals of an object at `time`. */
class DecodedShape {
  constructor(run, object, triangles) {
    Object.assign(this, { run, object, triangles, time: null });
  }

  #points = null;
  #normals = null;
  #timeOfPoints = null;
  #timeOfNormals = null;

  get points() {
    if (this.#timeOfPoints !== this.time) {
      this.#points ??= new Float32Array(3 * this.run.object(this.object).vertexCount);
      this.run.positions(this.time, { object: this.object, out: this.#points });
      this.#timeOfPoints = this.time;
    }
    return this.#points;
  }

  get normals() {
    const { points } = this;
    if (this.#timeOfNormals !== this.time) {
      this.#normals = normalsOf(points, this.triangles, this.#normals ?? new Float32Array(points.length));
      this.#timeOfNormals = this.time;
    }
    return this.#normals;
  }
}

/** Return an evaluator for the renderer's graphics processor, or null if it cannot evaluate. */
function makeGraphics(renderer) {
  if (renderer?.isWebGLRenderer && renderer.capabilities.isWebGL2) return new WebGlGraphics(renderer);
  if (renderer?.isWebGPURenderer && renderer.backend.isWebGPUBackend && renderer.backend.device) {
    return new WebGpuGraphics(renderer);
  }
  return null;
}

class WebGlGraphics {
  constructor(renderer) {
    this.renderer = renderer;
  }

  holds(run) {
    return GpuMotion.holds(this.renderer.getContext(), run);
  }

  motion(run, drawn) {
    return new GpuMotion(this.renderer.getContext(), run, drawn);
  }

  attribute(buffer, sources, values) {
    const attribute = new GLBufferAttribute(buffer, this.renderer.getContext().FLOAT, 3, 4, sources.length);
    return Object.assign(attribute, makeGetters(sources, values));
  }

  /** Do work in the renderer's context, then make the renderer reset its cached state. */
  work(work) {
    const { renderer } = this;
    const [target, face, level] = [
      renderer.getRenderTarget(),
      renderer.getActiveCubeFace(),
      renderer.getActiveMipmapLevel(),
    ];
    work();
    renderer.resetState();
    renderer.setRenderTarget(target, face, level);
  }

  /** Start or stop calling `restore` when a lost context comes back. */
  onRestored(restore, isWanted) {
    const { domElement } = this.renderer;
    if (isWanted) domElement.addEventListener("webglcontextrestored", restore);
    else domElement.removeEventListener("webglcontextrestored", restore);
  }
}

class WebGpuGraphics {
  constructor({ backend }) {
    this.backend = backend;
  }

  holds(run) {
    return WebGpuMotion.holds(this.backend.device, run);
  }

  motion(run, drawn) {
    return new WebGpuMotion(this.backend.device, run, drawn);
  }

  /** Make an attribute and give it its buffer before the renderer would create one. */
  attribute(buffer, sources, values) {
    const attribute = new BufferAttribute(new Float32Array(0), 3);
    attribute.count = sources.length;
    this.backend.get(attribute).buffer = buffer;
    return Object.assign(attribute, makeGetters(sources, values));
  }

  work(work) {
    work();
  }

  /** A lost device does not come back. */
  onRestored() {}
}

/** Return getters for an attribute on the graphics processor, for rays and boxes: they read the decoder's values. */
function makeGetters(sources, values) {
  const getComponent = (index, component) => values()[3 * sources[index] + component];
  return {
    getComponent,
    getX: (index) => getComponent(index, 0),
    getY: (index) => getComponent(index, 1),
    getZ: (index) => getComponent(index, 2),
    // three.js reads four components of any attribute that a ray hits, and uses three of a normal.
    getW: () => 0,
  };
}

/** Computes box and sphere through the attributes' getters: three.js reads arrays, which are not there. */
class GpuGeometry extends BufferGeometry {
  computeBoundingBox() {
    this.boundingBox = new Box3().setFromBufferAttribute(this.attributes.position);
  }

  computeBoundingSphere() {
    const { position } = this.attributes;
    const { center } = new Box3().setFromBufferAttribute(position).getBoundingSphere(new Sphere());
    const point = new Vector3();
    let radius = 0;
    for (let index = 0; index < position.count; index++) {
      radius = Math.max(radius, center.distanceTo(point.fromBufferAttribute(position, index)));
    }
    this.boundingSphere = new Sphere(center, radius);
  }
}

function gatherVertices(attribute, values, sources) {
  const { array } = attribute;
  for (let k = 0; k < sources.length; k++) {
    const from = 3 * sources[k];
    array[3 * k] = values[from];
    array[3 * k + 1] = values[from + 1];
    array[3 * k + 2] = values[from + 2];
  }
  attribute.needsUpdate = true;
}
