// The page of a robot: its links and skins, what each skin says, contacts, rules.

import "./robot.css";

import { Connection, liveAddress } from "../connection";
import { make, part, say, show } from "../dom";
import { Notes } from "../messages";
import type { RobotScene, RobotStatus, SkinState } from "./types";
import { type Colour, RobotView } from "./view";

const LIST_EVERY_MS = 150;

class RobotPage {
  scene: RobotScene | null = null;
  status: RobotStatus | null = null;
  readonly connection = new Connection<RobotScene, RobotStatus>(liveAddress(location), this);
  readonly view = makeView();
  private readonly notes = new Notes();
  private readonly marks = part("robot-marks");
  private redraw = true;
  private listAt = 0;
  private colours = look();

  start(): void {
    this.wire();
    this.setLink();
    this.connection.open();
    requestAnimationFrame((now) => this.draw(now));
  }

  connected(): void {
    document.body.classList.remove("stale");
    this.setLink();
  }

  disconnected(): void {
    document.body.classList.add("stale");
    this.setLink();
  }

  setScene(scene: RobotScene): void {
    this.scene = scene;
    this.view?.setScene(scene);
    say(part("design"), scene.robot);
    say(part("base"), scene.base ?? "none");
    document.title = `${scene.robot} · Dermis`;
    this.redraw = true;
  }

  setStatus(status: RobotStatus): void {
    this.status = status;
    this.view?.setPoses(status.poses);
    this.redraw = true;
  }

  refused({ why }: { why: string }): void {
    this.notes.refuse(why);
  }

  private draw(now: number): void {
    requestAnimationFrame((next) => this.draw(next));
    if (this.redraw) {
      this.redraw = false;
      this.view?.render((drawn) => {
        const skin = this.status?.snapshot.skins.find((one) => one.skin === drawn.skin);
        const zone = this.connection.connected ? skin?.zone : undefined;
        return drawn.skin === null ? this.colours.link : this.colours[zone ?? "unknown"];
      });
      this.mark();
    }
    if (now - this.listAt >= LIST_EVERY_MS) {
      this.listAt = now;
      this.list();
    }
  }

  /** A ring at each contact whose place is known. */
  private mark(): void {
    const contacts = this.status?.snapshot.contacts ?? [];
    const rings = (this.connection.connected ? contacts : []).flatMap(({ position_base_m: place, force_n: force }) => {
      const at = place && this.view?.project(place);
      if (!at) return [];
      const ring = make("span", "robot-mark", force === null ? "" : `${force.toFixed(1)} N`);
      ring.style.transform = `translate(${at[0].toFixed(1)}px, ${at[1].toFixed(1)}px)`;
      return [ring];
    });
    this.marks.replaceChildren(...rings);
  }

  private list(): void {
    const { status } = this;
    const { connected } = this.connection;
    const touched = connected ? (status?.snapshot.touched ?? null) : null;
    const word = touched === null ? "unknown" : touched ? "touched" : "untouched";
    part("touched").dataset["state"] = word;
    say(part("touched"), word);
    if (!status) return;
    const { snapshot } = status;
    show(part("robot-posed"), status.posed === false && this.scene?.base !== null);
    say(part("joints"), snapshot.joints_age_s === null ? "none" : `${(1000 * snapshot.joints_age_s).toFixed(0)} ms old`);
    part("skin-list").replaceChildren(...snapshot.skins.map((skin) => this.row(skin, status)));
    const contacts = snapshot.contacts.map((contact) => {
      const row = make("li", "robot-row");
      row.append(make("strong", "", contact.skin), make("span", "", contact.link));
      const place = contact.position_base_m;
      const spread = contact.sd_base_m === null ? "" : ` ± ${(1000 * contact.sd_base_m).toFixed(1)}`;
      row.append(make("span", "", place ? `${place.map((value) => (1000 * value).toFixed(0)).join(", ")}${spread} mm` : "place unknown"));
      row.append(make("span", "", contact.force_n === null ? "" : `${contact.force_n.toFixed(1)} N`));
      return row;
    });
    // Nothing of what was last said holds while the program is not heard.
    part("contact-list").replaceChildren(...(connected ? contacts : []));
    show(part("no-contacts"), contacts.length === 0 || !connected);
    say(part("no-contacts"), connected ? "No contacts." : "Unknown.");
    const rules = Object.entries(snapshot.rules).map(([name, { cause, skin }]) => {
      const row = make("li", "robot-row");
      row.append(make("strong", "", name), make("span", "", `${skin} is ${cause}`));
      return row;
    });
    part("rule-list").replaceChildren(...(connected ? rules : []));
    show(part("no-rules"), rules.length === 0 || !connected);
    say(part("no-rules"), connected ? "None." : "Unknown.");
    part<HTMLButtonElement>("tare").disabled = !connected;
    this.notes.setMessages(status.messages);
  }

  private row(skin: SkinState, status: RobotStatus): HTMLElement {
    const row = make("li", "robot-row robot-skin");
    const { connected } = this.connection;
    const zone = connected ? skin.zone : "unknown";
    row.dataset["zone"] = zone;
    const about = [
      skin.link,
      skin.rate_hz === null ? "no frames" : `${skin.rate_hz.toFixed(0)} Hz`,
      skin.age_s === null ? "" : skin.age_s < 1 ? `${(1000 * skin.age_s).toFixed(0)} ms old` : `${skin.age_s.toFixed(0)} s old`,
    ];
    row.append(make("i", "robot-zone"), make("strong", "", skin.skin), make("b", "", zone));
    const button = make("button", "", "Tare") as HTMLButtonElement;
    button.type = "button";
    button.dataset["skin"] = skin.skin;
    button.title = `Use the present frames of ${skin.skin} as its untouched baseline`;
    button.disabled = !connected;
    row.append(button, make("span", "robot-about", (connected ? about : [skin.link]).filter(Boolean).join(" · ")));
    const reason = connected ? status.reasons[skin.skin] : "the program is not heard";
    if (reason) row.append(make("span", "robot-about", reason));
    return row;
  }

  private setLink(): void {
    const { connected } = this.connection;
    const state = connected ? "live" : this.scene ? "disconnected" : "connecting";
    part("link").dataset["state"] = state;
    say(part("link"), state);
    this.redraw = true;
  }

  private wire(): void {
    // Rows are made anew, so that their list listens; a press is a click before the next ones.
    part("skin-list").addEventListener("pointerdown", (event) => {
      const skin = (event.target as HTMLElement).dataset["skin"];
      if (skin !== undefined) this.connection.send({ do: "tare", skin });
    });
    part("skin-list").addEventListener("keydown", (event) => {
      const skin = (event.target as HTMLElement).dataset["skin"];
      if (skin !== undefined && (event.key === "Enter" || event.key === " ")) this.connection.send({ do: "tare", skin });
    });
    part("tare").addEventListener("click", () => this.connection.send({ do: "tare" }));
    part("reset-view").addEventListener("click", () => {
      this.view?.reset();
      this.redraw = true;
    });
    const canvas = part<HTMLCanvasElement>("robot");
    canvas.addEventListener("pointerdown", (event) => canvas.setPointerCapture(event.pointerId));
    canvas.addEventListener("pointermove", (event) => {
      if (event.buttons === 0) return;
      this.view?.turn(event.movementX, event.movementY);
      this.redraw = true;
    });
    canvas.addEventListener("wheel", (event) => {
      event.preventDefault();
      this.view?.nearer(Math.exp(-0.001 * event.deltaY));
      this.redraw = true;
    });
    canvas.addEventListener("keydown", (event) => {
      const turn = { ArrowLeft: [-20, 0], ArrowRight: [20, 0], ArrowUp: [0, -20], ArrowDown: [0, 20] }[event.key];
      const zoom = { "+": 1.2, "-": 1 / 1.2 }[event.key];
      if (turn) this.view?.turn(turn[0] ?? 0, turn[1] ?? 0);
      else if (zoom) this.view?.nearer(zoom);
      else if (event.key === "Home") this.view?.reset();
      else return;
      event.preventDefault();
      this.redraw = true;
    });
    new ResizeObserver(() => (this.redraw = true)).observe(part("robot-stage"));
    window.matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => {
      this.colours = look();
      this.redraw = true;
    });
  }
}

/** The colours of the theme: blue is clear, orange is touched, violet is unknown; the list says it in words too. */
function look(): Record<"link" | "clear" | "touched" | "unknown", Colour> {
  const dark = window.matchMedia("(prefers-color-scheme: dark)").matches;
  return dark
    ? { link: [0.42, 0.45, 0.5], clear: [0.4, 0.62, 0.95], touched: [1.0, 0.62, 0.25], unknown: [0.66, 0.45, 0.8] }
    : { link: [0.78, 0.8, 0.83], clear: [0.36, 0.58, 0.92], touched: [0.96, 0.5, 0.1], unknown: [0.62, 0.42, 0.74] };
}

/** Null without WebGL, with a note on the page; the lists work. */
function makeView(): RobotView | null {
  try {
    return new RobotView(part<HTMLCanvasElement>("robot"));
  } catch {
    show(part("no-webgl"), true);
    return null;
  }
}

const page = new RobotPage();
// For the console and tests.
Object.assign(window, { dermisRobot: page });
page.start();
