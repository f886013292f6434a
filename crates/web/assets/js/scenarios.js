// Stories to play: pick one, watch it, see which expectations hold.

import { get, play, stopScenario } from "./api.js";
import { button, choice, h, setAttribute, setText } from "./dom.js";
import { seconds } from "./format.js";
import { attempt } from "./notes.js";
import { on as listen, store } from "./store.js";

const VERDICT = { playing: "playing", passed: "all expectations hold", failed: "an expectation failed", stopped: "stopped" };

/** Fills the panel. */
export function makeScenarios(panel) {
  const list = h("ul", { class: "stories", id: "stories" });
  const title = h("h3", {}, "Choose a scenario");
  const story = h("p", { class: "story" });
  const speed = choice("Speed", [["1", "as it is"], ["2", "twice"], ["5", "5 times"], ["10", "10 times"]]);
  const start = button("Play", () => attempt(() => play(chosen.name, Number(speed.select.value))), { class: "primary", id: "scenario-play", disabled: true });
  const stop = button("Stop", () => attempt(stopScenario), { id: "scenario-stop", disabled: true });
  const verdict = h("span", { class: "pill", id: "verdict", hidden: true });
  const bar = h("progress", { max: 1, value: 0, "aria-label": "Played so far" });
  const at = h("span", { class: "subtle at" });
  const expectations = h("ol", { class: "expectations", id: "expectations" });
  let chosen = null;
  panel.append(list, h("div", { class: "player" }, h("div", { class: "player-head" }, title, verdict), story,
    h("div", { class: "bar" }, speed.element, start, stop, bar, at), h("div", { class: "expectations-scroll", tabindex: 0, role: "region", "aria-label": "Expectations" }, expectations)));

  function choose(one, item) {
    chosen = one;
    for (const each of list.children) each.firstChild.setAttribute("aria-pressed", String(each.firstChild === item));
    setText(title, one.title);
    setText(story, one.story);
    start.disabled = false;
  }

  async function load() {
    const answer = await get("api/scenarios").catch(() => null);
    if (!answer) return;
    list.replaceChildren(...answer.scenarios.map((one) => {
      const item = h("button", { type: "button", "aria-pressed": "false", "data-scenario": one.name, onclick: () => choose(one, item) },
        h("span", { class: "story-title" }, one.title), h("span", { class: "subtle" }, seconds(one.seconds, 0)));
      return h("li", {}, item);
    }));
  }
  listen("connection", (to) => { if (to === "live") load(); });

  let rows = [];
  let shown = null;
  return () => {
    const playing = store.stage?.playing ?? null;
    stop.disabled = !playing;
    setText(stop, playing && playing.state !== "playing" ? "Back to the bench" : "Stop");
    verdict.hidden = !playing;
    if (!playing) {
      setText(at, "");
      if (bar.value !== 0) bar.value = 0;
      return;
    }
    setText(verdict, VERDICT[playing.state] ?? playing.state);
    setAttribute(verdict, "class", `pill ${{ passed: "good", failed: "bad", playing: "waiting" }[playing.state] ?? "off"}`);
    bar.value = Math.min(1, playing.at_s / (playing.seconds || 1));
    setText(at, `${seconds(playing.at_s)} of ${seconds(playing.seconds, 0)}`);
    if (shown !== `${playing.scenario} ${playing.expectations.length}`) {
      shown = `${playing.scenario} ${playing.expectations.length}`;
      rows = playing.expectations.map(() => {
        const row = { state: h("span", { class: "verdict" }), text: h("span", { class: "t-what" }), why: h("span", { class: "why" }) };
        row.element = h("li", {}, row.state, h("div", {}, row.text, row.why));
        return row;
      });
      expectations.replaceChildren(...rows.map((row) => row.element));
    }
    playing.expectations.forEach(({ text, state, why }, i) => {
      setText(rows[i].state, { held: "holds", failed: "failed", waiting: "waits" }[state] ?? state);
      setAttribute(rows[i].element, "class", state);
      setText(rows[i].text, text);
      setText(rows[i].why, why ?? "");
    });
  };
}
