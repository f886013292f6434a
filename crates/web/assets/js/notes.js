// Short messages over the page: refusals and what was done. They cover, and never move, what is below.

import { button, h } from "./dom.js";

const SHOWN_MS = { refused: 12000, done: 3500 };

/** Shows a message. `kind` is `refused` or `done`. */
export function note(kind, text) {
  const place = document.getElementById("notes");
  const element = h("div", { class: `toast ${kind}` }, h("p", {}, text),
    button("Close", () => element.remove(), { class: "quiet", "aria-label": "Close this message" }));
  place.append(element);
  while (place.children.length > 3) place.firstChild.remove();
  setTimeout(() => element.remove(), SHOWN_MS[kind]);
}

/** Does what a button asks; a refusal is shown. Gives the answer, or `null`. */
export async function attempt(work, done) {
  try {
    const answer = await work();
    if (done) note("done", done);
    return answer ?? {};
  } catch (error) {
    note("refused", error.message);
    return null;
  }
}
