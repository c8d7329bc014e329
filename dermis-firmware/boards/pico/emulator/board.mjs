// The board around the chip: multiplexers, amplifier and converter as the pins operate them. Readings come from a file that
// `dermis check-device --readings` writes; the settling time of each slot from the skin's table.

import { readFileSync } from 'node:fs';

const ADDRESS_MASK = (1 << 22) - 1;
const OPEN = 1 << 22;
const CONVERT = 1 << 26;
const CLOCK = 1 << 27;
/** Input of the amplifier's multiplexers that is on the reference resistor. */
const ON_REFERENCE = 31;
/** The shortest break before make, ns: ADG732, t_OFF at 5 V, greatest value. */
const BREAK_NS = 30;
/** The longest conversion, ns: MCP33131D-10, t_CNV, greatest value. */
const CONVERSION_NS = 710;

/** The pins of a slot: source, sink, plus, minus, five bits each, and the gain above them. */
function pinsOf([source, sink, plus, minus]) {
  const onReference = plus === 0xffff && minus === 0xffff;
  const inputs = onReference ? [ON_REFERENCE, ON_REFERENCE] : [plus, minus];
  const isFree = !onReference && !inputs.includes(source) && !inputs.includes(sink);
  return source | (sink << 5) | (inputs[0] << 10) | (inputs[1] << 15) | (isFree ? 1 << 20 : 0);
}

/**
 * Readings by slot of a file of `dermis check-device --readings`, little-endian: u32 0x31445244 ("DRD1"), u16 slots, u16 frames;
 * for each slot u16 source, sink, plus, minus (0xFFFF twice for the reference resistor); for each frame an i16 per slot.
 */
export function readReadings(path) {
  const bytes = readFileSync(path);
  const view = new DataView(bytes.buffer, bytes.byteOffset, bytes.byteLength);
  if (bytes.subarray(0, 4).toString() !== 'DRD1') throw new Error(`${path} is no file of readings (dermis check-device --readings writes them)`);
  const [slotCount, frameCount] = [view.getUint16(4, true), view.getUint16(6, true)];
  const slots = Array.from({ length: slotCount }, (_, slot) => [0, 2, 4, 6].map((at) => view.getUint16(8 + 8 * slot + at, true)));
  const values = 8 + 8 * slotCount;
  const frames = Array.from({ length: frameCount }, (_, frame) =>
    Int16Array.from({ length: slotCount }, (_, slot) => view.getInt16(values + 2 * (frame * slotCount + slot), true)),
  );
  return { slots, frames };
}

/** Settling times by pins, ns, from the skin's table in Rust. */
export function readSettling(path) {
  const waits = new Map();
  for (const [, source, sink, inputs, wait] of readFileSync(path, 'utf8').matchAll(/t\((\d+), (\d+), (None|Some\(\[\d+, \d+\]\)), (\d+)\)/g)) {
    const [plus, minus] = inputs === 'None' ? [0xffff, 0xffff] : inputs.match(/\d+/g).map(Number);
    waits.set(pinsOf([Number(source), Number(sink), plus, minus]), Number(wait));
  }
  if (waits.size === 0) throw new Error(`${path} has no slots`);
  return waits;
}

/** Multiplexers and converter. Times are cycles of the chip. */
export class FrontEnd {
  constructor(readings, waits, cycleNs) {
    this.cycleNs = cycleNs;
    this.waits = waits;
    this.frames = readings.frames;
    this.index = new Map(readings.slots.map((slot, index) => [pinsOf(slot), index]));
    this.pins = OPEN;
    this.shift = 0;
    this.frame = -1;
    this.closedAt = this.openedAt = this.convertedAt = 0;
    this.faults = new Map();
    this.conversions = 0;
    /** Shortest and longest time from one conversion to that of each slot, once the first frame is over; cycles. */
    this.intervals = new Map();
    this.leastSpareNs = Infinity;
    this.leastSettlingNs = Infinity;
    this.previous = null;
  }

  /** The converter's data pin. */
  get data() {
    return (this.shift >>> 15) & 1;
  }

  fault(what) {
    this.faults.set(what, (this.faults.get(what) ?? 0) + 1);
  }

  /** The chip has set its pins at a time. */
  update(pins, at) {
    const changed = pins ^ this.pins;
    if (changed === 0) return;
    const before = this.pins;
    this.pins = pins;
    const switched = changed & (ADDRESS_MASK | OPEN);
    if (switched && before & CONVERT) this.fault('switched during a conversion');
    if (switched && (at - this.convertedAt) * this.cycleNs < CONVERSION_NS) this.fault('switched before the converter was ready');
    if (changed & ADDRESS_MASK && !(before & OPEN)) this.fault('an address changed while the switches were closed');
    if (changed & OPEN) this.openOrClose(pins, at);
    if (changed & CONVERT) pins & CONVERT ? this.convert(at) : this.finish(at);
    if (changed & CLOCK && !(pins & CLOCK)) this.shift = (this.shift << 1) & 0xffff;
  }

  openOrClose(pins, at) {
    if (pins & OPEN) {
      this.openedAt = at;
    } else {
      if ((at - this.openedAt) * this.cycleNs < BREAK_NS) this.fault('made before break');
      this.closedAt = at;
    }
  }

  convert(at) {
    const address = this.pins & ADDRESS_MASK;
    const slot = this.index.get(address);
    this.conversions += 1;
    if (this.pins & OPEN) this.fault('converted with open switches');
    if (slot === undefined) this.fault('converted a slot that the readings do not have');
    if (slot === 0) this.frame = (this.frame + 1) % this.frames.length;
    const settledNs = (at - this.closedAt) * this.cycleNs;
    const neededNs = this.waits.get(address);
    if (neededNs === undefined) this.fault('converted a slot without a settling time');
    else if (settledNs < neededNs) this.fault('settled too briefly');
    else this.leastSpareNs = Math.min(this.leastSpareNs, settledNs - neededNs);
    this.leastSettlingNs = Math.min(this.leastSettlingNs, settledNs);
    this.time(slot, at);
    this.convertedAt = at;
    this.shift = slot === undefined ? 0 : this.frames[Math.max(this.frame, 0)][slot] & 0xffff;
  }

  /** Interval since the conversion before, by slot; intervals across a stop are left out. */
  time(slot, at) {
    const interval = at - this.convertedAt;
    if (this.previous !== null && interval * this.cycleNs < 1e6) {
      const [least, most] = this.intervals.get(slot) ?? [interval, interval];
      this.intervals.set(slot, [Math.min(least, interval), Math.max(most, interval)]);
    }
    this.previous = slot;
  }

  finish(at) {
    if ((at - this.convertedAt) * this.cycleNs < CONVERSION_NS) this.fault('read before the conversion was over');
  }

  report() {
    const intervals = [...this.intervals.values()];
    const us = (cycles) => (cycles * this.cycleNs) / 1e3;
    return {
      conversions: this.conversions,
      slots: intervals.length,
      shortest_slot_us: us(Math.min(...intervals.map(([least]) => least))),
      longest_slot_us: us(Math.max(...intervals.map(([, most]) => most))),
      largest_jitter_cycles: Math.max(...intervals.map(([least, most]) => most - least)),
      least_settling_us: this.leastSettlingNs / 1e3,
      least_spare_settling_us: this.leastSpareNs / 1e3,
      faults: Object.fromEntries(this.faults),
    };
  }
}
