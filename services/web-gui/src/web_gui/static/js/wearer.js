// Who wears the sensor of the chosen stream, and who from now on: the registry is asked, and its answer told.

import { h, keyed, text, attribute } from "./dom.js";

const NEW = "+", NOBODY = "unassigned"; // no pseudonym is a plus

export class Wearer {
  /** @param {import("./connection.js").Connection} connection */
  constructor(connection) {
    this.connection = connection;
    this.sensor = "";
    this.touched = false;
    /** @type {{sensor: string, human: string}[]} Those that are asked, one after the other. */
    this.orders = [];
    this.select = /** @type {HTMLSelectElement} */ (h("select", { id: "wearer", onchange: () => this.touch() }));
    this.name = /** @type {HTMLInputElement} */ (h("input", {
      "aria-label": "pseudonym of somebody new", placeholder: "pseudonym, such as p3", maxlength: 63, autocomplete: "off", spellcheck: "false", hidden: true,
    }));
    this.button = h("button", { type: "submit" }, "Assign");
    this.said = h("p", { class: "said", role: "status" });
    this.notes = h("ul", { class: "reasons", "aria-label": "What the registry says" });
    this.element = h("form", { class: "wearer", onsubmit: (/** @type {Event} */ event) => { event.preventDefault(); this.send(); } },
      h("label", { for: "wearer" }, "worn by"), this.select, this.name, this.button, this.said, this.notes);
  }

  /** Show whose the stream's sensor is; what the reader has begun to choose stays. */
  show(stream, /** @type {string[]} */ people) {
    if (stream.sensor !== this.sensor) {
      this.sensor = stream.sensor;
      this.touched = false;
      this.say("", "plain");
    }
    this.element.hidden = stream.status === "derived"; // it follows the sensor that it is computed from
    const wished = this.touched && this.name.hidden ? [this.select.value] : []; // stays, also where the page knows them no more
    const labels = new Map([...people, stream.human, ...wished].map((id) => [id, id]));
    labels.set(NOBODY, "nobody").set(NEW, "somebody new…");
    keyed(this.select, [...labels], ([id]) => id, ([id, label]) => h("option", { value: id }, label), () => {});
    if (!this.touched && !this.orders.some((order) => order.sensor === this.sensor)) this.choose(stream.human);
    keyed(this.notes, stream.notes, (note) => note, (note) => h("li", {}, note), () => {});
  }

  /** Put the keyboard there. */
  focus() {
    this.element.scrollIntoView({ block: "nearest" });
    this.select.focus();
  }

  /** Give a sensor to somebody without further ado; null: to somebody new, whose name is typed. */
  give(/** @type {string|null} */ human) {
    this.touched = true;
    this.choose(human ?? NEW);
    if (human === null) this.name.focus();
    else this.send();
  }

  touch() {
    this.touched = true;
    this.choose(this.select.value);
    this.say("", "plain");
    if (!this.name.hidden) this.name.focus();
  }

  choose(/** @type {string} */ id) {
    if (this.select.value !== id) this.select.value = id;
    this.name.hidden = id !== NEW;
  }

  /** Ask for what is chosen, after what was asked for before; the same twice is once. */
  async send() {
    const { sensor } = this;
    const human = this.name.hidden ? this.select.value : this.name.value.trim();
    if (this.orders.some((order) => order.sensor === sensor && order.human === human)) return;
    this.orders.push({ sensor, human });
    this.say(`${sensor}: ${human} was asked for, not moved yet …`, "plain");
    if (this.orders.length > 1) return;
    for (; this.orders.length; this.orders.shift()) await this.ask(this.orders[0]);
  }

  async ask(/** @type {{sensor: string, human: string}} */ { sensor, human }) {
    const answer = await this.connection.order({ type: "assign", sensor_id: sensor, human_id: human });
    if (sensor === this.sensor) {
      if (answer.ok) this.name.value = "";
      if (answer.ok && this.name === document.activeElement) this.select.focus(); // it is about to be hidden
      this.touched = !answer.ok && !this.name.hidden; // a name that was mistyped stays to be mended, else who wears it is shown again
    }
    this.say(answer.text, answer.ok ? "ok" : "bad");
  }

  say(/** @type {string} */ sentence, /** @type {string} */ kind) {
    text(this.said, sentence);
    attribute(this.said, "data-kind", kind);
  }
}
