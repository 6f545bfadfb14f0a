// Light and dark: the system's choice until the reader chooses. Canvas takes its colours from the style sheet.

const KEY = "sense4hri-theme";
const TYPES = [
  "ecg", "ppg", "respiration", "eda", "emg", "eeg", "eog", "eye_tracking", "pupillometry", "temperature",
  "accelerometer", "gyroscope", "magnetometer",
];
const PENS = {
  text: "--text", muted: "--muted", panel: "--panel", grid: "--grid", hole: "--hole", hatch: "--hatch", event: "--event",
  marker: "--marker", onMarker: "--on-marker", calm_relaxed: "--calm", alert_active: "--alert", stressed_anxious: "--stressed",
  unknown: "--unknown", accent: "--accent",
};
const dark = matchMedia("(prefers-color-scheme: dark)");
let known = null;

/** @returns {Object<string, string>} colours for the canvases of the current theme */
export function pens() {
  if (known) return known;
  const style = getComputedStyle(document.documentElement);
  known = { font: style.getPropertyValue("--font") };
  for (const [name, variable] of Object.entries(PENS)) known[name] = style.getPropertyValue(variable).trim();
  for (const type of TYPES) known[type] = style.getPropertyValue(`--${type}`).trim();
  return known;
}

function apply() {
  const chosen = localStorage.getItem(KEY);
  document.documentElement.dataset.theme = chosen ?? (dark.matches ? "dark" : "light");
  known = null;
  document.dispatchEvent(new CustomEvent("theme"));
}

/** Change to the other theme and remember it. */
export function toggleTheme() {
  localStorage.setItem(KEY, document.documentElement.dataset.theme === "dark" ? "light" : "dark");
  apply();
}

dark.addEventListener("change", apply);
apply();
