// The key to the map: each symbol as the map draws it, with its name.

import { palette } from "./colours.js";
import { request } from "./connection.js";
import { $, make, stored, write } from "./dom.js";
import { DIAMOND, HOME, Painter, drawBelieved, drawGhost, drawPacMan, drawPellet } from "./draw.js";
import { dismiss, notice } from "./notices.js";
import { on, state } from "./state.js";

const [WIDTH, HEIGHT] = [40, 32];
const SCALE = 62; // pixels a metre
const MIDDLE = [WIDTH / 2, HEIGHT / 2];
const POSE = [0, 0, 0];
const NO_LAYERS = {};
const SEEN = "pacman_env.seen"; // in the browser's store, once the first visit is over
const HOW = {
  robot: "You are the robot. Press Start, then click a pellet or use the arrow keys.",
  "ghost-0": "You are Clyde. Press Start, then click where Clyde goes.",
};
const FLAT = { scale: SCALE, turn: 0, toScreen: (x, y) => [MIDDLE[0] + x * SCALE, MIDDLE[1] - y * SCALE] };

const ghost = (look) => (painter, colours) => drawGhost(painter, POSE, look, NO_LAYERS, colours, false);
const pellet = (radius, exists) => (painter, colours) => drawPellet(painter, MIDDLE, radius, exists, colours);

function goalAndPlan(painter, { plan, pellet: fill }) {
  painter.line([[2, 22], [20, 22], [26, 16]], { stroke: plan, width: 3, dash: [1, 6], cap: "round" });
  painter.circle([29, 13], 4, { fill });
  painter.circle([29, 13], 9, { stroke: plan, width: 2.5 });
}

function lightRing(painter) {
  painter.circle(MIDDLE, 14, { fill: "#05070c", stroke: "#7f8ba6" });
  for (let k = 0; k < 6; k++) {
    const angle = (k + 0.5) * Math.PI / 3;
    painter.circle([MIDDLE[0] + 9 * Math.sin(angle), MIDDLE[1] + 9 * Math.cos(angle)], 3, { fill: "#ffcc1f" });
  }
}

function catchRadius(painter, { ghost: stroke }) {
  painter.circle(MIDDLE, 14, { fill: stroke, alpha: 0.13 });
  painter.circle(MIDDLE, 14, { stroke, dash: [4, 4] });
}

const score = (painter, { score: stroke }) => {
  painter.circle(MIDDLE, 10, { stroke, width: 2.4, alpha: 0.2 });
  painter.path((context) => context.arc(...MIDDLE, 10, -Math.PI / 2, Math.PI / 2), { stroke, width: 2.4 });
};

// Names and drawings of what this game shows.
function entries({ ghosts, power }) {
  return [
    ["robot", (painter, { robot, rim }) => drawPacMan(painter, POSE, 13, 0.75, { fill: robot, stroke: rim })],
    ["where it believes it is", (painter, { believed }) => drawBelieved(painter, POSE, 10, believed)],
    ["policy's robot, while you play", (painter, { baseline, rim }) =>
      drawPacMan(painter, POSE, 13, 0.75, { fill: baseline, stroke: rim, alpha: 0.55 })],
    ...ghosts.map(({ name, behaviour, colour }) => [`${name}: ${behaviour}`, ghost({ colour })]),
    ["a ghost catches the robot in here", catchRadius],
    ["pellet", pellet(4.5, true)],
    ["collected", pellet(4.5, false)],
    ...power ? [
      ["power pellet: frightens all ghosts", pellet(8.1, true)],
      ["frightened: the robot can catch it", ghost({ colour: power.frightened })],
      ["blinks: soon dangerous again", ghost({ colour: power.blinking })],
      ["caught: on its way back", ghost({ colour: null })],
    ] : [],
    ["goal and plan", goalAndPlan],
    ["score of the policy: fuller is better", score],
    ["refuge", (painter, { refuge }) => painter.polygon(DIAMOND, MIDDLE, 8, { stroke: refuge, width: 1.8 })],
    ["home", (painter, { home }) => painter.polygon(HOME, MIDDLE, 9, { fill: home, alpha: 0.55 })],
    ["light ring of the robot", lightRing],
  ];
}

function drawn(draw) {
  const ratio = Math.min(3, devicePixelRatio || 1);
  const canvas = make("canvas", { width: WIDTH * ratio, height: HEIGHT * ratio, "aria-hidden": "true" });
  const painter = new Painter(canvas, FLAT);
  painter.context.scale(ratio, ratio);
  draw(painter, palette());
  return canvas;
}

function show() {
  if ($("guide").hidden || !state.scene) return;
  $("guide-key").replaceChildren(...entries(state.scene).map(([text, draw]) => make("li", {}, drawn(draw),
    make("span", { text }))));
}

function openGuide(open, first = false) {
  $("guide").hidden = !open;
  $("welcome").hidden = !first;
  write($("guide-title"), first ? "Pac-Man with a robot" : "Key to the map");
  $("key").setAttribute("aria-expanded", String(open));
  show();
}

export function toggleGuide() {
  openGuide($("guide").hidden);
}

// Closes the guide; a first visit is over then.
function close() {
  if ($("guide").hidden) return;
  stored("localStorage", SEEN, "yes");
  openGuide(false);
}

async function play(role) {
  close();
  if (await request({ do: "role", role })) notice(HOW[role], { key: "role" });
}

$("key").onclick = toggleGuide;
$("guide-close").onclick = () => {
  close();
  $("key").focus();
};
$("welcome-start").onclick = () => {
  close();
  request({ do: "start" });
};
$("welcome-robot").onclick = () => play("robot");
$("welcome-ghost").onclick = () => play("ghost-0");
on("scene theme", show);
on("story", (story) => story && close());
on("frame", ({ state: now }) => {
  if (now !== "starting") return;
  dismiss("role");
  if (!$("welcome").hidden) close();
});
if (!stored("localStorage", SEEN) && !location.hash) openGuide(true, true);
