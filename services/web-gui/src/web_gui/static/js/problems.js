// What is wrong, in sentences: since when, of which stream; and for a moment what is over, with how long it lasted.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { span, timeOfDay } from "./format.js";

const FEW = 2; // more would take the room of the signals
const OVER_MS = 8000; // for so long what is over stays
const QUIET_MS = 5000; // between two announcements to a screen reader
const MOST_SPOKEN = 3;

export class Problems {
  /** @param {(stream: string) => void} onChoose */
  constructor(onChoose) {
    this.onChoose = onChoose;
    /** @type {Set<string>} */
    this.dismissed = new Set();
    /** @type {Map<string, string>} what lasted a moment ago: key -> sentence */
    this.known = new Map();
    /** @type {string[]} what a screen reader has not been told yet */
    this.news = [];
    this.spokenMs = -Infinity;
    this.all = false;
    this.study = null;
    byId("problems-all").addEventListener("click", () => this.toggle());
  }

  /** Take the study message. */
  update(study) {
    this.study = study;
    this.show();
    this.speak();
    this.log();
  }

  /** Show all that is wrong, or the newest alone. */
  toggle() {
    this.all = !this.all;
    this.show();
  }

  /** Hide one sentence, or without a key all of them, for as long as they last. */
  dismiss(/** @type {string|undefined} */ key) {
    const bar = byId("problems"), within = bar.contains(document.activeElement);
    for (const item of this.items()) if (!key || item.key === key) this.dismissed.add(item.key);
    this.show();
    if (within && !bar.contains(document.activeElement)) /** @type {HTMLElement} */ (bar.querySelector(".dismiss") ?? byId("lanes")).focus(); // not back to the top of the page
  }

  /** What lasts, and what was over a moment ago; the bar tells of the session. */
  items() {
    const { problems, log, wall_ms: now } = this.study ?? { problems: [], log: [], wall_ms: 0 };
    const lasting = new Set(problems.map((problem) => problem.key));
    const over = log.filter((entry) => now - entry.ended_ms < OVER_MS && !lasting.has(entry.key));
    return [...problems, ...over].filter((item) => item.key !== "session");
  }

  show() {
    const known = this.items(), keys = new Set(known.map((item) => item.key));
    for (const key of this.dismissed) if (!keys.has(key)) this.dismissed.delete(key);
    const items = known.filter((item) => !this.dismissed.has(item.key)), shown = this.all ? items : items.slice(0, FEW);
    byId("problems").hidden = !items.length;
    keyed(byId("problem-list"), shown, (item) => `${item.key} ${item.since_ms}`, (item) => this.item(item), (element, item) => this.fill(element, item));
    const button = byId("problems-all");
    button.hidden = items.length <= FEW;
    attribute(button, "aria-expanded", String(this.all));
    text(button, this.all ? "the newest alone (a)" : `all ${items.length} (a)`);
  }

  item(item) {
    const sentence = item.stream
      ? h("button", { type: "button", class: "sentence", title: "show this stream", onclick: () => this.onChoose(item.stream) })
      : h("span", { class: "sentence" });
    const parts = { sign: h("span", { class: "problem-sign", "aria-hidden": "true" }), sentence, since: h("span", { class: "since" }) };
    const close = h("button", { type: "button", class: "dismiss", onclick: () => this.dismiss(item.key) }, "dismiss");
    return Object.assign(h("li", { class: "problem" }, parts.sign, sentence, parts.since, close), { parts, close });
  }

  fill(element, item) {
    const over = item.ended_ms !== null;
    attribute(element, "data-kind", over ? "over" : item.severity === "error" ? "bad" : "wait");
    text(element.parts.sign, over ? "✓" : "⚠");
    text(element.parts.sentence, item.text);
    text(element.parts.since, over ? `over after ${span(item.ended_ms - item.since_ms)}` : `for ${span(this.study.wall_ms - item.since_ms)}`);
    attribute(element.parts.since, "title", `since ${timeOfDay(item.since_ms)}`);
    attribute(element.close, "aria-label", `dismiss: ${item.text}`);
  }

  /** Tell a screen reader what has begun and what is over, each once and not too often; the sentences count seconds. */
  speak() {
    const lasting = new Map(this.study.problems.map((problem) => [problem.key, problem.text]));
    for (const [key, sentence] of lasting) if (!this.known.has(key)) this.news.push(sentence);
    for (const [key, sentence] of this.known) if (!lasting.has(key)) this.news.push(`over: ${sentence}`);
    this.known = lasting;
    const now = performance.now();
    if (!this.news.length || now - this.spokenMs < QUIET_MS) return;
    this.spokenMs = now;
    const more = this.news.length - MOST_SPOKEN;
    text(byId("announce"), this.news.slice(-MOST_SPOKEN).join(". ") + (more > 0 ? `. And ${more} more` : ""));
    this.news = [];
  }

  log() {
    const entries = [...this.study.problems, ...this.study.log];
    keyed(/** @type {Element} */ (byId("log").querySelector("ol")), entries, (e) => `${e.key} ${e.since_ms}`, (e) =>
      h("li", {}, h("time", {}, timeOfDay(e.since_ms)), h("span", { class: "sentence" }), h("span", { class: "lasted" })),
    (element, e) => {
      text(element.children[1], e.text);
      text(element.children[2], e.ended_ms ? `over after ${span(e.ended_ms - e.since_ms)}` : "lasts");
    });
  }
}
