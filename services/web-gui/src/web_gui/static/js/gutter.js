// What stands right of now: the y axis of a lane, or the names of its channels and how good each of them is.

import { fixed, tick } from "./format.js";
import { Scale } from "./scale.js";

export const GUTTER = 52; // css pixels right of now

const LEAST_PX = 12; // between two labels
const GOOD = 0.8, USABLE = 0.5;
const SIGNS = { ok: "", wait: "", bad: "✕" };

/** @returns {"ok"|"wait"|"bad"} what a quality from 0 to 1 is worth */
export const worth = (/** @type {number} */ quality) => (quality >= GOOD ? "ok" : quality >= USABLE ? "wait" : "bad");

/** Lines and labels of the y axis; of a single channel also how good it is. @param {import("./ways.js").Brush} brush */
export function axis({ c, lane, pen }) {
  const { factor, offset } = lane.vertical(0, pen), { top, height } = lane.rowBox(-1, pen);
  const scale = lane.many ? around(lane.ruler) : lane.ruler;
  const zero = lane.many ? top + height / 2 : offset;
  const { step, values } = scale.ticks(), { base } = scale;
  c.fillStyle = pen.colours.muted;
  c.font = `${Math.round(10.5 * pen.ratio)}px ${pen.colours.font}`;
  c.textBaseline = "middle";
  c.textAlign = "left";
  c.lineWidth = 1;
  c.strokeStyle = pen.colours.grid;
  const y = (/** @type {number} */ v) => Math.round(zero + factor * v) + 0.5;
  const seen = values.filter((v) => y(v) >= 8 * pen.ratio && y(v) <= lane.plotHeight - 6 * pen.ratio);
  for (const v of seen) {
    c.beginPath();
    c.moveTo(0, y(v));
    c.lineTo(pen.width, y(v));
    c.stroke();
  }
  const only = lane.line.channels === 1 ? lane.quality(0) : null;
  const room = (GUTTER - (only === null ? 8 : 14)) * pen.ratio; // a longer label is drawn narrower: cut off it would be another number
  for (const v of labelled(seen, step, Math.abs(factor) / pen.ratio)) c.fillText(tick(v - base, step), pen.width + 6 * pen.ratio, y(v), room);
  if (only !== null) column(c, pen, only, pen.width + (GUTTER - 6) * pen.ratio, top, height);
}

/** Labels need more room than lines: all, every second, or else the lowest and the highest alone. */
function labelled(/** @type {number[]} */ values, /** @type {number} */ step, /** @type {number} */ pxPerUnit) {
  if (step * pxPerUnit >= LEAST_PX) return values;
  const even = values.filter((v) => Math.round(v / step) % 2 === 0);
  if (values.length < 2 || (even.length > 1 && 2 * step * pxPerUnit >= LEAST_PX)) return even;
  return (values.at(-1) - values[0]) * pxPerUnit >= LEAST_PX ? [values[0], values.at(-1)] : values.slice(0, 1);
}

/** The axis of channels that lie on each other, each around its own middle. */
function around(/** @type {Scale} */ scale) {
  const half = (scale.high - scale.low) / 2, found = new Scale();
  found.low = -half;
  found.high = half;
  return found;
}

/** Names of the channels, as many as fit, each with a column as high as its quality. @param {import("./ways.js").Brush} brush */
export function names({ c, lane, pen }) {
  c.font = `${Math.round(9.5 * pen.ratio)}px ${pen.colours.font}`;
  c.textBaseline = "middle";
  c.textAlign = "left";
  const every = Math.ceil((8.5 * pen.ratio) / lane.rowBox(0, pen).height);
  for (let row = 0; row < lane.rows; row++) {
    const { top, height } = lane.rowBox(row, pen), quality = lane.quality(row);
    if (quality !== null) column(c, pen, quality, pen.width + 4 * pen.ratio, top, height);
    if (row % every) continue;
    const name = `${quality === null ? "" : SIGNS[worth(quality)]}${lane.stream.channels[lane.stream.shown[row]] ?? ""}`;
    c.fillStyle = quality !== null && worth(quality) === "bad" ? pen.colours.bad : pen.colours.muted;
    c.fillText(name.slice(0, 8), pen.width + 11 * pen.ratio, top + height / 2, (GUTTER - 13) * pen.ratio);
  }
}

function column(/** @type {CanvasRenderingContext2D} */ c, pen, /** @type {number} */ quality, /** @type {number} */ x, /** @type {number} */ top, /** @type {number} */ height) {
  const width = 3.5 * pen.ratio, full = height - 2;
  c.fillStyle = pen.colours.grid;
  c.fillRect(x, top + 1, width, full);
  c.fillStyle = pen.colours[worth(quality)];
  c.fillRect(x, top + 1 + full * (1 - quality), width, full * quality);
}

/** @returns {string} how far the lines of an axis are apart, where not each of them has a label */
export function grid(/** @type {Scale} */ scale, /** @type {string} */ unit) {
  const { step } = scale.ticks();
  return ` · lines ${tick(step, step)} ${unit} apart`;
}

/** @returns {string} what the labels of the axis are to be added to, "" where they are the values themselves */
export function counted(/** @type {Scale} */ scale, /** @type {string} */ unit) {
  const { base } = scale;
  return base ? ` · axis + ${fixed(base, Math.max(0, -Math.floor(Math.log10(100 * scale.ticks().step) + 1e-9)))} ${unit}` : "";
}

/** @returns {string} the height of a row in the stream's unit */
export const rowHeight = (/** @type {Scale} */ scale, /** @type {string} */ unit) =>
  `row ${fixed(scale.high - scale.low, scale.high - scale.low < 10 ? 1 : 0)} ${unit}`;
