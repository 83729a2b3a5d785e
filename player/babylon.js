/** The glTF extension PDECODEC_mesh_motion for Babylon.js's glTF loader. */
import { Animation } from "@babylonjs/core/Animations/animation.js";
import { AnimationGroup } from "@babylonjs/core/Animations/animationGroup.js";
import { VertexBuffer } from "@babylonjs/core/Buffers/buffer.js";
import { BoundingInfo } from "@babylonjs/core/Culling/boundingInfo.js";
import { Vector2, Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { registerGLTFExtension } from "@babylonjs/loaders/glTF/2.0/glTFLoaderExtensionRegistry.js";

import { graphicsOf } from "./babylon-graphics.js";
import { DecodedRun, gatherRows, release, retain, turnTangents } from "./decoded.js";
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
  #state = new Vector2(0, 0);
  #shown = null;  // time and weight of the shape; the loader's vertices at first
  #isRead = true;  // whether the arrays have that shape
  #graphics;
  #motion;
  #pair;

  constructor(mesh, shape) {
    Object.assign(this, { mesh, shape, decoded: DecodedRun.of(shape.animation) });
    movers.set(mesh, this);
    mesh.motionState ??= new Vector2(0, 0);
    Object.defineProperty(mesh, "isOnGpu", { get: () => this.#isOnGpu });
    retain(shape.animation);
    const read = (kind) => mesh.getVerticesData(kind)?.slice();
    this.points = read(VertexBuffer.PositionKind);
    this.normals = shape.fans && read(VertexBuffer.NormalKind);
    this.firstTangents = this.normals && read(VertexBuffer.TangentKind);
    this.tangents = this.firstTangents?.slice();
    const scene = mesh.getScene();
    const graphics = graphicsOf(scene.getEngine());
    // Shaders of ours write no tangents.
    this.#graphics = graphics?.holds(shape.animation) && !this.tangents ? graphics : null;
    if (this.#graphics) this.restore();
    else for (const [kind, values] of this.#arrays) mesh.setVerticesData(kind, values, true);
    this.#setBounds();
    const drawing = scene.onBeforeRenderObservable.add(() => this.#update());
    const adding = scene.onNewMeshAddedObservable.add((added) => this.#follow(added));
    mesh.onDisposeObservable.addOnce(() => {
      drawing.remove();
      adding.remove();
      this.#freeBuffers();
      release(shape.animation);
    });
  }

  get #isOnGpu() {
    return Boolean(this.#pair && this.#motion.isOnGpu && this.#shown?.weight === 1);
  }

  get #arrays() {
    const { PositionKind, NormalKind, TangentKind } = VertexBuffer;
    const { points, normals, tangents } = this;
    return [[PositionKind, points], [NormalKind, normals], [TangentKind, tangents]].filter(([, values]) => values);
  }

  /** Draw from new buffers of the graphics processor: at first, and after a lost context. */
  restore() {
    const { mesh, shape, normals } = this;
    this.#motion = this.#graphics.borrow(shape.animation, this);
    this.#pair = this.#graphics.work(() => this.#motion.addDrawn(shape.rows, shape.fans));
    this.#show();
    const use = (kind, buffer, values) =>
      mesh.setVerticesBuffer(this.#graphics.vertexBuffer(kind, buffer, () => this.#read(values)));
    use(VertexBuffer.PositionKind, this.#pair.positions, this.points);
    if (normals) use(VertexBuffer.NormalKind, this.#pair.normals, normals);
    this.#setBounds();
  }

  #setBounds() {
    const { mesh, shape: { low, high } } = this;
    for (const own of [mesh, ...mesh.instances]) own.setBoundingInfo(new BoundingInfo(low, high, own.getWorldMatrix()));
    if (!mesh.hasThinInstances) return;
    mesh.rawBoundingInfo = new BoundingInfo(low, high);
    mesh._thinInstanceDataStorage.boundingVectors.length = 0;  // corners of the first frame's box
    mesh.thinInstanceRefreshBoundingInfo();
  }

  #freeBuffers() {
    if (!this.#pair) return;
    // Babylon.js frees buffers of vertices when it has drawn.
    this.#pair.positions = null;
    if (this.normals) this.#pair.normals = null;
    this.#graphics.work(() => this.#motion.removeDrawn(this.#pair));
    this.#graphics.giveBack(this.shape.animation, this);
    this.#pair = null;
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
    const state = this.mesh.motionState;
    if (state.equals(this.#state)) return;
    this.#state.copyFrom(state);
    const weight = Math.min(state.y, 1);
    const time = this.shape.animation.start + (weight > 0 ? state.x / state.y : 0);
    this.#shown = { time, weight: weight > 0 ? weight : 1 };
    this.#isRead = false;
    this.#show();
  }

  #show() {
    const { mesh, points, normals } = this;
    if (this.#pair && this.#shown?.weight === 1) {
      this.#graphics.work(() => this.#motion.evaluate(this.#shown.time, [this.#pair]));
      mesh._resetPointsArrayCache();  // of rays
    } else if (this.#pair) {
      this.#read();
      this.#graphics.work(() => this.#motion.write(this.#pair, points, normals));
      mesh._resetPointsArrayCache();
    } else {
      this.#read();
      for (const [kind, values] of this.#arrays) mesh.updateVerticesData(kind, values);
    }
  }

  /** Bring the arrays to the shape that is shown, and return `values`, one of them. */
  #read(values) {
    if (this.#isRead) return values;
    const { shape, decoded, points, normals, tangents } = this;
    const { time, weight } = this.#shown;
    retain(shape.animation);  // a copy may be read when its source is gone
    gatherRows(points, decoded.points(time, weight), shape.rows);
    if (normals) gatherRows(normals, decoded.normals(time, weight, shape.fans), shape.fans.of, shape.fans.stored);
    if (tangents) turnTangents(tangents, this.firstTangents, normals);
    release(shape.animation);
    this.#isRead = true;
    return values;
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
