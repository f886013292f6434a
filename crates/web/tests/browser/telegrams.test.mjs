// Telegrams scroll by, are filtered and held, and a field points at its octets.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, DEMO, LIMIT, openBench, openTab, until } from "./bench.mjs";

after(closeBrowser);

test("telegrams pass, are held and filtered, and a click on a field marks its octets", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  const rows = page.locator(".telegram:not(.empty)");
  await rows.nth(5).waitFor();
  await page.locator("#telegram-filter").fill("Data_Exchange");
  await page.waitForTimeout(600);
  await page.locator("#telegram-pause").click();
  // The newest stay in sight, however fast they come.
  const lag = await page.evaluate(() => {
    const list = document.querySelector("#telegrams");
    return list.scrollHeight - list.clientHeight - list.scrollTop;
  });
  assert.ok(lag < 30, `the list ends ${lag} px below what is shown`);
  const numbers = () => page.locator(".telegram:not(.empty) .t-n").allTextContents();
  const held = await numbers();
  await page.waitForTimeout(500);
  assert.deepEqual(await numbers(), held, "held telegrams do not move");
  assert.match(await page.locator("#telegram-count").textContent(), /\d wait$/);
  await page.locator(".telegram.reply:not(.empty)").first().click();
  const field = page.locator("#telegram-detail .field-row", { hasText: /position/i }).first();
  await field.click();
  const marked = await page.locator("#telegram-detail .octet.marked").evaluateAll((cells) => cells.map((cell) => cell.title));
  // SD2 head of four octets, DA, SA, FC; the position is the first four octets behind (manual 4.3.3).
  assert.deepEqual(marked, ["Octet 8", "Octet 9", "Octet 10", "Octet 11"]);
  await page.mouse.move(640, 20);
  await page.locator("#telegram-detail .octet").nth(4).click();
  assert.equal(await page.locator("#telegram-detail .field-row.marked").count(), 1);
  await page.locator("#telegram-pause").click();
  await page.waitForFunction((was) => document.querySelector(".telegram .t-n").textContent !== was, held[0]);
});

test("only the rows in sight exist, and the arrow keys walk through the list", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await page.waitForFunction(() => parseInt(document.querySelector("#telegram-count").textContent.replaceAll(/\s/g, ""), 10) > 60);
  assert.ok((await page.locator(".telegram").count()) < 40);
  await page.locator("#telegrams").focus();
  await page.keyboard.press("ArrowUp");
  await page.locator(".telegram.chosen").waitFor();
  assert.ok((await page.locator("#telegram-detail .octet").count()) > 0);
});

test("the bus lists its stations with state, owner and rate", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  await openTab(page, "bus");
  const row = page.locator("#panel-bus tr.selected");
  await row.locator("td", { hasText: "exchanges data" }).waitFor();
  assert.equal(await row.locator("td").nth(3).textContent(), "2");
  assert.match(await row.locator("td").nth(4).textContent(), /bit\/s$/);
});
