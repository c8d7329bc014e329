// A contact keeps one colour as long as it lasts, and a colour rests a little before another contact gets it.

import { SLOT_COUNT } from "./colours";
import type { Contact } from "./types";

/** A strip chart shows the last half minute; a colour not needed elsewhere stays with its old line for a while. */
const REST_FRAMES = 60;

export class Slots {
  private readonly slotOf = new Map<number, number>();
  private readonly freeSince: number[] = new Array<number>(SLOT_COUNT).fill(-REST_FRAMES - 1);
  private readonly taken: boolean[] = new Array<boolean>(SLOT_COUNT).fill(false);
  private clock = 0;

  /** A slot for each contact, in their order; more contacts than colours share the last, neutral one. */
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
