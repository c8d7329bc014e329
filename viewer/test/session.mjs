// A guided calibration session on a real `dermis calibrate --live`: the emulated skin is pressed with the mouse where the page
// says so. DERMIS names the program.
//
//   node test/session.mjs                       10 presses; ends with 0 if all holds
//   node test/session.mjs --study [DESIGN]...   50 presses on the twin `lab` with "about 2 N": 1.5 to 2.5 N; the calibration is
//                                               scored on other presses, beside calibrations with 50 simulated presses at
//                                               random places; all presses have such forces. FOLDER keeps the files, and
//                                               simulated presses that it has are used

import assert from "node:assert/strict";
import { execFileSync, spawn } from "node:child_process";
import { once } from "node:events";
import { existsSync, mkdirSync, mkdtempSync, readFileSync, rmSync, writeFileSync } from "node:fs";
import { tmpdir } from "node:os";
import path from "node:path";
import { fileURLToPath } from "node:url";

import { openBrowser, openPage } from "./browser.mjs";

const dermis = path.resolve(process.env.DERMIS ?? "../target/release/dermis");
const kept = process.env.FOLDER;
if (kept) mkdirSync(kept, { recursive: true });
const folder = kept ? path.resolve(kept) : mkdtempSync(path.join(tmpdir(), "dermis-session-"));
const run = (...args) => execFileSync(dermis, args, { cwd: folder, encoding: "utf8", stdio: ["ignore", "pipe", "pipe"] });
const seed = 71;
const LEAST_N = 1.5;
const MOST_N = 2.5;
const lab = readFileSync(path.join(path.dirname(fileURLToPath(import.meta.url)), "../../dermis-sim/twins/lab.toml"), "utf8");
/** The touch of an emulated membrane, which patches cannot model: `TwinOptions::made_of`. */
const MEMBRANE = "[touch.gaussian]\namplitude_per_n = 0.1\nwidth_m = 0.008\n\n[press]";

/** Writes the twin `lab` with the forces of a person; returns its file. */
function twin(design) {
  const forces = lab.replace(/least_force_n = \S+/, `least_force_n = ${LEAST_N}`).replace(/greatest_force_n = \S+/, `greatest_force_n = ${MOST_N}`);
  const touch = design === "cylinder30" ? forces : forces.replace(/\[touch\.patches\][^]*\[press\]/, MEMBRANE);
  writeFileSync(path.join(folder, `${design}.twin.toml`), touch);
  return `${design}.twin.toml`;
}

async function until(what, seconds, holds) {
  const begun = performance.now();
  for (;;) {
    const found = await holds();
    if (found) return found;
    if (performance.now() - begun > 1000 * seconds) throw new Error(`${what}: not within ${seconds} s`);
    await new Promise((done) => setTimeout(done, 20));
  }
}

/** Runs a session in a browser; `each(page, presses)` is called before each press. The answer is what the program prints. */
async function session(browser, design, presses, output, each = async () => {}) {
  const args = ["calibrate", design, "--live", "--presses", `${presses}`, "-o", output, "--twin", twin(design), "--seed", `${seed}`, "--serve", "127.0.0.1:0", "--json"];
  const live = spawn(dermis, args, { cwd: folder, stdio: ["pipe", "pipe", "pipe"] });
  let [told, printed] = ["", ""];
  live.stderr.on("data", (text) => (told += text));
  live.stdout.on("data", (text) => (printed += text));
  let code = null;
  live.on("exit", (status) => (code = status));
  try {
    const address = await until("the viewer's address", 60, () => told.match(/http:\S+/)?.[0]);
    const page = await openPage(browser, address);
    const guide = () => page.evaluate(() => window.dermis.status.guide);
    const step = (...names) => until(names.join(" or "), 60, async () => {
      const found = await guide();
      return code !== null || names.includes(found.step) ? found : null;
    });
    for (;;) {
      const asked = await step("press", "fit", "finished");
      if (asked.step !== "press") break;
      if ((await each(page, asked)) === "again") continue;
      const place = asked.position_m;
      const [x, y] = await page.evaluate((at) => (window.dermis.scene.unrolled ? window.dermis.projectFlat(at) : window.dermis.project(at)), place);
      await page.mouse.move(x, y);
      await page.mouse.down();
      await step("lift", "fit", "finished");
      await page.mouse.up();
      await until("the next place", 30, async () => code !== null || (({ step: now, taken }) => taken > asked.taken && now !== "lift")(await guide()));
    }
    await until("the end of the program", 120, () => code !== null);
    assert.equal(code, 0, told);
    assert.deepEqual(page.complaints, []);
    await page.context().close();
    return { ...JSON.parse(printed), told };
  } catch (error) {
    error.message += `\n${told}`;
    throw error;
  } finally {
    if (code === null) {
      live.kill("SIGKILL");
      await once(live, "exit");
    }
  }
}

/** Ten presses, with the buttons, an interruption and a continuation. */
async function short(browser) {
  const used = new Set();
  const once = (name, doIt) => used.has(name) || (used.add(name), doIt());
  const buttons = async (page, { taken, position_m: place }) => {
    const click = async (name) => {
      await page.click(`#guide-${name}`);
      await until(name, 10, () => page.evaluate((at) => `${window.dermis.status.guide.position_m}` !== `${at}`, place));
      return "again";
    };
    if (taken === 2 && !used.has("redo")) return used.add("redo"), click("redo");
    if (taken === 3 && !used.has("skip")) return used.add("skip"), click("skip");
    if (taken === 4) return page.click("#guide-finish"), until("the end", 30, () => page.evaluate(() => window.dermis.status.guide.step !== "press")).then(() => "again");
    if (process.env.SCREENSHOT && taken === 9) await page.screenshot({ path: process.env.SCREENSHOT });
    return undefined;
  };
  const first = await session(browser, "skin16", 10, "short", buttons);
  assert.deepEqual([first.presses, first.left, first.quality], [4, 5, null]);
  const second = await session(browser, "skin16", 10, "short", async (page, { taken }) => {
    if (process.env.SCREENSHOT && taken === 9) await page.screenshot({ path: process.env.SCREENSHOT });
  });
  assert.deepEqual([second.presses, second.left, second.coverage], [10, 0, 1]);
  assert.ok(second.quality.mean_error_m < 0.03, `${second.quality.mean_error_m} m`);
  // The files give the same calibration. Where so few presses are worse than none the session has said so, and files need a word.
  const again = ["calibrate", "skin16", "--frames", "short/frames.csv", "--difference", "--truth", "short/presses.csv", "-o", "again"];
  if (second.told.includes("without a calibration")) {
    assert.throws(() => run(...again), (error) => error.status === 2 && error.stderr.includes("without a calibration"));
    again.push("--force");
  }
  run(...again);
  for (const name of ["calibration.json", "weights.npy", "presses.npy"]) {
    assert.ok(readFileSync(path.join(folder, "short", name)).equals(readFileSync(path.join(folder, "again", name))), name);
  }
  console.log(`10 presses: mean error ${(1000 * second.quality.mean_error_m).toFixed(2)} mm by cross-validation`);
}

/** Fifty presses, scored on random presses of the same twin that no calibration has seen. */
async function study(browser, design) {
  const begun = performance.now();
  let number = 0;
  // A low-discrepancy sequence (multiples of the golden ratio), so that every run is the same.
  const press = (page) => {
    number += 1;
    const force = LEAST_N + (MOST_N - LEAST_N) * ((number * 0.618034) % 1);
    return page.$eval("#force", (slider, value) => ((slider.value = value), slider.dispatchEvent(new Event("input"))) && undefined, `${force}`);
  };
  rmSync(path.join(folder, design), { recursive: true, force: true });
  const { quality, coverage } = await session(browser, design, 50, design, press);
  const seconds = (performance.now() - begun) / 1000;
  if (!existsSync(path.join(folder, `${design}-exp`))) run("experiment", design, "--twin", twin(design), "--seed", `${seed}`, "-o", `${design}-exp`);
  const recorded = [design, "--frames", `${design}-exp/random/frames.npy`, "--baseline", `${design}-exp/random/baseline.npy`, "--truth", `${design}-exp/random/truth.csv`];
  const evaluated = (method) => JSON.parse(run("evaluate", ...recorded, "--method", method, "--rows", "400..900", "--json"));
  const score = (method) => 1000 * evaluated(method).localisation_m.mean;
  const [own, { covered }] = [score(`./${design}`), evaluated(`./${design}`)];
  const others = [0, 50, 100].map((from) => {
    run("calibrate", ...recorded, "--labels", `${from}..${from + 50}`, "-o", `${design}-${from}`);
    return score(`./${design}-${from}`);
  });
  const mean = others.reduce((sum, error) => sum + error, 0) / others.length;
  console.log("| skin | session, s | coverage | error by cross-validation, mm | error on 500 other presses, mm | 95 % regions hold | error with 50 simulated presses at random places, mm | ratio |");
  console.log("|---|---|---|---|---|---|---|---|");
  console.log(`| \`${design}\` | ${seconds.toFixed(0)} | ${(100 * coverage).toFixed(0)} % | ${(1000 * quality.mean_error_m).toFixed(2)} | ${own.toFixed(2)} | ${(100 * covered).toFixed(1)} % | ${others.map((error) => error.toFixed(2)).join(", ")} | ${(own / mean).toFixed(2)} |`);
  assert.ok(own < 1.2 * mean, `${own} mm in the session, ${mean} mm otherwise`);
}

const browser = await openBrowser();
try {
  const designs = process.argv.slice(3);
  if (process.argv[2] === "--study") for (const design of designs.length > 0 ? designs : ["skin16"]) await study(browser, design);
  else await short(browser);
} finally {
  await browser.close();
  if (!kept) rmSync(folder, { recursive: true });
}
