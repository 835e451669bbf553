// ---------------------------------------------------------------- panels: numbers, time bar, legend, buttons
const element = id => document.getElementById(id);
const captions = panels.length > 1 ? panels.map(p => { const c = document.createElement("div"); c.className = "panel caption"; c.textContent = p.title; document.body.append(c); return c; }) : [];
function force(x) { return Math.abs(x) >= 1000 ? `${(x / 1000).toFixed(1)} kN` : Math.abs(x) >= 0.95 || x === 0 ? `${x.toFixed(1)} N` : `${Number(x.toPrecision(2))} N`; }
function told(panel) { // rows of numbers at this instant
  const [k, w] = panel.frame(time), rows = [];
  if (panel.error) rows.push(["tracking error (rms)", panel.mix(panel.error, k, w).toFixed(2) + "°"]);
  if (panel.pulls) {
    const pulls = panel.pulls.map((v, i) => v ? [panel.mix(v, k, w), panel.cords[i][1], panel.cords[i][2]] : null).filter(Boolean), slack = pulls.filter(([pull, , kind]) => pull < 0 && (kind === "string" || kind === "motor"));
    rows.push(["largest tension", force(Math.max(...pulls.map(p => p[0])))]);
    if (pulls.some(p => p[2] === "string")) rows.push(["slack", slack.length ? slack.map(p => p[1]).join(", ") : "none"]);
  }
  const held = panel.limits.filter(([, spans]) => spans.some(([a, b]) => a <= time && time <= b)).map(l => l[0]);
  if (panel.limits.length) rows.push(["at its limit", held.length ? held.slice(0, 3).join(", ") + (held.length > 3 ? ` and ${held.length - 3} more` : "") : "nothing"]);
  return rows;
}
function readout() {
  const rows = still ? [] : [["time", time.toFixed(2) + " s"]];
  panels.forEach((panel, i) => { for (const [name, value] of told(panel)) rows.push([panels.length > 1 ? `${"left right".split(" ")[i] || i + 1}: ${name}` : name, value]); });
  element("rows").replaceChildren(...rows.map(([name, value]) => {
    const row = document.createElement("tr"); for (const each of [name, value]) row.insertCell().textContent = each; return row; }));
  boxes().forEach((box, i) => { if (captions[i]) { captions[i].style.left = `${box[0] + box[2] - 14}px`; captions[i].style.top = `${H - box[1] - box[3] + 66}px`; } });
  element("slider").value = still ? 0 : (time - begin) / (end - begin);
  element("clock").textContent = `${time.toFixed(2)} / ${end.toFixed(2)} s`;
  element("play").textContent = playing ? "❚❚" : "▶";
  drawSpark();
}
function drawSpark() {
  const box = element("spark"), w = box.clientWidth, h = box.clientHeight, c = box.getContext("2d");
  if (!w || still) return;
  if (box.width !== Math.round(w * ratio) || box.height !== Math.round(h * ratio)) { box.width = Math.round(w * ratio); box.height = Math.round(h * ratio); }
  c.setTransform(ratio, 0, 0, ratio, 0, 0); c.clearRect(0, 0, w, h);
  const base = h - 7, x = t => (t - begin) / (end - begin) * w, now = x(time);
  c.fillStyle = ink.line; c.fillRect(0, base, w, 3); c.fillStyle = ink.accent; c.fillRect(0, base, now, 3);
  const errors = panels.filter(p => p.error), top = Math.max(1e-9, ...errors.map(p => p.error.reduce((a, b) => Math.max(a, b), 0)));
  errors.forEach((p, i) => {
    c.beginPath(); c.moveTo(x(p.T[0]), base);
    p.T.forEach((t, k) => c.lineTo(x(t), base - p.error[k] / top * (h - 22)));
    c.lineTo(x(p.T[p.last]), base); c.closePath(); c.globalAlpha = 0.28; c.fillStyle = i ? ink.ghost : ink.accent; c.fill(); c.globalAlpha = 1;
  });
  c.fillStyle = ink.soft; c.font = "11px system-ui, sans-serif"; c.textBaseline = "top";
  if (errors.length) c.fillText(`tracking error, up to ${top.toFixed(2)}°`, 2, 0);
  const limits = panels.flatMap(p => p.limits);
  if (limits.length) {
    c.fillStyle = ink.limit;
    for (const [, spans] of limits) for (const [a, b] of spans) c.fillRect(Math.floor(x(a)), base - 6, Math.max(2, Math.ceil(x(b) - x(a))), 4);
    if (!errors.length) c.fillText("limits that are active", 2, 0);
  }
  c.fillStyle = ink.slack;
  for (const p of panels) if (p.pulls) for (let k = 0; k < p.last; k++) if (p.pulls.some((v, i) => v && v[k] < 0 && p.cords[i][2] === "string")) c.fillRect(Math.floor(x(p.T[k])), base + 4, Math.ceil(x(p.T[k + 1])) - Math.floor(x(p.T[k])), 3);
  c.fillStyle = ink.ink; c.beginPath(); c.arc(clamp(now, 5, w - 5), base + 1.5, 5, 0, 7); c.fill(); c.globalAlpha = 0.4; c.fillRect(clamp(now, 0, w - 1), 14, 1, base - 14); c.globalAlpha = 1;
}
function legend() {
  const box = element("legend"), rows = [];
  const row = (...parts) => { const d = document.createElement("div"); d.append(...parts); rows.push(d); };
  const chip = (id, style) => { const s = document.createElement("span"); s.className = "swatch"; s.id = id; s.style.background = style || ""; return s; };
  const cords = panels.flatMap(p => p.pulls ? p.cords.map(c => c[2]) : []);
  if (show.cords && cords.length) {
    const tops = panels.map(p => p.top), scale = chip("scale", `linear-gradient(90deg, ${text(ink.low)}, ${text(ink.high)})`);
    row("0", scale, `${Number(Math.max(...tops).toPrecision(2))} N ${cords.includes("string") ? "string tension" : "tension"}`);
    if (cords.includes("string")) row(chip("slackmark"), "slack: would have to push");
  }
  if (show.reference && some(p => p.wanted || p.wantedPoses)) row(chip("", ink.ghost), some(p => p.traces.length) ? "reference pose and path" : "reference pose");
  if (show.trace && some(p => p.traces.length)) row(chip("", ink.accent), "path taken");
  if (show.forces) for (const [kind, colour, what, units] of [["force", ink.input, "force", "N"], ["torque", ink.input, "torque (double head)", "N m"], ["reaction", ink.reaction, "reaction", "N"]]) {
    const top = Math.max(0, ...panels.map(p => p.strongest[kind] || 0));
    if (top > 1e-9) row(chip("", colour), `${what}, up to ${Number(top.toPrecision(2))} ${units}`);
  }
  box.replaceChildren(...rows); box.hidden = rows.length === 0;
}
const keys = {};
function tool(label, key, title, letter) {
  const b = document.createElement("button");
  b.textContent = label; b.title = `${title} (${letter.toUpperCase()})`; b.setAttribute("aria-pressed", show[key]);
  b.onclick = () => { show[key] = !show[key]; if (key === "follow") shift = [0, 0, 0]; b.setAttribute("aria-pressed", show[key]); legend(); dirty = true; };
  element("tools").append(b); keys[letter] = b;
}
if (!still && some(p => p.focus >= 0)) tool("Follow", "follow", "Follow with the camera", "f");
if (show.reference) tool("Reference", "reference", "Show the reference pose", "r");
if (show.cords) tool(some(p => p.cords.some(c => c[2] === "string")) ? "Strings" : "Springs", "cords", "Show strings and springs", "s");
if (show.trace) tool("Paths", "trace", "Show the paths", "p");
if (some(p => p.marks.some(m => m[1] !== "slide"))) tool("Joints", "joints", "Show the joints and their axes", "j");
if (some(p => p.arrows.length)) tool("Forces", "forces", "Show forces, torques and reactions", "o");
const themeButton = document.createElement("button");
themeButton.textContent = "◐"; themeButton.title = "Light or dark (D)"; themeButton.setAttribute("aria-label", "Light or dark");
themeButton.onclick = () => { setTheme(theme === "dark" ? "light" : "dark"); dirty = true; };
element("tools").append(themeButton); keys.d = themeButton;
