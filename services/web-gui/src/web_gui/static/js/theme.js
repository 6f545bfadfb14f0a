// Light and dark: the system's choice until the reader chooses. Canvas takes its colours from the style sheet.

const KEY = "sense4hri-theme";
const PENS = {
  text: "--text", muted: "--muted", panel: "--panel", grid: "--grid", hole: "--hole", hatch: "--hatch", event: "--event",
  marker: "--marker", onMarker: "--on-marker", calm_relaxed: "--calm", alert_active: "--alert", stressed_anxious: "--stressed",
  unknown: "--unknown", accent: "--accent", page: "--page", ok: "--ok", wait: "--wait", bad: "--bad",
};
const dark = matchMedia("(prefers-color-scheme: dark)");
let known = null;

/** @returns {Object<string, string>} colours for the canvases of the current theme */
export function pens() {
  if (known) return known;
  const style = getComputedStyle(document.documentElement);
  known = { font: style.getPropertyValue("--font") };
  for (const [name, variable] of Object.entries(PENS)) known[name] = style.getPropertyValue(variable).trim();
  return known;
}

/** @returns {string} the colour of a sensor type in the current theme, that of `other` where it has none of its own */
export function colourOf(/** @type {string} */ type) {
  const colours = pens(), name = `type ${type}`;
  if (!colours[name]) {
    const style = getComputedStyle(document.documentElement);
    colours[name] = (style.getPropertyValue(`--${type}`) || style.getPropertyValue("--other")).trim();
  }
  return colours[name];
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
