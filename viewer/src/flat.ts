// The flat layout of a body and the way back into space: u = radius * theta, v = z on a cylinder; u = x, v = y on a plane.

import type { SceneMessage, Surface, Unrolled, Vec2, Vec3 } from "./types";

export class Flat {
  /** Corner of the layout with the smallest u and v, m. */
  readonly origin: Vec2;
  readonly size: Vec2;
  readonly wraps: boolean;
  private readonly surface: Surface;

  constructor(scene: SceneMessage, unrolled: Unrolled) {
    this.size = unrolled.size_m;
    this.wraps = unrolled.wraps;
    this.surface = scene.surface;
    this.origin = scene.surface.kind === "plane" ? corner(scene.skin.vertices_m, this.size) : [0, 0];
  }

  /** The point of the body under a point of the layout; null outside, and where the body has no formula. */
  toSpace([u, v]: Vec2): Vec3 | null {
    const { surface } = this;
    const place = this.wrapped([u, v]);
    if (!this.holds(place)) return null;
    if (surface.kind === "cylinder") {
      const theta = place[0] / surface.radius_m;
      return [surface.radius_m * Math.cos(theta), surface.radius_m * Math.sin(theta), place[1]];
    }
    return surface.kind === "plane" ? [place[0], place[1], 0] : null;
  }

  /** The place of a point of the body in the layout; null where the body has no formula. */
  fromSpace([x, y, z]: Vec3): Vec2 | null {
    const { surface } = this;
    if (surface.kind === "cylinder") return this.wrapped([surface.radius_m * Math.atan2(y, x), z]);
    return surface.kind === "plane" ? [x, y] : null;
  }

  /** A vector of the tangent plane at a point of the body in the layout; null where the body has no formula. */
  vectorFromSpace([x, y]: Vec3, [dx, dy, dz]: Vec3): Vec2 | null {
    const { surface } = this;
    if (surface.kind === "plane") return [dx, dy];
    if (surface.kind !== "cylinder") return null;
    const theta = Math.atan2(y, x);
    return [dy * Math.cos(theta) - dx * Math.sin(theta), dz];
  }

  /** The same place within the width, where the layout closes on itself. */
  wrapped([u, v]: Vec2): Vec2 {
    if (!this.wraps) return [u, v];
    const [width] = this.size;
    const turns = Math.floor((u - this.origin[0]) / width);
    return [u - turns * width, v];
  }

  /** The nearest place inside. */
  clamped(place: Vec2): Vec2 {
    const [u, v] = this.wrapped(place);
    const within = (value: number, axis: 0 | 1): number =>
      Math.min(Math.max(value, this.origin[axis]), this.origin[axis] + this.size[axis]);
    return [within(u, 0), within(v, 1)];
  }

  private holds([u, v]: Vec2): boolean {
    const slack = 1e-9;
    const [u0, v0] = this.origin;
    const [width, height] = this.size;
    return u >= u0 - slack && u <= u0 + width + slack && v >= v0 - slack && v <= v0 + height + slack;
  }
}

/** The corner of a picture of this size round the middle of the vertices: a disk's polygon is a little smaller than the disk. */
function corner(vertices: number[], [width, height]: Vec2): Vec2 {
  const low: Vec2 = [Infinity, Infinity];
  const high: Vec2 = [-Infinity, -Infinity];
  for (let k = 0; k + 2 < vertices.length; k += 3)
    for (const axis of [0, 1] as const) {
      low[axis] = Math.min(low[axis], vertices[k + axis] as number);
      high[axis] = Math.max(high[axis], vertices[k + axis] as number);
    }
  return [0.5 * (low[0] + high[0] - width), 0.5 * (low[1] + high[1] - height)];
}
