// The field of view on which gaze is drawn: as far as the eyes went, in the unit of the stream.
//
// In `px` and in parts of a screen (`1`) 0, 0 is the upper left corner; in degrees 0, 0 is straight ahead and up is up.

import { fixed } from "./format.js";

const WIDEST = 2.4, NARROWEST = 0.8; // of width over height

/** @returns {number} the next round number away from 0 */
function round(/** @type {number} */ v) {
  const power = 10 ** Math.floor(Math.log10(Math.abs(v) || 1));
  return Math.sign(v) * ([1, 2, 3, 4, 5, 6, 8, 10].find((n) => n * power >= Math.abs(v) - 1e-9) ?? 10) * power;
}

export class Field {
  constructor(/** @type {string} */ unit) {
    this.unit = unit === "1" ? "" : unit;
    this.centred = unit === "°";
    /** @type {[number, number][]} */
    this.ranges = unit === "1" ? [[0, 1], [0, 1]] : [[0, 0], [0, 0]];
  }

  get known() { return this.ranges.every(([low, high]) => low < high); }
  get aspect() {
    const [x, y] = this.ranges.map(([low, high]) => high - low);
    return this.unit === "" ? 16 / 9 : Math.max(NARROWEST, Math.min(WIDEST, x / y));
  }

  /**
   * Take the usual ranges of both channels lately, and what was looked at; it never shrinks.
   * @param {([number, number]|null)[]} usualRanges
   * @param {import("./frames.js").Mark[]} looks
   */
  grow(usualRanges, looks) {
    this.ranges = /** @type {[number, number][]} */ (this.ranges.map(([low, high], channel) => {
      const places = looks.map((mark) => (channel ? mark.y : mark.x)).concat(usualRanges[channel] ?? []).filter((v) => !Number.isNaN(v));
      if (!places.length) return [low, high];
      const usual = [Math.min(...places), Math.max(...places)];
      const far = round(Math.max(Math.abs(low), Math.abs(usual[0]), Math.abs(high), Math.abs(usual[1])));
      return this.centred ? [-far, far] : [Math.min(low, usual[0] < low ? round(usual[0]) : low), Math.max(high, usual[1] > high ? round(usual[1]) : high)];
    }));
  }

  across(/** @type {number} */ v) { return (v - this.ranges[0][0]) / (this.ranges[0][1] - this.ranges[0][0]); }

  down(/** @type {number} */ v) {
    const share = (v - this.ranges[1][0]) / (this.ranges[1][1] - this.ranges[1][0]);
    return this.centred ? 1 - share : share;
  }

  /** What an axis of the field reaches over: x (0) from left to right, y (1) from its upper edge to its lower one. */
  reach(/** @type {0|1} */ axis) {
    const [low, high] = this.ranges[axis].map((v) => fixed(v, 0));
    const turned = axis === 1 && this.centred;
    return `${axis ? "y" : "x"} ${turned ? high : low} to ${turned ? low : high} ${this.unit}`.trimEnd();
  }
}
