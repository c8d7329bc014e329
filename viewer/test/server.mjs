// A server that speaks the viewer's interface without a skin: it serves the built page and sends simulated frames.

import http from "node:http";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { WebSocketServer } from "ws";

import { PAGE } from "../build.mjs";
import { contact, image, scene as cylinder, thetaOf } from "./skin.mjs";

const TYPES = { ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css" };
export const POLICY =
  "default-src 'self'; connect-src 'self' ws: wss:; style-src 'self' 'unsafe-inline'; img-src 'self' data: blob:";
/** A press is felt this much later. */
const DELAY_MS = 50;
/** A client that leaves this much unread is sent no frame. */
const UNREAD_BYTES = 100_000;

/**
 * Options: `port`; `rate` frames a second; `touches(timeS)` what moves by itself; `scene` and `frame(sequence, touches)`
 * for another body; `electrodes` their health; `guide` the state of a guided session, which may be changed. The answer holds `commands` and `addresses`
 * (all received), `tell(message)`, `mute()` (the line stays open, nothing is said) and `close()`.
 */
export async function startServer(options = {}) {
  const { rate = 120, touches: moving = () => [], scene = cylinder(), frame = image, connected = true } = options;
  const state = { method: scene.methods[0], threshold: 1, paused: false, recording: null, validity: { state: "ok", text: "ok" } };
  const commands = [];
  const addresses = [];
  let muted = false;
  const fingers = new Map();
  const lasting = new Map();
  const messages = [{ level: "warning", text: "electrode 7 is loose: its readings are left out", at_s: Date.now() / 1000 }];
  const started = performance.now();
  let [sequence, nextId, sent, skipped, sinceStatus] = [0, 1, 0, 0, 0];

  const server = http.createServer(async (request, response) => {
    const name = new URL(request.url, "http://x").pathname.replace(/^\/$/, "/index.html").slice(1);
    try {
      if (!/^[\w.]+$/.test(name)) throw new Error(name);
      const body = await readFile(path.join(PAGE, name));
      response.writeHead(200, { "content-type": TYPES[path.extname(name)], "content-security-policy": POLICY });
      response.end(body);
    } catch {
      response.writeHead(404).end("not found");
    }
  });
  const sockets = new WebSocketServer({ server, path: "/live" });
  const tell = (message) => sockets.clients.forEach((client) => client.send(JSON.stringify(message)));

  const health = options.electrodes ?? scene.electrodes.map((_, k) => ({
    state: k === 7 ? "loose" : "sound",
    contact_ohm: k === 7 ? 5400 : 96 + ((k * 37) % 17),
    noise: k === 7 ? 3.1 : 1,
  }));
  const status = () => ({
    type: "status",
    connected,
    source: "emulator: lab, seed 1",
    method: state.method,
    method_note: null,
    paused: state.paused,
    guide: options.guide ?? null,
    playback: options.playback ?? null,
    recording: state.recording && { path: "touch.mcap", frames: sequence, bytes: 7000 * sequence, problem: null },
    threshold: state.threshold,
    rate_hz: rate + 0.4 * Math.sin(sequence),
    latency_ms: { median: 0.31 + 0.02 * Math.sin(sequence), p99: 0.62 + 0.1 * Math.cos(3 * sequence) },
    noise: 1 + 0.05 * Math.sin(0.7 * sequence),
    counts: { frames: sequence, lost: 0, repeated: 0, reordered: 0, damaged: 0, late: 0, skipped },
    electrodes: health,
    messages,
  });

  function obey(client, command) {
    commands.push({ ...command, at: performance.now() });
    const felt = { theta: 0, z: 0, force: command.force_n };
    if (command.do === "press") {
      Object.assign(felt, { theta: thetaOf(command.position_m), z: command.position_m[2] });
      setTimeout(() => fingers.set(command.finger, felt), DELAY_MS);
    } else if (command.do === "release") setTimeout(() => fingers.delete(command.finger), DELAY_MS);
    else if (command.do === "threshold") state.threshold = command.value;
    else if (command.do === "guide" && options.guide) return;
    else if (command.do === "seek") return;
    else if (command.do === "pause") state.paused = command.on;
    else if (command.do === "record") state.recording = command.on ? {} : null;
    else if (command.do === "tare") messages.push({ level: "info", text: "tared over 100 frames", at_s: Date.now() / 1000 });
    else if (command.do === "method" && command.name !== options.refuses) state.method = command.name;
    else client.send(JSON.stringify({ type: "refused", why: `no method is called \`${command.name}\`` }));
    if (!["press", "release"].includes(command.do)) tell(status());
  }

  sockets.on("connection", (client, request) => {
    addresses.push(request.url);
    client.on("message", (data) => obey(client, JSON.parse(data.toString())));
    client.send(JSON.stringify(scene));
    client.send(JSON.stringify(status()));
  });

  function sendFrame() {
    if (state.paused) return;
    const touches = [...moving((performance.now() - started) / 1000).map((touch, k) => [`moving ${k}`, touch]), ...[...fingers].map(([finger, touch]) => [`finger ${finger}`, touch])];
    for (const name of lasting.keys()) if (!touches.some(([other]) => other === name)) lasting.delete(name);
    const contacts = touches.map(([name, touch]) => {
      if (!lasting.has(name)) lasting.set(name, { id: nextId++, since: Date.now() / 1000 });
      const { id, since } = lasting.get(name);
      return contact(id, touch, since);
    });
    const now = Date.now() / 1000;
    const isUsable = ["ok", "degraded"].includes(state.validity.state);
    const header = { sequence, measured_at_s: now, output_at_s: now, validity: state.validity, touched: isUsable ? touches.length > 0 : null, contacts: isUsable ? contacts : [] };
    const values = frame(touches.map(([, touch]) => touch), sequence);
    const message = pack(header, values);
    sockets.clients.forEach((client) => {
      if (client.bufferedAmount > UNREAD_BYTES) skipped += 1;
      else client.send(message);
    });
    sequence += 1;
  }

  // Timers fire late: what is due by now is sent now.
  const beat = setInterval(() => {
    if (muted) return;
    const due = Math.floor(((performance.now() - started) / 1000) * rate);
    for (; sent < due; sent += 1) sendFrame();
    if (performance.now() - sinceStatus > 250) {
      sinceStatus = performance.now();
      tell(status());
    }
  }, 3);

  await new Promise((resolve, reject) => server.once("error", reject).listen(options.port ?? 0, "127.0.0.1", resolve));
  const { port } = server.address();
  return {
    port,
    address: `http://127.0.0.1:${port}/`,
    commands,
    state,
    addresses,
    tell,
    mute: () => (muted = true),
    get sequence() {
      return sequence;
    },
    close: () =>
      new Promise((resolve) => {
        clearInterval(beat);
        sockets.clients.forEach((client) => client.terminate());
        server.close(resolve);
        server.closeAllConnections();
      }),
  };
}

function pack(header, values) {
  let text = JSON.stringify(header);
  text += " ".repeat((4 - (Buffer.byteLength(text) % 4)) % 4);
  const head = Buffer.from(text);
  const length = Buffer.alloc(4);
  length.writeUInt32LE(head.length);
  return Buffer.concat([length, head, Buffer.from(values.buffer, values.byteOffset, values.byteLength)]);
}
