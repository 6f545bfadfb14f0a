// How much room a participant takes: a full card and high lanes, or all in sight at once. The number of participants
// decides until the reader does, whose choice is kept.

import { attribute, byId } from "./dom.js";

const KEPT = "sense4hri-compact";
const MANY = 5; // participants of whom the full cards are not all in sight

export class Density {
  /** @param {(compact: boolean) => void} onChange */
  constructor(onChange) {
    this.onChange = onChange;
    this.count = 0;
    this.compact = false;
    this.button = byId("density");
    this.button.addEventListener("click", () => this.toggle());
    this.show();
  }

  /** Take how many participants there are. */
  people(/** @type {number} */ count) {
    this.count = count;
    this.show();
  }

  toggle() {
    localStorage.setItem(KEPT, String(!this.compact));
    this.show();
  }

  show() {
    const chosen = localStorage.getItem(KEPT), compact = chosen === null ? this.count >= MANY : chosen === "true";
    attribute(this.button, "aria-pressed", String(compact));
    if (compact === this.compact) return;
    this.compact = compact;
    document.body.classList.toggle("compact", compact);
    this.onChange(compact);
  }
}
