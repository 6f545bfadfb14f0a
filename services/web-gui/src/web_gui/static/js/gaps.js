// Where a line through values of successive messages is interrupted.

const BREAK_MS = 5000; // features older than this are not shown as current

/**
 * Whether nothing may be drawn from one message's value to the next one's.
 * @param {import("./frames.js").Mark|undefined} before
 * @param {import("./frames.js").Mark} mark
 * @param {[number, number][]} gaps of the signal, ms
 */
export function broken(before, mark, gaps) {
  if (!before || Number.isNaN(before.x) || Number.isNaN(mark.x) || mark.from - before.from > BREAK_MS) return true;
  return gaps.some(([from, to]) => from < mark.from && to > before.from);
}
