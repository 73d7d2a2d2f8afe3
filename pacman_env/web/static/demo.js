// The demo: while no person plays, the map shows the prepared round as its policy plays it, and a card offers to play.

import { $, focusMap, notice, still, stored } from "./dom.js";
import { switchSound } from "./effects.js";

const SPEED = 4; // times real time
const IDLE_MS = 30000; // after the end of a round, and after the last action of a person who has control
const END_MS = 2500; // for which the last frame is shown
const CHECK_MS = 250;
const PLAY_SPEED = 3; // times real time
const SEEN = "pacman_env.seen"; // in the browser's store, once the card was closed
const SOUND = "pacman_env.sound"; // in the browser's store: whether the player wants sound

export class Demo {
  #acted = -Infinity; // time of the last action
  #ended = -Infinity; // and of the end of a round
  #closed = false; // by its card's button
  #timer = 0;
  #asked = 0; // revision of the scene whose demo was requested last

  constructor(state, game, map) {
    Object.assign(this, { state, game, map });
    for (const event of ["pointerdown", "keydown"]) addEventListener(event, () => (this.#acted = performance.now()));
    state.on("ended", () => (this.#ended = performance.now()));
    state.on("people role story placing scene frame connection", () => this.#check());
    setInterval(() => this.#check(), CHECK_MS);
    $("play").onclick = () => this.#play("robot");
    $("play-clyde").onclick = () => this.#play("ghost-0");
    $("watch").onclick = () => game.request({ do: "start" });
    $("welcome-close").onclick = () => { // until the page is loaded again; on a robot for all later visits
      this.#closed = true;
      stored("localStorage", SEEN, "yes");
      this.#check();
      focusMap();
    };
    $("play-sound").checked = stored("localStorage", SOUND) !== "no";
    $("play-sound").onchange = ({ target }) => stored("localStorage", SOUND, target.checked ? "yes" : "no");
    state.on("demo", (invites) => ($("welcome").hidden = !invites));
  }

  // Takes a role and starts a game that can be won, in one click.
  async #play(role) {
    const { game, state } = this;
    if ($("play-sound").checked) switchSound(true);
    const hide = notice("Preparing the game.", { key: "setup", stays: true });
    const setup = { do: "setup", ...state.hello.choices.play[role.split("-")[0]] };
    const ready = await game.request({ do: "role", role }) && await game.request(setup, game.SLOW_MS)
      && await game.request({ do: "speed", times: PLAY_SPEED });
    hide();
    if (ready) await game.request({ do: "start" });
  }

  // Whether no person plays and nothing else is shown.
  get #isIdle() {
    const { connected, source, scene, frame, role, story, placing, people, me } = this.state;
    const mine = people.operator === me;
    const rests = performance.now() - Math.max(this.#ended, mine ? this.#acted : -Infinity) > IDLE_MS;
    const free = (mine || people.operator === null) && role === "none";
    const ready = connected && scene?.preparing === false && frame?.state === "menu" && !frame.stopped;
    const welcome = source !== "ros" || !stored("localStorage", SEEN);
    return ready && free && rests && welcome && !story && !placing && !this.#closed && !$("ask").open;
  }

  #check() {
    const { state } = this;
    const { demo, scene, invites } = state;
    const idle = state.invites = this.#isIdle;
    if (demo && (!idle || demo.scene !== scene)) this.#end();
    else if (idle !== invites) state.emit("demo", idle);
    if (!state.demo && idle && this.#asked !== scene.revision) this.#begin(scene);
  }

  async #begin(scene) {
    this.#asked = scene.revision;
    if (still.matches || this.state.source === "ros") return;
    const frames = await this.game.fetchFrames(0).catch(() => null);
    if (frames && this.#isIdle && this.state.scene === scene) {
      this.state.demo = { frames, scene, index: -1 };
      this.#advance();
    } else this.#asked = 0;
  }

  #advance() {
    const { demo } = this.state;
    const { frames } = demo;
    if (!document.hidden) {
      demo.index = (demo.index + 1) % frames.length;
      this.map.showFrame(frames[demo.index], { jump: demo.index === 0 });
      this.state.emit("demo", true);
    }
    const step_ms = (1000 * (frames.at(-1).time_s - frames[0].time_s)) / Math.max(1, frames.length - 1) / SPEED;
    this.#timer = setTimeout(() => this.#advance(), demo.index === frames.length - 1 ? END_MS : Math.max(20, step_ms));
  }

  #end() {
    clearTimeout(this.#timer);
    this.#asked = 0;
    this.state.demo = null;
    this.state.emit("demo", this.state.invites);
    if (this.state.frame && !this.state.story) this.map.showFrame(this.state.frame, { jump: true });
  }
}
