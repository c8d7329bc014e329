// The image on the vertices of the skin: each shows the weighted sum of four pixels.

import type { Skin } from "./types";

export class VertexValues {
  readonly values: Float32Array;
  private readonly pixels: Uint32Array;
  private readonly weights: Float32Array;

  constructor(skin: Skin) {
    const count = skin.vertices_m.length / 3;
    if (skin.pixels.length !== 4 * count || skin.weights.length !== 4 * count) {
      throw new Error(`${count} vertices need ${4 * count} pixels and weights, not ${skin.pixels.length} and ${skin.weights.length}`);
    }
    this.values = new Float32Array(count);
    this.pixels = Uint32Array.from(skin.pixels);
    this.weights = Float32Array.from(skin.weights);
  }

  update(image: Float32Array): void {
    const { values, pixels, weights } = this;
    for (let vertex = 0, k = 0; vertex < values.length; vertex += 1, k += 4) {
      let sum = 0;
      for (let corner = k; corner < k + 4; corner += 1) {
        const weight = weights[corner] as number;
        if (weight !== 0) sum += weight * (image[pixels[corner] as number] as number);
      }
      values[vertex] = sum;
    }
  }
}

/** The largest absolute value of an image; what is not a number counts for nothing. */
export function largest(image: Float32Array): number {
  let most = 0;
  for (const value of image) {
    const size = Math.abs(value);
    if (size > most) most = size;
  }
  return most;
}
