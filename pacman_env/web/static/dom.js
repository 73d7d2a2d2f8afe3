// Small helpers for the document.

export const $ = (id) => document.getElementById(id);

export function make(tag, options = {}, ...children) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(options)) {
    if (value === undefined || value === null || value === false) continue;
    if (name === "class") element.className = value;
    else if (name === "text") element.textContent = value;
    else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
    else if (name === "data") Object.assign(element.dataset, value);
    else if (name in element && name !== "list") element[name] = value;
    else element.setAttribute(name, value);
  }
  element.append(...children.filter((child) => child !== null && child !== undefined));
  return element;
}

export function setIcon(svg, name) {
  const use = document.createElementNS("http://www.w3.org/2000/svg", "use");
  use.setAttribute("href", `#i-${name}`);
  svg.replaceChildren(use);
}

// Writes only what has changed: a live region speaks once, and nothing is laid out anew.
export function write(element, words) {
  if (element.textContent !== words) element.textContent = words;
}

export function fill(select, values, chosen, names = {}) {
  const same = select.options.length === values.length && values.every((value, k) => select.options[k].value === value);
  if (!same) select.replaceChildren(...values.map((value) => make("option", { value, text: names[value] ?? value })));
  if (chosen !== undefined && values.includes(chosen)) select.value = chosen;
}

export const css = ([red, green, blue]) => `rgb(${red}, ${green}, ${blue})`;

export function clock(seconds) {
  if (!Number.isFinite(seconds)) return "–";
  const whole = Math.max(0, Math.floor(seconds));
  return `${Math.floor(whole / 60)}:${String(whole % 60).padStart(2, "0")}`;
}

export function debounced(call, wait_ms) {
  let timer = 0;
  return (...values) => {
    clearTimeout(timer);
    timer = setTimeout(() => call(...values), wait_ms);
  };
}

// At most one call in wait_ms, and always one for the last value.
export function throttled(call, wait_ms) {
  let timer = 0;
  let last = -Infinity;
  return (...values) => {
    clearTimeout(timer);
    const wait = Math.max(0, last + wait_ms - performance.now());
    timer = setTimeout(() => {
      last = performance.now();
      call(...values);
    }, wait);
  };
}

// Whether keys belong to a field that is being filled in.
export const isTyping = (target) => target?.matches?.("input:not([type=range]):not([type=checkbox]), select, textarea") ?? false;
