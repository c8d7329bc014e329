// Strip charts of the last half minute.

import uPlot from "uplot";

import { contactColour, INK, SLOT_COUNT, type Theme } from "./colours";
import { fixed, significant, strengthMm2 } from "./format";
import { type Box, freeBox } from "./labels";
import type { Contact, StatusMessage } from "./types";

const SPAN_S = 30;
/** Width of a bin of the contact chart, which keeps its largest value: a short touch stays visible. */
const BIN_S = 0.05;
const BINS = SPAN_S / BIN_S;
const HEIGHT = 96;

type Series = (number | null)[];

interface Look {
  label: string;
  colour: string;
  dash?: number[];
}

/** One strip: its title with the newest values, and the lines. */
class Strip {
  private plot: uPlot | null = null;
  private readonly value: HTMLElement;
  private readonly holder: HTMLElement;

  constructor(
    private readonly panel: HTMLElement,
    private readonly floor: number,
  ) {
    this.value = panel.querySelector(".value") as HTMLElement;
    this.holder = panel.querySelector(".plot") as HTMLElement;
  }

  restyle(theme: Theme, looks: Look[], names: () => string[]): void {
    this.plot?.destroy();
    const ink = INK[theme];
    const axis: uPlot.Axis = {
      stroke: ink.muted,
      font: "11px system-ui, sans-serif",
      grid: { stroke: ink.line, width: 1 },
      ticks: { show: false },
    };
    this.plot = new uPlot(
      {
        width: Math.max(this.holder.clientWidth, 80),
        height: HEIGHT,
        padding: [8, 14, 0, 0],
        cursor: { show: false },
        legend: { show: false },
        scales: {
          x: { time: false, range: [-SPAN_S, 0] },
          y: { range: (_plot, _low, high) => [0, Math.max(this.floor, 1.12 * (high ?? 0))] },
        },
        axes: [
          { ...axis, size: 22, gap: 2, values: (_plot, marks) => marks.map((mark) => (mark === 0 ? "now" : `−${-mark} s`)), splits: [-20, -10, 0] },
          { ...axis, size: 40, gap: 4, space: 26, values: (_plot, marks) => marks.map((mark) => significant(mark, 2)) },
        ],
        series: [
          {},
          ...looks.map((look) => ({
            label: look.label,
            stroke: look.colour,
            width: 1.75,
            points: { show: false },
            ...(look.dash ? { dash: look.dash } : {}),
          })),
        ],
        hooks: { draw: [(plot) => nameLines(plot, looks, names(), ink.panel)] },
      },
      [[], ...looks.map(() => [])] as uPlot.AlignedData,
      this.holder,
    );
  }

  resize(): void {
    this.plot?.setSize({ width: Math.max(this.holder.clientWidth, 80), height: HEIGHT });
  }

  draw(times: number[], series: Series[]): void {
    this.plot?.setData([times, ...series] as uPlot.AlignedData);
  }

  say(text: string): void {
    if (this.value.textContent !== text) this.value.textContent = text;
  }

  setTitle(text: string): void {
    const title = this.panel.querySelector(".title");
    if (title && title.textContent !== text) title.textContent = text;
  }
}

/** Draws the name of each line over its newest point, or near it where names would overlap. */
function nameLines(plot: uPlot, looks: Look[], names: string[], ground: string): void {
  const { ctx: pen, data } = plot;
  const scale = devicePixelRatio || 1;
  pen.save();
  pen.font = `600 ${11 * scale}px system-ui, sans-serif`;
  pen.textAlign = "right";
  pen.lineJoin = "round";
  pen.lineWidth = 4 * scale;
  pen.strokeStyle = ground;
  const { top, height } = plot.bbox;
  const placed: Box[] = [];
  looks.forEach((look, k) => {
    const line = data[k + 1];
    const name = names[k];
    if (!line || !name) return;
    let last = line.length - 1;
    while (last >= 0 && line[last] === null) last -= 1;
    const value = line[last];
    const time = data[0][last];
    if (value === null || value === undefined || time === undefined) return;
    const right = Math.max(plot.valToPos(time, "x", true) - 2 * scale, 90 * scale);
    const bottom = Math.max(plot.valToPos(value, "y", true) - 3 * scale, 14 * scale);
    const wanted = { right, bottom, width: pen.measureText(name).width + 4 * scale, height: 13 * scale };
    const box = freeBox(wanted, placed, top + height);
    placed.push(box);
    pen.strokeText(name, box.right, box.bottom - 2 * scale);
    pen.fillStyle = look.colour;
    pen.fillText(name, box.right, box.bottom - 2 * scale);
  });
  pen.restore();
}

interface Reading {
  at: number;
  rate: number | null;
  drawn: number | null;
  median: number | null;
  p99: number | null;
  noise: number | null;
}

export class Charts {
  private readonly contacts: Strip;
  private readonly rate: Strip;
  private readonly latency: Strip;
  private readonly noise: Strip;
  private readonly times: number[] = Array.from({ length: BINS }, (_, k) => (k + 1 - BINS) * BIN_S);
  private readonly lines: Series[] = Array.from({ length: SLOT_COUNT }, () => new Array<number | null>(BINS).fill(null));
  private readonly names: string[] = new Array<string>(SLOT_COUNT).fill("");
  private readings: Reading[] = [];
  private bin = 0;
  /** The last bin of each contact, by its id. */
  private lastBin = new Map<number, number>();
  private force = false;

  constructor(section: HTMLElement) {
    const strip = (name: string, floor: number): Strip => new Strip(section.querySelector(`[data-chart="${name}"]`) as HTMLElement, floor);
    this.contacts = strip("contacts", 1);
    this.rate = strip("rate", 10);
    this.latency = strip("latency", 0.5);
    this.noise = strip("noise", 2);
  }

  restyle(theme: Theme): void {
    const { accent, muted } = INK[theme];
    const looks = this.lines.map((_, slot) => ({ label: `contact ${slot}`, colour: contactColour(theme, slot) }));
    this.contacts.restyle(theme, looks, () => this.names);
    this.rate.restyle(theme, [{ label: "in", colour: accent }, { label: "drawn", colour: muted, dash: [5, 4] }], () => ["received", "drawn"]);
    this.latency.restyle(theme, [{ label: "p99", colour: muted, dash: [5, 4] }, { label: "median", colour: accent }], () => ["p99", "median"]);
    this.noise.restyle(theme, [{ label: "noise", colour: accent }], () => []);
  }

  resize(): void {
    for (const strip of [this.contacts, this.rate, this.latency, this.noise]) strip.resize();
  }

  /** Removes the contacts of another scene; rate and latency stay. */
  clear(): void {
    for (const line of this.lines) line.fill(null);
    this.names.fill("");
    this.lastBin.clear();
    this.force = false;
    this.contacts.setTitle("Contact strength (mm²)");
  }

  /** Adds the contacts of a frame. */
  addContacts(contacts: readonly Contact[], slots: readonly number[], nowS: number): void {
    this.shift(nowS);
    contacts.forEach((contact, k) => {
      const slot = slots[k] ?? SLOT_COUNT;
      const line = this.lines[slot];
      if (!line) return;
      this.measure(contact);
      const value = this.force ? contact.force_n : contact.strength === null ? null : strengthMm2(contact.strength);
      if (value === null) return;
      line[BINS - 1] = Math.max(line[BINS - 1] ?? -Infinity, value);
      // Between two drawings farther apart than a bin the line goes on.
      const skipped = this.bin - (this.lastBin.get(contact.id) ?? this.bin);
      for (let k = 1; k < Math.min(skipped, BINS); k += 1) line[BINS - 1 - k] ??= value;
      this.names[slot] = `#${contact.id}`;
    });
    this.lastBin = new Map(contacts.map((contact) => [contact.id, this.bin]));
  }

  addStatus(status: StatusMessage, drawnHz: number | null, nowS: number): void {
    const { rate_hz: rate, latency_ms: latency, noise } = status;
    this.readings.push({ at: nowS, rate, drawn: drawnHz, median: latency?.median ?? null, p99: latency?.p99 ?? null, noise });
    while (this.readings.length && (this.readings[0] as Reading).at < nowS - SPAN_S - 1) this.readings.shift();
    this.rate.say(`${fixed(rate, 0)} /s in, ${fixed(drawnHz, 0)} /s drawn`);
    this.latency.say(`median ${significant(latency?.median, 2)}, p99 ${significant(latency?.p99, 2)} ms`);
    this.noise.say(`${fixed(noise, 2)} × the noise at the tare`);
  }

  draw(nowS: number): void {
    this.shift(nowS);
    this.contacts.draw(this.times, this.lines);
    const newest = this.lines.flatMap((line, slot) => (line[BINS - 1] ?? line[BINS - 2] ?? null) === null ? [] : [this.names[slot]]);
    this.contacts.say(newest.length ? newest.join(" ") : "none");
    const times = this.readings.map((reading) => reading.at - nowS);
    const pick = (name: keyof Reading): Series => this.readings.map((reading) => reading[name]);
    this.rate.draw(times, [pick("rate"), pick("drawn")]);
    this.latency.draw(times, [pick("p99"), pick("median")]);
    this.noise.draw(times, [pick("noise")]);
  }

  /** Force as soon as one is known, strength until then; never both on one axis. */
  private measure(contact: Contact): void {
    if (this.force || contact.force_n === null) return;
    this.force = true;
    for (const line of this.lines) line.fill(null);
    this.contacts.setTitle("Contact force (N)");
  }

  /** Moves the bins on to now. */
  private shift(nowS: number): void {
    const bin = Math.floor(nowS / BIN_S);
    const steps = Math.min(bin - this.bin, BINS);
    this.bin = bin;
    if (steps <= 0) return;
    this.lines.forEach((line, slot) => {
      line.splice(0, steps);
      for (let k = 0; k < steps; k += 1) line.push(null);
      if (line.every((value) => value === null)) this.names[slot] = "";
    });
  }
}
