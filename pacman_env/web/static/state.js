// What a page knows of the game and of its people, and events about its changes.

export const robotPose = (frame) => frame?.true ?? frame?.believed ?? null;

export class PageState {
  connected = false;
  hello = null;
  scene = null;
  people = { viewers: 0, operator: null, asking: [], roles: {} };
  frame = null; // the newest of the game
  story = null; // the finished round that is open: {entry, frames, index, scene, trail}
  demo = null; // the round that is shown while no person plays: {frames, index, scene}
  invites = false; // whether no person plays, so that the page offers to play
  role = "none";
  why = null;
  candidate = -1; // below the mouse pointer
  placing = ""; // request to click on the map, which places a ghost or sets the robot's pose
  place = null; // what then gets the place
  stands = null; // where the robot stands, once that was clicked
  count = { frames: 0, frames_drawn: 0, notes: 0, lit: 0, errors: [] }; // for tests
  #listeners = {}; // by topic

  on(topics, listener) {
    for (const topic of topics.split(" ")) (this.#listeners[topic] ??= []).push(listener);
  }

  emit(topic, value) {
    for (const listener of this.#listeners[topic] ?? []) listener(value);
  }

  get shownFrame() {
    const shown = this.story ?? this.demo;
    return shown ? shown.frames[shown.index] : this.frame;
  }

  get shownScene() { return this.story?.scene ?? this.scene; }
  // "simulator", "ros", or "browser": the simulator in a worker of the page.
  get source() { return this.hello?.source ?? (document.documentElement.dataset.game ? "browser" : "simulator"); }
  get me() { return this.hello?.you ?? null; }
  get inControl() { return this.people.operator !== null && this.people.operator === this.me; }
  // Whether this page could take control or has it.
  get mayControl() { return this.hello?.access === "operator" && [null, this.me].includes(this.people.operator); }
  // Whether a round would be lost by a reset.
  get roundRuns() { return ["starting", "running"].includes(this.frame?.state); }
  resultWords(result) { return this.hello.results[result] ?? result; }
}
