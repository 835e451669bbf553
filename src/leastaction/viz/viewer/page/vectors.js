// ---------------------------------------------------------------- vectors and matrices (4x4 by columns, poses 3x4 by columns)
const add = (a, b, s = 1) => [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]], dot = (a, b) => a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
const cross = (a, b) => [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
const scale = (a, s) => [a[0] * s, a[1] * s, a[2] * s], unit = a => scale(a, 1 / (Math.hypot(...a) || 1));
const turned = (A, v) => [0, 1, 2].map(i => A[i] * v[0] + A[3 + i] * v[1] + A[6 + i] * v[2]);
const moved = (A, p) => add(turned(A, p), A.slice(9));
const placed = (A, B) => [...turned(A, B.slice(0, 3)), ...turned(A, B.slice(3, 6)), ...turned(A, B.slice(6, 9)), ...moved(A, B.slice(9))];
function across(z) { // two unit vectors across a third
  const x = unit(cross(Math.abs(z[2]) < 0.9 ? [0, 0, 1] : [1, 0, 0], z));
  return [x, cross(z, x)];
}
// From a to b along z, and so thick across.
function between(a, b, thick = 1) {
  const d = add(b, a, -1), z = Math.hypot(...d) > 1e-9 ? unit(d) : [0, 0, 1], [x, y] = across(z);
  return [...scale(x, thick), ...scale(y, thick), ...d, ...scale(add(a, b), 0.5)];
}
// What turns normals: the transposed inverse; of a mesh with offsets, which keep their thickness, the rotation.
function normals(A, offsets) {
  const x = A.slice(0, 3), y = A.slice(3, 6), z = A.slice(6, 9);
  if (offsets) { const w = Math.hypot(...z) > 1e-9 ? unit(z) : cross(unit(x), unit(y)); return [...unit(x), ...unit(y), ...w]; }
  const yz = cross(y, z), zx = cross(z, x), xy = cross(x, y), s = Math.sign(dot(x, yz)) || 1;
  return [...scale(yz, s), ...scale(zx, s), ...scale(xy, s)];
}
function product(A, B) {
  const C = new Float32Array(16);
  for (let j = 0; j < 4; j++) for (let i = 0; i < 4; i++) for (let k = 0; k < 4; k++) C[4 * j + i] += A[4 * k + i] * B[4 * j + k];
  return C;
}
const looking = (eye, right, up, ahead) => new Float32Array([right[0], up[0], -ahead[0], 0, right[1], up[1], -ahead[1], 0, right[2], up[2], -ahead[2], 0, -dot(right, eye), -dot(up, eye), dot(ahead, eye), 1]);
