// The line at the top: study, recording, streams, time; and below it what is wrong, in sentences.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { duration, span, timeOfDay } from "./format.js";

const MOST_SENTENCES = 2; // more would take the room of the signals

export class Header {
  constructor() {
    /** @type {Set<string>} */
    this.dismissed = new Set();
    /** @type {Set<string>} */
    this.announced = new Set();
    this.study = null;
  }

  /** Take the study message. */
  update(study) {
    this.study = study;
    const session = study.session;
    text(byId("study-name"), session?.study ? `study “${session.study}”` : "");
    this.recording(study, session);
    const ok = study.streams.filter((stream) => stream.status === "streaming" || stream.status === "derived").length;
    const errors = study.problems.filter((problem) => problem.severity === "error").length;
    const warnings = study.problems.length - errors;
    const parts = [`${ok} of ${study.streams.length} streams ok`];
    if (errors) parts.push(`${errors} lost or failed`);
    if (warnings) parts.push(`${warnings} warning${warnings > 1 ? "s" : ""}`);
    text(byId("streams-ok"), study.streams.length ? parts.join(" · ") : "no streams");
    attribute(byId("streams-ok"), "data-kind", errors ? "bad" : warnings ? "wait" : "plain");
    byId("replay").hidden = !study.replay;
    if (study.replay) text(byId("replay"), `replay of ${new Date(study.now_ms).toLocaleString()}`);
    this.problems();
    this.announce();
    this.log();
  }

  /** Tell a screen reader of each problem once, when it begins; the visible sentences count seconds. */
  announce() {
    const fresh = this.study.problems.filter((problem) => !this.announced.has(problem.key));
    this.announced = new Set(this.study.problems.map((problem) => problem.key));
    if (fresh.length) text(byId("announce"), fresh.map((problem) => problem.text).join(". "));
  }

  recording(study, session) {
    const chip = byId("recording");
    const phase = session?.phase ?? "idle";
    const recording = study.recorder?.recording ?? false;
    const silent = study.recorder?.recording === null;
    const words = {
      recording: () => (session.doubt ? "▲ REC NOT CONFIRMED" : `● REC ${session.humans.join(", ")} ${duration(study.now_ms - session.start_ms)}`),
      preparing: () => "◐ preparing",
      stopping: () => "◐ stopping, writing to disk",
      failed: () => "◌ session failed",
    };
    text(chip, words[phase]?.() ?? (session?.doubt ? "▲ REC NOT CONFIRMED" : recording ? "● recorder on" : silent ? "◌ recorder says nothing" : study.recorder ? "◐ recorder ready" : "◌ not recording"));
    attribute(chip, "data-kind", session?.doubt ? "bad" : phase === "recording" ? "rec" : phase === "failed" ? "bad" : recording ? "rec" : silent ? "wait" : "plain");
  }

  problems() {
    const shown = this.study.problems.filter((problem) => problem.key !== "session" && !this.dismissed.has(problem.key)); // the bar tells of the session
    for (const key of this.dismissed) if (!this.study.problems.some((problem) => problem.key === key)) this.dismissed.delete(key);
    const container = byId("problems");
    const items = shown.slice(0, MOST_SENTENCES), more = shown.length - items.length;
    keyed(container, items, (problem) => problem.key, (problem) => this.sentence(problem), (element, problem) => {
      const rest = more && problem === items.at(-1) ? ` · and ${more} more, press l` : "";
      text(element.parts.text, problem.text + rest);
      attribute(element, "data-kind", problem.severity === "error" ? "bad" : "wait");
    });
  }

  sentence(problem) {
    const parts = { text: h("span", { class: "sentence" }) };
    const close = h("button", { type: "button", onclick: () => this.dismiss(problem.key) }, "dismiss");
    return Object.assign(h("p", { class: "problem" }, h("span", { "aria-hidden": "true" }, "⚠"), parts.text, close), { parts });
  }

  /** Hide one sentence, or without a key all of them, for as long as they last. */
  dismiss(/** @type {string|undefined} */ key) {
    for (const problem of this.study?.problems ?? []) if (!key || problem.key === key) this.dismissed.add(problem.key);
    this.problems();
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
