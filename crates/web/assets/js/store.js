// Everything the server told, and who is looked at. Views read it; nobody else writes it.

import { BusClock } from "./clock.js";
import { Past } from "./ring.js";

const EVENTS_KEPT = 1000;

export const store = {
  /** connecting, live, lost */
  connection: "connecting",
  snapshot: null,
  stage: null,
  encoders: new Map(),
  segments: new Map(),
  pasts: new Map(),
  clock: new BusClock(),
  selected: null,
  events: [],
  eventCount: 0,
  heardAt: 0,
  snapshots: 0,
};

const listeners = { snapshot: [], event: [], telegrams: [], connection: [], selected: [], plant: [] };

/** Calls `f` on `kind`: snapshot, event, telegrams, connection, selected, plant (other encoders than before). */
export function on(kind, f) {
  listeners[kind].push(f);
}

function tell(kind, value) {
  for (const f of listeners[kind]) f(value);
}

/** The encoder that is looked at, or `null`. */
export function encoder() {
  return store.encoders.get(store.selected) ?? null;
}

/** The segment of an encoder. */
export function segmentOf(of) {
  return store.segments.get(of?.segment) ?? store.snapshot?.segments[0] ?? null;
}

/** The past of an encoder. */
export function past(name = store.selected) {
  let kept = store.pasts.get(name);
  if (!kept) store.pasts.set(name, (kept = new Past()));
  return kept;
}

export function select(name) {
  if (name === store.selected || !store.encoders.has(name)) return;
  store.selected = name;
  tell("selected", name);
}

let plant = "";

/** Takes a snapshot as /api/snapshot has it. */
export function takeSnapshot(snapshot, now = performance.now()) {
  store.snapshot = snapshot;
  store.stage = snapshot.stage ?? null;
  store.heardAt = now;
  store.snapshots++;
  const names = snapshot.encoders.map((each) => each.name).join("\n");
  const other = names !== plant;
  if (other) {
    plant = names;
    store.pasts.clear();
    store.clock = new BusClock();
  }
  store.encoders.clear();
  store.segments.clear();
  for (const segment of snapshot.segments) store.segments.set(segment.name, segment);
  let newest = 0;
  for (const each of snapshot.encoders) {
    store.encoders.set(each.name, each);
    past(each.name).push(each);
    newest = Math.max(newest, each.at_ns);
  }
  store.clock.hear(newest / 1e9, store.stage?.time_factor || 1, now);
  if (!store.encoders.has(store.selected)) {
    store.selected = snapshot.encoders[0]?.name ?? null;
    tell("selected", store.selected);
  }
  if (other) tell("plant");
  tell("snapshot");
}

export function takeEvent(event) {
  store.events.push(event);
  store.eventCount++;
  if (store.events.length > 2 * EVENTS_KEPT) store.events.splice(0, EVENTS_KEPT);
  tell("event", event);
}

export function takeTelegrams(batch) {
  tell("telegrams", batch);
}

export function setConnection(to) {
  if (store.connection === to) return;
  store.connection = to;
  tell("connection", to);
}
