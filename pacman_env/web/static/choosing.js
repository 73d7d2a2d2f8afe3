// Goals of a player: by click, by keys on the map, and by a list of the nearest pellets.

import { $, button, isShortcut, make, notice, write } from "./dom.js";
import { robotPose } from "./state.js";
import { FORWARD_LEFT } from "./steering.js";

const STEP_M = 0.2;
const PAN_PX = 60;
const SIDEWAYS = 1.5;
const TWICE_MS = 1000; // within which a key pressed again means the pellet behind
const WIDEST = 2; // metres to the side per metre ahead, within which a pellet lies in a direction
const NEAREST = 9; // pellets in the list, one by key
const LIST_MS = 500;

export class Choosing {
  #arrow = {}; // the pellet chosen last by an arrow key: {candidate, key, time}
  #goTo = (place) => this.game.request({ do: "goal", ...place });

  constructor(state, game, map) {
    Object.assign(this, { state, game, map });
    state.on("tap", (tap) => this.#choose(tap));
    state.on("choose", (candidate) => state.role === "robot" && !state.story && this.#goTo({ candidate }));
    addEventListener("keydown", (event) => this.#press(event));
    $("hold").onclick = () => this.#goTo({ candidate: -1 });
    $("chase").onclick = () => this.#goTo({ follow: true });
    const onclick = ({ currentTarget }) => this.#goTo({ candidate: Number(currentTarget.dataset.candidate) });
    const row = () => make("li", { hidden: true }, button("", { onclick }));
    $("nearest").append(...Array.from({ length: NEAREST }, row));
    setInterval(() => this.#listNearest(), LIST_MS);
  }

  #choose({ world, candidate }) {
    const { place, story, role } = this.state;
    if (place) place(world);
    else if (story) return;
    else if (role === "robot" && candidate >= 0) this.#goTo({ candidate });
    else if (role.startsWith("ghost") && this.map.isRobotAt(world)) this.#goTo({ follow: true });
    else if (role !== "none") this.#goTo({ x: world[0], y: world[1] });
    else if (candidate >= 0) notice("To send the robot there, choose its role in the tab Play.", { key: "role" });
  }

  #press(event) {
    const { code, key, target, defaultPrevented } = event;
    const { placing, role, story } = this.state;
    if (defaultPrevented || story || !isShortcut(event)) return; // keys that steer are no choice
    const pointing = placing || role.startsWith("ghost");
    const onMap = target === $("top");
    if (role === "robot" && key.startsWith("Arrow") && !placing) {
      event.preventDefault();
      const candidate = this.#pelletTowards(key);
      if (candidate !== undefined) this.#goTo({ candidate });
    } else if (role === "robot" && /^Digit[1-9]$/.test(code)) {
      const pellet = this.#nearestPellets()[Number(code.at(-1)) - 1];
      if (pellet) this.#goTo({ candidate: pellet.candidate });
    } else if (onMap && key.startsWith("Arrow")) {
      event.preventDefault();
      const [up, left] = FORWARD_LEFT[key];
      if (pointing) this.map.moveCross(-STEP_M * left, STEP_M * up);
      else this.map.pan(PAN_PX * left, PAN_PX * up);
    } else if (onMap && key === "Enter" && pointing && this.map.cross) {
      this.#choose({ world: this.map.cross, candidate: -1 });
      this.map.hideCross();
    }
  }

  // The next pellet in the direction of a key on the screen: from the robot, or from its goal if the same key chose it.
  // It is the nearest one, where a metre to the side counts as SIDEWAYS metres.
  #pelletTowards(key) {
    const { scene, frame } = this.state;
    const { candidate: last, key: lastKey, time } = this.#arrow;
    const goesOn = key === lastKey && frame.alive[last] && (frame.goal === last || performance.now() - time < TWICE_MS);
    const origin = goesOn ? scene.pellets[last] : robotPose(frame);
    if (!origin) return undefined;
    const [up, left] = FORWARD_LEFT[key];
    const { view } = this.map;
    const [x, y] = view.toScreen(...origin);
    let [best, least] = [undefined, Infinity];
    scene.pellets.forEach((place, candidate) => {
      const [right, down] = view.toScreen(...place).map((to, k) => to - [x, y][k]);
      const [ahead, aside] = up ? [-up * down, Math.abs(right)] : [-left * right, Math.abs(down)];
      const cost = ahead + SIDEWAYS * aside;
      if (!frame.alive[candidate] || ahead < 1 || aside > WIDEST * ahead || cost >= least) return;
      [best, least] = [candidate, cost];
    });
    if (best !== undefined) this.#arrow = { candidate: best, key, time: performance.now() };
    return best;
  }

  #nearestPellets() {
    const { scene, frame } = this.state;
    const pose = robotPose(frame);
    if (!scene || !pose) return [];
    return scene.pellets.map(([x, y], candidate) => ({ candidate, distance: Math.hypot(x - pose[0], y - pose[1]) }))
      .filter(({ candidate }) => frame.alive[candidate]).sort((a, b) => a.distance - b.distance).slice(0, NEAREST);
  }

  #listNearest() {
    if (this.state.role !== "robot" || document.hidden || $("panel-play").hidden) return;
    const pellets = this.#nearestPellets();
    [...$("nearest").children].forEach((row, k) => {
      row.hidden = k >= pellets.length;
      if (row.hidden) return;
      const [one] = row.children;
      const distance = `${pellets[k].distance.toFixed(1)} m`;
      one.dataset.candidate = String(pellets[k].candidate);
      write(one, `${k + 1}: ${distance}`);
      one.setAttribute("aria-label", `Go to the pellet ${distance} away, key ${k + 1}`);
    });
  }
}
