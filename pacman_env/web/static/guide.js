// The key to the map: each symbol as the map draws it, with its name.

import { palette } from "./colours.js";
import { $, make } from "./dom.js";
import { Painter, drawPlaces, drawTop } from "./draw.js";
import { leds } from "./effects.js";
import { View } from "./view.js";

const VIEW = Object.assign(new View(), { width: 40, height: 36, scale: 62 });
const AT = [0, 0, 0];
const GOAL = [0.04, 0.02];

const ghost = (look, layers = {}) => ({ scene: { ghosts: [look] }, poses: { ghosts: [AT] }, layers });
const pose = (name) => ({ poses: { ghosts: [], true: AT, [name]: AT } });
const pellet = (exists, power) => ({ scene: { pellets: [AT], power }, frame: { alive: [exists] } });

// Names of what this game shows, and a small game with nothing else; null: the light ring.
function entries({ ghosts, power }, source) {
  const [first] = ghosts;
  return [
    ["robot", pose("robot")],
    ["where it believes it is", { ...pose("believed"), layers: { believed: true } }],
    ...ghosts.map(({ name, behaviour, colour }) => [`${name}: ${behaviour}`, ghost({ colour })]),
    ["a ghost catches the robot in here", ghost({ colour: first?.colour, catch_m: 0.26 }, { catch: true })],
    ["pellet", pellet(true)],
    ["collected", pellet(false)],
    ...power ? [
      ["power pellet: frightens all ghosts", pellet(true, { pellets: [0] })],
      ["frightened: the robot can catch it", ghost({ colour: power.frightened })],
      ["blinks: soon dangerous again", ghost({ colour: power.blinking })],
      ["caught: on its way back", ghost({ colour: null })],
    ] : [],
    ["goal and plan", {
      scene: { pellets: [GOAL], candidates: [GOAL] }, layers: { plan: true },
      frame: { goal: 0, plan: [[-0.3, -0.22], [-0.1, -0.22], GOAL] },
    }],
    ["score of the policy: fuller is better", {
      scene: { candidates: [AT, [9, 9], [9, 9]] }, frame: { scores: [0.3, 0, 1] }, layers: { scores: true },
    }],
    ["refuge", { scene: { refuges: [AT] } }],
    ["home", { scene: { home: AT } }],
    ...source === "browser" ? [] : [
      ["policy's robot, while you play", pose("baseline")], ["light ring of the robot", null],
    ],
  ];
}

function drawn(shown) {
  if (!shown) return make("div", { class: "ring" }, ...leds());
  const ratio = Math.min(3, devicePixelRatio || 1);
  const canvas = make("canvas", { width: VIEW.width * ratio, height: VIEW.height * ratio, "aria-hidden": "true" });
  const painter = new Painter(canvas, VIEW);
  painter.context.scale(ratio, ratio);
  const scene = { pellets: [], candidates: [], refuges: [], robot: {}, ghosts: [], ...shown.scene };
  const [frame, colours] = [{ alive: [true], plan: [], ...shown.frame }, palette()];
  drawTop(painter, { layers: {}, trail: [], mouth: 0.75, poses: { ghosts: [] }, ...shown, scene, frame, colours });
  drawPlaces(painter, scene, colours);
  return canvas;
}

export class Guide {
  constructor(state) {
    this.state = state;
    $("key").onclick = () => this.toggle();
    $("guide-close").onclick = () => {
      this.toggle();
      $("key").focus();
    };
    state.on("scene theme", () => this.#show());
  }

  #show() {
    if ($("guide").hidden || !this.state.scene) return;
    const rows = entries(this.state.scene, this.state.source).map(([text, shown]) => make("li", {}, drawn(shown), text));
    $("guide-key").replaceChildren(...rows);
  }

  toggle() {
    $("guide").hidden = !$("guide").hidden;
    $("key").setAttribute("aria-expanded", String(!$("guide").hidden));
    this.#show();
  }
}
