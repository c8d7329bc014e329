// The bar at the top: the design, whether the skin is touched, frame rate, latency and losses.

import { fixed, significant, whole } from "./format";
import { part, say } from "./dom";
import type { Counts, SceneMessage, StatusMessage } from "./types";

export class Header {
  private readonly design = part("design");
  private readonly source = part("source");
  private readonly touched = part("touched");
  private readonly rate = part("rate");
  private readonly latency = part("latency");
  private readonly losses = part("losses");
  private readonly link = part("link");

  setScene(scene: SceneMessage): void {
    say(this.design, scene.design);
    this.design.title = `frame ${scene.frame_id}, dermis ${scene.version}`;
    document.title = `${scene.design} · Dermis`;
  }

  setStatus(status: StatusMessage): void {
    say(this.source, status.source);
    this.source.title = status.source;
    say(this.rate, `${fixed(status.rate_hz, 0)} /s`);
    say(this.latency, `${significant(status.latency_ms?.median, 2)} ms`);
    say(this.losses, losses(status.counts));
    this.losses.title = `${whole(status.counts.frames)} frames received; ${every(status.counts)}`;
  }

  /** Null while it is unknown. */
  setTouched(touched: boolean | null): void {
    const state = touched === null ? "unknown" : touched ? "touched" : "untouched";
    if (this.touched.dataset["state"] === state) return;
    this.touched.dataset["state"] = state;
    say(this.touched, state);
  }

  /** Without a device it is unknown whether the skin is touched. */
  setLink(connected: boolean, paused: boolean, device: boolean): void {
    if (!device) this.setTouched(null);
    const state = !connected ? "disconnected" : !device ? "no device" : paused ? "paused" : "live";
    if (this.link.dataset["state"] === state) return;
    this.link.dataset["state"] = state;
    say(this.link, state);
  }
}

const LOSSES = ["lost", "damaged", "repeated", "reordered", "late", "skipped"] as const;

function every(counts: Counts): string {
  return LOSSES.map((name) => `${whole(counts[name])} ${name}`).join(", ");
}

/** Only counts above zero. No contacts were computed of "late" frames. "Skipped" frames were not sent to this page: no loss. */
function losses(counts: Counts): string {
  const happened = LOSSES.filter((name) => name !== "skipped" && counts[name] > 0);
  return happened.length === 0 ? "none" : happened.map((name) => `${whole(counts[name])} ${name}`).join(", ");
}
