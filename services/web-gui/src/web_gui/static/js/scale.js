// A y axis that follows its signal slowly: it takes most of the window to move it, and then it glides.

const BLOCKS = 10;
const GLIDE_MS = 400;
const MARGIN = 0.12;
const MOST_STEPS = 1e6;

/**
 * The range of a channel as most parts of the window have it; an artefact in a quarter of them changes nothing.
 * @param {import("./line.js").Line} line
 * @param {number} channel
 * @returns {[number, number]|null}
 */
export function usualRange(line, channel) {
  const count = line.end - line.start;
  if (count < 2) return null;
  const first = line.times[line.start], width = (line.newest - first) / BLOCKS || 1;
  const lows = [], highs = [];
  let low = Infinity, high = -Infinity, block = 0;
  for (let i = line.start; i <= line.end; i++) {
    const here = i < line.end ? Math.min(BLOCKS - 1, Math.floor((line.times[i] - first) / width)) : BLOCKS;
    if (here !== block) {
      if (low <= high) { lows.push(low); highs.push(high); }
      low = Infinity; high = -Infinity; block = here;
    }
    if (i === line.end) break;
    if (line.low[channel][i] < low) low = line.low[channel][i];
    if (line.high[channel][i] > high) high = line.high[channel][i];
  }
  if (!lows.length) return null;
  lows.sort((a, b) => a - b);
  highs.sort((a, b) => a - b);
  return [lows[Math.floor(0.2 * (lows.length - 1))], highs[Math.ceil(0.8 * (highs.length - 1))]];
}

export class Scale {
  constructor() {
    this.low = NaN;
    this.high = NaN;
    this.glide = null;
    this.tooWideSince = NaN;
  }

  get known() { return this.low < this.high; }

  /**
   * Consider the usual range of the signal.
   * @param {[number, number]} range
   * @param {number} nowMs of the page's own clock
   * @param {boolean} settled false while there is little signal yet
   */
  consider([low, high], nowMs, settled) {
    const middle = (low + high) / 2;
    const span = Math.max(high - low, Math.abs(middle) * 1e-8, 1e-6);
    const target = [middle - span * (0.5 + MARGIN), middle + span * (0.5 + MARGIN)];
    if (!this.known) { [this.low, this.high] = target; return; }
    if (this.glide) return;
    const now = this.high - this.low;
    const outside = low < this.low || high > this.high;
    const wide = span * (1 + 2 * MARGIN) < (settled ? 0.55 : 0.8) * now;
    if (!wide) this.tooWideSince = NaN;
    else if (Number.isNaN(this.tooWideSince)) this.tooWideSince = nowMs;
    if (outside || (wide && (!settled || nowMs - this.tooWideSince > 4000))) {
      this.glide = { from: [this.low, this.high], to: target, since: nowMs };
      this.tooWideSince = NaN;
    }
  }

  /** Move; true while the axis differs from the last picture. */
  step(/** @type {number} */ nowMs) {
    if (!this.glide) return false;
    const done = Math.min(1, (nowMs - this.glide.since) / GLIDE_MS);
    const ease = done * done * (3 - 2 * done);
    this.low = this.glide.from[0] + (this.glide.to[0] - this.glide.from[0]) * ease;
    this.high = this.glide.from[1] + (this.glide.to[1] - this.glide.from[1]) * ease;
    if (done === 1) this.glide = null;
    return true;
  }

  /** What the axis counts from: 0, or where the labels would need more than six digits a round value inside it. */
  get base() {
    const { step } = this.ticks(), middle = (this.low + this.high) / 2;
    return Math.abs(middle) > MOST_STEPS * step ? Math.round(middle / (100 * step)) * 100 * step : 0;
  }

  /** Two to five round values inside the axis. */
  ticks() {
    const widest = (this.high - this.low) / 2;
    const power = 10 ** Math.floor(Math.log10(widest));
    const step = [5, 2, 1].map((n) => n * power).find((n) => n <= widest) ?? power;
    const found = [];
    for (let v = Math.ceil(this.low / step) * step; v <= this.high; v += step) found.push(v);
    return { step, values: found };
  }
}
