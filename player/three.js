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
import { FileLoader, Loader } from "three";

import { PdeanimError } from "./errors.js";
import { PdeAnimation } from "./pdeanim.js";
import { DeformingGroup } from "./three-group.js";

export { GLTFMeshMotionExtension } from "./three-gltf.js";
export { DeformingGroup } from "./three-group.js";

/** Loads `.pdeanim` files with the interface of three.js loaders. */
export class PDEAnimLoader extends Loader {
  #renderer = null;
  #original = null;

  /** Evaluate on the graphics processor of this renderer, which must be the one that draws; null: use the decoder. */
  setRenderer(renderer) {
    this.#renderer = renderer;
    return this;
  }

  /** Give what is loaded from now on the materials of a glTF file that `GLTFLoader` has loaded; null: none. */
  useMaterialsFrom(gltf) {
    this.#original = gltf;
    return this;
  }

  /** Fetch a file; `onLoad` receives a `DeformingGroup`. */
  load(url, onLoad, onProgress, onError) {
    const loader = new FileLoader(this.manager);
    loader.setPath(this.path);
    loader.setResponseType("arraybuffer");
    loader.setRequestHeader(this.requestHeader);
    loader.setWithCredentials(this.withCredentials);
    const fail = (cause) => {
      const isOurs = cause instanceof PdeanimError;
      const error = isOurs ? cause : Object.assign(new PdeanimError(`${url}: ${cause.message}`, "read-failed"), { cause });
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
    const group = new DeformingGroup(await PdeAnimation.open(data), { renderer: this.#renderer });
    if (this.#original) group.useMaterialsFrom(this.#original);
    return group;
  }
}
