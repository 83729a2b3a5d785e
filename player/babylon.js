/** The glTF extension PDECODEC_mesh_motion for Babylon.js's glTF loader. */
import { Animation } from "@babylonjs/core/Animations/animation.js";
import { AnimationGroup } from "@babylonjs/core/Animations/animationGroup.js";
import { VertexBuffer } from "@babylonjs/core/Buffers/buffer.js";
import { BoundingInfo } from "@babylonjs/core/Culling/boundingInfo.js";
import { Vector2, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { registerGLTFExtension } from "@babylonjs/loaders/glTF/2.0/glTFLoaderExtensionRegistry.js";

import { DecodedRun, gatherRows, release, retain } from "./decoded.js";
import { EXTENSION, Motions, extensionOf, fansOf, rowsOf } from "./gltf-motion.js";

/** Have every glTF file that is loaded from now on play its motions. */
export function registerMeshMotion() {
  registerGLTFExtension(EXTENSION, true, (loader) => new MeshMotionExtension(loader));
}

/** What moves each mesh. */
const movers = new WeakMap();

/**
 * Moves the vertices of one mesh to `mesh.motionState` before the scene is drawn: x is the sum of weighted seconds since
 * the first frame, y the sum of weights. So animations blend, and what lacks to a weight of 1 is the first frame's shape.
 */
class Mover {
  #shown = new Vector2(0, 0);

  constructor(mesh, shape) {
    Object.assign(this, { mesh, shape, decoded: DecodedRun.of(shape.animation) });
    movers.set(mesh, this);
    mesh.motionState ??= new Vector2(0, 0);
    retain(shape.animation);
    this.points = mesh.getVerticesData(VertexBuffer.PositionKind).slice();
    this.normals = shape.fans && mesh.getVerticesData(VertexBuffer.NormalKind).slice();
    mesh.setVerticesData(VertexBuffer.PositionKind, this.points, true);
    if (this.normals) mesh.setVerticesData(VertexBuffer.NormalKind, this.normals, true);
    mesh.setBoundingInfo(new BoundingInfo(shape.low, shape.high));
    const scene = mesh.getScene();
    const drawing = scene.onBeforeRenderObservable.add(() => this.#update());
    const adding = scene.onNewMeshAddedObservable.add((added) => this.#follow(added));
    mesh.onDisposeObservable.addOnce(() => {
      drawing.remove();
      adding.remove();
      release(shape.animation);
    });
  }

  /** Give a copy of the mesh a geometry and a time of its own; the decoder is shared. */
  #follow(added) {
    const scene = added.getScene();
    // A copy has neither its source nor its geometry while it is being added.
    scene.onBeforeRenderObservable.addOnce(() => {
      if (added.source !== this.mesh || movers.has(added) || added.isDisposed()) return;
      added.makeGeometryUnique();
      new Mover(added, this.shape);
    });
  }

  #update() {
    const { mesh, shape, decoded } = this;
    const state = mesh.motionState;
    if (state.equals(this.#shown)) return;
    this.#shown.copyFrom(state);
    const weight = Math.min(state.y, 1);
    const time = shape.animation.start + (weight > 0 ? state.x / state.y : 0);
    const share = weight > 0 ? weight : 1;
    gatherRows(this.points, decoded.points(time, share), shape.rows);
    mesh.updateVerticesData(VertexBuffer.PositionKind, this.points);
    if (!this.normals) return;
    gatherRows(this.normals, decoded.normals(time, share, shape.fans), shape.fans.of, shape.fans.stored);
    mesh.updateVerticesData(VertexBuffer.NormalKind, this.normals);
  }
}

/** Return the corners of a primitive's triangles, by its glTF mode: list, strip or fan; null for points and lines. */
function cornersOf(mesh, mode = 4) {
  if (mode < 4) return null;
  const order = mesh.isUnIndexed ? Array.from({ length: mesh.getTotalVertices() }, (_, k) => k) : mesh.getIndices();
  if (mode === 4) return order;
  const triangle = mode === 5 ? (k) => [k + (k % 2), k + 1 - (k % 2), k + 2] : (k) => [0, k + 1, k + 2];
  return Array.from({ length: Math.max(order.length - 2, 0) }, (_, k) => triangle(k).map((at) => order[at])).flat();
}

class MeshMotionExtension {
  #primitives = [];

  constructor(loader) {
    this.name = EXTENSION;
    this.enabled = loader.isExtensionUsed(EXTENSION);
    this.order = 50;  // before extensions that make instances
    this.loader = loader;
    const read = (index) => loader.loadBufferViewAsync(`/bufferViews/${index}`, loader.gltf.bufferViews[index]);
    this.motions = new Motions(loader.gltf, read);
  }

  dispose() {
    this.loader = null;
  }

  /** Load a primitive with a geometry of its own, and open its motion. */
  _loadMeshPrimitiveAsync(context, name, node, mesh, primitive, assign) {
    const own = extensionOf(primitive);
    const { loader } = this;
    if (!own) return null;
    loader._disableInstancedMesh++;
    const loading = loader._loadMeshPrimitiveAsync(context, name, node, mesh, primitive, assign);
    loader._disableInstancedMesh--;
    return loading.then(async (loaded) => {
      try {
        const animation = await this.motions.open(own.motion);
        const map = own.vertexMap === undefined ? null : loader.gltf.accessors[own.vertexMap];
        const values = map && (await loader._loadIndicesAccessorAsync(`${context}/vertexMap`, map));
        const rows = rowsOf(animation, own, values, loaded.getTotalVertices());
        const [low, high] = [own.min, own.max].map((corner) => Vector3.FromArray(corner));
        const index = cornersOf(loaded, primitive.mode);
        const normals = index && loaded.getVerticesData(VertexBuffer.NormalKind);
        this.#primitives.push({ loaded, node, motion: own.motion, animation, rows, low, high, index, normals });
      } catch (error) {
        console.error(`${EXTENSION}: ${context} stays still: ${error.message}`);
      }
      return loaded;
    });
  }

  /** Move what was loaded, and offer motions as animation groups, or as parts of those that they belong to. */
  onReady() {
    const keyOf = ({ node, motion }) => `${node.index} ${motion}`;
    for (const key of new Set(this.#primitives.map(keyOf))) {
      const shaded = this.#primitives.filter((primitive) => primitive.normals && keyOf(primitive) === key);
      fansOf(shaded).forEach((fans, k) => (shaded[k].fans = fans));
    }
    for (const { loaded, ...shape } of this.#primitives) new Mover(loaded, shape);
    this.motions.list.forEach((motion, index) => {
      const moved = this.#primitives.filter((primitive) => primitive.motion === index);
      if (moved.length) this.#addAnimations(index, moved.map(({ loaded }) => loaded));
    });
  }

  #addAnimations(index, meshes) {
    const { gltf, babylonScene, parent } = this.loader;
    const whole = gltf.animations?.[this.motions.list[index].animation]?._babylonAnimationGroup;
    const group = whole ?? new AnimationGroup(this.motions.nameOf(index), babylonScene);
    const { times, seconds } = this.motions.keysOf(index);
    const fps = parent.targetFps;
    const keys = times.map((time, k) => ({ frame: time * fps, value: new Vector2(seconds[k], 1) }));
    for (const mesh of meshes) {
      const animation = new Animation(`${mesh.name} ${EXTENSION}`, "motionState", fps, Animation.ANIMATIONTYPE_VECTOR2);
      animation.setKeys(keys);
      group.addTargetedAnimation(animation, mesh);
    }
    group.normalize(0);
    // The loader starts, and returns, the groups of this list.
    if (!whole) (gltf.animations ??= []).push({ channels: [], samplers: [], _babylonAnimationGroup: group });
  }
}
