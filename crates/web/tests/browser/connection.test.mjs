// The connection is lost and regained; nothing old is shown as if it were live.

import assert from "node:assert/strict";
import { after, test } from "node:test";
import { closeBrowser, LIMIT, openPage, RUN, startProgram, until } from "./bench.mjs";

after(closeBrowser);

test("the page says that the program is gone, steers nothing then, and goes on when it is back", LIMIT, async (t) => {
  const first = await startProgram(...RUN);
  const page = await openPage(t, first.url);
  await until(page, (on) => on.device.address === 5);
  await first.end();
  await page.locator("body[data-connection=lost]").waitFor();
  assert.match(await page.locator("#lost").textContent(), /Connection lost, trying again.*old/);
  assert.equal(await page.locator("#connection").textContent(), "not connected");
  assert.equal(await page.locator("#main").evaluate((main) => main.inert), true);
  const second = await startProgram("run", "--http", `127.0.0.1:${first.port}`, "--switches", "09");
  t.after(() => second.end());
  await page.locator("body[data-connection=live]").waitFor();
  await until(page, (on) => on.device.address === 9);
  assert.equal(await page.locator("#lost").isVisible(), false);
  assert.equal(await page.locator("#main").evaluate((main) => main.inert), false);
  await page.waitForFunction(() => document.querySelector("#cap-note").textContent === "Switches 09h: address 9");
});

test("silence counts as a loss", LIMIT, async (t) => {
  const program = await startProgram(...RUN);
  t.after(async () => {
    process.kill(program.pid, "SIGCONT");
    await program.end();
  });
  const page = await openPage(t, program.url);
  // A stream that says nothing any more, as a sleeping computer's or a stopped program's does.
  process.kill(program.pid, "SIGSTOP");
  await page.locator("body[data-connection=lost]").waitFor();
  process.kill(program.pid, "SIGCONT");
  await page.locator("body[data-connection=live]").waitFor();
});
