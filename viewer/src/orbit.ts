// The camera orbits the body: two angles and a distance, z up.

import { type PerspectiveCamera, Vector3 } from "three";

const STEEPEST = (89 * Math.PI) / 180;
const TURN_PER_PIXEL = 0.008;
/** Cosine of the angle between the line of sight and the normal of a side that is seen well. */
const SEEN_WELL = 0.5;
/** A side may lean by this angle. */
const LEANING = Math.PI / 4;
const NEAREST = 0.45;
const FARTHEST = 3;

export class Orbit {
  private azimuth = 0;
  private elevation = 0;
  private zoom = 1;
  private home = { azimuth: 0, elevation: 0 };
  private readonly centre = new Vector3();
  private readonly halfSize = new Vector3(0.1, 0.1, 0.1);

  constructor(private readonly camera: PerspectiveCamera) {
    camera.up.set(0, 0, 1);
  }

  /** Looks at a box from the given angles; the same box again leaves the camera where it is. */
  frame(low: Vector3, high: Vector3, azimuth: number, elevation: number): void {
    const centre = low.clone().add(high).multiplyScalar(0.5);
    const halfSize = high.clone().sub(low).multiplyScalar(0.5);
    if (centre.equals(this.centre) && halfSize.equals(this.halfSize)) return;
    this.centre.copy(centre);
    this.halfSize.copy(halfSize);
    this.home = { azimuth, elevation };
    this.reset();
  }

  reset(): void {
    Object.assign(this, this.home, { zoom: 1 });
    this.place();
  }

  /** Rotates the body so that a side with an outward normal is seen; a side that is seen well stays. */
  face([x, y, z]: readonly [number, number, number]): void {
    const { azimuth, elevation } = this;
    const level = Math.cos(elevation);
    const seen = level * (Math.cos(azimuth) * x + Math.sin(azimuth) * y) + Math.sin(elevation) * z;
    if (seen > SEEN_WELL) return;
    const across = Math.hypot(x, y);
    if (across > 0.1) this.azimuth = Math.atan2(y, x);
    const upright = Math.atan2(z, across);
    if (Math.abs(upright - elevation) > LEANING) this.elevation = upright - Math.sign(upright - elevation) * LEANING;
    this.place();
  }

  /** Rotates the body by pixels to the right and down. */
  turn(right: number, down: number): void {
    this.azimuth -= right * TURN_PER_PIXEL;
    this.elevation = Math.min(Math.max(this.elevation + down * TURN_PER_PIXEL, -STEEPEST), STEEPEST);
    this.place();
  }

  /** Above one zooms in. */
  zoomBy(factor: number): void {
    this.zoom = Math.min(Math.max(this.zoom / factor, NEAREST), FARTHEST);
    this.place();
  }

  /** Places the camera so that the box fills the view at a zoom of one, for any aspect ratio. */
  place(): void {
    const { camera } = this;
    const towards = new Vector3(
      Math.cos(this.elevation) * Math.cos(this.azimuth),
      Math.cos(this.elevation) * Math.sin(this.azimuth),
      Math.sin(this.elevation),
    );
    const distance = this.fitting() * this.zoom;
    camera.position.copy(this.centre).addScaledVector(towards, distance);
    camera.near = distance / 50;
    camera.far = distance * 6;
    camera.lookAt(this.centre);
    camera.updateProjectionMatrix();
    camera.updateMatrixWorld();
  }

  /** The distance at which the box, seen from its home angle or any turn about z, stays inside the view. */
  private fitting(): number {
    const { x, y, z } = this.halfSize;
    const round = Math.hypot(x, y);
    const tilt = Math.abs(this.home.elevation);
    const tall = z * Math.cos(tilt) + round * Math.sin(tilt);
    const tangent = Math.tan((this.camera.fov * Math.PI) / 360);
    const depth = 0.5 * (round * Math.cos(tilt) + z * Math.sin(tilt));
    const margin = 1.1;
    return depth + margin * Math.max(tall / tangent, round / (tangent * this.camera.aspect));
  }
}
