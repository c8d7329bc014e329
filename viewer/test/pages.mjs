// Pages for the tests: a browser for each file of tests, a server and a page for each test.

import assert from "node:assert/strict";
import { after, before, test } from "node:test";

import { openBrowser, openPage } from "./browser.mjs";
import { startServer } from "./server.mjs";

export const PHONE = { viewport: { width: 360, height: 740 }, deviceScaleFactor: 2, isMobile: true, hasTouch: true };

export let browser;
before(async () => (browser = await openBrowser()));
after(() => browser?.close());

/** Runs a test against a server and a page of its own; in the end the page has complained of nothing. */
export function withPage(name, { server: options, page: settings, query = "", prepare } = {}, body) {
  test(name, { timeout: 90_000 }, async () => {
    const server = await startServer(options);
    let page;
    try {
      page = await openPage(browser, server.address + query, { ...settings, prepare });
      await body(page, server);
      assert.deepEqual(page.complaints, []);
      for (const address of page.asked) assert.ok(address.startsWith(server.address) || address.startsWith("data:"), `the page asked ${address}`);
    } finally {
      await page?.context().close();
      await server.close();
    }
  });
}

export const wait = (ms) => new Promise((resolve) => setTimeout(resolve, ms));

export async function until(what, check, limitMs = 8000) {
  const end = performance.now() + limitMs;
  while (performance.now() < end) {
    if (await check()) return;
    await wait(20);
  }
  assert.fail(`${what} did not come within ${limitMs / 1000} s`);
}
