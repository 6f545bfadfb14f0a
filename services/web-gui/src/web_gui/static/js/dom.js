// Building blocks of the page. Text from the graph only ever becomes a text node or an attribute's value.

/**
 * @param {string} tag
 * @param {Object<string, any>} [attributes] `class`, `data-*`, `aria-*`, or `on*` listeners
 * @param {...(Node|string|null)} children strings become text nodes
 * @returns {HTMLElement}
 */
export function h(tag, attributes = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) {
    if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (value !== null && value !== false) element.setAttribute(name, value === true ? "" : String(value));
  }
  for (const child of children) if (child !== null) element.append(child);
  return element;
}

const SVG = "http://www.w3.org/2000/svg";

/**
 * @param {string} tag
 * @param {Object<string, any>} attributes
 * @returns {SVGElement}
 */
export function s(tag, attributes = {}) {
  const element = document.createElementNS(SVG, tag);
  for (const [name, value] of Object.entries(attributes)) element.setAttribute(name, String(value));
  return element;
}

/** Set an element's text where it differs, so that nothing is laid out again for nothing. */
export function text(/** @type {Element} */ element, /** @type {string} */ value) {
  if (element.textContent !== value) element.textContent = value;
}

/** Set or, with null, remove an attribute where it differs. */
export function attribute(/** @type {Element} */ element, /** @type {string} */ name, /** @type {any} */ value) {
  if (value === null || value === undefined || value === false) {
    if (element.hasAttribute(name)) element.removeAttribute(name);
  } else if (element.getAttribute(name) !== String(value)) element.setAttribute(name, String(value));
}

/**
 * Keep one child of `container` for each item, in order; children keep their identity, focus and hover.
 * @template T
 * @param {Element} container
 * @param {T[]} items
 * @param {(item: T) => string} keyOf
 * @param {(item: T) => HTMLElement} create
 * @param {(element: any, item: T) => void} update
 */
export function keyed(container, items, keyOf, create, update) {
  const known = new Map(), focused = document.activeElement;
  for (const child of [...container.children]) {
    const { key } = /** @type {any} */ (child);
    if (known.has(key)) child.remove(); // of two items with one key the second is made anew
    else known.set(key, child);
  }
  let place = container.firstElementChild;
  for (const item of items) {
    const key = keyOf(item);
    let element = known.get(key);
    known.delete(key);
    if (!element) {
      element = create(item);
      element.key = key;
    }
    update(element, item);
    if (element === place) place = place.nextElementSibling;
    else container.insertBefore(element, place);
  }
  for (const element of known.values()) element.remove();
  if (focused !== document.activeElement && container.contains(focused)) /** @type {HTMLElement} */ (focused).focus({ preventScroll: true }); // who is moved loses it
}

/**
 * Show a value, or `–` whose reason can be hovered, focused or tapped.
 * @param {HTMLElement} element
 * @param {string|null} shown
 * @param {string} reason
 */
export function value(element, shown, reason) {
  text(element, shown ?? "–");
  element.classList.toggle("missing", shown === null);
  attribute(element, "data-tip", shown === null ? reason : null);
  attribute(element, "tabindex", shown === null ? "0" : null);
  attribute(element, "aria-label", shown === null ? `not available: ${reason}` : null);
}

/**
 * One tooltip for everything with data-tip: on hover, focus and tap.
 * @returns {() => void} to be called when what is told may have changed
 */
export function tooltips() {
  const tip = /** @type {HTMLElement} */ (document.getElementById("tip"));
  let told = null;
  const tell = (/** @type {Element|null} */ target) => {
    told = target?.isConnected && target.hasAttribute("data-tip") ? target : null;
    tip.hidden = !told;
    if (!told) return;
    text(tip, told.getAttribute("data-tip"));
    const at = told.getBoundingClientRect();
    const size = tip.getBoundingClientRect();
    const left = Math.max(8, Math.min(innerWidth - size.width - 8, at.left + at.width / 2 - size.width / 2));
    const below = at.bottom + 6 + size.height < innerHeight;
    tip.style.left = `${left}px`;
    tip.style.top = `${below ? at.bottom + 6 : at.top - size.height - 6}px`;
  };
  const show = (/** @type {Event} */ event) => tell(/** @type {Element} */ (event.target).closest?.("[data-tip]"));
  const hide = () => tell(null);
  document.addEventListener("pointerover", show);
  document.addEventListener("focusin", show);
  document.addEventListener("click", show);
  document.addEventListener("focusout", hide);
  document.addEventListener("keydown", (event) => { if (event.key === "Escape") hide(); });
  return () => tell(told);
}

/** @returns {HTMLElement} */
export const byId = (/** @type {string} */ id) => /** @type {HTMLElement} */ (document.getElementById(id));
