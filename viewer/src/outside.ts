// What other programs (tests, a console) may read of the page.

import type { FrameHeader, SceneMessage, StatusMessage, Vec2, Vec3 } from "./types";

export interface Outside {
  /** Frames drawn so far. */
  readonly drawn: number;
  /** Header of the frame drawn last. */
  readonly frame: FrameHeader | null;
  readonly status: StatusMessage | null;
  readonly scene: SceneMessage | null;
  readonly connected: boolean;
  /** Where a point of space is in the picture in space, CSS pixels of the window. */
  project(position_m: Vec3): Vec2 | null;
  /** Where it is in the unrolled picture. */
  projectFlat(position_m: Vec3): Vec2 | null;
  /** The point of the skin's outside under a pixel of the picture in space. */
  unproject(pixel: Vec2): Vec3 | null;
  /** The point of the skin under a pixel of the unrolled picture. */
  unprojectFlat(pixel: Vec2): Vec3 | null;
}

declare global {
  interface Window {
    readonly dermis: Outside;
  }
}

export function expose(outside: Outside): void {
  Object.defineProperty(window, "dermis", { value: Object.freeze(outside), enumerable: true });
}
