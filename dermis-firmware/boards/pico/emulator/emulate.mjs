// Runs the Pico's firmware with its board in rp2040js, its USB port on a TCP port:
//   node emulate.mjs FIRMWARE.elf READINGS ../../skins/SKIN.rs PORT
// When its input ends it writes a report of the front end as JSON and ends, with 1 if anything was wrong there.

import { createServer } from 'node:net';
import { FrontEnd, readReadings, readSettling } from './board.mjs';
import { CYCLE_NS, Chip } from './chip.mjs';

const [firmware, readings, skin, port] = process.argv.slice(2);
if (port === undefined) {
  console.error('usage: node emulate.mjs FIRMWARE.elf READINGS SKIN.rs PORT');
  process.exit(2);
}

const frontEnd = new FrontEnd(readReadings(readings), readSettling(skin), CYCLE_NS);
const chip = new Chip(firmware, {
  pinsChanged: (pins, cycle) => frontEnd.update(pins, cycle),
  data: () => frontEnd.data,
});

let host = null;
chip.onData = (packet) => host?.write(packet);
const server = createServer((socket) => {
  host?.destroy();
  host = socket;
  socket.setNoDelay(true);
  chip.setOpened(true);
  socket.on('data', (bytes) => chip.send(bytes));
  socket.on('error', () => {});
  socket.on('close', () => {
    if (host !== socket) return;
    host = null;
    chip.setOpened(false);
  });
});
chip.onEnumerated = () => server.listen(Number(port), '127.0.0.1', () => console.log(`tcp:127.0.0.1:${server.address().port}`));

const began = process.hrtime.bigint();
let ended = false;
process.stdin.on('end', () => (ended = true));
process.stdin.resume();

function finish() {
  const seconds = chip.nanos / 1e9;
  const report = { ...frontEnd.report(), simulated_s: seconds, wall_s: Number(process.hrtime.bigint() - began) / 1e9, watchdog_resets: chip.watchdog };
  console.log(JSON.stringify(report));
  process.exit(Object.keys(report.faults).length > 0 || chip.watchdog > 0 ? 1 : 0);
}

/** Simulated time without a look at the connection, ns. */
const SLICE_NS = 1e6;

function step() {
  if (ended) finish();
  chip.run(SLICE_NS);
  setImmediate(step);
}
step();
