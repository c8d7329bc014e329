// Pointer and keyboard input on both views. On an emulated skin the left button, or one finger on a touch screen, presses
// the skin; with Shift the touch stays when it is let go, and another click on it with Shift ends it. Beside the skin, with the right button or with two fingers, the body rotates; the wheel and two fingers zoom.

import type { Presser } from "./press";
import type { SkinView } from "./scene3d";
import type { Vec2 } from "./types";
import type { UnrolledView } from "./unrolled";

const KEY_TURN_PIXELS = 18;
const KEY_STEP_M = 0.005;
const KEY_FINE_STEP_M = 0.001;
const KEYBOARD = "keyboard";

export interface InputListener {
  emulated(): boolean;
  /** A view must be drawn again. */
  changed(): void;
}

function place(event: PointerEvent | WheelEvent): Vec2 {
  return [event.clientX, event.clientY];
}

export function onSkin(view: SkinView, presser: Presser, listener: InputListener): void {
  const { canvas, orbit } = view;
  const pointers = new Map<number, Vec2>();
  const name = (event: PointerEvent): string => `skin ${event.pointerId}`;

  canvas.addEventListener("pointerdown", (event) => {
    canvas.setPointerCapture(event.pointerId);
    pointers.set(event.pointerId, place(event));
    view.hovered = null;
    if (pointers.size > 1) presser.upAll();
    else if (event.button === 0 && listener.emulated()) {
      const hit = view.pick(place(event));
      if (hit && !(event.shiftKey && presser.releaseAt(hit))) presser.down(name(event), hit);
    }
    canvas.classList.toggle("pressing", presser.count > 0);
    canvas.classList.toggle("turning", presser.count === 0);
    listener.changed();
  });

  canvas.addEventListener("pointermove", (event) => {
    const before = pointers.get(event.pointerId);
    if (!before) {
      if (event.pointerType === "mouse") hover(view, event, listener);
      return;
    }
    const now = place(event);
    if (presser.holds(name(event))) {
      const hit = view.pick(now);
      if (hit) presser.move(name(event), hit);
    } else turn(before, now, event.pointerId);
    pointers.set(event.pointerId, now);
    listener.changed();
  });

  /** One pointer rotates the body. With two, each rotates it by half, and their distance sets the zoom. */
  const turn = (before: Vec2, now: Vec2, moved: number): void => {
    const other = [...pointers].find(([id]) => id !== moved)?.[1];
    const share = other ? 0.5 : 1;
    orbit.turn(share * (now[0] - before[0]), share * (now[1] - before[1]));
    if (!other) return;
    const apart = (at: Vec2): number => Math.max(Math.hypot(at[0] - other[0], at[1] - other[1]), 10);
    orbit.zoomBy(apart(now) / apart(before));
  };

  const end = (event: PointerEvent): void => {
    pointers.delete(event.pointerId);
    letGo(presser, name(event), event);
    canvas.classList.remove("pressing", "turning");
    listener.changed();
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", () => leave(view, listener));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const pixels = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? event.deltaY * 30 : event.deltaY;
      orbit.zoomBy(Math.exp(-0.0014 * pixels));
      listener.changed();
    },
    { passive: false },
  );
  canvas.addEventListener("keydown", (event) => {
    const turns: Record<string, Vec2> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] };
    const way = turns[event.key];
    if (way) orbit.turn(way[0] * KEY_TURN_PIXELS, way[1] * KEY_TURN_PIXELS);
    else if (event.key === "+" || event.key === "=") orbit.zoomBy(1.1);
    else if (event.key === "-") orbit.zoomBy(1 / 1.1);
    else if (event.key === "Home" || event.key === "0") orbit.reset();
    else return;
    event.preventDefault();
    listener.changed();
  });
}

export function onUnrolled(view: UnrolledView, presser: Presser, listener: InputListener): void {
  const { canvas } = view;
  const name = (event: PointerEvent): string => `flat ${event.pointerId}`;

  canvas.addEventListener("pointerdown", (event) => {
    if (event.button !== 0 || !listener.emulated()) return;
    const at = view.placeAt(place(event));
    const inside = at && onBody(view, at) ? view.flat?.toSpace(at) : null;
    if (!inside) return;
    canvas.setPointerCapture(event.pointerId);
    view.hovered = view.cursor = null;
    if (!(event.shiftKey && presser.releaseAt(inside))) presser.down(name(event), inside);
    listener.changed();
  });

  canvas.addEventListener("pointermove", (event) => {
    if (!presser.holds(name(event))) {
      if (event.pointerType === "mouse") hover(view, event, listener);
      return;
    }
    const at = view.placeAt(place(event));
    const inside = at && view.flat ? view.flat.toSpace(view.flat.clamped(at)) : null;
    if (inside) presser.move(name(event), inside);
    listener.changed();
  });

  const end = (event: PointerEvent): void => {
    letGo(presser, name(event), event);
    listener.changed();
  };
  canvas.addEventListener("pointerup", end);
  canvas.addEventListener("pointercancel", end);
  canvas.addEventListener("pointerleave", () => leave(view, listener));
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("blur", () => {
    view.cursor = null;
    presser.up(KEYBOARD);
    listener.changed();
  });
  canvas.addEventListener("keydown", (event) => {
    if (!listener.emulated() || !pressWithKey(view, presser, event)) return;
    event.preventDefault();
    listener.changed();
  });
}

/** Ends the press of a pointer, or keeps it where Shift is held. */
function letGo(presser: Presser, who: string, event: PointerEvent): void {
  if (event.shiftKey && event.type === "pointerup") presser.keep(who);
  else presser.up(who);
}

/** Arrow keys move a cursor, the space bar starts and ends a press there, Escape removes the cursor. */
function pressWithKey(view: UnrolledView, presser: Presser, event: KeyboardEvent): boolean {
  const { flat } = view;
  if (!flat) return false;
  const cursor = view.cursor ?? flat.clamped([flat.origin[0] + 0.5 * flat.size[0], flat.origin[1] + 0.5 * flat.size[1]]);
  const step = event.shiftKey ? KEY_FINE_STEP_M : KEY_STEP_M;
  const moves: Record<string, Vec2> = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const way = moves[event.key];
  if (way) view.cursor = flat.clamped([cursor[0] + way[0] * step, cursor[1] + way[1] * step]);
  else if (event.key === " " || event.key === "Enter") view.cursor = cursor;
  else if (event.key === "Escape") view.cursor = null;
  else return false;
  const inside = view.cursor ? flat.toSpace(view.cursor) : null;
  if (!inside) presser.up(KEYBOARD);
  else if (way) presser.move(KEYBOARD, inside);
  else if (presser.holds(KEYBOARD)) presser.up(KEYBOARD);
  else if (!event.repeat) presser.down(KEYBOARD, inside);
  return true;
}

/** A press begins on the image, not on its axes; a slide may cross the seam. */
function onBody(view: UnrolledView, [u, v]: Vec2): boolean {
  const { flat } = view;
  if (!flat) return false;
  const [u0, v0] = flat.origin;
  return u >= u0 && u <= u0 + flat.size[0] && v >= v0 && v <= v0 + flat.size[1];
}

function hover(view: SkinView | UnrolledView, event: PointerEvent, listener: InputListener): void {
  const found = view.electrodeAt(place(event));
  if (found === view.hovered) return;
  view.hovered = found;
  listener.changed();
}

function leave(view: SkinView | UnrolledView, listener: InputListener): void {
  if (view.hovered === null) return;
  view.hovered = null;
  listener.changed();
}
