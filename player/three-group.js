/** The objects of a `.pdeanim` file as meshes of three.js. */
import {
  BufferAttribute,
  DoubleSide,
  Group,
  LineBasicMaterial,
  LineSegments,
  Mesh,
  MeshStandardMaterial,
  Points,
  PointsMaterial,
} from "three";

import { FieldColours } from "./colours.js";
import { release, retain } from "./decoded.js";
import { rowsOfDrawn } from "./fields.js";
import { changingUvs, describeFaceless, materialsOf, splitAtUvSeams, trianglesOf } from "./mesh.js";
import { MovingGeometry } from "./three-geometry.js";
import { graphicsOf } from "./three-graphics.js";

const OBJECTS = { Mesh, LineSegments, Points };
const MATERIALS = {
  Mesh: () => new MeshStandardMaterial({ side: DoubleSide }),
  LineSegments: () => new LineBasicMaterial(),
  Points: () => new PointsMaterial({ sizeAttenuation: false, size: 3 }),  // pixels: files store no point size
};

/** A mesh for each object of a file; line segments for an object of lines only, points for one of vertices only. */
export class DeformingGroup extends Group {
  /**
   * @param {import("./pdeanim.js").PdeAnimation} animation
   * @param {{ renderer?: import("three").WebGLRenderer | import("three/webgpu").WebGPURenderer | null }} options evaluate on
   *     this renderer's graphics processor (a `WebGPURenderer` only after its `init()`); without one the decoder evaluates
   */
  constructor(animation, { renderer = null } = {}) {
    super();
    retain(animation);
    this.animation = animation;
    this.duration = animation.end - animation.start;
    this.time = null;
    this.#graphics = graphicsOf(renderer);
    this.#renderer = renderer;
    this.setTime(0);
  }

  #renderer;
  #graphics;
  #run = null;
  #parts = [];
  #materials = new Map();
  #colours = null;
  #fieldOptions = null;
  #originals = null;
  #isClone = false;
  #isDisposed = false;

  /** Whether the graphics processor computed the shape that is shown. */
  get isOnGpu() {
    return this.#parts.length > 0 && this.#parts.every(({ mesh }) => mesh.geometry.isOnGpu);
  }

  /** Show the shape at a time [s], counted from the start of the clip. */
  setTime(seconds) {
    const time = this.animation.start + seconds;
    if (time === this.time) return;
    this.time = time;
    const run = this.animation.at(time);
    if (run !== this.#run) this.#build(run);
    this.#work(() => this.#parts.forEach(({ mesh }) => mesh.geometry.show(time)));
    this.#colour();
  }

  /** Return the vertex of the file's object that each vertex of a mesh is. */
  sourcesOf(mesh) {
    return this.#parts.find((part) => part.mesh === mesh).sources;
  }

  /**
   * Take materials by name from a loaded glTF file, and for objects without names of materials those of the mesh with the
   * object's name. UVs turn to glTF's convention, V down, which the textures of `GLTFLoader` expect.
   */
  useMaterialsFrom(gltf) {
    this.#originals = { materials: new Map(), meshes: new Map() };
    const { materials, meshes } = this.#originals;
    gltf.scene.traverse(({ name, userData, material }) => {
      for (const own of [material ?? []].flat()) if (!materials.has(own.name)) materials.set(own.name, own);
      for (const key of material ? [name, userData.name] : []) if (!meshes.has(key)) meshes.set(key, material);
    });
    for (const part of this.#parts) this.#useOriginals(part);
  }

  #useOriginals({ mesh }) {
    if (!this.#originals) return;
    const { materials, meshes } = this.#originals;
    const { uv, color } = mesh.geometry.attributes;
    const take = (own) => {
      const found = materials.get(own.name) ?? (own.name ? null : meshes.get(mesh.name));
      if (!found?.vertexColors || color) return found ?? own;
      return Object.assign(found.clone(), { vertexColors: false });
    };
    mesh.material = Array.isArray(mesh.material) ? mesh.material.map(take) : take(mesh.material);
    const maps = [mesh.material].flat().flatMap((own) => Object.values(own).filter((value) => value?.isTexture));
    if (!uv || uv.isDown || !maps.some(({ flipY }) => flipY === false)) return;
    for (let k = 1; k < uv.array.length; k += 2) uv.array[k] = 1 - uv.array[k];
    Object.assign(uv, { isDown: true, needsUpdate: true });
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
    this.#fieldOptions = options;
    for (const { mesh } of this.#parts) {
      if (before) mesh.geometry.deleteAttribute(before.attribute.name);
      if (before || this.#colours) this.#setVertexColors(mesh.material);
    }
    if (this.#isSplit === wasSplit) {
      for (const part of this.#parts) this.#addFieldTo(part);
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

  #addFieldTo(part) {
    if (!this.#colours) return;
    const { name, size } = this.#colours.attribute;
    const { mesh, object, sources, corners } = part;
    mesh.geometry.setAttribute(name, new BufferAttribute(new Float32Array(size * sources.length), size));
    part.rows = rowsOfDrawn(this.#colours.in(this.#run), this.#run, object, sources, corners);
  }

  /** Fill the field's attribute at the current time. */
  #colour() {
    const colours = this.#colours;
    if (!colours) return;
    const values = colours.in(this.#run) ? colours.values(this.#run, this.time) : [];
    for (const { mesh, rows } of this.#parts) {
      const attribute = mesh.geometry.attributes[colours.attribute.name];
      colours.fill(attribute.array, values, rows);
      attribute.needsUpdate = true;
    }
  }

  /** Upload the next group of frames, when there is time to spare. */
  prefetch() {
    this.#parts[0]?.mesh.geometry.prefetch();
  }

  /** Return another group that shares the decoder and the materials, with a time of its own. */
  clone(recursive = true) {
    return new DeformingGroup(this.animation, { renderer: this.#renderer }).copy(this, recursive);
  }

  /** Copy a group that shows the same animation. */
  copy(source, recursive = true) {
    super.copy(source, false);
    this.#isClone = true;
    this.#originals = source.#originals;
    if (source.#colours) this.setField(source.#colours.name, source.#fieldOptions);
    this.setTime(source.time - source.animation.start);
    source.#parts.forEach(({ mesh }, index) => {
      const own = this.#parts[index].mesh;
      const { geometry } = own;
      own.copy(mesh, recursive);
      own.geometry = geometry;
    });
    for (const part of this.#parts) this.#useOriginals(part);
    const others = source.children.filter((child) => !source.#parts.some(({ mesh }) => mesh === child));
    if (recursive) for (const child of others) this.add(child.clone());
    return this;
  }

  /** Free geometries and materials; the last group that shares the decoder frees everything decoded. */
  dispose() {
    if (this.#isDisposed) return;
    this.#isDisposed = true;
    if (!this.#isClone) for (const { mesh } of this.#parts) [mesh.material].flat().forEach((own) => own.dispose());
    this.#clear();
    release(this.animation);
  }

  /** Show the same time in new geometries. */
  #showAgain() {
    const { time } = this;
    this.time = null;
    this.setTime(time - this.animation.start);
  }

  #work(work) {
    if (this.#graphics) this.#graphics.work(work);
    else work();
  }

  #clear() {
    this.#work(() => this.#parts.forEach(({ mesh }) => mesh.geometry.dispose()));
    for (const { mesh } of this.#parts) this.remove(mesh);
    this.#parts = [];
  }

  #build(run) {
    const before = this.#parts.map(({ mesh }) => mesh);
    const parts = run.objects.map((object, index) => ({ object: index, ...this.#describe(run, object, index) }));
    this.#clear();
    this.#run = run;
    this.#work(() => parts.forEach((part) => this.#addPart(part, before[part.object])));
  }

  #describe(run, object, index) {
    const own = { ...object, firstVertex: 0 };
    const { triangles, faces } = trianglesOf([own]);
    if (!triangles.length) return { ...describeFaceless(own), names: [""], groups: [] };
    const attributes = [...run.attributes(index), ...changingUvs(run, index)];
    const { order, groups, names } = materialsOf(attributes, faces);
    return { ...splitAtUvSeams(attributes, own, triangles, this.#colours?.splits(run) ?? false, order), names, groups };
  }

  #addPart(part, before) {
    const run = this.#run;
    const { kind, object, sources, index, uvs, names, groups } = part;
    const { name, firstVertex } = run.object(object);
    const rows = sources.map((vertex) => firstVertex + vertex);
    const geometry = new MovingGeometry({ animation: this.animation, run, sources: rows });
    if (index) geometry.setIndex(new BufferAttribute(index, 1));
    if (uvs) geometry.setAttribute("uv", new BufferAttribute(uvs, 2));
    for (const group of groups) geometry.addGroup(group.start, group.count, group.materialIndex);
    geometry.setGraphics(this.#graphics);
    const isKept = before?.type === kind && before.name === name && [before.material].flat().length === names.length;
    const made = names.length > 1 ? names.map((own) => this.#material(kind, own)) : this.#material(kind, names[0]);
    const mesh = new OBJECTS[kind](geometry, isKept ? before.material : made);
    mesh.name = name;
    // Culling needs a bounding sphere per frame, which only the decoder could compute; drawing unseen vertices is
    // cheaper.
    mesh.frustumCulled = !geometry.hasGpuBuffers;
    part.mesh = mesh;
    this.#useOriginals(part);
    if (this.#colours) this.#setVertexColors(mesh.material);
    this.#addFieldTo(part);
    this.#parts.push(part);
    this.add(mesh);
  }

  /** Return the material of a name, which all objects share; without a name, one of its own. */
  #material(kind, name) {
    const key = `${kind} ${name}`;
    const found = (name && this.#materials.get(key)) || Object.assign(MATERIALS[kind](), { name });
    this.#materials.set(key, found);
    return found;
  }
}
