// How it looks and how fast it is: both themes, a tablet, contrast, the keyboard, weight, frames. Its pictures are kept.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, DEMO, LIMIT, openBench, openTab, picture, RUN, until } from "./bench.mjs";
import { faint } from "./contrast.mjs";

after(closeBrowser);

const MOST_OCTETS = 250_000;
const MOST_SCRIPT_MS = 8;

const TABS = ["telegrams", "bus", "journal", "faults", "master", "scenarios", "recordings"];

/** What is wider or higher than its place, or lies outside the window. */
const overflowing = () => {
  const wrong = [];
  const root = document.documentElement;
  if (root.scrollWidth > root.clientWidth) wrong.push(`page: ${root.scrollWidth} in ${root.clientWidth}`);
  for (const card of document.querySelectorAll(".card")) {
    if (card.offsetParent === null) continue;
    const box = card.getBoundingClientRect();
    if (box.right > innerWidth + 1 || box.bottom > innerHeight + 1) wrong.push(`#${card.id} ends at ${box.right}, ${box.bottom}`);
    if (card.scrollHeight > card.clientHeight + 1 || card.scrollWidth > card.clientWidth + 1) wrong.push(`#${card.id} holds ${card.scrollWidth} x ${card.scrollHeight} in ${card.clientWidth} x ${card.clientHeight}`);
  }
  return wrong;
};

for (const [name, viewport] of [["desk", { width: 1280, height: 800 }], ["tablet", { width: 820, height: 1180 }]]) {
  for (const colorScheme of ["light", "dark"]) {
    test(`${name}, ${colorScheme}: everything is in its place and every text can be read`, LIMIT, async (t) => {
      const { page } = await openBench(t, DEMO, { viewport, colorScheme });
      await until(page, (on) => on.device?.state === "data_exchange");
      await page.locator("#volts-number").fill("8.5");
      await page.keyboard.press("Enter");
      await page.locator("#words > li.alarm").first().waitFor();
      for (const tab of TABS) {
        await openTab(page, tab);
        await page.waitForTimeout(150);
        assert.deepEqual(await page.evaluate(overflowing), [], tab);
        assert.deepEqual(await page.evaluate(faint), [], `contrast, ${tab}`);
        await picture(page, `${name}-${colorScheme}-${tab}`);
      }
      await page.locator("button[data-view=segment]").click();
      await page.waitForTimeout(300);
      assert.deepEqual(await page.evaluate(faint), [], "contrast, all encoders");
    });
  }
}

test("the colours follow the switch, and the choice outlives a reload", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN, { colorScheme: "light" });
  const ground = () => page.evaluate(() => getComputedStyle(document.body.parentElement).backgroundColor);
  const light = await ground();
  await page.getByRole("button", { name: "Dark" }).click();
  const dark = await ground();
  assert.notEqual(dark, light);
  await page.reload();
  await page.locator("body[data-connection=live]").waitFor();
  assert.equal(await ground(), dark);
  await page.getByRole("button", { name: "Auto" }).click();
  assert.equal(await ground(), light);
});

test("the keyboard alone reaches and does everything, and one sees where it is", LIMIT, async (t) => {
  const { page } = await openBench(t, RUN);
  const reached = new Set();
  for (let i = 0; i < 60; i++) {
    await page.keyboard.press("Tab");
    const at = await page.evaluate(() => {
      const on = document.activeElement;
      const seen = getComputedStyle(on).outlineStyle !== "none" || on.matches(".rotary, .slide, .dial");
      return { name: on.getAttribute("aria-label") ?? on.id, seen };
    });
    assert.ok(at.seen || at.name === "", `no ring around ${at.name}`);
    reached.add(at.name);
  }
  for (const name of ["Rotary switch X16", "Rotary switch X1", "Termination switch S1", "Termination switch S2", "power", "Supply voltage", "Shaft", "Speed of the shaft", "drive-start", "tab-telegrams", "Telegrams"]) {
    assert.ok(reached.has(name), `Tab reaches ${name}: ${[...reached].join(", ")}`);
  }
  await page.locator("#tab-telegrams").focus();
  await page.keyboard.press("ArrowRight");
  assert.equal(await page.locator("#tab-bus").getAttribute("aria-selected"), "true");
  assert.equal(await page.locator("#panel-bus").isVisible(), true);
});

test("several encoders: all at once, and a choice leads to one", LIMIT, async (t) => {
  const { page } = await openBench(t, [...RUN, "--encoder", "switches=06,shaft=constant:60", "--encoder", "switches=07,shaft=constant:-30"]);
  await page.locator("button[data-view=segment]").click();
  assert.equal(await page.locator(".tile").count(), 3);
  await page.locator(".tile").nth(1).focus();
  await page.keyboard.press("ArrowRight");
  await page.keyboard.press("Enter");
  await until(page, (on) => on.switches === "07");
  assert.equal(await page.locator("#cap").isVisible(), true);
});

test("nothing moves its place while values change", LIMIT, async (t) => {
  const { page } = await openBench(t, DEMO);
  await until(page, (on) => on.device?.state === "data_exchange");
  const shift = await page.evaluate(() => new Promise((resolve) => {
    let total = 0;
    new PerformanceObserver((list) => { for (const entry of list.getEntries()) total += entry.value; }).observe({ type: "layout-shift" });
    setTimeout(() => resolve(total), 3000);
  }));
  // Cumulative layout shift; the list of telegrams moves its rows by transform, which does not count.
  assert.ok(shift < 0.005, `shifts of ${shift}`);
});

test("the first load is less than 250 kB", LIMIT, async (t) => {
  const { page, url } = await openBench(t, RUN);
  const loaded = await page.evaluate(() => [location.href, ...performance.getEntriesByType("resource").map((entry) => entry.name)].filter((name) => !name.includes("/api/")));
  let octets = 0;
  for (const name of loaded) {
    assert.ok(name.startsWith(url), `${name} is not of the program`);
    octets += (await (await fetch(name)).arrayBuffer()).byteLength;
  }
  console.log(`first load: ${octets} octets in ${loaded.length} files`);
  assert.ok(octets < MOST_OCTETS, `${octets} octets`);
});

test("32 encoders at 20 snapshots a second leave time in every frame", LIMIT, async (t) => {
  const more = Array.from({ length: 31 }, (_, i) => ["--encoder", `switches=${(i + 6).toString(16).padStart(2, "0")},shaft=constant:${10 + i}`]);
  const { page } = await openBench(t, [...RUN, ...more.flat()]);
  // Times of the processor, not of the clock: other programs on the computer then do not count.
  const session = await page.context().newCDPSession(page);
  await session.send("Performance.enable", { timeDomain: "threadTicks" });
  const scripts = async () => (await session.send("Performance.getMetrics")).metrics.find((metric) => metric.name === "ScriptDuration").value;
  for (const view of ["encoder", "segment"]) {
    await page.locator(`button[data-view=${view}]`).click();
    await page.waitForTimeout(1500);
    const before = await scripts();
    const figures = await page.evaluate(measureFrames);
    // All scripts, what snapshots cost when they come included.
    figures.script = ((await scripts()) - before) * 1000 / figures.count;
    console.log(`${view}: ${figures.snapshots.toFixed(1)} snapshots/s, ${figures.frames.toFixed(1)} frames/s, frame ${figures.middle.toFixed(1)} ms (95%: ${figures.most.toFixed(1)}), script ${figures.script.toFixed(2)} ms of processor time a frame`);
    assert.ok(figures.snapshots > 10, `${figures.snapshots} snapshots a second`);
    assert.ok(figures.script < MOST_SCRIPT_MS, `${figures.script} ms of script in a frame`);
  }
});

const measureFrames = () => new Promise((resolve) => {
  const { store } = window.bench;
  const gaps = [];
  let last = 0;
  const before = store.snapshots;
  const begun = performance.now();
  const frame = (now) => {
    if (last) gaps.push(now - last);
    last = now;
    if (performance.now() - begun < 4000) return void requestAnimationFrame(frame);
    const took = (performance.now() - begun) / 1000;
    const sorted = gaps.sort((a, b) => a - b);
    const part = (list, share) => list[Math.floor((list.length - 1) * share)];
    resolve({ count: gaps.length, frames: gaps.length / took, snapshots: (store.snapshots - before) / took, middle: part(sorted, 0.5), most: part(sorted, 0.95) });
  };
  requestAnimationFrame(frame);
});
