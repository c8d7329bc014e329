// Each contact keeps one colour. A free colour is given to another contact after some frames.

import { SLOT_COUNT } from "./colours";
import type { Contact } from "./types";

/** The charts show the last half minute: a colour is not reused before this many frames. */
const REST_FRAMES = 60;

export class Slots {
  private readonly slotOf = new Map<number, number>();
  private readonly freeSince: number[] = new Array<number>(SLOT_COUNT).fill(-REST_FRAMES - 1);
  private readonly taken: boolean[] = new Array<boolean>(SLOT_COUNT).fill(false);
  private clock = 0;

  /** A slot for each contact, in their order; contacts beyond the number of colours share the last, neutral one. */
  assign(contacts: readonly Contact[]): number[] {
    this.clock += 1;
    this.forget(new Set(contacts.map((contact) => contact.id)));
    return contacts.map((contact) => this.slotOf.get(contact.id) ?? this.take(contact.id));
  }

  clear(): void {
    this.forget(new Set());
  }

  private forget(present: Set<number>): void {
    for (const [id, slot] of this.slotOf) {
      if (present.has(id)) continue;
      this.slotOf.delete(id);
      if (slot < SLOT_COUNT) {
        this.taken[slot] = false;
        this.freeSince[slot] = this.clock;
      }
    }
  }

  private take(id: number): number {
    const free = this.taken.map((taken, slot) => (taken ? -1 : slot)).filter((slot) => slot >= 0);
    const rested = free.find((slot) => this.clock - (this.freeSince[slot] ?? 0) > REST_FRAMES);
    const longest = free.sort((a, b) => (this.freeSince[a] ?? 0) - (this.freeSince[b] ?? 0))[0];
    const slot = rested ?? longest ?? SLOT_COUNT;
    if (slot < SLOT_COUNT) this.taken[slot] = true;
    this.slotOf.set(id, slot);
    return slot;
  }
}
