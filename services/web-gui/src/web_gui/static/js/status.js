// A status is a sign, a word and a colour; never colour alone.

const SIGNS = {
  streaming: "●", derived: "●", starting: "◐", connecting: "◐", waiting: "◐", stopping: "◐", silent: "◌", lost: "◌",
};
const KINDS = {
  streaming: "ok", derived: "ok", starting: "wait", connecting: "wait", waiting: "wait", stopping: "wait",
  silent: "bad", lost: "bad",
};
export const STATE_SIGNS = { __proto__: null, calm_relaxed: "●", alert_active: "▲", stressed_anxious: "◆", unknown: "?" };

/** @returns {string} */
export const sign = (/** @type {string} */ status) => SIGNS[status] ?? "◌";
/** @returns {string} ok, wait or bad */
export const kind = (/** @type {string} */ status) => KINDS[status] ?? "bad";
