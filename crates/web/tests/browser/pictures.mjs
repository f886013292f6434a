// The pictures of the docs, made by `cargo xtask pictures`.

import { mkdirSync, writeFileSync } from "node:fs";
import { fileURLToPath } from "node:url";
import { closeBrowser, DEMO, openPage, openTab, RUN, startProgram, until } from "./bench.mjs";
import { smaller } from "./png.mjs";

const folder = fileURLToPath(new URL("../../../../docs/pictures/", import.meta.url));
const HOIST = { kind: "hoist", by: 3.2, speed: 0.8, acceleration: 0.4, jerk: 1, pause_s: 1, unit: "m", per_turn: 0.5, raw: 100000 };

/** What `openPage` wants of a test: here what it leaves to be done is done at once. */
const noTest = () => {
  const done = [];
  return { after: (f) => done.unshift(f), finish: async () => { for (const f of done) await f(); } };
};

async function picture(name, url, options, act) {
  const t = noTest();
  const page = await openPage(t, url, options);
  await act(page);
  // No picture has a caret or a ring that nobody put there.
  await page.evaluate(() => document.activeElement?.blur());
  await page.mouse.move(640, 20);
  await page.waitForTimeout(150);
  const png = smaller(await page.screenshot());
  mkdirSync(folder, { recursive: true });
  writeFileSync(`${folder}${name}.png`, png);
  console.log(`docs/pictures/${name}.png: ${png.length} octets`);
  await t.finish();
}

const post = (page, path, body) => page.evaluate(async ([to, what]) => {
  const answer = await fetch(to, { method: "POST", headers: { "content-type": "application/json" }, body: JSON.stringify(what) });
  if (!answer.ok) throw new Error(await answer.text());
}, [path, body]);

const demo = await startProgram(...DEMO);
await picture("bench", demo.url, { colorScheme: "light" }, async (page) => {
  await until(page, (on) => on.device?.state === "data_exchange");
  await post(page, "api/commands", { do: "shaft", encoder: 1, shaft: HOIST });
  await page.waitForTimeout(11_500);
  await page.locator("#telegram-pause").click();
  await page.locator(".telegram.reply:not(.empty)").nth(2).click();
  await page.locator("#telegram-detail .field-row", { hasText: /position/i }).first().click();
});
await picture("bench-faults", demo.url, { colorScheme: "dark" }, async (page) => {
  await openTab(page, "faults");
  await page.waitForTimeout(7000);
  await post(page, "api/commands", { do: "supply", encoder: 1, volts: 8.5 });
  await post(page, "api/commands", { do: "light", encoder: 1, state: "low" });
  await page.locator("#words > li.alarm").first().waitFor();
  await page.locator("#diagnosis .octet").nth(7).click();
  await page.waitForTimeout(2500);
});
await picture("bench-tablet", demo.url, { colorScheme: "light", viewport: { width: 820, height: 1180 } }, async (page) => {
  await post(page, "api/commands", { do: "supply", encoder: 1, volts: 24 });
  await post(page, "api/commands", { do: "light", encoder: 1, state: "ok" });
  await openTab(page, "scenarios");
  await page.locator("[data-scenario*=hoist]").click();
  await page.locator("#scenario-play").click();
  await page.waitForFunction(() => window.bench.store.stage.playing?.at_s > 9);
});
await demo.end();

const MOVES = [(i) => `constant:${(i % 5) * 7 - 12}@900000`, (i) => `sine:amplitude=${1 + (i % 3)}:period_s=${4 + (i % 4)}@900000`, (i) => `hoist:by=${1 + (i % 4)}:speed=0.7:acceleration=0.6:pause_s=1:unit=m:per_turn=0.5@900000`];
const more = Array.from({ length: 31 }, (_, i) => ["--encoder", `switches=${(i + 6).toString(16).padStart(2, "0")},shaft=${MOVES[(i + 1) % 3](i)}`]);
const many = await startProgram(...RUN, "--shaft", MOVES[0](0), ...more.flat());
await picture("bench-all", many.url, { colorScheme: "light" }, async (page) => {
  await post(page, "api/commands", { do: "supply", encoder: 12, volts: 8 });
  await post(page, "api/commands", { do: "battery", encoder: 22, state: "low" });
  await post(page, "api/commands", { do: "power", encoder: 27, state: "off" });
  await page.locator("button[data-view=segment]").click();
  await page.waitForTimeout(10_000);
});
await many.end();
await closeBrowser();
