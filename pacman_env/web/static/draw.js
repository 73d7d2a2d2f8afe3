// What the two canvases show: below the map and what stands still, above it what moves.

import { css, still } from "./dom.js";

const FULL = 2 * Math.PI;
// Shapes, in units of their size.
const HOME = [[0, -1], [1, -0.1], [0.65, -0.1], [0.65, 0.8], [-0.65, 0.8], [-0.65, -0.1], [-1, -0.1]];
const DIAMOND = [[0, -1.25], [1, 0], [0, 1.25], [-1, 0]];
const OCTAGON = Array.from({ length: 8 }, (_, k) => [Math.cos(FULL * (k + 0.5) / 8), Math.sin(FULL * (k + 0.5) / 8)]);
const RED = "#e02434";
const RAYS = 12;
const OPENED_UP = 5.8; // mouth that spans the whole circle
const POWER = 1.8; // size of a power pellet relative to a pellet
const BLINK_MS = 500; // half blue and half white
const GHOST = [
  ...Array.from({ length: 25 }, (_, k) => [-Math.cos(k * FULL / 48), -0.15 - Math.sin(k * FULL / 48)]),
  ...Array.from({ length: 7 }, (_, k) => [1 - k / 3, k % 2 ? 0.68 : 0.95]),
];

export class Painter {
  constructor(canvas, view, options) {
    this.context = canvas.getContext("2d", options);
    this.view = view;
  }

  // A size on the map in pixels of the page, limited to what can be seen.
  size(metres, least, most) {
    return Math.min(most, Math.max(least, metres * this.view.scale));
  }

  path(trace, { fill, stroke, width = 1.5, alpha = 1, dash = [], cap = "butt" }) {
    const { context } = this;
    context.save();
    context.beginPath();
    trace(context);
    Object.assign(context, { globalAlpha: alpha, lineWidth: width, lineCap: cap, lineJoin: "round" });
    Object.assign(context, { fillStyle: fill, strokeStyle: stroke });
    context.setLineDash(dash);
    if (fill) context.fill();
    if (stroke) context.stroke();
    context.restore();
  }

  // A circle, or a share of it from the top on.
  circle([x, y], radius, style, share = 1) {
    this.path((context) => context.arc(x, y, radius, -FULL / 4, FULL * (share - 1 / 4)), style);
  }

  polygon(points, [x, y], size, style) {
    this.path((context) => {
      for (const [dx, dy] of points) context.lineTo(x + size * dx, y + size * dy);
      context.closePath();
    }, style);
  }

  line(points, style) {
    this.path((context) => points.forEach(([x, y]) => context.lineTo(x, y)), style);
  }

  text(text, [x, y], colour, font, halo, pixels = 12) {
    const { context } = this;
    Object.assign(context, { font: `${font} ${pixels}px system-ui, sans-serif`, textAlign: "center" });
    Object.assign(context, { fillStyle: colour, strokeStyle: halo, lineWidth: 3.5, lineJoin: "round" });
    if (halo) context.strokeText(text, x, y);
    context.fillText(text, x, y);
  }
}

export function drawBase(painter, { picture, scene, colours }) {
  const { context, view } = painter;
  context.fillStyle = colours.page;
  context.fillRect(0, 0, view.width, view.height);
  if (!scene) return;
  if (picture) {
    const { resolution, origin, height } = picture.map;
    const pixel = (resolution * view.scale) / picture.zoom;
    context.save();
    context.translate(...view.toScreen(origin[0], origin[1]));
    context.rotate(-(origin[2] ?? 0) - view.turn);
    context.scale(pixel, pixel);
    context.imageSmoothingQuality = "high";
    context.drawImage(picture.drawn, 0, -height * picture.zoom);
    context.restore();
  }
  drawPlaces(painter, scene, colours);
  const metres = view.scale > 90 ? 0.5 : view.scale > 22 ? 1 : 5;
  const [right, y] = [view.free.x1 - 16, view.free.y1 - 14];
  const left = right - metres * view.scale;
  painter.line([[left, y - 4], [left, y], [right, y], [right, y - 4]], { stroke: colours.home });
  painter.text(`${metres} m`, [(left + right) / 2, y - 6], colours.home, "");
}

export function drawPlaces(painter, { home, refuges }, colours) {
  const { view } = painter;
  if (home) painter.polygon(HOME, view.toScreen(...home), painter.size(0.16, 7, 20), { fill: colours.home, alpha: 0.55 });
  for (const refuge of refuges) {
    painter.polygon(DIAMOND, view.toScreen(...refuge), painter.size(0.1, 4.5, 14), { stroke: colours.refuge, width: 1.8 });
  }
}

export function drawTop(painter, shown) {
  const { scene, frame, poses, trail, layers, colours, candidate, numbered, mine, cross, mouth, finale } = shown;
  const { context, view } = painter;
  context.clearRect(0, 0, view.width, view.height);
  if (!scene || !frame) return;
  const screen = (points) => points.map(([x, y]) => view.toScreen(x, y));
  const place = (number) => (scene.candidates[number] ? view.toScreen(...scene.candidates[number]) : null);
  const pellet = painter.size(0.075, 3.6, 16);
  screen(scene.pellets).forEach((at, k) => {
    const [fill, size] = frame.alive[k] ? [colours.pellet, pellet] : [colours.eaten, 0.55 * pellet];
    painter.circle(at, scene.power?.pellets.includes(k) ? POWER * size : size, { fill });
  });
  if (layers.scores) drawScores(painter, frame, place, colours.score);
  if (layers.trail) painter.line(screen(trail), { stroke: colours.trail, width: 2.2, alpha: 0.5, cap: "round" });
  if (layers.plan) {
    painter.line(screen(frame.plan), { stroke: colours.plan, width: 3, alpha: 0.85, dash: [1, 6], cap: "round" });
  }
  const [goal, pointed] = [place(frame.goal), place(candidate)];
  const ring = painter.size(0.2, 9, 30);
  for (const [radius, width] of goal ? [[ring, 3], [ring + 4.5, 1.2]] : []) {
    painter.circle(goal, radius, { stroke: colours.plan, width });
  }
  if (pointed) painter.circle(pointed, ring + 7, { stroke: colours.goal, width: 2.5 });
  if (layers.lidar && poses.robot) drawScan(painter, frame.scan, poses.robot, colours.lidar);
  poses.ghosts.forEach((_, k) => drawTarget(painter, frame.ghost_goals?.[k], scene.ghosts[k]?.colour, colours));
  poses.ghosts.forEach((pose, k) => {
    drawGhost(painter, pose, { ...scene.ghosts[k], ...lookOf(frame, scene.power, k) }, layers, colours,
      mine === `ghost-${k}`);
  });
  const radius = painter.size(scene.robot.radius_m ?? 0.17, 9, 60);
  if (poses.baseline) {
    const [x, y] = view.toScreen(...poses.baseline);
    drawPacMan(painter, poses.baseline, radius, mouth, { fill: colours.baseline, stroke: colours.rim, alpha: 0.55 });
    const covered = screen(poses.robot ? [poses.robot] : []).some((at) => Math.hypot(x - at[0], y - at[1]) < radius);
    if (layers.names && !covered) painter.text(scene.policy ?? "", [x, y + radius + 13], colours.ink, "600", colours.halo);
  }
  const opened = finale && !finale.won ? mouth + (OPENED_UP - mouth) * finale.share : mouth; // until nothing is left
  if (poses.robot) {
    const at = view.toScreen(...poses.robot);
    const fill = scene.pose_lost ? colours.home : colours.robot;
    drawPacMan(painter, poses.robot, radius, opened, { fill, stroke: colours.rim });
    if (finale) drawFinale(painter, at, radius, finale, colours);
    if (mine === "robot") painter.circle(at, radius + 5, { stroke: colours.goal, dash: [3, 3] });
    if (frame.stopped) painter.polygon(OCTAGON, at, radius + 9, { stroke: RED, width: 4 });
  }
  if (layers.believed && poses.believed && poses.true) drawBelieved(painter, poses.believed, radius, colours.believed);
  if (numbered) drawNumbers(painter, scene, frame, colours);
  for (const [x, y, points] of frame.points ?? []) {
    painter.text(String(points), view.toScreen(x, y), colours.points, "800", colours.halo, 20);
  }
  if (cross) drawCross(painter, view.toScreen(...cross), 10, { stroke: colours.goal, width: 2 });
}

// The numbers of the candidates, as the table of their terms names them.
function drawNumbers(painter, { names = [], candidates, first_refuge: refuges = Infinity }, { alive }, colours) {
  const above = painter.size(0.2, 8, 30) + 4;
  names.forEach((name, k) => {
    if (k < refuges && !alive[k]) return;
    const [x, y] = painter.view.toScreen(...candidates[k]);
    painter.text(name.split(" ").at(-1), [x, y - above], k < refuges ? colours.ink : colours.refuge, "700", colours.halo);
  });
}

// What power pellets change of a ghost's look: its colour, null if only its eyes are left; whether it is harmless.
function lookOf({ harmless_s: harmless = [], away_s: away = [] }, power, k, now = performance.now()) {
  if (!power || !(harmless[k] > 0)) return {};
  if (away[k] > 0) return { colour: null, harmless: true };
  const white = harmless[k] < power.warning_s && (still.matches || now % BLINK_MS < BLINK_MS / 2);
  return { colour: white ? power.blinking : power.frightened, harmless: true };
}

// A policy's scores: the better, the farther the ring closes.
function drawScores(painter, { scores, goal }, place, stroke) {
  const finite = scores.filter(Number.isFinite);
  const low = Math.min(...finite);
  const span = Math.max(...finite) - low || 1;
  const radius = painter.size(0.2, 8, 30);
  scores.forEach((score, k) => {
    const at = place(k);
    if (!at || !Number.isFinite(score) || k === goal) return;
    const share = 0.06 + 0.94 * ((score - low) / span);
    painter.circle(at, radius, { stroke, width: 2.4, alpha: 0.16 });
    painter.circle(at, radius, { stroke, width: 2.4, alpha: 0.35 + 0.6 * share, cap: "round" }, share);
  });
}

function drawScan({ context, view }, scan, [x, y, heading], colour) {
  context.fillStyle = colour;
  scan.forEach((range, k) => {
    if (range <= 0) return;
    const angle = heading + (k * FULL) / scan.length;
    const [px, py] = view.toScreen(x + range * Math.cos(angle), y + range * Math.sin(angle));
    context.fillRect(px - 1.3, py - 1.3, 2.6, 2.6);
  });
}

function drawPacMan(painter, [worldX, worldY, yaw], radius, mouth, style) {
  const [x, y] = painter.view.toScreen(worldX, worldY);
  const heading = yaw + painter.view.turn;
  const half = 0.12 + 0.52 * mouth;
  painter.path((context) => {
    context.moveTo(x - 0.2 * radius * Math.cos(heading), y + 0.2 * radius * Math.sin(heading));
    context.arc(x, y, radius, -heading + half, -heading - half + FULL);
    context.closePath();
  }, style);
}

// The end of a round: a win opens rings and a star of rays, a catch one red ring; `share` of it is over.
function drawFinale(painter, [x, y], radius, { won, share }, colours) {
  const stroke = won ? colours.robot : RED;
  const reach = radius * (1.3 + 5 * share);
  painter.circle([x, y], reach, { stroke, width: 5, alpha: 1 - 0.8 * share });
  for (let k = 0; k < RAYS; k++) {
    const [dx, dy] = [Math.cos(FULL * k / RAYS), Math.sin(FULL * k / RAYS)];
    const [from, to] = won ? [0.7 * reach, reach * 1.4] : [1.1 * radius, radius * (1.1 + 1.5 * share)];
    const ray = [[x + from * dx, y + from * dy], [x + to * dx, y + to * dy]];
    painter.line(ray, { stroke, width: 4, alpha: 1 - 0.8 * share, cap: "round" });
  }
}

function drawBelieved(painter, [worldX, worldY, yaw], radius, stroke) {
  const [x, y] = painter.view.toScreen(worldX, worldY);
  const heading = yaw + painter.view.turn;
  const [dx, dy] = [radius * Math.cos(heading), -radius * Math.sin(heading)];
  painter.circle([x, y], radius, { stroke, width: 1.8 });
  painter.line([[x + dx, y + dy], [x + 1.6 * dx, y + 1.6 * dy]], { stroke, width: 1.8 });
}

// Where a person has sent a ghost: a cross in a ring.
function drawTarget(painter, goal, colour, colours) {
  if (!goal || goal[0] === null) return;
  const at = painter.view.toScreen(...goal);
  for (const [stroke, width] of [[colours.halo, 6], [colour ? css(colour) : colours.home, 3]]) {
    drawCross(painter, at, painter.size(0.14, 8, 24), { stroke, width });
  }
}

function drawCross(painter, [x, y], size, style) {
  painter.circle([x, y], 1.5 * size, style);
  for (const d of [size / 1.5, -size / 1.5]) painter.line([[x - d, y - size / 1.5], [x + d, y + size / 1.5]], style);
}

function drawGhost(painter, pose, { name, colour, catch_m: catchM, harmless }, layers, colours, mine) {
  if (!Number.isFinite(pose[0])) return;
  const [x, y] = painter.view.toScreen(...pose);
  const fill = colour ? css(colour) : colours.home;
  const size = painter.size(0.16, 9, 44);
  if (layers.catch && catchM && !harmless) {
    painter.circle([x, y], catchM * painter.view.scale, { fill, alpha: 0.13 });
    painter.circle([x, y], catchM * painter.view.scale, { stroke: fill, dash: [4, 4] });
  }
  const outline = { stroke: mine ? colours.goal : colours.ghost, width: mine ? 3 : 1.2 };
  const [eyeSize, eyeOutline] = colour === null ? [0.38, outline] : [0.27, {}]; // null: only its eyes are left
  if (colour !== null) painter.polygon(GHOST, [x, y], size, { fill, ...outline });
  for (const eye of [x - 0.4 * size, x + 0.4 * size]) {
    painter.circle([eye, y - 0.2 * size], eyeSize * size, { fill: "#fff", ...eyeOutline });
    painter.circle([eye, y - 0.16 * size], eyeSize / 2 * size, { fill: "#14203c" });
  }
  if (layers.names && name) painter.text(name, [x, y + size + 14], colours.ink, "600", colours.halo);
}
