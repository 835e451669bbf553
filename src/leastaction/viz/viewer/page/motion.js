// ---------------------------------------------------------------- motion: what the data says at any time
const S = JSON.parse(document.getElementById("data").textContent), begin = S.begin, end = S.end, still = end <= begin;
const bytes = text => Uint8Array.from(atob(text), c => c.charCodeAt(0)).buffer;
const floats = text => new Float32Array(bytes(text));
const clamp = (x, a, b) => Math.min(b, Math.max(a, x));

// Positions are 16-bit integers in a box: p = low + code * step; attitudes are quaternions of 16-bit integers.
function places(group, low, step, last) {
  if (!group || !group.names.length) return null;
  const code = new Uint16Array(bytes(group.codes)), n = group.names.length;
  return { n, names: group.names, at(k, w, i, out = [0, 0, 0]) {
    const a = (k * n + i) * 3, b = (Math.min(k + 1, last) * n + i) * 3;
    for (let c = 0; c < 3; c++) out[c] = low[c] + step[c] * (code[a + c] * (1 - w) + code[b + c] * w);
    return out; } };
}
function attitudes(group, low, step, last) {
  const origin = places(group, low, step, last);
  if (!origin) return null;
  const turn = new Int16Array(bytes(group.turns)), n = group.names.length, p = [0, 0, 0];
  // The pose as the columns of a matrix: three axes and the origin.
  return { n, names: group.names, at(k, w, i) {
    const a = (k * n + i) * 4, b = (Math.min(k + 1, last) * n + i) * 4;
    let x = turn[a] * (1 - w) + turn[b] * w, y = turn[a + 1] * (1 - w) + turn[b + 1] * w;
    let z = turn[a + 2] * (1 - w) + turn[b + 2] * w, s = turn[a + 3] * (1 - w) + turn[b + 3] * w;
    const d = 1 / Math.hypot(x, y, z, s); x *= d; y *= d; z *= d; s *= d;
    origin.at(k, w, i, p);
    return [1 - 2 * (y * y + z * z), 2 * (x * y + s * z), 2 * (x * z - s * y), 2 * (x * y - s * z), 1 - 2 * (x * x + z * z), 2 * (y * z + s * x),
      2 * (x * z + s * y), 2 * (y * z - s * x), 1 - 2 * (x * x + y * y), p[0], p[1], p[2]]; } };
}
function panel(data) {
  const T = floats(data.t), last = T.length - 1, from = [data.low, data.step, last];
  return { ...data, T, last, got: places(data.points, ...from), wanted: places(data.ghost, ...from), poses: attitudes(data.poses, ...from), wantedPoses: attitudes(data.ghostPoses, ...from),
    pulls: data.tension ? data.tension.map(each => each && floats(each)) : null, error: data.error ? floats(data.error) : null,
    arrows: data.arrows.map(([name, kind, place, vector]) => ({ name, kind, place: floats(place), vector: floats(vector) })),
    // Index and fraction; samples lie closer where things move fast, so they are looked for.
    frame(time) {
      let a = 0, b = last;
      while (b - a > 1) { const m = (a + b) >> 1; if (T[m] <= time) a = m; else b = m; }
      return last ? [a, clamp((time - T[a]) / (T[a + 1] - T[a]), 0, 1)] : [0, 0];
    },
    mix(values, k, w) { return values[k] * (1 - w) + values[Math.min(k + 1, last)] * w; },
    mix3(values, k, w) { return [0, 1, 2].map(c => values[3 * k + c] * (1 - w) + values[3 * Math.min(k + 1, last) + c] * w); } };
}
const panels = S.panels.map(panel);
