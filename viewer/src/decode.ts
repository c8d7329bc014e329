// A binary message: u32 length of the header, the header as JSON, the image as f32.

import type { FrameHeader } from "./types";

export interface Frame {
  header: FrameHeader;
  /** A view into the message itself: nothing is copied. */
  values: Float32Array;
}

const text = new TextDecoder();

export function decode(message: ArrayBuffer, pixelCount: number): Frame {
  if (message.byteLength < 4) throw new Error(`a frame of ${message.byteLength} bytes has no length`);
  const headerBytes = new DataView(message).getUint32(0, true);
  const expected = 4 + headerBytes + 4 * pixelCount;
  if (message.byteLength !== expected || headerBytes % 4 !== 0) {
    throw new Error(`a frame of ${message.byteLength} bytes, where ${pixelCount} pixels and a header of ${headerBytes} need ${expected}`);
  }
  const header = JSON.parse(text.decode(new Uint8Array(message, 4, headerBytes))) as FrameHeader;
  return { header, values: new Float32Array(message, 4 + headerBytes, pixelCount) };
}
