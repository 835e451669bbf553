// ---------------------------------------------------------------- scene: what is painted at a time
const CAPSULE = 0, CYLINDER = 1, SPHERE = 2, CONE = 3;
function bodies(panel, poses, points, bones, tint) {
  const found = [];
  if (poses) for (const [frame, mesh, matrix, width, colour] of panel.solids) {
    const own = tint ? poses.names.indexOf(panel.poses.names[frame]) : frame;
    if (own >= 0) found.push({ mesh, A: placed(poses.now(own), matrix), width, colour: tint || colour });
  }
  for (const [a, b, radius, colour] of bones) found.push({ mesh: CAPSULE, A: between(points[a], points[b]), width: radius, colour: tint || colour || WOOD });
  return found;
}
function cordThings(panel, points, k, w, found) {
  panel.cords.forEach(([path, , kind, mesh], i) => {
    const known = panel.pulls && panel.pulls[i], pull = known ? panel.mix(known, k, w) : 0, part = clamp(pull / panel.top, 0, 1), slack = known && pull < 0 && kind !== "spring" && kind !== "damper" && kind !== "rod";
    const colour = slack ? [...rgb(ink.slack), 1] : known ? [...mixed(ink.low, ink.high, kind === "string" ? part : clamp(Math.abs(pull) / panel.top, 0, 1)), 1] : kind === "string" ? [...rgb(ink.soft), 1] : METAL;
    for (let j = 1; j < path.length; j++) {
      const a = points[path[j - 1]], b = points[path[j]], middle = scale(add(a, b), 0.5), r = thin(middle, known ? 1.6 + 1.8 * part : 1.8), length = Math.hypot(...add(b, a, -1));
      if (kind === "spring") found.push({ mesh, A: between(a, b, 0.028 * panel.size), width: Math.max(0.0045 * panel.size, thin(middle, 1.5)), colour });
      else if (kind === "rod") found.push({ mesh, A: between(a, b), width: Math.max(0.006 * panel.size, r), colour });
      else {
        found.push({ mesh, A: between(a, b), width: kind === "string" ? r : Math.max(0.006 * panel.size, r), colour, dash: slack ? Math.max(2, length / (8 * thin(middle, 2))) : 0, flat: kind === "string" ? 0.55 : 0 });
        if (kind !== "string") found.push({ mesh: CYLINDER, A: between(add(a, add(b, a, -1), 0.3), add(a, add(b, a, -1), 0.65), (kind === "motor" ? 0.026 : 0.018) * panel.size), colour });
      }
    }
    const held = points[path[path.length - 1]], tied = points[path[0]];
    if (kind === "string") for (const [p, pixels] of [[held, 8], [tied, 4.4]]) { const r = thin(p, pixels); found.push({ mesh: SPHERE, A: [r, 0, 0, 0, r, 0, 0, 0, r, ...p], colour, flat: 0.55 }); }
  });
}
function markThings(panel, found) {
  const r = 0.011 * panel.size;
  for (const [, kind, frame, point, axis, reach] of panel.marks) {
    const pose = panel.poses.now(frame), p = moved(pose, point), d = turned(pose, axis), colour = [...rgb(ink.accent), 1];
    if (kind === "slide") found.push({ mesh: CAPSULE, A: between(add(p, d, reach[0]), add(p, d, reach[1])), width: 0.5 * r, colour: METAL });
    else if (show.joints && kind === "ball") found.push({ mesh: SPHERE, A: [1.6 * r, 0, 0, 0, 1.6 * r, 0, 0, 0, 1.6 * r, ...p], colour, over: true });
    else if (show.joints) found.push({ mesh: CYLINDER, A: between(add(p, d, -2 * r), add(p, d, 2 * r), r), colour, over: true }, { mesh: CAPSULE, A: between(add(p, d, -7 * r), add(p, d, 7 * r)), width: thin(p, 1.6), colour, flat: 0.6, over: true });
  }
}
function arrow(found, p, v, colour, double) {
  const length = Math.hypot(...v);
  if (length < 1e-9) return;
  const d = scale(v, 1 / length), r = thin(p, 3.2), head = Math.min(0.5 * length, 9 * r), tip = add(p, v), neck = add(tip, d, -head), [x, y] = across(d);
  found.push({ mesh: CAPSULE, A: between(p, neck), width: r, colour, flat: 0.5 });
  for (const at of double ? [neck, add(neck, d, -0.6 * head)] : [neck]) found.push({ mesh: CONE, A: [...scale(x, 3 * r), ...scale(y, 3 * r), ...scale(d, head), ...at], colour, flat: 0.5 });
}
function arrowThings(panel, k, w, found) {
  for (const { kind, place, vector } of panel.arrows) {
    const colour = [...rgb(kind === "reaction" ? ink.reaction : ink.input), 1];
    arrow(found, panel.mix3(place, k, w), scale(panel.mix3(vector, k, w), 0.3 * panel.size / panel.strongest[kind]), colour, kind === "torque");
  }
}
function traceThings(panel, found) {
  const span = 1.2, steps = 48;
  for (const i of panel.traces) for (const [source, paint] of [[show.reference ? panel.wanted : null, ink.ghost], [panel.got, ink.accent]]) {
    const index = source ? source.names.indexOf(panel.points.names[i]) : -1;
    if (index < 0) continue;
    let before = null;
    for (let s = 0; s <= steps; s++) {
      const at = time - span * (1 - s / steps);
      if (at < begin) continue;
      const p = source.at(...panel.frame(at), index);
      if (before && Math.hypot(...add(p, before, -1)) > 1e-7) found.push({ mesh: CAPSULE, A: between(before, p), width: thin(p, 1.9), colour: [...rgb(paint), 0.75 * s / steps], flat: 1 });
      before = p;
    }
  }
}
// The middle of each panel's box on the page, and the box: side by side, or one above the other on a tall screen.
function boxes() {
  const n = panels.length, tall = H > W;
  return panels.map((_, i) => tall ? [0, Math.round(H * (n - 1 - i) / n), W, Math.round(H / n)] : [Math.round(W * i / n), 0, Math.round(W / n), H]);
}
function draw() {
  pen.setTransform(ratio, 0, 0, ratio, 0, 0); pen.clearRect(0, 0, W, H);
  boxes().forEach((box, i) => {
    const panel = panels[i], [k, w] = panel.frame(time);
    const seen = aim(panel, k, w, box[2], box[3]), points = panel.got.names.map((_, j) => panel.got.at(k, w, j));
    for (const poses of [panel.poses, panel.wantedPoses]) if (poses) poses.now = j => poses.at(k, w, j);
    const things = bodies(panel, panel.poses, points, panel.bones, null);
    if (show.cords) cordThings(panel, points, k, w, things);
    if (panel.marks.length) markThings(panel, things);
    if (show.forces) arrowThings(panel, k, w, things);
    if (show.trace) traceThings(panel, things);
    let ghosts = [];
    if (show.reference && (panel.wanted || panel.wantedPoses)) {
      const wanted = panel.wanted ? panel.wanted.names.map((_, j) => panel.wanted.at(k, w, j)) : [];
      ghosts = bodies(panel, panel.wantedPoses, wanted, panel.ghostBones, [...rgb(ink.ghost), 0.42]);
      for (const each of ghosts) each.flat = 0.5;
    }
    const floor = [seen.centre[0], seen.centre[1], panel.floor];
    panel.centre = project(seen.centre);
    if (paint) paint({ box: box.map(x => Math.round(x * ratio)), camera: seen.matrix, eye: seen.eye, light: LIGHT, ...sun(panel, seen.centre), things, ghosts, look, ground: { middle: floor, reach: 9 * S.grid > 3 * S.size ? 9 * S.grid : 3 * S.size } });
    if (show.joints) names(panel, box);
  });
  pen.fillStyle = ink.line;
  for (const [x, y, w, h] of boxes().slice(1)) if (x) pen.fillRect(x, 0, 1, H); else pen.fillRect(0, H - y - h, w, 1);
  readout();
}
function names(panel, box) {
  pen.font = "12px system-ui, sans-serif"; pen.textBaseline = "middle"; pen.lineWidth = 3; pen.strokeStyle = ink.sky; pen.fillStyle = ink.ink; pen.lineJoin = "round";
  const taken = [];
  for (const [name, , frame, point] of panel.marks) {
    const { x, y, depth } = project(moved(panel.poses.now(frame), point));
    let at = y;
    while (taken.some(([a, b]) => Math.abs(a - x) < 90 && Math.abs(b - at) < 14)) at += 14; // labels do not lie on each other
    taken.push([x, at]);
    if (depth > 0 && x > 0 && x < box[2]) { const left = box[0] + x + 12, top = H - box[1] - box[3] + at; pen.strokeText(name, left, top); pen.fillText(name, left, top); }
  }
}
