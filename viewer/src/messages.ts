// Messages of the server, refused commands, and the banner.

import { make, part, say, show } from "./dom";
import type { Level, Note, Validity } from "./types";

const REFUSAL_SHOWN_MS = 8000;
const SYMBOL: Record<Level, string> = { info: "ℹ", warning: "▲", error: "✖" };

export class Notes {
  private readonly list = part("message-list");
  private readonly none = part("no-messages");
  private readonly refusal = part("refusal");
  private readonly refusalText = part("refusal-text");
  private shown = "";
  private timer: number | undefined;

  constructor() {
    part("refusal-close").addEventListener("click", () => show(this.refusal, false));
  }

  setMessages(messages: Note[]): void {
    const key = JSON.stringify(messages);
    if (key === this.shown) return;
    this.shown = key;
    show(this.none, messages.length === 0);
    // Newest first.
    this.list.replaceChildren(...[...messages].reverse().map(line));
  }

  refuse(why: string): void {
    say(this.refusalText, `Refused: ${why}`);
    show(this.refusal, true);
    window.clearTimeout(this.timer);
    this.timer = window.setTimeout(() => show(this.refusal, false), REFUSAL_SHOWN_MS);
  }
}

function line(note: Note): HTMLElement {
  const level = note.level in SYMBOL ? note.level : "info";
  const item = make("li", `message ${level}`);
  const symbol = make("span", "symbol", SYMBOL[level]);
  symbol.setAttribute("aria-hidden", "true");
  const time = make("time", "", new Date(note.at_s * 1000).toLocaleTimeString("en-GB"));
  item.append(symbol, time, make("span", "level", `${level}:`), make("span", "text", note.text));
  return item;
}

export class Banner {
  private readonly banner = part("banner");
  private readonly text = part("banner-text");
  private readonly again = part("banner-again");
  private until = 0;
  private since: number | null = null;
  private ticking: number | undefined;

  constructor(tryNow: () => void) {
    this.again.addEventListener("click", tryNow);
  }

  /** No connection; the next attempt is after `waitMs`. */
  waiting(waitMs: number): void {
    this.since ??= performance.now();
    this.until = performance.now() + waitMs;
    window.clearInterval(this.ticking);
    this.ticking = window.setInterval(() => this.tick(), 200);
    this.put("down", true);
    this.tick();
  }

  /** The server is connected, its device is not. */
  deviceGone(): void {
    this.stop();
    say(this.text, "The device is not connected. Waiting for it to reconnect.");
    this.put("device", false);
  }

  /** The server has stopped, as a guided session ends with it. */
  ended(): void {
    this.stop();
    say(this.text, "The calibration is written. This page can be closed.");
    this.put("ended", false);
  }

  paused(): void {
    this.stop();
    say(this.text, "Paused: the last frame is shown. Press Resume to continue.");
    this.put("paused", false);
  }

  /** The contacts are unknown, or worse than usual. */
  validity({ state, text }: Validity): void {
    this.stop();
    say(this.text, state === "degraded" ? text : `Contacts unknown. ${text}`);
    this.put(state, false);
  }

  hide(): void {
    this.stop();
    show(this.banner, false);
  }

  private stop(): void {
    window.clearInterval(this.ticking);
    this.since = null;
  }

  private put(kind: string, button: boolean): void {
    this.banner.dataset["kind"] = kind;
    show(this.again, button);
    show(this.banner, true);
  }

  private tick(): void {
    const left = Math.ceil((this.until - performance.now()) / 1000);
    const gone = Math.round((performance.now() - (this.since ?? performance.now())) / 1000);
    const next = left > 0 ? `Reconnecting in ${left} s.` : "Reconnecting now.";
    const age = gone >= 2 ? ` The last frame is ${gone} s old.` : "";
    say(this.text, `Disconnected from the server. ${next}${age}`);
  }
}
