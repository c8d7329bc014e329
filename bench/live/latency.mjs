// How long contacts take and how many frames a second are read, device and host in two programs.
// DERMIS names the program; --seconds N each measurement (60), --write puts the tables into docs/live.md.

import { spawn } from "node:child_process";
import { once } from "node:events";
import { cpus, tmpdir } from "node:os";
import { mkdtempSync, rmSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { replaceTable } from "./table.mjs";

const root = new URL("../..", import.meta.url).pathname;
const { WebSocket } = createRequire(join(root, "viewer/package.json"))("ws");
const dermis = process.env.DERMIS ?? join(root, "target/release/dermis");
const at = process.argv.indexOf("--seconds");
const seconds = at > 0 ? Number(process.argv[at + 1]) : 60;

/** Starts the program; `line` comes true with the first match of what it says. */
function start(args, channel, pattern) {
  const child = spawn(dermis, args, { stdio: ["ignore", "pipe", "pipe"] });
  const told = { stdout: "", stderr: "" };
  for (const name of ["stdout", "stderr"]) child[name].on("data", (text) => (told[name] += text));
  const line = new Promise((resolve, reject) => {
    child[channel].on("data", () => told[channel].match(pattern) && resolve(told[channel].match(pattern)[0]));
    child.on("exit", (code) => reject(new Error(`dermis ${args.join(" ")} ended with ${code}\n${told.stderr}`)));
  });
  return { child, told, line };
}

/** A page that reads every message and draws none. */
function page(address) {
  const counted = { frames: 0 };
  const socket = new WebSocket(address.replace("http", "ws") + "live");
  socket.on("message", (_, binary) => (counted.frames += binary ? 1 : 0));
  socket.on("error", () => {});
  return { socket, counted };
}

async function measure({ emulate = [], live = [], pages = 0, latency }) {
  const emulator = start(["emulate", "cylinder30", "--tcp", "127.0.0.1:0", ...emulate], "stdout", /tcp:\S+/);
  const source = await emulator.line;
  const folder = mkdtempSync(join(tmpdir(), "dermis-live-"));
  const sinks = pages > 0 ? ["--record", join(folder, "a.mcap"), "--ros2"] : [];
  const drawn = latency ? ["--latency", latency] : [];
  const args = ["live", "cylinder30", "--source", source, "--serve", "127.0.0.1:0", "--for", String(seconds), "--json", ...sinks, ...drawn, ...live];
  const host = start(args, "stderr", /http:\S+/);
  const address = await host.line;
  const clients = Array.from({ length: pages }, () => page(address));
  host.line.catch(() => {});
  await once(host.child, "exit");
  emulator.line.catch(() => {});
  emulator.child.kill("SIGINT");
  clients.forEach(({ socket }) => socket.terminate());
  rmSync(folder, { recursive: true });
  return { ...JSON.parse(host.told.stdout), seen: clients.map(({ counted }) => counted.frames) };
}

const rows = [];
const touched = ["--touch", "four"];
let alone;
for (const pages of [1, 10]) {
  const told = await measure({ emulate: touched, pages, latency: pages === 1 && process.argv.includes("--write") ? join(root, "docs/images/live-latency.svg") : undefined });
  const { median, p99, worst } = told.latency_ms;
  alone ??= p99;
  const seen = Math.min(...told.seen);
  rows.push([`120 frames per second, recording, ROS 2, ${pages} page${pages > 1 ? "s" : ""}`, told.frames, told.lost + told.skipped, median, p99, worst, seen]);
  console.error(rows.at(-1).join("  "), pages > 1 ? `99 % within ${(p99 / alone).toFixed(2)} of what it is with one page` : "");
}
for (const rate of [500, 1000, 2000, 3000]) {
  const told = await measure({ emulate: [...touched, "--prerender", "480"], live: ["--rate", String(rate)] });
  const { median, p99, worst } = told.latency_ms;
  rows.push([`${rate} frames per second, prerendered`, told.frames, told.lost + told.skipped, median, p99, worst, ""]);
  console.error(rows.at(-1).join("  "));
}

const number = (value) => (typeof value === "number" && !Number.isInteger(value) ? value.toFixed(2) : String(value));
const table = [
  `On ${cpus().length} cores of ${cpus()[0].model.trim()}, ${seconds} s each (\`node bench/live/latency.mjs\`):`,
  "",
  "<!-- table: node bench/live/latency.mjs -->",
  "| load | frames | lost or dropped | latency from last byte to contacts: median, ms | 99th percentile, ms | longest, ms | frames received by the slowest page |",
  "|---|---|---|---|---|---|---|",
  ...rows.map((row) => `| ${row.map(number).join(" | ")} |`),
  "",
].join("\n");
console.log(table);
if (process.argv.includes("--write")) replaceTable(join(root, "docs/live.md"), "latency", table);
