/**
 * Derives from polygons what is drawn: triangles, edges, and the triangles around each vertex, for normals. A polygon
 * of any size becomes a triangle fan.
 */
import { countRows, countRowsBefore } from "./fields.js";

/** Triangulate the faces of all given objects: vertex indices across all objects, and the face of each triangle. */
export function trianglesOf(objects) {
  let count = 0;
  for (const { faceSizes } of objects) for (const size of faceSizes) count += Math.max(size - 2, 0);
  const triangles = new Uint32Array(3 * count);
  const faces = new Uint32Array(count);
  let at = 0;
  let face = 0;
  for (const { firstVertex, faceSizes, faceIndices } of objects) {
    let corner = 0;
    for (const size of faceSizes) {
      for (let k = 1; k + 1 < size; k++) {
        triangles[3 * at] = firstVertex + faceIndices[corner];
        triangles[3 * at + 1] = firstVertex + faceIndices[corner + k];
        triangles[3 * at + 2] = firstVertex + faceIndices[corner + k + 1];
        faces[at++] = face;
      }
      corner += size;
      face++;
    }
  }
  return { triangles, faces };
}

/** List the edges of faces (each once) and of lines, two vertices per edge. */
export function edgesOf(objects) {
  const found = [];
  for (const { firstVertex, vertexCount, faceSizes, faceIndices, lineSizes, lineIndices } of objects) {
    const seen = new Set();
    let corner = 0;
    for (const size of faceSizes) {
      for (let k = 0; k < size; k++) {
        const a = faceIndices[corner + k];
        const b = faceIndices[corner + ((k + 1) % size)];
        const key = Math.min(a, b) * vertexCount + Math.max(a, b);
        if (a === b || seen.has(key)) continue;
        seen.add(key);
        found.push(firstVertex + a, firstVertex + b);
      }
      corner += size;
    }
    corner = 0;
    for (const size of lineSizes) {
      for (let k = 0; k + 1 < size; k++) {
        found.push(firstVertex + lineIndices[corner + k], firstVertex + lineIndices[corner + k + 1]);
      }
      corner += size;
    }
  }
  return Uint32Array.from(found);
}

/**
 * List the two other vertices of each triangle around each vertex; pairs `starts[v]` to `starts[v + 1] - 1` belong to
 * `v`. With `fans`, the fan of each corner of the triangles, the same around each of `count` fans: a fan is the corners
 * at a vertex that share a normal.
 */
export function cornersAround(triangles, count, fans = triangles) {
  const starts = new Uint32Array(count + 1);
  for (const fan of fans) starts[fan + 1]++;
  for (let fan = 0; fan < count; fan++) starts[fan + 1] += starts[fan];
  const next = starts.slice();
  const others = new Uint32Array(2 * triangles.length);
  for (let corner = 0; corner < triangles.length; corner += 3) {
    for (let k = 0; k < 3; k++) {
      const place = 2 * next[fans[corner + k]]++;
      others[place] = triangles[corner + ((k + 1) % 3)];
      others[place + 1] = triangles[corner + ((k + 2) % 3)];
    }
  }
  return { starts, others };
}

/**
 * Compute unit normals of vertices, or of the fans that corners of triangles belong to: the normalised sum of the normals
 * of their triangles, weighted by area.
 */
export function normalsOf(positions, triangles, out = new Float32Array(positions.length), fans = triangles) {
  out.fill(0);
  for (let corner = 0; corner < triangles.length; corner += 3) {
    const a = 3 * triangles[corner];
    const b = 3 * triangles[corner + 1];
    const c = 3 * triangles[corner + 2];
    const ux = positions[b] - positions[a];
    const uy = positions[b + 1] - positions[a + 1];
    const uz = positions[b + 2] - positions[a + 2];
    const vx = positions[c] - positions[a];
    const vy = positions[c + 1] - positions[a + 1];
    const vz = positions[c + 2] - positions[a + 2];
    const x = uy * vz - uz * vy;
    const y = uz * vx - ux * vz;
    const z = ux * vy - uy * vx;
    for (let k = 0; k < 3; k++) {
      const at = 3 * fans[corner + k];
      out[at] += x;
      out[at + 1] += y;
      out[at + 2] += z;
    }
  }
  for (let at = 0; at < out.length; at += 3) {
    const length = Math.sqrt(out[at] ** 2 + out[at + 1] ** 2 + out[at + 2] ** 2) || 1;
    out[at] /= length;
    out[at + 1] /= length;
    out[at + 2] /= length;
  }
  return out;
}

/** Describe an object that has only lines or only vertices, as `splitAtUvSeams` describes one with faces. */
export function describeFaceless(object) {
  const sources = Uint32Array.from({ length: object.vertexCount }, (_, vertex) => vertex);
  const edges = edgesOf([object]);
  return edges.length
    ? { kind: "LineSegments", sources, index: edges, uvs: null }
    : { kind: "Points", sources, index: null, uvs: null };
}

/**
 * Return the names of an object's materials, the order of its triangles (`faces`: the face of each) in which those of one
 * material stand together, and the range of corners of each. Without materials there is one, called "", and no range.
 */
export function materialsOf(attributes, faces) {
  const material = attributes.find(({ name, domain, labels }) => name === "material" && domain === "faces" && labels?.length);
  if (!material) return { names: [""], order: null, groups: [] };
  const { values, indices, labels } = material;
  const rowOf = (face) => (indices ? indices[face] : face);
  const labelOf = (triangle) => Number(values[rowOf(faces[triangle])] ?? -1);
  const order = Uint32Array.from(faces, (_, triangle) => triangle).sort((a, b) => labelOf(a) - labelOf(b) || a - b);
  const names = [];
  const groups = [];
  order.forEach((triangle, place) => {
    const name = labels[labelOf(triangle)] ?? "";
    if (names.at(-1) !== name) {
      groups.push({ start: 3 * place, count: 0, materialIndex: names.length });
      names.push(name);
    }
    groups.at(-1).count += 3;
  });
  return names.length > 1 ? { names, order, groups } : { names, order: null, groups: [] };
}

/**
 * Split vertices at UV seams, as three.js needs it: the source of each vertex, the indices, and the UVs or null.
 * `isSplit`: give each corner of each triangle a vertex of its own, and say which corner of the faces it is. `order`: which
 * triangle to draw at each place, if not in order.
 */
export function splitAtUvSeams(attributes, object, unordered, isSplit, order = null) {
  const arrange = (corners) =>
    order ? Uint32Array.from(corners, (_, k) => corners[3 * order[Math.floor(k / 3)] + (k % 3)]) : corners;
  const triangles = arrange(unordered);
  const uv = attributes.find((attribute) => attribute.columns === 2 && attribute.name.toLowerCase().startsWith("uv"));
  const isMapped = uv?.domain === "corners" || uv?.domain === "vertices";
  if (!isMapped && !isSplit) {
    const sources = Uint32Array.from({ length: object.vertexCount }, (_, vertex) => vertex);
    return { kind: "Mesh", sources, index: triangles, uvs: null };
  }
  const rowOf = (element) => (uv.indices ? uv.indices[element] : element);
  const split = isSplit ? arrange(listTriangleCorners(object)) : null;
  const corners = uv?.domain === "corners" ? (split ?? arrange(listTriangleCorners(object))) : triangles;
  const numbers = new Map();
  const sources = [];
  const uvs = [];
  const index = new Uint32Array(triangles.length);
  for (let k = 0; k < triangles.length; k++) {
    const row = isMapped ? rowOf(corners[k]) : -1;
    const key = isSplit ? k : `${triangles[k]} ${row}`;
    if (!numbers.has(key)) {
      numbers.set(key, sources.length);
      sources.push(triangles[k]);
      uvs.push(row < 0 ? 0 : uv.values[2 * row], row < 0 ? 0 : uv.values[2 * row + 1]);
    }
    index[k] = numbers.get(key);
  }
  return {
    kind: "Mesh",
    sources: Uint32Array.from(sources),
    index: isSplit ? null : index,
    uvs: isMapped ? Float32Array.from(uvs) : null,
    corners: split,
  };
}

/**
 * Return the UVs of an object that change over time as attributes, as they are at the start of the run: those of its
 * first field of vertices or corners that is called like UVs.
 */
export function changingUvs(run, object) {
  const isUv = ({ name, components, domain }) =>
    components === 2 && /^uv/i.test(name) && (domain === "vertices" || domain === "corners");
  const field = run.fieldList.find((one) => isUv(one) && one.objects.includes(object));
  if (!field) return [];
  const first = countRowsBefore(run, field, object);
  const end = first + countRows(run.object(object), field.domain);
  const own = run.field(field.name, run.start).subarray(2 * first, 2 * end);
  // A vertex without UVs has (0, 0), as of attributes.
  const values = Float32Array.from(own, (value) => (Number.isFinite(value) ? value : 0));
  return [{ name: field.name, domain: field.domain, columns: 2, indices: null, values }];
}

/** Return which corner of the faces each corner of the triangles is. */
export function listTriangleCorners({ faceSizes }) {
  const found = [];
  let corner = 0;
  for (const size of faceSizes) {
    for (let k = 1; k + 1 < size; k++) found.push(corner, corner + k, corner + k + 1);
    corner += size;
  }
  return found;
}
