// The unrolled view: the image cell by cell, to scale, with axes in mm, electrodes and contacts.

import { colourTable, contactColour, INK, SLOT_COUNT, type Theme } from "./colours";
import { Flat } from "./flat";
import { contactForm } from "./form";
import { contactLabel, electrodeText, STATE_SYMBOL } from "./format";
import { contactRadius } from "./markers";
import { makeRaster, type Raster } from "./raster";
import { roundUp } from "./range";
import type { Contact, ElectrodeHealth, SceneMessage, Unrolled, Vec2, Vec3 } from "./types";

/** Room for the axes, CSS pixels. */
const LEFT = 46;
const BOTTOM = 38;
const TOP = 10;
const RIGHT = 14;
/** Ticks are at least this far apart, CSS pixels. */
const TICK_SPACING = 48;

/** Half axes on the canvas, and the angle from the right to the first one, clockwise. */
interface Oval {
  halfLength: number;
  halfWidth: number;
  angle: number;
}

interface Body {
  scene: SceneMessage;
  unrolled: Unrolled;
  flat: Flat;
  raster: Raster;
  texels: Uint32Array;
  picture: HTMLCanvasElement;
  bytes: ImageData;
}

export class UnrolledView {
  hovered: number | null = null;
  showNumbers = false;
  /** The cursor of the keyboard; null while the mouse is used. */
  cursor: Vec2 | null = null;
  private body: Body | null = null;
  private theme: Theme = "light";
  private table: Uint32Array = new Uint32Array();
  private contacts: readonly Contact[] = [];
  private slots: readonly number[] = [];
  private presses: readonly Vec3[] = [];
  private guide: Vec3 | null = null;
  private health: ElectrodeHealth[] = [];
  private size: Vec2 = [1, 1];
  private ratio = 1;
  private readonly ground = document.createElement("canvas");
  private groundIsOld = true;
  private readonly pen: CanvasRenderingContext2D;

  constructor(readonly canvas: HTMLCanvasElement) {
    const pen = canvas.getContext("2d");
    if (!pen) throw new Error("this browser has no 2D canvas");
    this.pen = pen;
  }

  get flat(): Flat | null {
    return this.body?.flat ?? null;
  }

  setScene(scene: SceneMessage): void {
    this.body = null;
    this.cursor = null;
    if (!scene.unrolled) return;
    const flat = new Flat(scene, scene.unrolled);
    const raster = makeRaster(scene, flat);
    const picture = document.createElement("canvas");
    picture.width = raster.width;
    picture.height = raster.height;
    const bytes = new ImageData(raster.width, raster.height);
    const texels = new Uint32Array(bytes.data.buffer);
    this.body = { scene, unrolled: scene.unrolled, flat, raster, texels, picture, bytes };
    this.setTheme(this.theme);
  }

  setTheme(theme: Theme): void {
    this.theme = theme;
    const signed = (this.body?.scene.quantity ?? "change") === "change";
    this.table = new Uint32Array(colourTable(theme, signed).buffer);
    this.groundIsOld = true;
  }

  setHealth(health: ElectrodeHealth[]): void {
    const changed = health.some((electrode, k) => electrode.state !== this.health[k]?.state);
    this.health = health;
    if (changed) this.groundIsOld = true;
  }

  setNumbers(on: boolean): void {
    this.showNumbers = on;
    this.groundIsOld = true;
  }

  setImage(image: Float32Array, vertices: Float32Array, range: number): void {
    const { body } = this;
    if (!body) return;
    body.raster.paint(body.texels, image, vertices, this.table, range);
    body.picture.getContext("2d")?.putImageData(body.bytes, 0, 0);
  }

  setContacts(contacts: readonly Contact[], slots: readonly number[]): void {
    this.contacts = contacts;
    this.slots = slots;
  }

  setPresses(places: readonly Vec3[]): void {
    this.presses = places;
  }

  /** Marks the place to press in a guided session. */
  setGuide(position: Vec3 | null): void {
    this.guide = position;
  }

  resize(width: number, height: number): void {
    this.size = [width, height];
    this.ratio = Math.min(window.devicePixelRatio || 1, 2);
    for (const canvas of [this.canvas, this.ground]) {
      canvas.width = Math.max(1, Math.round(width * this.ratio));
      canvas.height = Math.max(1, Math.round(height * this.ratio));
    }
    this.groundIsOld = true;
  }

  render(): void {
    const { pen, body } = this;
    if (!body) return;
    if (this.groundIsOld) this.drawGround(body);
    const { x, y, width, height } = this.area(body);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.canvas.width, this.canvas.height);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    pen.imageSmoothingEnabled = false;
    pen.drawImage(body.picture, x, y, width, height);
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.drawImage(this.ground, 0, 0);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    this.drawContacts(body);
    this.drawGuide(body);
    this.drawPresses(body);
    this.drawHover(body);
  }

  /** The place in the layout under a point of the page. */
  placeAt([clientX, clientY]: Vec2): Vec2 | null {
    const { body } = this;
    if (!body) return null;
    const { left, top } = this.canvas.getBoundingClientRect();
    const { x, y, height, perMetre } = this.area(body);
    const [u0, v0] = body.flat.origin;
    return [u0 + (clientX - left - x) / perMetre, v0 + (y + height - (clientY - top)) / perMetre];
  }

  /** Where a point of the body is on the page. */
  project(position: Vec3): Vec2 | null {
    const place = this.body?.flat.fromSpace(position) ?? null;
    if (!place || !this.body) return null;
    const { left, top } = this.canvas.getBoundingClientRect();
    const [x, y] = this.onCanvas(this.body, place);
    return [left + x, top + y];
  }

  electrodeAt(at: Vec2): number | null {
    const place = this.placeAt(at);
    const { body } = this;
    if (!place || !body) return null;
    const found = body.unrolled.electrodes_m.findIndex((electrode, k) => {
      const reach = Math.max(2 * (body.scene.electrodes[k]?.radius_m ?? 0), 0.006);
      return this.copies(body, electrode).some(([u, v]) => Math.hypot(u - place[0], v - place[1]) < reach);
    });
    return found < 0 ? null : found;
  }

  private area(body: Body): { x: number; y: number; width: number; height: number; perMetre: number } {
    const [across, up] = body.flat.size;
    const perMetre = Math.max(Math.min((this.size[0] - LEFT - RIGHT) / across, (this.size[1] - TOP - BOTTOM) / up), 1);
    const [width, height] = [across * perMetre, up * perMetre];
    const x = LEFT + Math.max(0, 0.5 * (this.size[0] - LEFT - RIGHT - width));
    const y = TOP + Math.max(0, 0.5 * (this.size[1] - TOP - BOTTOM - height));
    return { x, y, width, height, perMetre };
  }

  private onCanvas(body: Body, [u, v]: Vec2): Vec2 {
    const { x, y, height, perMetre } = this.area(body);
    return [x + (u - body.flat.origin[0]) * perMetre, y + height - (v - body.flat.origin[1]) * perMetre];
  }

  /** A place and its copies beyond the seam. */
  private copies(body: Body, [u, v]: Vec2): Vec2[] {
    if (!body.flat.wraps) return [[u, v]];
    const [width] = body.flat.size;
    return [[u, v], [u - width, v], [u + width, v]];
  }

  /** Axes, seam and electrodes: what stays from frame to frame. */
  private drawGround(body: Body): void {
    const pen = this.ground.getContext("2d");
    if (!pen) return;
    pen.setTransform(1, 0, 0, 1, 0, 0);
    pen.clearRect(0, 0, this.ground.width, this.ground.height);
    pen.setTransform(this.ratio, 0, 0, this.ratio, 0, 0);
    const ink = INK[this.theme];
    const { x, y, width, height } = this.area(body);
    pen.strokeStyle = ink.muted;
    pen.lineWidth = 1;
    pen.strokeRect(x - 0.5, y - 0.5, width + 1, height + 1);
    if (body.flat.wraps) {
      // Both sides are the same line on the body, so they are dashed.
      pen.strokeStyle = ink.panel;
      pen.setLineDash([5, 5]);
      pen.beginPath();
      for (const side of [x - 0.5, x + width + 0.5]) {
        pen.moveTo(side, y + 2);
        pen.lineTo(side, y + height - 2);
      }
      pen.stroke();
      pen.setLineDash([]);
    }
    this.drawAxes(pen, body);
    body.unrolled.electrodes_m.forEach((place, k) => this.drawElectrode(pen, body, place, k));
    this.groundIsOld = false;
  }

  private drawAxes(pen: CanvasRenderingContext2D, body: Body): void {
    const ink = INK[this.theme];
    const { x, y, width, height, perMetre } = this.area(body);
    const [u0, v0] = body.flat.origin;
    pen.font = "11px system-ui, sans-serif";
    pen.fillStyle = pen.strokeStyle = ink.muted;
    pen.textAlign = "center";
    pen.textBaseline = "top";
    const step = roundUp((1000 * TICK_SPACING) / perMetre, [1, 2, 5]) / 1000;
    const ticks = (from: number, length: number): number[] => {
      const first = Math.ceil(from / step - 1e-6);
      const count = Math.floor((from + length) / step + 1e-3) - first + 1;
      return Array.from({ length: Math.max(count, 0) }, (_, k) => (first + k) * step);
    };
    pen.beginPath();
    for (const u of ticks(u0, body.flat.size[0])) {
      const place = x + (u - u0) * perMetre;
      pen.moveTo(place, y + height + 1);
      pen.lineTo(place, y + height + 5);
      pen.fillText(millimetres(u), place, y + height + 7);
    }
    pen.textAlign = "right";
    pen.textBaseline = "middle";
    for (const v of ticks(v0, body.flat.size[1])) {
      const place = y + height - (v - v0) * perMetre;
      pen.moveTo(x - 5, place);
      pen.lineTo(x - 1, place);
      pen.fillText(millimetres(v), x - 8, place);
    }
    pen.stroke();
    pen.textAlign = "center";
    pen.textBaseline = "alphabetic";
    const seam = body.flat.wraps ? "  ·  wraps at the sides" : "";
    pen.fillText(body.unrolled.labels[0] + (width > 260 ? seam : ""), x + width / 2, y + height + 33);
    pen.save();
    pen.translate(x - 36, y + height / 2);
    pen.rotate(-Math.PI / 2);
    pen.fillText(body.unrolled.labels[1], 0, 0);
    pen.restore();
  }

  private drawElectrode(pen: CanvasRenderingContext2D, body: Body, place: Vec2, electrode: number): void {
    const ink = INK[this.theme];
    const state = this.health[electrode]?.state ?? "sound";
    const { x, y, width, height, perMetre } = this.area(body);
    const radius = Math.max((body.scene.electrodes[electrode]?.radius_m ?? 0.003) * perMetre, 2.5);
    for (const copy of this.copies(body, place)) {
      const [cx, cy] = this.onCanvas(body, copy);
      if (cx < x - radius || cx > x + width + radius) continue;
      if (state === "sound") {
        // On a rim an electrode is half a disc; beyond it stand the axes.
        pen.save();
        pen.beginPath();
        pen.rect(x - 3, y - 3, width + 6, height + 6);
        pen.clip();
        pen.beginPath();
        pen.arc(cx, cy, radius, 0, 2 * Math.PI);
        pen.fillStyle = ink.sound;
        pen.strokeStyle = ink.halo;
        pen.lineWidth = 1.5;
        pen.fill();
        pen.stroke();
        pen.restore();
        if (this.showNumbers) words(pen, `${electrode}`, cx, cy - radius - 3, ink.text, ink.halo, 11);
      } else {
        words(pen, STATE_SYMBOL[state], cx, cy + 6, ink[state], ink.halo, 17);
        words(pen, `${electrode} ${state}`, cx, cy - 10, ink[state], ink.halo, 11);
      }
    }
  }

  private drawContacts(body: Body): void {
    const { pen } = this;
    const ink = INK[this.theme];
    const { x, y, width, height } = this.area(body);
    this.contacts.forEach((contact, k) => {
      const place = contact.flat_m ?? body.flat.fromSpace(contact.position_m);
      if (!place) return;
      const colour = contactColour(this.theme, this.slots[k] ?? SLOT_COUNT);
      const oval = this.outline(body, contact);
      const { halfLength, halfWidth, angle } = oval;
      const aside = Math.hypot(halfLength * Math.cos(angle), halfWidth * Math.sin(angle));
      const up = Math.hypot(halfLength * Math.sin(angle), halfWidth * Math.cos(angle));
      for (const copy of this.copies(body, place)) {
        const [cx, cy] = this.onCanvas(body, copy);
        if (cx < x - aside || cx > x + width + aside) continue;
        pen.save();
        pen.beginPath();
        pen.rect(x, y, width, height);
        pen.clip();
        trace(pen, cx, cy, oval, ink.halo, 5);
        trace(pen, cx, cy, oval, colour, 3);
        pen.restore();
        if (cx < x || cx > x + width) continue;
        const below = cy - up < y + 18;
        const label = contactLabel(contact);
        pen.font = LABEL_FONT;
        const half = pen.measureText(label).width / 2 + 3;
        const at = Math.min(Math.max(cx, x + half), x + width - half);
        words(pen, label, at, below ? cy + up + 17 : cy - up - 6, ink.text, ink.halo, 13);
      }
    });
  }

  /** The form of a contact where it is known, else a circle. */
  private outline(body: Body, contact: Contact): Oval {
    const { perMetre } = this.area(body);
    const form = contactForm(contact);
    const along = form && body.flat.vectorFromSpace(contact.position_m, form.along);
    const radius = contactRadius(contact) * perMetre;
    if (!along) return { halfLength: radius, halfWidth: radius, angle: 0 };
    const angle = Math.atan2(-along[1], along[0]);
    return { halfLength: form.halfLengthM * perMetre, halfWidth: form.halfWidthM * perMetre, angle };
  }

  private drawGuide(body: Body): void {
    const { pen } = this;
    const place = this.guide && body.flat.fromSpace(this.guide);
    if (!place) return;
    const [cx, cy] = this.onCanvas(body, place);
    for (const [colour, wide, dot] of [[INK[this.theme].halo, 6, 5], [INK[this.theme].accent, 3, 3.5]] as const) {
      pen.beginPath();
      pen.arc(cx, cy, 11, 0, 2 * Math.PI);
      pen.strokeStyle = colour;
      pen.lineWidth = wide;
      pen.stroke();
      pen.beginPath();
      pen.arc(cx, cy, dot, 0, 2 * Math.PI);
      pen.fillStyle = colour;
      pen.fill();
    }
  }

  private drawPresses(body: Body): void {
    const { pen } = this;
    const places = this.presses.map((press) => body.flat.fromSpace(press));
    if (this.cursor) places.push(this.cursor);
    for (const place of places) {
      if (!place) continue;
      const [cx, cy] = this.onCanvas(body, place);
      for (const [colour, wide] of [[INK[this.theme].halo, 4], [INK[this.theme].text, 1.75]] as const) {
        pen.beginPath();
        pen.moveTo(cx - 7, cy);
        pen.lineTo(cx + 7, cy);
        pen.moveTo(cx, cy - 7);
        pen.lineTo(cx, cy + 7);
        pen.strokeStyle = colour;
        pen.lineWidth = wide;
        pen.stroke();
      }
    }
  }

  private drawHover(body: Body): void {
    const place = this.hovered === null ? undefined : body.unrolled.electrodes_m[this.hovered];
    if (!place || this.hovered === null) return;
    const { pen } = this;
    const [cx, cy] = this.onCanvas(body, place);
    const text = electrodeText(this.hovered, this.health[this.hovered]);
    pen.font = LABEL_FONT;
    const half = pen.measureText(text).width / 2 + 4;
    const at = Math.min(Math.max(cx, half), this.size[0] - half);
    words(pen, text, at, cy < 34 ? cy + 24 : cy - 12, INK[this.theme].text, INK[this.theme].halo, 13);
  }
}

const LABEL_FONT = "600 13px system-ui, sans-serif";

function millimetres(metres: number): string {
  return `${Math.round(metres * 1e5) / 100}`;
}

function trace(pen: CanvasRenderingContext2D, x: number, y: number, oval: Oval, colour: string, wide: number): void {
  pen.beginPath();
  pen.ellipse(x, y, oval.halfLength, oval.halfWidth, oval.angle, 0, 2 * Math.PI);
  pen.strokeStyle = colour;
  pen.lineWidth = wide;
  pen.stroke();
}

/** Text with an outline in the background colour, readable on any image. */
function words(pen: CanvasRenderingContext2D, text: string, x: number, y: number, ink: string, halo: string, size: number): void {
  pen.font = `600 ${size}px system-ui, sans-serif`;
  pen.textAlign = "center";
  pen.textBaseline = "alphabetic";
  pen.lineJoin = "round";
  pen.lineWidth = 3.5;
  pen.strokeStyle = halo;
  pen.strokeText(text, x, y);
  pen.fillStyle = ink;
  pen.fillText(text, x, y);
}
