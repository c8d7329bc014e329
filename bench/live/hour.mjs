// An hour of a touched skin, device and host in two programs, recording, publishing over ROS 2, with a page: what is lost, named or leaks.
// DERMIS names the program; --minutes N (60), --write puts the table into docs/live.md.

import { execFileSync, spawn } from "node:child_process";
import { cpus, tmpdir } from "node:os";
import { mkdtempSync, rmSync, statSync } from "node:fs";
import { createRequire } from "node:module";
import { createInterface } from "node:readline";
import { join } from "node:path";
import { replaceTable } from "./table.mjs";

const root = new URL("../..", import.meta.url).pathname;
const { WebSocket } = createRequire(join(root, "viewer/package.json"))("ws");
const dermis = process.env.DERMIS ?? join(root, "target/release/dermis");
const at = process.argv.indexOf("--minutes");
const minutes = at > 0 ? Number(process.argv[at + 1]) : 60;
const quarterMs = (minutes * 60e3) / 4;

/** The first match of a pattern in what a stream says. */
const said = (stream, pattern) =>
  new Promise((resolve) => {
    let text = "";
    stream.on("data", (more) => {
      text = (text + more).slice(-4000);
      const found = text.match(pattern);
      if (found) resolve(found[0]);
    });
  });

const folder = mkdtempSync(join(tmpdir(), "dermis-hour-"));
const emulator = spawn(dermis, ["emulate", "cylinder30", "--tcp", "127.0.0.1:0", "--touch", "random"]);
const source = await said(emulator.stdout, /tcp:\S+/);
const record = join(folder, "hour.mcap");
const args = ["live", "cylinder30", "--source", source, "--serve", "127.0.0.1:0", "--jsonl", "-", "--record", record, "--ros2"];
const host = spawn(dermis, [...args, "--for", String(minutes * 60)]);
let told = "";
host.stderr.on("data", (text) => (told += text));
const page = new WebSocket((await said(host.stderr, /http:\S+/)).replace("http", "ws") + "live");
page.on("message", () => {});
page.on("error", () => {});

const quarters = Array.from({ length: 4 }, () => ({ frames: 0, touched: 0, contacts: 0, lost: 0, named: new Set(), ms: [], kib: [] }));
const begun = Date.now();
const now = () => quarters[Math.min(3, Math.floor((Date.now() - begun) / quarterMs))];
const memory = setInterval(() => {
  try {
    now().kib.push(Number(execFileSync("ps", ["-o", "rss=", "-p", String(host.pid)])));
  } catch {
    clearInterval(memory);
  }
}, 5000);
let last;
let lostBefore = 0;
for await (const line of createInterface({ input: host.stdout })) {
  const frame = JSON.parse(line);
  const quarter = now();
  quarter.frames += 1;
  quarter.touched += frame.contacts.length > 0 ? 1 : 0;
  quarter.contacts = Math.max(quarter.contacts, ...frame.contacts.map((contact) => contact.id), 0);
  // A frame that came but is not told of was left out; one that did not come was lost.
  quarter.lost += last === undefined ? 0 : frame.sequence - last - 1;
  frame.bad_electrodes.forEach((electrode) => quarter.named.add(electrode));
  quarter.ms.push((frame.output_at - frame.received_at) * 1e-6);
  last = frame.sequence;
  lostBefore = frame.lost;
}
clearInterval(memory);
emulator.kill("SIGINT");
page.terminate();
const megabytes = statSync(record).size * 1e-6;
rmSync(folder, { recursive: true });

const mean = (values) => values.reduce((sum, value) => sum + value, 0) / Math.max(1, values.length);
const rows = quarters.map(({ frames, touched, contacts, lost, named, ms, kib }, index) => {
  ms.sort((a, b) => a - b);
  const of = (part) => (ms[Math.round((ms.length - 1) * part)] ?? NaN).toFixed(2);
  const [rss, most] = [mean(kib) / 1024, kib.reduce((a, b) => Math.max(a, b), 0) / 1024].map((mib) => mib.toFixed(1));
  return `| ${index + 1} | ${frames} | ${touched} | ${contacts} | ${lost} | ${[...named].join(", ") || "none"} | ${of(0.5)} | ${of(0.99)} | ${rss} | ${most} |`;
});
const table = [
  `On ${cpus().length} cores of ${cpus()[0].model.trim()}, ${minutes} minutes (\`node bench/live/hour.mjs\`), a recording of ${megabytes.toFixed(0)} MB, ${lostBefore} frames lost:`,
  "",
  "<!-- table: node bench/live/hour.mjs -->",
  "| quarter | frames | touched frames | contacts in total | lost or dropped | electrodes reported | latency from last byte to contacts: median, ms | 99th percentile, ms | memory, mean, MiB | memory, maximum, MiB |",
  "|---|---|---|---|---|---|---|---|---|---|",
  ...rows,
  "",
].join("\n");
console.log(table);
if (told.match(/warning|error/i)) console.error(told);
if (process.argv.includes("--write")) replaceTable(join(root, "docs/live.md"), "hour", table);
