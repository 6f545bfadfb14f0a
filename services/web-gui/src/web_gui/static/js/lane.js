// One lane: a stream's signal on canvas, and what its interpreter found in it.
//
// The line is drawn once, on a strip that is used as a ring; every picture copies the strip's visible part. So the cost
// of a picture does not depend on how many samples it shows. All else is drawn below or over the copy: marks of the
// features (ways.js, feet.js), holes and markers (overlay.js), axis and names (gutter.js).

import { h, text, attribute } from "./dom.js";
import { FEET } from "./feet.js";
import { Field } from "./field.js";
import { GUTTER, axis, counted, grid, names, rowHeight, worth } from "./gutter.js";
import { Ink } from "./ink.js";
import { Line } from "./line.js";
import { NUMBERLESS, holes, markers, reading } from "./overlay.js";
import { Scale, usualRange } from "./scale.js";
import { colourOf } from "./theme.js";
import { WAYS } from "./ways.js";

const LOOK_MS = 700; // between two looks at the signal's range
const FOLDED_FROM = 9; // channels that lie on each other until somebody opens them
const LABEL = 20, COMPACT_LABEL = 13, FLOOR = 4; // css pixels above and below the signal

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
  /** @param {(key: string) => void} onChoose @param {boolean} compact */
  constructor(stream, onChoose, compact) {
    this.key = stream.key;
    this.compact = compact;
    this.title = h("span", { class: "lane-type" });
    this.label = h("span", { class: "lane-sensor" });
    this.height = h("span", {});
    this.note = h("span", { class: "lane-note" });
    this.canvas = /** @type {HTMLCanvasElement} */ (h("canvas", { "aria-hidden": "true" }));
    this.button = h(
      "button", { type: "button", class: "lane-pick", onclick: () => onChoose(this.key) },
      this.canvas, h("span", { class: "lane-label" }, this.title, this.label, this.height, this.note),
    );
    this.opener = h("button", { type: "button", class: "lane-open", hidden: true, title: "One below the other, or on each other (f)", onclick: () => this.fold() });
    this.element = h("div", { class: "lane", "data-type": stream.type, "data-key": stream.key }, this.button, this.opener);
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d"));
    this.ink = new Ink(this);
    this.line = new Line(0);
    this.scales = [new Scale()];
    this.gaps = [];
    /** @type {import("./frames.js").Mark[]} */
    this.marks = [];
    this.opened = false;
    this.visible = this.numberless = false;
    this.drawnTo = NaN;
    this.lookedMs = 0;
    this.field = new Field(stream.unit);
    this.update(stream);
  }

  /** Take what the study message says of the stream. */
  update(stream) {
    if (this.stream?.unit !== stream.unit) this.field = new Field(stream.unit);
    const bad = (qualities) => qualities?.map((quality) => quality !== null && worth(quality) === "bad").join();
    if (bad(this.stream?.qualities) !== bad(stream.qualities)) this.stale = true;
    this.stream = stream;
    this.foot = this.footOf(stream);
    text(this.title, stream.label);
    text(this.label, ` ${[stream.sensor, this.whichChannels(), stream.unit || "unit unknown"].filter((one) => one).join(" · ")}`);
    const silent = !["streaming", "derived"].includes(stream.status);
    const why = stream.why_none || (this.numberless ? NUMBERLESS : "");
    text(this.note, `${this.poor()}${why ? ` · – ${why}` : ""}${silent ? ` ${stream.status}` : ""}`);
    attribute(this.button, "aria-label", `${stream.human} ${stream.type} ${stream.sensor}, ${stream.status}${this.poor()}${why ? `, ${why}` : ""}`);
    this.element.classList.toggle("silent", silent);
    this.shape();
  }

  /** What stands below the signal. */
  footOf({ drawn, interpreted }) {
    const foot = this.compact ? null : FEET[drawn.map(({ how }) => WAYS[how].foot).find((one) => one)] ?? null;
    return foot?.computed && !interpreted ? null : foot;
  }

  /** Draw the signal alone, below a smaller label. */
  setCompact(/** @type {boolean} */ compact) {
    this.compact = compact;
    this.stale = true;
    this.update(this.stream);
  }

  /** The names of channels that share an axis, in the order of their colours; "" where they stand beside the signal. */
  whichChannels() {
    const { channels, shown, stacked } = this.stream;
    if (stacked || (shown.length === 1 && channels.length === 1)) return "";
    const signs = shown.length > 1 ? ["━ ", "─ ", "┄ ", "┈ "] : [""];
    return shown.slice(0, 4).map((channel, i) => `${signs[i]}${channels[channel]}`).join("  ");
  }

  /** Which channels are no good, in words. */
  poor() {
    const { shown, channels, qualities } = this.stream;
    const found = shown.filter((channel) => typeof qualities[channel] === "number" && worth(qualities[channel]) === "bad");
    if (!found.length) return "";
    return ` · poor: ${found.slice(0, 4).map((channel) => channels[channel]).join(", ")}${found.length > 4 ? ` and ${found.length - 4} more` : ""}`;
  }

  /** Put channels one below the other, or on each other again. */
  fold() {
    this.opened = !this.opened;
    this.stale = true;
    this.shape();
  }

  /** As high as rows and foot need. */
  shape() {
    const count = this.stream.shown.length;
    this.opener.hidden = !this.foldable;
    attribute(this.opener, "aria-expanded", String(!this.folded));
    const { channels, channels_total: total } = this.stream, of = total > channels.length ? ` of ${total}` : "";
    text(this.opener, `${this.folded ? "▸" : "▾"} ${count}${of} channels`);
    this.element.style.setProperty("--rows", String(this.folded ? 1 : Math.min(count, this.stream.stacked ? count : 1)));
    attribute(this.element, "data-foot", this.foot ? "" : null);
    this.element.style.setProperty("--foot", `${this.foot?.css ?? 0}px`);
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
      this.scales = Array.from({ length: this.many ? this.line.channels : 1 }, () => new Scale());
    }
    if (part.low.length !== this.line.channels) return;
    this.line.take(part, keepFromMs);
    if (part.gaps) this.gaps = part.gaps;
    if (part.marks) this.marks = part.marks;
    this.drawnTo = part.full ? NaN : Math.min(Number.isNaN(this.drawnTo) ? part.fromMs : this.drawnTo, part.fromMs);
    if (part.full) this.stale = true;
    this.dirty = this.news = true;
  }

  /** Channels that have each their own middle: one below the other, or folded on each other. */
  get many() { return this.stream.stacked && this.line.channels > 1; }
  get foldable() { return this.stream.stacked && this.stream.shown.length >= FOLDED_FROM; }
  get folded() { return this.foldable && !this.opened; }
  get stacked() { return this.many && !this.folded; }
  get rows() { return this.stacked ? this.line.channels : 1; }
  /** The axis whose height all rows share; undefined while none is known. */
  get ruler() { return this.scales.find((scale) => scale.known); }
  get plotHeight() { return this.ink.height; }
  get labelled() { return this.compact ? COMPACT_LABEL : LABEL; }
  get timedHeight() { return this.foot?.timed ? this.canvas.height : this.ink.height; }

  /** @returns {number|null} from 0 to 1, null where it is not told */
  quality(/** @type {number} */ row) { return this.stream.qualities[this.stream.shown[row]] ?? null; }

  /** @returns {number|null} the row of a stream's channel, -1 of all of them, null where it is not shown */
  rowOf(/** @type {number} */ channel) {
    const row = channel < 0 ? -1 : this.stream.shown.indexOf(channel);
    if (channel >= 0 && row < 0) return null;
    return this.stacked ? row : -1;
  }

  /** Topmost pixel row of the line: of many channels none gets into the label. @param {Pen} pen */
  ceiling(pen) { return this.many ? this.labelled * pen.ratio : 0; }

  /** Where a row stands, row -1: the whole signal. @param {Pen} pen */
  rowBox(/** @type {number} */ row, pen) {
    const top = this.labelled * pen.ratio, height = this.ink.height - FLOOR * pen.ratio - top;
    return row < 0 ? { top, height } : { top: top + (row * height) / this.rows, height: height / this.rows };
  }

  middle(/** @type {number} */ channel) { return (this.scales[channel].low + this.scales[channel].high) / 2; }

  /** Pixel row of a value of a channel, as a factor and an offset. */
  vertical(/** @type {number} */ channel, /** @type {Pen} */ pen) {
    const { top, height } = this.rowBox(this.stacked ? channel : -1, pen);
    const factor = -height / (this.ruler.high - this.ruler.low);
    return { factor, offset: top + height / 2 - factor * this.middle(this.many ? channel : 0) };
  }

  /** @returns {number|null} pixel row of the signal at a time, null where it has no sample there */
  heightAt(/** @type {number} */ ms, /** @type {number} */ channel, /** @type {Pen} */ pen) {
    const value = this.drawable ? this.line.at(ms, channel, 2 / pen.perMs) : NaN;
    if (Number.isNaN(value)) return null;
    const { factor, offset } = this.vertical(channel, pen);
    return offset + factor * value;
  }

  /** Make the canvases as large as the lane. @param {Pen} pen */
  fit(pen) {
    const width = pen.width + Math.round(GUTTER * pen.ratio);
    const height = Math.max(1, Math.round(this.element.clientHeight * pen.ratio));
    const plot = Math.max(1, height - Math.round((this.foot?.css ?? 0) * pen.ratio));
    if (this.ink.fit(pen.width, plot)) this.stale = true;
    if (this.canvas.width === width && this.canvas.height === height) return;
    this.canvas.width = width;
    this.canvas.height = height;
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
      this.ink.anew(pen);
      this.stale = this.dirty = false;
    } else if (this.dirty) {
      this.ink.from(Math.max(this.line.start, this.line.find(this.drawnTo) - 2), pen);
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
      this.numberless = this.stream.raw && this.line.end > this.line.start + 1 && ranges.every((range) => range === null);
      this.field.grow(ranges, this.drawnAs("look"));
      if (this.many) this.considerRows(ranges, clockMs, settled);
      else {
        const known = [...ranges, this.levels()].filter((range) => range !== null);
        const all = /** @type {[number, number]} */ ([Math.min(...known.map((r) => r[0])), Math.max(...known.map((r) => r[1]))]);
        if (known.length) this.scales[0].consider(atLeast(all, this.stream.least), clockMs, settled);
      }
    }
    for (const scale of this.scales) if (scale.step(clockMs)) this.stale = true;
    if (!this.drawable && this.ruler) this.stale = true;
    this.drawable = this.ruler !== undefined;
  }

  /** The marks that are drawn in one way. */
  drawnAs(/** @type {string} */ how) { return this.marks.filter((mark) => this.stream.drawn[mark.kind]?.how === how); }

  /** The range of values that are drawn on the signal's axis beside it. @returns {[number, number]|null} */
  levels() {
    const values = this.drawnAs("level").map((mark) => mark.x).filter((v) => !Number.isNaN(v));
    return values.length ? [Math.min(...values), Math.max(...values)] : null;
  }

  /** Channels below or on each other share the height of a unit; each has its own middle. */
  considerRows(ranges, clockMs, settled) {
    const spans = ranges.filter((r) => r !== null).map(([low, high]) => high - low).sort((a, b) => a - b);
    if (!spans.length) return;
    const common = Math.max(this.stream.least, spans[Math.floor(0.75 * (spans.length - 1))]);
    ranges.forEach((range, c) => {
      const middle = range ? (range[0] + range[1]) / 2 : this.middle(c); // without numbers it stays where it was
      if (Number.isNaN(middle)) return;
      this.scales[c].consider([middle - common / 2, middle + common / 2], clockMs, settled);
    });
  }

  /** @param {Pen} pen */
  picture(pen) {
    const { context: c, canvas } = this;
    const right = Math.round((pen.right - this.ink.origin) * pen.perMs), left = right - pen.width;
    const x = (/** @type {number} */ ms) => Math.round((ms - this.ink.origin) * pen.perMs) - left;
    const brush = { c, lane: this, pen, x, colour: this.penColour };
    c.setTransform(1, 0, 0, 1, 0, 0);
    c.clearRect(0, 0, canvas.width, canvas.height);
    if (this.drawable) {
      text(this.height, this.scaleSaid());
      if (this.stacked) names(brush); else axis(brush);
      this.featured(brush, "under");
      this.ink.copy(c, left, right, pen);
      this.featured(brush, "over");
    }
    holes(brush);
    markers(brush);
    if (pen.pointer !== null) reading(brush);
  }

  /** What the title tells of the y axis. */
  scaleSaid() {
    const { ruler, stream } = this;
    if (this.stacked) return ` · ${rowHeight(ruler, stream.unit)}`;
    return `${this.many ? "" : counted(ruler, stream.unit)}${this.compact ? grid(ruler, stream.unit) : ""}`;
  }

  /** Draw the marks in the ways that the stream's kinds name; over the signal comes the foot as well. */
  featured(/** @type {import("./ways.js").Brush} */ brush, /** @type {"under"|"over"} */ when) {
    const { c, pen } = brush, kinds = this.stream.drawn.map((kind, place) => ({ kind, marks: this.marks.filter((mark) => mark.kind === place) }));
    c.save();
    c.beginPath();
    c.rect(0, 0, pen.width, this.canvas.height);
    c.clip();
    for (const { kind, marks } of kinds) WAYS[kind.how][when]?.(brush, marks);
    c.restore();
    if (!this.foot || when === "under") return;
    const top = this.ink.height, own = kinds.filter(({ kind }) => FEET[WAYS[kind.how].foot] === this.foot);
    this.foot.draw(brush, own, { top, height: this.canvas.height - top - 2 * pen.ratio });
  }
}
