// Draw Gaussians with WebGL2, the farthest first.

const TEXTURE_WIDTH = 2048;

class Renderer {
  constructor(canvas, scene, worker) {
    this.canvas = canvas;
    this.scene = scene;
    this.worker = worker;
    const gl = canvas.getContext("webgl2", { alpha: false, antialias: false, depth: false });
    if (!gl) throw new Error("This browser has no WebGL2, which the page draws with.");
    this.gl = gl;
    this.program = linked(gl, shaderText("vertex"), shaderText("fragment"));
    gl.useProgram(this.program);
    this.uniform = (name) => gl.getUniformLocation(this.program, name);
    this.buffers();
    this.textures();
    this.waiting = [];
    worker.postMessage({ means: scene.means });
    worker.addEventListener("message", ({ data }) => data.order && this.sorted(data));
  }

  buffers() {
    const gl = this.gl;
    this.orderBuffer = gl.createBuffer();
    gl.bindBuffer(gl.ARRAY_BUFFER, this.orderBuffer);
    gl.bufferData(gl.ARRAY_BUFFER, 4 * this.scene.drawn, gl.DYNAMIC_DRAW);
    const index = gl.getAttribLocation(this.program, "index");
    gl.enableVertexAttribArray(index);
    gl.vertexAttribIPointer(index, 1, gl.UNSIGNED_INT, 0, 0);
    gl.vertexAttribDivisor(index, 1);
    gl.enable(gl.BLEND);
    gl.blendFunc(gl.ONE, gl.ONE_MINUS_SRC_ALPHA);
  }

  textures() {
    const { drawn: count, means, opacities, covariances, colors, bands, facts } = this.scene;
    const geometry = new Float32Array(12 * count), shades = new Float32Array(16 * count);
    for (let one = 0; one < count; one++) {
      geometry.set(means.subarray(3 * one, 3 * one + 3), 12 * one);
      geometry[12 * one + 3] = opacities[one];
      geometry.set(covariances.subarray(6 * one, 6 * one + 6), 12 * one + 4);
      shades.set(colors.subarray(3 * one, 3 * one + 3), 16 * one);
      for (let band = 0; band < facts.bands; band++)
        shades.set(bands.subarray(3 * (one * facts.bands + band), 3 * (one * facts.bands + band) + 3), 16 * one + 4 * (band + 1));
    }
    this.paint = new Uint8Array(4 * count);
    this.texture(0, "geometry", geometry);
    this.texture(1, "colors", shades);
    this.texture(2, "paint", this.paint);
  }

  texture(place, name, values) {
    const gl = this.gl, bytes = values instanceof Uint8Array, [padded, height] = paddedRows(values);
    gl.activeTexture(gl.TEXTURE0 + place);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texImage2D(gl.TEXTURE_2D, 0, bytes ? gl.RGBA8 : gl.RGBA32F, TEXTURE_WIDTH, height, 0, gl.RGBA, bytes ? gl.UNSIGNED_BYTE : gl.FLOAT, padded);
    for (const side of [gl.TEXTURE_MIN_FILTER, gl.TEXTURE_MAG_FILTER]) gl.texParameteri(gl.TEXTURE_2D, side, gl.NEAREST);
    gl.uniform1i(this.uniform(name), place);
  }

  // Colors over the Gaussians: bytes of color and of use (0 none, 64 hidden, 128 gray, 255 this color).
  setPaint(paint) {
    const gl = this.gl, [padded, height] = paddedRows(paint);
    this.paint = paint;
    gl.activeTexture(gl.TEXTURE2);
    gl.texSubImage2D(gl.TEXTURE_2D, 0, 0, 0, TEXTURE_WIDTH, height, gl.RGBA, gl.UNSIGNED_BYTE, padded);
  }

  // Ask for the order of a camera; the promise resolves when the buffer holds it.
  sort(camera) {
    const row = [...camera.forward, -inner(camera.forward, camera.eye)];
    return new Promise((resolve) => {
      this.waiting.push(resolve);
      this.worker.postMessage({ sort: row });
    });
  }

  sorted({ order }) {
    const gl = this.gl;
    gl.bindBuffer(gl.ARRAY_BUFFER, this.orderBuffer);
    gl.bufferSubData(gl.ARRAY_BUFFER, 0, order);
    this.waiting.shift()?.();
  }

  // Draw the last order from a camera; focal in pixels of the canvas.
  draw(camera, focal) {
    const gl = this.gl, { facts, drawn } = this.scene, { width, height } = this.canvas, raster = facts.raster;
    const { right, down, forward } = camera;
    gl.viewport(0, 0, width, height);
    gl.uniformMatrix3fv(this.uniform("worldToCamera"), false, [0, 1, 2].flatMap((axis) => [right[axis], down[axis], forward[axis]]));
    gl.uniform3fv(this.uniform("eye"), camera.eye);
    gl.uniform2f(this.uniform("size"), width, height);
    gl.uniform1f(this.uniform("focal"), focal);
    gl.uniform1f(this.uniform("near"), facts.near);
    gl.uniform3f(this.uniform("limits"), raster.margin, raster.blur, raster.least_alpha);
    gl.uniform2f(this.uniform("bounds"), raster.least_alpha, raster.most_alpha);
    gl.uniform1i(this.uniform("bands"), facts.bands);
    const behind = Number(facts.white);
    gl.clearColor(behind, behind, behind, 1);
    gl.clear(gl.COLOR_BUFFER_BIT);
    gl.drawArraysInstanced(gl.TRIANGLE_STRIP, 0, 4, drawn);
  }

  // Wait until the picture is there: a pixel can be read only then.
  finish() {
    this.gl.readPixels(0, 0, 1, 1, this.gl.RGBA, this.gl.UNSIGNED_BYTE, new Uint8Array(4));
  }
}

// Whole rows of a texture with four values a pixel, and their number.
function paddedRows(values) {
  const height = Math.max(1, Math.ceil(values.length / 4 / TEXTURE_WIDTH));
  const padded = new values.constructor(4 * TEXTURE_WIDTH * height);
  padded.set(values);
  return [padded, height];
}

const shaderText = (name) => document.getElementById(name).textContent.trim();

function linked(gl, vertex, fragment) {
  const program = gl.createProgram();
  for (const [kind, text] of [[gl.VERTEX_SHADER, vertex], [gl.FRAGMENT_SHADER, fragment]]) {
    const shader = gl.createShader(kind);
    gl.shaderSource(shader, text);
    gl.compileShader(shader);
    if (!gl.getShaderParameter(shader, gl.COMPILE_STATUS)) throw new Error(gl.getShaderInfoLog(shader));
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program));
  return program;
}
