// A glTF file with motion in Babylon.js. ?time=0.5 shows one moment [s].
import { ArcRotateCamera } from "@babylonjs/core/Cameras/arcRotateCamera.js";
import { Engine } from "@babylonjs/core/Engines/engine.js";
import { HemisphericLight } from "@babylonjs/core/Lights/hemisphericLight.js";
import { ImportMeshAsync } from "@babylonjs/core/Loading/sceneLoader.js";
import { Vector3 } from "@babylonjs/core/Maths/math.vector.js";
import { Scene } from "@babylonjs/core/scene.js";
import "@babylonjs/core/Animations/animatable.js";
import "@babylonjs/loaders/glTF/2.0/glTFLoader.js";
import { registerMeshMotion } from "pdeanim/babylon";

registerMeshMotion();

const engine = new Engine(document.querySelector("canvas"), true);
const scene = new Scene(engine);
scene.useRightHandedSystem = true;  // as glTF
scene.clearColor.set(0.44, 0.5, 0.56, 1);
const camera = new ArcRotateCamera("camera", 1.19, 1.27, 3, new Vector3(0.5, 0.9, 0), scene);
camera.minZ = 0.1;
camera.attachControl();
new HemisphericLight("sky", new Vector3(0.3, 1, 0.5), scene);

const { animationGroups } = await ImportMeshAsync(new URL("../clip.glb", import.meta.url).href, scene);
const moment = new URLSearchParams(location.search).get("time");
for (const group of animationGroups) {
  group.start(true);
  if (moment) group.goToFrame(60 * moment).pause();
}
await scene.whenReadyAsync();
engine.runRenderLoop(() => scene.render());
