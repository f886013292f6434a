// A program with its page, and a browser that looks at it; both end with the test.
//
// SCH108BEX_PROGRAM    the program (target/debug/sch108bex)
// SCH108BEX_CHROMIUM   the browser (chromium, from the search path)
// SCH108BEX_BROWSER    the folder with node_modules (target/browser)
// SCH108BEX_SCREENSHOTS  where screenshots go (target/screenshots)

import assert from "node:assert/strict";
import { spawn } from "node:child_process";
import { existsSync, mkdirSync } from "node:fs";
import { createRequire } from "node:module";
import { join } from "node:path";
import { createInterface } from "node:readline";
import { fileURLToPath } from "node:url";

const root = fileURLToPath(new URL("../../../../", import.meta.url));
const program = process.env.SCH108BEX_PROGRAM ?? join(root, "target/debug/sch108bex");
const tools = process.env.SCH108BEX_BROWSER ?? join(root, "target/browser");
const screenshots = process.env.SCH108BEX_SCREENSHOTS?? join(root, "target/screenshots");
const browserName = process.env.SCH108BEX_CHROMIUM ?? "chromium";
const { chromium } = createRequire(join(tools, "package.json"))("playwright-core");

/** A test must not hang: this is more than any wait in it should ever take. */
export const LIMIT = { timeout: 90_000 };

/** Starts the program with its page. Gives where it is, and how to end it. */
export async function startProgram(...args) {
  const child = spawn(program, args, { stdio: ["ignore", "pipe", "pipe"], cwd: root });
  let told = "";
  child.stderr.on("data", (part) => { told += part; });
  const lines = createInterface({ input: child.stdout });
  const exited = new Promise((resolve) => child.once("exit", resolve));
  const url = await new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new Error(`no "http:" line within 30 s; standard error: ${told}`)), 30_000);
    lines.on("line", (line) => {
      told += `${line}\n`;
      const found = /^http: (\S+)$/.exec(line);
      if (found) {
        clearTimeout(timer);
        resolve(found[1]);
      }
    });
    child.once("exit", (code) => {
      clearTimeout(timer);
      reject(new Error(`the program ended with ${code}: ${told}`));
    });
  });
  return {
    url,
    pid: child.pid,
    port: new URL(url).port,
    bus: () => /^bus: (\S+)$/m.exec(told)?.[1],
    async end(signal = "SIGTERM") {
      child.kill(signal);
      const timer = setTimeout(() => child.kill("SIGKILL"), 10_000);
      await exited;
      clearTimeout(timer);
    },
  };
}

/** Starts another program of ours that ends with the test, such as a master. */
export function startBeside(t, ...args) {
  const child = spawn(program, args, { stdio: "ignore", cwd: root });
  t.after(() => child.kill("SIGTERM"));
}

let browser = null;

/** The browser's file: playwright does not look through the search path. */
function browserFile() {
  const found = browserName.includes("/") ? [browserName] : (process.env.PATH ?? "").split(":").map((folder) => join(folder, browserName));
  const file = found.find((each) => existsSync(each));
  assert.ok(file, `no ${browserName}`);
  return file;
}

async function launch() {
  browser ??= await chromium.launch({ executablePath: browserFile(), args: ["--no-sandbox"] });
  return browser;
}

/** Closes the browser: `after(closeBrowser)` in each file. */
export async function closeBrowser() {
  await browser?.close();
  browser = null;
}

/**
 * Opens the page, and waits until it is live. What the browser complains of fails the test at its end: scripts that throw,
 * files that are missing, what the content security policy refuses.
 */
export async function openPage(t, url, options = {}) {
  const page = await (await launch()).newPage({ viewport: { width: 1280, height: 800 }, ...options });
  const complaints = [];
  page.setDefaultTimeout(15_000);
  page.on("pageerror", (error) => complaints.push(error.stack ?? error.message));
  page.on("console", (message) => {
    // Refused requests are told by the page itself, a program that is gone as well.
    if (message.type() === "error" && !/Failed to load resource|ERR_CONNECTION_REFUSED|ERR_INCOMPLETE_CHUNKED/.test(message.text())) complaints.push(message.text());
  });
  t.after(async () => {
    await page.close();
    assert.deepEqual(complaints, [], "the browser complains of nothing");
  });
  await page.goto(url);
  await page.locator("body[data-connection=live]").waitFor();
  await page.waitForFunction(() => window.bench.store.selected !== null);
  return page;
}

/** Program and page in one. */
export async function openBench(t, args, options) {
  const running = await startProgram(...args);
  t.after(() => running.end());
  const page = await openPage(t, running.url, options);
  return { ...running, page };
}

/** `run` with one encoder at address 5, or with more arguments. */
export const RUN = ["run", "--http", "127.0.0.1:0", "--switches", "05"];

/** The demonstration, with its built-in master. */
export const DEMO = ["demo", "--http", "127.0.0.1:0"];

/** Keeps a screenshot. */
export async function picture(page, name) {
  mkdirSync(screenshots, { recursive: true });
  await page.screenshot({ path: join(screenshots, `${name}.png`) });
}

/** The encoder as the newest snapshot has it. */
export const encoder = (page) => page.evaluate(() => window.bench.store.encoders.get(window.bench.store.selected));

/** Waits until `f(encoder, argument)` holds, in the page. */
export async function until(page, f, argument) {
  const store = "window.bench.store";
  await page.waitForFunction(new Function("argument", `return (${f})(${store}.encoders.get(${store}.selected), argument)`), argument);
}

/** Opens a tab of the lower part. */
export async function openTab(page, id) {
  await page.locator(`#tab-${id}`).click();
  await page.locator(`#panel-${id}`).waitFor();
}
