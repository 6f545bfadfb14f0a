// The column of the glance: heart rate and state of everyone, readable from three metres.

import { h, s, keyed, text, attribute, value, byId } from "./dom.js";
import { fixed, words } from "./format.js";
import { STATE_SIGNS, kind, sign } from "./status.js";

/** Show a name that is broken behind its underscores, where it is too long for one line. */
function named(/** @type {Element} */ element, /** @type {string} */ name) {
  if (element.textContent !== name) element.replaceChildren(...name.split(/(?<=_)/).flatMap((part) => [part, h("wbr")]));
}

const SPARK_W = 100, SPARK_H = 26;

export class Participants {
  /**
   * @param {(key: string) => void} onChoose
   * @param {import("./drag.js").Drag} drag
   */
  constructor(onChoose, drag) {
    this.drag = drag;
    this.container = byId("participants");
    this.onChoose = onChoose;
    this.trends = new Map();
  }

  /** Take the strip's data: the small line beside the heart rate. */
  trend(message) {
    this.trends = new Map(message.participants.map((participant) => [participant.id, participant.heart_rate.slice(-120)]));
    for (const card of this.container.children) this.spark(/** @type {any} */ (card));
  }

  /** Take the study message. */
  update(study, /** @type {string|null} */ chosen) {
    this.problems = study.problems;
    this.streams = new Map(study.streams.map((stream) => [stream.key, stream]));
    keyed(this.container, study.participants, (p) => p.id, (p) => this.card(p), (card, p) => this.fill(card, p, chosen));
  }

  card(participant) {
    const path = s("path", { class: "spark-line" });
    const spark = s("svg", { viewBox: `0 0 ${SPARK_W} ${SPARK_H}`, class: "spark", "aria-hidden": "true", preserveAspectRatio: "none" });
    spark.append(path);
    const parts = {
      rate: h("span", { class: "rate" }),
      state: h("span", { class: "state-word" }),
      stateSign: h("span", { class: "state-sign", "aria-hidden": "true" }),
      expression: h("span", { class: "expression" }),
      sensors: h("ul", { class: "sensors" }),
      wrong: h("p", { class: "wrong" }),
      path,
    };
    const nobody = participant.id === "unassigned", name = nobody ? "worn by nobody" : participant.id;
    const opener = h("button", { type: "button", class: "opener", "aria-label": `full card of ${name}`, "aria-expanded": "false", onclick: () => {
      attribute(opener, "aria-expanded", String(card.classList.toggle("open")));
    } });
    const card = h(
      "article",
      { class: `card${nobody ? " nobody" : ""}`, "data-human": participant.id, "aria-label": nobody ? name : `participant ${name}` },
      h("h2", {}, h("span", { class: "who" }, opener, name), parts.expression),
      nobody ? null : h("div", { class: "glance" }, h("span", { class: "heart" }, parts.rate, h("span", { class: "bpm" }, "bpm")), /** @type {any} */ (spark)),
      nobody ? null : h("div", { class: "state", tabindex: "0" }, parts.stateSign, parts.state),
      parts.sensors,
      parts.wrong,
    );
    return Object.assign(card, { parts });
  }

  fill(card, participant, chosen) {
    const { rate, state, stateSign, expression, sensors } = card.parts;
    if (participant.id !== "unassigned") {
      value(rate, participant.heart_rate === null ? null : fixed(participant.heart_rate, 0), participant.heart_rate_note);
      if (participant.heart_rate !== null) attribute(rate, "data-tip", `${fixed(participant.heart_rate, 1)} bpm from ${participant.heart_rate_note}`);
      text(state, words(participant.state));
      text(stateSign, STATE_SIGNS[participant.state] ?? "?");
      const box = state.parentElement;
      attribute(box, "data-state", participant.state in STATE_SIGNS ? participant.state : "unknown");
      const sure = participant.confidence ? `confidence ${fixed(participant.confidence, 2)}. ` : "";
      attribute(box, "data-tip", `${sure}${participant.reasons.join("; ")}` || "no reason given");
    }
    text(expression, participant.expression ? participant.expression : "");
    this.wrong(card.parts.wrong, participant);
    keyed(sensors, participant.sensors, (sensor) => sensor.id, (sensor) => this.sensor(sensor.id), (item, sensor) => {
      const { mark, name, types } = item.parts;
      text(mark, sign(sensor.status));
      attribute(item.button, "data-kind", kind(sensor.status));
      named(name, sensor.id);
      const word = sensor.status === "streaming" || sensor.status === "derived" ? "" : sensor.status;
      text(item.parts.word, word);
      attribute(item.button, "aria-label", `${sensor.id}: ${sensor.status}`);
      attribute(item.button, "aria-pressed", sensor.streams.includes(chosen) ? "true" : "false");
      item.first = sensor.streams.find((key) => this.streams.get(key)?.type !== "accelerometer") ?? sensor.streams[0];
      keyed(types, sensor.streams.map((key) => this.streams.get(key)).filter(Boolean), (stream) => stream.key,
        (stream) => h("span", { class: "dot", "data-type": stream.type, title: stream.label }), () => {});
    });
    this.spark(card);
  }

  /** Why there is no heart rate, and what is wrong with a participant's streams, newest first; not that all come late. */
  wrong(element, { id, heart_rate: rate, heart_rate_note: note }) {
    const own = this.problems.filter((problem) => problem.stream.startsWith(`${id}/`) && problem.alert !== "LatencyGrowing");
    const said = own.map((problem) => problem.text.replace(`${id} / `, ""));
    if (rate === null && id !== "unassigned") said.unshift(`no heart rate: ${note}`);
    text(element, said.length ? `⚠ ${said.join("; ")}` : "");
    attribute(element, "data-kind", own.some((problem) => problem.severity === "error") ? "bad" : "wait");
    attribute(element, "data-tip", said.join("; ") || null);
    attribute(element, "tabindex", said.length ? "0" : null);
  }

  sensor(/** @type {string} */ id) {
    const parts = {
      mark: h("span", { class: "sign", "aria-hidden": "true" }), name: h("span", { class: "name" }),
      word: h("span", { class: "word" }), types: h("span", { class: "dots", "aria-hidden": "true" }),
    };
    const item = h("li", {});
    const button = h("button", { type: "button", "data-sensor": id, title: "press w to say who wears it", onclick: () => this.onChoose(/** @type {any} */ (item).first) }, parts.mark, parts.name, parts.word, parts.types);
    const grip = h("span", { class: "grip", title: "drag to another participant", "aria-hidden": "true" }, "⠿");
    this.drag.from(grip, id);
    item.append(grip, button);
    return Object.assign(item, { parts, button });
  }

  spark(card) {
    if (!card.parts?.path) return;
    const points = this.trends.get(card.key) ?? [], values = points.map(([, v]) => v).filter((v) => v !== null);
    const middle = (Math.min(...values) + Math.max(...values)) / 2;
    const reach = Math.max(10, Math.max(...values) - Math.min(...values)) / 2;
    const from = points[0]?.[0], to = points.at(-1)?.[0];
    const at = points.map(([t, v], i) => {
      if (v === null) return "";
      const lifted = i === 0 || points[i - 1][1] === null;
      const x = ((t - from) / (to - from || 1)) * SPARK_W;
      return `${lifted ? "M" : "L"}${x.toFixed(1)} ${(SPARK_H / 2 - ((v - middle) / reach) * (SPARK_H / 2 - 3)).toFixed(1)}`;
    });
    attribute(card.parts.path, "d", values.length < 3 ? null : at.join(""));
  }
}
