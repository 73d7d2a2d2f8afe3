// Play it yourself: roles, goals by click and by key, velocities by keys and by joystick.

import { request, send } from "./connection.js";
import { $, button, isShortcut, make, renderReleased, showMap, write, writeOrHide } from "./dom.js";
import * as map from "./map.js";
import { notice } from "./notices.js";
import { poseRobot } from "./pose.js";
import { placeGhost } from "./setup.js";
import { emit, me, on, robotPose, source, state, updateControls } from "./state.js";

const REPEAT_MS = 100;
const STEP_M = 0.2;
const PAN_PX = 60;
const BACKWARDS = 0.5; // share of the speed
const TURNING = 0.6; // share of the turning speed
const FORWARD_LEFT = { // of a key, as the joystick has them
  ArrowUp: [1, 0], KeyW: [1, 0], ArrowDown: [-1, 0], KeyS: [-1, 0],
  ArrowLeft: [0, 1], KeyA: [0, 1], ArrowRight: [0, -1], KeyD: [0, -1],
};

const goTo = (place) => request({ do: "goal", ...place });

function chooseOnMap({ world, candidate }) {
  if (state.posing) poseRobot(world);
  else if (state.placing) placeGhost(world);
  else if (state.story) return;
  else if (state.role === "robot" && candidate >= 0) goTo({ candidate });
  else if (state.role.startsWith("ghost") && isRobot(world)) goTo({ follow: true });
  else if (state.role !== "none") goTo({ x: world[0], y: world[1] });
  else if (candidate >= 0) notice("To send the robot there, choose its role in the tab Play.", { key: "role" });
}
on("tap", chooseOnMap);

function isRobot([x, y]) {
  const pose = robotPose(state.frame);
  return pose && Math.hypot(pose[0] - x, pose[1] - y) * map.view.scale < map.NEAR_PX;
}

async function chooseRole(role) {
  stopDriving();
  const answer = await request({ do: "role", role });
  if (answer?.data?.words) notice(`The role is ${answer.data.words}.`);
}

function showRoles() {
  const players = state.people.roles ?? {};
  const mine = Object.keys(players).find((role) => players[role] && players[role] === me()) ?? "none";
  if (mine !== state.role) changeRole(mine);
  renderReleased($("roles"), () => showPlayers(players, mine));
  $("play-robot").hidden = mine !== "robot";
  $("play-ghost").hidden = !mine.startsWith("ghost");
  if (mine.startsWith("ghost")) write($("play-ghost-title"), `You are ${state.hello.roles[mine].name}`);
  showMode();
}

function showPlayers(players, mine) {
  const ghosts = source() === "ros" ? [] : state.scene?.ghosts ?? []; // a robot's game has no players of ghosts
  const rows = state.hello ? [{ role: "robot", ...state.hello.roles.robot }, ...ghosts] : [];
  const active = document.activeElement?.dataset?.role;
  $("roles").replaceChildren(...rows.map(({ role, name, colour }) => {
    const player = players[role];
    const taken = player && player !== me();
    const act = role === mine ? "Leave" : "Play";
    return make("li", {}, make("span", { class: colour ? "dot" : "dot robot", colour }),
      make("span", { class: "player", text: `${name}: ${taken ? player : player ? "you" : "free"}` }),
      button(role === mine ? "Leave" : taken ? "Taken" : `Play ${name}`, {
        class: role === mine ? "small" : "small primary", "aria-label": `${act} ${name}`, disabled: taken,
        data: taken ? { role } : { role, needs: "operator" },
        onclick: () => chooseRole(role === mine ? "none" : role),
      }));
  }));
  if (active) $("roles").querySelector(`[data-role="${active}"]`)?.focus();
  updateControls();
}

function changeRole(role) {
  stopDriving();
  state.role = role;
  showStick(role === "robot" && matchMedia("(pointer: coarse)").matches);
  if (role !== "none") showMap();
  emit("role", role);
}

// What a player can do now.
function task({ state: now, harmless_s: harmless = [], away_s: away = [] }, role) {
  const ghost = Number(role.at(-1));
  const left = role === "robot" ? Math.max(0, ...harmless.filter((_, k) => !away[k])) : harmless[ghost];
  if (left > 0 && role === "robot") return `catch the blue ghosts, ${Math.ceil(left)} s left`;
  if (left > 0) return away[ghost] > 0 ? `caught, back in ${Math.ceil(left)} s` : `frightened for ${Math.ceil(left)} s`;
  const click = role === "robot" ? "click a pellet or use the arrow keys" : "click a place, or the robot to follow it";
  if (now !== "menu") return click;
  return $("start").disabled ? `wait for the start, then ${click}` : `press Start, then ${click}`;
}

function showMode() {
  const { frame, role, story, scene } = state;
  const plays = role !== "none" && !story && ["menu", "starting", "running"].includes(frame?.state);
  const player = role === "robot" ? "the robot" : state.hello?.roles[role]?.name;
  writeOrHide($("mode"), state.posing || (state.placing ? "Click where the ghost starts"
    : plays ? `You are ${player}: ${task(frame, role)}` : ""));
  const driver = state.people.roles?.robot;
  const score = frame?.baseline && driver && !story ? `Pellets: ${driver === me() ? "you" : driver} ${frame.collected}, `
    + `${scene?.policy ?? "policy"} ${frame.baseline_collected}` : "";
  writeOrHide($("duel"), score);
}
on("people hello scene connection", showRoles);
on("frame placing story role", showMode);

function nearestPellets() {
  const { scene, frame } = state;
  const pose = robotPose(frame);
  if (!scene || !pose) return [];
  return scene.pellets.map(([x, y], candidate) => ({ candidate, distance: Math.hypot(x - pose[0], y - pose[1]) }))
    .filter(({ candidate }) => frame.alive[candidate]).sort((a, b) => a.distance - b.distance).slice(0, 9);
}

const nearestButtons = Array.from({ length: 9 }, (_, k) => button(String(k + 1), {
  onclick: ({ currentTarget }) => goTo({ candidate: Number(currentTarget.dataset.candidate) }),
}));
$("nearest").append(...nearestButtons.map((one) => make("li", { hidden: true }, one)));
setInterval(() => {
  if (state.role !== "robot" || document.hidden || $("panel-play").hidden) return;
  const pellets = nearestPellets();
  nearestButtons.forEach((one, k) => {
    one.parentElement.hidden = k >= pellets.length;
    if (k >= pellets.length) return;
    const distance = `${pellets[k].distance.toFixed(1)} m`;
    one.dataset.candidate = String(pellets[k].candidate);
    write(one, `${k + 1}: ${distance}`);
    one.setAttribute("aria-label", `Go to the pellet ${distance} away, key ${k + 1}`);
  });
}, 500);

const held = new Set(); // keys
let stick = null; // [forward, left], each -1 to 1
let repeat = 0;

addEventListener("keydown", (event) => {
  const { code, key, target } = event;
  if (state.story || !isShortcut(event)) return;
  const movesFocus = target?.matches?.("input[type=range], [role=tab]");
  const pointing = state.posing || state.placing || state.role.startsWith("ghost");
  if (state.role === "robot" && FORWARD_LEFT[code] && !movesFocus && !state.placing) {
    event.preventDefault();
    held.add(code);
    drive();
  } else if (state.role === "robot" && /^Digit[1-9]$/.test(code)) {
    const pellet = nearestPellets()[Number(code.at(-1)) - 1];
    if (pellet) goTo({ candidate: pellet.candidate });
  } else if (target === $("top") && key.startsWith("Arrow")) {
    event.preventDefault();
    const [up, left] = FORWARD_LEFT[key];
    if (pointing) map.moveCross(-STEP_M * left, STEP_M * up);
    else map.pan(PAN_PX * left, PAN_PX * up);
  } else if (target === $("top") && key === "Enter" && pointing && map.cross) {
    chooseOnMap({ world: map.cross, candidate: -1 });
    map.hideCross();
  }
});
addEventListener("keyup", ({ code }) => held.delete(code) && drive());
for (const event of ["blur", "pagehide"]) addEventListener(event, stopDriving);
document.addEventListener("visibilitychange", () => document.hidden && stopDriving());
on("connection story", stopDriving);
$("hold").onclick = () => goTo({ candidate: -1 });
$("chase").onclick = () => goTo({ follow: true });
$("stick-show").onclick = () => showStick($("stick").hidden);

function moveStick({ clientX, clientY }) {
  const { left, top, width } = $("stick").getBoundingClientRect();
  const radius = width / 2;
  const [x, y] = [(clientX - left) / radius - 1, (clientY - top) / radius - 1];
  const far = Math.max(1, Math.hypot(x, y));
  $("knob").style.transform = `translate(${(x / far) * radius * 0.6}px, ${(y / far) * radius * 0.6}px)`;
  stick = [-y / far, -x / far].map((value) => (Math.abs(value) < 0.12 ? 0 : value));
}
$("stick").onpointerdown = (event) => {
  $("stick").setPointerCapture(event.pointerId);
  moveStick(event);
  drive();
};
$("stick").onpointermove = (event) => stick && moveStick(event);
$("stick").onlostpointercapture = () => {
  centreStick();
  drive();
};

function centreStick() {
  stick = null;
  $("knob").style.transform = "";
}

function showStick(show) {
  $("stick").hidden = !show;
  $("stick-show").setAttribute("aria-pressed", String(show));
}

// Sends the velocities now, again while something is held, and zero once when it is released.
function drive() {
  clearTimeout(repeat);
  repeat = 0;
  if (state.role !== "robot") return;
  const sum = (axis) => Math.sign([...held].reduce((total, code) => total + FORWARD_LEFT[code][axis], 0));
  const [forward, left] = stick ?? [sum(0), sum(1)];
  const speed = (state.scene?.robot.speed_mps ?? 0.3) * (forward < 0 ? BACKWARDS : 1);
  send({ do: "drive", v: speed * forward, omega: TURNING * (state.scene?.turn_radps ?? 1.9) * left });
  if (held.size || stick) repeat = setTimeout(drive, REPEAT_MS);
}

function stopDriving() {
  const driving = repeat !== 0;
  held.clear();
  centreStick();
  if (driving) drive();
}
