// Puts the page together: one card each, one loop of frames, one stream.

import { makeBus } from "./bus.js";
import { makeCap } from "./cap.js";
import { makeCharts } from "./charts.js";
import { makeDesk } from "./desk.js";
import { makeDiagnosis } from "./diagnosis.js";
import { setAttribute, setText } from "./dom.js";
import { makeFaults } from "./faults.js";
import { seconds } from "./format.js";
import { part, start, touch } from "./frames.js";
import { makeJournal } from "./journal.js";
import { makeMaster } from "./master.js";
import { makePicker } from "./picker.js";
import { makeRecordings } from "./recordings.js";
import { makeScenarios } from "./scenarios.js";
import { makeSegment } from "./segment.js";
import { makeShaft } from "./shaft.js";
import { on, store } from "./store.js";
import { connect } from "./stream.js";
import { makeTelegrams } from "./telegrams.js";
import { makeTheme } from "./theme.js";

const by = (id) => document.getElementById(id);

makeTheme(by("theme"));
const showView = makePicker(by("picker"));
const ofEncoder = [
  makeCap(by("cap")),
  makeShaft(by("shaft")),
  makeCharts(by("charts")),
  makeDiagnosis(by("diagnosis")),
  makeDesk(by("desk"), [
    ["telegrams", "Telegrams", makeTelegrams],
    ["bus", "Bus", makeBus],
    ["journal", "Events", makeJournal],
    ["faults", "Faults", makeFaults],
    ["master", "Master", makeMaster],
    ["scenarios", "Scenarios", makeScenarios],
    ["recordings", "Recordings", makeRecordings],
  ]),
];
const ofAll = makeSegment(by("segment"), () => showView("encoder"));
part({ update: () => {
  showStage();
  if (document.body.dataset.view === "encoder") ofEncoder.forEach((update) => update());
  else ofAll();
} });

function showStage() {
  const { stage } = store;
  const playing = stage?.playing?.state === "playing";
  setText(by("stage"), stage ? `${playing ? "Scenario: " : ""}${stage.title ?? stage.kind}${stage.time_factor && stage.time_factor !== 1 ? ` · ${stage.time_factor}×` : ""}` : "");
}

function showConnection(to) {
  document.body.dataset.connection = to;
  const pill = by("connection");
  setText(pill, { live: "live", lost: "not connected", connecting: "connecting" }[to]);
  setAttribute(pill, "class", `pill ${{ live: "good", lost: "bad", connecting: "waiting" }[to]}`);
  // What is shown is old then: nothing may be steered by it.
  by("main").inert = to !== "live";
  lostSince = to === "lost" ? store.heardAt : null;
  by("lost").hidden = to !== "lost";
  if (to === "lost") sayLost();
}

let lostSince = null;

function sayLost() {
  if (lostSince === null) return;
  const age = Math.round((performance.now() - lostSince) / 1000);
  setText(by("lost"), `Connection lost, trying again. What stands here is ${age < 1 ? "less than a second" : `${age} s`} old.`);
}

on("snapshot", touch);
on("event", touch);
on("telegrams", touch);
on("selected", touch);
on("connection", showConnection);
showConnection("connecting");
setInterval(sayLost, 1000);

const clock = by("clock");
let clockAt = 0;
part({ frame: (time, now) => {
  if (store.connection !== "live" || now - clockAt < 90) return;
  clockAt = now;
  setText(clock, seconds(Math.max(0, time)));
} });

start((now) => store.clock.shown(now));
connect();

// For those who look from outside, such as tests and the browser's console.
window.bench = { store };
