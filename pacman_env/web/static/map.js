// The live map: canvases, view, layers, when to draw, and its gestures, buttons and list of layers.

import { palette } from "./colours.js";
import { make, still } from "./dom.js";
import { Painter, drawBase, drawTop } from "./draw.js";
import { MapPicture, boundsOf } from "./picture.js";
import { robotPose } from "./state.js";
import { View, cardsOn, insetsOf, isCovered, setUpGestures } from "./view.js";

const LAYERS = {
  scores: "Scores as rings", plan: "Plan", trail: "Trail", believed: "Believed pose",
  catch: "Catch radius", names: "Names", lidar: "Lidar",
};
const TRAIL_M = 0.04;
const MOST_TRAIL = 3000;
const FINALE_MS = 1000; // length of the scene at the end of a round
const STILL_SHARE = 0.4; // of the scene that a page without motion shows
const NEAR_PX = 24; // between a click and what it means
const FARTHEST_M = 2.5; // beyond it, something was placed and did not move
const POSES = ["true", "believed", "baseline"];

const distance = (a, b) => Math.hypot(a[0] - b[0], a[1] - b[1]);

function between(from, to, share) {
  if (share >= 1 || !from || !to || Math.hypot(to[0] - from[0], to[1] - from[1]) > FARTHEST_M) return to;
  const turn = (a, b) => a + share * Math.atan2(Math.sin(b - a), Math.cos(b - a));
  const moved = [from[0] + share * (to[0] - from[0]), from[1] + share * (to[1] - from[1])];
  return to.length > 2 ? [...moved, turn(from[2], to[2])] : moved;
}

// Between two messages everything moves evenly from where it is shown to where the last message has it.
class Motion {
  #from = null;
  #since = 0;
  #wait = 60; // ms between messages, smoothed
  to = null;

  update(frame, now, jump) {
    jump ||= !this.to || frame.revision !== this.to.revision || frame.time_s < this.to.time_s;
    this.#from = jump ? null : this.at(now);
    this.#wait += 0.2 * (Math.min(250, Math.max(20, now - this.#since)) - this.#wait);
    this.#since = now;
    this.to = frame;
  }

  moving(now) {
    return this.#from !== null && now - this.#since < this.#wait;
  }

  at(now) {
    const { to } = this;
    if (!to) return { ghosts: [] };
    const share = this.moving(now) ? (now - this.#since) / this.#wait : 1;
    const poses = Object.fromEntries(POSES.map((name) => [name, between(this.#from?.[name], to[name], share)]));
    poses.ghosts = to.ghosts.map((ghost, k) => between(this.#from?.ghosts[k], ghost, share));
    poses.robot = robotPose(poses);
    return poses;
  }
}

export class GameMap {
  view = new View();
  layers = Object.fromEntries(Object.keys(LAYERS).map((name) => [name, name !== "lidar"]));
  cross = null; // the place chosen by keys
  #motion = new Motion();
  #picture = null;
  #baseChanged = true;
  #request = 0;
  #trail = [];
  #finale = null; // scene at the end of a round: {won, since}
  #driven = 0; // m, which opens and closes the mouth
  #base;
  #top;

  // `root` is the document or shadow root with the elements of the map, `address` gives the address of a picture, and
  // `failed` shows an error.
  constructor(root, state, { address = (url) => url, failed = () => {} } = {}) {
    Object.assign(this, { root, state, address, failed, element: root.getElementById("map") });
    this.#base = new Painter(root.getElementById("base"), this.view, { alpha: false });
    this.#top = new Painter(root.getElementById("top"), this.view);
    state.on("candidate role placing tab", () => this.redraw(false));
    state.on("theme", () => this.repaint());
    document.addEventListener("visibilitychange", () => this.redraw());
    const sizes = new ResizeObserver((changes) => { // also of an element that is shown or hidden
      if (changes.some(({ target }) => target === this.element)) this.#resize();
      this.#arrange();
    });
    for (const one of [this.element, ...this.element.querySelectorAll("[data-covers]")]) sizes.observe(one);
    this.#resize();
  }

  #resize() {
    const { clientWidth: width, clientHeight: height } = this.element;
    const ratio = Math.min(3, devicePixelRatio || 1);
    for (const { context } of [this.#base, this.#top]) {
      context.canvas.width = Math.round(width * ratio);
      context.canvas.height = Math.round(height * ratio);
      context.setTransform(ratio, 0, 0, ratio, 0, 0);
    }
    this.view.resize(width, height);
    this.redraw();
  }

  // Fits the map into what the cards leave free; a map that is not fitted moves only if a card covers the robot.
  #arrange() {
    const { view } = this;
    const cards = cardsOn(this.element);
    view.insets = insetsOf(cards, view.width, view.height);
    const { robot } = this.#motion.at(performance.now());
    if (view.fitted) view.fit();
    else if (robot && isCovered(view.toScreen(...robot), cards)) view.centre(...robot);
    this.redraw();
  }

  zoom(times) {
    this.view.zoom(times);
    this.redraw();
  }

  fit() {
    this.follow(false);
    this.view.fit();
  }

  follow(on) {
    this.view.following = on;
    this.root.getElementById("follow").setAttribute("aria-pressed", String(on));
    if (on && this.view.fitted) this.view.zoom(1.8);
    this.redraw();
  }

  pan(dx, dy) {
    this.follow(false);
    this.view.pan(dx, dy);
  }

  moveCross(dx, dy) {
    const [x, y] = this.cross ?? [this.view.x, this.view.y];
    const [right, up] = this.view.along(dx, dy);
    this.cross = [x + right, y + up];
    this.redraw(false);
  }

  hideCross() {
    this.cross = null;
    this.redraw(false);
  }

  repaint() {
    this.#picture?.paint(palette(this.root));
    this.redraw();
  }

  async showScene(scene) {
    const { map } = scene;
    const sameMap = this.#picture && this.#picture.map.name === map?.name;
    let loaded = map?.url === this.#picture?.map.url ? this.#picture : null;
    if (map && !loaded) {
      loaded = await MapPicture.load(map, this.address(map.url), palette(this.root)).catch(() => null);
      if (this.state.shownScene !== scene) return;
      if (!loaded) this.failed("The map image could not be loaded.");
    }
    this.#picture = loaded;
    const points = [...scene.pellets, ...(scene.home ? [scene.home] : [])];
    if (loaded) this.view.bounds = loaded.bounds;
    else if (points.length) this.view.bounds = boundsOf(points, 1);
    if (!sameMap || this.view.fitted) {
      this.view.fit();
      if (this.view.following) this.follow(true);
    }
    if (!sameMap) this.#trail = [];
    this.redraw();
  }

  // Moves to a frame of the game, or shows it at once; a finished round has its own trail.
  showFrame(frame, { jump = false, path = null } = {}) {
    if (jump || !this.#motion.to || frame.time_s < this.#motion.to.time_s) this.#trail = [];
    this.#motion.update(frame, performance.now(), jump);
    const pose = robotPose(frame);
    const step = pose && this.#trail.length ? distance(pose, this.#trail.at(-1)) : Infinity;
    if (path) this.#trail = path;
    else if (pose && !jump && step >= TRAIL_M) {
      if (step < 5) this.#driven += step;
      this.#trail.push(pose);
      if (this.#trail.length > MOST_TRAIL) this.#trail.splice(0, MOST_TRAIL / 10);
    }
    this.redraw(false);
  }

  // Shows for a second how a round has ended for the robot.
  showEnd(won) {
    this.#finale = { won, since: performance.now() };
    this.redraw(false);
  }

  // Whether a click at a place, m, can mean the robot.
  isRobotAt(place) {
    const pose = robotPose(this.state.frame);
    return pose && distance(pose, place) * this.view.scale < NEAR_PX;
  }

  // The number of the candidate near a point of the page, or -1.
  candidateAt(at) {
    const { shownScene: scene, shownFrame: frame } = this.state;
    let [best, least] = [-1, NEAR_PX];
    (scene?.candidates ?? []).forEach((place, k) => {
      if (!place || (k < (scene.first_refuge ?? Infinity) && frame && !frame.alive[k])) return;
      const away = distance(this.view.toScreen(...place), at);
      if (away < least) [best, least] = [k, away];
    });
    return best;
  }

  redraw(withBase = true) {
    this.#baseChanged ||= withBase;
    if (!this.#request && !document.hidden) this.#request = requestAnimationFrame(() => this.#draw());
  }

  #finaleAt(now) {
    const share = this.#finale ? (now - this.#finale.since) / FINALE_MS : 1;
    if (share >= 1) this.#finale = null;
    return this.#finale && { won: this.#finale.won, share: still.matches ? STILL_SHARE : share };
  }

  #draw() {
    this.#request = 0;
    const { state, view, layers } = this;
    const now = performance.now();
    const [poses, frame, trail] = [this.#motion.at(now), this.#motion.to, this.#trail];
    if (view.following && poses.robot && distance(view.toScreen(...poses.robot), view.middle) > 0.3) {
      view.centre(...poses.robot);
      this.#baseChanged = true;
    }
    const [scene, colours] = [state.shownScene, palette(this.root)];
    if (this.#baseChanged) drawBase(this.#base, { picture: this.#picture, scene, colours });
    this.#baseChanged = false;
    const ahead = poses.robot && trail.length ? Math.min(1, distance(poses.robot, trail.at(-1))) : 0;
    const pointing = state.placing || state.role.startsWith("ghost");
    drawTop(this.#top, {
      scene, frame, poses, trail, layers, colours, candidate: state.candidate,
      numbered: this.root.getElementById("panel-why").offsetParent, mine: state.story ? "none" : state.role,
      finale: this.#finaleAt(now), cross: pointing ? this.cross ?? state.stands : null,
      mouth: frame?.state === "running" ? 0.5 + 0.5 * Math.sin((this.#driven - ahead) * 22) : 0.75,
    });
    state.count.frames_drawn++;
    if (this.#motion.moving(now) || this.#finale) this.redraw(false);
  }
}

export function setUpMapControls(map) {
  const { element, layers, root, state, view } = map;
  const find = (id) => root.getElementById(id);
  const [top, list] = [find("top"), find("layers-list")];
  const openLayers = (open) => {
    list.hidden = !open;
    find("layers").setAttribute("aria-expanded", String(open));
  };

  setUpGestures(top, view, {
    changed: () => map.redraw(),
    panned: () => map.follow(false),
    tapped: (at) => {
      map.hideCross();
      state.emit("tap", { world: view.toWorld(...at), candidate: map.candidateAt(at) });
    },
    hovered: (at) => {
      const ghost = state.role.startsWith("ghost"); // which goes anywhere
      const candidate = at && !ghost ? map.candidateAt(at) : -1;
      top.classList.toggle("pointing", ghost || (candidate >= 0 && state.role === "robot"));
      if (candidate !== state.candidate) state.emit("candidate", (state.candidate = candidate));
    },
  });
  state.on("placing", () => top.classList.toggle("placing", Boolean(state.placing)));
  element.addEventListener("pointerdown", ({ target }) => target === top && openLayers(false));
  find("zoom-in").onclick = () => map.zoom(1.4);
  find("zoom-out").onclick = () => map.zoom(1 / 1.4);
  find("fit").onclick = () => map.fit();
  find("follow").onclick = () => map.follow(!view.following);
  find("layers").onclick = () => openLayers(list.hidden);
  list.append(...Object.entries(LAYERS).map(([name, text]) => make("label", { class: "switch" }, make("input", {
    type: "checkbox", checked: layers[name], id: `layer-${name}`,
    onchange: ({ target }) => {
      layers[name] = target.checked;
      state.emit("layers");
      map.redraw(false);
    },
  }), make("span", { text }))));
}
