// The past of one encoder, for charts and for movement between two samples.

const KEPT = 2400;

/** Columns of samples over bus time in seconds. Grows to twice what is kept, then drops the older half at once. */
export class Past {
  constructor() {
    this.clear();
  }

  clear() {
    this.time = [];
    this.position = [];
    this.velocity = [];
    this.acceleration = [];
    this.raw = [];
    this.last = null;
  }

  /** Takes a sample of a snapshot. A device without power leaves a gap; so does the jump where a position starts again. */
  push(encoder) {
    const time = encoder.at_ns / 1e9;
    const previous = this.time.at(-1);
    if (previous !== undefined && time < previous) this.clear();
    if (previous !== undefined && time === previous) return;
    const device = encoder.device;
    const range = device?.total_measuring_range ?? 0;
    if (device && this.last !== null && Math.abs(device.position - this.last) > range / 2) {
      const between = (column, now) => (column.at(-1) === null ? null : (column.at(-1) + now) / 2);
      this.add((time + previous) / 2, null, between(this.velocity, device.velocity), between(this.acceleration, device.acceleration), this.raw.at(-1));
    }
    this.last = device ? device.position : null;
    this.add(time, device?.position ?? null, device?.velocity ?? null, device?.acceleration ?? null, encoder.shaft_position);
  }

  add(time, position, velocity, acceleration, raw) {
    const columns = [this.time, this.position, this.velocity, this.acceleration, this.raw];
    if (this.time.length >= 2 * KEPT) for (const column of columns) column.splice(0, KEPT);
    this.time.push(time);
    this.position.push(position);
    this.velocity.push(velocity);
    this.acceleration.push(acceleration);
    this.raw.push(raw);
  }

  /** The physical position of the shaft at a bus time, in straight lines between samples. */
  rawAt(time) {
    const { time: times, raw } = this;
    let i = times.length - 1;
    if (i < 0) return 0;
    while (i > 0 && times[i] > time) i--;
    if (i === times.length - 1 || times[i] > time) return raw[i];
    const share = (time - times[i]) / (times[i + 1] - times[i]);
    return raw[i] + share * (raw[i + 1] - raw[i]);
  }
}
