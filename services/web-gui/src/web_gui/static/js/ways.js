// The ways in which marks are drawn on a lane, by their names in drawn.py.
//
// `under` is drawn before the signal, `over` after it; both are given a brush and the marks of one kind. `foot` names
// what is drawn below the signal (feet.js) from them.

import { broken } from "./gaps.js";

/**
 * @typedef {Object} Brush what a mark is drawn with
 * @property {CanvasRenderingContext2D} c
 * @property {import("./lane.js").Lane} lane
 * @property {import("./lane.js").Pen} pen
 * @property {(ms: number) => number} x
 * @property {string} colour of the modality
 */
/** @typedef {import("./frames.js").Mark} Mark */

const SHADE = 0.22; // how strong a stretch is tinted

/** A triangle at the foot of the signal: something happened at this time. */
function tick(/** @type {Brush} */ { c, lane, pen, x }, /** @type {Mark[]} */ marks) {
  const size = 4 * pen.ratio, base = lane.plotHeight - 2 * pen.ratio;
  c.fillStyle = pen.colours.event;
  c.beginPath();
  for (const mark of marks) {
    const at = x(mark.from) + 0.5;
    c.moveTo(at, base - 1.7 * size);
    c.lineTo(at - size, base);
    c.lineTo(at + size, base);
  }
  c.fill();
}

/** A short stroke at the foot of the signal. */
function dash(/** @type {Brush} */ { c, lane, pen, x }, /** @type {Mark[]} */ marks) {
  const base = lane.plotHeight - 2 * pen.ratio;
  c.strokeStyle = pen.colours.muted;
  c.lineWidth = 1.5 * pen.ratio;
  c.beginPath();
  for (const mark of marks) {
    c.moveTo(x(mark.from) + 0.5, base);
    c.lineTo(x(mark.from) + 0.5, base - 7 * pen.ratio);
  }
  c.stroke();
}

/** Circles on the signal, where it has a sample at that time. */
function circles(/** @type {Brush} */ { lane, pen, x }, /** @type {Mark[]} */ marks, paint) {
  for (const mark of marks) {
    const y = lane.heightAt(mark.from, Math.max(0, lane.rowOf(mark.channel)), pen);
    if (y !== null) paint(x(mark.from) + 0.5, y);
  }
}

function dot(/** @type {Brush} */ brush, /** @type {Mark[]} */ marks) {
  const { c, pen } = brush;
  c.fillStyle = pen.colours.event;
  c.beginPath();
  circles(brush, marks, (x, y) => { c.moveTo(x, y); c.arc(x, y, 3.2 * pen.ratio, 0, 7); });
  c.fill();
}

function ring(/** @type {Brush} */ brush, /** @type {Mark[]} */ marks) {
  const { c, pen } = brush;
  c.strokeStyle = pen.colours.event;
  c.fillStyle = pen.colours.panel;
  c.lineWidth = 1.5 * pen.ratio;
  c.beginPath();
  circles(brush, marks, (x, y) => { c.moveTo(x + 3.2 * pen.ratio, y); c.arc(x, y, 3.2 * pen.ratio, 0, 7); });
  c.fill();
  c.stroke();
}

/** A tinted stretch behind the signal, of one channel's row or of all. */
function shade(/** @type {Brush} */ { c, lane, pen, x, colour }, /** @type {Mark[]} */ marks) {
  c.fillStyle = colour;
  for (const mark of marks) {
    const row = lane.rowOf(mark.channel);
    if (row === null) continue;
    const { top, height } = lane.rowBox(row, pen);
    const a = x(mark.from), b = Math.max(a + pen.ratio, x(mark.to));
    c.globalAlpha = SHADE;
    c.fillRect(a, top, b - a, height);
    c.globalAlpha = 0.8;
    c.fillRect(a, top, pen.ratio, height);
    c.fillRect(b - pen.ratio, top, pen.ratio, height);
  }
  c.globalAlpha = 1;
}

/** A dashed line through the values of successive messages, on the signal's own axis. */
function level(/** @type {Brush} */ { c, lane, pen, x }, /** @type {Mark[]} */ marks) {
  const { factor, offset } = lane.vertical(0, pen);
  c.strokeStyle = pen.colours.text;
  c.lineWidth = 1.5 * pen.ratio;
  c.setLineDash([6 * pen.ratio, 4 * pen.ratio]);
  c.beginPath();
  marks.forEach((mark, i) => {
    if (Number.isNaN(mark.x)) return;
    if (broken(marks[i - 1], mark, lane.gaps)) c.moveTo(x(mark.from), offset + factor * mark.x);
    else c.lineTo(x(mark.from), offset + factor * mark.x);
  });
  c.stroke();
  c.setLineDash([]);
}

/** A stretch without samples of its own: dotted edges, and a dashed line from its last good sample to its first. */
function bridge(/** @type {Brush} */ brush, /** @type {Mark[]} */ marks) {
  const { c, lane, pen, x } = brush;
  shade(brush, marks);
  c.strokeStyle = pen.colours.text;
  c.lineWidth = 1.5 * pen.ratio;
  c.setLineDash([3 * pen.ratio, 3 * pen.ratio]);
  c.beginPath();
  for (const mark of marks) {
    for (let row = 0; row < lane.line.channels; row++) {
      const from = lane.heightAt(mark.from, row, pen), to = lane.heightAt(mark.to, row, pen);
      if (from === null || to === null) continue;
      c.moveTo(x(mark.from), from);
      c.lineTo(x(mark.to), to);
    }
  }
  c.stroke();
  c.setLineDash([]);
}

/** A bar at the foot of the signal for as long as it lasts. */
function bar(/** @type {Brush} */ { c, lane, pen, x, colour }, /** @type {Mark[]} */ marks) {
  c.fillStyle = colour;
  for (const mark of marks) {
    c.fillRect(x(mark.from), lane.plotHeight - 6 * pen.ratio, Math.max(pen.ratio, x(mark.to) - x(mark.from) - pen.ratio), 4 * pen.ratio);
  }
}

/** @type {Object<string, {under?: (brush: Brush, marks: Mark[]) => void, over?: (brush: Brush, marks: Mark[]) => void, foot?: string}>} */
export const WAYS = {
  tick: { over: tick },
  dash: { over: dash },
  dot: { over: dot },
  ring: { over: ring },
  shade: { under: shade },
  bridge: { under: bridge },
  level: { over: level },
  look: { over: bar, foot: "screen" },
  band: { foot: "bands" },
  area: { foot: "area" },
};
