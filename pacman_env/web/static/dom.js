// Small helpers for the document; short messages, shown and announced; and questions.

const SHOWN_MS = 3500; // at least, of a notice

export const narrow = matchMedia("(max-width: 820px), (max-height: 480px)");
export const touch = matchMedia("(pointer: coarse)");
export const still = matchMedia("(prefers-reduced-motion: reduce)");

export const $ = (id) => document.getElementById(id);

export const css = ([red, green, blue]) => `rgb(${red}, ${green}, ${blue})`;

// An element; an option is a property where the element has it (`onclick`), else an attribute.
export function make(tag, options = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "text") element.textContent = value;
    else if (name === "colour") element.style.background = css(value);
    else if (name === "data") Object.assign(element.dataset, value);
    else if (name in element) element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export const button = (text, options) => make("button", { type: "button", class: "small", text, ...options });

export const option = (value, text = String(value)) => make("option", { value, text });

// The rows of a list of names and values; empty values are left out.
export const facts = (rows) => rows.filter(([, value]) => value !== null && value !== undefined && value !== "")
  .flatMap(([name, value]) => [make("dt", { text: name }), make("dd", { text: String(value) })]);

export function setIcon(element, name) {
  element.querySelector(".icon")?.remove();
  element.insertAdjacentHTML("afterbegin", `<svg class="icon" aria-hidden="true"><use href="#i-${name}"/></svg>`);
}

// Adds the icons that the markup names.
export function setIcons(root) {
  for (const element of root.querySelectorAll("[data-icon]")) setIcon(element, element.dataset.icon);
}

// Writes only changed text: screen readers announce a live region once, and the layout stays.
export function write(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

// Writes an element that is shown only while it has a text.
export function writeOrHide(element, text) {
  write(element, text);
  element.hidden = !text;
}

// Reads a text that the browser stores, or writes it; both throw if the browser stores nothing.
export function stored(storage, key, text) {
  try {
    if (text !== undefined) window[storage][key] = text;
    return window[storage][key];
  } catch {
    return undefined;
  }
}

// Renders what can be clicked, but not while it is pressed: the click on a button that is replaced meanwhile is lost.
export function renderReleased(element, render) {
  if (element.matches(":active")) setTimeout(() => renderReleased(element, render), 50);
  else render();
}

export const counted = (number, noun) => `${number} ${noun}${number === 1 ? "" : "s"}`;

export function clock(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

// A slider that sends its value, once in wait_ms at most, the last one always. Returns what displays a value that the
// server reports, unless the user has just moved the slider.
export function slider(input, describe, send, wait_ms) {
  let [moved, timer] = [-Infinity, 0];
  const output = input.parentElement.querySelector("output");
  input.oninput = () => {
    moved = performance.now();
    write(output, describe(Number(input.value)));
    timer ||= setTimeout(() => {
      timer = 0;
      send(Number(input.value));
    }, wait_ms);
  };
  input.onpointerup = () => input.blur(); // arrow keys are the player's again
  return (value) => {
    if (performance.now() - moved < 1500 || value === undefined || Number(input.value) === value) return;
    input.value = String(value);
    write(output, describe(value));
  };
}

// Whether a key pressed is a shortcut of the page: without modifiers, not typed into a field or a dialog, and no arrow
// that moves a slider or chooses a tab.
export const isShortcut = ({ key, ctrlKey, metaKey, altKey, target }) => !(ctrlKey || metaKey || altKey || $("ask").open
  || target?.matches?.("input:not([type=range]):not([type=checkbox]), select, textarea")
  || (key.startsWith("Arrow") && target?.matches?.("input[type=range], [role=tab]")));

// Focuses the map, or another element, if the focused element is the map or can no longer be used.
export function focusMap(element = $("top")) {
  const { activeElement: now, body } = document;
  const free = !now || now === body || now === $("top") || now.disabled || !now.offsetParent;
  if (free) element.focus({ preventScroll: true });
}

// On a narrow page the panel leaves its place to the map.
export function showMap() {
  if (narrow.matches) document.body.classList.remove("panel-open");
}

// Returns the function that closes it. A notice replaces the notice with the same key, or with the same text.
export function notice(text, { bad = false, buttons = [], key = text, stays = false } = {}) {
  const place = $(bad ? "alerts" : "notices");
  [...place.children].find((other) => other.dataset.key === key)?.remove();
  const element = make("div", { class: bad ? "notice bad" : "notice", data: { key } }, make("span", { text }),
    ...buttons.map(([label, onclick]) => button(label, { onclick })));
  const close = () => element.remove();
  for (const one of element.querySelectorAll("button")) one.addEventListener("click", close);
  place.append(element);
  while (place.children.length > 3) place.firstElementChild.remove();
  if (!stays) setTimeout(close, SHOWN_MS + 60 * text.length);
  return close;
}

export const dismiss = (key) => document.querySelectorAll(`.notice[data-key="${key}"]`).forEach((one) => one.remove());

export function question(text) {
  const dialog = $("ask");
  $("ask-words").textContent = text;
  dialog.returnValue = "";
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.onclose = () => resolve(dialog.returnValue === "yes");
  });
}
