// What the two canvases show: below the map and what stands still, above it what moves.

import { css } from "./dom.js";

const FULL = 2 * Math.PI;

export function drawBase(context, view, ratio, { picture, scene, colours }) {
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.fillStyle = colours.page;
  context.fillRect(0, 0, view.width, view.height);
  if (!scene) return;
  if (picture?.drawn) {
    const { resolution, origin, height } = picture.map;
    const cell = resolution * view.scale;
    const [px, py] = view.toScreen(origin[0], origin[1]);
    context.save();
    context.translate(px, py);
    context.rotate(-(origin[2] ?? 0));
    context.scale(cell / picture.zoom, cell / picture.zoom);
    context.imageSmoothingEnabled = true;
    context.imageSmoothingQuality = "high";
    context.drawImage(picture.drawn, 0, -height * picture.zoom);
    context.restore();
  }
  if (scene.home) {
    const [x, y] = view.toScreen(scene.home[0], scene.home[1]);
    const size = mark(view, 0.16, 7, 20);
    context.fillStyle = colours.home;
    context.beginPath();
    context.moveTo(x, y - size);
    context.lineTo(x + size, y - 0.1 * size);
    context.lineTo(x + 0.65 * size, y - 0.1 * size);
    context.lineTo(x + 0.65 * size, y + 0.8 * size);
    context.lineTo(x - 0.65 * size, y + 0.8 * size);
    context.lineTo(x - 0.65 * size, y - 0.1 * size);
    context.lineTo(x - size, y - 0.1 * size);
    context.closePath();
    context.globalAlpha = 0.55;
    context.fill();
    context.globalAlpha = 1;
  }
  context.strokeStyle = colours.refuge;
  context.lineWidth = 1.8;
  context.beginPath();
  const size = mark(view, 0.1, 4.5, 14);
  for (const refuge of scene.refuges ?? []) {
    const [x, y] = view.toScreen(...refuge);
    context.moveTo(x, y - size * 1.25);
    context.lineTo(x + size, y);
    context.lineTo(x, y + size * 1.25);
    context.lineTo(x - size, y);
    context.closePath();
  }
  context.stroke();
  scaleBar(context, view, colours);
}

// A size on the map, kept within what can be seen.
function mark(view, metres, least, most) {
  return Math.min(most, Math.max(least, metres * view.scale));
}

function scaleBar(context, view, colours) {
  const metres = view.scale > 90 ? 0.5 : view.scale > 22 ? 1 : 5;
  const [length, y] = [metres * view.scale, view.height - 14];
  const right = view.width - 16;
  context.strokeStyle = context.fillStyle = colours.home;
  context.lineWidth = 1.5;
  context.beginPath();
  context.moveTo(right - length, y - 4);
  context.lineTo(right - length, y);
  context.lineTo(right, y);
  context.lineTo(right, y - 4);
  context.stroke();
  context.font = "12px system-ui, sans-serif";
  context.textAlign = "center";
  context.fillText(`${metres} m`, right - length / 2, y - 6);
}

export function drawTop(context, view, ratio, { scene, frame, poses, trail, layers, colours, candidate, mine, cross, mouth }) {
  context.setTransform(ratio, 0, 0, ratio, 0, 0);
  context.clearRect(0, 0, view.width, view.height);
  if (!scene || !frame) return;
  pellets(context, view, scene, frame, colours);
  if (layers.scores) scores(context, view, scene, frame, colours);
  if (layers.trail && trail.length > 1) line(context, view, trail, colours.trail, 2.2, 0.5);
  if (layers.plan && frame.plan.length > 1) line(context, view, frame.plan, colours.plan, 3, 0.85, [1, 6]);
  goal(context, view, scene, frame, colours);
  if (candidate >= 0 && scene.candidates?.[candidate]) pointer(context, view, scene.candidates[candidate], colours);
  if (layers.lidar && frame.scan.length && poses.robot) lidar(context, view, frame.scan, poses.robot, colours);
  poses.ghosts.forEach((place, k) => ghost(context, view, place, scene.ghosts?.[k] ?? {}, layers, colours, mine === `ghost-${k}`));
  const radius = mark(view, scene.robot?.radius_m ?? 0.17, 9, 60);
  if (poses.baseline) {
    context.globalAlpha = 0.55;
    pacman(context, view.toScreen(...poses.baseline), poses.baseline[2], radius, colours.baseline, colours.rim, mouth);
    context.globalAlpha = 1;
    if (layers.names) words(context, scene.baseline_name ?? scene.policy ?? "", view.toScreen(...poses.baseline), radius + 13, colours);
  }
  if (poses.robot) pacman(context, view.toScreen(...poses.robot), poses.robot[2], radius, colours.robot, colours.rim, mouth);
  if (layers.believed && poses.believed && poses.true) believed(context, view, poses.believed, radius, colours);
  if (mine === "robot" && poses.robot) {
    const [x, y] = view.toScreen(...poses.robot);
    circle(context, x, y, radius + 5, colours.goal, 1.5, [3, 3]);
  }
  if (frame.stopped && poses.robot) stopped(context, view.toScreen(...poses.robot), radius);
  if (cross) crosshair(context, view.toScreen(...cross), colours);
}

function circle(context, x, y, radius, colour, width, dash = []) {
  context.beginPath();
  context.arc(x, y, radius, 0, FULL);
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke();
  context.setLineDash([]);
}

function pellets(context, view, scene, frame, colours) {
  const radius = mark(view, 0.075, 3.6, 16);
  for (const there of [false, true]) {
    context.beginPath();
    scene.pellets.forEach((pellet, k) => {
      if (Boolean(frame.alive[k]) !== there) return;
      const [x, y] = view.toScreen(...pellet);
      const size = there ? radius : radius * 0.55;
      context.moveTo(x + size, y);
      context.arc(x, y, size, 0, FULL);
    });
    context.fillStyle = there ? colours.pellet : colours.eaten;
    context.fill();
  }
}

// A policy's scores: the better, the farther the ring closes.
function scores(context, view, scene, frame, colours) {
  const finite = frame.scores.filter(Number.isFinite);
  if (!finite.length) return;
  const low = Math.min(...finite);
  const span = Math.max(...finite) - low || 1;
  const radius = mark(view, 0.2, 8, 30);
  context.lineWidth = 2.4;
  context.lineCap = "round";
  frame.scores.forEach((score, k) => {
    const place = scene.candidates?.[k];
    if (!place || !Number.isFinite(score) || k === frame.goal) return;
    const [x, y] = view.toScreen(...place);
    const share = 0.06 + 0.94 * ((score - low) / span);
    context.strokeStyle = colours.score;
    context.globalAlpha = 0.16;
    context.beginPath();
    context.arc(x, y, radius, 0, FULL);
    context.stroke();
    context.globalAlpha = 0.35 + 0.6 * share;
    context.beginPath();
    context.arc(x, y, radius, -Math.PI / 2, -Math.PI / 2 + FULL * share);
    context.stroke();
  });
  context.globalAlpha = 1;
  context.lineCap = "butt";
}

function line(context, view, points, colour, width, alpha, dash = []) {
  context.beginPath();
  points.forEach((point, k) => {
    const [x, y] = view.toScreen(...point);
    if (k && point[2] !== "gap") context.lineTo(x, y);
    else context.moveTo(x, y);
  });
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.lineJoin = context.lineCap = "round";
  context.setLineDash(dash);
  context.globalAlpha = alpha;
  context.stroke();
  context.globalAlpha = 1;
  context.setLineDash([]);
  context.lineCap = "butt";
}

function goal(context, view, scene, frame, colours) {
  const place = frame.goal >= 0 ? scene.candidates?.[frame.goal] : null;
  if (!place) return;
  const [x, y] = view.toScreen(...place);
  const radius = mark(view, 0.2, 9, 30);
  circle(context, x, y, radius, colours.plan, 3);
  circle(context, x, y, radius + 4.5, colours.plan, 1.2);
}

function pointer(context, view, place, colours) {
  const [x, y] = view.toScreen(...place);
  circle(context, x, y, mark(view, 0.2, 9, 30) + 7, colours.goal, 2.5);
}

function lidar(context, view, scan, [x, y, heading], colours) {
  context.fillStyle = colours.lidar;
  const step = FULL / scan.length;
  for (let k = 0; k < scan.length; k++) {
    if (scan[k] <= 0) continue;
    const angle = heading + k * step;
    const [px, py] = view.toScreen(x + scan[k] * Math.cos(angle), y + scan[k] * Math.sin(angle));
    context.fillRect(px - 1.3, py - 1.3, 2.6, 2.6);
  }
}

function pacman(context, [x, y], heading, radius, colour, rim, mouth) {
  const half = 0.12 + 0.52 * mouth;
  context.beginPath();
  context.moveTo(x - 0.2 * radius * Math.cos(heading), y + 0.2 * radius * Math.sin(heading));
  context.arc(x, y, radius, -heading + half, -heading - half + FULL);
  context.closePath();
  context.fillStyle = colour;
  context.fill();
  context.strokeStyle = rim;
  context.lineWidth = 1.5;
  context.lineJoin = "round";
  context.stroke();
}

function believed(context, view, [wx, wy, heading], radius, colours) {
  const [x, y] = view.toScreen(wx, wy);
  circle(context, x, y, radius, colours.believed, 1.8);
  context.beginPath();
  context.moveTo(x + radius * Math.cos(heading), y - radius * Math.sin(heading));
  context.lineTo(x + 1.6 * radius * Math.cos(heading), y - 1.6 * radius * Math.sin(heading));
  context.stroke();
}

function ghost(context, view, place, facts, layers, colours, mine) {
  if (!Number.isFinite(place[0])) return;
  const [x, y] = view.toScreen(...place);
  const colour = facts.colour ? css(facts.colour) : colours.home;
  const size = mark(view, 0.16, 9, 44);
  if (layers.catch && facts.catch_m) {
    const radius = facts.catch_m * view.scale;
    context.beginPath();
    context.arc(x, y, radius, 0, FULL);
    context.fillStyle = colour;
    context.globalAlpha = 0.13;
    context.fill();
    context.globalAlpha = 1;
    circle(context, x, y, radius, colour, 1.5, [4, 4]);
  }
  context.beginPath();
  context.arc(x, y - 0.15 * size, size, Math.PI, 0);
  context.lineTo(x + size, y + 0.95 * size);
  for (let k = 0; k < 3; k++) {
    const right = x + size - (2 * size * k) / 3;
    context.lineTo(right - size / 3, y + 0.68 * size);
    context.lineTo(right - (2 * size) / 3, y + 0.95 * size);
  }
  context.closePath();
  context.fillStyle = colour;
  context.fill();
  context.strokeStyle = mine ? colours.goal : colours.ghost;
  context.lineWidth = mine ? 3 : 1.2;
  context.stroke();
  for (const side of [-1, 1]) {
    const eye = x + side * 0.4 * size;
    context.beginPath();
    context.arc(eye, y - 0.2 * size, 0.27 * size, 0, FULL);
    context.fillStyle = "#fff";
    context.fill();
    context.beginPath();
    context.arc(eye, y - 0.16 * size, 0.13 * size, 0, FULL);
    context.fillStyle = "#14203c";
    context.fill();
  }
  if (layers.names) words(context, facts.name ?? "", [x, y], size + 14, colours);
}

function words(context, text, [x, y], below, colours) {
  context.font = "600 12px system-ui, sans-serif";
  context.textAlign = "center";
  context.lineWidth = 3.5;
  context.lineJoin = "round";
  context.strokeStyle = colours.halo;
  context.strokeText(text, x, y + below);
  context.fillStyle = colours.ink;
  context.fillText(text, x, y + below);
}

function stopped(context, [x, y], radius) {
  const size = radius + 9;
  context.beginPath();
  for (let k = 0; k < 8; k++) {
    const angle = Math.PI / 8 + (k * Math.PI) / 4;
    context.lineTo(x + size * Math.cos(angle), y + size * Math.sin(angle));
  }
  context.closePath();
  context.strokeStyle = "#e02434";
  context.lineWidth = 4;
  context.stroke();
}

function crosshair(context, [x, y], colours) {
  circle(context, x, y, 12, colours.goal, 2);
  context.beginPath();
  for (const [dx, dy] of [[1, 0], [-1, 0], [0, 1], [0, -1]]) {
    context.moveTo(x + 6 * dx, y + 6 * dy);
    context.lineTo(x + 18 * dx, y + 18 * dy);
  }
  context.stroke();
}
