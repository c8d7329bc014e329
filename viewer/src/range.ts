// The range of the colours: up at once, down slowly, and never so narrow that noise fills it.

import type { Quantity } from "./types";

/** Nothing smaller is worth full colour: half a newton, 0.1 % of the conductance, the largest density. */
const SMALLEST: Record<Quantity, number> = { touch: 0.5, change: 0.001, density: 1 };
/** The strongest pixel of an untouched skin gets at most this share of the range; */
const QUIET_SHARE = 0.1;
/** or, where touches hardly rise above it, this. */
const LOUD_SHARE = 0.3;
const RISE_S = 0.06;
const DECAY_S = 6;
/** The quiet level follows down quickly and up slowly: what fades after a touch is not noise. */
const QUIET_DOWN_S = 0.3;
const QUIET_UP_S = 3;
const EASE_S = 0.15;
/** How long touches are averaged over to know what they usually reach. */
const TYPICAL_S = 3;
/** A rounder, smaller range is taken only when the peak is well inside it. */
const HYSTERESIS = 0.8;

export class AutoRange {
  private peak = 0;
  private quiet: number | null = null;
  private typical: number | null = null;
  private goal: number;
  private eased: number;

  constructor(private readonly quantity: Quantity) {
    this.goal = this.eased = roundUp(SMALLEST[quantity]);
  }

  /** The range to draw with. */
  get value(): number {
    return this.eased;
  }

  /** The round number the range settles at. */
  get top(): number {
    return this.goal;
  }

  update(largest: number, touched: boolean, elapsedS: number): void {
    this.peak += (largest - this.peak) * share(elapsedS, largest > this.peak ? RISE_S : DECAY_S);
    if (touched) this.typical = largest + ((this.typical ?? largest) - largest) * (1 - share(elapsedS, TYPICAL_S));
    else this.followQuiet(largest, elapsedS);
    const wanted = Math.max(this.floor(), this.peak);
    if (wanted > this.goal || roundUp(wanted / HYSTERESIS) < this.goal) this.goal = roundUp(wanted);
    this.eased += (this.goal - this.eased) * share(elapsedS, EASE_S);
  }

  private floor(): number {
    const quiet = this.quiet ?? 0;
    const calm = Math.min(quiet / QUIET_SHARE, this.typical ?? Infinity);
    return Math.max(SMALLEST[this.quantity], quiet / LOUD_SHARE, calm);
  }

  private followQuiet(largest: number, elapsedS: number): void {
    if (this.quiet === null) this.quiet = largest;
    else this.quiet += (largest - this.quiet) * share(elapsedS, largest > this.quiet ? QUIET_UP_S : QUIET_DOWN_S);
  }
}

function share(elapsedS: number, timeConstantS: number): number {
  return 1 - Math.exp(-elapsedS / timeConstantS);
}

/** The next of some steps, by default 1, 1.5, 2, 3, 5, 7, times a power of ten. */
export function roundUp(value: number, steps: readonly number[] = [1, 1.5, 2, 3, 5, 7]): number {
  if (!(value > 0) || !Number.isFinite(value)) return 1;
  const power = 10 ** Math.floor(Math.log10(value) + 1e-9);
  const step = steps.find((candidate) => candidate * power >= value * (1 - 1e-9)) ?? 10;
  return step * power;
}
