// Pictures of the page in its states, into test/pictures/: npm run screenshots

import { mkdir } from "node:fs/promises";
import path from "node:path";
import { fileURLToPath } from "node:url";

import { openBrowser, openPage } from "./browser.mjs";
import { startServer } from "./server.mjs";
import { squareScene } from "./skin.mjs";

const folder = path.join(path.dirname(fileURLToPath(import.meta.url)), "pictures");
await mkdir(folder, { recursive: true });
const only = process.argv[2];

const several = (t) => [
  { theta: 1.5 + 0.3 * Math.sin(0.8 * t), z: 0.2 + 0.03 * Math.sin(t), force: 2.4 + 0.8 * Math.sin(1.3 * t) },
  { theta: 2.9, z: 0.09, force: 1.3 + 0.5 * Math.sin(0.9 * t) },
  { theta: 5.8, z: 0.22, force: 0.9 },
  ...(t % 6 > 3 ? [{ theta: 0.1, z: 0.12, force: 1.1 }] : []),
];
const phone = { viewport: { width: 360, height: 740 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };
const session = {
  step: "press",
  position_m: [0.0477 * Math.cos(5.5), 0.0477 * Math.sin(5.5), 0.21],
  taken: 31,
  planned: 50,
  coverage: 0.74,
  reach_m: 0.018,
  errors: [[8, 0.019], [12, 0.0131], [16, 0.0094], [20, 0.0087], [24, 0.0066], [28, 0.0062]],
  fitting: false,
  note: "",
};
const square = squareScene();
const bump = (touches, sequence) =>
  Float32Array.from(square.middles, ([x, y]) => 2 * Math.exp(-((x - 0.03) ** 2 + (y - 0.05) ** 2) / 0.0008) + 0.03 * Math.sin(x * 1e5 + sequence));

const pictures = {
  light: { server: { touches: several }, wait: 9000 },
  dark: { server: { touches: several }, page: { colorScheme: "dark" }, wait: 9000 },
  rest: { server: {}, wait: 3000 },
  "rest-dark": { server: {}, page: { colorScheme: "dark" }, wait: 3000 },
  phone: { server: { touches: several }, page: phone, wait: 3000 },
  "phone-below": { server: { touches: several }, page: phone, wait: 3000, after: async (page) => (await page.evaluate(() => scrollTo(0, 700)), page.waitForTimeout(800)) },
  "phone-dark": { server: { touches: several }, page: { ...phone, colorScheme: "dark" }, wait: 2000 },
  tablet: { server: { touches: several }, page: { viewport: { width: 900, height: 1100 } }, wait: 3000, whole: true },
  large: { server: { touches: several }, page: { viewport: { width: 1920, height: 1080 } }, wait: 4000 },
  faults: {
    server: {
      touches: several,
      electrodes: Array.from({ length: 30 }, (_, k) => ({ state: { 6: "open", 8: "loose", 17: "doubtful", 22: "loose" }[k] ?? "sound", contact_ohm: k === 6 ? null : ({ 8: 5400, 22: 81234, 17: 310 }[k] ?? 100 + (k % 7)), noise: 1 })),
    },
    wait: 2500,
    after: async (page) => {
      await page.click("#numbers");
      await page.click("#record");
      await page.waitForTimeout(600);
    },
  },
  pressing: {
    server: {},
    wait: 2000,
    after: async (page) => {
      const [x, y] = await page.evaluate(() => window.dermis.project([0.0477 * Math.cos(2.4), 0.0477 * Math.sin(2.4), 0.17]));
      await page.mouse.move(x, y);
      await page.mouse.down();
      await page.waitForTimeout(700);
    },
  },
  square: { server: { touches: () => [{ theta: 0.5, z: 0, force: 2 }], scene: square.scene, frame: bump, electrodes: square.scene.electrodes.map(() => ({ state: "sound", contact_ohm: 100, noise: 1 })) }, wait: 2000 },
  guide: { server: { guide: session }, page: { viewport: { width: 1280, height: 800 } }, wait: 2000 },
  "guide-dark": { server: { guide: session }, page: { colorScheme: "dark" }, wait: 2000 },
  "guide-tablet": { server: { guide: { ...session, step: "lift", position_m: null } }, page: { viewport: { width: 900, height: 1100 } }, wait: 2000 },
  "guide-phone": { server: { guide: session }, page: { ...phone, viewport: { width: 390, height: 844 } }, wait: 2000 },
  paused: { server: { touches: several }, wait: 2500, after: async (page) => (await page.click("#pause"), page.waitForTimeout(500)) },
  disconnected: { server: { touches: several }, wait: 4000, after: async (page, server) => (await server.close(), page.waitForTimeout(2600)) },
};

const browser = await openBrowser();
for (const [name, { server: options, page: settings, wait, after, whole }] of Object.entries(pictures)) {
  if (only && !only.split(",").includes(name)) continue;
  const server = await startServer(options);
  const page = await openPage(browser, server.address, settings);
  await page.waitForTimeout(wait);
  await after?.(page, server);
  await page.screenshot({ path: path.join(folder, `${name}.png`), fullPage: whole ?? false });
  console.log(name, page.complaints.join(" | "));
  await page.context().close();
  await server.close();
}
await browser.close();
