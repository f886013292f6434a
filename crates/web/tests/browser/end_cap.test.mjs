// Switches, termination and supply on the end cap (manual 3.3, 3.4, 4.2.2).

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, encoder, LIMIT, openBench, RUN, until } from "./bench.mjs";

after(closeBrowser);

test("a turned switch counts at the next power-on, and the page says so", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  const note = page.locator("#cap-note");
  await page.waitForFunction(() => document.querySelector("#cap-note").textContent === "Switches 05h: address 5");
  await page.locator("[data-switch=X1]").click();
  await until(page, (on) => on.switches === "06");
  assert.match(await note.textContent(), /Turned to 06h \(address 6\).*next power-on.*Now address 5/);
  assert.equal((await encoder(page)).device.address, 5);
  await page.locator("#power-cycle").click();
  await until(page, (on) => on.device?.address === 6);
  await page.waitForFunction(() => document.querySelector("#cap-note").textContent === "Switches 06h: address 6");
  assert.equal(await page.locator("#power-cycle").isVisible(), false);
});

test("a switch is turned by dragging, by arrow keys and by its digit", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  const x16 = page.locator("[data-switch=X16]");
  await x16.focus();
  await page.keyboard.press("ArrowDown");
  await until(page, (on) => on.switches === "F5");
  assert.equal(await x16.getAttribute("aria-valuetext"), "F");
  await page.keyboard.press("2");
  await until(page, (on) => on.switches === "25");
  await page.keyboard.press("c");
  await until(page, (on) => on.switches === "C5");
  const box = await page.locator("[data-switch=X1] .rotary-body").boundingBox();
  const [x, y, r] = [box.x + box.width / 2, box.y + box.height / 2, box.width / 3];
  await page.mouse.move(x, y - r);
  await page.mouse.down();
  await page.mouse.move(x + r * 0.7, y - r * 0.7, { steps: 4 });
  await page.mouse.move(x + r, y, { steps: 4 }); // a quarter turn: four positions
  await page.mouse.up();
  await until(page, (on) => on.switches === "C9");
});

test("both termination switches are turned each by itself, and one alone is said to be wrong", LIMIT, async (t) => {
  const { page } = await openBench(t, [...RUN, "--encoder", "switches=06"]);
  const before = (await encoder(page)).cap;
  const first = page.getByRole("switch", { name: "Termination switch S1" });
  await first.focus();
  await page.keyboard.press("Space");
  await until(page, (on, was) => on.cap.terminated_first === !was.terminated_first && on.cap.terminated_second === was.terminated_second, before);
  await page.locator("#cap-termination.pending").waitFor();
  await page.getByRole("switch", { name: "Termination switch S2" }).click();
  await until(page, (on, was) => on.cap.terminated_second === !was.terminated_second, before);
});

test("the power switch cuts the power, and a reversed supply is shown as such", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  const power = page.getByRole("switch", { name: "Power" });
  await power.click();
  await until(page, (on) => on.device === null);
  await page.locator("#dp-state", { hasText: "no power" }).waitFor();
  assert.equal(await page.locator(".led.on").count(), 0);
  await power.click();
  await until(page, (on) => on.device !== null);
  await page.locator(".led.on").waitFor();
  await page.locator("#volts-number").fill("-24");
  await page.keyboard.press("Enter");
  await until(page, (on) => on.volts === -24 && on.device === null);
  await page.locator(".cap-volts", { hasText: "reversed" }).waitFor();
});
