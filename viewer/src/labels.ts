// Words over a picture: a pool of elements that are moved, and written to only when they change.

export interface Label {
  x: number;
  y: number;
  text: string;
  /** Class names beside `label`. */
  kind: string;
  colour?: string;
}

export class Labels {
  private readonly pool: { element: HTMLElement; text: string; kind: string; colour: string; place: string }[] = [];

  constructor(private readonly overlay: HTMLElement) {}

  show(labels: readonly Label[]): void {
    while (this.pool.length < labels.length) {
      const element = document.createElement("div");
      this.overlay.append(element);
      this.pool.push({ element, text: "", kind: "?", colour: "", place: "" });
    }
    this.pool.forEach((held, k) => {
      const label = labels[k];
      const kind = label ? `label ${label.kind}` : "label hidden";
      if (held.kind !== kind) held.element.className = held.kind = kind;
      if (!label) return;
      if (held.text !== label.text) held.element.textContent = held.text = label.text;
      const colour = label.colour ?? "";
      if (held.colour !== colour) held.element.style.setProperty("--ink", (held.colour = colour));
      const place = `translate(${label.x.toFixed(1)}px, ${label.y.toFixed(1)}px) translate(-50%, -100%)`;
      if (held.place !== place) held.element.style.transform = held.place = place;
    });
  }
}

/** A box on a picture, in pixels: `right` and `bottom` are the coordinates of its edges. */
export interface Box {
  right: number;
  bottom: number;
  width: number;
  height: number;
}

/**
 * The box moved to the nearest place that overlaps no other box: up or down between 0 and `lowest`, else to the left. Where
 * there is none, the box itself.
 */
export function freeBox(box: Box, others: readonly Box[], lowest: number): Box {
  const isFree = (one: Box): boolean =>
    one.bottom - one.height >= 0 &&
    one.bottom <= lowest &&
    others.every(
      (other) =>
        one.right <= other.right - other.width ||
        other.right <= one.right - one.width ||
        one.bottom <= other.bottom - other.height ||
        other.bottom <= one.bottom - one.height,
    );
  for (let right = box.right; right > box.width; right -= box.width)
    for (let step = 0; step <= lowest; step += 1)
      for (const bottom of [box.bottom - step, box.bottom + step]) {
        const moved = { ...box, right, bottom };
        if (isFree(moved)) return moved;
      }
  return box;
}
