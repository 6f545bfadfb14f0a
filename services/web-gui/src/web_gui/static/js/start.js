// The dialog that asks for a session.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { Preflight } from "./preflight.js";

const KEPT = "sense4hri-study";

/** The metadata as they were typed: a number that this page read and wrote again would be another one beyond 2^53. */
function withNote(/** @type {string} */ typed, /** @type {boolean} */ empty, /** @type {string} */ note) {
  if (!note) return empty ? "" : typed;
  return `${empty ? "{" : `${typed.slice(0, -1)}, `}"note": ${JSON.stringify(note)}}`;
}

const input = (/** @type {string} */ id) => /** @type {HTMLInputElement} */ (byId(id));
/** The names that were typed. */
const lines = (/** @type {string} */ id) => [...new Set(input(id).value.split(/[\s,]+/).filter(Boolean))];

export class StartDialog {
  /** @param {import("./connection.js").Connection} connection */
  constructor(connection) {
    this.connection = connection;
    this.dialog = /** @type {HTMLDialogElement} */ (byId("start"));
    this.study = null;
    this.studyName = "";
    /** @type {Map<string, boolean>} what the reader has ticked by hand */
    this.people = new Map();
    this.streams = new Map();
    this.asking = false;
    this.preflight = new Preflight();
    for (const id of ["start-minutes", "start-warmup", "start-more-humans", "start-more-streams"]) byId(id).addEventListener("input", () => this.fill());
    byId("start-form").addEventListener("submit", (event) => { event.preventDefault(); this.send(); });
    byId("start-leave").addEventListener("click", () => this.dialog.close());
  }

  /** Take the study message: live streams come and go while the dialog is open. */
  update(study) {
    this.study = study;
    this.studyName = study.session.study || this.studyName; // of a session that is over nobody says it any more
    if (this.dialog.open) this.fill();
  }

  open() {
    this.people.clear();
    this.streams.clear();
    input("start-study").value ||= this.studyName || localStorage.getItem(KEPT) || "";
    input("start-session").value = "";
    this.say("");
    this.fill();
    this.dialog.showModal();
  }

  fill() {
    const live = this.study.streams.filter((stream) => stream.raw && stream.human !== "unassigned");
    const humans = [...new Set(this.study.participants.map((p) => p.id).filter((id) => id !== "unassigned"))];
    this.boxes("start-humans", humans.map((id) => ({ key: id, label: id, on: this.people.get(id) ?? true })), this.people);
    const chosen = new Set(humans.filter((id) => this.people.get(id) ?? true));
    const offered = live.filter((stream) => chosen.has(stream.human));
    this.boxes("start-streams", offered.map((stream) => ({
      key: `/humans/physiological/${stream.key}/raw`, label: stream.key.replaceAll("/", " / "),
      on: this.streams.get(`/humans/physiological/${stream.key}/raw`) ?? true,
      note: stream.status === "streaming" ? "" : stream.status,
    })), this.streams);
    byId("start-no-humans").hidden = humans.length > 0;
    byId("start-no-streams").hidden = offered.length > 0;
    const required = new Set([...this.ticked("start-streams"), ...lines("start-more-streams")]);
    this.preflight.show(this.study, required, lines("start-more-humans"), this.connection.connected);
  }

  boxes(/** @type {string} */ id, choices, /** @type {Map<string, boolean>} */ ticked) {
    keyed(byId(id), choices, (choice) => choice.key, (choice) => {
      const box = /** @type {HTMLInputElement} */ (h("input", { type: "checkbox", value: choice.key }));
      box.addEventListener("change", () => { ticked.set(choice.key, box.checked); this.fill(); });
      const note = h("span", { class: "check-why" });
      return Object.assign(h("label", {}, box, h("span", {}, choice.label), note), { box, note });
    }, (label, choice) => {
      if (label.box.checked !== choice.on) label.box.checked = choice.on;
      text(label.note, choice.note ?? "");
    });
  }

  /** What is ticked now. */
  ticked(/** @type {string} */ id) {
    return [...byId(id).querySelectorAll("input:checked")].map((box) => /** @type {HTMLInputElement} */ (box).value);
  }

  async send() {
    if (this.asking) return;
    const metadata = input("start-metadata").value.trim() || "{}", note = input("start-note").value.trim();
    let read = null;
    try {
      read = JSON.parse(metadata);
    } catch (error) {
      this.say(`Metadata is no JSON: ${/** @type {Error} */ (error).message}`);
      return;
    }
    if (read === null || typeof read !== "object" || Array.isArray(read)) {
      this.say("Metadata must be a JSON object such as {\"room\": \"2.07\"}");
      return;
    }
    this.asking = true;
    attribute(byId("start-send"), "disabled", true);
    this.say("asking the session-coordinator …");
    const answer = await this.connection.order({
      type: "start",
      study: input("start-study").value.trim(),
      session_id: input("start-session").value.trim(),
      task: input("start-task").value.trim(),
      metadata_json: withNote(metadata, !Object.keys(read).length, note),
      human_ids: [...new Set([...this.ticked("start-humans"), ...lines("start-more-humans")])],
      required_streams: [...new Set([...this.ticked("start-streams"), ...lines("start-more-streams")])],
      allow_warmup: input("start-warmup").checked,
    });
    this.asking = false;
    attribute(byId("start-send"), "disabled", null);
    this.say(answer.ok ? "" : answer.text);
    if (!answer.ok) return;
    localStorage.setItem(KEPT, input("start-study").value.trim());
    this.dialog.close();
  }

  say(/** @type {string} */ sentence) {
    text(byId("start-said"), sentence);
  }
}
