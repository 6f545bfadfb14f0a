// Who may operate: a token, typed or from the address's fragment, is exchanged for a cookie that no script can read.

import { text, byId } from "./dom.js";

export class Access {
  /** @param {() => void} onChange the browser may do more than before */
  constructor(onChange) {
    this.onChange = onChange;
    this.asking = false; // the dialog has opened by itself
    this.dialog = /** @type {HTMLDialogElement} */ (byId("access"));
    this.token = /** @type {HTMLInputElement} */ (byId("access-token"));
    byId("access-button").addEventListener("click", () => this.dialog.showModal());
    byId("access-cancel").addEventListener("click", () => this.dialog.close());
    byId("access-leave").addEventListener("click", () => this.leave());
    byId("access-form").addEventListener("submit", (event) => { event.preventDefault(); this.typed(); });
    addEventListener("hashchange", async () => { if (await this.brought()) this.onChange(); });
  }

  /** Take the token that the address brings, and ask for one where nothing may be seen without. */
  async enter() {
    await this.brought();
    await this.askAgain();
  }

  /** Ask for a token where nothing may be seen without: at the beginning, or since the login has ended. */
  async askAgain() {
    const standing = await ask("/access").catch(() => null);
    if (standing?.role !== "nobody" || this.dialog.open) return;
    this.asking = true;
    this.say(standing.why);
    this.dialog.showModal();
  }

  /** Take what the server says this connection may do. */
  hello(message) {
    const button = byId("access-button");
    button.hidden = !message.why_not_operate && !message.by_token;
    text(button, message.role === "operate" ? "Operator" : "View only…");
    byId("access-leave").hidden = !message.by_token;
    this.say(message.why_not_operate || "You may operate: start, stop, mark, assign.");
    if (this.dialog.open && (this.asking || !message.why_not_operate)) this.dialog.close();
    this.asking = false;
  }

  /** Give the token back: whoever sits here next may do what everybody may. */
  async leave() {
    await ask("/leave", {}).catch(() => null);
    location.reload();
  }

  /** @returns {Promise<boolean>} whether the address's fragment brought a token; it stays neither there nor in the history */
  async brought() {
    const token = new URLSearchParams(location.hash.slice(1)).get("token");
    if (!token) return false;
    history.replaceState(null, "", location.pathname);
    return this.exchange(token);
  }

  async typed() {
    if (!await this.exchange(this.token.value)) return;
    this.token.value = "";
    this.dialog.close();
    this.onChange();
  }

  /** @returns {Promise<boolean>} whether the server took the token */
  async exchange(/** @type {string} */ token) {
    const answer = await ask("/token", { token }).catch(() => ({ error: "no connection to the server" }));
    text(byId("access-said"), answer.error ?? "");
    return !answer.error;
  }

  say(/** @type {string} */ why) {
    text(byId("access-why"), why);
    byId("access-button").title = why;
  }
}

/** @returns {Promise<any>} the JSON that answers a GET, or a POST of the body */
async function ask(/** @type {string} */ path, /** @type {object|null} */ body = null) {
  const post = { method: "POST", headers: { "Content-Type": "application/json" }, body: JSON.stringify(body) };
  return (await fetch(path, body ? post : {})).json();
}
