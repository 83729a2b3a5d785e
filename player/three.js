/**
 * Deforming meshes in three.js.
 *
 *     const animation = await new PDEAnimLoader().loadAsync("cloth.pdeanim");
 *     scene.add(animation);
 *     animation.setTime(seconds); // in the loop that draws
 */
import { BufferAttribute, BufferGeometry, DoubleSide, FileLoader, Group, Loader, Mesh, MeshStandardMaterial } from "three";

import { normalsOf, trianglesOf } from "./mesh.js";
import { PdeAnimation } from "./pdeanim.js";

/** Loads `.pdeanim` files, as three's own loaders load theirs. */
export class PDEAnimLoader extends Loader {
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
    return new DeformingGroup(await PdeAnimation.open(data));
  }
}

/** A mesh for each object of a file. */
export class DeformingGroup extends Group {
  /** @param {PdeAnimation} animation */
  constructor(animation) {
    super();
    this.animation = animation;
    this.duration = animation.end - animation.start;
    this.time = null;
    this.#run = null;
    this.setTime(0);
  }

  #run;

  /** Show the shape at a time [s] from the clip's start. */
  setTime(seconds) {
    const time = this.animation.start + seconds;
    if (time === this.time) return;
    this.time = time;
    const run = this.animation.at(time);
    if (run !== this.#run) this.#build(run);
    for (const mesh of this.children) {
      const { position, normal } = mesh.geometry.attributes;
      const { object, sources, triangles, points, normals } = mesh.userData.pdeanim;
      run.positions(time, { object, out: points });
      normalsOf(points, triangles, normals);
      take(position, points, sources);
      take(normal, normals, sources);
      mesh.geometry.boundingSphere = null;
      mesh.geometry.boundingBox = null;
    }
  }

  /** Give back geometries, materials and what is decoded. */
  dispose() {
    this.#clear();
    this.animation.close();
  }

  #clear() {
    for (const mesh of [...this.children]) {
      mesh.geometry.dispose();
      mesh.material.dispose();
      this.remove(mesh);
    }
  }

  #build(run) {
    const materials = this.children.map((mesh) => mesh.material);
    this.#clear();
    this.#run = run;
    run.objects.forEach((object, index) => {
      const own = { ...object, firstVertex: 0 };
      const { triangles } = trianglesOf([own]);
      const { sources, index: indices, uvs } = withUvs(run.attributes(index), own, triangles);
      const geometry = new BufferGeometry();
      geometry.setIndex(new BufferAttribute(indices, 1));
      for (const name of ["position", "normal"]) {
        geometry.setAttribute(name, new BufferAttribute(new Float32Array(3 * sources.length), 3));
      }
      if (uvs) geometry.setAttribute("uv", new BufferAttribute(uvs, 2));
      const mesh = new Mesh(geometry, materials[index] ?? new MeshStandardMaterial({ side: DoubleSide }));
      mesh.name = object.name;
      const count = 3 * object.vertexCount;
      const [points, normals] = [new Float32Array(count), new Float32Array(count)];
      mesh.userData.pdeanim = { object: index, sources, triangles, points, normals };
      this.add(mesh);
    });
  }
}

/** Vertices as three.js has them, one for each pair of vertex and UV: where each comes from, indices, UVs or null. */
function withUvs(attributes, object, triangles) {
  const uv = attributes.find((attribute) => attribute.columns === 2 && attribute.name.toLowerCase().startsWith("uv"));
  if (!uv || (uv.domain !== "corners" && uv.domain !== "vertices")) {
    const sources = Uint32Array.from({ length: object.vertexCount }, (_, vertex) => vertex);
    return { sources, index: triangles, uvs: null };
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
  return { sources: Uint32Array.from(sources), index, uvs: Float32Array.from(uvs) };
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
