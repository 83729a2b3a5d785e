/** What three.js and the page share to show fields: colour maps, runs that may have a field, and rows of values. */

/** Colours at equal distances along a range. */
export const COLORMAPS = {
  /** Lightness grows evenly, so that order shows without colours, too. */
  viridis: "#440154 #472d7b #3b528b #2c728e #21918c #28ae80 #5ec962 #addc30 #fde725".split(" "),
  /** For ranges around zero, which is grey: "smooth cool warm" of Moreland 2009. */
  coolwarm: "#3b4cc0 #6282ea #8db0fe #b8d0f9 #dddddd #f5c4ad #f49a7b #de604d #b40426".split(" "),
};

/** Go through all runs of frames, and open each in its turn; a file with one run is that run. */
export function* runsOf(animation) {
  if (animation.runCount === 1) yield animation;
  else for (let run = 0; run < animation.runCount; run++) yield animation.run(run);
}

/** Return the number of rows that a field of a domain has in an object. */
export function countRows({ vertexCount, faceSizes, faceIndices }, domain) {
  return { vertices: vertexCount, faces: faceSizes.length, corners: faceIndices.length, object: 1 }[domain];
}

/** Return the number of rows of a field before those of an object. */
export function countRowsBefore(run, { domain, objects }, object) {
  const before = objects.filter((owner) => owner < object);
  return before.reduce((sum, owner) => sum + countRows(run.object(owner), domain), 0);
}

/** Whether faces that share a vertex may differ there, so that each corner of a triangle needs a vertex of its own. */
export const splitsVertices = (field) => ["faces", "corners"].includes(field?.domain);

/** Return one number for each row: a component, or the magnitude of all (`component` null). */
export function reduceRows(values, components, component) {
  const found = new Float64Array(values.length / components);
  for (let row = 0; row < found.length; row++) {
    const at = row * components;
    if (component !== null) {
      found[row] = Number(values[at + component]);
      continue;
    }
    let sum = 0;
    for (let k = 0; k < components; k++) sum += Number(values[at + k]) ** 2;
    found[row] = Math.sqrt(sum);
  }
  return found;
}

/**
 * Return the row of a field for each drawn vertex of an object, -1 for none. `sources` are their vertices in the object;
 * `corners`, of split triangles, their corners among those of all faces.
 */
export function rowsOfDrawn(field, run, object, sources, corners) {
  const rows = new Int32Array(sources.length).fill(-1);
  if (!field?.objects.includes(object)) return rows;
  const first = countRowsBefore(run, field, object);
  if (field.domain === "vertices") return rows.map((_, k) => first + sources[k]);
  if (field.domain === "object") return rows.fill(first);
  if (!corners) return rows;
  if (field.domain === "corners") return rows.map((_, k) => first + corners[k]);
  const faces = [];
  run.object(object).faceSizes.forEach((size, face) => faces.push(...Array(size).fill(face)));
  return rows.map((_, k) => first + faces[corners[k]]);
}
