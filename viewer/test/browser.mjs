// A headless Chromium, drawn by software, for the tests and the pictures.

import { chromium } from "playwright-core";

export function openBrowser() {
  return chromium.launch({
    executablePath: process.env.CHROMIUM ?? "/usr/bin/chromium",
    args: ["--no-sandbox", "--enable-unsafe-swiftshader"],
  });
}

/**
 * Opens the page and waits for its first drawing; what it complains of is in `page.complaints`, what it
 * asked for in `page.asked`. `prepare` runs in the page before its own script.
 */
export async function openPage(browser, address, { prepare, ...settings } = {}) {
  const context = await browser.newContext({ viewport: { width: 1280, height: 800 }, ...settings });
  const page = await context.newPage();
  page.complaints = [];
  page.asked = [];
  page.on("request", (request) => page.asked.push(request.url()));
  page.on("pageerror", (error) => page.complaints.push(String(error)));
  page.on("console", (line) => {
    if (["error", "warning"].includes(line.type()) && !/GPU stall|ERR_CONNECTION|WebSocket connection/.test(line.text())) page.complaints.push(line.text());
  });
  if (prepare) await page.addInitScript(prepare);
  await page.goto(address);
  await page.waitForFunction(() => window.dermis?.drawn > 0 && window.dermis.status !== null);
  return page;
}
