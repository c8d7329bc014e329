// Compares the contacts of two runs of `dermis live --jsonl -` with the same readings, frame by frame.
//   node touches.mjs TOUCHES.toml EXPECTED ACTUAL FRAMES

import { readFileSync } from 'node:fs';

/** Rate of the frames, Hz. */
const RATE = 120;
/** Part of a press in which its contact must be there: it is found some frames after the finger is down, s. */
const AFTER_S = 0.1;
/** Greatest distance of two contacts, m. */
const MAX_M = 1e-4;
/** Radius of the cylinder, m. */
const RADIUS_M = 0.05;

const [touches, expected, actual, count] = process.argv.slice(2);
const presses = [...readFileSync(touches, 'utf8').matchAll(/at_s = ([\d.]+), for_s = ([\d.]+), from = { z_m = ([\d.]+), theta_deg = ([\d.]+) }/g)]
  .map((match) => match.slice(1).map(Number))
  .map(([at, during, z, degrees]) => {
    const angle = (degrees * Math.PI) / 180;
    return { at, until: at + during, place: [RADIUS_M * Math.cos(angle), RADIUS_M * Math.sin(angle), z] };
  });

/** Lines by the number of the reading's frame in the file. */
function read(path, firstOf) {
  const lines = readFileSync(path, 'utf8').trim().split('\n').slice(0, Number(count)).map((line) => JSON.parse(line));
  const { lost, skipped } = lines[lines.length - 1];
  if (lost > 0 || skipped > 0) throw new Error(`${path}: ${lost} frames lost, ${skipped} skipped`);
  const first = firstOf(lines[0].sequence);
  const frames = lines.filter(({ validity }) => validity.state !== 'stale');
  return new Map(frames.map((line) => [line.sequence - first, line]));
}

const distance = (a, b) => Math.hypot(...a.map((value, axis) => value - b[axis]));
// `dermis emulate` sends frame n of the twin with number n, and the file begins after the frame of a self-test; the Pico
// begins with the first frame of the file, whatever its number.
const [before, after] = [read(expected, () => 1), read(actual, (sequence) => sequence)];
let [compared, exact, worst, found] = [0, 0, 0, 0];
const errors = [];
for (const { at, until, place } of presses) {
  let largest = -1;
  for (let frame = Math.ceil((at + AFTER_S) * RATE); frame < (until - AFTER_S) * RATE; frame += 1) {
    const lines = [before.get(frame), after.get(frame)];
    if (!lines.every((line) => line?.contacts.length === 1)) continue;
    const [a, b] = lines.map((line) => line.contacts[0].position_m);
    const apart = distance(a, b);
    largest = Math.max(largest, apart);
    compared += 1;
    exact += apart === 0 ? 1 : 0;
    errors.push(distance(b, place));
  }
  if (largest >= 0 && largest <= MAX_M) found += 1;
  else console.log(`the press at ${at} s: ${largest < 0 ? 'no contact in both' : `${1e3 * largest} mm apart`}`);
  worst = Math.max(worst, largest);
}
const mm = (length) => (1e3 * length).toFixed(4);
console.log(`${found} of ${presses.length} presses within ${mm(MAX_M)} mm: ${compared} frames compared, ${exact} of them equal, at most ${mm(worst)} mm apart`);
errors.sort((a, b) => a - b);
console.log(`distance from the place of the press on the Pico: ${mm(errors[Math.floor(errors.length / 2)])} mm (median), ${mm(errors[Math.floor(0.95 * errors.length)])} mm (95 %)`);
process.exit(found === presses.length && presses.length === 20 ? 0 : 1);
