// The live map: canvases, view, layers, and when to draw.

import { palette } from "./colours.js";
import { $, make } from "./dom.js";
import { drawBase, drawTop } from "./draw.js";
import { robotPose } from "./frame.js";
import { Motion } from "./motion.js";
import { loadPicture } from "./picture.js";
import { on, shown, shownScene, state, tell } from "./state.js";
import { View, setUpGestures } from "./view.js";

const LAYERS = [
  ["scores", "Scores as rings", true], ["plan", "Plan", true], ["trail", "Trail", true], ["believed", "Believed pose", true],
  ["catch", "Catch radius", true], ["names", "Names", true], ["lidar", "Lidar", false],
];
const TRAIL_M = 0.04;
const MOST_TRAIL = 3000;
const GRAB_PX = 24;

export const view = new View();
export const layers = Object.fromEntries(LAYERS.map(([name, , on_]) => [name, on_]));

export class GameMap {
  #base = $("base").getContext("2d", { alpha: false });
  #top = $("top").getContext("2d");
  #motion = new Motion();
  #pictures = new Map(); // by address
  #picture = null;
  #baseDirty = true;
  #topDirty = true;
  #request = 0;
  #trail = [];
  #walked = 0;
  #second = { since: 0, count: 0 };
  #cross = null;

  constructor({ token, count, actions }) {
    this.token = token;
    this.count = count;
    this.actions = actions; // tapped(world): what a click does
    setUpGestures($("top"), view, {
      changed: () => this.redraw(),
      panned: () => this.follow(false),
      tapped: (at) => {
        this.#cross = null;
        this.actions(view.toWorld(...at), this.nearest(at));
        this.redraw(false);
      },
      hovered: (at) => {
        const candidate = at ? this.nearest(at) : -1;
        $("top").classList.toggle("pointing", candidate >= 0 && state.role === "robot");
        if (candidate !== state.candidate) tell("candidate", (state.candidate = candidate));
      },
    });
    new ResizeObserver(() => this.#resize()).observe($("map"));
    document.addEventListener("visibilitychange", () => {
      if (document.hidden) {
        cancelAnimationFrame(this.#request);
        this.#request = 0;
      } else {
        this.#second = { since: performance.now(), count: 0 };
        this.redraw();
      }
    });
    $("zoom-in").addEventListener("click", () => this.zoom(1.4));
    $("zoom-out").addEventListener("click", () => this.zoom(1 / 1.4));
    $("fit").addEventListener("click", () => this.fit());
    $("follow").addEventListener("click", () => this.follow(!view.following));
    $("layers").addEventListener("click", () => this.#openLayers($("layers-list").hidden));
    $("layers-list").append(...LAYERS.map(([name, words]) => make("label", {}, make("input", {
      type: "checkbox", checked: layers[name], id: `layer-${name}`,
      onchange: ({ target }) => {
        layers[name] = target.checked;
        tell("layers");
        this.redraw();
      },
    }), make("span", { text: words }))));
    $("map").addEventListener("pointerdown", ({ target }) => {
      if (target === $("top")) this.#openLayers(false);
    });
    on("candidate role placing", () => this.redraw(false));
    this.#resize();
  }

  #openLayers(open) {
    $("layers-list").hidden = !open;
    $("layers").setAttribute("aria-expanded", String(open));
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = $("map");
    this.ratio = Math.min(3, devicePixelRatio || 1);
    for (const canvas of [$("base"), $("top")]) {
      canvas.width = Math.round(width * this.ratio);
      canvas.height = Math.round(height * this.ratio);
    }
    view.resize(width, height);
    this.redraw();
  }

  zoom(times) {
    view.zoom(times);
    this.redraw();
  }

  // So many pixels at the bottom are covered.
  cover(inset) {
    view.inset = inset;
    if (view.fitted) view.fit();
    this.redraw();
  }

  fit() {
    this.follow(false);
    view.fit();
    this.redraw();
  }

  follow(follow) {
    view.following = follow;
    $("follow").setAttribute("aria-pressed", String(follow));
    if (follow) {
      if (view.fitted) view.zoom(1.8);
      this.redraw();
    }
  }

  pan(dx, dy) {
    this.follow(false);
    view.pan(dx, dy);
    this.redraw();
  }

  // Where the keys point at; null: nowhere.
  get cross() {
    return this.#cross;
  }

  moveCross(dx, dy) {
    const from = this.#cross ?? [view.x, view.y];
    this.#cross = [from[0] + dx, from[1] + dy];
    this.redraw(false);
  }

  dropCross() {
    this.#cross = null;
    this.redraw(false);
  }

  repaint() {
    for (const picture of this.#pictures.values()) picture.drawn = null;
    this.#picture?.paint(palette());
    this.redraw();
  }

  // The scene that is shown has changed.
  async show(scene) {
    const address = scene?.map?.url ?? null;
    if (address && !this.#pictures.has(address)) {
      try {
        this.#pictures.set(address, await loadPicture(scene.map, this.token));
      } catch {
        if (shownScene() === scene) tell("notice", { words: "The map image could not be loaded." });
      }
      if (this.#pictures.size > 8) this.#pictures.delete(this.#pictures.keys().next().value);
      if (shownScene() !== scene) return;
    }
    const picture = this.#pictures.get(address) ?? null;
    const same = this.#picture && picture && this.#picture.map.name === picture.map.name;
    this.#picture = picture;
    if (picture && !picture.drawn) picture.paint(palette());
    if (scene) {
      const points = [...scene.pellets, ...(scene.home ? [scene.home] : [])];
      const [xs, ys] = [points.map(([x]) => x), points.map(([, y]) => y)];
      if (picture) view.bounds = picture.bounds;
      else if (points.length) view.bounds = [Math.min(...xs) - 1, Math.min(...ys) - 1, Math.max(...xs) + 1, Math.max(...ys) + 1];
      if (!same || view.fitted) {
        view.fit();
        if (view.following) this.follow(true);
      }
    }
    this.#trail = [];
    this.redraw();
  }

  // A frame to be shown: a new one of the game, or one of a finished round (then at once).
  take(frame, steady = false) {
    const before = this.#motion.to;
    this.#motion.take(frame, performance.now(), steady);
    if (steady || !before || frame.time_s < before.time_s) this.#trail = [];
    if (!steady) this.#leave(robotPose(frame));
    this.redraw(false);
  }

  setTrail(trail) {
    this.#trail = trail;
  }

  #leave(pose) {
    if (!pose) return;
    const last = this.#trail.at(-1);
    const step = last ? Math.hypot(pose[0] - last[0], pose[1] - last[1]) : Infinity;
    if (step < TRAIL_M) return;
    if (step < 5) this.#walked += step;
    this.#trail.push([pose[0], pose[1]]);
    if (this.#trail.length > MOST_TRAIL) this.#trail.splice(0, MOST_TRAIL / 10);
  }

  nearest([px, py]) {
    const scene = shownScene();
    const frame = shown();
    let [best, distance] = [-1, GRAB_PX];
    (scene?.candidates ?? []).forEach((place, k) => {
      if (!place || (k < (scene.first_refuge ?? Infinity) && frame && !frame.alive[k])) return;
      const [x, y] = view.toScreen(...place);
      const apart = Math.hypot(x - px, y - py);
      if (apart < distance) [best, distance] = [k, apart];
    });
    return best;
  }

  redraw(base = true) {
    this.#baseDirty ||= base;
    this.#topDirty = true;
    if (!this.#request && !document.hidden) this.#request = requestAnimationFrame((now) => this.#draw(now));
  }

  #draw() {
    this.#request = 0;
    const now = performance.now();
    const moving = this.#motion.moving(now);
    const poses = this.#motion.at(now) ?? { ghosts: [] };
    if (view.following && poses.robot && (moving || this.#baseDirty || this.#topDirty)) {
      const [x, y] = poses.robot;
      if (Math.hypot(x - view.x, y - view.y) * view.scale > 0.3) {
        [view.x, view.y] = [x, y];
        this.#baseDirty = true;
      }
    }
    if (this.#baseDirty) drawBase(this.#base, view, this.ratio, { picture: this.#picture, scene: shownScene(), colours: palette() });
    const frame = this.#motion.to;
    const open = frame && frame.state === "running" ? 0.5 + 0.5 * Math.sin((this.#walked + this.#onward(poses)) * 22) : 0.75;
    drawTop(this.#top, view, this.ratio, {
      scene: shownScene(), frame, poses, trail: this.#trail, layers, colours: palette(), candidate: state.candidate,
      mine: state.story ? "none" : state.role, cross: state.placing || state.role.startsWith("ghost") ? this.#cross : null, mouth: open,
    });
    this.#baseDirty = this.#topDirty = false;
    this.#tick(now);
    if (moving) this.redraw(false);
  }

  // How far the robot is from where the trail ends: the mouth moves with it.
  #onward({ robot }) {
    const last = this.#trail.at(-1);
    return robot && last ? -Math.min(1, Math.hypot(robot[0] - last[0], robot[1] - last[1])) : 0;
  }

  #tick(now) {
    this.count.frames_drawn++;
    this.#second.count++;
    const passed = now - this.#second.since;
    if (passed >= 1000) {
      this.count.frames_per_second = (1000 * this.#second.count) / passed;
      this.#second = { since: now, count: 0 };
    }
  }
}
