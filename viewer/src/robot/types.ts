// The messages of a robot's page; positions in metres.

import type { Note } from "../types";

/** A pose: the three columns of the rotation, then the translation. */
export type Pose = [number, number, number, number, number, number, number, number, number, number, number, number];

export interface Part {
  /** The link in whose frame the triangles are. */
  link: string;
  /** The skin that the part is; null for a link itself. */
  skin: string | null;
  /** x, y, z of the three corners of each triangle. */
  corners_m: number[];
}

export interface RobotScene {
  type: "scene";
  robot: string;
  base: string | null;
  /** The link that each link hangs on; null for a root. */
  parents: Record<string, string | null>;
  parts: Part[];
}

export interface SkinState {
  skin: string;
  link: string;
  zone: "clear" | "touched" | "unknown";
  reason?: string;
  age_s: number | null;
  rate_hz: number | null;
}

export interface RobotContact {
  skin: string;
  link: string;
  id: number;
  force_n: number | null;
  position_base_m: [number, number, number] | null;
  sd_base_m: number | null;
}

export interface RobotStatus {
  type: "status";
  snapshot: {
    touched: boolean | null;
    complete: boolean;
    skins: SkinState[];
    contacts: RobotContact[];
    rules: Record<string, { cause: string; skin: string }>;
    joints_age_s: number | null;
  };
  /** The pose of each link in the frame of the base; of a robot whose joints are unknown, with all joints at zero. */
  poses: Record<string, Pose | null>;
  /** Whether the joints are known. */
  posed: boolean;
  /** The reason of each unknown skin in words. */
  reasons: Record<string, string>;
  messages: Note[];
}
