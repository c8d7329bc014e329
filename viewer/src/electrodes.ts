// Electrode health: a tile per electrode with its number, a symbol and a word for its state, and its contact resistance.

import { electrodeText, ohms, STATE_SYMBOL, stateName } from "./format";
import { STATES } from "./markers";
import { make, part, say } from "./dom";
import type { ElectrodeHealth } from "./types";

export class ElectrodeGrid {
  private readonly list = part("electrode-grid");
  private readonly summary = part("electrode-summary");
  private cards: { card: HTMLElement; symbol: HTMLElement; word: HTMLElement; value: HTMLElement; shown: string }[] = [];

  /** `pointed` receives the electrode under the mouse, or null. */
  constructor(private readonly pointed: (electrode: number | null) => void) {}

  setCount(count: number): void {
    this.cards = Array.from({ length: count }, (_, electrode) => {
      const card = make("li", "electrode sound");
      const head = make("span", "head");
      const symbol = make("span", "symbol", "");
      symbol.setAttribute("aria-hidden", "true");
      head.append(make("span", "number", `${electrode}`), symbol);
      const word = make("span", "word");
      const value = make("span", "ohm", "–");
      card.append(head, value, word);
      card.addEventListener("pointerenter", () => this.pointed(electrode));
      card.addEventListener("pointerleave", () => this.pointed(null));
      return { card, symbol, word, value, shown: "" };
    });
    this.list.replaceChildren(...this.cards.map(({ card }) => card));
  }

  update(health: ElectrodeHealth[]): void {
    this.cards.forEach((held, electrode) => {
      const state = health[electrode];
      if (!state) return;
      const text = electrodeText(electrode, state);
      if (text === held.shown) return;
      held.shown = text;
      held.card.className = `electrode ${state.state}`;
      held.card.title = text;
      say(held.symbol, STATE_SYMBOL[state.state]);
      say(held.word, state.state === "sound" ? "" : stateName(state.state));
      say(held.value, ohms(state.contact_ohm));
      held.card.setAttribute("aria-label", text);
    });
    const counted = STATES.map((state) => [state, health.filter((electrode) => electrode.state === state).length] as const);
    // Faults first: the end may be truncated.
    const listed = counted.filter(([state, count]) => count > 0 || state === "sound").reverse();
    say(this.summary, listed.map(([state, count]) => `${count} ${stateName(state)}`).join(" · "));
  }
}
