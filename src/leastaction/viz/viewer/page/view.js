// ---------------------------------------------------------------- view: state, colours and camera
const view = document.getElementById("view"), labels = document.getElementById("labels"), pen = labels.getContext("2d"), paint = painter(view);
document.getElementById("missing").hidden = !!paint;
document.documentElement.dataset.still = still;
const some = test => panels.some(test), hash = new URLSearchParams(location.hash.slice(1));
const show = { follow: true, reference: some(p => p.wanted || p.wantedPoses), cords: some(p => p.cords.length), trace: some(p => p.traces.length), joints: !!S.joints, forces: !!S.forces };
let time = begin, playing = !still, speed = 1, yaw = S.azimuth, pitch = S.elevation, far = 1.6 * S.size, shift = [0, 0, 0], W = 0, H = 0, ratio = 1;
let theme = matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
if (matchMedia("(prefers-reduced-motion: reduce)").matches) playing = false;
if (hash.has("t")) { time = clamp(parseFloat(hash.get("t")) || 0, begin, end); playing = false; }
if (hash.has("theme")) theme = hash.get("theme") === "dark" ? "dark" : "light";
if (hash.has("yaw")) yaw = parseFloat(hash.get("yaw")) * Math.PI / 180;
for (const key of ["joints", "forces"]) if (hash.has(key)) show[key] = hash.get(key) !== "0";
const css = name => getComputedStyle(document.documentElement).getPropertyValue(name).trim();
const rgb = text => [1, 3, 5].map(i => parseInt(text.slice(i, i + 2), 16) / 255);
const mixed = (a, b, w) => a.map((x, i) => x + (b[i] - x) * w), text = c => `rgb(${c.map(x => Math.round(255 * x)).join(",")})`;
let ink = {}, look = {};
function setTheme(name) {
  theme = name; document.documentElement.dataset.theme = name;
  const dark = name === "dark", of = key => css(`--${key}`);
  ink = { paper: of("paper"), sky: of("sky"), line: of("line"), soft: of("soft"), ink: of("ink"), accent: of("accent"), slack: of("slack"), ghost: of("ghost"), input: of("input"), reaction: of("reaction"),
    limit: of("limit"), low: dark ? [0.42, 0.6, 0.77] : [0.32, 0.48, 0.64], high: [0.9, 0.62, 0] };
  look = { sky: rgb(ink.sky), paper: rgb(ink.paper), line: rgb(ink.line), dark: dark ? 0.4 : 0.2, ambient: dark ? [0.42, 0.46, 0.54] : [0.54, 0.57, 0.62], earth: dark ? [0.14, 0.14, 0.15] : [0.27, 0.25, 0.24] };
  legend(); drawSpark();
}
const LIGHT = unit([0.6 * Math.cos(S.azimuth - 0.65), 0.6 * Math.sin(S.azimuth - 0.65), 1]), WOOD = [0.84, 0.66, 0.45, 1], METAL = [0.55, 0.58, 0.63, 1];
// As far away that what is shown fits between the panels above and below.
const afar = () => 1.25 * S.size / S.nearer / clamp((innerHeight - (still ? 80 : 190)) / innerHeight, 0.4, still ? 0.9 : 0.78);
let camera = null; // of the panel that was drawn last
function aim(panel, k, w, width, height) {
  const spot = panel.focus < 0 ? panel.spot : panel.got.at(k, w, panel.focus), target = show.follow ? spot : (panel.spot || spot);
  panel.spot = target;
  const c = Math.cos(pitch), s = Math.sin(pitch), cy = Math.cos(yaw), sy = Math.sin(yaw);
  const ahead = [-c * cy, -c * sy, -s], right = [-sy, cy, 0], up = [-s * cy, -s * sy, c];
  // A follower that also bobs up and down makes the floor swim, so the height is that of the whole scene.
  // Closer by, what is followed moves into the middle.
  const close = clamp((1.6 * S.size - far) / (0.8 * S.size), 0, 1);
  const centre = [target[0] + shift[0], target[1] + shift[1], panel.middle + close * (panel.height - panel.middle) + shift[2]];
  const eye = add(centre, ahead, -far), lens = 1.25 * Math.min(height, width * 1.15), near = 0.02 * far, back = far + 12 * S.size;
  const project = new Float32Array([2 * lens / width, 0, 0, 0, 0, 2 * lens / height, 0, 0, 0, -0.06, -(back + near) / (back - near), -1, 0, 0, -2 * back * near / (back - near), 0]);
  camera = { eye, ahead, right, up, lens, centre, width, height, matrix: product(project, looking(eye, right, up, ahead)) };
  return camera;
}
function project(p) {
  const d = add(p, camera.eye, -1), depth = dot(d, camera.ahead), f = camera.lens / Math.max(depth, 1e-3);
  return { x: camera.width / 2 + f * dot(d, camera.right), y: camera.height * 0.47 - f * dot(d, camera.up), f, depth };
}
// Half the thickness in space of what is to be so many pixels thick.
const thin = (p, pixels) => 0.5 * pixels * Math.max(dot(add(p, camera.eye, -1), camera.ahead), 0.02 * far) / camera.lens;
// The sun's own camera: a square about the middle, seen along the light.
function sun(panel, centre) {
  const z = scale(LIGHT, -1), [x, y] = across(z), reach = 1.1 * Math.max(panel.size, 0.6 * far), eye = add([centre[0], centre[1], panel.floor + 0.4 * reach], LIGHT, 2 * reach);
  const box = new Float32Array([1 / reach, 0, 0, 0, 0, 1 / reach, 0, 0, 0, 0, -0.5 / reach, 0, 0, 0, -1, 1]);
  return { reach, lamp: product(box, looking(eye, x, y, z)) };
}
