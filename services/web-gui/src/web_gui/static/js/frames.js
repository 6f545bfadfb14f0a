// Decoder of the binary frame; the layout is described in frames.py.

const MAGIC = 0x31483453;
const FULL = 1, MARKS = 2, OFFSETS = 4, MARK_BYTES = 20;

/**
 * @typedef {Object} LanePart
 * @property {number} index
 * @property {boolean} full
 * @property {number} fromMs
 * @property {Float64Array} times ms since the Unix epoch
 * @property {(Float32Array|Float64Array)[]} low one per channel; double where the values need it
 * @property {(Float32Array|Float64Array)[]} high
 * @property {[number, number][]|null} gaps ms; null = unchanged
 * @property {Mark[]|null} marks null = unchanged
 */

/**
 * @typedef {Object} Mark
 * @property {number} kind its place in the stream's `drawn`
 * @property {number} from ms
 * @property {number} to ms, that of `from` where it has no length
 * @property {number} channel of the stream, -1 = all
 * @property {number} x its value or place, NaN = none
 * @property {number} y
 */

/**
 * @param {ArrayBuffer} buffer
 * @returns {{view: number, number: number, nowMs: number, lanes: LanePart[]}}
 */
export function decode(buffer) {
  const data = new DataView(buffer);
  if (data.getUint32(0, true) !== MAGIC) throw new Error("not a frame of this page's server");
  const lanes = data.getUint32(12, true);
  const baseMs = data.getFloat64(24, true);
  const frame = { view: data.getUint32(4, true), number: data.getUint32(8, true), nowMs: data.getFloat64(16, true), lanes: [] };
  let at = 32;
  const ms = (/** @type {number} */ count) => {
    const micros = new Int32Array(buffer, at, count);
    const times = new Float64Array(count);
    for (let i = 0; i < count; i++) times[i] = baseMs + micros[i] / 1000;
    at += 4 * count;
    return times;
  };
  const doubles = (/** @type {number} */ count) => {
    const found = Array.from({ length: count }, (_, i) => data.getFloat64(at + 8 * i, true));
    at += 8 * count;
    return found;
  };
  const channels = (/** @type {number} */ count, /** @type {number} */ points, /** @type {number[]} */ offsets) => {
    const found = [];
    for (let c = 0; c < count; c++, at += 4 * points) {
      const told = new Float32Array(buffer, at, points);
      found.push(offsets.length ? Float64Array.from(told, (v) => v + offsets[c]) : told);
    }
    return found;
  };
  for (let i = 0; i < lanes; i++) {
    const index = data.getUint16(at, true);
    const count = data.getUint8(at + 2);
    const flags = data.getUint8(at + 3);
    const points = data.getUint32(at + 4, true);
    const gapCount = data.getUint16(at + 8, true);
    const markCount = data.getUint16(at + 10, true);
    const fromMs = baseMs + data.getInt32(at + 12, true) / 1000;
    at += 16;
    const offsets = doubles(flags & OFFSETS ? count : 0);
    const times = ms(points), low = channels(count, points, offsets), high = channels(count, points, offsets);
    const edges = ms(2 * gapCount);
    const gaps = [];
    for (let g = 0; g < gapCount; g++) gaps.push([edges[2 * g], edges[2 * g + 1]]);
    const marks = [];
    for (let m = 0; m < markCount; m++, at += MARK_BYTES) marks.push(mark(data, at, baseMs));
    const told = (flags & MARKS) !== 0;
    frame.lanes.push({
      index, full: (flags & FULL) !== 0, fromMs, times, low, high, gaps: told ? gaps : null, marks: told ? marks : null,
    });
  }
  return frame;
}

/** @returns {Mark} */
const mark = (/** @type {DataView} */ data, /** @type {number} */ at, /** @type {number} */ baseMs) => ({
  from: baseMs + data.getInt32(at, true) / 1000,
  to: baseMs + data.getInt32(at + 4, true) / 1000,
  kind: data.getUint16(at + 8, true),
  channel: data.getInt16(at + 10, true),
  x: data.getFloat32(at + 12, true),
  y: data.getFloat32(at + 16, true),
});
