// Fingers on an emulated skin: what the pointers do becomes `press` and `release`, at most one press a finger and drawing.

import type { Command, Vec3 } from "./types";

interface Finger {
  position: Vec3;
  force: number;
  changed: boolean;
}

export class Presser {
  private readonly fingers = new Map<number, Finger>();
  private readonly numberOf = new Map<string, number>();

  constructor(
    private readonly send: (command: Command) => boolean,
    private readonly force: () => number,
  ) {}

  get places(): Vec3[] {
    return [...this.fingers.values()].map((finger) => finger.position);
  }

  get count(): number {
    return this.fingers.size;
  }

  /** `who` names the pointer or key that presses. */
  down(who: string, position: Vec3): void {
    if (this.numberOf.has(who)) return this.move(who, position);
    let number = 0;
    while (this.fingers.has(number)) number += 1;
    this.numberOf.set(who, number);
    this.fingers.set(number, { position, force: this.force(), changed: true });
    this.flush();
  }

  move(who: string, position: Vec3): void {
    const finger = this.fingers.get(this.numberOf.get(who) ?? -1);
    if (!finger) return;
    finger.position = position;
    finger.changed = true;
  }

  up(who: string): void {
    const number = this.numberOf.get(who);
    if (number === undefined) return;
    this.flush();
    this.numberOf.delete(who);
    this.fingers.delete(number);
    this.send({ do: "release", finger: number });
  }

  holds(who: string): boolean {
    return this.numberOf.has(who);
  }

  upAll(): void {
    for (const who of [...this.numberOf.keys()]) this.up(who);
  }

  /** The fingers still down press again: after a line that was lost, or when the force changes. */
  repeat(): void {
    for (const finger of this.fingers.values()) finger.changed = true;
  }

  /** Sends what changed since the last time. */
  flush(): void {
    for (const [number, finger] of this.fingers) {
      const force = this.force();
      if (!finger.changed && force === finger.force) continue;
      finger.force = force;
      finger.changed = !this.send({ do: "press", finger: number, position_m: finger.position, force_n: force });
    }
  }
}
