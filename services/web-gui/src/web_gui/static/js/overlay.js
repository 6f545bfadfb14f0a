// What is drawn over a lane and is nobody's feature: holes, the study's markers, the value under the pointer.

import { fixed, span } from "./format.js";

/** @typedef {import("./ways.js").Brush} Brush */

export const NUMBERLESS = "every sample is NaN";

/** Hatched where samples are missing, with for how long. */
export function holes(/** @type {Brush} */ brush) {
  const { lane, pen, x } = brush;
  for (const [from, to] of lane.gaps) hole(brush, x(from), x(to), `gap ${span(to - from)}`);
  const { line, stream } = lane, until = Math.min(pen.right, pen.now);
  const newest = line.end > line.start ? line.newest : stream.newest_ms ?? NaN; // none in the window: before it
  if (until - newest > stream.patience_s * 1000) {
    hole(brush, x(newest), x(until), `no data for ${span(until - newest)}`);
  } else if (lane.numberless) said(brush, 0, pen.width, NUMBERLESS);
}

function hole(/** @type {Brush} */ brush, /** @type {number} */ from, /** @type {number} */ to, /** @type {string} */ label) {
  const { c, lane, pen } = brush, height = lane.timedHeight;
  const a = Math.max(0, from + 1), b = Math.min(pen.width, to - 1);
  if (b - a < 1) return;
  c.save();
  c.beginPath();
  c.rect(a, 0, b - a, height);
  c.clip();
  c.fillStyle = pen.colours.hole;
  c.fillRect(a, 0, b - a, height);
  c.strokeStyle = pen.colours.hatch;
  c.lineWidth = pen.ratio;
  const step = 8 * pen.ratio, phase = ((from % step) + step) % step;
  c.beginPath();
  for (let s = a - (a % step) - height + phase - step; s < b + step; s += step) {
    c.moveTo(s, height);
    c.lineTo(s + height, 0);
  }
  c.stroke();
  said(brush, a, b, label);
  c.restore();
}

/** Words in the middle between two places, where they have room. */
function said(/** @type {Brush} */ { c, lane, pen }, /** @type {number} */ a, /** @type {number} */ b, /** @type {string} */ label) {
  const top = lane.compact ? lane.labelled * pen.ratio : 0; // not on the title of a low lane
  const middle = (top + lane.timedHeight) / 2, half = Math.min(10 * pen.ratio, (lane.timedHeight - top) / 2);
  c.font = `600 ${Math.round((lane.compact ? 10.5 : 12) * pen.ratio)}px ${pen.colours.font}`;
  c.textAlign = "center";
  c.textBaseline = "middle";
  const width = c.measureText(label).width + 12 * pen.ratio;
  if (width < b - a) {
    c.fillStyle = pen.colours.panel;
    c.fillRect((a + b - width) / 2, middle - half, width, 2 * half);
    c.fillStyle = pen.colours.text;
    c.fillText(label, (a + b) / 2, middle);
  }
}

/** Dashed lines through the lane, at the study's markers. */
export function markers(/** @type {Brush} */ { c, lane, pen, x }) {
  c.strokeStyle = pen.colours.marker;
  c.lineWidth = 1.5 * pen.ratio;
  c.setLineDash([5 * pen.ratio, 3 * pen.ratio]);
  c.beginPath();
  for (const marker of pen.markers) {
    const at = x(marker.at_ms) + 0.5;
    if (at < 0 || at > pen.width) continue;
    c.moveTo(at, 0);
    c.lineTo(at, lane.timedHeight);
  }
  c.stroke();
  c.setLineDash([]);
}

/** The value under the pointer. */
export function reading(/** @type {Brush} */ { c, lane, pen, x, colour }) {
  const at = x(pen.pointer) + 0.5;
  c.strokeStyle = pen.colours.muted;
  c.lineWidth = 1;
  c.beginPath();
  c.moveTo(at, 0);
  c.lineTo(at, lane.timedHeight);
  c.stroke();
  if (lane.many || !lane.drawable) return;
  const index = lane.line.find(pen.pointer);
  const near = index < lane.line.end && Math.abs(lane.line.times[index] - pen.pointer) < 20 / pen.perMs;
  if (!near) return;
  const { factor, offset } = lane.vertical(0, pen);
  const values = Array.from({ length: lane.line.channels }, (_, channel) => lane.line.high[channel][index]);
  if (values.some(Number.isNaN)) return;
  c.fillStyle = colour;
  for (const v of values) {
    c.beginPath();
    c.arc(at, offset + factor * v, 3 * pen.ratio, 0, 7);
    c.fill();
  }
  const digits = Math.abs(values[0]) < 100 ? 2 : 0;
  const label = `${values.map((v) => fixed(v, digits)).join("  ")} ${lane.stream.unit}`;
  c.font = `600 ${Math.round(11 * pen.ratio)}px ${pen.colours.font}`;
  const width = c.measureText(label).width + 10 * pen.ratio;
  const flip = at + width + 8 * pen.ratio > pen.width;
  const start = flip ? at - width - 6 * pen.ratio : at + 6 * pen.ratio;
  c.fillStyle = pen.colours.panel;
  c.fillRect(start, 4 * pen.ratio, width, 18 * pen.ratio);
  c.fillStyle = pen.colours.text;
  c.textAlign = "left";
  c.textBaseline = "middle";
  c.fillText(label, start + 5 * pen.ratio, 13 * pen.ratio);
}
