// The layout of the page on screens of several sizes.

import assert from "node:assert/strict";

import { PHONE, until, withPage } from "./pages.mjs";
import { scene } from "./skin.mjs";

const steady = { theta: 2.2, z: 0.15, force: 2.1 };
withPage("a phone shows one column, nothing wider than the screen, large buttons", { page: PHONE, server: { touches: () => [steady] } }, async (page) => {
  assert.ok((await page.evaluate(() => document.scrollingElement.scrollWidth)) <= 360);
  const wide = await page.$$eval("body *", (all) => all.filter((one) => !one.closest(".labels") && one.getBoundingClientRect().right > 360.5).map((one) => one.id || one.className));
  assert.deepEqual(wide, []);
  for (const id of ["tare", "pause", "record"]) assert.ok((await page.locator(`#${id}`).boundingBox()).height >= 44);
});

const extremes = [0.0039, 100, 5432, 81234, 1.23e6, 310.5];
const faults = scene().electrodes.map((_, k) => ({ state: { 6: "open", 8: "loose", 17: "doubtful" }[k] ?? "sound", contact_ohm: extremes[k % extremes.length], noise: 1 }));
for (const [width, height] of [[320, 640], [360, 740], [390, 844], [1280, 800]])
  withPage(`the text fits its box on a screen ${width} pixels wide`, { page: { viewport: { width, height } }, server: { electrodes: faults } }, async (page) => {
    await until("the state", async () => (await page.textContent("#touched")) === "untouched");
    const overflow = await page.$$eval("#touched, #electrode-grid .electrode *", (boxes) =>
      boxes.filter((box) => box.textContent !== "").flatMap((box) => {
        const text = document.createRange();
        text.selectNodeContents(box);
        const [inner, outer] = [text.getBoundingClientRect(), box.closest("#touched, .electrode").getBoundingClientRect()];
        return inner.left < outer.left + 2 || inner.right > outer.right - 2 ? [box.textContent] : [];
      }));
    assert.deepEqual(overflow, []);
    assert.ok((await page.evaluate(() => document.scrollingElement.scrollWidth)) <= width);
  });

/** Keeps the words that each canvas shows since it was last cleared, with their boxes, in `window.words`. */
const keepWords = () => {
  window.words = new Map();
  const { clearRect, fillText } = CanvasRenderingContext2D.prototype;
  CanvasRenderingContext2D.prototype.clearRect = function (...box) {
    window.words.set(this.canvas, []);
    clearRect.apply(this, box);
  };
  CanvasRenderingContext2D.prototype.fillText = function (text, x, y) {
    const size = this.measureText(text);
    const box = { left: x - size.actualBoundingBoxLeft, right: x + size.actualBoundingBoxRight, top: y - size.actualBoundingBoxAscent, bottom: y + size.actualBoundingBoxDescent };
    window.words.get(this.canvas)?.push({ text, ...box });
    fillText.call(this, text, x, y);
  };
};
const alike = [0.2, 1.2, 2.2, 3.2, 4.2, 5.2].map((theta) => ({ theta, z: 0.15, force: 2 }));
for (const [width, height] of [[320, 640], [390, 844], [1280, 800]])
  withPage(`names in the chart of contacts do not overlap on a screen ${width} pixels wide`, { page: { viewport: { width, height } }, server: { touches: () => alike }, prepare: keepWords }, async (page) => {
    const read = () => page.$eval('[data-chart="contacts"] canvas', (canvas) => ({ words: window.words.get(canvas).filter(({ text }) => text.startsWith("#")), width: canvas.width, height: canvas.height }));
    await until("the names", async () => (await read()).words.length === alike.length);
    const { words, ...size } = await read();
    for (const [k, one] of words.entries()) {
      assert.ok(one.left >= 0 && one.top >= 0 && one.right <= size.width && one.bottom <= size.height, `${one.text} is outside`);
      for (const other of words.slice(0, k)) {
        const overlaps = one.left < other.right && other.left < one.right && one.top < other.bottom && other.top < one.bottom;
        assert.ok(!overlaps, `${one.text} covers ${other.text}`);
      }
    }
  });
