// What is drawn below a signal: the power of bands, a quantity of its own, the screen that somebody looks at.
//
// Each is given a brush, the kinds of marks that it is made of with their marks, and its box in device pixels. `css` is
// its height in css pixels, `timed` whether it stands on the lanes' time axis.

import { broken } from "./gaps.js";
import { fixed } from "./format.js";

/** @typedef {{kind: {name: string, how: string}, marks: import("./frames.js").Mark[]}[]} Kinds */
/** @typedef {{top: number, height: number}} Box */
/** @typedef {import("./ways.js").Brush} Brush */

const LOOK_BACK_MS = 5000, FADES = 8, LONGEST_STEP_MS = 1500;

function label(/** @type {Brush} */ { c, pen }, /** @type {string} */ said, /** @type {number} */ x, /** @type {number} */ y) {
  c.fillStyle = pen.colours.muted;
  c.font = `${Math.round(9.5 * pen.ratio)}px ${pen.colours.font}`;
  c.textBaseline = "middle";
  c.textAlign = "left";
  c.fillText(said, x, y);
}

/** Draw within the plot alone, not over what stands right of now. */
function inPlot(/** @type {Brush} */ { c, pen }, /** @type {Box} */ box, /** @type {() => void} */ draw) {
  c.save();
  c.beginPath();
  c.rect(0, box.top, pen.width, box.height);
  c.clip();
  draw();
  c.restore();
}

/** One row for each kind, as dark as its share of the sum of all kinds at that time; the newest share beside it. */
function bands(/** @type {Brush} */ brush, /** @type {Kinds} */ kinds, /** @type {Box} */ box) {
  const { c, lane, pen, x, colour } = brush;
  const height = box.height / kinds.length;
  const count = Math.min(...kinds.map(({ marks }) => marks.length));
  const cell = (/** @type {number} */ i) => {
    const mark = kinds[0].marks[i], before = kinds[0].marks[i - 1];
    const sum = kinds.reduce((total, { marks }) => total + marks[i].x, 0);
    if (!(sum > 0)) return;
    const since = broken(before, mark, lane.gaps) ? mark.from - 1000 : Math.max(before.from, mark.from - LONGEST_STEP_MS);
    kinds.forEach(({ marks }, row) => {
      c.globalAlpha = Math.max(0.03, marks[i].x / sum);
      c.fillRect(x(since), Math.round(box.top + row * height) + 1, x(mark.from) - x(since), Math.max(1, Math.round(height) - 1));
    });
  };
  c.fillStyle = colour;
  inPlot(brush, box, () => { for (let i = 0; i < count; i++) cell(i); });
  const newest = kinds.map(({ marks }) => marks[count - 1]?.x ?? NaN), sum = newest.reduce((a, b) => a + b, 0);
  kinds.forEach(({ kind }, row) => {
    const share = sum > 0 ? `${fixed((100 * newest[row]) / sum, 0)} %` : "–";
    label(brush, `${kind.name} ${share}`, pen.width + 6 * pen.ratio, box.top + (row + 0.5) * height);
  });
}

/** A quantity from 0 up, filled. */
function area(/** @type {Brush} */ brush, /** @type {Kinds} */ kinds, /** @type {Box} */ box) {
  const { c, lane, pen, x, colour } = brush;
  const [{ kind, marks }] = kinds;
  const values = marks.map((mark) => mark.x).filter((v) => !Number.isNaN(v));
  label(brush, `${kind.name}, ${lane.stream.unit}${values.length ? "" : ": –"}`, 13 * pen.ratio, box.top + 4 * pen.ratio);
  if (!values.length) return;
  const highest = Math.max(0, ...values);
  const power = 10 ** Math.floor(Math.log10(highest || 1));
  const top = [1, 2, 5, 10].map((n) => n * power).find((n) => n >= highest) ?? power;
  const bottom = box.top + box.height - pen.ratio, plot = box.height - 8 * pen.ratio;
  const y = (/** @type {number} */ v) => bottom - (v / top) * plot;
  c.strokeStyle = pen.colours.grid;
  c.lineWidth = 1;
  for (const v of [0, top]) {
    c.beginPath();
    c.moveTo(0, Math.round(y(v)) + 0.5);
    c.lineTo(pen.width, Math.round(y(v)) + 0.5);
    c.stroke();
  }
  c.fillStyle = c.strokeStyle = colour;
  c.lineWidth = 1.5 * pen.ratio;
  inPlot(brush, box, () => marks.forEach((mark, i) => {
    const before = marks[i - 1];
    if (broken(before, mark, lane.gaps)) return;
    c.beginPath();
    c.moveTo(x(before.from), y(before.x));
    c.lineTo(x(mark.from), y(mark.x));
    c.stroke();
    c.lineTo(x(mark.from), bottom);
    c.lineTo(x(before.from), bottom);
    c.globalAlpha = 0.3;
    c.fill();
    c.globalAlpha = 1;
  }));
  label(brush, String(top), pen.width + 6 * pen.ratio, y(top));
  label(brush, "0", pen.width + 6 * pen.ratio, bottom - 3 * pen.ratio);
}

/** The way of the gaze between two times, interrupted where it was lost. */
function way(/** @type {CanvasRenderingContext2D} */ c, /** @type {import("./line.js").Line} */ line, /** @type {number} */ from, /** @type {number} */ to, px, py) {
  let down = false;
  for (let i = Math.max(line.start, line.find(from) - 1); i < line.end && line.times[i] <= to; i++) {
    const x = (line.low[0][i] + line.high[0][i]) / 2, y = (line.low[1][i] + line.high[1][i]) / 2;
    const lost = Number.isNaN(x + y);
    if (!lost && down) c.lineTo(px(x), py(y));
    else if (!lost) c.moveTo(px(x), py(y));
    down = !lost;
  }
}

/** The field that the eyes have moved in, with the gaze of the last seconds and the fixations, as large as they were long. */
function screen(/** @type {Brush} */ brush, /** @type {Kinds} */ kinds, /** @type {Box} */ box) {
  const { c, lane, pen, colour } = brush;
  const { field, line } = lane, until = pen.right, since = until - LOOK_BACK_MS;
  if (!field.known || line.channels < 2) return;
  const width = Math.min(0.6 * pen.width, (box.height - 10 * pen.ratio) * field.aspect), height = width / field.aspect;
  const left = 13 * pen.ratio, top = box.top + 4 * pen.ratio;
  const px = (/** @type {number} */ v) => left + field.across(v) * width, py = (/** @type {number} */ v) => top + field.down(v) * height;
  c.save();
  c.beginPath();
  c.rect(left, top, width, height);
  c.clip();
  c.fillStyle = pen.colours.page;
  c.fillRect(left, top, width, height);
  c.strokeStyle = colour;
  c.lineWidth = 1.2 * pen.ratio;
  for (let step = 0; step < FADES; step++) { // the older, the paler
    c.globalAlpha = (step + 1) / FADES;
    c.beginPath();
    way(c, line, since + (step * LOOK_BACK_MS) / FADES, Math.min(until, since + ((step + 1) * LOOK_BACK_MS) / FADES), px, py);
    c.stroke();
  }
  const seen = kinds[0].marks.filter((mark) => mark.to >= since && mark.from <= until && !Number.isNaN(mark.x + mark.y));
  for (const mark of seen) {
    c.beginPath();
    c.arc(px(mark.x), py(mark.y), Math.max(2.5, 15 * Math.sqrt((mark.to - mark.from) / 1000)) * pen.ratio, 0, 7);
    c.fillStyle = colour;
    c.globalAlpha = 0.25;
    c.fill();
    c.globalAlpha = 1;
    c.strokeStyle = pen.colours.text;
    c.lineWidth = pen.ratio;
    c.stroke();
  }
  c.restore();
  c.strokeStyle = pen.colours.muted;
  c.lineWidth = 1;
  c.strokeRect(left + 0.5, top + 0.5, width, height);
  const text = left + width + 8 * pen.ratio, said = [
    `→ ${field.reach(0)}`, `↓ ${field.reach(1)}`, `gaze of the last ${LOOK_BACK_MS / 1000} s`,
    seen.length ? `${seen.length} fixation${seen.length > 1 ? "s" : ""}, the longer the larger` : "no fixation", seen.length ? `newest ${fixed(seen.at(-1).to - seen.at(-1).from, 0)} ms` : "",
  ];
  said.forEach((one, i) => label(brush, one, text, top + (8 + 15 * i) * pen.ratio));
}

/** `computed`: it shows features alone, so without an interpreter it takes no room.
 * @type {Object<string, {css: number, timed: boolean, computed: boolean, draw: (brush: Brush, kinds: Kinds, box: Box) => void}>} */
export const FEET = {
  bands: { css: 52, timed: true, computed: true, draw: bands },
  area: { css: 34, timed: true, computed: true, draw: area },
  screen: { css: 132, timed: false, computed: false, draw: screen },
};
