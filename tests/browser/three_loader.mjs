// Loads a file with the loader for three.js in Node, and prints where three.js has the vertices at some times.
import { readFile } from "node:fs/promises";

import { PDEAnimLoader } from "../../player/three.js";

const [path, ...times] = process.argv.slice(2);
const data = await readFile(path);
const loader = new PDEAnimLoader();
const group = await new Promise((resolve, reject) => loader.parse(data, resolve, reject));
const found = times.map((time) => {
  group.setTime(Number(time));
  return group.children.map((mesh) => ({
    name: mesh.name,
    type: mesh.type,
    points: [...mesh.geometry.attributes.position.array],
    normals: [...mesh.geometry.attributes.normal.array],
    uvs: mesh.geometry.attributes.uv ? [...mesh.geometry.attributes.uv.array] : null,
    index: mesh.geometry.index ? [...mesh.geometry.index.array] : null,
    sources: [...mesh.userData.pdeanim.sources],
    material: mesh.material.type,
  }));
});
group.dispose();
console.log(JSON.stringify({ duration: group.duration, found }));
