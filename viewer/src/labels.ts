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
