// The line of a lane, drawn once on a strip that is used as a ring.

import { worth } from "./gutter.js";

const SPARE = 32; // pixels of the strip beyond the window

/** @typedef {import("./lane.js").Lane} Lane */
/** @typedef {import("./lane.js").Pen} Pen */

export class Ink {
  constructor(/** @type {Lane} */ lane) {
    this.lane = lane;
    this.strip = document.createElement("canvas");
    this.context = /** @type {CanvasRenderingContext2D} */ (this.strip.getContext("2d"));
    this.origin = 0;
  }

  get height() { return this.strip.height; }

  /** Make the strip as large as the signal; true where it was not. */
  fit(/** @type {number} */ width, /** @type {number} */ height) {
    if (this.strip.width === width + SPARE && this.strip.height === height) return false;
    this.strip.width = width + SPARE;
    this.strip.height = height;
    return true;
  }

  /** Draw the whole line anew. @param {Pen} pen */
  anew(pen) {
    this.origin = Math.floor(pen.right / 1000) * 1000;
    this.context.clearRect(0, 0, this.strip.width, this.strip.height);
    this.from(this.lane.line.start, pen);
  }

  /** Draw the line from point number `first` to its end. @param {Pen} pen */
  from(/** @type {number} */ first, pen) {
    const { lane, context: ink, strip } = this, { line } = lane;
    if (first >= line.end || !lane.drawable) return;
    const left = Math.floor((line.times[first] - this.origin) * pen.perMs);
    const right = Math.ceil((line.newest - this.origin) * pen.perMs) + 2;
    const from = Math.max(left, right - strip.width);
    for (let turn = Math.floor(from / strip.width); turn <= Math.floor(right / strip.width); turn++) {
      const shift = turn * strip.width;
      const a = Math.max(from, shift), b = Math.min(right, shift + strip.width);
      if (b <= a) continue;
      ink.save();
      ink.translate(-shift, 0);
      ink.beginPath();
      ink.rect(a, lane.ceiling(pen), b - a, strip.height);
      ink.clip();
      ink.clearRect(a, 0, b - a, strip.height);
      const begin = line.find(this.origin + a / pen.perMs) - 3;
      for (let c = 0; c < line.channels; c++) this.channel(c, begin, this.origin + b / pen.perMs, pen);
      ink.restore();
    }
  }

  /** Colour, width and strength of a channel's line. @param {Pen} pen */
  dip(/** @type {number} */ channel, pen) {
    const { lane, context: ink } = this, quality = lane.quality(channel);
    const second = !lane.many && channel % 2 === 1; // of two on one axis
    const pale = quality !== null && worth(quality) === "bad" ? 0.4 : lane.many && lane.folded ? 0.6 : channel > 1 && !lane.many ? 0.5 : 1;
    ink.strokeStyle = second ? pen.colours.text : lane.penColour;
    ink.globalAlpha = pale;
    ink.lineWidth = (lane.rows > 12 || lane.folded || second ? 1 : 1.5) * pen.ratio;
    ink.lineJoin = "bevel";
  }

  channel(/** @type {number} */ channel, /** @type {number} */ first, /** @type {number} */ upToMs, /** @type {Pen} */ pen) {
    const { lane, context: ink, origin } = this, { line } = lane;
    const { factor, offset } = lane.vertical(channel, pen);
    const low = line.low[channel], high = line.high[channel];
    this.dip(channel, pen);
    ink.beginPath();
    let down = false, before = 0;
    for (let i = Math.max(first, line.start); i < line.end; i++) {
      if (Number.isNaN(low[i])) { down = false; continue; }
      const x = (line.times[i] - origin) * pen.perMs;
      const yLow = offset + factor * low[i], yHigh = offset + factor * high[i];
      if (!down) ink.moveTo(x, yLow);
      if (yLow === yHigh) ink.lineTo(x, yLow);
      else if (Math.abs(before - yHigh) < Math.abs(before - yLow)) { ink.lineTo(x, yHigh); ink.lineTo(x, yLow); }
      else { ink.lineTo(x, yLow); ink.lineTo(x, yHigh); }
      before = high[i] === low[i] ? yLow : (yLow + yHigh) / 2;
      down = true;
      if (line.times[i] > upToMs + 50) break;
    }
    ink.stroke();
  }

  /** Copy the visible part onto a canvas. @param {Pen} pen */
  copy(/** @type {CanvasRenderingContext2D} */ onto, /** @type {number} */ left, /** @type {number} */ right, pen) {
    const { strip } = this, { line } = this.lane;
    const newest = Math.min(right, Math.ceil((line.newest - this.origin) * pen.perMs) + 2);
    const oldest = Math.max(left, newest - strip.width, Math.floor((line.times[line.start] - this.origin) * pen.perMs) - 1);
    for (let from = oldest; from < newest;) {
      const inRing = ((from % strip.width) + strip.width) % strip.width;
      const width = Math.min(newest - from, strip.width - inRing);
      onto.drawImage(strip, inRing, 0, width, strip.height, from - left, 0, width, strip.height);
      from += width;
    }
  }
}
