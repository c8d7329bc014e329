// Tare, threshold, method, record, pause; and the force of the pointer on an emulated skin.

import { bytes, minutes, whole } from "./format";
import { part, say, show } from "./dom";
import type { Command, SceneMessage, StatusMessage } from "./types";

/** A status does not move a control that was changed this recently: the answer of the server is still to come. */
const PENDING_MS = 1500;

export class Controls {
  private readonly tare = part<HTMLButtonElement>("tare");
  private readonly pause = part<HTMLButtonElement>("pause");
  private readonly record = part<HTMLButtonElement>("record");
  private readonly recordNote = part("record-note");
  private readonly method = part<HTMLSelectElement>("method");
  private readonly methodNote = part("method-note");
  private readonly threshold = part<HTMLInputElement>("threshold");
  private readonly thresholdValue = part("threshold-value");
  private readonly force = part<HTMLInputElement>("force");
  private readonly forceValue = part("force-value");
  private readonly seek = part<HTMLInputElement>("seek");
  private thresholdTouched = -Infinity;
  private seekTouched = -Infinity;
  private methodTouched = -Infinity;

  constructor(private readonly send: (command: Command) => boolean) {
    this.tare.addEventListener("click", () => this.send({ do: "tare" }));
    this.pause.addEventListener("click", () => this.send({ do: "pause", on: !pressed(this.pause) }));
    this.record.addEventListener("click", () => this.send({ do: "record", on: !pressed(this.record) }));
    this.method.addEventListener("change", () => {
      this.methodTouched = performance.now();
      this.send({ do: "method", name: this.method.value });
    });
    this.seek.addEventListener("input", () => (this.seekTouched = performance.now()));
    // Once, where the slider is left.
    this.seek.addEventListener("change", () => {
      this.seekTouched = performance.now();
      this.send({ do: "seek", part: Number(this.seek.value) });
    });
    this.threshold.addEventListener("input", () => {
      this.thresholdTouched = performance.now();
      this.sayThreshold();
      this.send({ do: "threshold", value: this.thresholdFactor });
    });
    this.force.addEventListener("input", () => this.sayForce());
    this.sayThreshold();
    this.sayForce();
  }

  /** Force of a press, N. */
  get forceN(): number {
    return Number(this.force.value);
  }

  enable(connected: boolean): void {
    for (const control of [this.seek, this.tare, this.pause, this.record, this.method, this.threshold]) control.disabled = !connected;
  }

  setScene(scene: SceneMessage): void {
    this.method.replaceChildren(...scene.methods.map((name) => new Option(name, name)));
    show(part("force-control"), scene.emulated);
  }

  setStatus(status: StatusMessage): void {
    const now = performance.now();
    toggle(this.pause, status.paused, "Resume", "Pause");
    toggle(this.record, status.recording !== null, "Stop", "Record");
    this.sayRecording(status);
    this.sayPlayback(status, now);
    if (now - this.methodTouched > PENDING_MS && this.method.value !== status.method) this.method.value = status.method;
    say(this.methodNote, status.method_note ?? "");
    show(this.methodNote, status.method_note !== null);
    if (now - this.thresholdTouched > PENDING_MS) {
      this.threshold.value = `${Math.log2(status.threshold)}`;
      this.sayThreshold();
    }
  }

  private sayPlayback({ playback }: StatusMessage, now: number): void {
    show(part("seek-control"), !!playback);
    if (!playback) return;
    say(part("seek-value"), minutes(playback.time_s));
    this.seek.setAttribute("aria-valuetext", minutes(playback.time_s));
    if (now - this.seekTouched > PENDING_MS) this.seek.value = `${playback.part}`;
  }

  /** The slider is logarithmic: a quarter to four times the method's default. */
  private get thresholdFactor(): number {
    return Math.round(2 ** Number(this.threshold.value) * 100) / 100;
  }

  private sayThreshold(): void {
    const text = `${this.thresholdFactor.toFixed(2)} ×`;
    say(this.thresholdValue, text);
    this.threshold.setAttribute("aria-valuetext", `${text} the method's default`);
  }

  private sayForce(): void {
    const text = `${this.forceN.toFixed(1)} N`;
    say(this.forceValue, text);
    this.force.setAttribute("aria-valuetext", text);
  }

  private sayRecording({ recording }: StatusMessage): void {
    show(this.recordNote, recording !== null);
    if (!recording) return;
    const { path, frames, bytes: size, problem } = recording;
    say(this.recordNote, problem ? `${path}: ${problem}` : `${path}: ${whole(frames)} frames, ${bytes(size)}`);
    this.recordNote.classList.toggle("problem", problem !== null);
  }
}

function pressed(button: HTMLButtonElement): boolean {
  return button.getAttribute("aria-pressed") === "true";
}

function toggle(button: HTMLButtonElement, on: boolean, whenOn: string, whenOff: string): void {
  button.setAttribute("aria-pressed", `${on}`);
  const word = button.querySelector<HTMLElement>(".word");
  if (word) say(word, on ? whenOn : whenOff);
}
