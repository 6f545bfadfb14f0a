// Markers: a button and a key each, stamped when they were pressed.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { fixed, words } from "./format.js";
import { ahead } from "./hostclock.js";

const SAID_MS = 4000, SHOWN_MS = 5000;
const EVERYONE = "";

/** The key as it stands in `marker_keys`: a capital letter means Shift, whatever Caps Lock says; a Greek or Russian one is the Latin one on its place. */
export function keyOf(/** @type {KeyboardEvent} */ event) {
  if (event.key.length !== 1) return event.key;
  const place = event.key > "\x7f" ? /^Key([A-Z])$/.exec(event.code) : null, key = place ? place[1] : event.key;
  return event.shiftKey ? key.toUpperCase() : key.toLowerCase();
}

export class Markers {
  /**
   * @param {import("./connection.js").Connection} connection
   * @param {import("./hostclock.js").HostClock} clock
   * @param {() => void} onPressed
   */
  constructor(connection, clock, onPressed) {
    this.connection = connection;
    this.clock = clock;
    this.onPressed = onPressed;
    /** @type {{key: string, name: string}[]} */
    this.keys = [];
    /** @type {{at_ms: number, name: string, value: string, human: string, untilMs: number}[]} */
    this.own = [];
    this.human = /** @type {HTMLSelectElement} */ (byId("marker-human"));
    this.note = /** @type {HTMLDialogElement} */ (byId("note"));
    this.noteText = /** @type {HTMLInputElement} */ (byId("note-text"));
    this.pressed = null;
    this.timer = 0;
    byId("note-form").addEventListener("submit", () => this.send(this.pressed, this.noteText.value.trim()));
    byId("note-leave").addEventListener("click", () => this.note.close());
  }

  /** Take the markers of this server. */
  hello(message) {
    this.keys = message.marker_keys;
    keyed(byId("marker-buttons"), this.keys, nameOf, (marker) => this.button(marker), () => {});
    keyed(byId("marker-help"), this.keys, nameOf, (marker) =>
      h("div", {}, h("dt", {}, h("kbd", {}, shown(marker.key))), h("dd", {}, words(marker.name))), () => {});
  }

  button(marker) {
    let pressedMs = null;
    const press = (/** @type {Event} */ event) => { if (!(/** @type {any} */ (event).repeat)) pressedMs = event.timeStamp; };
    const act = (/** @type {Event} */ event) => {
      this.press(marker, pressedMs ?? event.timeStamp);
      pressedMs = null;
    };
    return h("button", {
      type: "button", "data-marker": marker.name, title: `marker ${marker.name} (${shown(marker.key)})`,
      "aria-keyshortcuts": shown(marker.key), onpointerdown: press, onkeydown: press, onclick: act,
    }, h("kbd", { "aria-hidden": "true" }, shown(marker.key)), words(marker.name));
  }

  /** Offer these people. */
  people(/** @type {string[]} */ humans) {
    const chosen = this.human.value;
    keyed(this.human, [EVERYONE, ...humans], (id) => id, (id) => h("option", { value: id }, id || "everyone"), () => {});
    this.human.value = [...this.human.options].some((option) => option.value === chosen) ? chosen : EVERYONE;
  }

  /** @returns {boolean} whether the key is a marker's */
  takeKey(/** @type {KeyboardEvent} */ event) {
    const marker = this.keys.find((one) => one.key === keyOf(event));
    if (!marker) return false;
    if (!event.repeat) this.press(marker, event.timeStamp);
    return true;
  }

  press(marker, /** @type {number} */ pageMs) {
    if (!this.connection.connected) {
      this.refuse(words(marker.name));
      return;
    }
    const aheadMs = ahead();
    const pressed = { name: marker.name, pageMs, aheadMs, known: this.clock.at(pageMs, aheadMs), human: this.human.value };
    if (marker.name !== "note") {
      this.send(pressed, "");
      return;
    }
    this.pressed = pressed;
    this.noteText.value = "";
    this.note.showModal();
  }

  async send(pressed, /** @type {string} */ value) {
    const { name, pageMs, human } = pressed;
    const label = `${human ? `${human} ` : ""}${words(name)}${value ? `: ${value}` : ""}`;
    const known = pressed.known ?? await this.known(pressed, label);
    if (!known) {
      this.refuse(label);
      return;
    }
    const at_ms = pageMs + known.offsetMs, uncertainty_ms = known.uncertaintyMs;
    const own = { at_ms, name, value, human, untilMs: performance.now() + SHOWN_MS };
    this.own.push(own);
    this.onPressed();
    const answer = await this.connection.order({ type: "marker", name, value, human_id: human, at_ms, uncertainty_ms });
    if (!answer.ok) {
      this.own = this.own.filter((one) => one !== own);
      this.onPressed();
    }
    if (answer.ok) this.say(`${label} ± ${fixed(uncertainty_ms, 1)} ms`, "ok");
    else this.say(`marker ${label} is not sure to be set: ${answer.text}`, "bad");
  }

  /** What the server's clock was at a press from before it was known. */
  known({ pageMs, aheadMs }, /** @type {string} */ label) {
    this.say(`marker ${label} waits until the server's clock is known`, "plain");
    return this.clock.when(pageMs, aheadMs);
  }

  refuse(/** @type {string} */ label) {
    const why = this.connection.connected ? "the server's clock is not known, press again" : "no connection to the server";
    this.say(`${why}: marker ${label} is not set`, "bad");
  }

  say(/** @type {string} */ sentence, /** @type {"ok"|"bad"|"plain"} */ kind) {
    const place = byId("marker-said");
    text(place, sentence);
    attribute(place, "data-kind", kind);
    clearTimeout(this.timer);
    if (kind === "ok") this.timer = setTimeout(() => text(place, ""), SAID_MS);
  }

  /** The study's markers, and the page's own ones that are still on their way. */
  with(markers) {
    const now = performance.now();
    const arrived = (one) => markers.some((m) => m.name === one.name && Math.abs(m.at_ms - one.at_ms) < 2);
    this.own = this.own.filter((one) => now < one.untilMs && !arrived(one));
    return [...markers, ...this.own];
  }
}

/** By its key alone it would keep the name that a server of before had for it. */
const nameOf = (marker) => `${marker.key} ${marker.name}`;

/** A key as it is printed on the page. */
const shown = (/** @type {string} */ key) => (key !== key.toLowerCase() ? `Shift+${key.toLowerCase()}` : key);
