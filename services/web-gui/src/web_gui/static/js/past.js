// The slider below the signals: the last minutes that the server keeps, while it goes on receiving.

import { text, attribute, byId } from "./dom.js";
import { span } from "./format.js";

export class Past {
  /** @param {import("./lanes.js").Lanes} lanes */
  constructor(lanes) {
    this.lanes = lanes;
    this.slider = /** @type {HTMLInputElement} */ (byId("scrub"));
    this.slider.addEventListener("input", () => this.moved());
  }

  /** Show where the right edge stands within the seconds that are kept. */
  show(/** @type {number} */ keptS) {
    attribute(this.slider, "min", -Math.max(1, Math.round(keptS - this.lanes.windowMs / 1000)));
    const agoS = this.lanes.live ? 0 : (this.lanes.now() - this.lanes.endMs) / 1000;
    const at = String(-Math.round(2 * agoS) / 2 || 0);
    if (this.slider.value !== at) this.slider.value = at;
    const said = agoS < 0.5 ? "now" : `${span(1000 * agoS)} ago`;
    text(byId("scrub-said"), said);
    attribute(this.slider, "aria-valuetext", said);
  }

  moved() {
    const agoS = -Number(this.slider.value);
    this.lanes.setEnd(agoS < 0.5 ? null : this.lanes.now() - 1000 * agoS);
  }
}
