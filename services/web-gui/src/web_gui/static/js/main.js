// Wires the page: server -> panels, reader -> view.

import { Access } from "./access.js";
import { Connection } from "./connection.js";
import { Density } from "./density.js";
import { Details } from "./details.js";
import { attribute, byId, text, tooltips } from "./dom.js";
import { span, timeOfDay } from "./format.js";
import { Drag } from "./drag.js";
import { Header } from "./header.js";
import { HostClock } from "./hostclock.js";
import { Lanes } from "./lanes.js";
import { Markers, keyOf } from "./markers.js";
import { Participants } from "./participants.js";
import { Past } from "./past.js";
import { Problems } from "./problems.js";
import { SessionBar } from "./session.js";
import { StartDialog } from "./start.js";
import { Strip } from "./strip.js";
import { toggleTheme } from "./theme.js";
import { Wearer } from "./wearer.js";

const WINDOWS = { 1: 5, 2: 10, 3: 30 };

let study = null;
/** @type {string|null} */
let chosen = null;
let lostMs = performance.now();

const header = new Header();
const problems = new Problems(show);
const strip = new Strip();
const participants = new Participants(show, new Drag(give));
const access = new Access(() => connection.renew());
await access.enter();
const connection = new Connection({
  onStudy: takeStudy,
  onTrend: (message) => { strip.trend(message); participants.trend(message); },
  onFrame: (frame) => lanes.take(frame),
  onHello: (message) => { markers.hello(message); access.hello(message); },
  onPong: (message) => clock.take(message),
  onState: connectionChanged,
  onShutOut: () => access.askAgain(),
});
const lanes = new Lanes(connection, choose);
const density = new Density((compact) => lanes.setCompact(compact));
const past = new Past(lanes);
const wearer = new Wearer(connection);
const details = new Details(wearer);
const clock = new HostClock(connection);
const markers = new Markers(connection, clock, showMarkers);
const sessionBar = new SessionBar(connection, new StartDialog(connection));

function takeStudy(message) {
  study = message;
  if (!study.streams.some((stream) => stream.key === chosen)) {
    chosen = (moved(study) ?? study.streams.find((stream) => stream.raw) ?? study.streams[0])?.key ?? null;
  }
  strip.nowMs = study.now_ms;
  header.update(study);
  problems.update(study);
  sessionBar.update(study);
  markers.people(people());
  density.people(people().length);
  lanes.update(study);
  showMarkers();
  showEmpty();
  showChosen();
  tellTime();
  retell();
}

/** The chosen stream where somebody else wears its sensor now. */
function moved(study) {
  return study.streams.find((stream) => chosen?.endsWith(`/${stream.type}/${stream.sensor}`));
}

/** Everybody the page knows of. */
const people = () => study.participants.map((participant) => participant.id).filter((id) => id !== "unassigned");

/** Markers stand on the lanes at once, before the graph has brought them back. */
function showMarkers() {
  lanes.markers = strip.markers = markers.with(study?.markers ?? []);
}

function choose(/** @type {string} */ key) {
  chosen = key;
  showChosen();
}

/** Choose a stream and bring its lane into sight. */
function show(/** @type {string} */ key) {
  choose(key);
  lanes.lanes.get(key)?.element.scrollIntoView({ block: "nearest" });
}

/** A sensor was dropped on somebody; null: on somebody new. */
function give(/** @type {string} */ sensor, /** @type {string|null} */ human) {
  chooseSensor(sensor);
  wearer.give(human);
}

function chooseSensor(/** @type {string} */ sensor) {
  const streams = study.streams.filter((stream) => stream.sensor === sensor && stream.status !== "derived");
  if (streams.length) choose((streams.find((stream) => stream.key === chosen) ?? streams[0]).key);
}

/** Say who wears the sensor in focus, else the chosen one. */
function askWearer() {
  const sensor = document.activeElement?.getAttribute("data-sensor");
  if (sensor) chooseSensor(sensor);
  wearer.focus();
}

function showChosen() {
  participants.update(study, chosen);
  details.show(study.streams.find((stream) => stream.key === chosen) ?? null, people());
  for (const lane of lanes.lanes.values()) attribute(lane.button, "aria-current", lane.key === chosen ? "true" : null);
}

function chooseNext(/** @type {number} */ step) {
  const keys = [...lanes.lanes.keys()];
  const order = study.streams.map((stream) => stream.key).filter((key) => keys.includes(key));
  if (!order.length) return;
  const next = order[Math.max(0, Math.min(order.length - 1, order.indexOf(chosen) + step))];
  show(next);
  lanes.lanes.get(next).button.focus({ preventScroll: true });
}

function showEmpty() {
  const empty = byId("empty");
  const signals = study.streams.some((stream) => stream.lane);
  empty.hidden = signals;
  byId("lanes").hidden = !signals;
  byId("axis").hidden = byId("past").hidden = !signals;
  if (signals) return;
  const waiting = [...study.streams.map((stream) => `${stream.human} / ${stream.sensor}: ${stream.status}`), ...study.unseen.map((one) => `${one.node}: ${one.why}`)];
  text(empty.querySelector("h2"), waiting.length ? "Connecting to the sensors" : "Nothing is connected yet");
  text(empty.querySelector("p"), waiting.length
    ? "Drivers are on the graph, no samples so far. Their signals appear here with the first sample."
    : "This page shows every sensor on the ROS graph as soon as its driver runs. To see it with two virtual participants:");
  text(empty.querySelector("pre"), waiting.join("\n") || "make demo");
}

function connectionChanged(/** @type {boolean} */ connected) {
  document.body.classList.toggle("offline", !connected);
  byId("disconnected").hidden = connected;
  if (connected) {
    lanes.look();
    clock.begin();
  } else {
    lanes.freeze();
    clock.end();
    lostMs = connection.lastDataMs || lostMs;
  }
  if (study) sessionBar.update(study);
  tellTime();
}

function tellTime() {
  const edgeMs = lanes.endMs ?? (lanes.nowOffset === null ? study?.now_ms : lanes.now()); // never this browser's own time of day
  text(byId("clock"), edgeMs === undefined ? "" : timeOfDay(edgeMs));
  if (study) past.show(study.history_s);
  if (!connection.connected) {
    const { refused } = connection;
    text(byId("disconnected-why"), refused || "No connection to the server");
    text(byId("disconnected-age"), refused ? "" : `; last data ${span(performance.now() - lostMs)} ago`); // for the eye: a screen reader would say it four times a second
  }
}

function showView() {
  for (const button of document.querySelectorAll("[data-window]")) {
    attribute(button, "aria-checked", String(Number(button.getAttribute("data-window")) * 1000 === lanes.windowMs));
  }
  attribute(byId("pause"), "aria-pressed", String(!lanes.live));
  text(byId("pause"), lanes.live ? "Pause" : "Paused");
  attribute(byId("live"), "disabled", lanes.live);
  text(byId("columns"), `▥ ${lanes.columns}`);
  attribute(byId("columns"), "aria-label", `Participants side by side: ${lanes.columns} column${lanes.columns > 1 ? "s" : ""}`);
  attribute(byId("forward"), "disabled", lanes.live);
  document.body.classList.toggle("paused", !lanes.live);
  tellTime();
}

const setWindow = (/** @type {number} */ seconds) => { lanes.setWindow(seconds); showView(); };
const oldest = () => lanes.now() - 1000 * study.history_s + lanes.windowMs;
const openDialog = (/** @type {string} */ id) => /** @type {HTMLDialogElement} */ (byId(id)).showModal();

/** Where a key is a letter, and no order; a dialog that was closed keeps the keys until the next picture. */
const CLOSED = "dialog:not([open])", TYPED_INTO = "textarea, input:not([type=range]):not([type=checkbox]), #wearer";

const KEYS = {
  " ": () => lanes.pause(),
  ArrowLeft: () => lanes.scroll(-0.2),
  ArrowRight: () => { if (!lanes.live) lanes.scroll(0.2); },
  ArrowUp: () => chooseNext(-1),
  ArrowDown: () => chooseNext(1),
  PageUp: () => lanes.scroll(-1),
  PageDown: () => { if (!lanes.live) lanes.scroll(1); },
  Home: () => lanes.setEnd(oldest()),
  End: () => lanes.setEnd(null),
  1: () => setWindow(WINDOWS[1]),
  2: () => setWindow(WINDOWS[2]),
  3: () => setWindow(WINDOWS[3]),
  a: () => problems.toggle(),
  d: () => problems.dismiss(),
  g: () => sessionBar.act(),
  l: () => openDialog("log"),
  t: toggleTheme,
  o: () => lanes.nextColumns(),
  v: () => density.toggle(),
  w: askWearer,
  f: () => { const lane = lanes.lanes.get(chosen); if (lane && !lane.opener.hidden) lane.fold(); },
  "?": () => openDialog("help"),
};

document.addEventListener("keydown", (event) => {
  const target = /** @type {Element} */ (event.target);
  if (event.ctrlKey || event.metaKey || event.altKey || document.querySelector("dialog[open]")) return;
  if (target.closest(TYPED_INTO) && !target.closest(CLOSED)) return;
  if (markers.takeKey(event)) {
    event.preventDefault(); // also a list's own search, which would choose somebody else
    return;
  }
  if (!study || (target.closest("input, select") && !target.closest(CLOSED))) return; // which have other keys of their own
  const act = KEYS[keyOf(event)];
  if (!act || (event.key === " " && target.closest("button, a") && !target.closest(".lane-pick"))) return;
  event.preventDefault();
  act();
});

for (const button of document.querySelectorAll("[data-window]")) {
  button.addEventListener("click", () => setWindow(Number(button.getAttribute("data-window"))));
}
byId("pause").addEventListener("click", () => lanes.pause());
byId("back").addEventListener("click", () => lanes.scroll(-0.2));
byId("forward").addEventListener("click", () => lanes.scroll(0.2));
byId("live").addEventListener("click", () => lanes.setEnd(null));
byId("columns").addEventListener("click", () => lanes.nextColumns());
byId("theme").addEventListener("click", toggleTheme);
byId("help-button").addEventListener("click", () => openDialog("help"));
lanes.container.addEventListener("moved", showView);
showView();
setInterval(tellTime, 250);
const retell = tooltips();

// For tests and the browser's console: what is drawn, as numbers.
globalThis.sense4hri = { lanes, clock };
