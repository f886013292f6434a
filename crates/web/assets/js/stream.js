// The live stream. It connects again by itself, and takes silence for a loss: a socket may die without a word.

import { setConnection, store, takeEvent, takeSnapshot, takeTelegrams } from "./store.js";

const SILENCE_MS = 2500;
const AGAIN_MS = 1000;

let source = null;
let again = 0;

/** Connects, and stays connected. */
export function connect() {
  clearTimeout(again);
  source?.close();
  source = new EventSource("api/stream");
  source.addEventListener("snapshot", (message) => {
    takeSnapshot(JSON.parse(message.data));
    setConnection("live");
  });
  source.addEventListener("event", (message) => takeEvent(JSON.parse(message.data)));
  source.addEventListener("telegrams", (message) => takeTelegrams(JSON.parse(message.data)));
  source.onerror = lost;
  store.heardAt = performance.now();
}

function lost() {
  source?.close();
  source = null;
  if (store.connection !== "connecting" || store.snapshots) setConnection("lost");
  clearTimeout(again);
  again = setTimeout(connect, AGAIN_MS);
}

setInterval(() => {
  if (source && performance.now() - store.heardAt > SILENCE_MS) lost();
}, 500);

// A laptop that wakes up should not wait for the timer.
addEventListener("online", connect);
document.addEventListener("visibilitychange", () => {
  if (!document.hidden && store.connection === "lost") connect();
});
