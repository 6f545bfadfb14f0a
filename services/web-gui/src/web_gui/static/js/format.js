// Numbers and times as text.

/** @returns {string} a number with true minus sign */
export function fixed(/** @type {number} */ value, /** @type {number} */ digits) {
  const shown = value.toFixed(digits);
  return (Number(shown) === 0 ? shown.replace("-", "") : shown).replace("-", "−");
}

/** @returns {string} a number of which nothing else is known: two decimals, of a large one none, of a small one its first two digits */
export function plain(/** @type {number} */ value) {
  const size = Math.abs(value);
  if (size > 0 && size < 0.1) return String(Number(value.toPrecision(2))).replaceAll("-", "−");
  return fixed(value, size < 100 ? 2 : 0);
}

/** @returns {string|null} null stays null */
export const maybe = (/** @type {number|null|undefined} */ value, /** @type {number} */ digits, unit = "") =>
  value === null || value === undefined ? null : fixed(value, digits) + (unit ? ` ${unit}` : "");

const LARGE = /** @type {[string, number][]} */ ([["G", 1e9], ["M", 1e6], ["k", 1e3]]);

/** @returns {string} label of an axis tick */
export function tick(/** @type {number} */ value, /** @type {number} */ step) {
  const [sign, size] = LARGE.find(([, size]) => Math.abs(value) >= 10 * size) ?? ["", 1];
  const digits = Math.max(0, Math.min(6, -Math.floor(Math.log10(step / size) + 1e-9)));
  return fixed(value / size, digits) + sign;
}

/** @returns {string} 14:02:11 */
export function timeOfDay(/** @type {number} */ ms) {
  const date = new Date(ms);
  return [date.getHours(), date.getMinutes(), date.getSeconds()].map((n) => String(n).padStart(2, "0")).join(":");
}

/** @returns {string} 00:12:41 */
export function duration(/** @type {number} */ ms) {
  const seconds = Math.max(0, Math.floor(ms / 1000));
  const parts = [Math.floor(seconds / 3600), Math.floor(seconds / 60) % 60, seconds % 60];
  return parts.map((n) => String(n).padStart(2, "0")).join(":");
}

/** @returns {string} 4.1 s, 2 min */
export function span(/** @type {number} */ ms) {
  const seconds = ms / 1000;
  if (seconds < 10) return `${fixed(seconds, 1)} s`;
  return seconds < 120 ? `${fixed(seconds, 0)} s` : `${fixed(seconds / 60, 0)} min`;
}

/** @returns {string} a device clock's offset in the unit that reads best; days are no offset but another epoch */
export function offset(/** @type {number} */ seconds) {
  const size = Math.abs(seconds);
  if (size < 1) return `${fixed(seconds * 1000, 1)} ms`;
  if (size < 3600) return `${fixed(seconds, 3)} s`;
  if (size < 86400 * 3) return `${fixed(seconds / 3600, 1)} h`;
  return `other epoch (${fixed(seconds / 86400, 0)} d)`;
}

/** calm_relaxed -> calm relaxed */
export const words = (/** @type {string} */ name) => name.replaceAll("_", " ");

/** @returns {string} 12 345 */
export const count = (/** @type {number} */ number) => String(number).replace(/\B(?=(\d{3})+$)/g, "\u202f");

/** @returns {string} 41 GB */
export function bytes(/** @type {number} */ number) {
  for (const [unit, size] of /** @type {[string, number][]} */ ([["TB", 1e12], ["GB", 1e9], ["MB", 1e6]])) {
    if (number >= size) return `${fixed(number / size, number < 10 * size ? 1 : 0)} ${unit}`;
  }
  return `${fixed(number / 1e3, 0)} kB`;
}
