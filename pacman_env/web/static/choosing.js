// Goals of a player: by click, by keys on the map, and by a list of the nearest pellets.

import { $, button, isShortcut, make, write } from "./dom.js";
import { notice } from "./notices.js";
import { robotPose } from "./state.js";
import { FORWARD_LEFT } from "./steering.js";

const STEP_M = 0.2;
const PAN_PX = 60;
const SIDEWAYS = 1.5;
const WIDEST = 2; // metres to the side per metre ahead, within which a pellet lies in a direction
const NEAREST = 9; // pellets in the list, one by key
const LIST_MS = 500;

export class Choosing {
  #goTo = (place) => this.game.request({ do: "goal", ...place });

  // `place` is called with a place that is clicked to set a pose or to place a ghost.
  constructor(state, game, map, place) {
    Object.assign(this, { state, game, map, place });
    state.on("tap", (tap) => this.#choose(tap));
    addEventListener("keydown", (event) => this.#press(event));
    $("hold").onclick = () => this.#goTo({ candidate: -1 });
    $("chase").onclick = () => this.#goTo({ follow: true });
    const onclick = ({ currentTarget }) => this.#goTo({ candidate: Number(currentTarget.dataset.candidate) });
    const row = () => make("li", { hidden: true }, button("", { onclick }));
    $("nearest").append(...Array.from({ length: NEAREST }, row));
    setInterval(() => this.#listNearest(), LIST_MS);
  }

  #choose({ world, candidate }) {
    const { posing, placing, story, role } = this.state;
    if (posing || placing) this.place(world);
    else if (story) return;
    else if (role === "robot" && candidate >= 0) this.#goTo({ candidate });
    else if (role.startsWith("ghost") && this.#isRobot(world)) this.#goTo({ follow: true });
    else if (role !== "none") this.#goTo({ x: world[0], y: world[1] });
    else if (candidate >= 0) notice("To send the robot there, choose its role in the tab Play.", { key: "role" });
  }

  #isRobot(world) {
    const pose = robotPose(this.state.frame);
    return pose && this.map.isNear(pose, world);
  }

  #press(event) {
    const { code, key, target, defaultPrevented } = event;
    const { posing, placing, role, story } = this.state;
    if (defaultPrevented || story || !isShortcut(event)) return; // keys that steer are no choice
    const pointing = posing || placing || role.startsWith("ghost");
    const onMap = target === $("top");
    const movesFocus = target?.matches?.("input[type=range], [role=tab]");
    if (role === "robot" && key.startsWith("Arrow") && !placing && !movesFocus) {
      event.preventDefault();
      const candidate = this.#pelletTowards(FORWARD_LEFT[key]);
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

  // The next pellet in a direction on the screen ([up, left]) from the robot, or from its goal if that is the next one:
  // the nearest, where a metre to the side counts as SIDEWAYS metres.
  #pelletTowards([up, left]) {
    const { scene, frame } = this.state;
    const pose = robotPose(frame);
    if (!scene || !pose) return undefined;
    const towards = (origin) => scene.pellets.map((place, candidate) => {
      const [from, to] = [origin, place].map(([x, y]) => this.map.view.toScreen(x, y));
      const [right, down] = [to[0] - from[0], to[1] - from[1]];
      const [ahead, aside] = up ? [-up * down, Math.abs(right)] : [-left * right, Math.abs(down)];
      return { candidate, ahead, aside, cost: ahead + SIDEWAYS * aside };
    }).filter(({ candidate, ahead, aside }) => frame.alive[candidate] && ahead > 1 && aside < WIDEST * ahead)
      .sort((a, b) => a.cost - b.cost)[0]?.candidate;
    const first = towards(pose);
    return first === frame.goal && first !== undefined ? towards(scene.pellets[first]) ?? first : first;
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
