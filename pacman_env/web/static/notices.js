// Short messages, shown and announced; and questions.

import { $, button, make } from "./dom.js";

const SHOWN_MS = 3500;

// Returns the function that closes it. A notice replaces that of the same key, or of the same text.
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
