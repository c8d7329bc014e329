import assert from "node:assert/strict";
import { mkdtemp, readdir, readFile, rm } from "node:fs/promises";
import os from "node:os";
import path from "node:path";
import { test } from "node:test";
import { fileURLToPath } from "node:url";

import { buildInto, PAGE } from "../build.mjs";

const home = path.join(path.dirname(fileURLToPath(import.meta.url)), "..");

test("the committed page is what src/ builds, byte for byte", async () => {
  const fresh = await mkdtemp(path.join(os.tmpdir(), "viewer-"));
  try {
    await buildInto(fresh);
    const names = (await readdir(fresh)).sort();
    assert.deepEqual((await readdir(PAGE)).sort(), names);
    for (const name of names) {
      const [built, kept] = await Promise.all([fresh, PAGE].map((folder) => readFile(path.join(folder, name))));
      assert.ok(built.equals(kept), `${name} is old: npm run build`);
    }
  } finally {
    await rm(fresh, { recursive: true });
  }
});

test("the bundle is small and carries the licences of what it holds", async () => {
  const script = await readFile(path.join(PAGE, "viewer.js"), "utf8");
  const style = await readFile(path.join(PAGE, "viewer.css"), "utf8");
  console.log(`bundle: ${((script.length + style.length) / 1000).toFixed(0)} kB`);
  assert.ok(script.length + style.length < 700_000);
  for (const words of ["three.js authors", "Leon Sorokin", 'THE SOFTWARE IS PROVIDED "AS IS"']) assert.ok(script.includes(words), words);
  const { packages } = JSON.parse(await readFile(path.join(home, "package-lock.json"), "utf8"));
  const bundled = Object.entries(packages).filter(([name, { dev }]) => name && !dev).map(([name, { version }]) => `${name.replace("node_modules/", "")} ${version}`);
  assert.deepEqual(bundled, ["three 0.187.0", "uplot 1.6.32"], "THIRD-PARTY.md and the licences name what is bundled");
});

test("the page has no script of its own in the text and asks nobody else", async () => {
  const page = await readFile(path.join(PAGE, "index.html"), "utf8");
  assert.ok(!/<script(?![^>]*\bsrc=)/.test(page) && !/\son\w+=/.test(page));
  for (const [, address] of page.matchAll(/(?:src|href)="([^"]*)"/g)) assert.ok(!/^(\w+:)?\/\//.test(address), address);
});
