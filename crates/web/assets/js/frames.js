// One loop of animation frames for all: first what is new is written into the page, then what moves is drawn.

const updates = new Set();
const drawings = [];
let dirty = false;

/** Calls `update()` in the next frame after each snapshot, and `frame(busTime, now)` in every frame. */
export function part({ update, frame }) {
  if (update) updates.add(update);
  if (frame) drawings.push(frame);
}

/** Something is new. */
export function touch() {
  dirty = true;
}

/** Starts the loop. `shown` gives the bus time to show. */
export function start(shown) {
  const loop = (now) => {
    requestAnimationFrame(loop);
    if (dirty) {
      dirty = false;
      for (const update of updates) update();
    }
    const time = shown(now);
    for (const frame of drawings) frame(time, now);
  };
  requestAnimationFrame(loop);
}
