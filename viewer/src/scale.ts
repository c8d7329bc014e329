// The colour scale with its unit.

import { colourTable, TABLE_SIZE, type Theme } from "./colours";
import { significant } from "./format";
import { part, say } from "./dom";
import type { Quantity } from "./types";

const UNITS: Record<Quantity, string> = {
  change: "change of conductance, %",
  touch: "touch, N",
  density: "relative density of the position",
};

export class Scale {
  private readonly bar = part<HTMLCanvasElement>("scale-bar");
  private readonly ticks = [...document.querySelectorAll<HTMLElement>("#scale-ticks span")];
  private readonly unit = part("scale-unit");
  private quantity: Quantity = "change";

  setLook(theme: Theme, quantity: Quantity): void {
    this.quantity = quantity;
    const signed = quantity === "change";
    const table = colourTable(theme, signed);
    // Without a sign only the upper half of the table is in use.
    const first = signed ? 0 : TABLE_SIZE / 2;
    this.bar.width = TABLE_SIZE - first;
    this.bar.height = 1;
    const bytes = new Uint8ClampedArray(table.subarray(4 * first));
    this.bar.getContext("2d")?.putImageData(new ImageData(bytes, TABLE_SIZE - first, 1), 0, 0);
    say(this.unit, UNITS[quantity]);
  }

  setTop(top: number): void {
    const value = this.quantity === "change" ? 100 * top : top;
    const marks = this.quantity === "change" ? [-value, 0, value] : [0, value / 2, value];
    const texts = marks.map((mark, k) => (mark > 0 && k === 2 && this.quantity === "change" ? "+" : "") + significant(mark, 2).replace("-", "−"));
    this.ticks.forEach((tick, k) => say(tick, texts[k] ?? ""));
  }
}
