/**
 * Deforming meshes in three.js.
 *
 *     const animation = await new PDEAnimLoader().setRenderer(renderer).loadAsync("cloth.pdeanim");
 *     scene.add(animation);
 *     animation.setTime(seconds); // in the loop that draws
 *
 * With a renderer, positions and normals are made on the graphics processor, into buffers that are attributes of geometries as
 * any others: for every material, for shadows. Without one they are made by the decoder.
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

import { GpuMotion } from "./gpu.js";
import { edgesOf, normalsOf, trianglesOf } from "./mesh.js";
import { PdeAnimation } from "./pdeanim.js";
import { WebGpuMotion } from "./webgpu.js";

/** Loads `.pdeanim` files, as three's own loaders load theirs. */
export class PDEAnimLoader extends Loader {
  #renderer = null;

  /** Evaluate on the graphics processor of a renderer, the one that will draw; null for the decoder. */
  setRenderer(renderer) {
    this.#renderer = renderer;
    return this;
  }

  /** Fetch a file; `onLoad` is called with a `DeformingGroup`. */
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

  /** Make a `DeformingGroup` of the bytes of a file; `onLoad` is called with it. */
  parse(data, onLoad, onError) {
    this.parseAsync(data).then(onLoad, onError ?? console.error);
  }

  /** @returns {Promise<DeformingGroup>} */
  async parseAsync(data) {
    if (this.#renderer?.isWebGPURenderer) await this.#renderer.init();
    return new DeformingGroup(await PdeAnimation.open(data), { renderer: this.#renderer });
  }
}

/** A mesh for each object of a file; line segments for one of lines alone, points for one of vertices alone. */
export class DeformingGroup extends Group {
  /**
   * @param {PdeAnimation} animation
   * @param {{ renderer?: import("three").WebGLRenderer | import("three/webgpu").WebGPURenderer | null }} options the renderer
   *     that evaluates (a `WebGPURenderer` once `init()` is done); the decoder does where there is none
   */
  constructor(animation, { renderer = null } = {}) {
    super();
    this.animation = animation;
    this.duration = animation.end - animation.start;
    this.time = null;
    this.#graphics = graphicsOf(renderer);
    this.#graphics?.onRestored(this.#restore, true);
    this.setTime(0);
  }

  #graphics;
  #run = null;
  #motion = null;

  /** Whether the graphics processor made the shape that is shown. */
  get isOnGpu() {
    return this.#motion !== null && this.#motion.isOnGpu;
  }

  /** Show the shape at a time [s] from the clip's start. */
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
        take(attributes.position, shape.points, sources);
        take(attributes.normal, shape.normals, sources);
      }
      mesh.geometry.boundingSphere = null;
      mesh.geometry.boundingBox = null;
    }
  }

  /** Upload the frames that come after those of now, when there is time for it. */
  prefetch() {
    if (this.#motion) this.#graphics.work(() => this.#motion.prefetchAfter(this.time));
  }

  /** Give back geometries, materials and what is decoded. */
  dispose() {
    this.#graphics?.onRestored(this.#restore, false);
    this.#clear();
    this.animation.close();
  }

  /** What the graphics processor had is gone: upload it again. */
  #restore = () => {
    const { time } = this;
    this.#run = null;
    this.time = null;
    this.setTime(time - this.animation.start);
  };

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
      const drawn = triangles.length ? withUvs(run.attributes(index), own, triangles) : withoutFaces(own);
      return { shape: new Shape(run, index, triangles), ...drawn };
    });
    if (this.#graphics?.holds(run)) {
      const drawn = parts.map(({ sources }, index) => sources.map((vertex) => run.object(index).firstVertex + vertex));
      this.#graphics.work(() => (this.#motion = this.#graphics.motion(run, drawn)));
    }
    parts.forEach(({ shape, kind, sources, index: indices, uvs }, index) => {
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
      // A sphere around the shape of each frame would take the decoder; a mesh out of sight costs its vertices.
      mesh.frustumCulled = !drawn;
      mesh.userData.pdeanim = { shape, sources };
      this.add(mesh);
    });
  }
}

const OBJECTS = { Mesh, LineSegments, Points };
const MATERIALS = {
  Mesh: () => new MeshStandardMaterial({ side: DoubleSide }),
  LineSegments: () => new LineBasicMaterial(),
  Points: () => new PointsMaterial({ sizeAttenuation: false, size: 3 }), // pixels: nothing says how large they are
};

/** Positions and normals of an object by the decoder, at the time that is set; made when they are asked for. */
class Shape {
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

/** What evaluates on the graphics processor of a renderer, or null where nothing does. */
function graphicsOf(renderer) {
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
    return Object.assign(attribute, readBy(sources, values));
  }

  /** Do work with the renderer's context, and let the renderer know that its state is another one. */
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

  /** Have `restore` called, or no longer, where a context that was lost came back. */
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

  /** An attribute that has its buffer before the renderer makes one of it. */
  attribute(buffer, sources, values) {
    const attribute = new BufferAttribute(new Float32Array(0), 3);
    attribute.count = sources.length;
    this.backend.get(attribute).buffer = buffer;
    return Object.assign(attribute, readBy(sources, values));
  }

  work(work) {
    work();
  }

  /** A device that was lost does not come back. */
  onRestored() {}
}

/** How an attribute that the graphics processor fills is read, by a ray or a box: from what the decoder says. */
function readBy(sources, values) {
  const getComponent = (index, component) => values()[3 * sources[index] + component];
  return {
    getComponent,
    getX: (index) => getComponent(index, 0),
    getY: (index) => getComponent(index, 1),
    getZ: (index) => getComponent(index, 2),
    // three asks for four numbers of any attribute where a ray hits, and takes three of a normal.
    getW: () => 0,
  };
}

/** Box and sphere of attributes that the graphics processor fills: three's own read arrays. */
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

/** An object of lines alone, or of vertices alone, as `withUvs` has those of faces. */
function withoutFaces(object) {
  const sources = Uint32Array.from({ length: object.vertexCount }, (_, vertex) => vertex);
  const edges = edgesOf([object]);
  return edges.length
    ? { kind: "LineSegments", sources, index: edges, uvs: null }
    : { kind: "Points", sources, index: null, uvs: null };
}

/** Vertices as three.js has them, one for each pair of vertex and UV: where each comes from, indices, UVs or null. */
function withUvs(attributes, object, triangles) {
  const uv = attributes.find((attribute) => attribute.columns === 2 && attribute.name.toLowerCase().startsWith("uv"));
  if (!uv || (uv.domain !== "corners" && uv.domain !== "vertices")) {
    const sources = Uint32Array.from({ length: object.vertexCount }, (_, vertex) => vertex);
    return { kind: "Mesh", sources, index: triangles, uvs: null };
  }
  const rowOf = (element) => (uv.indices ? uv.indices[element] : element);
  const corners = uv.domain === "corners" ? cornersOfTriangles(object) : triangles;
  const numbers = new Map();
  const sources = [];
  const uvs = [];
  const index = new Uint32Array(triangles.length);
  for (let k = 0; k < triangles.length; k++) {
    const row = rowOf(corners[k]);
    const key = `${triangles[k]} ${row}`;
    if (!numbers.has(key)) {
      numbers.set(key, sources.length);
      sources.push(triangles[k]);
      uvs.push(row < 0 ? 0 : uv.values[2 * row], row < 0 ? 0 : uv.values[2 * row + 1]);
    }
    index[k] = numbers.get(key);
  }
  return { kind: "Mesh", sources: Uint32Array.from(sources), index, uvs: Float32Array.from(uvs) };
}

/** Of each triangle's corners which corners of the faces they are. */
function cornersOfTriangles({ faceSizes }) {
  const found = [];
  let corner = 0;
  for (const size of faceSizes) {
    for (let k = 1; k + 1 < size; k++) found.push(corner, corner + k, corner + k + 1);
    corner += size;
  }
  return found;
}

function take(attribute, values, sources) {
  const { array } = attribute;
  for (let k = 0; k < sources.length; k++) {
    const from = 3 * sources[k];
    array[3 * k] = values[from];
    array[3 * k + 1] = values[from + 1];
    array[3 * k + 2] = values[from + 2];
  }
  attribute.needsUpdate = true;
}
