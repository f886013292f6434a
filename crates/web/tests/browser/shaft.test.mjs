// The shaft is dragged, turned with keys and driven; the charts move with it.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, DEMO, encoder, LIMIT, openBench, RUN, until } from "./bench.mjs";

after(closeBrowser);

test("dragging the dial by a quarter turn clockwise moves the shaft by a quarter turn", LIMIT, async (t) => {
  const { page } = await openBench(t, [...RUN, "--shaft", "still@100000"]);
  const face = await page.locator(".dial .face").boundingBox();
  const [x, y, r] = [face.x + face.width / 2, face.y + face.height / 2, face.width / 2 - 10];
  await page.mouse.move(x, y - r);
  await page.mouse.down();
  for (let step = 1; step <= 15; step++) {
    const angle = (step / 15) * (Math.PI / 2);
    await page.mouse.move(x + r * Math.sin(angle), y - r * Math.cos(angle));
  }
  await page.mouse.up();
  // A pixel at the rim is less than 200 counts of 65536.
  await until(page, (on) => Math.abs(on.shaft_position - 100000 - 16384) < 400);
  assert.match((await encoder(page)).shaft, /^still@/);
});

test("arrow keys turn by a 64th, with Shift by one count, Page keys by a turn, Home to zero", LIMIT, async (t) => {
  const { page } = await openBench(t, [...RUN, "--shaft", "still@100000"]);
  await page.getByRole("slider", { name: "Shaft", exact: true }).focus();
  await page.keyboard.press("ArrowRight");
  await until(page, (on) => on.shaft_position === 101024);
  await page.waitForTimeout(700);
  await page.keyboard.press("Shift+ArrowLeft");
  await until(page, (on) => on.shaft_position === 101023);
  await page.waitForTimeout(700);
  await page.keyboard.press("PageUp");
  await until(page, (on) => on.shaft_position === 166559);
  await page.keyboard.press("Home");
  await until(page, (on) => on.shaft_position === 0);
});

test("movements start and stop, and the speed slider drives", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  await page.getByLabel("Movement").selectOption("hoist");
  await page.locator("#drive-start").click();
  await until(page, (on) => on.shaft.startsWith("hoist") && on.rpm !== 0);
  await page.locator("#drive-stop").click();
  await until(page, (on) => on.shaft.startsWith("still") && on.rpm === 0);
  await page.locator("#speed").focus();
  for (let i = 0; i < 30; i++) await page.keyboard.press("ArrowRight");
  await until(page, (on) => on.rpm > 30);
  assert.match(await page.locator("#shaft-rpm").textContent(), /RPM$/);
});

test("the charts show what moves, and scroll between two snapshots", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  await page.locator("#speed").focus();
  for (let i = 0; i < 30; i++) await page.keyboard.press("ArrowRight");
  await until(page, (on) => on.rpm > 30 && on.device.velocity !== 0);
  const value = page.locator("#value-position");
  const first = await value.textContent();
  await page.waitForFunction((was) => document.querySelector("#value-position").textContent !== was, first);
  await page.waitForTimeout(1500);
  // Ink of the line in the right half of the plot, and other pixels a frame later.
  const moved = await page.evaluate(() => new Promise((resolve) => {
    const canvas = document.querySelector(".position canvas");
    const look = () => canvas.getContext("2d").getImageData(canvas.width / 2, 0, canvas.width / 2, canvas.height - 4).data;
    const before = look();
    const snapshots = window.bench.store.snapshots;
    const tries = [];
    const frame = () => {
      const same = window.bench.store.snapshots === snapshots;
      const now = look();
      tries.push(same && now.some((octet, i) => octet !== before[i]));
      if (tries.includes(true) || tries.length > 60) resolve({ ink: before.some((octet) => octet !== 0), between: tries.includes(true) });
      else requestAnimationFrame(frame);
    };
    requestAnimationFrame(frame);
  }));
  assert.deepEqual(moved, { ink: true, between: true });
});
