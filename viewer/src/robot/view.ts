// The robot in WebGL: flat triangles, one colour for each part, the camera orbits the robot, z up.

import type { Part, Pose, RobotScene } from "./types";

export type Colour = [number, number, number];
type Vector = [number, number, number];

const VERTEX = `attribute vec3 position, normal; uniform mat4 view, model; uniform mat3 turn; varying vec3 n;
void main() { n = turn * normal; gl_Position = view * model * vec4(position, 1.0); }`;
/** Lit from the camera's side and a little from above; the back of a sheet as its front. */
const FRAGMENT = `precision mediump float; varying vec3 n; uniform vec3 colour, light;
void main() { float lit = abs(dot(normalize(n), light)); gl_FragColor = vec4(colour * (0.45 + 0.55 * lit), 1.0); }`;

const FIELD = Math.PI / 5;
const STEEPEST = (89 * Math.PI) / 180;
const TURN_PER_PIXEL = 0.008;

interface Drawn {
  part: Part;
  buffer: WebGLBuffer;
  count: number;
}

export class RobotView {
  private readonly gl: WebGLRenderingContext;
  private readonly program: WebGLProgram;
  private drawn: Drawn[] = [];
  private poses: Record<string, Pose | null> = {};
  private centre: Vector = [0, 0, 0];
  private radius = 1;
  private fitted = false;
  private azimuth = -0.9;
  private elevation = 0.35;
  private zoom = 1;

  constructor(readonly canvas: HTMLCanvasElement) {
    const gl = canvas.getContext("webgl", { antialias: true, alpha: true });
    if (!gl) throw new Error("no WebGL");
    this.gl = gl;
    this.program = link(gl);
    gl.useProgram(this.program);
    gl.enable(gl.DEPTH_TEST);
  }

  setScene(scene: RobotScene): void {
    const { gl } = this;
    for (const { buffer } of this.drawn) gl.deleteBuffer(buffer);
    this.fitted = false;
    this.drawn = scene.parts.map((part) => {
      const buffer = gl.createBuffer();
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      gl.bufferData(gl.ARRAY_BUFFER, withNormals(part.corners_m), gl.STATIC_DRAW);
      return { part, buffer, count: part.corners_m.length / 3 };
    });
  }

  setPoses(poses: Record<string, Pose | null>): void {
    this.poses = poses;
    if (!this.fitted) this.fit();
  }

  turn(dx: number, dy: number): void {
    this.azimuth -= dx * TURN_PER_PIXEL;
    this.elevation = Math.min(Math.max(this.elevation + dy * TURN_PER_PIXEL, -STEEPEST), STEEPEST);
  }

  nearer(factor: number): void {
    this.zoom = Math.min(Math.max(this.zoom * factor, 0.2), 12);
  }

  reset(): void {
    [this.azimuth, this.elevation, this.zoom] = [-0.9, 0.35, 1];
    this.fit();
  }

  /** A point of the base's frame in CSS pixels of the canvas; null behind the camera. */
  project(point: Vector): [number, number] | null {
    const m = this.viewMatrix();
    const at = (row: number) => (m[row] ?? 0) * point[0] + (m[row + 4] ?? 0) * point[1] + (m[row + 8] ?? 0) * point[2] + (m[row + 12] ?? 0);
    const w = at(3);
    if (w <= 0) return null;
    return [(0.5 + (0.5 * at(0)) / w) * this.canvas.clientWidth, (0.5 - (0.5 * at(1)) / w) * this.canvas.clientHeight];
  }

  render(colour: (part: Part) => Colour): void {
    const { gl, program, canvas } = this;
    const scale = Math.min(window.devicePixelRatio || 1, 2);
    const [width, height] = [Math.round(canvas.clientWidth * scale), Math.round(canvas.clientHeight * scale)];
    if (canvas.width !== width || canvas.height !== height) [canvas.width, canvas.height] = [width, height];
    gl.viewport(0, 0, width, height);
    gl.clearColor(0, 0, 0, 0);
    gl.clear(gl.COLOR_BUFFER_BIT | gl.DEPTH_BUFFER_BIT);
    const { forward, up } = this.axes();
    const light = normalised([0.4 * up[0] - forward[0], 0.4 * up[1] - forward[1], 0.4 * up[2] - forward[2]]);
    gl.uniform3fv(gl.getUniformLocation(program, "light"), light);
    gl.uniformMatrix4fv(gl.getUniformLocation(program, "view"), false, this.viewMatrix());
    for (const { part, buffer, count } of this.drawn) {
      const pose = this.poses[part.link];
      if (!pose) continue;
      const [a, b, c, d, e, f, g, h, i, x, y, z] = pose;
      gl.uniformMatrix4fv(gl.getUniformLocation(program, "model"), false, [a, b, c, 0, d, e, f, 0, g, h, i, 0, x, y, z, 1]);
      gl.uniformMatrix3fv(gl.getUniformLocation(program, "turn"), false, [a, b, c, d, e, f, g, h, i]);
      gl.uniform3fv(gl.getUniformLocation(program, "colour"), colour(part));
      gl.bindBuffer(gl.ARRAY_BUFFER, buffer);
      for (const [name, offset] of [["position", 0], ["normal", 12]] as const) {
        const place = gl.getAttribLocation(program, name);
        gl.enableVertexAttribArray(place);
        gl.vertexAttribPointer(place, 3, gl.FLOAT, false, 24, offset);
      }
      gl.drawArrays(gl.TRIANGLES, 0, count);
    }
  }

  /** The camera sees every part, and every link without one. */
  private fit(): void {
    const low: Vector = [Infinity, Infinity, Infinity];
    const high: Vector = [-Infinity, -Infinity, -Infinity];
    const take = (point: Vector) => {
      for (let axis = 0; axis < 3; axis += 1) {
        low[axis] = Math.min(low[axis] ?? 0, point[axis] ?? 0);
        high[axis] = Math.max(high[axis] ?? 0, point[axis] ?? 0);
      }
    };
    for (const pose of Object.values(this.poses)) if (pose) take([pose[9], pose[10], pose[11]]);
    for (const { part } of this.drawn) {
      const pose = this.poses[part.link];
      if (!pose) continue;
      for (let k = 0; k < part.corners_m.length; k += 3) take(moved(pose, part.corners_m.slice(k, k + 3) as Vector));
    }
    if (!Number.isFinite(low[0])) return;
    this.centre = [0, 1, 2].map((axis) => 0.5 * ((low[axis] ?? 0) + (high[axis] ?? 0))) as Vector;
    this.radius = Math.max(0.5 * Math.hypot(high[0] - low[0], high[1] - low[1], high[2] - low[2]), 0.05);
    this.fitted = true;
  }

  private axes(): { forward: Vector; right: Vector; up: Vector } {
    const [ca, sa, ce, se] = [Math.cos(this.azimuth), Math.sin(this.azimuth), Math.cos(this.elevation), Math.sin(this.elevation)];
    return { forward: [-ca * ce, -sa * ce, -se], right: [-sa, ca, 0], up: [-ca * se, -sa * se, ce] };
  }

  /** Perspective times view, by columns. */
  private viewMatrix(): number[] {
    const { forward, right, up } = this.axes();
    const aspect = Math.max(this.canvas.clientWidth, 1) / Math.max(this.canvas.clientHeight, 1);
    const distance = (1.02 * this.radius) / Math.sin(0.5 * FIELD * Math.min(1, aspect)) / this.zoom;
    const eye = [0, 1, 2].map((axis) => (this.centre[axis] ?? 0) - distance * (forward[axis] ?? 0)) as Vector;
    const f = 1 / Math.tan(0.5 * FIELD);
    const [near, far] = [0.02 * distance, distance + 4 * this.radius];
    const row = (axis: Vector, factor: number) => [...axis.map((value) => value * factor), -factor * dot(axis, eye)];
    const x = row(right, f / aspect);
    const y = row(up, f);
    const w = row(forward, 1);
    const depth = (far + near) / (far - near);
    const z = w.map((value, column) => value * depth - (column === 3 ? (2 * far * near) / (far - near) : 0));
    return [0, 1, 2, 3].flatMap((column) => [x[column] ?? 0, y[column] ?? 0, z[column] ?? 0, w[column] ?? 0]);
  }
}

function moved(pose: Pose, [x, y, z]: Vector): Vector {
  return [0, 1, 2].map((axis) => (pose[axis] ?? 0) * x + (pose[axis + 3] ?? 0) * y + (pose[axis + 6] ?? 0) * z + (pose[axis + 9] ?? 0)) as Vector;
}

function dot(a: Vector, b: Vector): number {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

function normalised(vector: Vector): Vector {
  const length = Math.hypot(...vector) || 1;
  return vector.map((part) => part / length) as Vector;
}

/** Each corner followed by the normal of its triangle. */
function withNormals(corners: number[]): Float32Array {
  const data = new Float32Array(2 * corners.length);
  for (let first = 0; first + 8 < corners.length; first += 9) {
    const [a, b, c] = [0, 3, 6].map((corner) => corners.slice(first + corner, first + corner + 3) as Vector) as [Vector, Vector, Vector];
    const u: Vector = [b[0] - a[0], b[1] - a[1], b[2] - a[2]];
    const v: Vector = [c[0] - a[0], c[1] - a[1], c[2] - a[2]];
    const normal = normalised([u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2], u[0] * v[1] - u[1] * v[0]]);
    [a, b, c].forEach((corner, index) => data.set([...corner, ...normal], 2 * first + 6 * index));
  }
  return data;
}

function link(gl: WebGLRenderingContext): WebGLProgram {
  const program = gl.createProgram();
  for (const [kind, source] of [[gl.VERTEX_SHADER, VERTEX], [gl.FRAGMENT_SHADER, FRAGMENT]] as const) {
    const shader = gl.createShader(kind);
    if (!shader) throw new Error("no WebGL");
    gl.shaderSource(shader, source);
    gl.compileShader(shader);
    gl.attachShader(program, shader);
  }
  gl.linkProgram(program);
  if (!gl.getProgramParameter(program, gl.LINK_STATUS)) throw new Error(gl.getProgramInfoLog(program) ?? "no WebGL");
  return program;
}
