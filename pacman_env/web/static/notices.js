// Short words for the person, seen and spoken; and questions.

import { $, make } from "./dom.js";

const SHOWN_MS = 3500;

export function notice(words, { bad = false, buttons = [], key = "", stays = false } = {}) {
  if (!words) return null;
  const place = $(bad ? "alerts" : "notices");
  const old = key ? place.querySelector(`[data-key="${key}"]`) : [...place.children].find((one) => one.dataset.words === words);
  old?.remove();
  const element = make("div", { class: bad ? "notice bad" : "notice", data: { words, key } }, make("span", { text: words }));
  const close = () => element.remove();
  for (const [text, act] of buttons) {
    element.append(make("button", { type: "button", class: "small", text, onclick: () => {
      close();
      act();
    } }));
  }
  place.append(element);
  while (place.children.length > 3) place.firstElementChild.remove();
  if (!stays) setTimeout(close, SHOWN_MS + 60 * words.length);
  return close;
}

export const unnotice = (key) => document.querySelectorAll(`.notice[data-key="${key}"]`).forEach((one) => one.remove());

export function question(words) {
  const dialog = $("ask");
  $("ask-words").textContent = words;
  dialog.returnValue = "";
  $("ask-yes").onclick = () => dialog.close("yes");
  $("ask-no").onclick = () => dialog.close("no");
  dialog.showModal();
  return new Promise((resolve) => {
    dialog.onclose = () => resolve(dialog.returnValue === "yes");
  });
}

// Says why something was not done; true: it was.
export function told(answer) {
  if (!answer.ok) notice(answer.words || "That was refused.", { bad: !answer.late });
  return answer.ok;
}
