// Before a session: whether everything it needs is in order, and how to mend what is not.

import { h, keyed, text, attribute, byId } from "./dom.js";
import { bytes } from "./format.js";

const input = (/** @type {string} */ id) => /** @type {HTMLInputElement} */ (byId(id));

/** Somebody whom the page does not know: a name that is mistyped, or nobody who wears a sensor. */
const stranger = (/** @type {string} */ id) =>
  ({ name: `participant ${id}`, ok: false, found: "no sensor has been seen", mend: "look how the name is written, or say who wears what" });

/** A required stream that the page does not know; what a glob means is the coordinator's to say. */
const RAW = /^\/humans\/physiological\/(\w+\/\w+\/\w+)\/raw$/;
const missing = (/** @type {string} */ key) =>
  ({ name: spaced(key), ok: false, found: "no such stream has been seen", mend: "look how the topic is written, or start its driver" });
const spaced = (/** @type {string} */ key) => key.replaceAll("/", " / ");

const UNKNOWN = { name: "this page", ok: false, found: "no connection to the server, all else is how it was", mend: "it connects again by itself" };

export class Preflight {
  /** Show how things stand. @param {Set<string>} topics the raw topics that are required @param {string[]} typed participants beside those who are offered @param {boolean} connected */
  show(study, topics, typed, connected) {
    const required = study.streams.filter((stream) => stream.raw && topics.has(`/humans/physiological/${stream.key}/raw`));
    const unseen = [...topics].map((topic) => RAW.exec(topic)?.[1]).filter((key) => key && !required.some((stream) => stream.key === key));
    const rows = [
      ...(connected ? [] : [UNKNOWN]),
      ...typed.filter((id) => !study.participants.some((known) => known.id === id)).map(stranger),
      ...unseen.map(missing),
      ...required.map((stream) => this.stream(stream)),
      this.disk(study),
      ...study.preflight.items.map((item) => ({ name: item.what.replaceAll("_", "-"), ok: item.ok, found: item.found, mend: item.mend })),
    ];
    const wrong = rows.filter((row) => !row.ok);
    text(byId("preflight-sum"), wrong.length ? `${wrong.length} of ${rows.length} not in order` : `all ${rows.length} in order`);
    attribute(byId("preflight-sum"), "data-kind", wrong.length ? "bad" : "ok");
    keyed(byId("preflight"), [...wrong, ...rows.filter((row) => row.ok)], (row) => row.name, () => this.row(), (element, row) => {
      attribute(element, "data-kind", row.ok ? "ok" : "bad");
      text(element.parts.sign, row.ok ? "✓" : "✗");
      text(element.parts.word, row.ok ? "in order: " : "not in order: ");
      text(element.parts.name, row.name);
      text(element.parts.found, row.found);
      text(element.parts.mend, row.mend ? `→ ${row.mend}` : "");
    });
  }

  /** One row for all that a stream needs; where it may begin in warm-up, its clock need not be locked. */
  stream(stream) {
    const counted = stream.preflight.filter((item) => item.what !== "clock" || !input("start-warmup").checked);
    const wrong = counted.filter((item) => !item.ok);
    return {
      name: spaced(stream.key), ok: !wrong.length,
      found: (wrong.length ? wrong : stream.preflight).map((item) => item.found).join(" · "), mend: wrong.map((item) => item.mend).join("; "),
    };
  }

  /** Whether the disk lasts for the planned time, at the rate of what streams now. */
  disk(study) {
    const minutes = Number(input("start-minutes").value) || 0, free = study.recorder?.free_bytes ?? null;
    const needed = 60 * minutes * study.preflight.bytes_per_s;
    if (free === null) return { name: "disk", ok: false, found: "its free space is not known", mend: "the recorder tells it: start one" };
    const ok = free > needed;
    return { name: "disk", ok, found: `${bytes(free)} free, about ${bytes(needed)} needed for ${minutes} min`, mend: ok ? "" : "make room, or plan less" };
  }

  row() {
    const parts = {
      sign: h("span", { class: "sign", "aria-hidden": "true" }), word: h("span", { class: "unseen" }), name: h("span", { class: "check-name" }),
      found: h("span", { class: "check-why" }), mend: h("span", { class: "mend" }),
    };
    return Object.assign(h("li", {}, parts.sign, parts.word, parts.name, parts.found, parts.mend), { parts });
  }
}
