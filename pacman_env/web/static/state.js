// What the page knows, and who wants to hear of it.

export const state = {
  connected: false,
  hello: null,
  scene: null,
  people: { viewers: 0, operator: null, asking: [], roles: {} },
  frame: null, // the newest of the game
  story: null, // the finished round that is open: {entry, frames, index, scene}
  role: "none",
  why: null,
  candidate: -1, // the one pointed at
  placing: false,
};

const listeners = new Map();

export function on(topics, listener) {
  for (const topic of topics.split(" ")) {
    if (!listeners.has(topic)) listeners.set(topic, []);
    listeners.get(topic).push(listener);
  }
}

export function tell(topic, value) {
  for (const listener of listeners.get(topic) ?? []) listener(value);
}

export const shown = () => (state.story ? state.story.frames[state.story.index] : state.frame);
export const shownScene = () => state.story?.scene ?? state.scene;
export const me = () => state.hello?.you ?? null;
export const inControl = () => state.people.operator !== null && state.people.operator === me();

// Why something may not be done now; empty: it may.
export function obstacle(needs) {
  for (const need of needs) {
    if (!state.connected) return "There is no connection.";
    if ((need === "control" || need === "operator") && state.hello?.access !== "operator") {
      return "View only: this is a viewer's link. STOP still works.";
    }
    const { operator } = state.people;
    if (need === "control" && operator && operator !== me()) return `${operator} has control. You can ask for it.`;
    if (need === "menu" && state.frame && state.frame.state !== "menu") return "Only in the menu: press Reset first.";
  }
  return "";
}
