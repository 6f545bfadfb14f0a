// The panel on the right: everything known of one stream, and why something is not known.

import { h, s, keyed, text, attribute, value, byId } from "./dom.js";
import { fixed, maybe, offset, plain, words } from "./format.js";

const SPARK_W = 120, SPARK_H = 22;

export class Details {
  /** @param {import("./wearer.js").Wearer} wearer */
  constructor(wearer) {
    this.wearer = wearer;
    this.container = byId("details");
    this.parts = {
      title: h("h2", {}), about: h("p", { class: "about" }),
      features: h("table", { class: "rows" }), quality: h("div", { class: "quality" }),
      clock: h("dl", {}), health: h("dl", {}), reasons: h("ul", { class: "reasons" }),
      clockState: h("span", { class: "chip" }), latency: s("svg", { viewBox: `0 0 ${SPARK_W} ${SPARK_H}`, class: "latency", role: "img", preserveAspectRatio: "none" }),
      healthState: h("span", { class: "chip" }),
    };
    const p = this.parts;
    p.rowsHead = h("thead", {}, h("tr", {}, h("th", { scope: "col" }, ""), h("th", { scope: "col" }, "computed"), h("th", { scope: "col" }, "device")));
    p.rows = h("tbody", {});
    p.features.append(p.rowsHead, p.rows);
    p.bar = h("div", { class: "bar" });
    p.barValue = h("span", { class: "number" });
    p.quality.append(h("span", {}, "quality"), h("div", { class: "track" }, p.bar), p.barValue);
    p.path = s("path", { class: "spark-line" });
    p.latency.append(p.path);
    this.sections = {
      features: h("section", {}, h("h3", {}, "Features"), p.features, p.quality, p.reasons),
      clock: h("section", {}, h("h3", {}, "Clock ", p.clockState), p.clock, /** @type {any} */ (p.latency)),
      health: h("section", {}, h("h3", {}, "Health ", p.healthState), p.health),
    };
  }

  /** Show a stream, null = there is none; people: the ids of all participants. */
  show(stream, /** @type {string[]} */ people) {
    if (!stream) {
      this.container.replaceChildren(h("p", { class: "about" }, "Choose a signal to see its features, clock and health."));
      return;
    }
    const p = this.parts;
    if (p.title.parentElement !== this.container) {
      this.container.replaceChildren(p.title, p.about, this.wearer.element, ...Object.values(this.sections));
    }
    attribute(this.container, "data-type", stream.type);
    text(p.title, `${stream.sensor} · ${stream.label}`);
    text(p.about, [stream.human === "unassigned" ? "worn by nobody" : stream.human, ...stream.about].join(" · "));
    this.wearer.show(stream, people);
    this.features(stream);
    this.clock(stream.clock);
    this.health(stream);
  }

  features(stream) {
    const p = this.parts;
    this.sections.features.hidden = !stream.interpreted;
    const extra = stream.extra.map((item) => ({
      label: words(item.name), value: item.value, unit: item.unit, digits: null, reason: "not computed", device: null,
    }));
    const rows = [...stream.rows, ...extra];
    p.rowsHead.hidden = !rows.some((row) => row.device !== null);
    keyed(p.rows, rows, (row) => row.label, (row) => {
      const parts = { value: h("span", { class: "number" }), unit: h("span", { class: "unit" }), why: h("span", { class: "why" }), device: h("td", { class: "device number" }) };
      return Object.assign(
        h("tr", {}, h("th", { scope: "row" }, row.label), h("td", {}, parts.value, parts.unit, parts.why), parts.device), { parts },
      );
    }, (element, row) => {
      value(element.parts.value, row.value === null ? null : row.digits === null ? plain(row.value) : fixed(row.value, row.digits), row.reason);
      text(element.parts.unit, row.value === null || !row.unit ? "" : ` ${row.unit}`);
      text(element.parts.why, row.value === null ? row.reason.replaceAll(/(?<=\d) (?=s\b)/g, "\u00a0") : ""); // no line ends before its unit
      const wide = row.value === null && row.device === null; // then the reason has the room of the device's value
      element.parts.device.hidden = wide;
      attribute(element.children[1], "colspan", wide ? 2 : null);
      text(element.parts.device, row.device === null ? "" : fixed(row.device, 0));
    });
    p.bar.style.width = `${100 * (stream.quality ?? 0)}%`;
    attribute(p.bar, "data-kind", (stream.quality ?? 0) >= 0.8 ? "ok" : (stream.quality ?? 0) >= 0.5 ? "wait" : "bad");
    value(p.barValue, maybe(stream.quality, 2), stream.rows[0]?.reason || "the interpreter gives no quality");
    keyed(p.reasons, stream.reasons, (reason) => reason, (reason) => h("li", {}, reason), () => {});
  }

  clock(clock) {
    const p = this.parts;
    const known = { LOCKED: "ok", WARMUP: "wait", HOLDOVER: "wait", HOST: "plain", NONE: "bad" };
    text(p.clockState, { HOST: "host time", NONE: "none" }[clock.state] ?? clock.state);
    attribute(p.clockState, "data-kind", known[clock.state] ?? "bad");
    const why = clock.note || "the model does not say";
    const rows = clock.offset_s === undefined ? [] : [
      ["uncertainty", clock.uncertainty_ms === null ? null : `±${fixed(clock.uncertainty_ms, 1)} ms`],
      ["offset", offset(clock.offset_s)],
      ["skew", maybe(clock.skew_ppm, 1, "ppm")],
      ["latency", maybe(clock.latency_ms, 0, "ms")],
      ["segment", String(clock.segment)],
    ];
    this.pairs(p.clock, clock.note ? [...rows, ["note", clock.note]] : rows, why);
    const latencies = clock.latencies_ms ?? [];
    attribute(p.latency, "hidden", latencies.length < 3);
    if (latencies.length < 3) return;
    const top = Math.max(...latencies) * 1.1 || 1;
    const at = latencies.map((v, i) => `${((i / (latencies.length - 1)) * SPARK_W).toFixed(1)} ${(SPARK_H - 1 - (v / top) * (SPARK_H - 3)).toFixed(1)}`);
    attribute(p.path, "d", `M${at.join("L")}`);
    attribute(p.latency, "aria-label", `latency of the last ${latencies.length} models, at most ${fixed(Math.max(...latencies), 0)} ms`);
  }

  health(stream) {
    const p = this.parts, health = stream.health;
    text(p.healthState, stream.status);
    const kinds = { streaming: "ok", derived: "ok", lost: "bad", silent: "bad" };
    attribute(p.healthState, "data-kind", kinds[stream.status] ?? "wait");
    if (!health) {
      this.pairs(p.health, [["driver", null]], "no health on the graph for this stream");
      return;
    }
    const why = health.stale || "the device does not tell";
    this.pairs(p.health, [
      ["rate", health.measured_hz === null ? null : `${fixed(health.measured_hz, 1)} of ${maybe(health.nominal_hz, 1) ?? "–"} Hz`],
      ["lost", health.lost === null ? null : `${health.lost} samples`],
      ["gaps", health.gaps === null ? null : String(health.gaps)],
      ["reconnects", health.reconnects === null ? null : String(health.reconnects)],
      ["battery", maybe(health.battery, 0, "%")],
      ["RSSI", maybe(health.rssi, 0, "dBm")],
      ["contact", health.contact === null ? null : health.contact ? "on the skin" : "off the skin"],
      ["host", health.host || null],
      ...health.reasons.map((reason, i) => [i ? `note ${i + 1}` : "note", reason]),
    ], why);
  }

  /** @param {HTMLElement} list @param {any[][]} pairs @param {string} why */
  pairs(list, pairs, why) {
    keyed(list, pairs, ([name]) => name, ([name]) => {
      const shown = h("dd", {}, h("span", { class: "number" }));
      return Object.assign(h("div", {}, h("dt", {}, name), shown), { shown: shown.firstElementChild });
    }, (element, [, shown]) => value(element.shown, shown, why));
  }
}
