// The game of the page without a server: rounds of one person, with the messages of docs/dev/web_protocol.md.

import { Engine, gunzip, unpack } from "./engine.js";
import { FOLLOW, Round } from "./round.js";

const SHOW_S = { starting: 2, dying: 6, complete: 6, returning_home: 6 }; // simulated time
const AT_ONCE = ["stop", "release", "watch", "why", "stories", "story", "ping"]; // others wait for files and setups
const DEAD_MAN_MS = 500;
const KEPT = 10; // finished rounds
const SLICE = 8; // ticks after which messages are handled while a round is played as fast as possible

const isWhole = (value, least, end) => Number.isInteger(value) && value >= least && value < end;
const ghostOf = (role) => (role.startsWith("ghost-") ? Number(role.slice(6)) : null);
const fileOf = ({ map, level }) => (map === "generated" ? `${map}-${level}` : map);
const newSeed = () => crypto.getRandomValues(new Uint32Array(1))[0];

function demand(condition, words) {
  if (!condition) throw new Error(words);
}

// Whether orders of people (pacman_env/web/orders.py) fit a map and its ghosts.
function fits({ placed, orders }, { numbers, cells }, count) {
  const isGhost = (k) => isWhole(Number(k), 0, count);
  return Object.entries(placed).every(([k, place]) => isGhost(k) && place.every(Number.isFinite))
    && orders.every(([tick, { goal = 0, velocity = [0, 0], ghosts = {} }]) => (
      isWhole(tick, 0, Infinity) && isWhole(goal, 0, numbers.length)
      && velocity.length === 2 && velocity.every(Number.isFinite)
      && Object.entries(ghosts).every(([k, cell]) => isGhost(k) && isWhole(cell ?? FOLLOW, FOLLOW, cells))));
}

// The frame between two ticks: what a tick decides changes at its start, what it reaches at its end.
function between(old, now, share) {
  if (share >= 1) return now;
  const turn = (angle) => Math.atan2(Math.sin(angle), Math.cos(angle));
  const mix = (from, to) => from.map((one, k) => one + share * (k < 2 ? to[k] - one : turn(to[k] - one)));
  const { goal, scores, plan, velocity } = now;
  const [time_s] = mix([old.time_s], [now.time_s]);
  const [real, believed] = ["true", "believed"].map((name) => mix(old[name], now[name]));
  const ghosts = old.ghosts.map((ghost, k) => mix(ghost, now.ghosts[k]));
  return { ...old, goal, scores, plan, velocity, time_s, ghosts, true: real, believed };
}

export class Match {
  state = "menu";
  round = null; // null until the files of the game have arrived
  #options = { speed: 1, paused: false, stopped: false };
  #share = 1; // of the last tick that is over
  #left_s = 0; // of the present show
  #now = 0; // time of the last advance, ms
  #shown = null; // frames before and after the last tick
  #sent = ""; // the last frame
  #count = { frame: 0, news: 0, story: 0, revision: 0 };
  #soundEnds = 0; // ms
  #role = "none";
  #goal = null; // the robot's candidate, a ghost's cell or FOLLOW
  #hand = null; // velocity by hand, and its time
  #why = false;
  #stories = []; // finished rounds, the last one first
  #turn = Promise.resolve(); // of requests that change the game
  #asideTurn = Promise.resolve(); // of rounds on the second engine
  #aside = null; // the second engine
  #parts = null; // the module and the network, of all engines

  // Shows the first round as it was recorded, and loads the game meanwhile. `host` is what the worker provides.
  async begin(host) {
    this.host = host;
    const text = (bytes) => JSON.parse(new TextDecoder().decode(bytes));
    this.hello = text(await this.host.read("hello.json"));
    const { setup, scene, frames } = text(await gunzip(await this.host.read("first.json.gz")));
    this.setup = { level: null, ...setup, power: Number(setup.settings["power.pellets"]) > 0 };
    this.rules = new URLSearchParams(scene.link);
    this.#post("hello", this.hello);
    this.#showRole();
    this.#show(scene, frames[0]);
    this.demo = { frames, entry: this.scene };
    await this.receive('{"do":"ready"}');
  }

  receive(text) {
    const message = JSON.parse(text);
    const answer = () => this.#answer(message);
    return AT_ONCE.includes(message.do) ? answer() : (this.#turn = this.#turn.then(answer, answer));
  }

  async #answer({ do: what, id, ...message }) {
    let [words, data] = ["", null];
    try {
      demand(Object.hasOwn(this.#requests, what), `${what}: not without a server`);
      if (!AT_ONCE.includes(what)) this.round ??= new Round(await this.#engine(this.setup), this.setup);
      data = await this.#requests[what](message);
    } catch (error) {
      words = error.message;
    }
    if (id) this.#post("answer", { id, ok: !words, words, data });
    else if (words) this.#post("refused", { words });
  }

  // Lets time pass, and sends the frame if it has changed.
  advance() {
    const { paused, stopped, speed } = this.#options;
    const passed_s = paused || stopped ? 0 : (speed * (this.host.now() - this.#now)) / 1000;
    this.#now = this.host.now();
    if (!this.#shown) return;
    this.#left_s -= passed_s;
    this.#share += passed_s / (this.round?.engine.facts.tick_s ?? 1);
    const isOver = SHOW_S[this.state] && this.#left_s <= 0;
    if (this.state === "running" && passed_s && this.#share >= 1) this.#tick();
    else if (isOver && this.state === "starting") this.#enter("running");
    else if (isOver) this.#layOut();
    const shown = between(...this.#shown, this.#share);
    const text = JSON.stringify({
      ...shown, ...this.#options, state: this.state, revision: this.#count.revision,
      velocity: this.state === "running" && passed_s ? shown.velocity : [0, 0],
      ghost_goals: this.round?.ghostGoals(shown.true, this.#orders().ghosts) ?? shown.ghost_goals,
      ...(this.state === "starting" ? { begins_in_s: Math.max(0, Math.round(100 * this.#left_s) / 100) } : {}),
    });
    if (text !== this.#sent) this.host.post(`${text.slice(0, -1)},"number":${++this.#count.frame}}`);
    this.#sent = text;
  }

  #enter(state) {
    this.#left_s = SHOW_S[state];
    this.#add({ state: (this.state = state) });
  }

  #tick() {
    const { round, round: { engine: { facts } } } = this;
    const before = round.snapshots.at(-1);
    round.step(this.#orders());
    const now = round.snapshots.at(-1);
    this.#shown = [before, now];
    this.#share %= 1; // late ticks are skipped
    const name = (ghost) => this.hello.roles[`ghost-${ghost}`].name.toLowerCase();
    const pellets = [...before.alive.keys()].filter((pellet) => before.alive[pellet] && !now.alive[pellet]);
    for (const one of pellets) this.#report(round.power && facts.power.includes(one) ? "power pellet" : "pellet");
    for (const ghost of round.caught?.fresh ?? []) this.#report(`${name(ghost)} caught`);
    if (this.#why) this.#add({ why: round.why() });
    if (!round.over) return;
    this.#record(round);
    if (round.result === "caught") this.#report(`${name(round.catcher)} killed`);
    if (round.result === "complete") this.#report("win");
    this.#enter({ caught: "dying", complete: "complete" }[round.result] ?? "returning_home");
  }

  // What the person orders in the next tick.
  #orders() {
    const ghost = ghostOf(this.#role);
    if (this.round?.played.includes(ghost)) return { ghosts: { [ghost]: this.#goal } };
    if (this.#role !== "robot") return {};
    const { velocity, time } = this.#hand ?? {};
    const driven = velocity && { velocity: this.#now - time < DEAD_MAN_MS ? velocity : [0, 0] };
    return { robot: true, ...(this.#goal === null ? {} : { goal: this.#goal }), ...driven };
  }

  #post(kind, message) {
    this.host.post(JSON.stringify({ ...message, kind }));
  }

  #add(item) {
    this.#post("news", { items: [{ number: ++this.#count.news, ...item }] });
  }

  // Notes an event; its sound replaces the present sound, unless it is a pellet's.
  #report(event) {
    const { events, sounds } = this.hello;
    const { sound } = events[event];
    this.#add({ event });
    if (sound === "pellet" && this.#now < this.#soundEnds) return;
    this.#soundEnds = this.#now + sounds[sound].reduce((sum, [, seconds]) => sum + 1000 * seconds, 0);
    this.#add({ sound });
  }

  #showRole() {
    const player = (role) => [role, role === this.#role ? this.hello.you : null];
    const roles = Object.fromEntries(Object.keys(this.hello.roles).map(player));
    this.#post("people", { viewers: 1, operator: null, away: false, asking: [], roles });
  }

  #show(scene, frame) {
    this.scene = { ...scene, revision: ++this.#count.revision };
    this.#shown = [frame, frame];
    this.#post("scene", this.scene);
  }

  #showRound() {
    const { round, setup: { map, level, ghosts, clyde_mps: speed, seed } } = this;
    const { power, ...facts } = round.engine.facts.scene;
    const link = new URLSearchParams(this.rules);
    for (const [name, value] of Object.entries({ map, ghosts, clyde: speed, seed })) link.set(name, value);
    if (level !== null) link.set("level", level);
    if (!round.power) link.set("set.power.pellets", 0);
    this.#show({
      ...facts, ...(round.power ? { power } : {}), seed, level, clyde_speed_mps: speed, link: String(link),
      map: { ...facts.map, url: `game/maps/${fileOf(this.setup)}.png` },
      ghosts: ghosts.map((behaviour, k) => ({ ...facts.ghosts[0], role: `ghost-${k}`, behaviour })),
    }, round.snapshots.at(-1));
  }

  // An engine with the map of a setup: the given one if it has this map.
  async #engine(setup, engine) {
    const file = fileOf(setup);
    if (engine?.file === file) return engine;
    const read = (path) => this.host.read(path).catch(({ message }) => {
      throw new Error(`${path} could not be loaded: ${message}`);
    });
    this.#parts ??= Promise.all([
      read("game.wasm.bin").then(gunzip).then((code) => WebAssembly.compile(code)), read("network.bin").then(unpack),
    ]).catch((error) => {
      this.#parts = null; // the next setup tries again
      throw error;
    });
    const [[module, network], map] = await Promise.all([this.#parts, read(`maps/${file}.bin`).then(unpack)]);
    return Object.assign(new Engine(module, network, map), { file });
  }

  // A round before its first tick, for the person and for the orders of people.
  #newRound(setup, engine, orders = []) {
    const sent = [ghostOf(this.#role), ...orders.flatMap(([, { ghosts = {} }]) => Object.keys(ghosts).map(Number))];
    return new Round(engine, setup, [...setup.ghosts.keys()].filter((k) => sent.includes(k)));
  }

  // Shows a round in the menu: the given one, or the next one.
  #layOut(setup = { ...this.setup, seed: newSeed() }, round = this.#newRound(setup, this.round.engine)) {
    Object.assign(this, { setup, round });
    [this.#goal, this.#hand] = [null, null];
    if (this.state !== "menu") this.#enter("menu");
    this.#showRound();
  }

  // Plays a round on the second engine, in slices so that messages are handled meanwhile. Returns what `take` returns.
  #playAside(take, setup, played, moves, ticks = Infinity, goesOn = () => true) {
    const turn = this.#asideTurn.then(async () => {
      this.#aside = await this.#engine(setup, this.#aside);
      const round = new Round(this.#aside, setup, played);
      do {
        round.replay(moves, Math.min(ticks, round.ticks + SLICE));
        await this.host.pause();
      } while (!round.over && round.ticks < ticks && goesOn());
      return take(round);
    });
    this.#asideTurn = turn.catch(() => null);
    return turn;
  }

  // Keeps a finished round. Returns its number.
  #record(round) {
    const { setup, engine: { facts }, snapshots: frames } = round;
    const { collected, spawned, ghosts_caught: caught } = frames.at(-1);
    const time_s = Math.round(100 * frames.at(-1).time_s) / 100;
    const goals = round.choices.map(([goal]) => goal);
    const decisions = [...goals.keys()].filter((tick) => goals[tick] !== goals[tick - 1]);
    const entry = {
      story: ++this.#count.story, result: round.result, seed: setup.seed, collected, spawned, time_s,
      ticks: round.ticks, parts: [], worse: round.worse, moves: round.moves, decisions,
      player: round.byPerson ? "person" : "policy",
      policies: ["ppo"], second: null, ghosts_played: round.played, catcher: round.catcher < 0 ? null : round.catcher,
      ghosts_caught: caught, map: setup.map, hash: facts.hash, configuration: facts.configuration,
      revision: this.scene.revision, link: this.scene.link,
    };
    this.#stories = [{ entry, goals, setup, frames }, ...this.#stories].slice(0, KEPT);
    this.#add({ story: entry.story, words: `${round.result}: ${collected} of ${spawned} pellets in ${time_s} s` });
    return entry.story;
  }

  #story(number) {
    const story = this.#stories.find(({ entry }) => entry.story === number);
    demand(story, `round ${number} is no longer stored`);
    return story;
  }

  // The present setup with the changes of a message.
  #changed({ map, level = null, ghosts, clyde_mps: speed, seed, settings, preset, policy }) {
    const { choices: { maps, levels, behaviours } } = this.hello;
    const setup = { ...this.setup, seed: seed ?? newSeed(), ...(map && { map, level }), ...(ghosts && { ghosts }) };
    setup.level = level ?? setup.level ?? (setup.map === "generated" ? setup.seed % levels : null);
    setup.clyde_mps = speed ?? setup.clyde_mps;
    if (settings) setup.power = Number(settings["power.pellets"] ?? 0) > 0;
    const fine = {
      map: maps.includes(setup.map),
      level: setup.map === "generated" ? isWhole(setup.level, 0, levels) : setup.level === null,
      ghosts: isWhole(setup.ghosts.length, 1, 5) && setup.ghosts.every((one) => behaviours.includes(one)),
      clyde_mps: setup.clyde_mps >= 0.05 && setup.clyde_mps <= 2,
      seed: isWhole(setup.seed, 0, 2 ** 53),
    };
    for (const name of Object.keys(fine)) demand(fine[name], `${name} = ${setup[name]}: cannot be played here`);
    const set = Object.entries(settings ?? {}).map(([name, value]) => [`set.${name}`, value]);
    for (const [name, value = this.rules.get(name)] of [["preset", preset], ["policy", policy], ...set]) {
      const own = this.rules.get(name);
      const same = own !== null && (value === own || Number(value) === Number(own));
      demand(same || (name === "set.power.pellets" && !setup.power), `${name} = ${value}: needs a server`);
    }
    return setup;
  }

  #requests = {
    ping() {},
    start: ({ same }) => {
      demand(!this.#options.stopped, "stopped: press Release first");
      demand(this.state === "menu" || this.round.over, "a round is in progress: press Reset to end it");
      if (same && this.#stories.length) this.#layOut({ ...this.setup, seed: this.#stories[0].entry.seed });
      else if (this.state !== "menu") this.#layOut();
      this.#report("start");
      this.#enter("starting");
    },
    reset: () => this.#layOut(),
    pause: ({ on }) => void (this.#options.paused = on),
    speed: ({ times }) => void (this.#options.speed = times),
    stop: () => void (this.#options.stopped = true),
    release: () => void (this.#options.stopped = false),
    setup: async ({ finish, moves: given, until = 0, ...message }) => {
      const setup = this.#changed(message);
      const moves = { placed: {}, orders: [], ...given };
      const engine = await this.#engine(setup, this.round.engine);
      demand(fits(moves, engine.facts, setup.ghosts.length), "moves: they are of another map, or of other ghosts");
      const round = this.#newRound(setup, engine, moves.orders);
      round.replay(moves, until);
      this.#layOut(setup, round);
      const record = (played) => ({ story: this.#record(played) });
      return finish ? this.#playAside(record, setup, round.played, moves) : null;
    },
    clyde_speed: ({ mps }) => {
      const setup = this.#changed({ clyde_mps: mps, seed: this.setup.seed });
      if (this.state === "menu") this.#layOut(setup);
      else this.setup = setup;
    },
    place_clyde: ({ x, y, ghost }) => {
      demand(this.state === "menu", "ghosts can be placed only in the menu: press Reset first");
      demand(isWhole(ghost, 0, this.setup.ghosts.length), `there is no ghost ${ghost}`);
      this.round.placeGhost(ghost, x, y);
      this.#showRound();
    },
    role: ({ role }) => {
      const ghost = ghostOf(role);
      demand(ghost === null || isWhole(ghost, 0, this.setup.ghosts.length), `${role}: there is no such ghost`);
      [this.#role, this.#goal, this.#hand] = [role, null, null];
      this.#showRole();
      if (this.state === "menu" && !this.round.ticks) this.#layOut(this.setup);
      return { words: ghost === null || this.round.played.includes(ghost) ? "" : "yours from the next round on" };
    },
    goal: ({ candidate, follow, x, y }) => {
      const { round, round: { hold, engine } } = this;
      const ghost = ghostOf(this.#role);
      demand(this.#role === "robot" || round.played.includes(ghost), "choose a role first, in the menu");
      demand(isWhole(candidate ?? 0, -1, hold + 1), `candidate ${candidate}: must be 0 to ${hold}`);
      const place = engine.facts.candidates[candidate] ?? [x, y];
      const nearest = () => (ghost === null ? candidate ?? round.nearest(x, y) : round.ghostCell(ghost, ...place));
      const goal = follow ? FOLLOW : candidate === -1 || candidate === hold ? undefined : nearest();
      demand(goal !== null, "no pellet or refuge within 1 m");
      [this.#goal, this.#hand] = [goal ?? null, null];
    },
    drive: ({ v, omega }) => void (this.#hand = { velocity: [v, omega], time: this.#now }),
    watch: ({ why }) => void (this.#why = why),
    stories: () => this.#stories.map(({ entry }) => entry),
    story: async ({ story }) => {
      const { frames, entry: { revision } } = story ? this.#story(story) : await this.#demo();
      return frames.map((frame) => ({ ...frame, revision }));
    },
    why: ({ story, tick }) => {
      const { entry: { moves, ticks, ghosts_played: played }, goals, setup } = this.#story(story);
      demand(isWhole(tick, 0, ticks + 1), `tick ${tick}: the round has ${ticks}`);
      return this.#playAside((round) => ({ ...round.why(), goal: goals[tick] ?? -1 }), setup, played, moves, tick);
    },
    ready: () => [{ name: "map", state: "ok", words: `${this.setup.map}: ${this.round.pellets} pellets` }],
  };

  // The prepared round as ppo plays it.
  async #demo() {
    const { setup, round, scene: { revision }, demo } = this;
    if (demo.entry.revision === revision) return demo;
    const isWanted = () => this.state === "menu" && this.scene.revision === revision;
    const frames = await this.#playAside((played) => played.over && played.snapshots, setup, [],
      { placed: round.moves.placed }, Infinity, isWanted);
    demand(frames, "another round is prepared");
    return (this.demo = { frames, entry: { revision } });
  }
}
