/**
 * The glTF extension PDECODEC_mesh_motion for gltf-transform: `io.registerExtensions([PDECODECMeshMotion])`.
 *
 * In a document, the map of a primitive's vertices is an attribute (`VERTEX_ATTRIBUTE`), so that functions which merge,
 * drop or reorder vertices change it, too. In a file it stands in the extension.
 */
import { Extension, ExtensionProperty, GLB_BUFFER, PropertyType, RefList } from "@gltf-transform/core";

const EXTENSION = "PDECODEC_mesh_motion";

/** Name of the attribute that maps a primitive's vertices to those of the motion. */
export const VERTEX_ATTRIBUTE = "_PDECODEC_VERTEX";

const MOTIONS = "MeshMotions";

/** A `.pdeanim` file and its place in time. */
export class Motion extends ExtensionProperty {
  static EXTENSION_NAME = EXTENSION;

  init() {
    this.extensionName = EXTENSION;
    this.propertyType = "Motion";
    this.parentTypes = [MOTIONS, "PrimitiveMotion"];
  }

  getDefaults() {
    return Object.assign(super.getDefaults(), { data: new Uint8Array(), settings: {}, animation: null });
  }

  /** The bytes of the file. */
  getData() {
    return this.get("data");
  }

  setData(data) {
    return this.set("data", data);
  }

  /** `duration` and `startTime` [s], `frameRate` [frames/s]. */
  getSettings() {
    return this.get("settings");
  }

  setSettings(settings) {
    return this.set("settings", settings);
  }

  /** The animation that the motion is a part of, or null. */
  getAnimation() {
    return this.getRef("animation");
  }

  setAnimation(animation) {
    return this.setRef("animation", animation);
  }
}

/** The motions of a document; the root has them. */
export class MeshMotions extends ExtensionProperty {
  static EXTENSION_NAME = EXTENSION;

  init() {
    this.extensionName = EXTENSION;
    this.propertyType = MOTIONS;
    this.parentTypes = [PropertyType.ROOT];
  }

  getDefaults() {
    return Object.assign(super.getDefaults(), { motions: new RefList() });
  }

  listMotions() {
    return this.listRefs("motions");
  }

  addMotion(motion) {
    return this.addRef("motions", motion);
  }
}

/** Which motion moves a primitive, and its bounds at all times. */
export class PrimitiveMotion extends ExtensionProperty {
  static EXTENSION_NAME = EXTENSION;

  init() {
    this.extensionName = EXTENSION;
    this.propertyType = "PrimitiveMotion";
    this.parentTypes = [PropertyType.PRIMITIVE];
  }

  getDefaults() {
    return Object.assign(super.getDefaults(), { motion: null, vertexMap: null, settings: {} });
  }

  getMotion() {
    return this.getRef("motion");
  }

  setMotion(motion) {
    return this.setRef("motion", motion);
  }

  /** `min`, `max` and `firstVertex`. */
  getSettings() {
    return this.get("settings");
  }

  setSettings(settings) {
    return this.set("settings", settings);
  }
}

export class PDECODECMeshMotion extends Extension {
  static EXTENSION_NAME = EXTENSION;
  extensionName = EXTENSION;
  prewriteTypes = [PropertyType.ACCESSOR];

  createMotion(name = "") {
    return new Motion(this.document.getGraph(), name);
  }

  createMotions() {
    return new MeshMotions(this.document.getGraph());
  }

  createPrimitiveMotion() {
    return new PrimitiveMotion(this.document.getGraph());
  }

  read(context) {
    const { json, resources } = context.jsonDoc;
    const motions = this.createMotions();
    for (const { name, bufferView, animation, ...settings } of json.extensions?.[EXTENSION]?.motions ?? []) {
      const { buffer, byteOffset = 0, byteLength } = json.bufferViews[bufferView];
      const bytes = resources[json.buffers[buffer].uri ?? GLB_BUFFER];
      const data = bytes.slice(byteOffset, byteOffset + byteLength);
      const motion = this.createMotion(name).setData(data).setSettings(settings);
      motions.addMotion(motion.setAnimation(context.animations[animation] ?? null));
    }
    this.document.getRoot().setExtension(EXTENSION, motions);
    json.meshes?.forEach((mesh, index) => {
      mesh.primitives.forEach((definition, place) => {
        const { motion, vertexMap, ...settings } = definition.extensions?.[EXTENSION] ?? {};
        if (motion === undefined) return;
        const primitive = context.meshes[index].listPrimitives()[place];
        const own = this.createPrimitiveMotion().setMotion(motions.listMotions()[motion]).setSettings(settings);
        primitive.setExtension(EXTENSION, own);
        const { count } = json.accessors[definition.attributes.POSITION];
        primitive.setAttribute(VERTEX_ATTRIBUTE, context.accessors[vertexMap] ?? this.#createMap(count));
      });
    });
    return this;
  }

  /** Return a map of `count` vertices to themselves: the order may change. */
  #createMap(count) {
    const [buffer] = this.document.getRoot().listBuffers();
    const array = Uint32Array.from({ length: count }, (_, vertex) => vertex);
    return this.document.createAccessor("").setArray(array).setBuffer(buffer);
  }

  /** Take maps out of the attributes, so that they are written as what they are, and add the files to the buffer. */
  prewrite(context) {
    for (const [primitive, own] of this.#primitives()) {
      own.setRef("vertexMap", primitive.getAttribute(VERTEX_ATTRIBUTE), { usage: "OTHER" });
      primitive.setAttribute(VERTEX_ATTRIBUTE, null);
    }
    const root = this.document.getRoot();
    const buffer = root.listBuffers()[0] ?? this.document.createBuffer();
    const views = context.otherBufferViews.get(buffer) ?? [];
    const motions = root.getExtension(EXTENSION)?.listMotions() ?? [];
    context.otherBufferViews.set(buffer, [...views, ...motions.map((motion) => motion.getData())]);
    return this;
  }

  write(context) {
    const { json } = context.jsonDoc;
    const root = this.document.getRoot();
    const motions = root.getExtension(EXTENSION)?.listMotions() ?? [];
    if (motions.length) {
      const list = motions.map((motion) => ({
        ...(motion.getName() && { name: motion.getName() }),
        bufferView: context.otherBufferViewsIndexMap.get(motion.getData()),
        ...(motion.getAnimation() && { animation: context.animationIndexMap.get(motion.getAnimation()) }),
        ...motion.getSettings(),
      }));
      (json.extensions ??= {})[EXTENSION] = { motions: list };
    }
    root.listMeshes().forEach((mesh, index) => {
      mesh.listPrimitives().forEach((primitive, place) => {
        const own = primitive.getExtension(EXTENSION);
        if (!own) return;
        const map = own.getRef("vertexMap");
        const definition = json.meshes[context.meshIndexMap.get(mesh) ?? index].primitives[place];
        (definition.extensions ??= {})[EXTENSION] = {
          motion: motions.indexOf(own.getMotion()),
          ...(map && { vertexMap: context.accessorIndexMap.get(map) }),
          ...own.getSettings(),
        };
        own.setRef("vertexMap", null);
        primitive.setAttribute(VERTEX_ATTRIBUTE, map);
      });
    });
    return this;
  }

  #primitives() {
    const primitives = this.document.getRoot().listMeshes().flatMap((mesh) => mesh.listPrimitives());
    return primitives.map((primitive) => [primitive, primitive.getExtension(EXTENSION)]).filter(([, own]) => own);
  }
}
