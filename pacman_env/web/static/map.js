// The live map: canvases, view, layers, and when to draw.

import { palette } from "./colours.js";
import { $, make } from "./dom.js";
import { Painter, drawBase, drawTop } from "./draw.js";
import { Motion } from "./motion.js";
import { notice } from "./notices.js";
import { MapPicture, boundsOf } from "./picture.js";
import { count, emit, on, robotPose, shownFrame, shownScene, state } from "./state.js";
import { View, setUpGestures } from "./view.js";

const LAYERS = Object.entries({
  scores: "Scores as rings", plan: "Plan", trail: "Trail", believed: "Believed pose",
  catch: "Catch radius", names: "Names", lidar: "Lidar",
});
const TRAIL_M = 0.04;
const MOST_TRAIL = 3000;
const SPANS = 0.6; // share of the map's width or height from which a card covers a whole side
const SMALL = 0.08; // share of the map's area below which a card covers nothing
const LEAST_FREE = 0.4; // share of the map's width or height that cards leave free, or else they are ignored
export const NEAR_PX = 24; // between a click and what it means

export const view = new View();
export const layers = Object.fromEntries(LAYERS.map(([name]) => [name, name !== "lidar"]));
export let cross = null; // the place chosen by keys

const base = new Painter($("base"), view, { alpha: false });
const top = new Painter($("top"), view);
const motion = new Motion();
let picture = null;
let baseChanged = true;
let request = 0;
let trail = [];
let driven = 0; // m, which opens and closes the mouth

function resize() {
  const { clientWidth: width, clientHeight: height } = $("map");
  const ratio = Math.min(3, devicePixelRatio || 1);
  for (const { context } of [base, top]) {
    context.canvas.width = Math.round(width * ratio);
    context.canvas.height = Math.round(height * ratio);
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
  }
  view.resize(width, height);
  redraw();
}

export function zoom(times) {
  view.zoom(times);
  redraw();
}

// What covers the map: rectangles of its shown elements with the attribute `data-covers`, in pixels of the map.
function cards() {
  const { left, top } = $("map").getBoundingClientRect();
  return [...$("map").querySelectorAll("[data-covers]")].map((card) => card.getBoundingClientRect())
    .map((card) => ({ x0: card.left - left, x1: card.right - left, y0: card.top - top, y1: card.bottom - top }))
    .filter(({ x0, x1, y0, y1 }) => (x1 - x0 > SPANS * view.width && y1 > y0) || (y1 - y0 > SPANS * view.height && x1 > x0)
      || (x1 - x0) * (y1 - y0) > SMALL * view.width * view.height);
}

function insetsOf(shown) {
  const { width, height } = view;
  const insets = { top: 0, right: 0, bottom: 0, left: 0 };
  const add = (side, pixels) => (insets[side] = Math.max(insets[side], pixels));
  for (const { x0, x1, y0, y1 } of shown) {
    if (x1 - x0 > SPANS * width) y0 + y1 < height ? add("top", y1) : add("bottom", height - y0);
    else x0 + x1 < width ? add("left", x1) : add("right", width - x0);
  }
  if (height - insets.top - insets.bottom < LEAST_FREE * height) insets.top = insets.bottom = 0;
  if (width - insets.left - insets.right < LEAST_FREE * width) insets.left = insets.right = 0;
  return insets;
}

// Fits the map into what the cards leave free; a map that is not fitted moves only if a card covers the robot.
function arrange() {
  const shown = cards();
  view.insets = insetsOf(shown);
  const { robot } = motion.at(performance.now());
  const [x, y] = robot ? view.toScreen(...robot) : [];
  if (view.fitted) view.fit();
  else if (shown.some(({ x0, x1, y0, y1 }) => x > x0 && x < x1 && y > y0 && y < y1)) view.centre(...robot);
  redraw();
}

export function fit() {
  follow(false);
  view.fit();
}

export function follow(on_) {
  view.following = on_;
  $("follow").setAttribute("aria-pressed", String(on_));
  if (on_ && view.fitted) view.zoom(1.8);
  redraw();
}

export function pan(dx, dy) {
  follow(false);
  view.pan(dx, dy);
}

export function moveCross(dx, dy) {
  const [x, y] = cross ?? [view.x, view.y];
  const [right, up] = view.along(dx, dy);
  cross = [x + right, y + up];
  redraw(false);
}

export function hideCross() {
  cross = null;
  redraw(false);
}

export function repaint() {
  picture?.paint(palette());
  redraw();
}

export async function showScene(scene) {
  const { map } = scene;
  const sameMap = picture && picture.map.name === map?.name;
  let loaded = map?.url === picture?.map.url ? picture : null;
  if (map && !loaded) {
    try {
      loaded = await MapPicture.load(map);
      loaded.paint(palette());
    } catch {
      if (shownScene() === scene) notice("The map image could not be loaded.");
    }
    if (shownScene() !== scene) return;
  }
  picture = loaded;
  const points = [...scene.pellets, ...(scene.home ? [scene.home] : [])];
  if (picture) view.bounds = picture.bounds;
  else if (points.length) view.bounds = boundsOf(points, 1);
  if (!sameMap || view.fitted) {
    view.fit();
    if (view.following) follow(true);
  }
  trail = [];
  redraw();
}

// Moves to a frame of the game, or shows it at once; a finished round has its own trail.
export function showFrame(frame, { jump = false, path = null } = {}) {
  if (jump || !motion.to || frame.time_s < motion.to.time_s) trail = [];
  motion.update(frame, performance.now(), jump);
  const pose = robotPose(frame);
  const step = pose && trail.length ? distance(pose, trail.at(-1)) : Infinity;
  if (path) trail = path;
  else if (pose && !jump && step >= TRAIL_M) {
    if (step < 5) driven += step;
    trail.push(pose);
    if (trail.length > MOST_TRAIL) trail.splice(0, MOST_TRAIL / 10);
  }
  redraw(false);
}

const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

// The number of the candidate near a point of the page, or -1.
function candidateAt(at) {
  const [scene, frame] = [shownScene(), shownFrame()];
  let [best, least] = [-1, NEAR_PX];
  (scene?.candidates ?? []).forEach((place, k) => {
    if (!place || (k < (scene.first_refuge ?? Infinity) && frame && !frame.alive[k])) return;
    const away = distance(view.toScreen(...place), at);
    if (away < least) [best, least] = [k, away];
  });
  return best;
}

function redraw(withBase = true) {
  baseChanged ||= withBase;
  if (!request && !document.hidden) request = requestAnimationFrame(draw);
}

function draw() {
  request = 0;
  const now = performance.now();
  const poses = motion.at(now);
  if (view.following && poses.robot && distance(view.toScreen(...poses.robot), view.middle) > 0.3) {
    view.centre(...poses.robot);
    baseChanged = true;
  }
  const [scene, frame, colours] = [shownScene(), motion.to, palette()];
  if (baseChanged) drawBase(base, { picture, scene, colours });
  baseChanged = false;
  const ahead = poses.robot && trail.length ? Math.min(1, distance(poses.robot, trail.at(-1))) : 0;
  drawTop(top, {
    scene, frame, poses, trail, layers, colours, candidate: state.candidate, numbered: $("panel-why").offsetParent,
    mine: state.story ? "none" : state.role,
    cross: state.posing || state.placing || state.role.startsWith("ghost") ? cross ?? state.stands : null,
    mouth: frame?.state === "running" ? 0.5 + 0.5 * Math.sin((driven - ahead) * 22) : 0.75,
  });
  count.frames_drawn++;
  if (motion.moving(now)) redraw(false);
}

function openLayers(open) {
  $("layers-list").hidden = !open;
  $("layers").setAttribute("aria-expanded", String(open));
}

setUpGestures($("top"), view, {
  changed: redraw,
  panned: () => follow(false),
  tapped: (at) => {
    hideCross();
    emit("tap", { world: view.toWorld(...at), candidate: candidateAt(at) });
  },
  hovered: (at) => {
    const ghost = state.role.startsWith("ghost"); // which goes anywhere
    const candidate = at && !ghost ? candidateAt(at) : -1;
    $("top").classList.toggle("pointing", ghost || (candidate >= 0 && state.role === "robot"));
    if (candidate !== state.candidate) emit("candidate", (state.candidate = candidate));
  },
});
$("map").addEventListener("pointerdown", ({ target }) => target === $("top") && openLayers(false));
document.addEventListener("visibilitychange", () => {
  cancelAnimationFrame(request);
  request = 0;
  redraw();
});
$("zoom-in").onclick = () => zoom(1.4);
$("zoom-out").onclick = () => zoom(1 / 1.4);
$("fit").onclick = fit;
$("follow").onclick = () => follow(!view.following);
$("layers").onclick = () => openLayers($("layers-list").hidden);
$("layers-list").append(...LAYERS.map(([name, text]) => make("label", { class: "switch" }, make("input", {
  type: "checkbox", checked: layers[name], id: `layer-${name}`,
  onchange: ({ target }) => {
    layers[name] = target.checked;
    emit("layers");
    redraw(false);
  },
}), make("span", { text }))));
on("candidate role placing tab", () => redraw(false));
const sizes = new ResizeObserver((changes) => { // also of an element that is shown or hidden
  if (changes.some(({ target }) => target === $("map"))) resize();
  arrange();
});
for (const element of [$("map"), ...$("map").querySelectorAll("[data-covers]")]) sizes.observe(element);
resize();
