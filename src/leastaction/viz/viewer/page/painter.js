// ---------------------------------------------------------------- painter: meshes, light and shadow by WebGL 2
const SHADOW = 2048;
const HEAD = `#version 300 es
precision highp float; precision highp sampler2DShadow;
`;
const PLACE = HEAD + `
in vec3 p, n; uniform mat4 A, camera; uniform mat3 N; uniform float width; out vec3 P, M; out float along;
void main() { M = N * n; vec3 q = (A * vec4(p, 1.)).xyz + width * M; P = q; along = p.z; gl_Position = camera * vec4(q, 1.); }`;
const LIT = `
uniform sampler2DShadow shade; uniform mat4 lamp; uniform float soft;
float lit(vec3 q) {
  vec3 s = (lamp * vec4(q, 1.)).xyz * .5 + .5; float sum = 0.;
  if (any(greaterThan(abs(s - .5), vec3(.5)))) return 1.;
  for (int i = -2; i <= 2; i++) for (int j = -2; j <= 2; j++) sum += texture(shade, s + vec3(soft * vec2(i, j), -.0012));
  return sum / 25.;
}`;
const BODY = HEAD + LIT + `
in vec3 P, M; in float along; uniform vec4 colour; uniform vec3 eye, light, sky, earth; uniform float dash, flatness, lift; out vec4 shown;
void main() {
  if (dash > 0. && fract(along * dash) > .55) discard;
  vec3 v = normalize(eye - P), f = normalize(cross(dFdx(P), dFdy(P))), m = normalize(M);
  if (dot(f, v) < 0.) f = -f;
  if (dot(m, f) < 0.) m = -m;
  m = normalize(mix(f, m, smoothstep(.55, .8, dot(m, f)))); // what is a sharp edge stays one
  vec3 base = pow(colour.rgb, vec3(2.2)); float facing = max(dot(m, light), 0.), sun = facing > 0. ? mix(1., lit(P + lift * m), smoothstep(.02, .3, facing)) : 0.;
  vec3 c = base * (mix(earth, sky, .5 + .5 * m.z) + .8 * facing * sun);
  c += .10 * sun * pow(max(dot(m, normalize(light + v)), 0.), 40.) + .05 * pow(1. - max(dot(m, v), 0.), 3.) * sky;
  shown = vec4(pow(mix(c, base, flatness), vec3(1. / 2.2)), 1.) * colour.a; shown.a = colour.a;
}`;
const FLOOR = HEAD + LIT + `
in vec3 P, M; in float along; uniform vec4 colour; uniform vec3 middle; uniform float grid, reach, dark; out vec4 shown;
void main() {
  vec2 g = P.xy / grid, d = fwidth(g), l = abs(fract(g - .5) - .5) / d; float far = length(P.xy - middle.xy) / reach;
  float line = clamp(1.1 - min(l.x, l.y), 0., 1.) * clamp(1. - 2.5 * max(d.x, d.y), 0., 1.) * .8;
  float fade = clamp(1. - far, 0., 1.), s = (1. - lit(P)) * dark * smoothstep(0., .25, fade), a = colour.a * line * fade;
  float whole = s + a * (1. - s);
  shown = vec4(colour.rgb * a * (1. - s), whole);
}`;
const SKY = HEAD + "in vec3 p, n; out float h; void main() { h = p.y; gl_Position = vec4(p.xy, .9999, 1.); }";
const BACK = HEAD + "in float h; uniform vec3 top, bottom; out vec4 shown; void main() { shown = vec4(mix(bottom, top, .5 + .5 * h), 1.); }";
const NOTHING = HEAD + "in vec3 P, M; in float along; uniform float dash; void main() { if (dash > 0. && fract(along * dash) > .55) discard; }";

function painter(canvas) {
  const gl = canvas.getContext("webgl2", { antialias: true, alpha: false });
  if (!gl) return null;
  const program = (vertex, fragment) => {
    const made = gl.createProgram(), at = {};
    for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, text); gl.compileShader(shader); gl.attachShader(made, shader);
      if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    }
    gl.bindAttribLocation(made, 0, "p"); gl.bindAttribLocation(made, 1, "n"); gl.linkProgram(made);
    for (let i = gl.getProgramParameter(made, gl.ACTIVE_UNIFORMS) - 1; i >= 0; i--) { const { name } = gl.getActiveUniform(made, i); at[name] = gl.getUniformLocation(made, name); }
    return { made, at };
  };
  const body = program(PLACE, BODY), floor = program(PLACE, FLOOR), cast = program(PLACE, NOTHING), back = program(SKY, BACK);
  const mesh = (p, n, index) => {
    const vao = gl.createVertexArray();
    gl.bindVertexArray(vao);
    for (const [slot, values] of [[0, p], [1, n]]) {
      gl.bindBuffer(gl.ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ARRAY_BUFFER, values, gl.STATIC_DRAW);
      gl.enableVertexAttribArray(slot); gl.vertexAttribPointer(slot, 3, gl.FLOAT, false, 0, 0);
    }
    gl.bindBuffer(gl.ELEMENT_ARRAY_BUFFER, gl.createBuffer()); gl.bufferData(gl.ELEMENT_ARRAY_BUFFER, index, gl.STATIC_DRAW);
    return { vao, count: index.length };
  };
  const meshes = S.meshes.map(data => {
    const code = new Uint16Array(bytes(data.p)), index = data.wide ? new Uint32Array(bytes(data.i)) : Uint32Array.from(new Uint16Array(bytes(data.i)));
    const p = Float32Array.from(code, (c, i) => data.low[i % 3] + data.step[i % 3] * c), n = new Float32Array(p.length);
    if (data.n) { const given = new Int8Array(bytes(data.n)); for (let i = 0; i < n.length; i++) n[i] = given[i] / 127; }
    else for (let i = 0; i < index.length; i += 3) { // the sum of the triangles around, by their areas
      const at = [0, 1, 2].map(k => 3 * index[i + k]), [a, b, c] = at.map(j => [p[j], p[j + 1], p[j + 2]]), f = cross(add(b, a, -1), add(c, a, -1));
      for (const j of at) for (let k = 0; k < 3; k++) n[j + k] += f[k];
    }
    return { ...mesh(p, n, index), offsets: !!data.n };
  });
  const plane = { ...mesh(new Float32Array([-1, -1, 0, 1, -1, 0, 1, 1, 0, -1, 1, 0]), new Float32Array([0, 0, 1, 0, 0, 1, 0, 0, 1, 0, 0, 1]), new Uint32Array([0, 1, 2, 0, 2, 3])), offsets: false };
  const depth = gl.createTexture(), target = gl.createFramebuffer();
  gl.bindTexture(gl.TEXTURE_2D, depth); gl.texStorage2D(gl.TEXTURE_2D, 1, gl.DEPTH_COMPONENT24, SHADOW, SHADOW);
  for (const [key, value] of [[gl.TEXTURE_MIN_FILTER, gl.LINEAR], [gl.TEXTURE_MAG_FILTER, gl.LINEAR], [gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE], [gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE],
    [gl.TEXTURE_COMPARE_MODE, gl.COMPARE_REF_TO_TEXTURE], [gl.TEXTURE_COMPARE_FUNC, gl.LEQUAL]]) gl.texParameteri(gl.TEXTURE_2D, key, value);
  gl.bindFramebuffer(gl.FRAMEBUFFER, target); gl.framebufferTexture2D(gl.FRAMEBUFFER, gl.DEPTH_ATTACHMENT, gl.TEXTURE_2D, depth, 0);
  gl.drawBuffers([gl.NONE]); gl.readBuffer(gl.NONE);
  gl.enable(gl.DEPTH_TEST); gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);

  function put(on, each) {
    const A = each.A, shape = each.mesh === -1 ? plane : meshes[each.mesh];
    gl.uniformMatrix4fv(on.at.A, false, [A[0], A[1], A[2], 0, A[3], A[4], A[5], 0, A[6], A[7], A[8], 0, A[9], A[10], A[11], 1]);
    gl.uniformMatrix3fv(on.at.N, false, normals(A, shape.offsets)); gl.uniform1f(on.at.width, each.width || 0); gl.uniform1f(on.at.dash, each.dash || 0);
    if (on === body) { gl.uniform4fv(body.at.colour, each.colour); gl.uniform1f(body.at.flatness, each.flat || 0); }
    gl.bindVertexArray(shape.vao); gl.drawElements(gl.TRIANGLES, shape.count, gl.UNSIGNED_INT, 0);
  }
  // things: { mesh, A, width, colour, dash, flat }; ghosts are laid over at once, so that overlapping limbs do not add up.
  return function paint({ box, camera, eye, light, lamp, reach, things, ghosts, look, ground }) {
    gl.bindFramebuffer(gl.FRAMEBUFFER, target); gl.viewport(0, 0, SHADOW, SHADOW); gl.disable(gl.SCISSOR_TEST); gl.depthMask(true); gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.useProgram(cast.made); gl.uniformMatrix4fv(cast.at.camera, false, lamp);
    for (const each of things) if (!each.flat && !each.over) put(cast, each);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null); gl.viewport(...box); gl.enable(gl.SCISSOR_TEST); gl.scissor(...box); gl.clear(gl.DEPTH_BUFFER_BIT);
    gl.depthMask(false); gl.useProgram(back.made); gl.uniform3fv(back.at.top, look.sky); gl.uniform3fv(back.at.bottom, look.paper);
    gl.bindVertexArray(plane.vao); gl.drawElements(gl.TRIANGLES, 6, gl.UNSIGNED_INT, 0);
    gl.enable(gl.BLEND);
    for (const on of [floor, body]) {
      gl.useProgram(on.made); gl.uniformMatrix4fv(on.at.camera, false, camera); gl.uniformMatrix4fv(on.at.lamp, false, lamp); gl.uniform1i(on.at.shade, 0); gl.uniform1f(on.at.soft, 1.3 / SHADOW);
      if (on === floor) {
        gl.uniform4fv(floor.at.colour, [...look.line, 1]); gl.uniform3fv(floor.at.middle, ground.middle); gl.uniform1f(floor.at.grid, S.grid); gl.uniform1f(floor.at.reach, ground.reach); gl.uniform1f(floor.at.dark, look.dark);
        put(floor, { mesh: -1, A: [ground.reach, 0, 0, 0, ground.reach, 0, 0, 0, 1, ...ground.middle] });
        gl.disable(gl.BLEND); gl.depthMask(true);
      } else {
        gl.uniform3fv(body.at.eye, eye); gl.uniform1f(body.at.lift, 6 * reach / SHADOW); gl.uniform3fv(body.at.light, light); gl.uniform3fv(body.at.sky, look.ambient); gl.uniform3fv(body.at.earth, look.earth);
        if (ghosts.length) { // only what is nearest of them, and behind all else: it nearly coincides with it
          gl.enable(gl.BLEND); gl.colorMask(false, false, false, false); for (const each of ghosts) put(body, each);
          gl.colorMask(true, true, true, true); gl.depthFunc(gl.LEQUAL); for (const each of ghosts) put(body, each); gl.depthFunc(gl.LESS);
          gl.disable(gl.BLEND); gl.clear(gl.DEPTH_BUFFER_BIT);
        }
        for (const each of things) if (each.colour[3] >= 1 && !each.over) put(body, each);
        gl.enable(gl.BLEND); gl.depthMask(false);
        for (const each of things) if (each.colour[3] < 1) put(body, each);
        gl.depthMask(true); gl.clear(gl.DEPTH_BUFFER_BIT); for (const each of things) if (each.over) put(body, each); // joints are seen through what is around them
        gl.disable(gl.BLEND); gl.depthMask(true);
      }
    }
  };
}
