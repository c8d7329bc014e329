// Numbers as text.

import type { Contact, ElectrodeHealth, ElectrodeState } from "./types";

/** About three significant digits, without trailing digits: 0.00123, 4.56, 78.9, 1230. */
export function significant(value: number | null | undefined, digits = 3): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  if (value === 0) return "0";
  const size = Math.floor(Math.log10(Math.abs(value)));
  return value.toFixed(Math.min(Math.max(digits - 1 - size, 0), 6));
}

export function fixed(value: number | null | undefined, places: number, unit = ""): string {
  return value === null || value === undefined || !Number.isFinite(value) ? "–" : `${value.toFixed(places)}${unit && ` ${unit}`}`;
}

/** A time as minutes and seconds: 1:05. */
export function minutes(seconds: number): string {
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

/** Strength is relative change of conductance times area, in mm². */
export function strengthMm2(strength: number): number {
  return strength * 1e6;
}

export function contactSize(contact: Contact): string {
  if (contact.force_n !== null) return `${contact.force_n.toFixed(1)} N`;
  return contact.strength === null ? "" : `${significant(strengthMm2(contact.strength), 2)} mm²`;
}

export function contactLabel(contact: Contact): string {
  return `#${contact.id} ${contactSize(contact)}`.trim();
}

/** Length and width of a contact; empty where they are unknown. */
export function formText({ half_length_m, half_width_m }: Contact): string {
  if (half_length_m === null || half_width_m === null) return "";
  return `${Math.round(2000 * half_length_m)} × ${Math.round(2000 * half_width_m)} mm`;
}

/** Two or three digits; at most six characters, so that it fits into the tile of an electrode. */
export function ohms(value: number | null | undefined): string {
  if (value === null || value === undefined || !Number.isFinite(value)) return "–";
  const size = Math.abs(value);
  const [scale, unit] = size >= 999.5e3 ? [1e-6, "MΩ"] : size >= 999.5 ? [1e-3, "kΩ"] : size >= 0.9995 ? [1, "Ω"] : [1e3, "mΩ"];
  return size < 0.00005 ? "0 Ω" : `${(value * scale).toFixed(size * scale < 9.95 ? 1 : 0)} ${unit}`;
}

export const STATE_SYMBOL: Record<ElectrodeState, string> = {
  sound: "●", doubtful: "◆", suspect: "◆", on_trial: "◆", loose: "▲", open: "✖",
};

/** The name of a state. */
export function stateName(state: ElectrodeState): string {
  return state.replace("_", " ");
}

export function electrodeText(electrode: number, health: ElectrodeHealth | undefined): string {
  if (!health) return `electrode ${electrode}`;
  const noise = health.noise === null ? "" : `, noise ${fixed(health.noise, 1)} ×`;
  return `electrode ${electrode}: ${stateName(health.state)}, ${ohms(health.contact_ohm)}${noise}`;
}

export function bytes(count: number): string {
  const steps = ["B", "kB", "MB", "GB", "TB"];
  let [value, step] = [count, 0];
  while (value >= 1000 && step < steps.length - 1) [value, step] = [value / 1000, step + 1];
  return `${step === 0 ? value : value.toFixed(1)} ${steps[step] ?? ""}`;
}

export function whole(count: number): string {
  return count.toLocaleString("en").replaceAll(",", "\u202f");
}
