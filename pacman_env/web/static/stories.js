// Finished rounds: their list, and the open round.

import { $, button, clock, counted, isShortcut, make, notice, renderReleased, write } from "./dom.js";
import { showResult } from "./end.js";
import { Links } from "./links.js";
import { Player } from "./player.js";
import { robotPose } from "./state.js";

const EXPLAIN_DELAY_MS = 150;
const DECIDED_TICKS = 4; // before a catch nothing can be changed any more
const BEFORE_TICKS = 8; // shown before the decisive moment
const MOMENT_S = 5; // least time for which the decisive moment is shown
const NOT_KEPT = "Rounds of a robot are not kept here. Record them in a terminal: pacman-env ros record.";

// The tick that decided a round: the last choice well before the robot was caught, or else where a ghost was nearest to
// it.
function momentOf({ result, decisions, ticks }, frames) {
  if (result === "caught") return decisions.filter((tick) => tick < ticks - DECIDED_TICKS).at(-1) ?? 0;
  const nearest = (frame) => Math.min(...frame.ghosts.map(([x, y], k) => (
    frame.harmless_s?.[k] > 0 ? Infinity : Math.hypot(x - frame.true[0], y - frame.true[1]))));
  const distances = frames.map(nearest);
  return distances.indexOf(Math.min(...distances));
}

export class Stories {
  #scenes = new Map(); // by revision
  #entries = []; // as the server lists them
  #explainTimer = 0;

  constructor(state, game, map) {
    Object.assign(this, { state, game, map });
    this.links = new Links(state, game, this);
    this.player = new Player(document, {
      show: (tick, jumps) => this.#show(tick, jumps),
      paused: () => this.#explain(),
      jumped: (mark, step) => mark ?? notice(step > 0 ? "No later marker." : "No earlier marker.", { key: "mark" }),
    });
    state.on("scene", (scene) => this.#scenes.set(scene.revision, scene));
    state.on("hello", () => this.#load());
    state.on("news", async (items) => {
      const number = items.filter((item) => item.story).at(-1)?.story;
      const entry = number && await this.#load(number);
      const isLinked = this.links.opening || state.story?.entry.story === number; // has its own card
      if (entry && !isLinked) showResult(entry);
    });
    state.on("tab", () => this.#explain());
    state.on("moment", (entry) => this.#openMoment(entry));
    state.on("worse", ({ story, worse }) => this.open(story, worse[0])); // a person's first goal riskier than ppo's
    $("story-close").onclick = () => this.close();
    addEventListener("keydown", (event) => state.story && isShortcut(event) && this.player.press(event));
  }

  // Requests the list of rounds. Returns the entry of the one with this number.
  async #load(number) {
    const { ok, data } = await this.game.ask({ do: "stories" });
    if (ok) this.#entries = data ?? [];
    this.#showList();
    return this.#entries.find(({ story }) => story === number);
  }

  #resultOf({ result, collected, spawned }) {
    return `${this.state.resultWords(result)}: ${collected} of ${spawned}`;
  }

  #showList() {
    const hint = this.#entries.length ? "Newest first." : "No round has ended yet.";
    write($("stories-words"), this.state.source === "ros" ? NOT_KEPT : hint);
    renderReleased($("stories"), () => $("stories").replaceChildren(...this.#entries.map((entry) => this.#row(entry))));
  }

  #row(entry) {
    const { story, second, parts, policies: [policy] = ["policy"] } = entry;
    const disagree = parts.length ? `policies disagree ${counted(parts.length, "time")}` : "";
    const player = entry.player === "person" ? "played by a person" : policy;
    const caught = entry.ghosts_caught ? `, ${counted(entry.ghosts_caught, "ghost")} caught` : "";
    const words = second && this.state.resultWords(second.result).toLowerCase();
    const other = second ? `, ${policy} ${second.collected} (${words})` : "";
    const details = [entry.map, `seed ${entry.seed}`, player, disagree];
    return make("li", { class: this.state.story?.entry.story === story ? "open" : "", data: { story } },
      make("span", {}, make("strong", { text: this.#resultOf(entry) }), `${caught} in ${clock(entry.time_s)}${other}`),
      button("Open", { "aria-label": `Open round ${story}`, onclick: () => this.open(story) }),
      make("span", { class: "quiet", text: details.filter(Boolean).join(" · ") }));
  }

  // The scene of a round: as it was sent, or the current one if it has the same map.
  #sceneOf(entry) {
    const scene = this.#scenes.get(entry.revision);
    if (scene && !scene.preparing) return scene;
    const now = this.state.scene;
    const same = now?.map?.name === entry.map && now.pellets.length === entry.spawned
      && (entry.map !== "generated" || now.seed === entry.seed);
    return same || entry.map === undefined ? now : null;
  }

  async open(number, tick = 0) {
    const entry = this.#entries.find(({ story }) => story === number) ?? await this.#load(number);
    const scene = entry ? this.#sceneOf(entry) : null;
    if (!scene) {
      notice(entry ? `That round was on another map, ${entry.map}. Choose it in the tab Game first.`
        : "That round is no longer stored.", { bad: true });
      return;
    }
    const frames = await this.game.fetchFrames(number)
      .catch((error) => void notice(`The round could not be loaded: ${error.message.trim()}`, { bad: true }));
    if (!frames) return;
    this.player.pause();
    this.state.story = { entry, frames, index: 0, scene, trail: frames.map(robotPose) };
    this.#showBar(this.state.story);
    await this.map.showScene(scene);
    if (this.state.story?.entry === entry) this.player.seek(tick); // it was not closed meanwhile
  }

  async close() {
    const { state } = this;
    if (!state.story) return;
    this.player.pause();
    state.story = null;
    this.#showBar(null);
    state.emit("why", (state.why = null));
    state.emit("story", null);
    await this.map.showScene(state.scene);
    if (state.frame) this.map.showFrame(state.frame, { jump: true });
  }

  #showBar(story) {
    $("story-bar").hidden = !story;
    document.body.classList.toggle("replays", Boolean(story));
    this.#showList();
    if (!story) return;
    const { entry, frames } = story;
    const [ticks, { decisions, parts: differing, worse = [], player }] = [frames.length, entry];
    const parts = player === "person" ? [] : differing; // of a person's round the goals that ppo judges
    const marks = [worse, parts, decisions].find((some) => some.length) ?? [];
    this.player.open({
      ticks, tick_s: (frames.at(-1).time_s - frames[0].time_s) / Math.max(1, ticks - 1),
      marks, lanes: [[decisions, "#7f8ba6", 6, true], [parts, "#e0407f", 9, false], [worse, "#e0810f", 9, false]],
    });
    for (const [name, some] of Object.entries({ worse, disagree: parts })) $(`legend-${name}`).hidden = !some.length;
    $("story-again").hidden = player !== "person" || !this.state.mayControl;
    write($("story-title"), `Round ${entry.story}: ${this.#resultOf(entry).toLowerCase()}`);
    write($("story-parts"), entry.policies ? `(${entry.policies.join(" and ")})` : "");
  }

  // Shows a tick of the open round. Returns it in words.
  #show(tick, jumps) {
    const { story } = this.state;
    const frame = story.frames[story.index = tick];
    this.map.showFrame(frame, { jump: jumps, path: story.trail.slice(0, tick + 1).filter(Boolean) });
    this.state.emit("story", story);
    this.#explain();
    return `${clock(frame.time_s)} of ${clock(story.entry.time_s)}, ${frame.collected} pellets`;
  }

  // Asks for the terms of the decision shown, once the position stays.
  #explain() {
    clearTimeout(this.#explainTimer);
    this.#explainTimer = setTimeout(async () => {
      const { state } = this;
      const { story } = state;
      if (!story || $("panel-why").hidden || this.player.playing) return;
      const { index, entry } = story;
      const tick = Math.min(index, Math.max(0, entry.ticks - 1));
      const answer = await this.game.request({ do: "why", story: entry.story, tick }, 30000);
      if (answer && state.story === story && story.index === index) state.emit("why", (state.why = answer.data));
    }, EXPLAIN_DELAY_MS);
  }

  // Opens a round shortly before the moment that decided it, and plays it from there.
  async #openMoment(entry) {
    await this.open(entry.story);
    const { story } = this.state;
    if (story?.entry.story !== entry.story) return;
    const { frames } = story;
    const tick = momentOf(entry, frames) - BEFORE_TICKS;
    const latest = frames.findIndex(({ time_s: s }) => s >= frames.at(-1).time_s - MOMENT_S); // enough is left from here
    this.player.speed = latest > 0 ? 1 : 0.5;
    this.player.seek(Math.max(0, Math.min(tick, latest - 1)));
    this.player.play();
  }
}
