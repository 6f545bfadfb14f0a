// The session: start and stop, what it waits for, what the recorder writes, and the report when it is done.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { bytes, count, fixed } from "./format.js";

const NOBODY = "No session-coordinator on the graph: sessions can neither be started nor stopped from here.";

export class SessionBar {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {import("./start.js").StartDialog} startDialog
   */
  constructor(connection, startDialog) {
    this.connection = connection;
    this.startDialog = startDialog;
    this.button = /** @type {HTMLButtonElement} */ (byId("session-button"));
    this.stopDialog = /** @type {HTMLDialogElement} */ (byId("stop"));
    this.study = null;
    this.answered = this.asked = "";
    this.announced = "";
    this.button.addEventListener("click", () => this.act());
    byId("stop-form").addEventListener("submit", () => this.stop());
    byId("stop-leave").addEventListener("click", () => this.stopDialog.close());
  }

  get running() { return !this.study?.session.replayed && ["preparing", "recording"].includes(this.study?.session.phase); }

  /** Take the study message. */
  update(study) {
    if (study.session.phase !== this.study?.session.phase) this.answered = "";
    this.study = study;
    const { session } = study;
    attribute(byId("session"), "data-phase", session.replayed ? "idle" : session.phase);
    const stopping = session.phase === "stopping" && !session.replayed;
    const label = this.running ? (session.phase === "preparing" ? "Cancel the start" : "Stop…") : stopping ? "Stopping" : "Start a session…";
    text(/** @type {Element} */ (this.button.firstElementChild), label);
    attribute(this.button, "disabled", !session.coordinator || session.phase === "stopping");
    this.said(study, session);
    this.recorder(study.recorder, session.replayed);
    const report = /** @type {HTMLAnchorElement} */ (byId("report"));
    report.hidden = !session.report;
    attribute(report, "href", session.report || null);
    this.checks(session);
    this.startDialog.update(study);
    this.stopDialogFor(session);
    this.announce(session);
  }

  said(study, session) {
    const name = session.id ? `${session.id}${session.task ? ` · ${session.task}` : ""}` : "";
    const seconds = Math.ceil((session.start_ms - study.wall_ms) / 1000);
    const missing = session.checks.filter((check) => !check.ok).length;
    const phases = {
      idle: () => [session.detail || "No session.", unrecorded(session), folder(session.directory)].filter(Boolean).join(" · "), // its title is the whole path
      preparing: () => `${name}: waiting for ${missing} of ${session.checks.length}`,
      recording: () => (seconds > 0 ? `${name} begins in ${seconds} s` : name), // that it records, the header tells
      stopping: () => `${name}: stopping${missing ? `, waiting for ${missing}` : ""}`,
      failed: () => `${name || "session"} failed: ${session.detail || "no reason given"}`,
    };
    const nobody = session.replayed ? `Played back: ${name || "a recording"}` : NOBODY + (this.running ? ` ${name} may go on.` : "");
    const sentence = session.coordinator && !session.replayed ? phases[session.phase]() : nobody;
    text(byId("session-said"), [this.answered, sentence].filter(Boolean).join(" · "));
    attribute(byId("session-said"), "data-kind", this.answered || session.phase === "failed" || unrecorded(session) ? "bad" : "plain");
    attribute(byId("session-said"), "title", session.directory || null);
  }

  recorder(recorder, replayed) {
    const place = byId("recorder");
    if (!recorder) text(place, "no recorder on the graph");
    else if (recorder.recording === null) text(place, "the recorder says nothing");
    else {
      const parts = recorder.recording ? [] : ["recorder ready"];
      if (recorder.messages !== null && recorder.recording) parts.push(`${count(recorder.messages)} messages`);
      if (recorder.lost !== null && recorder.recording) parts.push(`${count(recorder.lost)} lost`);
      if (recorder.free_bytes !== null) parts.push(`${bytes(recorder.free_bytes)} free`);
      if (recorder.minutes_left !== null) parts.push(left(recorder.minutes_left));
      text(place, parts.join(" · "));
    }
    attribute(place, "data-kind", !recorder && replayed ? "plain" : !recorder || recorder.level === "error" ? "bad" : recorder.recording === null || recorder.level === "warning" || recorder.lost > 0 ? "wait" : "plain");
    attribute(place, "title", [recorder?.message, recorder?.directory].filter(Boolean).join("\n") || null);
  }

  /** Green is there, red is missing; while recording only what is missing is told. */
  checks(session) {
    const missing = session.checks.filter((check) => !check.ok);
    const shown = { preparing: session.checks, stopping: session.checks, failed: missing, recording: missing }[session.phase] ?? [];
    const list = byId("checks");
    list.hidden = !shown.length;
    const ordered = [...shown].sort((a, b) => Number(a.ok) - Number(b.ok));
    keyed(list, ordered, (check) => `${check.kind} ${check.name}`, () => this.check(), (item, check) => {
      attribute(item, "data-kind", check.ok ? "ok" : "bad");
      text(item.parts.sign, check.ok ? "✓" : "✗");
      text(item.parts.word, check.ok ? "there: " : "missing: ");
      text(item.parts.name, check.kind === "stream" ? short(check.name) : check.name);
      text(item.parts.why, check.why);
      attribute(item, "title", check.name);
    });
  }

  check() {
    const parts = {
      sign: h("span", { class: "sign", "aria-hidden": "true" }), word: h("span", { class: "unseen" }),
      name: h("span", { class: "check-name" }), why: h("span", { class: "check-why" }),
    };
    return Object.assign(h("li", {}, parts.sign, parts.word, parts.name, parts.why), { parts });
  }

  /** Tell a screen reader of every change of phase, once. */
  announce(session) {
    const key = `${session.phase} ${session.id}`;
    if (this.announced && key !== this.announced) {
      const missing = session.checks.filter((check) => !check.ok).map((check) => check.name);
      text(byId("session-announce"), `session ${session.phase} ${session.id}${missing.length ? `, waiting for ${missing.join(", ")}` : ""} ${session.phase === "failed" ? session.detail : ""}`);
    }
    this.announced = key;
  }

  /** Start or stop, whichever can be done. */
  act() {
    if (!this.study || this.button.disabled) return;
    if (!this.running) {
      this.startDialog.open();
      return;
    }
    this.asked = this.study.session.id;
    this.stopDialog.showModal();
    this.stopDialogFor(this.study.session);
  }

  /** What would be stopped; where somebody else has stopped it meanwhile there is nothing to ask. */
  stopDialogFor(session) {
    if (!this.stopDialog.open) return;
    if (!this.running || session.id !== this.asked) this.stopDialog.close();
    const runs = session.doubt ? `runs, but ${session.doubt}` : "is being recorded";
    const known = `Session ${session.id} ${session.phase === "preparing" ? "has not begun yet" : runs}.`;
    const unknown = `No connection to the server: session ${session.id} may go on, and cannot be stopped from here.`;
    text(byId("stop-what"), this.connection.connected ? known : unknown);
  }

  async stop() {
    const answer = await this.connection.order({ type: "stop", session_id: this.asked }); // not another one, begun meanwhile
    this.answered = answer.ok || !this.running ? "" : answer.text; // what somebody else has stopped meanwhile tells its own end
    this.update(this.study);
  }
}

/** /humans/physiological/p1/ecg/h10_1/raw -> p1 / ecg / h10_1 */
const short = (/** @type {string} */ topic) => topic.replace(/^\/humans\/physiological\/(.+)\/raw$/, "$1").replaceAll("/", " / ").replace(/^ \/ /, "/ ");

/** What a session that is over went through without its recorder. */
const unrecorded = (session) => (session.phase === "idle" && session.unrecorded_s ? `for ${session.unrecorded_s} s of it the recorder was not heard to record` : "");

/** /recordings/demo/p1-p2/s1_rest_20261121T071818Z -> …/s1_rest_20261121T071818Z */
const folder = (/** @type {string} */ path) => path.replace(/^.*\/(?=[^/]+$)/, "…/");

/** 41 min left, 12 h left, 85 days left */
function left(/** @type {number} */ minutes) {
  if (minutes < 600) return `${fixed(minutes, 0)} min left`;
  return minutes < 4320 ? `${fixed(minutes / 60, 0)} h left` : `${fixed(minutes / 1440, 0)} days left`;
}
