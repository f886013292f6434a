// The bus clock between two snapshots. Snapshots come when they come; what scrolls must not show that.

const BEHIND_S = 0.15; // what is shown is this much behind, so that the next sample is there before its time

export class BusClock {
  constructor() {
    this.factor = 1;
    this.offset = null; // bus seconds minus browser seconds times the factor
  }

  /** A snapshot of bus time `bus` (s) came at `now` (browser ms). */
  hear(bus, factor, now) {
    if (factor !== this.factor) {
      this.factor = factor;
      this.offset = null;
    }
    const offset = bus - (now / 1000) * factor;
    // A late snapshot is the network's doing and moves the clock little; one that is far off is another time.
    if (this.offset === null || Math.abs(offset - this.offset) > 0.6 * factor) this.offset = offset;
    else this.offset += (offset - this.offset) * (offset > this.offset ? 0.2 : 0.02);
  }

  /** The bus time to show at `now`, in seconds. */
  shown(now) {
    return this.offset === null ? 0 : (now / 1000) * this.factor + this.offset - BEHIND_S * this.factor;
  }
}
