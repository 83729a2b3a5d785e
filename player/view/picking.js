/** Finds what is drawn under a point of the picture. */
import { trianglesOf } from "pdeanim/mesh.js";

/** Largest distance [pixels] of a point or a line's vertex from the pointer. */
const REACH = 12;

const triangleLists = new WeakMap();

/** Triangles of a run, each with its object; kept as long as the run is. */
function trianglesIn(run) {
  if (!triangleLists.has(run)) triangleLists.set(run, run.objects.map((object) => trianglesOf([object]).triangles));
  return triangleLists.get(run);
}

/**
 * Return the object, the vertex and the drawn corner of a triangle (-1 without a face) that are nearest to a point of
 * the picture, or null.
 * @param {object} run the run of frames that is shown
 * @param {Float32Array} positions of its vertices
 * @param {import("./camera.js").OrbitCamera} camera
 * @param {{ x: number, y: number, width: number, height: number }} point in a view of that size [pixels]
 * @param {number | null} only the only object that is drawn
 */
export function pick(run, positions, camera, { x, y, width, height }, only) {
  const aspect = width / height;
  const { eye, direction } = camera.rayOf(x / width, y / height, aspect);
  let nearest = Infinity;
  let found = null;
  let first = 0;
  trianglesIn(run).forEach((triangles, object) => {
    for (let at = 0; at < triangles.length && (only === null || only === object); at += 3) {
      const corners = [triangles[at], triangles[at + 1], triangles[at + 2]];
      const hit = hitOf(positions, corners, eye, direction);
      if (!hit || hit.distance >= nearest) continue;
      nearest = hit.distance;
      found = { object, vertex: corners[hit.corner], corner: first + at + hit.corner };
    }
    first += triangles.length;
  });
  return found ?? nearestVertex(run, positions, camera, { x, y, width, height }, only);
}

/** Distance along a ray to a triangle, and its corner that is nearest to the point; null if the ray misses it. */
function hitOf(positions, [a, b, c], eye, direction) {
  const [ax, ay, az] = [positions[3 * a], positions[3 * a + 1], positions[3 * a + 2]];
  const [ux, uy, uz] = [positions[3 * b] - ax, positions[3 * b + 1] - ay, positions[3 * b + 2] - az];
  const [vx, vy, vz] = [positions[3 * c] - ax, positions[3 * c + 1] - ay, positions[3 * c + 2] - az];
  const [dx, dy, dz] = direction;
  const [px, py, pz] = [dy * vz - dz * vy, dz * vx - dx * vz, dx * vy - dy * vx];
  const size = ux * px + uy * py + uz * pz;
  if (size === 0) return null;
  const [tx, ty, tz] = [eye[0] - ax, eye[1] - ay, eye[2] - az];
  const u = (tx * px + ty * py + tz * pz) / size;
  if (u < 0 || u > 1) return null;
  const [qx, qy, qz] = [ty * uz - tz * uy, tz * ux - tx * uz, tx * uy - ty * ux];
  const v = (dx * qx + dy * qy + dz * qz) / size;
  const distance = (vx * qx + vy * qy + vz * qz) / size;
  if (v < 0 || u + v > 1 || distance <= 0) return null;
  const shares = [1 - u - v, u, v];
  return { distance, corner: shares.indexOf(Math.max(...shares)) };
}

/** The nearest vertex of objects without faces, within reach. */
function nearestVertex(run, positions, camera, { x, y, width, height }, only) {
  const place = camera.projector(width / height);
  let nearest = REACH;
  let found = null;
  run.objects.forEach(({ firstVertex, vertexCount, faceSizes }, object) => {
    if (faceSizes.length || (only !== null && only !== object)) return;
    for (let vertex = firstVertex; vertex < firstVertex + vertexCount; vertex++) {
      const at = place(positions.subarray(3 * vertex, 3 * vertex + 3));
      const away = Math.hypot(at[0] * width - x, at[1] * height - y);
      if (away < nearest) [nearest, found] = [away, { object, vertex, corner: -1 }];
    }
  });
  return found;
}
