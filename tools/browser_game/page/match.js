// The game of the page without a server: the rounds of one person, with the messages of docs/dev/web_protocol.md.

import { Engine, gunzip, unpack } from "./engine.js";
import { FOLLOW, Round } from "./round.js";

const SHOW_S = { starting: 2, dying: 5, returning_home: 2 }; // how long these states last; the last one in real time
const IMPORTANCE = { "power pellet": 1, ghost: 1, start: 2, death: 3, win: 3 }; // of sounds; others never wait
const NEVER_WAIT = ["stop", "release", "watch", "why", "stories", "story", "ping"]; // for the game's files, or a setup
const NO_CONTROL = [...NEVER_WAIT.filter((what) => what !== "release"), "ready", "control", "role", "goal", "drive"];
const DEAD_MAN_MS = 500;
const WHY_MS = 250; // time between two messages with terms
const KEPT = 10; // finished rounds
const SLICE = 8; // ticks after which messages are handled while a round is played at once

const isNumber = (value, least, most) => typeof value === "number" && value >= least && value <= most;
const isWhole = (value, least, most) => Number.isInteger(value) && isNumber(value, least, most);
const isPlace = (x, y) => isNumber(x, -1e6, 1e6) && isNumber(y, -1e6, 1e6);
const ghostOf = (role) => (role.startsWith("ghost-") ? Number(role.slice(6)) : null);
const randomSeed = () => crypto.getRandomValues(new Uint32Array(1))[0];
const fileOf = ({ map, level }) => (map === "generated" ? `${map}-${level}` : map);
const ghostsIn = ({ orders = [] }) => orders.flatMap(([, { ghosts = {} }]) => Object.keys(ghosts).map(Number));

function demand(condition, words) {
  if (!condition) throw new Error(words);
}

// Whether recorded orders of people (pacman_env/web/orders.py) can be played on a map.
function fits({ placed = {}, orders = [] }, { numbers, cells }, count) {
  const isGhost = (k) => isWhole(Number(k), 0, count - 1);
  const isCell = (cell) => cell === null || isWhole(cell, FOLLOW, cells - 1);
  const isOrder = ([tick, { goal = 0, velocity = [0, 0], ghosts = {} }]) => (
    isWhole(tick, 0, Infinity) && isWhole(goal, 0, numbers.length - 1) && velocity.length === 2
    && velocity.every((one) => isNumber(one, -10, 10))
    && Object.entries(ghosts).every(([k, cell]) => isGhost(k) && isCell(cell)));
  try {
    return orders.every(isOrder) && Object.entries(placed).every(([k, [x, y]]) => isGhost(k) && isPlace(x, y));
  } catch {
    return false; // something has another type
  }
}

// The frame between two ticks: what a tick decides changes at its start, what it reaches at its end.
function between(old, now, share) {
  if (share >= 1) return now;
  const mix = (from, to) => from.map((value, k) => value + share * (to[k] - value));
  const pose = ([x, y, from], [toX, toY, to]) => (
    mix([x, y, from], [toX, toY, from + Math.atan2(Math.sin(to - from), Math.cos(to - from))]));
  const { goal, scores, plan, velocity } = now;
  return {
    ...old, goal, scores, plan, velocity, time_s: old.time_s + share * (now.time_s - old.time_s),
    true: pose(old.true, now.true), believed: pose(old.believed, now.believed),
    ghosts: old.ghosts.map((ghost, k) => mix(ghost, now.ghosts[k])),
  };
}

export class Match {
  state = "menu";
  round = null; // null until the files of the game have arrived
  #speed = 1;
  #paused = false;
  #stopped = false;
  #share = 1; // of the last tick that is over
  #left_s = 0; // of the present show
  #last = 0; // time of the last advance, ms
  #shown = null; // frames before and after the last tick
  #frame = "";
  #frames = 0;
  #revision = 0;
  #news = [];
  #newsCount = 0;
  #sounds = []; // the one that plays, and the one that waits
  #soundEnds = 0; // ms
  #operator = null;
  #role = "none";
  #goal = null; // the robot's candidate, a ghost's cell or FOLLOW
  #hand = null; // velocities by hand, and when they were sent
  #why = false;
  #whySent = 0;
  #kept = []; // finished rounds, the last one first
  #count = 0; // of all finished rounds
  #turn = Promise.resolve(); // of requests that change the game
  #asideTurn = this.#turn; // of rounds that are played at once
  #aside = null; // the engine for them
  #parts = null; // of all engines
  #map = { file: "" }; // loaded last

  // `host` has the functions read, post, now and pause of the worker.
  constructor(host) {
    this.host = host;
  }

  // Shows the first round as it was recorded, and loads the game meanwhile.
  async begin() {
    const text = (bytes) => JSON.parse(new TextDecoder().decode(bytes));
    try {
      this.hello = text(await this.host.read("hello.json"));
      const { setup, scene, frames } = text(await gunzip(await this.host.read("first.json.gz")));
      this.rules = new URLSearchParams(scene.link);
      this.setup = { level: null, ...setup, power: Number(setup.settings["power.pellets"]) > 0 };
      this.#post(this.hello);
      this.#sendPeople();
      this.#show(scene, frames[0]);
      this.demo = { revision: this.#revision, frames };
      await (this.#turn = this.#prepare());
    } catch ({ message }) {
      this.#post({ kind: "refused", words: message });
    }
  }

  receive(text) {
    const message = JSON.parse(text);
    if (NEVER_WAIT.includes(message.do)) return this.#answer(message);
    return (this.#turn = this.#turn.then(() => this.#answer(message), () => this.#answer(message)));
  }

  // Lets time pass and sends what has changed.
  advance() {
    const now = this.host.now();
    const passed_s = (now - this.#last) / 1000;
    this.#last = now;
    if (!this.#shown) return;
    if (now >= this.#soundEnds && this.#sounds.length) this.#playSound(this.#sounds[1]);
    if (!this.#held && this.state !== "menu") this.#pass(passed_s);
    if (this.#news.length) this.#post({ kind: "news", items: this.#news.splice(0) });
    this.#sendFrame();
  }

  get #held() { return this.#paused || this.#stopped; }

  #pass(passed_s) {
    this.#share += (passed_s * this.#speed) / this.round.engine.facts.tick_s;
    this.#left_s -= passed_s * (this.state === "returning_home" ? 1 : this.#speed);
    if (this.state === "running") {
      if (this.#share >= 1) this.#tick();
    } else if (this.#left_s <= 0) {
      if (this.state === "starting") this.#enter("running");
      else if (this.state === "returning_home") this.#layOut({ ...this.setup, seed: randomSeed() });
      else this.#enter("returning_home");
    }
  }

  #enter(state) {
    if (state === "running") this.#share = 1; // the first tick is due
    this.#left_s = SHOW_S[state] ?? 0;
    this.#add({ state: (this.state = state) });
  }

  #tick() {
    const { round } = this;
    const before = round.snapshots.at(-1);
    round.step(this.#orders());
    const now = round.snapshots.at(-1);
    this.#shown = [before, now];
    this.#share = Math.min(this.#share - 1, 1); // late ticks are skipped
    const name = (ghost) => this.hello.roles[`ghost-${ghost}`].name.toLowerCase();
    const { power } = round.engine.facts;
    before.alive.forEach((was, pellet) => was && !now.alive[pellet]
      && this.#report(round.power && power.includes(pellet) ? "power pellet" : "pellet"));
    for (const ghost of round.caught?.fresh ?? []) this.#report(`${name(ghost)} caught`);
    if (this.#why && this.#last - this.#whySent >= WHY_MS) {
      this.#whySent = this.#last;
      this.#add({ why: round.why() });
    }
    if (!round.over) return;
    this.#record(round);
    if (round.result === "caught") this.#report(`${name(round.catcher)} killed`);
    if (round.result === "complete") this.#report("win");
    this.#enter({ caught: "dying", complete: "complete" }[round.result] ?? "returning_home");
  }

  // What the person orders in the next tick.
  #orders() {
    const [goal, ghosts] = [this.#goal, this.#sent()];
    if (this.#role !== "robot") return Object.keys(ghosts).length ? { ghosts } : {};
    const { velocity, sent } = this.#hand ?? {};
    const driven = velocity && { velocity: this.#last - sent < DEAD_MAN_MS ? velocity : [0, 0] };
    return { robot: true, ...(goal === null ? {} : { goal }), ...driven };
  }

  // Where the person sends a ghost, by its number.
  #sent() {
    const ghost = ghostOf(this.#role);
    return this.round.played.includes(ghost) ? { [ghost]: this.#goal } : {};
  }

  #add(item) {
    this.#news.push({ number: ++this.#newsCount, ...item });
  }

  // Notes an event, and plays its sound by the rules of pacman_env/game/sounds.py.
  #report(event) {
    this.#add({ event });
    const { sound } = this.hello.events[event];
    const [playing, waiting] = this.#sounds;
    const rank = (word) => IMPORTANCE[word] ?? 0;
    if (!playing) this.#playSound(sound);
    else if (sound !== playing && rank(sound) >= (waiting ? rank(waiting) : 1)) this.#sounds = [playing, sound];
  }

  #playSound(word) {
    this.#sounds = word ? [word] : [];
    if (!word) return;
    this.#soundEnds = this.#last + this.hello.sounds[word].reduce((sum, [, seconds]) => sum + 1000 * seconds, 0);
    this.#add({ sound: word });
  }

  #post(message) {
    this.host.post(JSON.stringify(message));
  }

  #sendPeople() {
    const roles = Object.fromEntries(Object.keys(this.hello.roles).map((role) => [role, role === this.#role ? this.hello.you : null]));
    this.#post({ kind: "people", viewers: 1, operator: this.#operator, away: false, asking: [], roles });
  }

  #sendFrame() {
    const shown = between(...this.#shown, this.#share);
    const moves = this.state === "running" && !this.#held;
    const text = JSON.stringify({
      ...shown, state: this.state, revision: this.#revision, speed: this.#speed, paused: this.#paused, stopped: this.#stopped,
      velocity: moves ? shown.velocity : [0, 0],
      ghost_goals: this.round?.ghostGoals(shown.true, this.#sent()) ?? shown.ghost_goals,
      ...(this.state === "starting" ? { begins_in_s: Math.max(0, Math.round(100 * this.#left_s) / 100) } : {}),
    });
    if (text !== this.#frame) this.host.post(`${text.slice(0, -1)},"number":${++this.#frames}}`);
    this.#frame = text;
  }

  // Shows a prepared round by its scene and its last frame.
  #show(scene, frame) {
    this.scene = { ...scene, kind: "scene", revision: ++this.#revision };
    this.#shown = [frame, frame];
    this.#post(this.scene);
  }

  #showRound() {
    const { round, setup: { map, level, ghosts, clyde_mps: speed, seed } } = this;
    const { power, ...facts } = round.engine.facts.scene;
    const link = new URLSearchParams(this.rules);
    const fields = { map, level, ghosts, clyde: speed, seed, ...(round.power ? {} : { "set.power.pellets": 0 }) };
    for (const [name, value] of Object.entries(fields)) value === null ? link.delete(name) : link.set(name, value);
    this.#show({
      ...facts, ...(round.power ? { power } : {}), seed, level, clyde_speed_mps: speed, link: String(link),
      map: { ...facts.map, url: `game/maps/${fileOf(this.setup)}.png` },
      ghosts: ghosts.map((behaviour, k) => ({ ...facts.ghosts[0], role: `ghost-${k}`, behaviour })),
    }, round.snapshots.at(-1));
  }

  // Loads the game and a map, unless `engine` has this map already.
  async #engine(setup, engine) {
    const file = fileOf(setup);
    if (engine?.file === file) return engine;
    const read = (path) => this.host.read(path).catch(({ message }) => {
      throw new Error(`The map ${file} could not be loaded: ${message}.`);
    });
    const parts = () => Promise.all([
      read("game.wasm.bin").then(gunzip).then((code) => WebAssembly.compile(code)), read("network.bin").then(unpack)]);
    const map = () => read(`maps/${file}.bin`).then(unpack);
    const loaded = [this.#parts ?? parts(), this.#map.file === file ? this.#map.map : map()];
    [this.#parts, this.#map] = await Promise.all(loaded).then(([code, unpacked]) => [code, { file, map: unpacked }]);
    return Object.assign(new Engine(...this.#parts, this.#map.map), { file });
  }

  async #prepare() {
    if (!this.round) this.round = new Round(await this.#engine(this.setup), this.setup);
  }

  // Prepares a round in the menu; the first ticks are played with orders of people.
  #newRound(setup, engine, moves = {}) {
    const own = [ghostOf(this.#role), ...ghostsIn(moves)].filter((k) => k !== null && k < setup.ghosts.length);
    return new Round(engine, setup, [...new Set(own)].sort());
  }

  #layOut(setup, round = this.#newRound(setup, this.round.engine)) {
    Object.assign(this, { setup, round });
    [this.#goal, this.#hand] = [null, null];
    if (this.state !== "menu") this.#enter("menu");
    this.#showRound();
  }

  // Plays a round on with recorded orders, in slices so that messages are handled meanwhile.
  async #play(round, moves, ticks = Infinity, goesOn = () => true) {
    do {
      round.replay(moves, Math.min(ticks, round.ticks + SLICE));
      await this.host.pause();
    } while (!round.over && round.ticks < ticks && goesOn());
    return round;
  }

  // The same on an engine of its own, one round after the other; returns what `take` takes from the round.
  #playAside(take, setup, moves, played, ...limits) {
    const turn = this.#asideTurn.then(async () => {
      this.#aside = await this.#engine(setup, this.#aside);
      return take(await this.#play(new Round(this.#aside, setup, played), moves, ...limits));
    });
    this.#asideTurn = turn.catch(() => null);
    return turn;
  }

  #record(round) {
    const { facts } = round.engine;
    const { placed, orders } = round.moves;
    const { collected, spawned, time_s: time, ghosts_caught: caught } = round.snapshots.at(-1);
    const goals = round.choices.map(([goal]) => goal);
    const time_s = Math.round(100 * time) / 100;
    const entry = {
      story: ++this.#count, result: round.result, seed: round.seed, collected, spawned, time_s, ticks: round.ticks, parts: [],
      worse: round.worse, decisions: [...goals.keys()].filter((tick) => goals[tick] !== goals[tick - 1]),
      moves: { ...(Object.keys(placed).length ? { placed } : {}), ...(orders.length ? { orders } : {}) },
      player: round.byPerson ? "person" : "policy", policies: ["ppo"], second: null, ghosts_played: round.played,
      catcher: round.catcher < 0 ? null : round.catcher, map: this.setup.map, hash: facts.hash,
      configuration: facts.configuration, revision: this.#revision, link: this.scene.link, ghosts_caught: caught,
    };
    this.#kept = [{ entry, goals, setup: this.setup, frames: round.snapshots }, ...this.#kept].slice(0, KEPT);
    this.#add({ story: this.#count, words: `${round.result}: ${collected} of ${spawned} pellets in ${time_s} s` });
    return this.#count;
  }

  #storyOf(number) {
    const story = this.#kept.find(({ entry }) => entry.story === number);
    demand(story, `round ${number} is no longer stored`);
    return story;
  }

  // The present setup with the changes of a message.
  #changed({ map, level, ghosts, clyde_mps, seed = randomSeed(), settings, preset, policy }) {
    const { maps, levels, behaviours } = this.hello.choices;
    const given = Object.fromEntries(Object.entries({ map, level, ghosts, clyde_mps }).filter(([, value]) => value != null));
    const setup = { ...this.setup, ...(map && { level: null }), ...given, seed };
    demand(isWhole(seed, 0, Number.MAX_SAFE_INTEGER), `seed ${seed}: must be a whole number from 0 on`);
    demand(maps.includes(setup.map), `map ${setup.map}: must be one of ${maps.join(", ")}`);
    if (setup.map === "generated") setup.level ??= seed % levels;
    demand(setup.map !== "generated" || isWhole(setup.level, 0, levels - 1), `level ${setup.level}: must be 0 to ${levels - 1}`);
    demand(setup.map === "generated" || setup.level === null, `level ${setup.level}: map ${setup.map} has none`);
    demand(Array.isArray(setup.ghosts) && isWhole(setup.ghosts.length, 1, 4), "ghosts: must be 1 to 4");
    for (const one of setup.ghosts) demand(behaviours.includes(one), `ghost ${one}: must be one of ${behaviours.join(", ")}`);
    demand(isNumber(setup.clyde_mps, 0.05, 2), `clyde_mps ${setup.clyde_mps}: must be 0.05 to 2`);
    const fixed = Object.entries(settings ?? {}).map(([name, value]) => [`set.${name}`, value]);
    for (const [name, value] of [["preset", preset], ["policy", policy], ...fixed]) {
      const own = this.rules.get(name);
      const same = value == null || String(value) === own || (own !== null && Number(value) === Number(own));
      demand(same || (name === "set.power.pellets" && Number(value) === 0), `${name} ${value}: must be ${own} without a server`);
    }
    if (settings) setup.power = Number(settings["power.pellets"] ?? 0) > 0;
    return setup;
  }

  #requests = {
    ping: () => null,
    start: ({ same }) => {
      demand(!this.#stopped, "stopped: press Release first");
      demand(this.state === "menu" || this.round.over, "a round is in progress: press Reset to end it");
      if (same && this.#kept.length) this.#layOut({ ...this.setup, seed: this.#kept[0].entry.seed });
      else if (this.state !== "menu") this.#layOut({ ...this.setup, seed: randomSeed() });
      this.#report("start");
      this.#enter("starting");
    },
    reset: () => this.#layOut({ ...this.setup, seed: randomSeed() }),
    pause: ({ on }) => { this.#paused = Boolean(on); },
    speed: ({ times }) => {
      const { speeds } = this.hello.choices;
      demand(speeds.includes(times), `speed ${times}: must be one of ${speeds.join(", ")}`);
      this.#speed = times;
    },
    setup: async ({ finish, moves = {}, until = 0, ...message }) => {
      const setup = this.#changed(message);
      const engine = await this.#engine(setup, this.round.engine);
      demand(fits(moves, engine.facts, setup.ghosts.length), "moves: the map or the ghosts are others than in these orders");
      demand(isWhole(until, 0, Number.MAX_SAFE_INTEGER), `until ${until}: must be a whole number from 0 on`);
      if (this.state !== "menu") this.#enter("menu"); // the present round ends, its engine may be needed
      const round = this.#newRound(setup, engine, moves);
      this.#layOut(setup, await this.#play(round, moves, until));
      if (!finish) return null;
      const record = (played) => this.#record(played);
      return { story: await this.#playAside(record, setup, moves, round.played) };
    },
    clyde_speed: ({ mps }) => {
      const setup = this.#changed({ clyde_mps: mps, seed: this.setup.seed });
      if (this.state === "menu") this.#layOut(setup);
      else this.setup = setup;
    },
    place_clyde: ({ x, y, ghost = 0 }) => {
      demand(this.state === "menu", "ghosts can be placed only in the menu: press Reset first");
      demand(isWhole(ghost, 0, this.setup.ghosts.length - 1), `there is no ghost ${ghost}`);
      demand(isPlace(x, y), "x and y: must be a place on the map");
      this.round.placeGhost(ghost, x, y);
      this.#showRound();
    },
    role: ({ role }) => {
      const known = ["robot", "none", ...this.setup.ghosts.map((_, k) => `ghost-${k}`)];
      demand(known.includes(role), `${role}: there are ${this.setup.ghosts.length} ghosts`);
      [this.#role, this.#goal, this.#hand] = [role, null, null];
      this.#sendPeople();
      if (this.state === "menu" && !this.round.ticks) this.#layOut(this.setup);
      const waits = ghostOf(role) !== null && !this.round.played.includes(ghostOf(role));
      return { words: waits ? "yours from the next round on" : "" };
    },
    goal: ({ candidate = null, follow, x, y }) => {
      demand(this.#role !== "none", "choose a role in the tab Play first");
      const { round, round: { hold } } = this;
      const ghost = ghostOf(this.#role);
      demand(candidate === null ? follow || isPlace(x, y) : isWhole(candidate, -1, hold),
        candidate === null ? "goal: give a candidate, or x and y" : `candidate ${candidate}: must be 0 to ${hold}`);
      demand(ghost === null || round.played.includes(ghost), "the ghost is yours from the next round on");
      const place = round.engine.facts.candidates[candidate] ?? [x, y];
      if (candidate === -1 || candidate === hold) this.#goal = null;
      else if (ghost !== null) this.#goal = follow ? FOLLOW : round.ghostCell(ghost, ...place);
      else {
        const nearest = candidate ?? round.nearest(x, y);
        demand(nearest !== null, "no pellet or refuge within 1 m");
        [this.#goal, this.#hand] = [nearest, null];
      }
    },
    drive: ({ v, omega }) => {
      demand(this.#role === "robot", "choose the robot's role in the tab Play first");
      demand(isNumber(v, -10, 10) && isNumber(omega, -10, 10), "v and omega: must be -10 to 10");
      this.#hand = { velocity: [v, omega], sent: this.host.now() };
    },
    stop: () => this.#stop(true),
    release: () => this.#stop(false),
    control: ({ what }) => {
      this.#operator = what === "give" ? null : this.hello.you;
      this.#sendPeople();
    },
    watch: ({ why }) => { this.#why = Boolean(why); },
    stories: () => this.#kept.map(({ entry }) => entry),
    story: async ({ story }) => {
      if (!story) return this.#demo();
      const { entry: { revision }, frames } = this.#storyOf(story);
      return frames.map((frame) => ({ ...frame, revision }));
    },
    why: ({ story, tick }) => {
      const { entry: { moves, ticks, ghosts_played: played }, goals, setup } = this.#storyOf(story);
      demand(isWhole(tick, 0, ticks), `tick ${tick}: the round has ${ticks}`);
      return this.#playAside((round) => ({ ...round.why(), goal: goals[tick] ?? -1 }), setup, moves, played, tick);
    },
    ready: () => [
      { name: "simulator", state: "ok", words: `pacman_env ${this.hello.version} in this browser`, remedy: "" },
      { name: "map", state: "ok", words: `${this.setup.map}: ${this.round.pellets} pellets`, remedy: "" },
    ],
  };

  #stop(stopped) {
    if (this.#stopped !== stopped) this.#add({ words: `${stopped ? "stopped" : "released"} by ${this.hello.you}` });
    [this.#stopped, this.#hand] = [stopped, null];
  }

  // The frames of the prepared round as ppo plays it.
  async #demo() {
    const revision = this.#revision;
    if (this.demo.revision !== revision) {
      const isPrepared = () => this.#revision === revision && this.state === "menu";
      const frames = await this.#playAside((round) => round.over && round.snapshots, this.setup,
        { placed: this.round.moves.placed }, [], Infinity, isPrepared);
      demand(frames && isPrepared(), "another round is prepared");
      this.demo = { revision, frames };
    }
    return this.demo.frames.map((frame) => ({ ...frame, revision, state: "menu" }));
  }

  async #answer({ do: what, id, ...message }) {
    let [words, data] = ["", null];
    try {
      demand(Object.hasOwn(this.#requests, what), `${what}: not without a server`);
      if (!NEVER_WAIT.includes(what)) await this.#prepare();
      if (!NO_CONTROL.includes(what) && !this.#operator) await this.#requests.control({});
      data = await this.#requests[what](message) ?? null;
    } catch (error) {
      words = error.message || "refused";
    }
    if (id) this.#post({ kind: "answer", id, ok: !words, words, data });
    else if (words) this.#post({ kind: "refused", words });
  }
}
