// Loads a file with the loader for three.js in Node, and prints where three.js has the vertices at some times.
import { readFile } from "node:fs/promises";

import { PDEAnimLoader } from "pdeanim/three";

const [path, ...steps] = process.argv.slice(2);
const data = await readFile(path);
const loader = new PDEAnimLoader();
const group = await new Promise((resolve, reject) => loader.parse(data, resolve, reject));
const found = steps.map((text) => {
  const step = JSON.parse(text);
  if (typeof step === "number") group.setTime(step);
  else group.setField(step.name, step.options);
  return group.children.map((mesh) => ({
    name: mesh.name,
    type: mesh.type,
    points: [...mesh.geometry.attributes.position.array],
    normals: [...mesh.geometry.attributes.normal.array],
    uvs: mesh.geometry.attributes.uv ? [...mesh.geometry.attributes.uv.array] : null,
    index: mesh.geometry.index ? [...mesh.geometry.index.array] : null,
    sources: [...group.sourcesOf(mesh)],
    material: mesh.material.type,
    vertexColors: mesh.material.vertexColors,
    colors: mesh.geometry.attributes.color ? [...mesh.geometry.attributes.color.array] : null,
    field: mesh.geometry.attributes.field ? [...mesh.geometry.attributes.field.array] : null,
  }));
});
group.dispose();
console.log(JSON.stringify({ duration: group.duration, found }));
