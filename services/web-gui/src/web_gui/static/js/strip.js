// The last minutes: state, expression, heart rate and markers of everyone.

import { h, keyed, attribute, text, byId } from "./dom.js";
import { fixed, span, words } from "./format.js";
import { pens } from "./theme.js";
import { STATE_SIGNS } from "./status.js";

const PARTS = 5; // between its ticks
const LOW_PX = 30; // a lower row has room for the states alone
const USUAL_BPM = [50, 110]; // the heart rate's axis reaches at least from here to there

/** @returns {[number, number]|null} the heart rate's axis of a participant in bpm, null where there is no heart rate */
function axisOf(/** @type {{heart_rate: [number, number|null][]}} */ participant) {
  const rates = participant.heart_rate.map(([, rate]) => rate).filter((rate) => rate !== null);
  return rates.length ? [Math.min(USUAL_BPM[0], ...rates), Math.max(USUAL_BPM[1], ...rates)] : null;
}

export class Strip {
  constructor() {
    this.container = byId("strip");
    this.rows = h("div", { class: "strip-rows", tabindex: "0", role: "group" });
    this.ticks = h("div", { class: "strip-ticks", "aria-hidden": "true" });
    for (let part = PARTS; part >= 0; part--) this.ticks.append(h("span", {}, "now"));
    this.container.append(this.rows, this.ticks);
    this.message = { span_s: 1, participants: [] };
    this.markers = [];
    this.nowMs = 0;
    new ResizeObserver(() => this.draw()).observe(this.container);
    document.addEventListener("theme", () => this.draw());
  }

  /** Take the strip's data. */
  trend(message) {
    this.message = message;
    this.container.hidden = !message.participants.length;
    attribute(this.rows, "aria-label", `The last ${this.since(1)} of everybody`);
    for (let part = PARTS; part > 0; part--) text(this.ticks.children[PARTS - part], `−${this.since(part / PARTS)}`);
    keyed(this.rows, message.participants, (p) => p.id, (p) => {
      const canvas = h("canvas", { role: "img" });
      const scale = h("span", { class: "strip-scale", "aria-hidden": "true" });
      return Object.assign(h("div", { class: "strip-row" }, h("span", { class: "strip-name" }, p.id), canvas, scale), { canvas, scale });
    }, (row, p) => {
      attribute(row.canvas, "aria-label", this.summary(p));
      text(row.scale, axisOf(p)?.map((rate) => fixed(rate, 0)).reverse().join("\n").concat(" bpm") ?? "");
    });
    this.draw();
  }

  /** @returns {string} how long a share of the strip is */
  since(/** @type {number} */ share) { return span(1000 * this.message.span_s * share); }

  summary(participant) {
    const last = participant.state.at(-1);
    const rates = participant.heart_rate.map(([, v]) => v).filter((v) => v !== null);
    const range = rates.length ? `heart rate ${Math.min(...rates)} to ${Math.max(...rates)} bpm` : "no heart rate";
    return `${participant.id}, last ${this.since(1)}: ${range}; state now ${last ? words(last[2]) : "unknown"}`;
  }

  draw() {
    const ratio = Math.min(2, devicePixelRatio || 1);
    for (const row of this.rows.children) {
      const participant = this.message.participants.find((p) => p.id === /** @type {any} */ (row).key);
      if (participant) this.row(/** @type {any} */ (row).canvas, participant, ratio);
    }
  }

  row(canvas, participant, ratio) {
    const width = Math.round(canvas.clientWidth * ratio), height = Math.round(canvas.clientHeight * ratio);
    if (!width) return;
    if (canvas.width !== width || canvas.height !== height) { canvas.width = width; canvas.height = height; }
    const c = canvas.getContext("2d"), colours = pens();
    c.clearRect(0, 0, width, height);
    const x = (ms) => width - ((this.nowMs - ms) / (1000 * this.message.span_s)) * width;
    const low = height < LOW_PX * ratio, band = low ? height : Math.round(height * 0.36);
    this.states(c, participant.state, x, band, ratio, colours);
    if (!low) {
      this.expressions(c, participant.expression, x, height, ratio, colours);
      this.heartRate(c, participant.heart_rate, x, band, height, ratio, colours);
    }
    c.strokeStyle = colours.marker;
    c.lineWidth = 1.5 * ratio;
    for (const marker of this.markers) {
      if (marker.human && marker.human !== participant.id) continue;
      c.beginPath();
      c.moveTo(x(marker.at_ms), low ? 0 : band); // not through the words of a state
      c.lineTo(x(marker.at_ms), height);
      c.stroke();
    }
  }

  states(c, stretches, x, band, ratio, colours) {
    c.font = `600 ${Math.round(10.5 * ratio)}px ${colours.font}`;
    c.textBaseline = "middle";
    c.textAlign = "left";
    for (const [from, to, state] of stretches) {
      const a = Math.max(0, x(from)), b = x(to + 1000);
      if (b <= 0) continue;
      const known = state in STATE_SIGNS ? state : "unknown";
      c.fillStyle = colours[known];
      c.fillRect(a, 0, Math.max(1, b - a - 1), band);
      const label = `${STATE_SIGNS[known]} ${words(state)}`;
      if (c.measureText(label).width + 10 * ratio < b - a) {
        c.fillStyle = colours.onMarker;
        c.fillText(label, a + 5 * ratio, band / 2 + ratio / 2);
      }
    }
  }

  expressions(c, stretches, x, height, ratio, colours) {
    c.font = `${Math.round(10.5 * ratio)}px ${colours.font}`;
    c.fillStyle = colours.muted;
    c.textBaseline = "bottom";
    let free = 0;
    for (const [from, to, expression] of stretches) {
      const a = Math.max(free, x(from), 0), b = x(to + 1000);
      c.fillRect(Math.max(0, x(from)), height - ratio, Math.max(0, b - Math.max(0, x(from)) - 2), ratio);
      const width = c.measureText(expression).width;
      if (width + 6 * ratio > b - a) continue;
      c.fillText(expression, a + 3 * ratio, height - 2 * ratio);
      free = a + width + 8 * ratio;
    }
  }

  heartRate(c, points, x, band, height, ratio, colours) {
    const axis = axisOf({ heart_rate: points });
    if (!axis) return;
    const [low, high] = axis;
    const top = band + 4 * ratio, bottom = height - 15 * ratio;
    c.strokeStyle = colours.text;
    c.lineWidth = 1.5 * ratio;
    c.lineJoin = "round";
    c.beginPath();
    let down = false;
    for (const [ms, v] of points) {
      if (v === null) { down = false; continue; }
      const y = bottom - ((v - low) / (high - low)) * (bottom - top);
      if (down) c.lineTo(x(ms), y); else c.moveTo(x(ms), y);
      down = true;
    }
    c.stroke();
  }
}
