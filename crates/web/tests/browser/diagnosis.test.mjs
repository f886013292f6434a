// A fault is injected, its words are read, and words and octets point at each other.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, DEMO, encoder, LIMIT, openBench, openTab, RUN, until } from "./bench.mjs";

after(closeBrowser);

test("an undervoltage is an alarm in words, first of all, with what to do, and bit 1 of octet 8", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  await page.locator("#volts-number").fill("8.5");
  await page.keyboard.press("Enter");
  const first = page.locator("#words > li").first();
  await page.locator("#words > li.alarm", { hasText: "9 to 30 V" }).waitFor();
  assert.match(await first.textContent(), /supply is outside 9 to 30 V/);
  assert.equal(await first.locator(".level").textContent(), "Alarm");
  assert.notEqual(await first.locator(".advice").textContent(), "");
  const octets = (await encoder(page)).device.diagnosis.octets.split(" ");
  assert.equal(parseInt(octets[7], 16) & 2, 2); // manual 4.2.2
  await first.hover();
  const marked = page.locator("#diagnosis .octet.marked");
  assert.equal(await marked.first().getAttribute("title"), "Octet 8");
  await page.mouse.move(640, 20);
  assert.equal(await marked.count(), 0);
  await page.locator("#diagnosis .octet").nth(7).click();
  assert.ok((await first.getAttribute("class")).includes("marked"));
  // Octet 1 says two things here: that it is not ready, and that it reports a fault.
  await page.locator("#diagnosis .octet").nth(0).hover();
  assert.equal(await page.locator("#words > li.marked").count(), 2);
});

test("faults of the sensor and heat are counted, listed, and ended", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  await openTab(page, "faults");
  const list = page.locator("#active-faults > li");
  const before = await list.count();
  await page.locator("#fault-light").click();
  await page.locator("#words > li.warning").first().waitFor();
  await page.locator("#active-faults > li", { hasText: "light" }).waitFor();
  assert.equal(await page.locator("#badge-faults").textContent(), String(before + 1));
  await page.locator("#active-faults > li", { hasText: "light" }).getByRole("button").click();
  await page.waitForFunction((count) => document.querySelectorAll("#active-faults > li").length === count, before);
  await page.locator("#fault-sensor-once").click();
  await until(page, (on) => on.device.alarms.includes("position_error"));
  await page.locator("#words > li.alarm").first().waitFor();
});

test("a cut cable and noise are of the segment, and can be ended", LIMIT, async (t) => {
  const { page } = await openBench(t, [...RUN, "--encoder", "switches=06"]);
  await openTab(page, "faults");
  await page.locator("#fault-cut").click();
  await until(page, () => [...window.bench.store.segments.values()][0].cable.cut_after === 1);
  await page.locator("#fault-noise").click();
  await until(page, () => [...window.bench.store.segments.values()][0].line !== null);
  assert.equal(await page.locator("#active-faults > li").count() >= 2, true);
  await page.locator("#active-faults > li", { hasText: "cut" }).getByRole("button").click();
  await until(page, () => [...window.bench.store.segments.values()][0].cable.cut_after === null);
});

test("what the program refuses is said with its reason", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  await page.locator("#volts-number").fill("850");
  await page.keyboard.press("Enter");
  const told = page.locator(".toast.refused");
  await told.waitFor();
  assert.match(await told.textContent(), /from -100 to 100/);
  await told.getByRole("button").click();
  assert.equal(await told.count(), 0);
});
