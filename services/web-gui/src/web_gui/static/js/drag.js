// A sensor dragged to somebody, by mouse, pen or finger: the same order as `worn by` beside the chosen sensor, which the
// keyboard uses. Made of pointer events: a browser's own drag and drop knows no finger, and no button in Firefox.

import { h, byId } from "./dom.js";

const NOBODY = "unassigned", NEW = "+"; // no pseudonym is a plus
const FAR = 6; // pixels; less is a click

export class Drag {
  /** @param {(sensor: string, human: string|null) => void} onDrop human null = somebody new, whose name is typed */
  constructor(onDrop) {
    this.onDrop = onDrop;
    this.ghost = h("div", { class: "ghost", "aria-hidden": "true", hidden: true });
    document.body.append(this.ghost);
    for (const ended of ["pointerup", "pointercancel"]) document.addEventListener(ended, () => this.end()); // also where the sensor has gone meanwhile
    this.targets = byId("targets");
    this.targets.append(h("div", { class: "card target", "data-human": NEW }, "somebody new…"), h("div", { class: "card target", "data-human": NOBODY }, "nobody"));
  }

  /** Let a sensor be dragged by an element, to any card that says whose it is. */
  from(/** @type {HTMLElement} */ grip, /** @type {string} */ sensor) {
    let begun = null;
    grip.addEventListener("pointerdown", (event) => {
      event.preventDefault();
      grip.setPointerCapture(event.pointerId);
      begun = [event.clientX, event.clientY];
    });
    grip.addEventListener("pointermove", (event) => {
      if (begun && Math.hypot(event.clientX - begun[0], event.clientY - begun[1]) > FAR) this.over(event, sensor);
    });
    grip.addEventListener("pointerup", (event) => {
      const card = begun && !this.ghost.hidden ? this.card(event) : null;
      begun = null;
      this.end();
      const human = card?.getAttribute("data-human");
      if (human) this.onDrop(sensor, human === NEW ? null : human);
    });
    grip.addEventListener("pointercancel", () => { begun = null; this.end(); });
  }

  /** @returns {Element|null} the card under the pointer */
  card(/** @type {PointerEvent} */ event) {
    return document.elementFromPoint(event.clientX, event.clientY)?.closest("[data-human]") ?? null;
  }

  over(/** @type {PointerEvent} */ event, /** @type {string} */ sensor) {
    this.targets.hidden = this.ghost.hidden = false;
    this.ghost.textContent = sensor;
    this.ghost.style.left = `${event.clientX + 12}px`;
    this.ghost.style.top = `${event.clientY + 8}px`;
    const under = this.card(event);
    for (const card of document.querySelectorAll("[data-human]")) card.classList.toggle("drop", card === under);
  }

  end() {
    this.targets.hidden = this.ghost.hidden = true;
    for (const card of document.querySelectorAll(".drop")) card.classList.remove("drop");
  }
}
