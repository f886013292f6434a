// The built-in master presets, parameterizes and is refused; a foreign one is left alone.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, DEMO, LIMIT, openBench, openTab, RUN, until } from "./bench.mjs";

after(closeBrowser);

test("a preset tells what the position was and what it became", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  await page.locator("#drive-stop").click();
  await until(page, (on) => on.rpm === 0);
  await openTab(page, "master");
  await page.getByLabel("New position").fill("4711");
  await page.locator("#preset").click();
  await until(page, (on) => on.device.position === 4711);
  await page.locator("#preset-result", { hasText: /became 4.711/ }).waitFor();
});

test("parameters that the encoder takes are in force, and those that it refuses come back with the reason", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  await openTab(page, "master");
  const units = page.getByLabel("Units a turn");
  await units.fill("1000");
  await page.getByLabel("Units in all").fill("10000");
  await page.locator("#parameterize").click();
  await until(page, (on) => on.device?.measuring_units_per_revolution === 1000 && on.device.total_measuring_range === 10000);
  await units.fill("70000");
  await page.locator("#parameterize").click();
  const told = page.locator(".toast.refused");
  await told.waitFor();
  assert.match(await told.textContent(), /70000|65536|Prm_Fault|parameter/);
  await openTab(page, "journal");
  await page.locator("#journal > li.refused", { hasText: /octets 10-13/ }).first().waitFor();
});

test("with a master of the user's own the page says why it does not meddle", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  await openTab(page, "master");
  await page.getByRole("heading", { name: "The master is yours" }).waitFor();
  assert.equal(await page.locator("#preset").isVisible(), false);
});
