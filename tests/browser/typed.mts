import { Document, NodeIO } from "@gltf-transform/core";
import { HttpSource, MemorySource, PdeAnimation, PdeanimError, compile } from "pdeanim";
import { MeshMotions, Motion, PDECODECMeshMotion, PrimitiveMotion, VERTEX_ATTRIBUTE } from "pdeanim/gltf-transform";
import { GpuMotion } from "pdeanim/gpu";
import { WebGpuMotion } from "pdeanim/webgpu";
import { trianglesOf, normalsOf } from "pdeanim/mesh";
import { GLTFMeshMotionExtension, PDEAnimLoader, DeformingGroup, type MovedByMotion } from "pdeanim/three";
import { AnimationMixer, Mesh, Scene, WebGLRenderer } from "three";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { WebGPURenderer } from "three/webgpu";

async function play(gl: WebGL2RenderingContext, device: GPUDevice): Promise<number> {
  await compile();
  const animation = await PdeAnimation.open("cloth.pdeanim", { maxMemory: 2 ** 30 });
  await animation.prepare(1.25);
  const out: Float32Array = animation.positions(1.25, { object: 0, out: new Float32Array(3) });
  const [field] = animation.fieldList;
  const values = animation.field<Float64Array>(field!.name, 1.25, { derivative: 1, out: new Float64Array(field!.rows) });
  values.fill(field!.bound);
  const { triangles } = trianglesOf(animation.objects);
  normalsOf(out, triangles);
  const drawn = new GpuMotion(gl, animation);
  drawn.evaluate(1.25);
  const buffer: WebGLBuffer = drawn.positions;
  const other = new WebGpuMotion(device, animation, [new Uint32Array([0, 1])]);
  const vertices: GPUBuffer = other.drawn[0]!.positions;
  const read: Float32Array = await other.readPositions();
  const clip: DeformingGroup = await new PDEAnimLoader().setRenderer(new WebGPURenderer()).loadAsync("a");
  new PDEAnimLoader().setRenderer(new WebGLRenderer());
  new Scene().add(clip);
  clip.setTime(0.5);
  clip.setField(field!.name, { colormap: ["white", "#f00"], range: [0, 1], component: 0 });
  clip.setField(null);
  const copy: DeformingGroup = clip.clone();
  const sources: Uint32Array = copy.sourcesOf(copy.children[0]!);
  const gltf = await new GLTFLoader().register((parser) => new GLTFMeshMotionExtension(parser)).loadAsync("b");
  new PDEAnimLoader().useMaterialsFrom(gltf).setPath(`${sources.length}`);
  new AnimationMixer(gltf.scene).clipAction(gltf.animations[0]!).play();
  (gltf.scene.children[0] as Mesh & MovedByMotion).motionTime = 0.5;
  // @ts-expect-error there is no such colour map
  clip.setField("stress", { colormap: "rainbow" });
  // @ts-expect-error times are numbers
  animation.positions("1.25");
  return read.length + (clip.isOnGpu ? 1 : 0) + (buffer && vertices ? 1 : 0);
}

async function transform(document: Document, isRemote: boolean): Promise<number> {
  const source = isRemote ? await HttpSource.open("cloth.pdeanim") : new MemorySource(new ArrayBuffer(8));
  const io = new NodeIO().registerExtensions([PDECODECMeshMotion]);
  const extension = document.createExtension(PDECODECMeshMotion);
  const motion: Motion = extension.createMotion("wave").setData(source.read(0, 8)!).setSettings({ duration: 1 });
  const motions: MeshMotions = extension.createMotions().addMotion(motion);
  document.getRoot().setExtension("PDECODEC_mesh_motion", motions);
  const primitive = document.createPrimitive().setAttribute(VERTEX_ATTRIBUTE, document.createAccessor());
  const own: PrimitiveMotion = extension.createPrimitiveMotion().setMotion(motion);
  primitive.setExtension("PDECODEC_mesh_motion", own.setSettings({ min: [0, 0, 0], max: [1, 1, 1] }));
  return (await io.writeBinary(document)).length;
}

transform satisfies (document: Document, isRemote: boolean) => Promise<number>;
play satisfies (gl: WebGL2RenderingContext, device: GPUDevice) => Promise<number>;

export const codeOf = (error: unknown): string | null => (error instanceof PdeanimError ? error.code : null);
