// Messages between server and page; README.md describes every field.

export type Vec2 = [number, number];
export type Vec3 = [number, number, number];

export type Surface = { kind: "cylinder"; radius_m: number; length_m: number } | { kind: "plane" } | { kind: "free" };

export interface Skin {
  vertices_m: number[];
  normals: number[];
  triangles: number[];
  /** Four pixels for each vertex, and their weights: a vertex shows the weighted sum. */
  pixels: number[];
  weights: number[];
}

export interface ElectrodePlace {
  position_m: Vec3;
  normal: Vec3;
  radius_m: number;
}

export interface ImageLayout {
  pixel_count: number;
  rows: number | null;
  columns: number | null;
  position_in_grid: number[] | null;
}

export interface Unrolled {
  size_m: Vec2;
  wraps: boolean;
  labels: [string, string];
  electrodes_m: Vec2[];
}

export type Quantity = "change" | "touch" | "density";

export interface SceneMessage {
  type: "scene";
  version: string;
  design: string;
  frame_id: string;
  touch: "conductance_rises" | "conductance_falls";
  surface: Surface;
  skin: Skin;
  electrodes: ElectrodePlace[];
  image: ImageLayout;
  unrolled: Unrolled | null;
  methods: string[];
  emulated: boolean;
  quantity: Quantity;
}

export type ElectrodeState = "sound" | "doubtful" | "suspect" | "on_trial" | "loose" | "open";

export interface ElectrodeHealth {
  state: ElectrodeState;
  contact_ohm: number | null;
  noise: number | null;
}

export interface Counts {
  frames: number;
  lost: number;
  repeated: number;
  reordered: number;
  damaged: number;
  late: number;
  skipped: number;
}

export interface Recording {
  path: string;
  frames: number;
  bytes: number;
  problem: string | null;
}

export type Level = "info" | "warning" | "error";

export interface Note {
  level: Level;
  text: string;
  at_s: number;
}

export type GuideStep = "wait" | "press" | "hold" | "lift" | "fit" | "finished";

/** A guided calibration session. */
export interface GuideStatus {
  step: GuideStep;
  position_m: Vec3 | null;
  taken: number;
  planned: number;
  coverage: number;
  reach_m: number;
  /** Number of presses and mean error of each calibration. */
  errors: [number, number][];
  fitting: boolean;
  note: string;
}

export interface StatusMessage {
  type: "status";
  connected: boolean;
  source: string;
  method: string;
  method_note: string | null;
  paused: boolean;
  playback?: { time_s: number; part: number } | null;
  recording: Recording | null;
  guide?: GuideStatus | null;
  threshold: number;
  rate_hz: number | null;
  latency_ms: { median: number | null; p99: number | null } | null;
  noise: number | null;
  counts: Counts;
  electrodes: ElectrodeHealth[];
  messages: Note[];
}

export interface RefusedMessage {
  type: "refused";
  why: string;
}


/** A contact, as in JSON lines (docs/file-formats.md). Written by a test of dermis-live. */
export interface Contact {
  id: number;
  position_m: Vec3;
  normal: Vec3;
  force_n: number | null;
  force_sd_n: number | null;
  strength: number | null;
  area_m2: number | null;
  direction: Vec3;
  half_length_m: number | null;
  half_width_m: number | null;
  edge_m: number | null;
  sd_m: number | null;
  confidence: number;
  conductance?: "rises" | "falls";
  centroid_m: Vec3;
  centre_of_pressure_m: Vec3;
  velocity_m_s: Vec3;
  seen: boolean;
  since: number;
  age_s: number;
  zone: string | null;
  /** Its place on the unrolled surface, if there is one. */
  flat_m: Vec2 | null;
}

export interface Validity {
  state: "ok" | "degraded" | "invalid" | "stale";
  text: string;
}

export interface FrameHeader {
  sequence: number;
  measured_at_s: number;
  output_at_s: number;
  /** Whether the contacts can be relied on, in words too. */
  validity: Validity;
  /** Null if it is unknown: the frame is invalid or stale. */
  touched: boolean | null;
  contacts: Contact[];
}

export type Command =
  | { do: "tare"; skin?: string }
  | { do: "threshold"; value: number }
  | { do: "method"; name: string }
  | { do: "record"; on: boolean }
  | { do: "pause"; on: boolean }
  | { do: "seek"; part: number }
  | { do: "press"; finger: number; position_m: Vec3; force_n: number }
  | { do: "release"; finger: number }
  | { do: "guide"; action: "skip" | "redo" | "finish" };
