// The page in a real browser against the simulated server.

import assert from "node:assert/strict";
import { test } from "node:test";

import { openPage } from "./browser.mjs";
import { browser, PHONE, until, wait, withPage } from "./pages.mjs";
import { startServer } from "./server.mjs";
import { LENGTH_M, onCylinder, RADIUS_M, scene, squareScene } from "./skin.mjs";

const project = (page, position) => page.evaluate((p) => window.dermis.project(p), position);
const projectFlat = (page, position) => page.evaluate((p) => window.dermis.projectFlat(p), position);
const apart = (a, b) => Math.hypot(...a.map((value, axis) => value - b[axis]));
const presses = (server) => server.commands.filter(({ do: what }) => what === "press");
const releases = (server) => server.commands.filter(({ do: what }) => what === "release");

/** Mean colour of a few pixels of the page as it is seen. */
async function colourAt(page, [x, y]) {
  const picture = await page.screenshot({ clip: { x: Math.round(x) - 1, y: Math.round(y) - 1, width: 3, height: 3 } });
  return meanColour(page, picture).then(({ mean }) => mean);
}

async function meanColour(page, picture) {
  return page.evaluate(async (base64) => {
    const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
    const bitmap = await createImageBitmap(new Blob([bytes], { type: "image/png" }));
    const pen = Object.assign(document.createElement("canvas"), { width: bitmap.width, height: bitmap.height }).getContext("2d");
    pen.drawImage(bitmap, 0, 0);
    const { data } = pen.getImageData(0, 0, bitmap.width, bitmap.height);
    const [sum, seen] = [[0, 0, 0], new Set()];
    for (let k = 0; k < data.length; k += 4) {
      for (let c = 0; c < 3; c += 1) sum[c] += data[k + c];
      seen.add((data[k] << 16) | (data[k + 1] << 8) | data[k + 2]);
    }
    return { mean: sum.map((channel) => (4 * channel) / data.length), colours: seen.size };
  }, picture.toString("base64"));
}

/** Measures milliseconds from the pointer going down to the first drawing of a frame with a contact, for `seen`. */
function watchPress(page) {
  return page.evaluate(() => {
    const down = new Promise((resolve) => window.addEventListener("pointerdown", resolve, { once: true, capture: true }));
    window.seen = down.then(
      () =>
        new Promise((resolve) => {
          const pressed = performance.now();
          const look = () => (window.dermis.frame.contacts.length > 0 ? resolve(performance.now() - pressed) : requestAnimationFrame(look));
          look();
        }),
    );
    return null;
  });
}

const isOrange = ([r, , b]) => r > b + 50;
const isGrey = ([r, , b]) => Math.abs(r - b) < 30;

withPage("the page draws both pictures and the charts", { server: { touches: () => [{ theta: 2.2, z: 0.15, force: 2 }] } }, async (page) => {
  await wait(600);
  for (const place of ["#skin", "#unrolled", '[data-chart="contacts"] canvas', '[data-chart="rate"] canvas', "#scale-bar"]) {
    const { colours } = await meanColour(page, await page.locator(place).screenshot());
    assert.ok(colours > 8, `${place} shows ${colours} colours`);
  }
  assert.equal(await page.textContent("#touched"), "touched");
  assert.equal(await page.textContent("#link"), "live");
  assert.match(await page.textContent("#source"), /emulator/);
  assert.match(await page.textContent("#scale-unit"), /%/);
});

const steady = { theta: 2.2, z: 0.15, force: 2.1 };
withPage("a contact has a label and keeps its colour while others come and go", { server: { touches: (t) => [steady, ...(t % 1 > 0.5 ? [{ theta: 4, z: 0.2, force: 1 }] : [])] } }, async (page) => {
  const ids = new Map();
  const others = new Set();
  for (let k = 0; k < 40; k += 1) {
    await wait(60);
    const labels = await page.$$eval("#skin-labels .label.contact", (found) => found.map((label) => [label.textContent, label.style.getPropertyValue("--ink")]));
    for (const [text, ink] of labels) {
      if (!text.endsWith("2.1 N")) others.add(text);
      else ids.set(text, (ids.get(text) ?? new Set()).add(ink));
    }
  }
  assert.ok(others.size > 1, "others came and went");
  assert.equal(ids.size, 1);
  const [[text, inks]] = ids;
  assert.match(text, /^#\d+ 2\.1 N$/);
  assert.equal(inks.size, 1, `colours ${[...inks]}`);
});

const oval = { theta: 2.2, z: 0.15, force: 2, form: { halfLengthM: 0.03, halfWidthM: 0.01, angle: 0.6 } };
const onSeam = { theta: 0.1, z: 0.08, force: 1, form: { halfLengthM: 0.025, halfWidthM: 0.005, angle: 0 } };
/** A point of the skin at these distances along and across the form of a touch. */
function pointOf({ theta, z, form: { angle } }, along, across) {
  const [cos, sin] = [Math.cos(angle), Math.sin(angle)];
  return onCylinder(theta + (along * cos - across * sin) / RADIUS_M, z + along * sin + across * cos);
}
withPage("the form of a contact is drawn in both views and across the seam, and its size is in the list", { server: { touches: () => [oval, onSeam, { theta: 4, z: 0.2, force: 1 }] } }, async (page) => {
  await until("the sizes", async () => (await page.$$eval("#contact-list .details", (found) => found.map((one) => one.textContent))).join("|") === "105, 150 · 60 × 20 mm|5, 80 · 50 × 10 mm|191, 200 mm · 98 %");
  const tips = await page.$$eval("#contact-list .contact-row", (rows) => rows.map((row) => row.title.split(",")[0].split(": ")[1]));
  assert.deepEqual(tips, ["length and width 60 × 20 mm", "length and width 50 × 10 mm", "length and width unknown"]);
  // The contact colours of the light theme: blue, then green.
  const isBlue = ([r, , b]) => r < 100 && b > 130;
  const isGreen = ([r, g]) => r < 100 && g > 100;
  for (const draw of [project, projectFlat]) {
    for (const [along, across] of [[0.03, 0], [-0.03, 0], [0, 0.01]]) {
      const seen = await colourAt(page, await draw(page, pointOf(oval, along, across)));
      assert.ok(isBlue(seen), `${draw.name} shows ${seen} at ${along}, ${across}`);
    }
      // There the oval of the opposite angle, and the circle of an unknown form, would be drawn.
    for (const [along, across] of [[0.03 * Math.cos(1.2), -0.03 * Math.sin(1.2)], [0, 0.0165]]) {
      const seen = await colourAt(page, await draw(page, pointOf(oval, along, across)));
      assert.ok(!isBlue(seen), `${draw.name} shows ${seen} at ${along}, ${across}`);
    }
  }
  for (const along of [-0.025, 0.025]) assert.ok(isGreen(await colourAt(page, await projectFlat(page, pointOf(onSeam, along, 0)))), `${along} along the form on the seam`);
});

const guide = { step: "press", position_m: onCylinder(5.5, 0.1), taken: 11, planned: 50, coverage: 0.41, reach_m: 0.02, errors: [[8, 0.0081], [12, 0.0042]], fitting: false, note: "" };
withPage("a guided session shows the place, the figures and its buttons", { server: { guide } }, async (page, server) => {
  await until("the instruction", async () => (await page.textContent("#guide-step")) === "Press here with about 2 N");
  assert.equal(await page.textContent("#guide-place"), "Place 12 of 50: z 100 mm, theta 315°");
  const figures = await page.$$eval("#guide dd", (found) => found.map((figure) => figure.textContent));
  assert.deepEqual(figures, ["11 / 50", "41 %", "4.20 mm"]);
  // The place is marked in both views; it was on the far side of the body.
  await wait(300);
  const isAccent = ([r, , b]) => b > r + 60;
  for (const place of [project, projectFlat]) assert.ok(isAccent(await colourAt(page, await place(page, guide.position_m))), `no mark: ${await colourAt(page, await place(page, guide.position_m))}`);
  const hit = await page.evaluate((pixel) => window.dermis.unproject(pixel), await project(page, guide.position_m));
  assert.ok(hit && apart(hit, guide.position_m) < 0.002, "the place can be pressed there");
  for (const action of ["skip", "redo", "finish"]) {
    await page.click(`#guide-${action}`);
    await until(action, () => server.commands.some((command) => command.do === "guide" && command.action === action));
  }
  Object.assign(guide, { step: "finished", position_m: null, taken: 50, coverage: 1 });
  await until("the end", async () => (await page.textContent("#guide-step")) === "The session has ended");
  assert.ok(await page.isDisabled("#guide-skip"));
  await server.close();
  await until("the banner", async () => /can be closed/.test(await page.textContent("#banner-text")));
});

withPage("without a guided session there is none on the page", {}, async (page) => {
  assert.equal(await page.isVisible("#guide"), false);
});

for (const [view, place] of [["skin", project], ["unrolled picture", projectFlat]])
  withPage(`a press with the mouse on the ${view} gives a contact there`, {}, async (page, server) => {
    for (const [theta, z] of [[2.4, 0.17], [1.9, 0.1], [2.9, 0.24]]) {
      const point = onCylinder(theta, z);
      const [x, y] = await place(page, point);
      const before = server.commands.length;
      await page.mouse.move(x, y);
      await watchPress(page);
      await page.mouse.down();
      await until("the press", () => server.commands.length > before);
      const command = server.commands.at(-1);
      assert.deepEqual([command.do, command.finger, command.force_n], ["press", 0, 2]);
      assert.ok(apart(command.position_m, point) < 0.002, `${1000 * apart(command.position_m, point)} mm off`);
      await until("the contact", () => page.evaluate((p) => window.dermis.frame.contacts.some((c) => Math.hypot(...c.position_m.map((v, k) => v - p[k])) < 0.002), point));
      console.log(`drawn ${(await page.evaluate(() => window.seen)).toFixed(0)} ms after the button went down (50 ms of them the simulated skin's)`);
      await wait(400);
      // Beside the cross, the pin and the ring there is room for the colour of a touch.
      const near = [[0.14, 0], [-0.14, 0], [0, 0.007], [0, -0.007]].map(([turn, up]) => onCylinder(theta + turn, z + up));
      const far = onCylinder(theta, z + (z > 0.15 ? -0.1 : 0.1));
      for (const draw of [project, projectFlat]) {
        const colours = [];
        for (const place of near) colours.push(await colourAt(page, await draw(page, place)));
        assert.ok(colours.filter(isOrange).length >= 2, `${draw.name} shows ${colours.join(" and ")} at the press`);
        const away = await colourAt(page, await draw(page, far));
        assert.ok(isGrey(away), `${draw.name} shows ${away} 100 mm away`);
      }
      await page.mouse.up();
      await until("the release", () => server.commands.at(-1).do === "release");
      await until("the end of the contact", () => page.evaluate(() => window.dermis.frame.contacts.length === 0));
    }
  });

withPage("a press follows the mouse, takes the force of the slider, and ends where the window is left", {}, async (page, server) => {
  const path = [0, 1, 2, 3, 4, 5].map((k) => onCylinder(2 + 0.15 * k, 0.12 + 0.01 * k));
  await page.mouse.move(...(await project(page, path[0])));
  await page.mouse.down();
  for (const point of path) {
    await page.mouse.move(...(await project(page, point)));
    await wait(80);
  }
  await until("the last place", () => presses(server).some(({ position_m }) => apart(position_m, path.at(-1)) < 0.002));
  await page.evaluate(() => {
    const slider = document.getElementById("force");
    slider.value = "3.5";
    slider.dispatchEvent(new Event("input", { bubbles: true }));
  });
  await until("the force", () => presses(server).at(-1).force_n === 3.5);
  await page.evaluate(() => window.dispatchEvent(new Event("blur")));
  await until("the release", () => releases(server).length === 1);
  await page.mouse.up();
});

withPage("a slide across the seam of the unrolled picture goes on at the other side", {}, async (page, server) => {
  const [left, y] = await projectFlat(page, onCylinder(0.05, 0.15));
  await page.mouse.move(left, y);
  await page.mouse.down();
  await page.mouse.move(left - 12, y);
  await until("the move", () => presses(server).length > 1);
  const [x, yy] = presses(server).at(-1).position_m;
  const theta = Math.atan2(yy, x);
  assert.ok(theta < 0 && theta > -0.4, `theta ${theta}`);
  await page.mouse.up();
});

withPage("dragging beside the skin or with the right button turns it, the wheel zooms, and nothing is pressed", {}, async (page, server) => {
  const point = onCylinder(2.2, 0.15);
  const box = await page.locator("#skin").boundingBox();
  const ends = async () => apart(await project(page, onCylinder(2.2, 0)), await project(page, onCylinder(2.2, LENGTH_M)));
  const size = await ends();
  const drags = [["left", [box.x + 30, box.y + 60]], ["right", await project(page, point)]];
  for (const [button, [x, y]] of drags) {
    const before = await project(page, point);
    await page.mouse.move(x, y);
    await page.mouse.down({ button });
    await page.mouse.move(x + 40, y + 10, { steps: 4 });
    await page.mouse.up({ button });
    assert.ok(apart(before, await project(page, point)) > 4, `${button} button`);
  }
  await page.mouse.wheel(0, -300);
  await until("the zoom", async () => (await ends()) > 1.2 * size);
  await page.click("#reset-view");
  await until("the first view", async () => Math.abs((await ends()) - size) < 1);
  assert.equal(server.commands.length, 0);
});

withPage("on a real device the left button turns", { server: { scene: scene({ emulated: false }) } }, async (page, server) => {
  const point = onCylinder(2.2, 0.15);
  const before = await project(page, point);
  await page.mouse.move(...before);
  await page.mouse.down();
  await page.mouse.move(before[0] + 40, before[1], { steps: 4 });
  await page.mouse.up();
  assert.ok((await project(page, point))[0] - before[0] > 8, "the body follows the pointer");
  await page.mouse.click(...(await projectFlat(page, point)));
  await wait(200);
  assert.equal(server.commands.length, 0);
  assert.equal(await page.isVisible("#force"), false);
});

withPage("the keyboard presses, turns and zooms", {}, async (page, server) => {
  await page.focus("#unrolled");
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("ArrowUp");
  await page.keyboard.press("Space");
  await until("the press", () => presses(server).length > 0);
  const width = 2 * Math.PI * RADIUS_M;
  const expected = onCylinder((width / 2 + 0.005) / RADIUS_M, 0.155);
  assert.ok(apart(presses(server)[0].position_m, expected) < 1e-6);
  await page.keyboard.press("ArrowUp");
  await until("the move", () => Math.abs((presses(server).at(-1)?.position_m[2] ?? 0) - 0.16) < 1e-6);
  await page.keyboard.press("Space");
  await until("the release", () => releases(server).length === 1);
  await page.focus("#skin");
  const before = await project(page, expected);
  await page.keyboard.press("ArrowLeft");
  assert.ok(apart(before, await project(page, expected)) > 2);
});

withPage("controls send their commands and show what the server answers", {}, async (page, server) => {
  const last = () => {
    const { at, ...command } = server.commands.at(-1) ?? {};
    return JSON.stringify(command);
  };
  const sends = (what) => until(what, () => last() === what);
  await page.click("#tare");
  await sends('{"do":"tare"}');
  await until("the message", async () => (await page.textContent("#message-list")).includes("tared over 100 frames"));
  await page.selectOption("#method", "noser");
  await sends('{"do":"method","name":"noser"}');
  await page.focus("#threshold");
  await page.keyboard.press("ArrowRight");
  await sends('{"do":"threshold","value":1.07}');
  await until("the value", async () => (await page.textContent("#threshold-value")) === "1.07 ×");
  await page.click("#record");
  await sends('{"do":"record","on":true}');
  await until("the recording", async () => /touch\.mcap: .*frames, .*B/.test(await page.textContent("#record-note")));
  assert.equal((await page.textContent("#record")).trim(), "Stop");
  await page.click("#record");
  await sends('{"do":"record","on":false}');
  await page.click("#pause");
  await sends('{"do":"pause","on":true}');
  await until("paused", async () => (await page.textContent("#link")) === "paused" && (await page.isVisible("#banner")));
  const { drawn } = await page.evaluate(() => ({ drawn: window.dermis.drawn }));
  await wait(500);
  assert.ok((await page.evaluate(() => window.dermis.drawn)) - drawn <= 1);
  await page.click("#pause");
  await sends('{"do":"pause","on":false}');
  await until("live", async () => (await page.textContent("#link")) === "live" && !(await page.isVisible("#banner")));
});

withPage("a recording that is played has a place, which a slider moves", { server: { playback: { time_s: 65, part: 0.5 } } }, async (page, server) => {
  await until("the place", async () => (await page.textContent("#seek-value")) === "1:05");
  assert.equal(await page.inputValue("#seek"), "0.5");
  await page.focus("#seek");
  await page.keyboard.press("Home");
  await until("the command", () => JSON.stringify(server.commands.at(-1) ?? {}).startsWith('{"do":"seek","part":0,'));
});

withPage("a refused command is shown, and the control returns to its value", { server: { refuses: "laplace" } }, async (page) => {
  await page.selectOption("#method", "laplace");
  await until("the refusal", () => page.isVisible("#refusal"));
  assert.match(await page.textContent("#refusal"), /Refused: no method is called `laplace`/);
  await until("the old method", async () => (await page.inputValue("#method")) === "best");
  await page.click("#refusal-close");
  assert.equal(await page.isVisible("#refusal"), false);
});

withPage("an electrode's state is shown by a symbol and a word, its number on hover", {}, async (page) => {
  assert.equal(await page.textContent("#electrode-summary"), "1 loose · 29 sound");
  const card = page.locator("#electrode-grid .electrode").nth(7);
  assert.equal(await card.textContent(), "7▲5.4 kΩloose");
  assert.equal(await page.textContent("#skin-labels .electrode.loose"), "7 loose");
  assert.match(await page.textContent("#message-list"), /warning:electrode 7 is loose/);
  // Electrode 16: ring 3, theta = 1.5 * 72 degrees.
  await page.mouse.move(...(await project(page, onCylinder(1.5 * 0.4 * Math.PI, 0.18))));
  await until("the label", () => page.isVisible("#skin-labels .hovered"));
  assert.match(await page.textContent("#skin-labels .hovered"), /^electrode 16: sound, 110 Ω/);
});

withPage("the page says that contacts are unknown, and shows none", { server: { touches: () => [steady] } }, async (page, server) => {
  await until("a contact", async () => (await page.textContent("#touched")) === "touched");
  for (const state of ["invalid", "stale"]) {
    server.state.validity = { state, text: `${state}: a reason` };
    await until("the banner", async () => (await page.textContent("#banner-text")) === `Contacts unknown. ${state}: a reason`);
    assert.equal(await page.textContent("#touched"), "unknown");
    assert.equal(await page.$eval("canvas", (canvas) => getComputedStyle(canvas).filter), "grayscale(1) opacity(0.35)");
    await until("no contacts", async () => (await page.textContent("#no-contacts")) === "Unknown." && (await page.isHidden("#contact-list li")));
    server.state.validity = { state: "ok", text: "ok" };
    await until("no banner", () => page.isHidden("#banner"));
  }
  server.state.validity = { state: "degraded", text: "degraded: 58 channels masked" };
  await until("the banner", async () => (await page.textContent("#banner-text")) === "degraded: 58 channels masked");
  await until("touched", async () => (await page.textContent("#touched")) === "touched");
});

test("the page reconnects after the server is killed, with growing waits", { timeout: 90_000 }, async () => {
  let server = await startServer();
  const { port } = server;
  const page = await openPage(browser, server.address);
  const attempts = [];
  page.on("websocket", () => attempts.push(performance.now()));
  const killed = performance.now();
  await server.close();
  await until("the banner", () => page.isVisible("#banner"));
  assert.match(await page.textContent("#banner"), /Disconnected/);
  assert.equal(await page.textContent("#touched"), "unknown");
  assert.equal(await page.isDisabled("#tare"), true);
  await until("four attempts", () => attempts.length >= 4, 15_000);
  const gaps = attempts.map((at, k) => at - (attempts[k - 1] ?? killed));
  console.log(`waits: ${gaps.map((gap) => gap.toFixed(0)).join(", ")} ms`);
  for (const [k, expected] of [250, 500, 1000, 2000].entries()) assert.ok(gaps[k] > 0.8 * expected && gaps[k] < expected + 1500, `wait ${k}: ${gaps[k]} ms`);
  server = await startServer({ port });
  await until("the connection", () => page.evaluate(() => window.dermis.connected), 9000);
  const before = await page.evaluate(() => window.dermis.drawn);
  await until("new drawings", async () => (await page.evaluate(() => window.dermis.drawn)) > before + 3);
  assert.equal(await page.isVisible("#banner"), false);
  assert.equal(await page.isDisabled("#tare"), false);
  const point = onCylinder(2.2, 0.15);
  await page.mouse.move(...(await project(page, point)));
  await page.mouse.down();
  await until("a contact", () => page.evaluate(() => window.dermis.frame.contacts.length === 1));
  await page.context().close();
  await server.close();
});

withPage("the page reconnects when the server sends nothing", {}, async (page, server) => {
  server.mute();
  await until("the banner", () => page.isVisible("#banner"), 12_000);
  await until("another attempt", () => server.addresses.length > 1);
});

withPage("the token of the page's address is passed to the WebSocket", { query: "?token=a%20b" }, async (_page, server) => {
  assert.deepEqual(server.addresses, ["/live?token=a%20b"]);
});

withPage("a slow page skips frames and builds no backlog", {}, async (page, server) => {
  await page.evaluate(() => {
    const end = performance.now() + 2500;
    while (performance.now() < end);
  });
  const read = () => page.evaluate(() => [window.dermis.frame.sequence, window.dermis.drawn]);
  const [missed, drawn] = await read();
  const ended = performance.now();
  assert.ok(server.sequence - missed > 200, "the page missed frames");
  await until("the newest frame", async () => server.sequence - (await read())[0] < 40, 3000);
  const [caught, later] = await read();
  console.log(`${caught - missed} frames caught up with by ${later - drawn} drawings in ${(performance.now() - ended).toFixed(0)} ms`);
  assert.ok(caught - missed > 2 * (later - drawn));
});

withPage("at least 20 drawings a second at 120 frames a second, drawn by software", { server: { touches: (t) => [{ theta: 2 + t, z: 0.15, force: 2 }, { theta: 4, z: 0.1 + 0.02 * Math.sin(t), force: 1 }] } }, async (page) => {
  await wait(2000);
  const rates = [];
  // Others may use the same cores meanwhile: the best of a few looks counts, and all are printed.
  for (let k = 0; k < 5 && !(rates.at(-1) >= 20); k += 1) {
    const read = () => page.evaluate(() => [window.dermis.drawn, performance.now()]);
    const [drawn, at] = await read();
    await wait(3000);
    const [later, then] = await read();
    rates.push((1000 * (later - drawn)) / (then - at));
  }
  const pixels = await page.$eval("#skin", (canvas) => `${canvas.width} x ${canvas.height}`);
  console.log(`drawn a second: ${rates.map((rate) => rate.toFixed(1)).join(", ")} (picture in space: ${pixels} pixels)`);
  assert.ok(Math.max(...rates) >= 20);
});

withPage("one finger presses, two rotate and zoom", { page: PHONE }, async (page, server) => {
  const touch = await page.context().newCDPSession(page);
  const send = (type, ...points) => touch.send("Input.dispatchTouchEvent", { type, touchPoints: points.map(([x, y], id) => ({ x, y, id })) });
  const [x, y] = await project(page, onCylinder(2.2, 0.15));
  await send("touchStart", [x, y]);
  await until("the press", () => presses(server).length > 0);
  await send("touchStart", [x, y], [x + 60, y]);
  await until("the release", () => releases(server).length === 1);
  const ends = async () => apart(await project(page, onCylinder(2.2, 0)), await project(page, onCylinder(2.2, LENGTH_M)));
  const [size, count] = [await ends(), presses(server).length];
  for (let k = 1; k <= 5; k += 1) await send("touchMove", [x - 6 * k, y], [x + 60 + 6 * k, y]);
  await send("touchEnd");
  assert.ok((await ends()) > 1.3 * size);
  assert.equal(presses(server).length, count);
});

const square = squareScene();
const bump = () => Float32Array.from(square.middles, ([x, y]) => 2 * Math.exp(-((x - 0.03) ** 2 + (y - 0.05) ** 2) / 0.0008));
const onSquare = { touches: () => [{ theta: 0, z: 0, force: 1 }], scene: square.scene, frame: bump };
withPage("a flat skin without a grid: image, press and unit are right", { server: onSquare }, async (page, server) => {
  await wait(500);
  for (const draw of [project, projectFlat]) {
    assert.ok(isOrange(await colourAt(page, await draw(page, [0.035, 0.055, 0]))), `${draw.name} at the touch`);
    for (const [x, y] of [[0.035, -0.055], [-0.035, 0.055]]) assert.ok(isGrey(await colourAt(page, await draw(page, [x, y, 0]))), `${draw.name} at ${x}, ${y}`);
    const point = [-0.03, 0.04, 0];
    await page.mouse.move(...(await draw(page, point)));
    const count = presses(server).length;
    await page.mouse.down();
    await until("the press", () => presses(server).length > count);
    assert.ok(apart(presses(server).at(-1).position_m, point) < 0.002);
    await page.mouse.up();
  }
  assert.equal(await page.textContent("#scale-unit"), "touch, N");
});

withPage("a body without a flat layout has no unrolled picture, and can be pressed", { server: { scene: scene({ surface: { kind: "free" }, unrolled: null }) } }, async (page, server) => {
  assert.equal(await page.isVisible("#unrolled"), false);
  const point = onCylinder(2.2, 0.15);
  await page.mouse.click(...(await project(page, point)));
  await until("the press", () => presses(server).length > 0);
  assert.ok(apart(presses(server)[0].position_m, point) < 0.002);
});

const noWebgl = () => {
  const make = HTMLCanvasElement.prototype.getContext;
  HTMLCanvasElement.prototype.getContext = function (kind, ...rest) {
    return kind.startsWith("webgl") ? null : make.call(this, kind, ...rest);
  };
};
test("without WebGL the unrolled picture still works, and the page says so", { timeout: 60_000 }, async () => {
  const server = await startServer({ touches: () => [steady] });
  const page = await openPage(browser, server.address, { prepare: noWebgl });
  assert.ok(await page.isVisible("#no-webgl"));
  await wait(500);
  assert.ok(isOrange(await colourAt(page, await projectFlat(page, onCylinder(steady.theta + 0.1, steady.z - 0.005)))));
  await page.context().close();
  await server.close();
});

withPage("light and dark follow the system, also while the page is open", {}, async (page) => {
  const brightness = async () => (await colourAt(page, await projectFlat(page, onCylinder(3, 0.15)))).reduce((a, b) => a + b) / 3;
  assert.ok((await brightness()) > 150);
  await page.emulateMedia({ colorScheme: "dark" });
  await wait(500);
  assert.ok((await brightness()) < 110);
});
