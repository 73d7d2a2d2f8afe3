// Steering by hand: velocities by keys and by joystick.

import { $, isShortcut, touch } from "./dom.js";

const REPEAT_MS = 100;
const BACKWARDS = 0.5; // share of the speed
const TURNING = 0.6; // share of the turning speed
const KNOB = 0.6; // share of the stick's radius
const STILL = 0.12; // share of the radius in which the stick commands nothing
export const FORWARD_LEFT = { // of a key, as the joystick has them
  ArrowUp: [1, 0], KeyW: [1, 0], ArrowDown: [-1, 0], KeyS: [-1, 0],
  ArrowLeft: [0, 1], KeyA: [0, 1], ArrowRight: [0, -1], KeyD: [0, -1],
};

export class Steering {
  #held = new Set(); // keys
  #stick = null; // [forward, left], each -1 to 1
  #repeat = 0;

  constructor(state, { send }) {
    Object.assign(this, { state, send });
    addEventListener("keydown", (event) => this.#press(event));
    addEventListener("keyup", ({ code }) => this.#held.delete(code) && this.#drive());
    for (const event of ["blur", "pagehide"]) addEventListener(event, () => this.stop());
    document.addEventListener("visibilitychange", () => document.hidden && this.stop());
    state.on("connection story", () => this.stop());
    state.on("role", (role) => this.#showStick(role === "robot" && touch.matches));
    $("stick-show").onclick = () => this.#showStick($("stick").hidden);
    $("stick").onpointerdown = (event) => {
      $("stick").setPointerCapture(event.pointerId);
      this.#moveStick(event);
      this.#drive();
    };
    $("stick").onpointermove = (event) => this.#stick && this.#moveStick(event);
    $("stick").onlostpointercapture = () => this.stop();
  }

  #press(event) {
    const { role, story, placing, source } = this.state;
    if (role !== "robot" || story || placing || !FORWARD_LEFT[event.code] || !isShortcut(event)) return;
    if (source !== "ros" && event.code.startsWith("Arrow")) return; // they choose pellets
    event.preventDefault();
    this.#held.add(event.code);
    this.#drive();
  }

  #moveStick({ clientX, clientY }) {
    const { left, top, width } = $("stick").getBoundingClientRect();
    const radius = width / 2;
    const [x, y] = [(clientX - left) / radius - 1, (clientY - top) / radius - 1];
    const far = Math.max(1, Math.hypot(x, y));
    $("knob").style.transform = `translate(${(x / far) * radius * KNOB}px, ${(y / far) * radius * KNOB}px)`;
    this.#stick = [-y / far, -x / far].map((value) => (Math.abs(value) < STILL ? 0 : value));
  }

  #showStick(show) {
    $("stick").hidden = !show;
    $("stick-show").setAttribute("aria-pressed", String(show));
  }

  // Sends the velocities now, again while something is held, and zero once when it is released.
  #drive() {
    clearTimeout(this.#repeat);
    this.#repeat = 0;
    const { role, scene } = this.state;
    if (role !== "robot") return;
    const sum = (axis) => Math.sign([...this.#held].reduce((total, code) => total + FORWARD_LEFT[code][axis], 0));
    const [forward, left] = this.#stick ?? [sum(0), sum(1)];
    const speed = (scene?.robot.speed_mps ?? 0.3) * (forward < 0 ? BACKWARDS : 1);
    this.send({ do: "drive", v: speed * forward, omega: TURNING * (scene?.turn_radps ?? 1.9) * left });
    if (this.#held.size || this.#stick) this.#repeat = setTimeout(() => this.#drive(), REPEAT_MS);
  }

  stop() {
    const driving = this.#repeat !== 0;
    this.#held.clear();
    this.#stick = null;
    $("knob").style.transform = "";
    if (driving) this.#drive();
  }
}
