// The list of contacts, one line each.

import { contactColour, SLOT_COUNT, type Theme } from "./colours";
import { contactSize, fixed, formText } from "./format";
import { make, part, say, show } from "./dom";
import type { Contact } from "./types";

export class ContactList {
  private readonly list = part("contact-list");
  private readonly none = part("no-contacts");
  private readonly count = part("contact-count");
  private rows: { row: HTMLElement; name: HTMLElement; size: HTMLElement; details: HTMLElement }[] = [];

  /** `known`: whether the frame says anything about contacts. */
  update(contacts: readonly Contact[], slots: readonly number[], theme: Theme, known: boolean): void {
    while (this.rows.length < contacts.length) this.rows.push(this.addRow());
    say(this.none, known ? "No contacts." : "Unknown.");
    show(this.none, contacts.length === 0);
    say(this.count, contacts.length === 0 ? "" : `${contacts.length}`);
    this.rows.forEach(({ row, name, size, details }, k) => {
      const contact = contacts[k];
      show(row, contact !== undefined);
      if (!contact) return;
      row.style.setProperty("--ink", contactColour(theme, slots[k] ?? SLOT_COUNT));
      say(name, `#${contact.id}`);
      const spread = contact.force_n !== null && contact.force_sd_n !== null ? ` ± ${contact.force_sd_n.toFixed(1)}` : "";
      say(size, `${contactSize(contact)}${spread}`);
      say(details, describe(contact));
      row.title = explain(contact);
    });
  }

  private addRow(): (typeof this.rows)[number] {
    const row = make("li", "contact-row");
    const name = make("span", "name");
    const size = make("span", "size");
    const details = make("span", "details");
    row.append(name, size, details);
    this.list.append(row);
    return { row, name, size, details };
  }
}

/** The tooltip of a contact. */
function explain(contact: Contact): string {
  const sd = contact.sd_m === null ? "unknown" : `${fixed(contact.sd_m * 1000, 1)} mm`;
  const sure = contact.confidence === null ? "unknown" : fixed(contact.confidence, 2);
  const form = formText(contact) || "unknown";
  return `contact ${contact.id}: length and width ${form}, standard deviation of the position ${sd}, confidence ${sure}`;
}

/** The place, and the form where it is known, else the confidence: all three are too wide for the list. */
function describe(contact: Contact): string {
  const place = (contact.flat_m ?? contact.position_m).map((length) => Math.round(length * 1000)).join(", ");
  const form = formText(contact);
  if (form) return `${place} · ${form}`;
  return contact.confidence === null ? `${place} mm` : `${place} mm · ${Math.round(contact.confidence * 100)} %`;
}
