// Decodes files with the player in Node: reads jobs as JSON from standard input, and writes the results to standard
// output.
import { readFile } from "node:fs/promises";
import { text } from "node:stream/consumers";

import { PdeAnimation } from "../../player/pdeanim.js";

// JSON has neither NaN nor 64-bit whole numbers.
const numbersOf = (values) => Array.from(values, (value) => (Number.isNaN(value) ? "NaN" : String(value)));

function meshOf(animation) {
  return animation.objects.map((object, index) => ({
    name: object.name,
    vertices: object.vertexCount,
    faceSizes: [...object.faceSizes],
    faceIndices: [...object.faceIndices],
    lineSizes: [...object.lineSizes],
    lineIndices: [...object.lineIndices],
    attributes: animation.attributes(index).map((attribute) => ({
      name: attribute.name,
      domain: attribute.domain,
      columns: attribute.columns,
      values: [...attribute.values].map(Number),
      indices: attribute.indices && [...attribute.indices],
      labels: attribute.labels,
    })),
  }));
}

async function decoded({ path, address, times }) {
  try {
    const animation = await PdeAnimation.open(address ?? (await readFile(path)), address ? {} : undefined);
    if (!address) animation.verify();
    const found = { times: [...animation.times], frameRate: animation.frameRate, runs: [], fields: [], at: [] };
    for (const time of times) {
      await animation.prepare(time);
      const run = animation.at(time);
      found.at.push({
        positions: [...run.positions(time)],
        velocities: [...run.velocities(time)],
        accelerations: [...run.accelerations(time)],
        fields: run.fieldList.map(({ name }) => numbersOf(run.field(name, time))),
      });
    }
    for (let run = 0; run < (address ? 0 : animation.runCount); run++) {
      const own = animation.runCount === 1 ? animation : animation.run(run);
      found.runs.push(meshOf(own));
      found.fields.push(own.fieldList);
    }
    animation.close();
    return found;
  } catch (error) {
    return { error: error.message, code: error.code, frame: error.frame };
  }
}

const results = [];
for (const job of JSON.parse(await text(process.stdin))) results.push(await decoded(job));
console.log(JSON.stringify(results));
