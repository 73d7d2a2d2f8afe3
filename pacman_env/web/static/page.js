// The state of this page; which controls can be used now, and why others cannot.

import { $, focusMap, writeOrHide } from "./dom.js";
import { PageState } from "./state.js";

export const state = new PageState();

// Why an element with these needs cannot be used now; empty if it can.
function obstacle(needs) {
  if (!state.connected) return state.source === "browser" ? "The game is loading." : "There is no connection.";
  const { operator, away } = state.people;
  if ((needs.includes("control") || needs.includes("operator")) && state.hello?.access !== "operator") {
    return "View only: this is a viewer's link. STOP still works.";
  }
  if (needs.includes("control") && operator && operator !== state.me) {
    return away ? `${operator} has left: control is free within 10 s.` : `${operator} has control. You can ask for it.`;
  }
  const { state: now = "menu", stopped, over } = state.frame ?? {};
  const ended = over && state.source !== "ros"; // there the show at the end can be skipped
  if (needs.includes("menu") && now !== "menu" && !ended) return "Only in the menu: press Reset first.";
  return needs.includes("released") && stopped ? "Stopped: press Release first." : "";
}

// Disables what cannot be used now, with the reason as its title; `data-needs`: what it needs, `data-only`: the sources.
export function updateControls() {
  for (const element of document.querySelectorAll("[data-needs]")) {
    const reason = obstacle(element.dataset.needs.split(" "));
    element.disabled = Boolean(reason);
    element.title = reason || (element.dataset.title ?? "");
  }
  for (const element of document.querySelectorAll("[data-only]")) {
    element.hidden = !element.dataset.only.split(" ").includes(state.source);
  }
  writeOrHide($("reason"), state.connected ? obstacle(["control"]) : "");
}

// These are the first listeners: others read which controls can be used.
let gameState = "";
state.on("hello people connection", updateControls);
state.on("frame", (frame) => {
  const now = `${frame.state} ${frame.stopped} ${frame.over}`;
  if (now === gameState) return;
  updateControls();
  if (gameState) focusMap();
  gameState = now;
});
updateControls();
