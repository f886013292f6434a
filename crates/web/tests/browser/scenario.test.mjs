// A scenario is chosen and played, and its expectations are watched.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, LIMIT, openBench, openTab, RUN, until } from "./bench.mjs";

after(closeBrowser);

test("a scenario plays to its end, its expectations hold, and what was there before comes back", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  await openTab(page, "scenarios");
  await page.locator("[data-scenario*=hoist]").click();
  await page.getByLabel("Speed", { exact: true }).last().selectOption("10");
  await page.locator("#scenario-play").click();
  await page.waitForFunction(() => window.bench.store.stage.kind === "scenario");
  await until(page, (on) => on.device?.state === "data_exchange");
  await page.locator("#verdict", { hasText: "all expectations hold" }).waitFor();
  assert.equal(await page.locator("#expectations > li").count(), await page.locator("#expectations > li.held").count());
  assert.equal(await page.locator("#expectations > li").count(), 4);
  await page.getByRole("button", { name: "Back to the bench" }).click();
  await page.waitForFunction(() => window.bench.store.stage.kind === "run");
});

test("a scenario can be stopped", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  await openTab(page, "scenarios");
  await page.locator("[data-scenario*=draw-works]").click();
  await page.locator("#scenario-play").click();
  await page.waitForFunction(() => window.bench.store.stage.playing?.state === "playing");
  await page.locator("#scenario-stop").click();
  await page.waitForFunction(() => window.bench.store.stage.kind === "run");
});
