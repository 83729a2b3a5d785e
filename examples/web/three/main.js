// A glTF file with motion in three.js. ?time=0.5 shows one moment [s].
import * as THREE from "three";
import { OrbitControls } from "three/addons/controls/OrbitControls.js";
import { GLTFLoader } from "three/addons/loaders/GLTFLoader.js";
import { GLTFMeshMotionExtension } from "pdeanim/three";

const renderer = new THREE.WebGLRenderer({ antialias: true });
renderer.setSize(innerWidth, innerHeight);
renderer.shadowMap.enabled = true;
document.body.append(renderer.domElement);

const scene = new THREE.Scene();
scene.background = new THREE.Color("slategray");
const sun = new THREE.DirectionalLight("white", 3);
sun.position.set(2, 4, 3);
sun.castShadow = true;
const ground = new THREE.Mesh(new THREE.CircleGeometry(2).rotateX(-Math.PI / 2), new THREE.MeshStandardMaterial());
ground.receiveShadow = true;
scene.add(sun, new THREE.HemisphereLight("white", "gray", 1), ground);
const camera = new THREE.PerspectiveCamera(50, innerWidth / innerHeight, 0.1, 100);
camera.position.set(1.5, 1.8, 2.5);
const controls = new OrbitControls(camera, renderer.domElement);
controls.target.set(0.5, 0.9, 0);

const loader = new GLTFLoader();
loader.register((parser) => new GLTFMeshMotionExtension(parser));
const gltf = await loader.loadAsync(new URL("../clip.glb", import.meta.url).href);
gltf.scene.traverse((object) => (object.castShadow = object.isMesh));
scene.add(gltf.scene);
const mixer = new THREE.AnimationMixer(gltf.scene);
for (const clip of gltf.animations) mixer.clipAction(clip).play();

const moment = new URLSearchParams(location.search).get("time");
renderer.setAnimationLoop((milliseconds) => {
  mixer.setTime(Number(moment ?? milliseconds / 1000));
  controls.update();
  renderer.render(scene, camera);
});
