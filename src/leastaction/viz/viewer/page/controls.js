// ---------------------------------------------------------------- controls: keyboard, mouse, touch, and the loop
const home = () => ({ yaw: S.azimuth, pitch: S.elevation, far: afar() });
const toggle = () => { if (still) return; if (!playing && time >= end) time = begin; playing = !playing; dirty = true; };
element("play").onclick = toggle;
element("slider").oninput = e => { time = begin + e.target.value * (end - begin); playing = false; dirty = true; };
element("speed").onchange = e => { speed = parseFloat(e.target.value); };
function stepTime(by) {
  const T = panels.reduce((a, b) => a.last > b.last ? a : b), [k, w] = T.frame(time);
  playing = false; time = T.T[clamp(by > 0 ? (w >= 1 ? k + 2 : k + 1) : (w > 0 ? k : k - 1), 0, T.last)]; dirty = true;
}
addEventListener("keydown", e => {
  if (e.ctrlKey || e.metaKey || e.altKey || e.target.tagName === "SELECT" || e.target.closest?.("#sliders")) return;
  if (e.key === " ") { e.preventDefault(); if (e.target.tagName === "BUTTON") e.target.blur(); toggle(); }
  else if (e.key === "ArrowRight" || e.key === "ArrowLeft") { e.preventDefault(); if (!still) stepTime(e.key === "ArrowRight" ? 1 : -1); }
  else if (e.key === "Home" || e.key === "End") { e.preventDefault(); playing = false; time = e.key === "Home" ? begin : end; dirty = true; }
  else keys[e.key.toLowerCase()]?.click();
});
const fingers = new Map();
view.onpointerdown = e => { fingers.set(e.pointerId, [e.clientX, e.clientY]); view.setPointerCapture(e.pointerId); };
view.onpointerup = view.onpointercancel = e => fingers.delete(e.pointerId);
view.oncontextmenu = e => e.preventDefault();
function move(dx, dy) { const s = far / camera.lens; for (let i = 0; i < 3; i++) shift[i] += s * (-dx * camera.right[i] + dy * camera.up[i]); }
const zoom = by => { far = clamp(far * by, 0.3 * S.size, 8 * S.size); dirty = true; };
view.onpointermove = e => {
  const old = fingers.get(e.pointerId);
  if (!old) return;
  const dx = e.clientX - old[0], dy = e.clientY - old[1];
  if (fingers.size === 2) {
    const [id] = [...fingers.keys()].filter(x => x !== e.pointerId), other = fingers.get(id);
    zoom(clamp(Math.hypot(old[0] - other[0], old[1] - other[1]) / Math.max(1, Math.hypot(e.clientX - other[0], e.clientY - other[1])), 0.5, 2));
    move(dx / 2, dy / 2);
  } else if (e.shiftKey || e.buttons & 6) move(dx, dy);
  else { yaw -= dx * 0.008; pitch = clamp(pitch + dy * 0.006, -0.25, 1.55); }
  fingers.set(e.pointerId, [e.clientX, e.clientY]); dirty = true;
};
view.addEventListener("wheel", e => { e.preventDefault(); zoom(Math.exp(e.deltaY * 0.001)); }, { passive: false });
view.ondblclick = () => { ({ yaw, pitch, far } = home()); shift = [0, 0, 0]; dirty = true; };
function resize() {
  ratio = Math.min(devicePixelRatio || 1, 2); W = innerWidth; H = innerHeight;
  for (const c of [view, labels]) { c.width = Math.round(W * ratio); c.height = Math.round(H * ratio); }
  dirty = true;
}
addEventListener("resize", resize);
let dirty = true, clock = null;
function loop(stamp) {
  if (playing) { if (clock !== null) time += speed * Math.min(0.1, (stamp - clock) / 1000); if (time > end) time = begin; dirty = true; }
  clock = stamp;
  if (dirty) { dirty = false; draw(); }
  requestAnimationFrame(loop);
}
far = afar(); resize(); setTheme(theme); draw(); requestAnimationFrame(loop);
