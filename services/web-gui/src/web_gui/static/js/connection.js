// The WebSocket: one view at a time, every frame acknowledged, every order answered, reconnects by itself.

import { decode } from "./frames.js";

const SHORTEST_MS = 500, LONGEST_MS = 5000, ANSWER_MS = 8000;
const LONGEST_BYTES = 60_000; // the server takes 64 kB
const UNANSWERED_MS = 10_000; // of a try to connect: the way to the server is cut, and may be back for another one
const SILENT_MS = 3000; // the server speaks twice a second; one that hangs keeps its connections open

export class Connection {
  /**
   * @param {{onStudy: Function, onTrend: Function, onFrame: Function, onHello: Function, onPong: Function, onState: (connected: boolean) => void, onShutOut: () => void}} handlers
   */
  constructor(handlers) {
    this.handlers = handlers;
    this.view = null;
    this.pauseMs = SHORTEST_MS;
    this.lastDataMs = 0;
    this.connected = false;
    this.refused = "";
    this.shutOut = false; // nothing may be seen without a token
    /** @type {Map<number, (answer: {ok: boolean, text: string}) => void>} */
    this.orders = new Map();
    this.orderNumber = 0;
    this.open();
    setInterval(() => this.watch(), 500);
  }

  open() {
    const scheme = location.protocol === "https:" ? "wss" : "ws";
    const socket = new WebSocket(`${scheme}://${location.host}/ws`);
    socket.binaryType = "arraybuffer";
    this.socket = socket;
    this.triedMs = performance.now();
    socket.onopen = () => {
      this.connected = true;
      this.lastDataMs = performance.now();
      this.pauseMs = SHORTEST_MS;
      this.handlers.onState(true);
      this.send(this.view);
    };
    socket.onmessage = (event) => this.receive(event.data);
    let opened = false;
    socket.addEventListener("open", () => { opened = true; this.refused = ""; this.shutOut = false; });
    socket.onclose = () => {
      if (!opened) this.ask();
      this.lost();
    };
  }

  /** The connection is gone: what waits for an answer gets none, and another one is tried for. */
  lost() {
    this.connected = false;
    for (const number of [...this.orders.keys()]) this.settle({ number, ok: false, text: "the connection was lost before the answer" });
    this.handlers.onState(false);
    setTimeout(() => this.open(), this.pauseMs);
    this.pauseMs = Math.min(LONGEST_MS, Math.max(SHORTEST_MS, this.pauseMs * 1.6));
  }

  /** Let go of a server that has fallen silent, or does not answer at all: it hangs, is stopped, or cannot be reached. */
  watch() {
    const now = performance.now(), tries = this.socket.readyState === WebSocket.CONNECTING;
    if (tries ? now - this.triedMs < UNANSWERED_MS : !this.connected || now - this.lastDataMs < SILENT_MS) return;
    this.socket.onclose = this.socket.onmessage = null;
    this.socket.close();
    this.lost();
  }

  /** Why the server does not let this page connect: a browser hides what a WebSocket was answered. */
  async ask() {
    const answer = await fetch("/ws").catch(() => null);
    const shutOut = answer?.status === 401;
    this.refused = shutOut ? "A token is needed to see this study" : answer?.status === 429 ? (await answer.json()).error : "";
    if (shutOut && !this.shutOut) this.handlers.onShutOut();
    this.shutOut = shutOut;
  }

  /** Connect anew, with what the browser may do by now. */
  renew() {
    this.pauseMs = 0;
    this.socket.close();
  }

  /** @param {string|ArrayBuffer} data */
  receive(data) {
    this.lastDataMs = performance.now();
    if (typeof data !== "string") {
      const frame = decode(data);
      this.send({ type: "ack", number: frame.number });
      this.handlers.onFrame(frame);
      return;
    }
    const message = JSON.parse(data);
    if (message.type === "study") this.handlers.onStudy(message);
    else if (message.type === "trend") this.handlers.onTrend(message);
    else if (message.type === "pong") this.handlers.onPong(message);
    else if (message.type === "answer") this.settle(message);
    else if (message.type === "hello") this.handlers.onHello(message);
    else if (message.type === "error") console.error(`the server refused a message: ${message.text}`);
  }

  /** Ask for a view; it is asked for again after a reconnect. */
  look(/** @type {object} */ view) {
    this.view = view;
    this.send(view);
  }

  /**
   * Ask for something to be done.
   * @param {object} order
   * @returns {Promise<{ok: boolean, text: string}>} what became of it, in words
   */
  order(order) {
    if (!this.connected) return Promise.resolve({ ok: false, text: "no connection to the server" });
    if (new Blob([JSON.stringify(order)]).size > LONGEST_BYTES) return Promise.resolve({ ok: false, text: "this is too much text: 60 kB can be sent at once" });
    this.orderNumber += 1;
    const number = this.orderNumber;
    this.send({ ...order, number });
    setTimeout(() => this.settle({ number, ok: false, text: "no answer from the server" }), ANSWER_MS);
    return new Promise((settle) => this.orders.set(number, settle));
  }

  settle(/** @type {{number: number, ok: boolean, text: string}} */ answer) {
    this.orders.get(answer.number)?.(answer);
    this.orders.delete(answer.number);
  }

  /** @param {object|null} message */
  send(message) {
    if (message && this.socket.readyState === WebSocket.OPEN) this.socket.send(JSON.stringify(message));
  }
}
