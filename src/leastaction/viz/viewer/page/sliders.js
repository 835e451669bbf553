// ---------------------------------------------------------------- sliders: what stands still is moved by its joints
function moving([v0, v1, v2, w0, w1, w2], s) { // the pose exp(hat(twist) s)
  const v = [v0, v1, v2], w = [w0, w1, w2], n2 = dot(w, w);
  if (n2 === 0) return [1, 0, 0, 0, 1, 0, 0, 0, 1, ...scale(v, s)];
  const n = Math.sqrt(n2), u = scale(w, 1 / n), c = Math.cos(n * s), d = Math.sin(n * s), o = 1 - c;
  const R = [c + o * u[0] * u[0], o * u[0] * u[1] + d * u[2], o * u[0] * u[2] - d * u[1], o * u[0] * u[1] - d * u[2], c + o * u[1] * u[1], o * u[1] * u[2] + d * u[0],
    o * u[0] * u[2] + d * u[1], o * u[1] * u[2] - d * u[0], c + o * u[2] * u[2]];
  const p = scale(cross(w, v), 1 / n2);
  return [...R, ...add(add(p, turned([...R, 0, 0, 0], p), -1), w, dot(w, v) * s / n2)];
}
function follow(panel, q) { // the page draws what the sliders say from now on
  const joints = [], { frames } = panel.kinematics;
  for (const [parent, pose, twist, terms, offset] of panel.kinematics.joints) {
    const own = placed(pose, moving(twist, terms.reduce((s, [i, factor]) => s + factor * q[i], offset)));
    joints.push(parent < 0 ? own : placed(joints[parent], own));
  }
  const at = name => { const [joint, pose] = frames[name]; return joint < 0 ? pose : placed(joints[joint], pose); };
  panel.got.at = (k, w, i) => at(panel.got.names[i]).slice(9);
  if (panel.poses) panel.poses.at = (k, w, i) => at(panel.poses.names[i]);
}
const held = panels.length === 1 ? panels[0].kinematics : null;
if (held) {
  const box = document.createElement("section"), q = held.variables.map(v => v[1]), inputs = [];
  box.id = "sliders"; box.className = "panel"; box.hidden = true; box.setAttribute("aria-label", "Joints");
  const shown = x => x.toFixed(2);
  held.variables.forEach(([name, value, low, high], i) => {
    const row = document.createElement("label"), input = document.createElement("input"), number = document.createElement("output");
    Object.assign(input, { type: "range", min: low, max: high, step: (high - low) / 1000, value }); input.setAttribute("aria-label", name);
    number.textContent = shown(value); row.append(name, number, input); box.append(row); inputs.push(input);
    input.oninput = () => { q[i] = parseFloat(input.value); number.textContent = shown(q[i]); follow(panels[0], q); dirty = true; };
  });
  box.ondblclick = () => { held.variables.forEach((v, i) => { inputs[i].value = v[1]; inputs[i].oninput(); }); };
  document.body.append(box);
  show.sliders = false; tool("Move", "sliders", "Move the joints; double click to put them back", "m"); element("tools").append(themeButton);
  const click = keys.m.onclick; keys.m.onclick = () => { click(); box.hidden = !show.sliders; };
}
