// The page of a robot in a real browser against a server that says what a robot says.

import assert from "node:assert/strict";
import http from "node:http";
import { readFile } from "node:fs/promises";
import path from "node:path";
import { test } from "node:test";
import { WebSocketServer } from "ws";

import { PAGE } from "../build.mjs";
import { browser, until } from "./pages.mjs";
import { POLICY } from "./server.mjs";

const TYPES = { ".html": "text/html; charset=utf-8", ".js": "text/javascript", ".css": "text/css" };
/** The unit pose, and one that is 0.5 m higher. */
const AT_BASE = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0];
const ABOVE = [1, 0, 0, 0, 1, 0, 0, 0, 1, 0, 0, 0.5];
/** Two sides of a plate round the origin of a link. */
const PLATE = [-0.1, 0, -0.1, 0.1, 0, -0.1, 0.1, 0, 0.1, -0.1, 0, -0.1, 0.1, 0, 0.1, -0.1, 0, 0.1];
const scene = { type: "scene", robot: "arm <b>", base: "base", parts: [{ link: "base", skin: null, corners_m: PLATE }, { link: "fore", skin: "sleeve", corners_m: PLATE }] };
const skin = (skin, zone, reason) => ({ skin, link: "fore", zone, reason, age_s: 0.008, rate_hz: 120 });

function status(change = {}) {
  const contact = { skin: "sleeve", link: "fore", id: 3, force_n: 2.5, position_base_m: [0, 0, 0.5], sd_base_m: 0.0012 };
  return {
    type: "status",
    snapshot: { touched: true, complete: false, skins: [skin("sleeve", "touched"), skin("palm", "unknown", "lost")], contacts: [contact], rules: { stop: { cause: "touched", skin: "sleeve" } }, joints_age_s: 0.01 },
    poses: { base: AT_BASE, fore: ABOVE },
    posed: true,
    reasons: { palm: "its device was lost" },
    messages: [{ level: "warning", text: "palm: <i>lost</i>", at_s: 1.7e9 }],
    ...change,
  };
}

async function startRobot() {
  const commands = [];
  const server = http.createServer(async (request, response) => {
    const name = new URL(request.url, "http://x").pathname.replace(/^\/$/, "/robot.html").slice(1);
    const body = await readFile(path.join(PAGE, name)).catch(() => null);
    if (!body) return response.writeHead(404).end();
    response.writeHead(200, { "content-type": TYPES[path.extname(name)], "content-security-policy": POLICY });
    response.end(body);
  });
  const sockets = new WebSocketServer({ server, path: "/live" });
  const tell = (message) => sockets.clients.forEach((client) => client.send(JSON.stringify(message)));
  sockets.on("connection", (socket) => {
    socket.on("message", (text) => commands.push(JSON.parse(text)));
    socket.send(JSON.stringify(scene));
    socket.send(JSON.stringify(status()));
  });
  await new Promise((resolve) => server.listen(0, "127.0.0.1", resolve));
  const close = () => {
    sockets.clients.forEach((client) => client.terminate());
    server.closeAllConnections();
    return new Promise((resolve) => server.close(resolve));
  };
  return { address: `http://127.0.0.1:${server.address().port}/`, commands, tell, close };
}

test("the page of a robot shows its skins, contacts and rules, and asks for a tare", async () => {
  const server = await startRobot();
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 } });
  const page = await context.newPage();
  const complaints = [];
  page.on("pageerror", (error) => complaints.push(String(error)));
  try {
    await page.goto(server.address);
    await page.waitForFunction(() => window.dermisRobot?.status);
    await until("the badge", async () => (await page.textContent("#touched")) === "touched");
    assert.equal(await page.textContent("#design"), "arm <b>", "names are text");
    const rows = await page.$$eval("#skin-list > li", (items) => items.map((item) => [item.dataset.zone, item.textContent]));
    assert.deepEqual(rows.map(([zone]) => zone), ["touched", "unknown"]);
    assert.match(rows[1][1], /its device was lost/);
    assert.match(await page.textContent("#contact-list"), /0, 0, 500 ± 1\.2 mm.*2\.5 N/);
    assert.match(await page.textContent("#rule-list"), /stop.*sleeve is touched/);
    assert.match(await page.textContent("#message-list"), /palm: <i>lost<\/i>/);
    // The contact is in the middle of the upper plate, where the ring is.
    const ring = await page.$eval(".robot-mark", (mark) => mark.getBoundingClientRect().toJSON());
    const at = await page.evaluate(() => window.dermisRobot.view.project([0, 0, 0.5]));
    const stage = await page.$eval("#robot", (canvas) => canvas.getBoundingClientRect().toJSON());
    assert.ok(Math.hypot(ring.x - stage.x - at[0], ring.y - stage.y - at[1]) < 1.5, `${ring.x} ${at}`);
    // Turned, it is elsewhere.
    await page.mouse.move(stage.x + 200, stage.y + 300);
    await page.mouse.down();
    await page.mouse.move(stage.x + 330, stage.y + 340, { steps: 5 });
    await page.mouse.up();
    const turned = await page.evaluate(() => window.dermisRobot.view.project([0.1, 0, 0.5]));
    assert.ok(Math.hypot(turned[0] - at[0], turned[1] - at[1]) > 3);
    await page.click('#skin-list button[data-skin="palm"]');
    await page.click("#tare");
    await until("both commands", () => server.commands.length >= 2);
    assert.deepEqual(server.commands.slice(0, 2), [{ do: "tare", skin: "palm" }, { do: "tare" }]);
    server.tell(status({ posed: false }));
    await until("the banner", () => page.isVisible("#robot-posed"));
    server.tell({ type: "refused", why: "the robot has no skin `x`" });
    await until("the refusal", () => page.isVisible("#refusal"));
    await server.close();
    await until("the end", async () => (await page.textContent("#touched")) === "unknown");
    assert.equal(await page.textContent("#link"), "disconnected");
    // Nothing of what was last said holds.
    const zones = () => page.$$eval("#skin-list > li", (items) => items.map((item) => item.dataset.zone));
    await until("the skins", async () => (await zones()).every((zone) => zone === "unknown"));
    assert.deepEqual([await page.textContent("#no-contacts"), await page.textContent("#no-rules")], ["Unknown.", "Unknown."]);
    assert.equal(await page.$$eval("#contact-list > li, #rule-list > li, .robot-mark", (items) => items.length), 0);
    assert.ok(await page.isDisabled("#tare"));
    assert.deepEqual(complaints, []);
  } finally {
    await context.close();
    await server.close().catch(() => {});
  }
});
