// The colours of the image, of contacts and of electrodes.
//
// The image has a sign and a middle: zero is the untouched skin, positive a touch, negative an artefact. So the map
// diverges from a grey that leaves the skin calm at rest: orange for a touch, blue for the other sign. Orange and blue
// lie along the axis that people with red-green blindness see whole, and in each arm the lightness changes evenly and
// one way only, so that the map is read even in grey. It is computed from a few points in OKLCh (Ottosson 2020).

export type Theme = "light" | "dark";

/** Lightness (0 to 1), chroma and hue (degrees). */
type Lch = [number, number, number];

/** Chroma and hue along an arm at even steps, from the grey of zero; the lightness runs straight from first to last. */
interface Arm {
  lightness: [number, number];
  chroma: number[];
  hue: number[];
}

const ARMS: Record<Theme, { negative: Arm; positive: Arm }> = {
  light: {
    positive: { lightness: [0.91, 0.37], chroma: [0.004, 0.12, 0.165, 0.16, 0.12], hue: [255, 82, 62, 45, 33] },
    negative: { lightness: [0.91, 0.4], chroma: [0.004, 0.06, 0.11, 0.14, 0.15], hue: [255, 235, 245, 255, 263] },
  },
  dark: {
    positive: { lightness: [0.34, 0.94], chroma: [0.015, 0.1, 0.16, 0.16, 0.1], hue: [262, 40, 48, 70, 98] },
    negative: { lightness: [0.34, 0.86], chroma: [0.015, 0.08, 0.13, 0.12, 0.08], hue: [262, 260, 252, 238, 222] },
  },
};

/** Entries of the table of colours; the middle ones are zero. */
export const TABLE_SIZE = 512;

/** RGBA bytes, from minus the range to plus the range; where nothing is negative the lower half stays grey. */
export function colourTable(theme: Theme, signed: boolean): Uint8Array {
  const table = new Uint8Array(4 * TABLE_SIZE);
  const { negative, positive } = ARMS[theme];
  for (let entry = 0; entry < TABLE_SIZE; entry += 1) {
    const value = (2 * (entry + 0.5)) / TABLE_SIZE - 1;
    const colour = value >= 0 || !signed ? along(positive, Math.max(value, 0)) : along(negative, -value);
    table.set([...toRgb(colour), 255], 4 * entry);
  }
  return table;
}

/** The entry for a value, clipped to the range. */
export function tableEntry(value: number, range: number): number {
  const entry = Math.floor((0.5 + (0.5 * value) / range) * TABLE_SIZE);
  return Math.min(Math.max(entry, 0), TABLE_SIZE - 1);
}

/** Straight lines in OKLab between the stops, so that the way from a bluish grey to orange leads through no third hue. */
function along(arm: Arm, share: number): Lch {
  const [from, to] = arm.lightness;
  const place = share * (arm.hue.length - 1);
  const left = Math.min(Math.floor(place), arm.hue.length - 2);
  const [a, b] = [left, left + 1].map((stop) => {
    const angle = ((arm.hue[stop] ?? 0) * Math.PI) / 180;
    const chroma = arm.chroma[stop] ?? 0;
    return [chroma * Math.cos(angle), chroma * Math.sin(angle)] as const;
  }) as [readonly [number, number], readonly [number, number]];
  const mixed = [0, 1].map((axis) => (a[axis] ?? 0) + ((b[axis] ?? 0) - (a[axis] ?? 0)) * (place - left)) as [number, number];
  return [from + (to - from) * share, Math.hypot(...mixed), (Math.atan2(mixed[1], mixed[0]) * 180) / Math.PI];
}

/** sRGB bytes; chroma gives way where the screen cannot show it, lightness and hue stay. */
export function toRgb([lightness, chroma, hue]: Lch): [number, number, number] {
  let [low, high] = [0, chroma];
  if (inGamut(linearRgb(lightness, chroma, hue))) low = chroma;
  else
    for (let step = 0; step < 16; step += 1) {
      const middle = 0.5 * (low + high);
      if (inGamut(linearRgb(lightness, middle, hue))) low = middle;
      else high = middle;
    }
  const [r, g, b] = linearRgb(lightness, low, hue).map(gammaByte);
  return [r ?? 0, g ?? 0, b ?? 0];
}

/** OKLab to linear sRGB: the two matrices of Ottosson (2020), "A perceptual color space for image processing". */
function linearRgb(lightness: number, chroma: number, hue: number): number[] {
  const a = chroma * Math.cos((hue * Math.PI) / 180);
  const b = chroma * Math.sin((hue * Math.PI) / 180);
  const l = (lightness + 0.3963377774 * a + 0.2158037573 * b) ** 3;
  const m = (lightness - 0.1055613458 * a - 0.0638541728 * b) ** 3;
  const s = (lightness - 0.0894841775 * a - 1.291485548 * b) ** 3;
  return [
    4.0767416621 * l - 3.3077115913 * m + 0.2309699292 * s,
    -1.2684380046 * l + 2.6097574011 * m - 0.3413193965 * s,
    -0.0041960863 * l - 0.7034186147 * m + 1.707614701 * s,
  ];
}

function inGamut(rgb: number[]): boolean {
  return rgb.every((channel) => channel >= -1e-4 && channel <= 1.0001);
}

function gammaByte(linear: number): number {
  const value = Math.min(Math.max(linear, 0), 1);
  return Math.round(255 * (value <= 0.0031308 ? 12.92 * value : 1.055 * value ** (1 / 2.4) - 0.055));
}

/** Lines and rings of contacts: hues of Okabe and Ito (2008), lightened or darkened to stand out from the ground. */
const CONTACTS: Record<Theme, string[]> = {
  light: ["#0063a8", "#00785a", "#a83279", "#6b4fc0", "#7a5b00", "#b5321c", "#0e7c96", "#4b5563"],
  dark: ["#6cc3ff", "#3fd6a4", "#f29ad0", "#b9a5ff", "#f2e05a", "#ff9a76", "#6fe3f2", "#cbd5e1"],
};

export const SLOT_COUNT = 8;

export function contactColour(theme: Theme, slot: number): string {
  return CONTACTS[theme][slot] ?? (theme === "light" ? "#4b5563" : "#cbd5e1");
}

export interface Ink {
  text: string;
  muted: string;
  line: string;
  panel: string;
  halo: string;
  accent: string;
  sound: string;
  doubtful: string;
  suspect: string;
  on_trial: string;
  loose: string;
  open: string;
}

/** What canvases draw with; the style sheet holds the same values for the rest of the page. */
export const INK: Record<Theme, Ink> = {
  light: {
    text: "#18202b", muted: "#5a6575", line: "#d9dee6", panel: "#ffffff", halo: "#ffffff", accent: "#1d5fc4",
    sound: "#3a4656", doubtful: "#8a6200", suspect: "#8a6200", on_trial: "#8a6200", loose: "#b42318", open: "#7a1fa2",
  },
  dark: {
    text: "#e8ebf0", muted: "#98a3b3", line: "#2c343f", panel: "#161a20", halo: "#0c0e11", accent: "#7fb2ff",
    sound: "#c3ccd8", doubtful: "#f5c451", suspect: "#f5c451", on_trial: "#f5c451", loose: "#ff8a75", open: "#d9a3ff",
  },
};

export function currentTheme(): Theme {
  return window.matchMedia("(prefers-color-scheme: dark)").matches ? "dark" : "light";
}
