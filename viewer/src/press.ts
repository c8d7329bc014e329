// Presses on an emulated skin: pointers become `press` and `release` commands, at most one `press` per touch and frame.

import type { Command, Vec3 } from "./types";

/** A kept press is released by another one within a fingertip of it, m. */
const FINGERTIP_M = 0.01;

interface Press {
  position: Vec3;
  force: number;
  changed: boolean;
}

export class Presser {
  private readonly presses = new Map<number, Press>();
  private readonly numberOf = new Map<string, number>();

  constructor(
    private readonly send: (command: Command) => boolean,
    private readonly force: () => number,
  ) {}

  get places(): Vec3[] {
    return [...this.presses.values()].map((press) => press.position);
  }

  get count(): number {
    return this.presses.size;
  }

  /** `who` identifies the pointer or key. */
  down(who: string, position: Vec3): void {
    if (this.numberOf.has(who)) return this.move(who, position);
    let number = 0;
    while (this.presses.has(number)) number += 1;
    this.numberOf.set(who, number);
    this.presses.set(number, { position, force: this.force(), changed: true });
    this.flush();
  }

  move(who: string, position: Vec3): void {
    const press = this.presses.get(this.numberOf.get(who) ?? -1);
    if (!press) return;
    press.position = position;
    press.changed = true;
  }

  up(who: string): void {
    const number = this.numberOf.get(who);
    if (number === undefined) return;
    this.flush();
    this.numberOf.delete(who);
    this.release(number);
  }

  /** Keeps a press when its pointer leaves. */
  keep(who: string): void {
    this.flush();
    this.numberOf.delete(who);
  }

  /** Releases the kept press at a place; whether there was one. */
  releaseAt([x, y, z]: Vec3): boolean {
    const held = new Set(this.numberOf.values());
    for (const [number, { position: [px, py, pz] }] of this.presses) {
      if (held.has(number) || Math.hypot(px - x, py - y, pz - z) > FINGERTIP_M) continue;
      this.release(number);
      return true;
    }
    return false;
  }

  /** Ends all presses, kept ones too. */
  releaseAll(): void {
    this.upAll();
    for (const number of [...this.presses.keys()]) this.release(number);
  }

  private release(number: number): void {
    this.presses.delete(number);
    this.send({ do: "release", finger: number });
  }

  holds(who: string): boolean {
    return this.numberOf.has(who);
  }

  upAll(): void {
    for (const who of [...this.numberOf.keys()]) this.up(who);
  }

  /** Sends all presses again, after a reconnection. */
  repeat(): void {
    for (const press of this.presses.values()) press.changed = true;
  }

  /** Sends the changes since the last call. */
  flush(): void {
    for (const [number, press] of this.presses) {
      const force = this.force();
      if (!press.changed && force === press.force) continue;
      press.force = force;
      press.changed = !this.send({ do: "press", finger: number, position_m: press.position, force_n: force });
    }
  }
}
