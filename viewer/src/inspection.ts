// The state of the page as `window.dermis`, for the console and for tests.

import type { FrameHeader, SceneMessage, StatusMessage, Vec2, Vec3 } from "./types";

export interface Inspection {
  /** Frames drawn so far. */
  readonly drawn: number;
  /** Header of the frame drawn last. */
  readonly frame: FrameHeader | null;
  readonly status: StatusMessage | null;
  readonly scene: SceneMessage | null;
  readonly connected: boolean;
  /** The pixel of a point in the 3D view, CSS pixels of the window. */
  project(position_m: Vec3): Vec2 | null;
  /** The same in the unrolled view. */
  projectFlat(position_m: Vec3): Vec2 | null;
  /** The point of the skin under a pixel of the 3D view. */
  unproject(pixel: Vec2): Vec3 | null;
  /** The same in the unrolled view. */
  unprojectFlat(pixel: Vec2): Vec3 | null;
}

declare global {
  interface Window {
    readonly dermis: Inspection;
  }
}

export function expose(inspection: Inspection): void {
  Object.defineProperty(window, "dermis", { value: Object.freeze(inspection), enumerable: true });
}
