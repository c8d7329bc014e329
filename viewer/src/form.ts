// The form of a contact: an oval on the skin.

import type { Contact, Surface, Vec3 } from "./types";

export interface Form {
  /** Unit vectors of the tangent plane along and across it. */
  along: Vec3;
  across: Vec3;
  halfLengthM: number;
  halfWidthM: number;
}

/** A contact is drawn at least this large, so that it can be seen. */
export const LEAST_RADIUS_M = 0.003;

/** The form of a contact as it is drawn; null unless all of it is known. */
export function contactForm({ normal, direction, half_length_m, half_width_m }: Contact): Form | null {
  // The components of an unknown direction are null.
  if (half_length_m === null || half_width_m === null || !direction.every(Number.isFinite)) return null;
  const halfLengthM = Math.max(half_length_m, LEAST_RADIUS_M);
  const halfWidthM = Math.max(half_width_m, LEAST_RADIUS_M);
  return { along: direction, across: cross(normal, direction), halfLengthM, halfWidthM };
}

/**
 * The point at these distances along, across and out of the skin from the middle of a form, in the axes along, across and
 * normal. On a cylinder the distances follow the cylinder, elsewhere the tangent plane.
 */
export function pointOnSkin({ along, across }: Form, surface: Surface, [alongM, acrossM, outM]: Vec3): Vec3 {
  if (surface.kind !== "cylinder") return [alongM, acrossM, outM];
  const radiusM = surface.radius_m + outM;
  // In these axes the cylinder's axis is (along[2], across[2], 0), and a quarter turn gives the way round it.
  const axis = [along[2], across[2]] as const;
  const round = [across[2], -along[2]] as const;
  const axialM = alongM * axis[0] + acrossM * axis[1];
  const theta = (alongM * round[0] + acrossM * round[1]) / surface.radius_m;
  const roundM = radiusM * Math.sin(theta);
  return [axialM * axis[0] + roundM * round[0], axialM * axis[1] + roundM * round[1], radiusM * Math.cos(theta) - surface.radius_m];
}

function cross(a: Vec3, b: Vec3): Vec3 {
  return [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]];
}
