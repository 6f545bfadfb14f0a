// One lane: a stream's signal on canvas.
//
// The line is drawn once, on a strip that is used as a ring; every picture copies the strip's visible part. So the cost
// of a picture does not depend on how many samples it shows. Holes, events and markers are drawn over the copy.

import { h, text, attribute } from "./dom.js";
import { span, tick, fixed } from "./format.js";
import { Line } from "./line.js";
import { Scale, usualRange } from "./scale.js";
import { colourOf } from "./theme.js";

const SPARE = 32; // pixels of the strip beyond the window
export const GUTTER = 52; // css pixels right of now, for the labels of the y axis
const LOOK_MS = 700; // between two looks at the signal's range
// Smallest range of an axis, so that a quiet signal looks quiet and noise does not fill the lane.

/**
 * @typedef {Object} Pen what all lanes share in one picture
 * @property {number} width device pixels of the plot
 * @property {number} ratio device pixels per css pixel
 * @property {number} perMs device pixels per ms
 * @property {number} right ms at the right edge
 * @property {number} now ms; differs from right when paused
 * @property {Object<string, string>} colours
 * @property {{at_ms: number, name: string, human: string}[]} markers
 * @property {number|null} pointer ms under the pointer
 */

/** @returns {[number, number]} a range widened to a least width */
function atLeast(/** @type {[number, number]} */ [low, high], /** @type {number} */ least) {
  const more = Math.max(0, least - (high - low)) / 2;
  return [low - more, high + more];
}

export class Lane {
  /** @param {(key: string) => void} onChoose */
  constructor(stream, onChoose) {
    this.key = stream.key;
    this.title = h("span", { class: "lane-type" });
    this.label = h("span", { class: "lane-sensor" });
    this.height = h("span", {});
    this.note = h("span", { class: "lane-note" });
    this.canvas = /** @type {HTMLCanvasElement} */ (h("canvas", { "aria-hidden": "true" }));
    this.element = h(
      "button",
      { type: "button", class: "lane", "data-type": stream.type, "data-key": stream.key, onclick: () => onChoose(this.key) },
      this.canvas,
      h("span", { class: "lane-label" }, this.title, this.label, this.height, this.note),
    );
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    this.strip = document.createElement("canvas");
    this.ink = /** @type {CanvasRenderingContext2D} */ (this.strip.getContext("2d"));
    this.line = new Line(0);
    this.scales = [new Scale()];
    this.gaps = [];
    this.events = [];
    this.visible = false;
    this.drawnTo = NaN;
    this.lookedMs = 0;
    this.origin = 0;
    this.update(stream);
  }

  /** Take what the study message says of the stream. */
  update(stream) {
    this.stream = stream;
    text(this.title, stream.label);
    const many = stream.shown.length < stream.channels.length && stream.shown.length === 1;
    text(this.label, ` ${stream.sensor} · ${many ? `${stream.channels[stream.shown[0]]} · ` : ""}${stream.unit || "unit unknown"}`);
    const silent = !["streaming", "derived"].includes(stream.status);
    text(this.note, silent ? ` ${stream.status}` : "");
    attribute(this.element, "aria-label", `${stream.human} ${stream.type} ${stream.sensor}, ${stream.status}`);
    this.element.classList.toggle("silent", silent);
  }

  /** Forget the signal: another view begins. */
  clear() {
    this.line = new Line(0);
    this.drawnTo = NaN;
  }

  /** Take points of a frame. */
  take(part, keepFromMs) {
    if (part.full && part.low.length !== this.line.channels) {
      this.line = new Line(part.low.length);
      this.scales = Array.from({ length: Math.max(1, this.rows) }, () => new Scale());
    }
    if (part.low.length !== this.line.channels) return;
    this.line.take(part, keepFromMs);
    if (part.gaps) this.gaps = part.gaps;
    if (part.events) this.events = part.events;
    this.drawnTo = part.full ? NaN : Math.min(Number.isNaN(this.drawnTo) ? part.fromMs : this.drawnTo, part.fromMs);
    if (part.full) this.stale = true;
    this.dirty = this.news = true;
  }

  get least() { return this.stream.least; }
  get stacked() { return this.stream.stacked && this.line.channels > 1; }
  get rows() { return this.stacked ? this.line.channels : 1; }

  /** Make the canvases as large as the lane. @param {Pen} pen */
  fit(pen) {
    const width = pen.width + Math.round(GUTTER * pen.ratio);
    const height = Math.max(1, Math.round(this.element.clientHeight * pen.ratio));
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
    this.strip.width = pen.width + SPARE;
    this.strip.height = height;
    this.stale = true;
  }

  /** Draw one picture. @param {Pen} pen */
  draw(pen, /** @type {number} */ clockMs) {
    if (!this.visible) return;
    this.fit(pen);
    this.scaleUp(clockMs);
    const colour = colourOf(this.stream.type);
    if (this.stale || this.penColour !== colour || this.penPerMs !== pen.perMs) {
      this.penColour = colour;
      this.penPerMs = pen.perMs;
      this.origin = Math.floor(pen.right / 1000) * 1000;
      this.ink.clearRect(0, 0, this.strip.width, this.strip.height);
      this.inkFrom(this.line.start, pen);
      this.stale = this.dirty = false;
    } else if (this.dirty) {
      this.inkFrom(Math.max(this.line.start, this.line.find(this.drawnTo) - 2), pen);
      this.dirty = false;
    }
    this.drawnTo = this.line.newest;
    this.picture(pen);
  }

  scaleUp(clockMs) {
    if (this.news && clockMs - this.lookedMs > LOOK_MS && this.line.channels) {
      this.lookedMs = clockMs;
      this.news = false;
      const settled = this.line.newest - this.line.times[this.line.start] > 4000;
      const ranges = Array.from({ length: this.line.channels }, (_, c) => usualRange(this.line, c));
      if (this.stacked) this.considerRows(ranges, clockMs, settled);
      else {
        const known = ranges.filter((range) => range !== null);
        const all = /** @type {[number, number]} */ ([Math.min(...known.map((r) => r[0])), Math.max(...known.map((r) => r[1]))]);
        if (known.length) this.scales[0].consider(atLeast(all, this.least), clockMs, settled);
      }
    }
    for (const scale of this.scales) if (scale.step(clockMs)) this.stale = true;
    if (!this.drawable && this.scales[0].known) this.stale = true;
    this.drawable = this.scales[0].known;
  }

  /** Channels below each other share the height of a unit; each has its own middle. */
  considerRows(ranges, clockMs, settled) {
    const spans = ranges.filter((r) => r !== null).map(([low, high]) => high - low).sort((a, b) => a - b);
    if (!spans.length) return;
    const common = Math.max(this.least, spans[Math.floor(0.75 * (spans.length - 1))]);
    ranges.forEach((range, c) => {
      if (!range) return;
      const middle = (range[0] + range[1]) / 2;
      this.scales[c].consider([middle - common / 2, middle + common / 2], clockMs, settled);
    });
  }

  /** First pixel row of the signal: below the label, where there is room for that. @param {Pen} pen */
  top(pen) { return (this.rows > 8 ? 3 : 20) * pen.ratio; }

  /** Pixel row of a value of a channel, as a factor and an offset. */
  vertical(/** @type {number} */ channel, /** @type {Pen} */ pen) {
    const top = this.top(pen), bottom = this.strip.height - 4 * pen.ratio;
    const height = (bottom - top) / this.rows;
    const scale = this.scales[this.stacked ? channel : 0];
    const rowTop = top + (this.stacked ? channel * height : 0);
    const factor = -height / (scale.high - scale.low);
    return { factor, offset: rowTop - factor * scale.high };
  }

  /** Draw the line from point number `first` to its end onto the strip. */
  inkFrom(/** @type {number} */ first, /** @type {Pen} */ pen) {
    const { line, ink, strip } = this;
    if (first >= line.end || !this.drawable) return;
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
      ink.rect(a, 0, b - a, strip.height);
      ink.clip();
      ink.clearRect(a, 0, b - a, strip.height);
      const begin = line.find(this.origin + a / pen.perMs) - 3;
      for (let c = 0; c < line.channels; c++) this.inkChannel(c, begin, this.origin + b / pen.perMs, pen);
      ink.restore();
    }
  }

  inkChannel(/** @type {number} */ channel, /** @type {number} */ first, /** @type {number} */ upToMs, /** @type {Pen} */ pen) {
    const { line, ink, origin } = this;
    const { factor, offset } = this.vertical(channel, pen);
    const low = line.low[channel], high = line.high[channel];
    ink.strokeStyle = this.penColour;
    ink.globalAlpha = this.stacked ? 1 : [1, 0.72, 0.5, 0.38][Math.min(channel, 3)];
    ink.lineWidth = (this.rows > 12 ? 1 : 1.5) * pen.ratio;
    ink.lineJoin = "bevel";
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

  /** @param {Pen} pen */
  picture(pen) {
    const { context: c, canvas, strip } = this;
    const x = (/** @type {number} */ ms) => Math.round((ms - this.origin) * pen.perMs) - left;
    const right = Math.round((pen.right - this.origin) * pen.perMs), left = right - pen.width;
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, canvas.width, canvas.height);
    this.grid(pen);
    const newest = Math.min(right, Math.ceil((this.line.newest - this.origin) * pen.perMs) + 2);
    const oldest = Math.max(left, newest - strip.width, Math.floor((this.line.times[this.line.start] - this.origin) * pen.perMs) - 1);
    for (let from = oldest; from < newest;) {
      const inRing = ((from % strip.width) + strip.width) % strip.width;
      const width = Math.min(newest - from, strip.width - inRing);
      c.drawImage(strip, inRing, 0, width, strip.height, from - left, 0, width, strip.height);
      from += width;
    }
    this.holes(pen, x);
    this.marks(pen, x);
    if (pen.pointer !== null) this.reading(pen, x);
  }

  /** @param {Pen} pen */
  grid(pen) {
    const { context: c, canvas } = this;
    if (this.stacked) return this.names(pen);
    if (!this.drawable) return;
    const { factor, offset } = this.vertical(0, pen);
    const { step, values } = this.scales[0].ticks();
    c.fillStyle = pen.colours.muted;
    c.font = `${Math.round(10.5 * pen.ratio)}px ${pen.colours.font}`;
    c.textBaseline = "middle";
    c.textAlign = "left";
    c.lineWidth = 1;
    c.strokeStyle = pen.colours.grid;
    const every = Math.abs(factor) * step < 15 * pen.ratio ? 2 : 1; // labels need more room than lines
    for (const v of values) {
      const y = Math.round(offset + factor * v) + 0.5;
      if (y < 8 * pen.ratio || y > canvas.height - 6 * pen.ratio) continue;
      c.beginPath();
      c.moveTo(0, y);
      c.lineTo(pen.width, y);
      c.stroke();
      if (Math.round(v / step) % every === 0) c.fillText(tick(v, step), pen.width + 6 * pen.ratio, y);
    }
  }

  /** Channel names in the gutter of a stacked lane, as many as fit. @param {Pen} pen */
  names(pen) {
    const { context: c } = this;
    c.fillStyle = pen.colours.muted;
    c.font = `${Math.round(9.5 * pen.ratio)}px ${pen.colours.font}`;
    c.textBaseline = "middle";
    c.textAlign = "left";
    const top = this.top(pen);
    const height = (this.strip.height - 4 * pen.ratio - top) / this.rows;
    const every = Math.ceil((8.5 * pen.ratio) / height);
    for (let row = 0; row < this.rows; row += every) {
      const name = this.stream.channels[this.stream.shown[row]] ?? "";
      c.fillText(name.slice(0, 8), pen.width + 6 * pen.ratio, top + (row + 0.5) * height, GUTTER * pen.ratio - 8);
    }
    if (!this.drawable) return;
    const digits = this.scales[0].high - this.scales[0].low < 10 ? 1 : 0;
    text(this.height, ` · row ${fixed(this.scales[0].high - this.scales[0].low, digits)} ${this.stream.unit}`);
  }

  /** @param {Pen} pen */
  holes(pen, x) {
    for (const [from, to] of this.gaps) this.hole(pen, x(from), x(to), `gap ${span(to - from)}`);
    const newest = this.line.newest;
    const known = !Number.isNaN(newest) && this.line.end > this.line.start;
    const until = Math.min(pen.right, pen.now);
    if (known && until - newest > this.stream.patience_s * 1000) {
      this.hole(pen, x(newest), x(until), `no data for ${span(until - newest)}`);
    }
  }

  hole(/** @type {Pen} */ pen, /** @type {number} */ from, /** @type {number} */ to, /** @type {string} */ label) {
    const { context: c, canvas } = this;
    const a = Math.max(0, from + 1), b = Math.min(pen.width, to - 1);
    if (b - a < 1) return;
    c.save();
    c.beginPath();
    c.rect(a, 0, b - a, canvas.height);
    c.clip();
    c.fillStyle = pen.colours.hole;
    c.fillRect(a, 0, b - a, canvas.height);
    c.strokeStyle = pen.colours.hatch;
    c.lineWidth = pen.ratio;
    const step = 8 * pen.ratio, phase = ((from % step) + step) % step;
    c.beginPath();
    for (let s = a - (a % step) - canvas.height + phase - step; s < b + step; s += step) {
      c.moveTo(s, canvas.height);
      c.lineTo(s + canvas.height, 0);
    }
    c.stroke();
    c.font = `600 ${Math.round(12 * pen.ratio)}px ${pen.colours.font}`;
    c.textAlign = "center";
    c.textBaseline = "middle";
    const width = c.measureText(label).width + 12 * pen.ratio;
    if (width < b - a) {
      c.fillStyle = pen.colours.panel;
      c.fillRect((a + b - width) / 2, canvas.height / 2 - 10 * pen.ratio, width, 20 * pen.ratio);
      c.fillStyle = pen.colours.text;
      c.fillText(label, (a + b) / 2, canvas.height / 2);
    }
    c.restore();
  }

  /** @param {Pen} pen */
  marks(pen, x) {
    const { context: c, canvas } = this;
    const size = 4 * pen.ratio, base = canvas.height - 2 * pen.ratio;
    c.fillStyle = pen.colours.event;
    c.beginPath();
    for (const ms of this.events) {
      const at = x(ms) + 0.5;
      if (at < 0 || at > pen.width) continue;
      c.moveTo(at, base - 1.7 * size);
      c.lineTo(at - size, base);
      c.lineTo(at + size, base);
    }
    c.fill();
    c.strokeStyle = pen.colours.marker;
    c.lineWidth = 1.5 * pen.ratio;
    c.setLineDash([5 * pen.ratio, 3 * pen.ratio]);
    for (const marker of pen.markers) {
      const at = x(marker.at_ms) + 0.5;
      if (at < 0 || at > pen.width) continue;
      c.beginPath();
      c.moveTo(at, 0);
      c.lineTo(at, canvas.height);
      c.stroke();
    }
    c.setLineDash([]);
  }

  /** The value under the pointer. @param {Pen} pen */
  reading(pen, x) {
    const { context: c, canvas } = this;
    const at = x(pen.pointer) + 0.5;
    c.strokeStyle = pen.colours.muted;
    c.lineWidth = 1;
    c.beginPath();
    c.moveTo(at, 0);
    c.lineTo(at, canvas.height);
    c.stroke();
    if (this.stacked || !this.line.channels) return;
    const index = this.line.find(pen.pointer);
    const near = index < this.line.end && Math.abs(this.line.times[index] - pen.pointer) < 20 / pen.perMs;
    if (!near) return;
    const { factor, offset } = this.vertical(0, pen);
    const values = Array.from({ length: this.line.channels }, (_, channel) => this.line.high[channel][index]);
    if (values.some(Number.isNaN)) return;
    c.fillStyle = this.penColour;
    for (const v of values) {
      c.beginPath();
      c.arc(at, offset + factor * v, 3 * pen.ratio, 0, 7);
      c.fill();
    }
    const digits = Math.abs(values[0]) < 100 ? 2 : 0;
    const label = `${values.map((v) => fixed(v, digits)).join("  ")} ${this.stream.unit}`;
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
}
