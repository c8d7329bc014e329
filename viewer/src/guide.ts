// A guided calibration session: what to do, how far it is, and how the error falls.

import { fixed } from "./format";
import { part, say, show } from "./dom";
import type { Command, GuideStatus, GuideStep, SceneMessage, Vec3 } from "./types";

const WORDS: Record<GuideStep, string> = {
  wait: "Leave the skin untouched",
  press: "Press here with about 2 N",
  hold: "Hold still",
  lift: "Taken: lift the finger",
  fit: "Calibrating with all presses",
  finished: "The session has ended",
};
/** Size of the curve's view box, and room at its edges. */
const [WIDTH, HEIGHT, EDGE] = [160, 44, 4];

export class GuidePanel {
  private readonly panel = part("guide");
  private readonly step = part("guide-step");
  private readonly place = part("guide-place");
  private readonly count = part("guide-count");
  private readonly coverage = part("guide-coverage");
  private readonly error = part("guide-error");
  private readonly curve = part<HTMLElement>("guide-curve");
  private readonly buttons: Record<"skip" | "redo" | "finish", HTMLButtonElement>;
  private scene: SceneMessage | null = null;
  private status: GuideStatus | null = null;

  constructor(send: (command: Command) => boolean) {
    const button = (action: "skip" | "redo" | "finish"): HTMLButtonElement => {
      const found = part<HTMLButtonElement>(`guide-${action}`);
      found.addEventListener("click", () => send({ do: "guide", action }));
      return found;
    };
    this.buttons = { skip: button("skip"), redo: button("redo"), finish: button("finish") };
  }

  get ended(): boolean {
    return this.status?.step === "finished";
  }

  setScene(scene: SceneMessage): void {
    this.scene = scene;
  }

  setStatus(status: GuideStatus | null): void {
    this.status = status;
    show(this.panel, status !== null);
    document.body.classList.toggle("guided", status !== null);
    if (!status) return;
    this.panel.dataset["step"] = status.step;
    const retry = status.step === "lift" && status.note !== "";
    say(this.step, retry ? "Lift the finger" : WORDS[status.step]);
    const at = status.position_m ? `Place ${status.taken + 1} of ${status.planned}: ${this.where(status.position_m)}` : "";
    say(this.place, [at, status.note].filter((text) => text !== "").join(" · "));
    say(this.count, `${status.taken} / ${status.planned}`);
    say(this.coverage, fixed(100 * status.coverage, 0, "%"));
    this.coverage.title = `part of the skin within ${fixed(1000 * status.reach_m, 0)} mm of a press`;
    const last = status.errors.at(-1);
    say(this.error, last ? fixed(1000 * last[1], 2, "mm") : status.taken < 8 ? "from 8 presses on" : "computing");
    this.error.classList.toggle("unknown", !last);
    this.error.title = last ? `by cross-validation, with ${last[0]} presses` : "";
    this.drawCurve(status);
    this.enable(true);
  }

  enable(connected: boolean): void {
    const { status, buttons } = this;
    const runs = connected && status !== null && status.step !== "fit" && status.step !== "finished";
    buttons.finish.disabled = !runs;
    buttons.skip.disabled = !runs || status.position_m === null;
    buttons.redo.disabled = !runs || status.taken === 0;
  }

  private where([x, y, z]: Vec3): string {
    const mm = (length: number): string => `${(1000 * length).toFixed(0).replace("-0", "0").replace("-", "−")} mm`;
    const kind = this.scene?.surface.kind;
    if (kind === "plane") return `x ${mm(x)}, y ${mm(y)}`;
    if (kind !== "cylinder") return `x ${mm(x)}, y ${mm(y)}, z ${mm(z)}`;
    const degrees = ((Math.atan2(y, x) * 180) / Math.PI + 360) % 360;
    return `z ${mm(z)}, theta ${degrees.toFixed(0)}°`;
  }

  /** The error of each calibration over the number of its presses, from zero. */
  private drawCurve({ errors, planned }: GuideStatus): void {
    show(this.curve, errors.length > 1);
    if (errors.length < 2) return;
    const top = Math.max(...errors.map(([, error]) => error));
    const at = ([presses, error]: [number, number]): string => {
      const x = EDGE + ((WIDTH - 2 * EDGE) * presses) / Math.max(planned, 1);
      const y = HEIGHT - EDGE - ((HEIGHT - 2 * EDGE) * error) / top;
      return `${x.toFixed(1)},${y.toFixed(1)}`;
    };
    this.curve.querySelector("polyline")?.setAttribute("points", errors.map(at).join(" "));
    const [x, y] = at(errors.at(-1) ?? [0, 0]).split(",");
    const dot = this.curve.querySelector("circle");
    dot?.setAttribute("cx", x ?? "0");
    dot?.setAttribute("cy", y ?? "0");
  }
}
