// The 3D view of the skin: drawing, and the point of the skin under a pixel.

import {
  BufferAttribute,
  BufferGeometry,
  Color,
  DynamicDrawUsage,
  type Material,
  Mesh,
  PerspectiveCamera,
  Raycaster,
  Scene,
  type ShaderMaterial,
  Vector2,
  Vector3,
  WebGLRenderer,
} from "three";

import { colourTable, contactColour, SLOT_COUNT, type Theme } from "./colours";
import { contactForm } from "./form";
import { contactLabel, electrodeText } from "./format";
import { type Label, Labels } from "./labels";
import { ContactMarks, contactRadius, ElectrodeMarks, GuideMark, PressMarks } from "./markers";
import { Orbit } from "./orbit";
import { skinMaterial, tableTexture } from "./shading";
import type { Contact, ElectrodeHealth, SceneMessage, Vec2, Vec3 } from "./types";

/** Below this rate the resolution is reduced step by step. */
const SLOW_MS = 50;
const STEPS = [1, 0.8, 0.6];
/** Frames averaged before a step, so that one slow frame has no effect. */
const LOOKED_AT = 40;
/** The body is this far above the middle, CSS pixels: the colour scale is below. */
const RAISED = 16;

/** The objects of one scene. */
interface Body {
  mesh: Mesh<BufferGeometry, ShaderMaterial>;
  values: BufferAttribute;
  electrodes: ElectrodeMarks;
  contacts: ContactMarks;
  presses: PressMarks;
  guide: GuideMark;
  scene: SceneMessage;
}

export class SkinView {
  readonly orbit: Orbit;
  showNumbers = false;
  hovered: number | null = null;
  private readonly renderer: WebGLRenderer;
  private readonly world = new Scene();
  private readonly camera = new PerspectiveCamera(28, 1, 0.01, 10);
  private readonly raycaster = new Raycaster();
  private readonly labels: Labels;
  private body: Body | null = null;
  private theme: Theme = "light";
  private health: ElectrodeHealth[] = [];
  private contacts: readonly Contact[] = [];
  private slots: readonly number[] = [];
  private tips: Vector3[] = [];
  /** The place to press, as text. */
  private guided = "";
  private size: Vec2 = [1, 1];
  private step = 0;
  private paceMs = 0;
  private paced = 0;

  constructor(
    readonly canvas: HTMLCanvasElement,
    overlay: HTMLElement,
  ) {
    const antialias = !drawnBySoftware();
    this.renderer = new WebGLRenderer({ canvas, antialias, alpha: true, powerPreference: "high-performance" });
    this.orbit = new Orbit(this.camera);
    this.labels = new Labels(overlay);
  }

  setScene(scene: SceneMessage): void {
    this.dispose();
    const geometry = new BufferGeometry();
    geometry.setAttribute("position", new BufferAttribute(new Float32Array(scene.skin.vertices_m), 3));
    geometry.setAttribute("normal", new BufferAttribute(new Float32Array(scene.skin.normals), 3));
    const values = new BufferAttribute(new Float32Array(scene.skin.vertices_m.length / 3), 1).setUsage(DynamicDrawUsage);
    geometry.setAttribute("value", values);
    geometry.setIndex(new BufferAttribute(new Uint32Array(scene.skin.triangles), 1));
    geometry.computeBoundingBox();
    geometry.computeBoundingSphere();
    const box = geometry.boundingBox;
    const bodySize = 2 * (geometry.boundingSphere?.radius ?? 0.1);
    const mesh = new Mesh(geometry, skinMaterial());
    const electrodes = new ElectrodeMarks(scene.electrodes);
    const contacts = new ContactMarks(bodySize, scene.surface);
    const presses = new PressMarks(bodySize * 0.014);
    const guide = new GuideMark(bodySize * 0.03);
    this.body = { mesh, values, electrodes, contacts, presses, guide, scene };
    this.world.add(mesh, electrodes.group, contacts.group, guide.group, presses.group);
    if (box) this.orbit.frame(box.min, box.max, ...firstLook(scene));
    this.setTheme(this.theme);
    this.setContacts([], []);
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    const { body } = this;
    if (!body) return;
    const { uniforms } = body.mesh.material;
    (uniforms["colours"]?.value as { dispose(): void } | null)?.dispose();
    const signed = body.scene.quantity === "change";
    set(uniforms, "colours", tableTexture(colourTable(theme, signed)));
    set(uniforms, "edge", theme === "light" ? -0.42 : 0.5);
    const inside = new Color().set(theme === "light" ? "#aab3bf" : "#1b2027");
    set(uniforms, "inside", inside.convertLinearToSRGB());
    for (const part of [body.electrodes, body.contacts, body.presses, body.guide]) part.setTheme(theme);
    this.setContacts(this.contacts, this.slots);
  }

  setValues(vertexValues: Float32Array, range: number): void {
    const { body } = this;
    if (!body) return;
    (body.values.array as Float32Array).set(vertexValues);
    body.values.needsUpdate = true;
    set(body.mesh.material.uniforms, "scale", 0.5 / range);
  }

  setContacts(contacts: readonly Contact[], slots: readonly number[]): void {
    this.contacts = contacts;
    this.slots = slots;
    this.tips = this.body?.contacts.update(contacts, slots) ?? [];
  }

  setHealth(health: ElectrodeHealth[]): void {
    this.health = health;
    this.body?.electrodes.update(health.map((electrode) => electrode.state));
  }

  setPresses(places: readonly Vec3[]): void {
    this.body?.presses.update(places.map((position) => ({ position, normal: this.normalNear(position) })));
  }

  /** Marks the place to press; a new one is rotated into view. */
  setGuide(position: Vec3 | null): void {
    if (!this.body) return;
    const normal = position ? this.normalNear(position) : null;
    this.body.guide.update(position && normal ? { position, normal } : null);
    if (normal && `${position}` !== this.guided) this.orbit.face(normal);
    this.guided = position ? `${position}` : "";
  }

  resize(width: number, height: number): void {
    this.size = [Math.max(width, 1), Math.max(height, 1)];
    this.camera.aspect = this.size[0] / this.size[1];
    this.camera.setViewOffset(...this.size, 0, RAISED, ...this.size);
    this.applySize();
    this.orbit.place();
  }

  render(): void {
    this.renderer.render(this.world, this.camera);
    this.labels.show(this.makeLabels());
  }

  /** Reduces the resolution on a slow machine, from the time between two frames. */
  pace(elapsedMs: number): void {
    this.paced += 1;
    this.paceMs += (elapsedMs - this.paceMs) / Math.min(this.paced, LOOKED_AT);
    if (this.paced < LOOKED_AT || this.paceMs < SLOW_MS || this.step + 1 >= STEPS.length) return;
    this.step += 1;
    this.paced = 0;
    this.applySize();
  }

  /** The point of the skin under a point of the page; null beside it. */
  pick([x, y]: Vec2): Vec3 | null {
    const { body } = this;
    if (!body) return null;
    const { left, top } = this.canvas.getBoundingClientRect();
    const [width, height] = this.size;
    const pointer = new Vector2((2 * (x - left)) / width - 1, 1 - (2 * (y - top)) / height);
    this.raycaster.setFromCamera(pointer, this.camera);
    const hit = this.raycaster.intersectObject(body.mesh, false)[0];
    if (!hit) return null;
    const place = hit.point.toArray() as Vec3;
    // Only the outside can be pressed; through an open end one sees the inside.
    return this.outwardSeen(place, this.normalNear(place)) ? place : null;
  }

  /** Where a point of space is on the page. */
  project(position: Vec3): Vec2 {
    const { left, top } = this.canvas.getBoundingClientRect();
    const [x, y] = this.onCanvas(new Vector3(...position));
    return [left + x, top + y];
  }

  /** The electrode under a point of the page. */
  electrodeAt(at: Vec2): number | null {
    const place = this.pick(at);
    if (!place || !this.body) return null;
    const point = new Vector3(...place);
    let [found, nearest] = [-1, Infinity];
    this.body.scene.electrodes.forEach((electrode, index) => {
      const distance = point.distanceTo(new Vector3(...electrode.position_m));
      if (distance < Math.max(2 * electrode.radius_m, 0.006) && distance < nearest) [found, nearest] = [index, distance];
    });
    return found < 0 ? null : found;
  }

  /** The camera's axes on the screen: right and up parts of x, y and z. */
  axes(): Vec2[] {
    const { elements: m } = this.camera.matrixWorldInverse;
    return [0, 4, 8].map((column) => [m[column] ?? 0, m[column + 1] ?? 0]);
  }

  private makeLabels(): Label[] {
    const labels: Label[] = [];
    this.body?.scene.electrodes.forEach(({ position_m, normal }, index) => {
      const state = this.health[index]?.state ?? "sound";
      const hovered = this.hovered === index;
      if (!hovered && !this.showNumbers && state === "sound") return;
      if (!this.outwardSeen(position_m, normal) && !hovered) return;
      const [x, y] = this.onCanvas(new Vector3(...position_m));
      const text = hovered ? electrodeText(index, this.health[index]) : state === "sound" ? `${index}` : `${index} ${state}`;
      labels.push({ x, y: y - 7, text, kind: `electrode ${state}${hovered ? " hovered" : ""}` });
    });
    this.contacts.forEach((contact, k) => {
      const tip = this.tips[k];
      if (!tip) return;
      const [x, tipY] = this.onCanvas(tip);
      // Over the pin, and over the ring where the pin points at the eye.
      const [footX, footY] = this.onCanvas(new Vector3(...contact.position_m));
      const ring = this.heightSeen(contact) * this.pixelsPerMetre(tip);
      const y = Math.hypot(x - footX, tipY - footY) < 1.5 * ring ? Math.min(tipY, footY - ring) : tipY;
      const behind = this.outwardSeen(contact.position_m, contact.normal) ? "" : " behind";
      const colour = contactColour(this.theme, this.slots[k] ?? SLOT_COUNT);
      labels.push({ x, y: y - 5, text: contactLabel(contact), kind: `contact${behind}`, colour });
    });
    return labels;
  }

  /** How far the outline of a contact reaches up on the screen, m. */
  private heightSeen(contact: Contact): number {
    const form = contactForm(contact);
    if (!form) return contactRadius(contact);
    const up = new Vector3(0, 1, 0).applyQuaternion(this.camera.quaternion);
    return Math.hypot(form.halfLengthM * up.dot(new Vector3(...form.along)), form.halfWidthM * up.dot(new Vector3(...form.across)));
  }

  private onCanvas(point: Vector3): Vec2 {
    const seen = point.clone().project(this.camera);
    return [0.5 * (seen.x + 1) * this.size[0], 0.5 * (1 - seen.y) * this.size[1]];
  }

  private pixelsPerMetre(at: Vector3): number {
    const tangent = Math.tan((this.camera.fov * Math.PI) / 360);
    return this.size[1] / (2 * tangent * this.camera.position.distanceTo(at));
  }

  private outwardSeen(position: Vec3, normal: Vec3): boolean {
    return this.camera.position.clone().sub(new Vector3(...position)).dot(new Vector3(...normal)) > 0;
  }

  private normalNear(position: Vec3): Vec3 {
    const { body } = this;
    if (!body) return [0, 0, 1];
    const { surface, skin } = body.scene;
    if (surface.kind === "plane") return [0, 0, 1];
    if (surface.kind === "cylinder") {
      const radius = Math.hypot(position[0], position[1]) || 1;
      return [position[0] / radius, position[1] / radius, 0];
    }
    let [found, nearest] = [0, Infinity];
    for (let k = 0; k + 2 < skin.vertices_m.length; k += 3) {
      const distance = Math.hypot(...[0, 1, 2].map((axis) => (skin.vertices_m[k + axis] ?? 0) - (position[axis] ?? 0)));
      if (distance < nearest) [found, nearest] = [k, distance];
    }
    return skin.normals.slice(found, found + 3) as Vec3;
  }

  private applySize(): void {
    this.renderer.setPixelRatio(Math.min(window.devicePixelRatio || 1, 2) * (STEPS[this.step] ?? 1));
    this.renderer.setSize(...this.size, false);
  }

  private dispose(): void {
    const { body } = this;
    if (!body) return;
    (body.mesh.material.uniforms["colours"]?.value as { dispose(): void } | null)?.dispose();
    this.world.traverse((part) => {
      if (!(part instanceof Mesh)) return;
      (part.geometry as BufferGeometry).dispose();
      (part.material as Material).dispose();
    });
    this.world.clear();
    this.body = null;
  }
}

/** Without a graphics card smooth edges cost more than half of the drawings a second. */
function drawnBySoftware(): boolean {
  const probe = document.createElement("canvas").getContext("webgl2");
  const names = probe?.getExtension("WEBGL_debug_renderer_info");
  const renderer = probe && names ? String(probe.getParameter(names.UNMASKED_RENDERER_WEBGL)) : "";
  probe?.getExtension("WEBGL_lose_context")?.loseContext();
  return /swiftshader|llvmpipe|softpipe|software|basic render/i.test(renderer);
}

function set(uniforms: ShaderMaterial["uniforms"], name: string, value: unknown): void {
  const uniform = uniforms[name];
  if (uniform) uniform.value = value;
}

/** A cylinder is first seen from its side with the seam out of sight, a flat skin from above. */
function firstLook(scene: SceneMessage): [number, number] {
  const degrees = Math.PI / 180;
  if (scene.surface.kind === "plane") return [-72 * degrees, 48 * degrees];
  return [125 * degrees, 16 * degrees];
}
