// Play it yourself: roles, goals by click and by key, velocities by keys and by stick.

import { $, css, isTyping, make, write } from "./dom.js";
import { robotPose } from "./frame.js";
import { refresh } from "./gates.js";
import { notice, told } from "./notices.js";
import { me, on, state, tell } from "./state.js";

const REPEAT_MS = 100;
const STEP_M = 0.2;
const BACKWARDS = 0.5; // share of the speed
const KEYS = { ArrowUp: "up", KeyW: "up", ArrowDown: "down", KeyS: "down", ArrowLeft: "left", KeyA: "left", ArrowRight: "right", KeyD: "right" };
const ARROWS = { ArrowUp: [0, 1], ArrowDown: [0, -1], ArrowLeft: [-1, 0], ArrowRight: [1, 0] };

export class Roles {
  #held = new Set();
  #stick = null; // [forward, left], each -1 to 1
  #timer = 0;

  constructor(connection, map, setup) {
    this.connection = connection;
    this.map = map;
    this.setup = setup;
    on("people hello scene connection", () => this.#show());
    on("frame", () => this.#later());
    $("hold").addEventListener("click", () => this.#goal({ candidate: -1 }));
    $("stick-show").addEventListener("click", () => this.#showStick($("stick").hidden));
    this.#setUpKeys();
    this.#setUpStick();
    on("story", () => this.#release());
    setInterval(() => this.#nearestButtons(), 500);
  }

  // A click on the map.
  tapped(world, candidate) {
    if (state.placing) this.setup.placeAt(world);
    else if (state.story) return;
    else if (state.role === "robot") this.#goal(candidate >= 0 ? { candidate } : { x: world[0], y: world[1] });
    else if (state.role !== "none") this.#goal({ x: world[0], y: world[1] });
    else if (candidate >= 0) notice("To send the robot there, choose its role in the tab Play.", { key: "role" });
  }

  async #goal(where) {
    told(await this.connection.ask({ do: "goal", ...where }));
  }

  async #sit(who) {
    this.#release();
    const answer = await this.connection.ask({ do: "role", role: who });
    if (!told(answer)) return;
    if (answer.data?.words) notice(`The role is ${answer.data.words}.`);
  }

  #show() {
    const people = state.people.roles ?? {};
    const mine = Object.keys(people).find((role) => people[role] && people[role] === me()) ?? "none";
    if (mine !== state.role) {
      this.#release();
      state.role = mine;
      if (mine === "robot" && matchMedia("(pointer: coarse)").matches) this.#showStick(true);
      if (mine !== "robot") this.#showStick(false);
      if (mine !== "none" && matchMedia("(max-width: 820px)").matches) document.querySelector(".panel").classList.remove("open"); // room for the map
      tell("role", mine);
    }
    const ghosts = state.scene?.ghosts ?? [];
    const rows = [["robot", state.hello?.roles.robot.name], ...ghosts.map(({ role, name, colour }) => [role, name, colour])];
    const key = JSON.stringify([rows, people, me()]);
    if (this.key !== key) {
      this.key = key;
      const active = document.activeElement?.dataset?.role;
      $("roles").replaceChildren(...rows.map(([role, name, colour]) => {
        const dot = make("span", { class: colour ? "dot" : "dot robot" });
        if (colour) dot.style.background = css(colour);
        const who = people[role];
        const taken = who && who !== me();
        const button = make("button", { type: "button", class: role === mine ? "small" : "small primary", data: { role }, disabled: taken,
          "aria-label": role === mine ? `Leave ${name}` : `Play ${name}`, text: role === mine ? "Leave" : taken ? "Taken" : `Play ${name}`,
          onclick: () => this.#sit(role === mine ? "none" : role) });
        if (!taken) button.dataset.needs = "operator";
        return make("li", {}, dot, make("span", { class: "who", text: who ? `${name}: ${who === me() ? "you" : who}` : `${name}: free` }), button);
      }));
      if (active) $("roles").querySelector(`[data-role="${active}"]`)?.focus();
      refresh();
    }
    $("play-robot").hidden = mine !== "robot";
    $("play-ghost").hidden = !mine.startsWith("ghost");
    if (mine.startsWith("ghost")) write($("play-ghost-title"), `You are ${state.hello.roles[mine].name}`);
    this.#mode();
    this.#duel();
  }

  #mode() {
    const words = state.placing ? "Click where the ghost starts" : state.story ? "" : state.role === "robot" ? "You are the robot" :
      state.role !== "none" ? $("play-ghost-title").textContent : "";
    write($("mode"), words);
    $("mode").hidden = !words;
  }

  #later() {
    this.#duel();
    this.#mode();
  }

  // "you 7, clyde_aware 6"
  #duel() {
    const frame = state.frame;
    const robot = state.people.roles?.robot;
    const beside = Boolean(frame?.baseline && robot) && !state.story;
    const words = beside ? `${robot === me() ? "you" : robot} ${frame.collected}, ${state.scene?.policy ?? "policy"} ${frame.baseline_collected}` : "";
    write($("duel"), words);
    $("duel").hidden = !words;
  }

  // Who was better, when a round has ended.
  ended(entry) {
    if (entry.player !== "person" || !entry.second) return;
    const rank = ({ result, collected, time_s: time }) => [result === "complete" ? 1 : 0, collected, result === "complete" ? -time : 0];
    const [yours, other] = [rank(entry), rank(entry.second)];
    const first = yours.findIndex((value, k) => value !== other[k]);
    const better = first < 0 ? "It is a draw" : yours[first] > other[first] ? "You were better" : `${entry.policies?.[0] ?? "The policy"} was better`;
    const words = `${better}: you ${entry.collected} (${entry.result}, ${entry.time_s.toFixed(1)} s), ${entry.policies?.[0] ?? "the policy"} ${entry.second.collected} (${entry.second.result}, ${entry.second.time_s.toFixed(1)} s).`;
    write($("duel-words"), words);
    notice(words, { key: "duel" });
  }

  get nearest() {
    const { scene, frame } = state;
    const pose = robotPose(frame);
    if (!scene || !pose) return [];
    return scene.pellets.map(([x, y], candidate) => ({ candidate, away: Math.hypot(x - pose[0], y - pose[1]) }))
      .filter(({ candidate }) => frame.alive[candidate]).sort((a, b) => a.away - b.away).slice(0, 9);
  }

  #nearestButtons() {
    if (state.role !== "robot" || document.hidden || $("panel-play").hidden) return;
    const list = $("nearest");
    const { nearest } = this;
    while (list.children.length > nearest.length) list.lastElementChild.remove();
    nearest.forEach(({ candidate, away }, k) => {
      if (!list.children[k]) {
        const button = make("button", { type: "button", class: "small", onclick: () => this.#goal({ candidate: Number(button.dataset.candidate) }) });
        list.append(make("li", {}, button));
      }
      const button = list.children[k].firstElementChild;
      button.dataset.candidate = String(candidate);
      write(button, `${k + 1}: ${away.toFixed(1)} m`);
      button.setAttribute("aria-label", `Go to the pellet ${away.toFixed(1)} m away, key ${k + 1}`);
    });
  }

  #setUpKeys() {
    addEventListener("keydown", (event) => {
      if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target) || state.story || $("ask").open) return;
      const range = event.target?.matches?.("input[type=range], [role=tab]");
      if (state.role === "robot" && KEYS[event.code] && !range && !state.placing) {
        event.preventDefault();
        this.#held.add(KEYS[event.code]);
        this.#drive();
        return;
      }
      if (state.role === "robot" && /^Digit[1-9]$/.test(event.code)) {
        const pellet = this.nearest[Number(event.code.slice(5)) - 1];
        if (pellet) this.#goal({ candidate: pellet.candidate });
        return;
      }
      if (event.target !== $("top")) return;
      const pointing = state.placing || state.role.startsWith("ghost");
      const arrow = ARROWS[event.key];
      if (arrow) {
        event.preventDefault();
        if (pointing) this.map.moveCross(STEP_M * arrow[0], STEP_M * arrow[1]);
        else this.map.pan(-60 * arrow[0], 60 * arrow[1]);
      } else if (event.key === "Enter" && pointing && this.map.cross) {
        this.tapped(this.map.cross, -1);
        this.map.dropCross();
      }
    });
    addEventListener("keyup", (event) => {
      if (KEYS[event.code] && this.#held.delete(KEYS[event.code])) this.#drive();
    });
    addEventListener("blur", () => this.#release());
    addEventListener("pagehide", () => this.#release());
    document.addEventListener("visibilitychange", () => document.hidden && this.#release());
    on("connection", () => this.#release());
  }

  #setUpStick() {
    const stick = $("stick");
    const moved = (event) => {
      const box = stick.getBoundingClientRect();
      const radius = box.width / 2;
      let [x, y] = [(event.clientX - box.left - radius) / radius, (event.clientY - box.top - radius) / radius];
      const far = Math.max(1, Math.hypot(x, y));
      [x, y] = [x / far, y / far];
      $("knob").style.transform = `translate(${x * radius * 0.6}px, ${y * radius * 0.6}px)`;
      const dead = (value) => (Math.abs(value) < 0.12 ? 0 : value);
      this.#stick = [dead(-y), dead(-x)];
    };
    stick.addEventListener("pointerdown", (event) => {
      stick.setPointerCapture(event.pointerId);
      moved(event);
      this.#drive();
    });
    stick.addEventListener("pointermove", (event) => {
      if (this.#stick) moved(event);
    });
    for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
      stick.addEventListener(end, () => {
        $("knob").style.transform = "";
        if (!this.#stick) return;
        this.#stick = null;
        this.#drive();
      });
    }
  }

  #showStick(show) {
    $("stick").hidden = !show;
    $("stick-show").setAttribute("aria-pressed", String(show));
  }

  // Says the velocities now, and again while something is held; once zero when nothing is.
  #drive() {
    clearTimeout(this.#timer);
    this.#timer = 0;
    if (state.role !== "robot") return;
    const key = (name) => (this.#held.has(name) ? 1 : 0);
    const [forward, left] = this.#stick ?? [key("up") - key("down"), key("left") - key("right")];
    const speed = state.scene?.robot?.speed_mps ?? 0.3;
    const turn = state.scene?.turn_radps ?? 1.9;
    const v = speed * (forward < 0 ? BACKWARDS * forward : forward);
    this.connection.say({ do: "drive", v, omega: 0.6 * turn * left });
    if (this.#held.size || this.#stick) this.#timer = setTimeout(() => this.#drive(), REPEAT_MS);
  }

  #release() {
    const driving = this.#timer !== 0;
    this.#held.clear();
    this.#stick = null;
    $("knob").style.transform = "";
    if (driving) this.#drive();
  }
}
