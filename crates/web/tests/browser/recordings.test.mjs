// Recordings are made and fetched.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, LIMIT, openBench, openTab, RUN } from "./bench.mjs";

after(closeBrowser);

test("a recording is started, stopped, downloaded and removed", LIMIT, async (t) => {
  const { page } = await openBench(t, [...RUN, "--shaft", "constant:60"]);
  await openTab(page, "recordings");
  await page.locator("#record-csv").click();
  const row = page.locator("#recordings > tr").first();
  await row.getByText("recording", { exact: true }).waitFor();
  await page.waitForTimeout(1200);
  await row.getByRole("button", { name: "Stop" }).click();
  const [download] = await Promise.all([page.waitForEvent("download"), row.getByRole("link", { name: "Download" }).click()]);
  const text = await (await download.createReadStream()).toArray().then((parts) => Buffer.concat(parts).toString());
  // A row of every encoder every 10 ms, for more than a second, and a head.
  assert.ok(text.split("\n").length > 50, text.slice(0, 200));
  await row.getByRole("button", { name: "Remove" }).click();
  await page.getByText("Nothing is recorded yet.").waitFor();
});
