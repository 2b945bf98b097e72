// Plain geometry: arrays from base64, vectors, matrices (column-major, as WebGL takes them), tubes and normals.

const decode = (text, Type) => {
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return new Type(bytes.buffer);
};

const add = (a, b, k = 1) => [a[0] + k * b[0], a[1] + k * b[1], a[2] + k * b[2]];
const scale = (a, k) => [k * a[0], k * a[1], k * a[2]];
const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const norm = (a) => Math.sqrt(dot(a, a));
const unit = (a) => scale(a, 1 / (norm(a) || 1));

const IDENTITY = new Float32Array([1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]);

/** The matrix that turns by the unit quaternion q = [w, x, y, z] and then moves by p. */
function placement(p, q) {
  const [w, x, y, z] = q;
  return new Float32Array([
    1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y), 0,
    2 * (x * y - w * z), 1 - 2 * (x * x + z * z), 2 * (y * z + w * x), 0,
    2 * (x * z + w * y), 2 * (y * z - w * x), 1 - 2 * (x * x + y * y), 0,
    p[0], p[1], p[2], 1,
  ]);
}

const column = (m, k) => [m[4 * k], m[4 * k + 1], m[4 * k + 2]];

function multiply(a, b) {
  const out = new Float32Array(16);
  for (let c = 0; c < 4; c++)
    for (let r = 0; r < 4; r++)
      for (let k = 0; k < 4; k++) out[4 * c + r] += a[4 * k + r] * b[4 * c + k];
  return out;
}

/** World to clip space: from an eye with axes right, up and back, `tangent` half the picture's height at depth 1. */
function projection(eye, right, up, back, tangent, aspect, near, far) {
  const view = new Float32Array([
    right[0], up[0], back[0], 0, right[1], up[1], back[1], 0, right[2], up[2], back[2], 0,
    -dot(right, eye), -dot(up, eye), -dot(back, eye), 1,
  ]);
  const depth = 1 / (near - far);
  const lens = new Float32Array([
    1 / (tangent * aspect), 0, 0, 0, 0, 1 / tangent, 0, 0, 0, 0, (near + far) * depth, -1, 0, 0, 2 * near * far * depth, 0,
  ]);
  return multiply(lens, view);
}

/** A closed tube of `sides` sides around points (3 n): {positions, normals, stations, indices}. */
function tube(points, radius, sides) {
  const n = points.length / 3, rings = n + 2, count = rings * sides + 2;
  const positions = new Float32Array(3 * count), normals = new Float32Array(3 * count);
  const stations = new Uint32Array(count), indices = [];
  const at = (i) => [points[3 * i], points[3 * i + 1], points[3 * i + 2]];
  const put = (k, p, v, station) => {
    positions.set(p, 3 * k);
    normals.set(v, 3 * k);
    stations[k] = station;
  };
  let across = null, along = null;
  for (let i = 0; i < n; i++) {
    along = unit(add(at(Math.min(i + 1, n - 1)), at(Math.max(i - 1, 0)), -1));
    if (!across) across = cross(along, Math.abs(along[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0]);
    across = unit(add(across, along, -dot(across, along))); // carried along without twist
    const other = cross(along, across), last = i === n - 1;
    for (let j = 0; j < sides; j++) {
      const angle = (2 * Math.PI * j) / sides;
      const out = add(scale(across, Math.cos(angle)), other, Math.sin(angle));
      const place = add(at(i), out, radius);
      put((i + 1) * sides + j, place, out, i);
      if (i === 0) put(j, place, scale(along, -1), 0);
      if (last) put((n + 1) * sides + j, place, along, i);
    }
    if (i === 0) put(rings * sides, at(0), scale(along, -1), 0);
    if (last) put(rings * sides + 1, at(i), along, i);
  }
  for (let j = 0; j < sides; j++) {
    const next = (j + 1) % sides;
    for (let i = 1; i < n; i++) {
      const a = i * sides + j, b = i * sides + next;
      indices.push(a, b, a + sides, b, b + sides, a + sides);
    }
    indices.push(rings * sides, next, j, rings * sides + 1, (n + 1) * sides + j, (n + 1) * sides + next);
  }
  return { positions, normals, stations, indices: new Uint32Array(indices) };
}

const ARROW = [[0, 0], [0.028, 0], [0.028, 0.7], [0.09, 0.7], [0, 1]]; // radius and height of an arrow's outline

/** An arrow of length 1 along axis `k`: {positions, normals}, three points a triangle. */
function arrow(k, sides) {
  const positions = [], normals = [], turned = (p) => [p[(3 - k + 2) % 3], p[(4 - k + 2) % 3], p[(5 - k + 2) % 3]];
  for (let i = 1; i < ARROW.length; i++) {
    const [[r0, z0], [r1, z1]] = [ARROW[i - 1], ARROW[i]];
    for (let j = 0; j < sides; j++) {
      const at = (r, z, n) => [r * Math.cos((2 * Math.PI * n) / sides), r * Math.sin((2 * Math.PI * n) / sides), z];
      const out = unit(at(z1 - z0, r0 - r1, j + 0.5));
      for (const corner of [at(r0, z0, j), at(r0, z0, j + 1), at(r1, z1, j + 1), at(r0, z0, j), at(r1, z1, j + 1), at(r1, z1, j)]) {
        positions.push(...turned(corner));
        normals.push(...turned(out));
      }
    }
  }
  return { positions: new Float32Array(positions), normals: new Float32Array(normals) };
}

const EDGE_COSINE = Math.cos((30 * Math.PI) / 180); // between faces, from which an edge is sharp

/** Triangles with normals that are smooth across blunt edges, and the sharp edges as pairs of points. */
function solid(vertices, faces) {
  const count = faces.length / 3, at = (i) => [vertices[3 * i], vertices[3 * i + 1], vertices[3 * i + 2]];
  const face = [], around = new Map(), borders = new Map();
  for (let f = 0; f < count; f++) {
    const [a, b, c] = [0, 1, 2].map((k) => faces[3 * f + k]);
    const area = cross(add(at(b), at(a), -1), add(at(c), at(a), -1));
    face.push({ area, normal: unit(area) });
    for (const [p, q] of [[a, b], [b, c], [c, a]]) {
      if (!around.has(p)) around.set(p, []);
      around.get(p).push(f);
      const key = Math.min(p, q) * 4294967 + Math.max(p, q);
      if (borders.has(key)) borders.get(key).faces.push(f);
      else borders.set(key, { p, q, faces: [f] });
    }
  }
  const positions = new Float32Array(9 * count), normals = new Float32Array(9 * count), edges = [];
  for (let f = 0; f < count; f++)
    for (let k = 0; k < 3; k++) {
      const vertex = faces[3 * f + k];
      let sum = [0, 0, 0];
      for (const g of around.get(vertex)) if (dot(face[g].normal, face[f].normal) > EDGE_COSINE) sum = add(sum, face[g].area);
      positions.set(at(vertex), 9 * f + 3 * k);
      normals.set(unit(norm(sum) ? sum : face[f].normal), 9 * f + 3 * k);
    }
  for (const { p, q, faces: owners } of borders.values()) {
    const blunt = owners.length === 2 && dot(face[owners[0]].normal, face[owners[1]].normal) > EDGE_COSINE;
    if (!blunt) edges.push(...at(p), ...at(q));
  }
  return { positions, normals, edges: new Float32Array(edges) };
}
