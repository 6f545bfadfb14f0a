// The line at the top: study, recording, streams, time.

import { text, attribute, byId } from "./dom.js";
import { duration } from "./format.js";

const FEW = 4; // of whom the line has room for the names
const DOUBTED = "▲ REC NOT CONFIRMED";
const phone = matchMedia("(max-width: 520px)"); // the words that it has no room for are left out

/** Whom a session records. */
function recorded(/** @type {string[]} */ humans) {
  if (phone.matches || !humans.length) return [];
  return [humans.length > FEW ? `${humans.length} participants` : humans.join(", ")];
}

export class Header {
  /** Take the study message. */
  update(study) {
    const session = study.session;
    text(byId("study-name"), session?.study ? `study “${session.study}”` : "");
    attribute(byId("study-name"), "title", session?.study || null);
    this.recording(study, session);
    const ok = study.streams.filter((stream) => stream.status === "streaming" || stream.status === "derived").length;
    const errors = study.problems.filter((problem) => problem.severity === "error").length;
    const warnings = study.problems.length - errors;
    const parts = [`${ok} of ${study.streams.length} ${phone.matches ? "" : "streams "}ok`];
    if (errors) parts.push(`${errors} lost${phone.matches ? "" : " or failed"}`);
    if (warnings) parts.push(`${warnings} warning${warnings > 1 ? "s" : ""}`);
    text(byId("streams-ok"), study.streams.length ? parts.join(" · ") : "no streams");
    attribute(byId("streams-ok"), "data-kind", errors ? "bad" : warnings ? "wait" : "plain");
    byId("replay").hidden = !study.replay;
    if (study.replay) text(byId("replay"), `replay of ${new Date(study.now_ms).toLocaleString()}`);
  }

  recording(study, session) {
    const chip = byId("recording");
    const phase = session?.replayed ? "replayed" : session?.phase ?? "idle";
    const recording = study.recorder?.recording ?? false;
    const silent = study.recorder?.recording === null;
    const words = {
      recording: () => [...(session.doubt ? [DOUBTED] : ["● REC", ...recorded(session.humans)]), duration(study.wall_ms - session.start_ms)].join(" "),
      replayed: () => "▷ a recording is played",
      preparing: () => "◐ preparing",
      stopping: () => "◐ stopping, writing to disk",
      failed: () => "◌ session failed",
    };
    text(chip, words[phase]?.() ?? (session?.doubt ? DOUBTED : recording ? "● recorder on" : silent ? "◌ recorder says nothing" : study.recorder ? "◐ recorder ready" : "◌ not recording"));
    attribute(chip, "data-kind", session?.doubt ? "bad" : phase === "recording" ? "rec" : phase === "failed" ? "bad" : recording ? "rec" : silent ? "wait" : "plain");
  }
}
