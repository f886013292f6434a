// What is written down: telegrams as pcapng, values as CSV.

import { get, removeRecording, startRecording, stopRecording } from "./api.js";
import { button, h } from "./dom.js";
import { size } from "./format.js";
import { attempt } from "./notes.js";
import { encoder, on as listen, segmentOf, store } from "./store.js";

const KINDS = { pcapng: "telegrams, for Wireshark, decode and replay", csv: "values of all encoders, for a spreadsheet" };
const EVERY_MS = 1000;

/** Fills the panel. */
export function makeRecordings(panel) {
  const body = h("tbody", { id: "recordings" });
  const start = (kind, text) => button(text, async () => {
    // Telegrams are those of the segment that is looked at; values those of all.
    const request = kind === "pcapng" ? { kind, segment: segmentOf(encoder())?.name } : { kind };
    await attempt(() => startRecording(request), "The recording runs.");
    load();
  }, { id: `record-${kind}` });
  panel.append(h("div", { class: "bar" }, start("pcapng", "Record telegrams"), start("csv", "Record values")),
    h("div", { class: "bus-scroll", tabindex: 0, role: "region", "aria-label": "Recordings" }, h("table", {}, h("thead", {}, h("tr", {}, ["Name", "What", "Size", ""].map((text) => h("th", { scope: "col" }, text)))), body),
      h("p", { class: "subtle empty-hint" }, "Nothing is recorded yet. What is recorded stays until the program ends: download what you want to keep.")));
  let shown = "";
  async function load() {
    const answer = await get("api/recordings").catch(() => null);
    if (!answer) return;
    const key = JSON.stringify(answer.recordings);
    if (key === shown) return;
    shown = key;
    panel.classList.toggle("has-any", answer.recordings.length > 0);
    body.replaceChildren(...answer.recordings.map(({ name, kind, octets, running }) => h("tr", {},
      h("td", {}, h("code", {}, name)), h("td", {}, KINDS[kind] ?? kind), h("td", { class: "number" }, size(octets)),
      h("td", { class: "actions" }, running
        ? [h("span", { class: "pill waiting" }, "recording"), button("Stop", async () => { await attempt(() => stopRecording(name)); load(); }, { class: "small" })]
        : [h("a", { href: `api/recordings/${encodeURIComponent(name)}`, download: name, class: "button small" }, "Download"),
          button("Remove", async () => { await attempt(() => removeRecording(name)); load(); }, { class: "small" })]))));
  }
  listen("connection", (to) => { if (to === "live") load(); });
  setInterval(() => { if (!panel.hidden && store.connection === "live") load(); }, EVERY_MS);
  return load;
}
