// The points of one lane that the page keeps: at times[i], from low to high of every channel. NaN lifts the pen.

const FIRST = 2048;

export class Line {
  /** @param {number} channels */
  constructor(channels) {
    this.channels = channels;
    this.start = 0;
    this.end = 0;
    this.allocate(FIRST);
  }

  get newest() { return this.end > this.start ? this.times[this.end - 1] : NaN; }

  /** Index of the first point at or after a time. */
  find(/** @type {number} */ ms) {
    let low = this.start, high = this.end;
    while (low < high) {
      const middle = (low + high) >> 1;
      if (this.times[middle] < ms) low = middle + 1; else high = middle;
    }
    return low;
  }

  /** The signal at a time, NaN where no point is as near as this. */
  at(/** @type {number} */ ms, /** @type {number} */ channel, /** @type {number} */ nearMs) {
    const later = this.find(ms);
    const near = [later - 1, later].filter((i) => i >= this.start && i < this.end && Math.abs(this.times[i] - ms) <= Math.max(nearMs, 60));
    const i = near.sort((a, b) => Math.abs(this.times[a] - ms) - Math.abs(this.times[b] - ms))[0];
    return i === undefined ? NaN : (this.low[channel][i] + this.high[channel][i]) / 2;
  }

  /** Replace everything from part.fromMs on; forget what is older than keepFromMs. */
  take(/** @type {import("./frames.js").LanePart} */ part, /** @type {number} */ keepFromMs) {
    this.end = part.full ? this.start : this.find(part.fromMs);
    this.start = Math.max(this.start, this.find(keepFromMs) - 1);
    this.reserve(part.times.length);
    this.times.set(part.times, this.end);
    for (let c = 0; c < this.channels; c++) {
      this.low[c].set(part.low[c], this.end);
      this.high[c].set(part.high[c], this.end);
    }
    this.end += part.times.length;
  }

  reserve(/** @type {number} */ count) {
    if (this.end + count <= this.times.length) return;
    const { times, low, high, start, end } = this;
    const kept = end - start;
    if (2 * (kept + count) > times.length) this.allocate(2 * (kept + count));
    this.times.set(times.subarray(start, end));
    for (let c = 0; c < this.channels; c++) {
      this.low[c].set(low[c].subarray(start, end));
      this.high[c].set(high[c].subarray(start, end));
    }
    this.start = 0;
    this.end = kept;
  }

  allocate(/** @type {number} */ size) {
    this.times = new Float64Array(size);
    this.low = Array.from({ length: this.channels }, () => new Float64Array(size));
    this.high = Array.from({ length: this.channels }, () => new Float64Array(size));
  }
}
