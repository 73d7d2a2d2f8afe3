// Finished rounds: the list, the time line, the marks, the link.

import { $, clock, debounced, isTyping, make, setIcon, write } from "./dom.js";
import { robotPose } from "./frame.js";
import { copyLink } from "./link.js";
import { notice, told } from "./notices.js";
import { on, state, tell } from "./state.js";

const TIMES = 4; // as fast as the round was
const resultName = (result) => state.hello.results[result] ?? result;

export class Stories {
  #timer = 0;
  #entries = [];
  #scenes = new Map(); // by revision

  constructor(connection, map, token, ended) {
    Object.assign(this, { connection, map, token, ended });
    on("scene", (scene) => this.#scenes.set(scene.revision, scene));
    on("news", (items) => {
      const stories = items.filter((item) => item.story).map((item) => item.story);
      if (stories.length) this.load(stories.at(-1));
    });
    on("hello", () => this.load());
    $("story-close").addEventListener("click", () => this.close());
    $("story-play").addEventListener("click", () => this.#play(!this.#timer));
    $("story-previous").addEventListener("click", () => this.#jump(-1));
    $("story-next").addEventListener("click", () => this.#jump(1));
    $("story-range").addEventListener("input", ({ target }) => {
      this.#play(false);
      this.seek(Number(target.value));
    });
    $("story-share").addEventListener("click", () => {
      const { entry, index } = state.story;
      if (entry.link) copyLink(`${entry.link}&tick=${index}`);
      else notice("This round cannot be reproduced by a link: a person played it, or a ghost was placed by hand.");
    });
    addEventListener("keydown", (event) => {
      if (!state.story || isTyping(event.target) || event.ctrlKey || event.metaKey || event.altKey || $("ask").open) return;
      if (event.key === " " && !event.target.matches?.("button, input, summary")) this.#play(!this.#timer);
      else if (event.key === "n") this.#jump(1);
      else if (event.key === "p") this.#jump(-1);
      else if (event.target === $("top") && event.key === "ArrowRight") this.seek(state.story.index + 1);
      else if (event.target === $("top") && event.key === "ArrowLeft") this.seek(state.story.index - 1);
      else return;
      event.preventDefault();
    });
    this.askWhy = debounced(() => this.#askWhy(), 150);
    new ResizeObserver(() => this.#marks()).observe($("story-range"));
  }

  async load(ended = 0) {
    const answer = await this.connection.ask({ do: "stories" });
    if (!answer.ok) return;
    this.#entries = answer.data ?? [];
    this.#list();
    const entry = this.#entries.find((one) => one.story === ended);
    if (entry) this.ended(entry);
  }

  #list() {
    write($("stories-words"), this.#entries.length ? "Newest first." : "No round has ended yet.");
    $("stories").replaceChildren(...this.#entries.map((entry) => {
      const parts = entry.parts.length;
      const second = entry.second ? `, ${entry.policies?.[0] ?? "policy"} ${entry.second.collected} (${entry.second.result})` : "";
      const about = [entry.map, `seed ${entry.seed}`, entry.player === "person" ? "played by a person" : entry.policies?.[0], parts ? `policies disagree ${parts} ${parts === 1 ? "time" : "times"}` : ""];
      return make("li", { class: state.story?.entry.story === entry.story ? "open" : "", data: { story: entry.story } },
        make("span", {}, make("strong", { text: `${resultName(entry.result)}: ${entry.collected} of ${entry.spawned}` }), ` in ${clock(entry.time_s)}${second}`),
        make("button", { type: "button", class: "small", text: "Open", "aria-label": `Open round ${entry.story}`, onclick: () => this.open(entry.story) }),
        make("span", { class: "quiet", text: about.filter(Boolean).join(" · ") }));
    }));
  }

  #sceneOf(entry) {
    const scene = this.#scenes.get(entry.revision);
    if (scene && !scene.preparing) return scene;
    const same = state.scene?.map?.name === entry.map && state.scene.pellets.length === entry.spawned && (entry.map !== "generated" || state.scene.seed === entry.seed);
    return same || entry.map === undefined ? state.scene : null;
  }

  async open(number, tick = 0) {
    if (!this.#entries.some((one) => one.story === number)) await this.load();
    const entry = this.#entries.find((one) => one.story === number);
    const scene = entry ? this.#sceneOf(entry) : null;
    if (!entry || !scene) {
      notice(entry ? `That round was on another map, ${entry.map}. Choose it in the tab Game first.` : "That round is not kept any more.", { bad: true });
      return;
    }
    try {
      const response = await fetch(`/story/${number}.json`, { headers: this.token ? { Authorization: `Bearer ${this.token}` } : {} });
      if (!response.ok) throw new Error(await response.text());
      const frames = await response.json();
      if (!frames.length) throw new Error("it is empty");
      this.#play(false);
      state.story = { entry, frames, index: 0, scene, trail: frames.map(robotPose) };
    } catch (error) {
      notice(`The round could not be loaded: ${error.message.trim()}`, { bad: true });
      return;
    }
    $("story-bar").hidden = false;
    $("ring").hidden = true;
    $("story-range").max = String(state.story.frames.length - 1);
    write($("story-title"), `Round ${entry.story}: ${resultName(entry.result).toLowerCase()}, ${entry.collected} of ${entry.spawned}`);
    write($("story-parts"), entry.policies ? `(${entry.policies.join(" and ")})` : "");
    await this.map.show(scene);
    this.map.cover($("story-bar").offsetHeight + 8);
    this.seek(tick);
    this.#list();
    requestAnimationFrame(() => this.#marks());
  }

  close() {
    if (!state.story) return;
    this.#play(false);
    state.story = null;
    state.why = null;
    $("story-bar").hidden = true;
    $("ring").hidden = false;
    this.#list();
    this.map.cover(0);
    tell("why");
    tell("story", null);
    this.map.show(state.scene).then(() => state.frame && this.map.take(state.frame, true));
  }

  seek(index, smooth = false) {
    const { story } = state;
    if (!story) return;
    story.index = Math.max(0, Math.min(story.frames.length - 1, index));
    const frame = story.frames[story.index];
    this.map.take(frame, !smooth);
    this.map.setTrail(story.trail.slice(0, story.index + 1).filter(Boolean));
    $("story-range").value = String(story.index);
    const words = `${clock(frame.time_s)} of ${clock(story.entry.time_s)}, ${frame.collected} pellets`;
    write($("story-at"), words);
    $("story-range").setAttribute("aria-valuetext", words);
    tell("story", story);
    this.askWhy();
  }

  async #askWhy() {
    const { story } = state;
    if (!story || $("panel-why").hidden || this.#timer) return;
    const { index } = story;
    const answer = await this.connection.ask({ do: "why", story: story.entry.story, tick: Math.min(index, Math.max(0, story.entry.ticks - 1)) }, 30000);
    if (state.story !== story || story.index !== index) return;
    if (told(answer)) tell("why", (state.why = answer.data));
  }

  #play(play) {
    clearInterval(this.#timer);
    this.#timer = 0;
    const { story } = state;
    if (play && story) {
      if (story.index >= story.frames.length - 1) this.seek(0);
      const seconds = Math.max(0.01, (story.frames.at(-1).time_s - story.frames[0].time_s) / Math.max(1, story.frames.length - 1));
      const wait = Math.max(50, (1000 * seconds) / TIMES);
      const step = Math.max(1, Math.round((wait * TIMES) / (1000 * seconds)));
      this.#timer = setInterval(() => {
        if (document.hidden) return;
        this.seek(story.index + step, true);
        if (story.index >= story.frames.length - 1) this.#play(false);
      }, wait);
    }
    const name = this.#timer ? "Pause" : "Play";
    $("story-play").setAttribute("aria-label", name);
    setIcon($("story-play").firstElementChild, this.#timer ? "pause" : "play");
    if (!this.#timer) this.askWhy();
  }

  // The next marker: where the policies disagree; without such, where the goal changes.
  #jump(way) {
    const { story } = state;
    if (!story) return;
    this.#play(false);
    const marks = story.entry.parts.length ? story.entry.parts : story.entry.decisions;
    const next = way > 0 ? marks.find((tick) => tick > story.index) : marks.findLast((tick) => tick < story.index);
    if (next === undefined) notice(way > 0 ? "No later marker." : "No earlier marker.", { key: "mark" });
    else this.seek(next);
  }

  #marks() {
    const { story } = state;
    if (!story) return;
    const canvas = $("story-marks");
    const ratio = devicePixelRatio || 1;
    const { clientWidth: width, clientHeight: height } = $("story-range");
    canvas.width = width * ratio;
    canvas.height = height * ratio;
    const context = canvas.getContext("2d");
    context.scale(ratio, ratio);
    const thumb = 16;
    const last = Math.max(1, story.frames.length - 1);
    for (const [ticks, colour, y, size] of [[story.entry.decisions, "#7f8ba6", height - 9, 6], [story.entry.parts, "#e0407f", 2, 9]]) {
      context.fillStyle = colour;
      for (const tick of ticks) context.fillRect(thumb / 2 + ((width - thumb) * tick) / last - 1.5, y, 3, size);
    }
  }
}
