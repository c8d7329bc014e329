// The whole page: each new frame is drawn in every view.

import "./style.css";

import { Charts } from "./charts";
import { currentTheme } from "./colours";
import { Connection, liveAddress } from "./connection";
import { ContactList } from "./contacts";
import { Controls } from "./controls";
import { decode } from "./decode";
import { ElectrodeGrid } from "./electrodes";
import { onSkin, onUnrolled } from "./input";
import { GuidePanel } from "./guide";
import { Header } from "./header";
import { Banner, Notes } from "./messages";
import { expose } from "./inspection";
import { part, show } from "./dom";
import { Presser } from "./press";
import { AutoRange } from "./range";
import { Scale } from "./scale";
import { SkinView } from "./scene3d";
import { largest, VertexValues } from "./skin";
import { Slots } from "./colour_slots";
import type { Contact, FrameHeader, SceneMessage, StatusMessage, Validity } from "./types";
import { UnrolledView } from "./unrolled";

const CHARTS_EVERY_MS = 100;
const LIST_EVERY_MS = 120;

class Viewer {
  drawn = 0;
  frame: FrameHeader | null = null;
  status: StatusMessage | null = null;
  scene: SceneMessage | null = null;
  readonly connection = new Connection(liveAddress(location), this);
  readonly skin = makeSkinView();
  readonly unrolled = new UnrolledView(part<HTMLCanvasElement>("unrolled"));
  private readonly header = new Header();
  private readonly controls = new Controls((command) => this.connection.send(command));
  private readonly guide = new GuidePanel((command) => this.connection.send(command));
  private readonly presser = new Presser((command) => this.connection.send(command), () => this.controls.forceN);
  private readonly grid = new ElectrodeGrid((electrode) => this.point(electrode));
  private readonly list = new ContactList();
  private readonly notes = new Notes();
  private readonly banner = new Banner(() => this.connection.open());
  private readonly scale = new Scale();
  private readonly charts = new Charts(part("charts"));
  private readonly slots = new Slots();
  private vertices: VertexValues | null = null;
  private image: Float32Array | null = null;
  private validity: Validity = { state: "ok", text: "ok" };
  private range = new AutoRange("change");
  private theme = currentTheme();
  private contactSlots: number[] = [];
  private redraw = true;
  private frameAt = 0;
  private drawingAt = 0;
  private chartsAt = 0;
  private listAt = 0;
  private drawnBefore = { count: 0, at: 0 };

  start(): void {
    const input = { emulated: () => this.scene?.emulated ?? false, changed: () => this.inputChanged() };
    if (this.skin) onSkin(this.skin, this.presser, input);
    onUnrolled(this.unrolled, this.presser, input);
    this.wireButtons();
    this.watchWindow();
    this.retheme();
    this.controls.enable(false);
    this.connection.open();
    requestAnimationFrame((now) => this.draw(now));
  }

  // Events of the connection.

  connected(): void {
    this.banner.hide();
    document.body.classList.remove("stale");
    this.controls.enable(true);
    this.presser.repeat();
    this.setLink();
  }

  disconnected(waitMs: number): void {
    if (this.guide.ended) this.banner.ended();
    else this.banner.waiting(waitMs);
    document.body.classList.add("stale");
    this.controls.enable(false);
    this.guide.enable(false);
    this.slots.clear();
    this.header.setTouched(null);
    this.setLink();
  }

  setScene(scene: SceneMessage): void {
    this.scene = scene;
    this.vertices = new VertexValues(scene.skin);
    this.image = null;
    this.range = new AutoRange(scene.quantity);
    this.skin?.setScene(scene);
    this.unrolled.setScene(scene);
    this.header.setScene(scene);
    this.controls.setScene(scene);
    this.guide.setScene(scene);
    this.grid.setCount(scene.electrodes.length);
    this.scale.setLook(this.theme, scene.quantity);
    this.scale.setTop(this.range.top);
    this.charts.clear();
    this.slots.clear();
    this.setContacts([]);
    document.body.classList.toggle("emulated", scene.emulated);
    document.body.classList.toggle("no-layout", scene.unrolled === null);
    this.resize();
  }

  setStatus(status: StatusMessage): void {
    this.status = status;
    this.header.setStatus(status);
    this.controls.setStatus(status);
    this.setGuide(status);
    this.grid.update(status.electrodes);
    this.skin?.setHealth(status.electrodes);
    this.unrolled.setHealth(status.electrodes);
    this.notes.setMessages(status.messages);
    this.setLink();
    this.showBanner();
    const now = performance.now();
    if (!status.paused) this.charts.addStatus(status, this.drawnRate(now), now / 1000);
    this.redraw = true;
  }

  /** What the contacts are worth: a banner, and a grey image while they are unknown. */
  private showBanner(): void {
    const validity = this.validity;
    document.body.dataset["validity"] = validity.state;
    if (this.status?.connected === false) this.banner.deviceGone();
    else if (this.status?.paused) this.banner.paused();
    else if (validity.state !== "ok") this.banner.validity(validity);
    else this.banner.hide();
  }

  private setGuide({ guide }: StatusMessage): void {
    const resized = document.body.classList.contains("guided") !== Boolean(guide);
    this.guide.setStatus(guide ?? null);
    this.skin?.setGuide(guide?.position_m ?? null);
    this.unrolled.setGuide(guide?.position_m ?? null);
    if (resized) this.resize();
  }

  refused({ why }: { why: string }): void {
    this.notes.refuse(why);
  }

  // Drawing.

  private draw(now: number): void {
    requestAnimationFrame((next) => this.draw(next));
    this.presser.flush();
    const message = this.connection.take();
    if (message && this.scene) this.showFrame(message, now);
    if (this.redraw) {
      this.redraw = false;
      this.skin?.setPresses(this.presser.places);
      this.unrolled.setPresses(this.presser.places);
      this.skin?.render();
      this.unrolled.render();
      if (message) this.drawn += 1;
      if (message && now - this.drawingAt < 500) this.skin?.pace(now - this.drawingAt);
      this.drawingAt = now;
      this.drawAxes();
    }
    this.drawSlowParts(now);
  }

  private showFrame(message: ArrayBuffer, now: number): void {
    const { header, values } = decode(message, this.scene?.image.pixel_count ?? 0);
    const elapsedS = Math.min((now - this.frameAt) / 1000, 0.5);
    this.frameAt = now;
    this.frame = header;
    this.image = values;
    this.vertices?.update(values);
    this.range.update(largest(values), header.touched === true, elapsedS);
    this.scale.setTop(this.range.top);
    this.showImage();
    this.setContacts(header.contacts);
    this.header.setTouched(header.touched);
    this.showValidity(header.validity);
    this.charts.addContacts(header.contacts, this.contactSlots, now / 1000);
    this.redraw = true;
  }

  private showValidity({ state, text }: Validity): void {
    if (state === this.validity.state && text === this.validity.text) return;
    this.validity = { state, text };
    this.showBanner();
  }

  private isKnown(): boolean {
    return this.validity.state === "ok" || this.validity.state === "degraded";
  }

  private showImage(): void {
    if (!this.image || !this.vertices) return;
    this.skin?.setValues(this.vertices.values, this.range.value);
    this.unrolled.setImage(this.image, this.vertices.values, this.range.value);
  }

  private setContacts(contacts: Contact[]): void {
    this.contactSlots = this.slots.assign(contacts);
    this.skin?.setContacts(contacts, this.contactSlots);
    this.unrolled.setContacts(contacts, this.contactSlots);
  }

  /** Text and charts are updated ten times a second at most. */
  private drawSlowParts(now: number): void {
    const still = this.status?.paused === true || !this.connection.connected;
    if (now - this.chartsAt >= CHARTS_EVERY_MS && !still) {
      this.chartsAt = now;
      this.charts.draw(now / 1000);
    }
    if (now - this.listAt >= LIST_EVERY_MS) {
      this.listAt = now;
      this.list.update(this.frame?.contacts ?? [], this.contactSlots, this.theme, this.isKnown());
    }
  }

  private drawAxes(): void {
    this.skin?.axes().forEach(([x, y], axis) => {
      const line = axisLines[axis];
      const name = axisNames[axis];
      line?.setAttribute("x2", (22 * x).toFixed(1));
      line?.setAttribute("y2", (-22 * y).toFixed(1));
      name?.setAttribute("x", (30 * x).toFixed(1));
      name?.setAttribute("y", (-30 * y).toFixed(1));
    });
  }

  private drawnRate(now: number): number | null {
    const { count, at } = this.drawnBefore;
    this.drawnBefore = { count: this.drawn, at: now };
    return at > 0 && now > at ? (1000 * (this.drawn - count)) / (now - at) : null;
  }

  // The window and its buttons.

  private inputChanged(): void {
    this.redraw = true;
  }

  private point(electrode: number | null): void {
    if (this.skin) this.skin.hovered = electrode;
    this.unrolled.hovered = electrode;
    this.redraw = true;
  }

  private setLink(): void {
    this.header.setLink(this.connection.connected, this.status?.paused ?? false, this.status?.connected ?? true);
  }

  private wireButtons(): void {
    part("reset-view").addEventListener("click", () => {
      this.skin?.orbit.reset();
      this.redraw = true;
    });
    part("numbers").addEventListener("click", (event) => {
      const button = event.currentTarget as HTMLElement;
      const on = button.getAttribute("aria-pressed") !== "true";
      button.setAttribute("aria-pressed", `${on}`);
      if (this.skin) this.skin.showNumbers = on;
      this.unrolled.setNumbers(on);
      this.redraw = true;
    });
  }

  private watchWindow(): void {
    const observer = new ResizeObserver(() => this.resize());
    for (const id of ["skin-stage", "unrolled-stage", "charts"]) observer.observe(part(id));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => this.retheme());
    // All presses end when the window loses the focus.
    window.addEventListener("blur", () => this.presser.upAll());
    window.addEventListener("pagehide", () => this.presser.releaseAll());
    window.addEventListener("keydown", (event) => {
      if (event.key === "Escape") this.presser.releaseAll();
    });
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) this.presser.upAll();
    });
  }

  private resize(): void {
    const stage = part("skin-stage");
    this.skin?.resize(stage.clientWidth, stage.clientHeight);
    const flat = part("unrolled-stage");
    this.unrolled.resize(flat.clientWidth, flat.clientHeight);
    this.charts.resize();
    this.redraw = true;
  }

  private retheme(): void {
    this.theme = currentTheme();
    this.skin?.setTheme(this.theme);
    this.unrolled.setTheme(this.theme);
    this.charts.restyle(this.theme);
    this.scale.setLook(this.theme, this.scene?.quantity ?? "change");
    this.showImage();
    this.redraw = true;
  }
}

const axisLines = [...document.querySelectorAll<SVGLineElement>("#axes line")];
const axisNames = [...document.querySelectorAll<SVGTextElement>("#axes text")];

/** Null without WebGL, with a note on the page; the rest of the page works. */
function makeSkinView(): SkinView | null {
  try {
    return new SkinView(part<HTMLCanvasElement>("skin"), part("skin-labels"));
  } catch {
    show(part("no-webgl"), true);
    return null;
  }
}

const viewer = new Viewer();
expose({
  get drawn() {
    return viewer.drawn;
  },
  get frame() {
    return viewer.frame;
  },
  get status() {
    return viewer.status;
  },
  get scene() {
    return viewer.scene;
  },
  get connected() {
    return viewer.connection.connected;
  },
  project: (position) => viewer.skin?.project(position) ?? null,
  projectFlat: (position) => viewer.unrolled.project(position),
  unproject: (pixel) => viewer.skin?.pick(pixel) ?? null,
  unprojectFlat: (pixel) => {
    const place = viewer.unrolled.placeAt(pixel);
    return place ? (viewer.unrolled.flat?.toSpace(place) ?? null) : null;
  },
});
viewer.start();
