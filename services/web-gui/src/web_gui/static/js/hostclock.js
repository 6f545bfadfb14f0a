// The host's wall clock as this page knows it: pings over the WebSocket, the one with the shortest way there and back.

const FIRST_PINGS = 5, FIRST_EVERY_MS = 60, EVERY_MS = 2000, KEPT_MS = 30000;
const DRIFT = 1e-4; // of a clock against another one, at most; a ping grows older and less sure by it
const STEP_MS = 2; // pings that disagree by more than their uncertainty and this: one of the clocks was set

const SLEPT_MS = 1000; // by which the time of day goes ahead of the page's clock, which stands still while the computer sleeps

const WAITED_MS = 10_000; // for an answer to a ping that tells what a time of before it was

/** What tells whether the computer has slept, or its time of day was set, since. */
export const ahead = () => Date.now() - performance.now();

/** How finely this browser's clock ticks, in ms; some blur it on purpose. */
function tickMs() {
  let widest = 0;
  for (let i = 0, before = performance.now(); i < 3; i++) {
    let now = before;
    while (now === before) now = performance.now();
    widest = Math.max(widest, now - before);
    before = now;
  }
  return widest;
}

export class HostClock {
  /** @param {import("./connection.js").Connection} connection */
  constructor(connection) {
    this.connection = connection;
    this.tick = tickMs();
    /** @type {{atMs: number, offsetMs: number, halfMs: number, aheadMs: number}[]} */
    this.pings = [];
    /** @type {Map<number, {atMs: number, aheadMs: number}>} */
    this.sent = new Map();
    /** @type {Map<(known: {offsetMs: number, uncertaintyMs: number}|null) => void, {pageMs: number, aheadMs: number}>} */
    this.waiting = new Map();
    this.number = 0;
    this.timer = 0;
  }

  /** Begin afresh with a new connection. */
  begin() {
    this.pings = [];
    this.sent.clear();
    clearTimeout(this.timer);
    this.ping(FIRST_PINGS);
  }

  /** The connection is lost: nobody waits for its answers any more. */
  end() {
    for (const settle of this.waiting.keys()) settle(null);
    this.waiting.clear();
  }

  ping(/** @type {number} */ soon) {
    if (!this.connection.connected) return;
    this.number += 1;
    this.sent.clear();
    this.sent.set(this.number, { atMs: performance.now(), aheadMs: ahead() });
    this.connection.send({ type: "ping", number: this.number });
    this.timer = setTimeout(() => this.ping(soon - 1), soon > 1 ? FIRST_EVERY_MS : EVERY_MS);
  }

  /** Take the answer to a ping. */
  take(message) {
    const now = performance.now(), sent = this.sent.get(message.number);
    if (sent === undefined) return;
    this.sent.delete(message.number);
    const { atMs, aheadMs } = sent;
    const ping = { atMs: now, offsetMs: message.host_ms - (atMs + now) / 2, halfMs: (now - atMs) / 2, aheadMs };
    const known = this.at(now);
    if (known && Math.abs(known.offsetMs - ping.offsetMs) > known.uncertaintyMs + ping.halfMs + STEP_MS) this.pings = [];
    this.pings = [...this.pings.filter((old) => now - old.atMs < KEPT_MS), ping];
    this.tell();
  }

  /** Tell who waits what is known by now. */
  tell() {
    for (const [settle, { pageMs, aheadMs }] of this.waiting) {
      const known = this.at(pageMs, aheadMs);
      if (!known) continue;
      this.waiting.delete(settle);
      settle(known);
    }
  }

  /**
   * The same as `at`, as soon as a ping tells it.
   * @param {number} pageMs
   * @param {number} aheadMs
   * @returns {Promise<{offsetMs: number, uncertaintyMs: number}|null>} null where none does in time, or the connection is lost
   */
  when(pageMs, aheadMs) {
    return new Promise((settle) => {
      this.waiting.set(settle, { pageMs, aheadMs });
      setTimeout(() => { this.waiting.delete(settle); settle(null); }, WAITED_MS);
      this.tell();
    });
  }

  /**
   * @param {number} pageMs a time of this page's clock, as in an event's timeStamp
   * @param {number} aheadMs what `ahead` was then: pings from before a sleep tell nothing of it
   * @returns {{offsetMs: number, uncertaintyMs: number}|null} what to add to it, and half the width of what is sure
   */
  at(pageMs, aheadMs = ahead()) {
    let best = null;
    for (const ping of this.pings) {
      if (Math.abs(ping.aheadMs - aheadMs) > SLEPT_MS) continue;
      const uncertaintyMs = ping.halfMs + this.tick + DRIFT * Math.abs(pageMs - ping.atMs);
      if (!best || uncertaintyMs < best.uncertaintyMs) best = { offsetMs: ping.offsetMs, uncertaintyMs };
    }
    return best;
  }
}
