// All lanes: which there are, what part of time they show, and one picture per animation frame.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { timeOfDay } from "./format.js";
import { GUTTER } from "./gutter.js";
import { Lane } from "./lane.js";
import { pens } from "./theme.js";

const MOST_LANES = 200; // in sight at once
const COLUMNS = [1, 2, 4]; // of participants beside each other
const KEPT = { false: "sense4hri-columns", true: "sense4hri-columns-compact" }; // by whether lanes are compact
const STEPS_S = [1, 2, 2.5, 5, 10, 15], LABEL_PX = 60; // between ticks of the time axis; less room and their labels touch
const SLOW = 0.02; // share by which the page's idea of now follows the server's

export class Lanes {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {(key: string) => void} onChoose
   */
  constructor(connection, onChoose) {
    this.connection = connection;
    this.onChoose = onChoose;
    this.container = byId("lanes");
    this.axis = /** @type {HTMLCanvasElement} */ (byId("axis"));
    /** @type {Map<string, Lane>} */
    this.lanes = new Map();
    /** @type {Lane[]} */
    this.asked = [];
    this.viewNumber = 0;
    this.windowMs = 10000;
    this.endMs = null; // null = live
    this.nowOffset = null; // server's now minus this page's clock
    this.rate = 1; // of that clock: a replay may be slower than life
    this.markers = [];
    this.pointer = null;
    this.signature = "";
    this.frames = 0;
    this.seen = new IntersectionObserver((entries) => {
      for (const entry of entries) {
        const lane = this.lanes.get(/** @type {HTMLElement} */ (entry.target).dataset.key);
        if (lane) lane.visible = entry.isIntersecting;
      }
      this.look();
    }, { root: this.container, rootMargin: "200px" });
    new ResizeObserver(() => this.look()).observe(this.container);
    this.setCompact(false);
    this.container.addEventListener("pointermove", (event) => {
      const lane = /** @type {Element} */ (event.target).closest(".lane");
      this.pointer = lane ? event.clientX - lane.getBoundingClientRect().left : null; // in whichever column: they share one time axis
    });
    this.container.addEventListener("pointerleave", () => { this.pointer = null; });
    this.container.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.frozenMs = null;
    this.tick = this.tick.bind(this);
    requestAnimationFrame(this.tick);
  }

  get live() { return this.endMs === null; }

  /** Right edge of the axis in ms; the server's clock, carried on by this page's. */
  now() {
    return this.frozenMs ?? this.clock + this.nowOffset;
  }

  get clock() { return performance.now() * this.rate; }

  /** Go on at another pace from here. */
  setRate(/** @type {number} */ rate) {
    const before = this.clock;
    this.rate = rate;
    if (this.nowOffset !== null) this.nowOffset += before - this.clock;
  }

  /** Take the study message. */
  update(study) {
    this.setRate(study.rate);
    if (!this.asked.length) this.nowOffset = study.now_ms - this.clock; // no frame tells it
    const streams = study.streams.filter((stream) => stream.lane);
    const groups = [];
    for (const stream of streams) {
      if (groups.at(-1)?.id !== stream.human) groups.push({ id: stream.human, streams: [] });
      groups.at(-1).streams.push(stream);
    }
    keyed(this.container, groups, (group) => group.id, (group) => this.group(group), (element, group) => {
      keyed(element.lastElementChild, group.streams, (s) => s.key, (s) => this.lane(s).element, (_, s) => this.lanes.get(s.key).update(s));
    });
    for (const key of this.lanes.keys()) if (!streams.some((stream) => stream.key === key)) this.drop(key);
    const signature = JSON.stringify(streams.map((stream) => [stream.key, stream.shown, stream.channels.length]));
    if (signature !== this.signature) {
      this.signature = signature;
      this.look();
    }
  }

  group(group) {
    return h(
      "section",
      { class: "group", "aria-label": `signals of ${group.id}` },
      h("h2", { class: "band" }, h("span", {}, group.id)),
      h("div", { class: "group-lanes" }),
    );
  }

  /** @returns {Lane} */
  lane(stream) {
    const lane = new Lane(stream, this.onChoose, this.compact);
    this.lanes.set(stream.key, lane);
    this.seen.observe(lane.element);
    return lane;
  }

  drop(/** @type {string} */ key) {
    this.seen.unobserve(this.lanes.get(key).element);
    this.lanes.delete(key);
  }

  get ratio() { return Math.min(2, devicePixelRatio || 1); }

  plotWidth() {
    const first = this.lanes.values().next().value;
    const css = first ? first.element.clientWidth : this.container.clientWidth;
    return Math.max(50, Math.round((css - GUTTER) * this.ratio));
  }

  /** Ask the server for what is to be seen now: of two hundred people only those in sight. */
  look() {
    const lanes = [...this.lanes.values()].filter((lane) => lane.visible && lane.stream.shown.length).slice(0, MOST_LANES);
    if (!lanes.length) return;
    this.asked = lanes;
    this.viewNumber += 1;
    this.width = this.plotWidth();
    for (const lane of lanes) lane.fresh = true;
    this.connection.look({
      type: "view",
      view: this.viewNumber,
      columns: Math.min(8192, this.width),
      window_s: this.windowMs / 1000,
      end_ms: this.endMs,
      lanes: lanes.map((lane) => ({ stream: lane.key, channels: lane.stream.shown })),
    });
  }

  /** Take a binary frame. */
  take(frame) {
    this.frames += 1;
    const measured = frame.nowMs - this.clock;
    const off = this.nowOffset === null ? Infinity : measured - this.nowOffset;
    this.frozenMs = null;
    if (Math.abs(off) > 500) this.nowOffset = measured;
    else this.nowOffset += off * (off > 0 ? 4 * SLOW : SLOW);
    if (frame.view !== this.viewNumber) return;
    const keepFrom = (this.live ? frame.nowMs : this.endMs) - 1.15 * this.windowMs;
    for (const part of frame.lanes) this.asked[part.index]?.take(part, keepFrom);
  }

  /** Show the last seconds of this length. */
  setWindow(/** @type {number} */ seconds) {
    this.windowMs = seconds * 1000;
    this.look();
  }

  /** Draw all lanes low, or as high as there is room; each has its own number of columns. */
  setCompact(/** @type {boolean} */ compact) {
    this.compact = compact;
    for (const lane of this.lanes.values()) lane.setCompact(compact);
    this.setColumns(Number(localStorage.getItem(KEPT[compact])));
  }

  /** Put so many participants beside each other. */
  setColumns(/** @type {number} */ columns) {
    this.columns = COLUMNS.includes(columns) ? columns : this.compact ? 2 : 1;
    this.container.dataset.columns = String(this.columns);
    localStorage.setItem(KEPT[this.compact], String(this.columns));
    this.container.dispatchEvent(new CustomEvent("moved"));
  }

  /** One, two, four columns, and one again. */
  nextColumns() { this.setColumns(COLUMNS[(COLUMNS.indexOf(this.columns) + 1) % COLUMNS.length]); }

  /** Left edges of the columns' lanes on the screen. @returns {number[]} */
  lefts() {
    const firsts = [...this.container.children].map((group) => group.querySelector(".lane")?.getBoundingClientRect().left ?? NaN);
    return [...new Set(firsts.filter((left) => !Number.isNaN(left)))];
  }

  /** Stop at a time, or with null follow now. */
  setEnd(/** @type {number|null} */ ms) {
    this.endMs = ms === null ? null : Math.max(0, ms); // the time of a simulation begins there
    this.look();
    this.container.dispatchEvent(new CustomEvent("moved"));
  }

  pause() { this.setEnd(this.live ? this.now() : null); }

  /** Scroll by a share of the window; at now it becomes live again. */
  scroll(/** @type {number} */ share) {
    const end = (this.endMs ?? this.now()) + share * this.windowMs;
    this.setEnd(end >= this.now() ? null : end);
  }

  wheel(/** @type {WheelEvent} */ event) {
    if (!event.shiftKey && Math.abs(event.deltaX) <= Math.abs(event.deltaY)) return;
    event.preventDefault();
    this.scroll((event.deltaX || event.deltaY) / 1000);
  }

  /** The page lost its server: what is shown stands still until the first frame of the next connection. */
  freeze() {
    if (this.nowOffset !== null) this.frozenMs ??= this.clock + this.nowOffset;
    this.nowOffset = null;
  }

  tick(/** @type {number} */ clockMs) {
    requestAnimationFrame(this.tick);
    if (this.nowOffset === null && this.frozenMs === null) return;
    const ratio = this.ratio, now = this.now();
    if (this.width !== this.plotWidth()) this.look();
    const width = this.width ?? this.plotWidth();
    const perMs = width / this.windowMs, right = this.endMs ?? now;
    const under = this.pointer === null ? NaN : right - (width - this.pointer * ratio) / perMs;
    const pen = {
      width, ratio, perMs, right, now, colours: pens(), markers: this.markers,
      pointer: under <= right && under >= right - this.windowMs ? under : null,
    };
    for (const lane of this.lanes.values()) lane.draw(pen, clockMs);
    this.drawAxis(pen);
  }

  /** Ticks and the names of markers, below each column. */
  drawAxis(pen) {
    const { axis } = this;
    const context = /** @type {CanvasRenderingContext2D} */ (axis.getContext("2d"));
    const box = axis.getBoundingClientRect();
    const width = Math.round(box.width * pen.ratio), height = Math.round(box.height * pen.ratio);
    if (axis.width !== width || axis.height !== height) { axis.width = width; axis.height = height; }
    context.setTransform(1, 0, 0, 1, 0, 0);
    context.clearRect(0, 0, width, height);
    context.textBaseline = "alphabetic";
    const seconds = this.windowMs / 1000;
    for (const left of this.lefts()) {
      const shift = Math.round((left - box.left) * pen.ratio);
      this.drawTicks(pen, context, shift, seconds);
      this.drawFlags(pen, context, shift, height);
    }
    const said = this.live ? `the last ${seconds} s up to now` : `${seconds} s up to ${timeOfDay(pen.right)}`;
    attribute(axis, "aria-label", `Time axis: ${said}`);
  }

  drawTicks(pen, context, shift, seconds) {
    const fits = (/** @type {number} */ step) => seconds % step === 0 && step >= seconds / 6 && step * 1000 * pen.perMs >= LABEL_PX * pen.ratio;
    const step = STEPS_S.find(fits) ?? seconds;
    context.font = `${Math.round(11 * pen.ratio)}px ${pen.colours.font}`;
    context.fillStyle = context.strokeStyle = pen.colours.muted;
    for (let back = 0; back <= seconds; back += step) {
      const x = shift + pen.width - back * 1000 * pen.perMs;
      context.beginPath();
      context.moveTo(Math.round(x) - 0.5, 0);
      context.lineTo(Math.round(x) - 0.5, 4 * pen.ratio);
      context.stroke();
      context.textAlign = back === seconds ? "left" : "center";
      const label = back === 0 ? (this.live ? "now" : timeOfDay(pen.right)) : `−${back} s`;
      context.fillText(label, back === seconds ? Math.max(x, 2) : x, 15 * pen.ratio);
    }
  }

  drawFlags(pen, context, shift, height) {
    context.textAlign = "left";
    context.font = `600 ${Math.round(11 * pen.ratio)}px ${pen.colours.font}`;
    const free = [];
    for (const marker of [...this.markers].reverse()) {
      const x = shift + pen.width - (pen.right - marker.at_ms) * pen.perMs;
      if (x < shift || x > shift + pen.width) continue;
      const who = `${marker.human ? `${marker.human} ` : ""}${marker.name.replaceAll("_", " ")}`.slice(0, 60);
      const flags = [`${who} ${marker.value}`.trimEnd().slice(0, 60), who].map((label) => { // the name alone where the value has no room
        const size = context.measureText(label).width + 12 * pen.ratio;
        return { label, size, start: Math.min(x, shift + pen.width + GUTTER * pen.ratio - size) };
      });
      const flag = flags.find(({ start, size }) => !free.some(([a, b]) => start < b && start + size > a));
      if (!flag) continue;
      const { label, size, start } = flag;
      free.push([start, start + size]);
      context.fillStyle = pen.colours.marker;
      context.fillRect(start, height - 17 * pen.ratio, size, 16 * pen.ratio);
      context.fillStyle = pen.colours.onMarker;
      context.fillText(label, start + 6 * pen.ratio, height - 5 * pen.ratio);
    }
  }
}
