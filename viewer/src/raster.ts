// The flat picture as texels: of a grid, each cell is one pixel of the image; of a body without a grid, texels are
// interpolated between the skin's vertices, found once.

import type { Flat } from "./flat";
import { TABLE_SIZE } from "./colours";
import type { SceneMessage, Vec2, Vec3 } from "./types";

/** Texels along the longer side of a body without a grid. */
const FREE_TEXELS = 160;

export interface Raster {
  readonly width: number;
  readonly height: number;
  /** Fills RGBA texels, top row first (the largest v). */
  paint(texels: Uint32Array, image: Float32Array, vertices: Float32Array, table: Uint32Array, range: number): void;
}

export function makeRaster(scene: SceneMessage, flat: Flat): Raster {
  const { rows, columns, position_in_grid: places } = scene.image;
  return rows !== null && columns !== null && places !== null ? new GridRaster(rows, columns, places) : new MeshRaster(scene, flat);
}

function entry(value: number, scale: number): number {
  const place = (0.5 + value * scale) * TABLE_SIZE;
  return place < 0 ? 0 : place >= TABLE_SIZE ? TABLE_SIZE - 1 : place | 0;
}

class GridRaster implements Raster {
  private readonly texelOf: Uint32Array;

  constructor(
    readonly height: number,
    readonly width: number,
    places: number[],
  ) {
    this.texelOf = Uint32Array.from(places, (place) => {
      const row = Math.floor(place / width);
      return (height - 1 - row) * width + (place % width);
    });
  }

  paint(texels: Uint32Array, image: Float32Array, _vertices: Float32Array, table: Uint32Array, range: number): void {
    const scale = 0.5 / range;
    for (let pixel = 0; pixel < this.texelOf.length; pixel += 1) {
      texels[this.texelOf[pixel] as number] = table[entry(image[pixel] as number, scale)] as number;
    }
  }
}

class MeshRaster implements Raster {
  readonly width: number;
  readonly height: number;
  private readonly texels: number[] = [];
  private readonly corners: number[] = [];
  private readonly shares: number[] = [];

  constructor(scene: SceneMessage, flat: Flat) {
    const [width, height] = flat.size;
    const step = Math.max(width, height) / FREE_TEXELS;
    this.width = Math.max(1, Math.round(width / step));
    this.height = Math.max(1, Math.round(height / step));
    const { vertices_m: points, triangles } = scene.skin;
    const placed: (Vec2 | null)[] = [];
    for (let k = 0; k + 2 < points.length; k += 3) placed.push(flat.fromSpace(points.slice(k, k + 3) as Vec3));
    for (let k = 0; k + 2 < triangles.length; k += 3) this.fill(triangles.slice(k, k + 3) as Vec3, placed, flat);
  }

  paint(texels: Uint32Array, _image: Float32Array, vertices: Float32Array, table: Uint32Array, range: number): void {
    const { corners, shares } = this;
    const scale = 0.5 / range;
    for (let k = 0; k < this.texels.length; k += 1) {
      let value = 0;
      for (let c = 3 * k; c < 3 * k + 3; c += 1) value += (shares[c] as number) * (vertices[corners[c] as number] as number);
      texels[this.texels[k] as number] = table[entry(value, scale)] as number;
    }
  }

  /** Notes the texels whose centres lie in a triangle, with their barycentric coordinates. */
  private fill(triangle: Vec3, placed: (Vec2 | null)[], flat: Flat): void {
    const found = triangle.map((vertex) => placed[vertex] ?? null);
    if (found.some((place) => place === null)) return;
    const period = flat.wraps ? flat.size[0] : 0;
    const first = found[0] as Vec2;
    const [a, b, c] = (found as Vec2[]).map(([u, v]) => this.inTexels([near(u, first[0], period), v], flat)) as [Vec2, Vec2, Vec2];
    const twice = cross(a, b, c);
    if (twice === 0) return;
    const us = [a[0], b[0], c[0]];
    const vs = [a[1], b[1], c[1]];
    for (let row = Math.max(0, Math.ceil(Math.min(...vs))); row <= Math.min(this.height - 1, Math.max(...vs)); row += 1)
      for (let column = Math.ceil(Math.min(...us)); column <= Math.max(...us); column += 1) {
        const at: Vec2 = [column, row];
        const shares = [cross(at, b, c) / twice, cross(a, at, c) / twice, cross(a, b, at) / twice];
        if (shares.some((share) => share < -1e-9)) continue;
        const wrappedColumn = flat.wraps ? ((column % this.width) + this.width) % this.width : column;
        if (wrappedColumn < 0 || wrappedColumn >= this.width) continue;
        this.texels.push((this.height - 1 - row) * this.width + wrappedColumn);
        this.corners.push(...triangle);
        this.shares.push(...shares);
      }
  }

  private inTexels([u, v]: Vec2, flat: Flat): Vec2 {
    return [
      ((u - flat.origin[0]) / flat.size[0]) * this.width - 0.5,
      ((v - flat.origin[1]) / flat.size[1]) * this.height - 0.5,
    ];
  }
}

function cross(a: Vec2, b: Vec2, c: Vec2): number {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

/** The copy of u nearest to another, where the layout closes on itself. */
function near(u: number, other: number, period: number): number {
  return period > 0 ? u - period * Math.round((u - other) / period) : u;
}
