// The state of the page, events about its changes, and which controls can be used.

import { $, write, writeOrHide } from "./dom.js";

export const state = {
  connected: false,
  hello: null,
  scene: null,
  people: { viewers: 0, operator: null, asking: [], roles: {} },
  frame: null, // the newest of the game
  story: null, // the finished round that is open: {entry, frames, index, scene, trail}
  role: "none",
  why: null,
  candidate: -1, // below the mouse pointer
  placing: false,
  posing: "", // what is to be clicked to set the robot's pose
  stands: null, // where the robot stands, once that was clicked
};
export const count = { frames: 0, frames_drawn: 0, notes: 0, lit: 0, errors: [] }; // for tests

const listeners = new Map();

export function on(topics, listener) {
  for (const topic of topics.split(" ")) listeners.set(topic, [...(listeners.get(topic) ?? []), listener]);
}

export function emit(topic, value) {
  for (const listener of listeners.get(topic) ?? []) listener(value);
}

export const shownFrame = () => (state.story ? state.story.frames[state.story.index] : state.frame);
export const shownScene = () => state.story?.scene ?? state.scene;
export const source = () => state.hello?.source ?? "simulator"; // or "ros"
export const me = () => state.hello?.you ?? null;
export const inControl = () => state.people.operator !== null && state.people.operator === me();
// Whether this page could take control or has it.
export const mayControl = () => state.hello?.access === "operator" && [null, me()].includes(state.people.operator);
// Whether a round would be lost by a reset.
export const roundRuns = () => ["starting", "running"].includes(state.frame?.state);
export const robotPose = (frame) => frame?.true ?? frame?.believed ?? null;

// Why an element with these needs cannot be used now; empty if it can.
function obstacle(needs) {
  if (!state.connected) return "There is no connection.";
  const { operator } = state.people;
  if ((needs.includes("control") || needs.includes("operator")) && state.hello?.access !== "operator") {
    return "View only: this is a viewer's link. STOP still works.";
  }
  if (needs.includes("control") && operator && operator !== me()) return `${operator} has control. You can ask for it.`;
  const { state: now = "menu", stopped } = state.frame ?? {};
  if (needs.includes("menu") && now !== "menu") return "Only in the menu: press Reset first.";
  return needs.includes("released") && stopped ? "Stopped: press Release first." : "";
}

// Disables what cannot be used now, with the reason as its title; `data-needs`: what it needs, `data-only`: the source.
export function updateControls() {
  for (const element of document.querySelectorAll("[data-needs]")) {
    const reason = obstacle(element.dataset.needs.split(" "));
    element.disabled = Boolean(reason);
    element.title = reason || (element.dataset.title ?? "");
  }
  for (const element of document.querySelectorAll("[data-only]")) element.hidden = source() !== element.dataset.only;
  writeOrHide($("reason"), state.connected ? obstacle(["control"]) : "");
}

let gameState = "";
on("hello people connection", updateControls);
on("frame", (frame) => {
  const now = `${frame.state} ${frame.stopped}`;
  if (now !== gameState) updateControls();
  gameState = now;
});
updateControls();
