/** The glTF extension PDECODEC_mesh_motion for three.js's `GLTFLoader`. */
import {
  AnimationClip,
  Box3,
  InstancedMesh,
  Line,
  LineLoop,
  LineSegments,
  Mesh,
  Points,
  Vector3,
  VectorKeyframeTrack,
} from "three";

import { EXTENSION, Motions, extensionOf, fansOf, rowsOf } from "./gltf-motion.js";
import { MovingGeometry, shapeOf } from "./three-geometry.js";
import { graphicsOf } from "./three-graphics.js";

/**
 * Return a class of objects that a motion moves. An `AnimationMixer` writes `motionState`: the sum of weighted seconds since
 * the first frame, and the sum of weights. So actions of one clip blend, and what is missing to a weight of 1 is the
 * shape of the first frame.
 */
const moving = (Base) =>
  class extends Base {
    motionState = [0, 0];
    #shown = [0, 0];
    #renderer = null;
    #isShared = false;

    /** Seconds since the first frame, for programs without a mixer. */
    get motionTime() {
      const [sum, weight] = this.motionState;
      return weight > 0 ? sum / weight : 0;
    }

    set motionTime(seconds) {
      this.motionState[0] = seconds;
      this.motionState[1] = 1;
    }

    /** Whether the graphics processor computed the shape that is shown. */
    get isOnGpu() {
      return this.geometry.isOnGpu === true;
    }

    /** Bring the geometry to the current time; drawing and rays do it. */
    updateMotion() {
      const { geometry, motionState } = this;
      const isShown = !geometry.isStale && motionState.every((value, k) => value === this.#shown[k]);
      if (!geometry.isMoving || isShown) return;
      this.#shown = [...motionState];
      geometry.setGraphics(this.#isShared ? null : graphicsOf(this.#renderer));
      const weight = Math.min(motionState[1], 1);
      const { start } = geometry.shape.animation;
      if (weight > 0) geometry.show(start + this.motionTime, weight);
      else geometry.show(start);
    }

    updateMatrixWorld(force) {
      this.updateMotion();
      super.updateMatrixWorld(force);
    }

    raycast(raycaster, hits) {
      this.updateMotion();
      super.raycast(raycaster, hits);
    }

    /** From the next change on, evaluate with the renderer that draws; with the decoder if several do. */
    onBeforeRender(renderer) {
      this.#renderer ??= renderer;
      if (renderer === this.#renderer || this.#isShared) return;
      this.#isShared = true;
      this.#shown = [NaN, NaN];
    }

    copy(source, recursive) {
      super.copy(source, recursive);
      this.geometry = source.geometry.clone();
      this.motionState = [...source.motionState];
      return this;
    }
  };

const MOVING = Object.fromEntries(
  Object.entries({ InstancedMesh, Line, LineLoop, LineSegments, Mesh, Points }).map(([name, Base]) => [name, moving(Base)]),
);

/**
 * Plays motions of glTF files: `loader.register((parser) => new GLTFMeshMotionExtension(parser))`. Meshes move; motions are
 * clips of `gltf.animations`. Disposing of all geometries frees the decoder.
 */
export class GLTFMeshMotionExtension {
  constructor(parser) {
    this.name = EXTENSION;
    this.parser = parser;
    this.motions = new Motions(parser.json, (index) => parser.getDependency("bufferView", index));
  }

  /** Load a mesh, and replace the objects of primitives that have a motion. */
  loadMesh(index) {
    const { primitives } = this.parser.json.meshes[index];
    return primitives.some((primitive) => extensionOf(primitive)) ? this.#loadMesh(index, primitives) : null;
  }

  async #loadMesh(index, primitives) {
    const loaded = await this.parser.loadMesh(index);
    const objects = primitives.length === 1 ? [loaded] : [...loaded.children];
    let shapes;
    try {
      shapes = await this.#describe(primitives, objects);
    } catch (error) {
      console.error(`${EXTENSION}: mesh ${index} stays still: ${error.message}`);
      return loaded;
    }
    const replaced = objects.map((object, k) => (shapes[k] ? this.#replace(object, shapes[k]) : object));
    if (primitives.length === 1) return replaced[0];
    loaded.remove(...objects);
    return loaded.add(...replaced);
  }

  async #describe(primitives, objects) {
    const shapes = await Promise.all(
      primitives.map(async (primitive, k) => {
        const own = extensionOf(primitive);
        if (!own) return null;
        const animation = await this.motions.open(own.motion);
        const map = own.vertexMap === undefined ? null : await this.parser.getDependency("accessor", own.vertexMap);
        const { attributes, index } = objects[k].geometry;
        const rows = rowsOf(animation, own, map && valuesOf(map), attributes.position.count);
        const bounds = new Box3(new Vector3(...own.min), new Vector3(...own.max));
        const normals = objects[k].isMesh && attributes.normal ? valuesOf(attributes.normal) : null;
        const tangents = normals && attributes.tangent ? valuesOf(attributes.tangent) : null;
        const corners = index && valuesOf(index);
        return { motion: own.motion, animation, run: animation, sources: rows, bounds, rows, normals, tangents, index: corners };
      }),
    );
    for (const animation of new Set(shapes.map((shape) => shape?.animation))) {
      const own = shapes.filter((shape) => shape?.normals && shape.animation === animation);
      fansOf(own).forEach((fans, k) => (own[k].fans = fans));
    }
    return shapes;
  }

  #replace(object, { motion, animation, run, sources, bounds, fans = null, normals, tangents }) {
    const hasNormals = normals !== null;
    const geometry = new MovingGeometry({ motion, animation, run, sources, bounds, fans, tangents, hasNormals });
    geometry.copyRest(object.geometry);
    const replaced = new MOVING[object.type](geometry, object.material);
    replaced.name = object.name;
    replaced.userData = object.userData;
    this.parser.associations.set(replaced, this.parser.associations.get(object));
    return replaced;
  }

  /** Replace instances (EXT_mesh_gpu_instancing) that were made of a moving mesh by moving ones. */
  #replaceInstances(object) {
    const geometry = new MovingGeometry(shapeOf(object.geometry));
    geometry.copyRest(object.geometry);
    const replaced = new MOVING.InstancedMesh(geometry, object.material, object.count);
    InstancedMesh.prototype.copy.call(replaced, object, false);
    // Tracks of animations name objects by their identifiers.
    Object.assign(replaced, { geometry, uuid: object.uuid });
    const { parent } = object;
    parent.children[parent.children.indexOf(object)] = replaced;
    Object.assign(replaced, { parent });
    for (const child of [...object.children]) replaced.add(child);
    object.parent = null;
    this.parser.associations.set(replaced, this.parser.associations.get(object));
  }

  /** Offer motions as clips, or as tracks of the animations that they are a part of. */
  afterRoot({ scenes, animations }) {
    const objects = this.motions.list.map(() => new Set());
    for (const scene of scenes) {
      const instanced = [];
      scene.traverse((object) => object.isInstancedMesh && shapeOf(object.geometry) && instanced.push(object));
      for (const object of instanced) this.#replaceInstances(object);
      scene.traverse((object) => object.motionState && objects[object.geometry.shape.motion].add(object));
    }
    objects.forEach((own, index) => {
      if (own.size === 0) return;
      const { times, seconds } = this.motions.keysOf(index);
      const states = seconds.flatMap((second) => [second, 1]);
      const tracks = [...own].map(
        ({ name, uuid }) => new VectorKeyframeTrack(`${name || uuid}.motionState`, times, states),
      );
      const whole = animations[this.motions.list[index].animation];
      if (whole) {
        whole.tracks.push(...tracks);
        whole.resetDuration();
      } else {
        animations.push(new AnimationClip(this.motions.nameOf(index), -1, tracks));
      }
    });
    return null;
  }
}

/** Return an attribute's numbers in a row; its own array, where it holds nothing else. */
function valuesOf(attribute) {
  const { count, itemSize, array, normalized } = attribute;
  if (attribute.isBufferAttribute && !normalized && array.length === count * itemSize) return array;
  const values = new Float64Array(count * itemSize);
  for (let k = 0; k < values.length; k++) values[k] = attribute.getComponent(Math.floor(k / itemSize), k % itemSize);
  return itemSize === 1 ? values : Float32Array.from(values);
}
