// One round of the game, tick by tick, by the planner or by people: as pacman_env/web/played_round.py plays it.

import { CaughtGhosts } from "./caught_ghosts.js";

export const FOLLOW = -1; // in place of a ghost's cell: follow the robot
const [AS_BEHAVIOUR, TO_CELL] = [2, 3]; // kinds of a ghost's choice (sim/ghost_state.py)
const NEAR_M = 1; // largest distance from a click to its candidate
const WORSE = 0.1; // a goal is worse if a catch within 10 s is more likely by at least this probability
const MOST_PLAN_POINTS = 64;

const KINDS = ["pellet", "refuge", "hold"];

const rounded = (value) => (Number.isFinite(value) ? Math.round(value * 1e4) / 1e4 : null);
const sameOrders = (one, other) => JSON.stringify(one) === JSON.stringify(other);

export class Round {
  ticks = 0;
  byPerson = false;
  moves = {}; // placed ghosts and orders, as pacman_env/web/orders.py has them
  worse = []; // ticks at which a person chose a more dangerous goal than the planner
  choices = []; // goal and the planner's choice, as page numbers, of each tick
  #sent = {};

  // `played` are the numbers of the ghosts that people may send.
  constructor(engine, setup, played = []) {
    const { seed, ghosts, clyde_mps: speed, power } = setup;
    Object.assign(this, { engine, setup, behaviours: ghosts, power, played });
    const { facts } = engine;
    engine.layOut(ghosts.length);
    this.pellets = facts.pellets;
    this.numbers = facts.numbers; // candidate by page number
    this.hold = this.numbers.length - 1;
    const powerful = engine.array("level", "power");
    powerful.fill(0);
    if (power) for (const pellet of facts.power) powerful[pellet] = 1;
    const rows = engine.array("ghosts", "behaviours");
    const wander = engine.array("begin_rounds", "wander_first");
    ghosts.forEach((name, k) => {
      const row = 2 * (ghosts.length + facts.behaviours.indexOf(name));
      wander[k] = name === "wander" || played.includes(k) ? 1 : 0;
      rows.set(wander[k] ? [played.includes(k) ? -1n : 0n, 0n] : rows.slice(row, row + 2), 2 * k);
    });
    engine.field("begin_rounds", "fresh", "episode_seed")[0] = BigInt(seed);
    engine.array("begin_rounds", "seeds")[0] = BigInt(seed);
    for (const name of ["base_clyde_speed", "clyde_speed"]) engine.field("begin_rounds", "fresh", name)[0] = speed;
    engine.call("begin_rounds");
    this.caught = power ? new CaughtGhosts(engine.facts.return_s, engine.facts.ghost_points) : null;
    this.#observe();
    this.snapshots = [this.#snapshot()];
  }

  #game(name) { return Number(this.engine.field("play", "rules.games", name)[0]); }

  get over() { return this.#game("end") !== 0; }
  get result() { return this.engine.facts.ends[this.#game("end")]; }
  get catcher() { return this.#game("catcher"); }

  // Writes the situation, and the planner's scores and choice.
  #observe() {
    this.engine.call("write_situations");
    this.engine.call("fill");
    this.best = this.#pageNumber(this.engine.call("judge"));
  }

  #pageNumber(candidate) {
    const number = this.numbers.indexOf(candidate);
    return number < 0 ? this.hold : number;
  }

  #allowed(number) { return this.engine.array("situation", "mask")[this.numbers[number]] === 1; }

  // Plays one tick with the orders of people (pacman_env/web/orders.py).
  step(orders = {}) {
    if (this.over) return;
    const { engine } = this;
    const choice = this.best;
    this.#sent = orders.ghosts ?? {};
    this.#note(orders);
    let goal = choice;
    if (orders.velocity) goal = this.hold;
    else if (orders.robot) {
      goal = orders.goal ?? this.hold;
      if (goal !== this.choices.at(-1)?.[0] && this.#isWorse(goal)) this.worse.push(this.ticks);
    }
    this.byPerson ||= Boolean(orders.robot || orders.velocity);
    engine.array("play", "choices")[0] = BigInt(this.numbers[this.#allowed(goal) ? goal : this.hold]);
    engine.array("play", "velocities").set(orders.velocity ?? [0, 0]);
    const control = { fresh: 1n, by_hand: orders.velocity ? 1n : 0n, ticks: 1n };
    for (const [name, value] of Object.entries(control)) engine.field("play", "control", name)[0] = value;
    engine.field("play", "last_decision", "ticks")[0] = 1n;
    this.#sendGhosts();
    engine.call("play");
    this.ticks++;
    this.choices.push([goal, choice]);
    this.#observe();
    this.snapshots.push(this.#snapshot());
  }

  #note(orders) {
    const { orders: noted = [] } = this.moves;
    if (!sameOrders(orders, noted.at(-1)?.[1] ?? {})) this.moves.orders = [...noted, [this.ticks, orders]];
  }

  #sendGhosts() {
    const known = this.engine.facts.behaviours;
    for (const k of this.played) {
      const cell = this.#sent[k] ?? null;
      const isCell = cell !== null && cell !== FOLLOW;
      const behaviour = known.indexOf(cell === FOLLOW ? "chase" : this.behaviours[k]);
      this.engine.field("ghosts", "choices", "kind", k)[0] = BigInt(isCell ? TO_CELL : AS_BEHAVIOUR);
      this.engine.field("ghosts", "choices", "value", k)[0] = BigInt(isCell ? cell : behaviour);
    }
  }

  // Whether the planner expects a catch on the way to a goal clearly more often than with its own choice.
  #isWorse(goal) {
    const features = this.engine.array("judge", "candidates");
    const { columns, terms } = this.engine.facts;
    const risk = (number) => (this.#allowed(number) ? features[this.numbers[number] * columns + terms.caught] : 0);
    return risk(goal) - risk(this.best) >= WORSE;
  }

  // What the planner thinks of each allowed candidate, as the message `why` has it.
  why() {
    const { engine, numbers, engine: { facts: { columns, terms, scene } } } = this;
    const [kind, paths, ghostPaths, [speed], [time_s]] = ["kind", "path_robot", "path_clyde", "clyde_speed", "time_s"]
      .map((name) => engine.array("situation", name));
    const [features, logits, [value]] = ["candidates", "logits", "value"].map((name) => engine.array("judge", name));
    const best = Math.max(...logits);
    const odds = logits.map((logit) => Math.exp(logit - best));
    const sum = odds.reduce((total, one) => total + one, 0);
    const rows = [...numbers.keys()].filter((number) => this.#allowed(number)).map((number) => {
      const at = numbers[number];
      const shown = Object.entries(terms).map(([name, column]) => [name, features[at * columns + column]]);
      const all = [["score", logits[at]], ["probability", odds[at] / sum], ["value", value], ...shown];
      return {
        candidate: number, kind: KINDS[kind[at]], robot_m: rounded(paths[at]),
        ghost_later_s: rounded(ghostPaths[at] / speed - paths[at] / scene.robot.speed_mps),
        terms: { ppo: Object.fromEntries(all.map(([name, one]) => [name, rounded(one)])) },
      };
    });
    return { time_s, goal: this.snapshots.at(-1).goal, policies: ["ppo"], chosen: { ppo: this.best }, rows };
  }

  // Plays with recorded orders until `ticks` ticks, or to the end.
  replay(moves, ticks = Infinity) {
    if (!this.ticks) for (const [k, place] of Object.entries(moves?.placed ?? {})) this.placeGhost(Number(k), ...place);
    while (!this.over && this.ticks < ticks) {
      this.step(moves?.orders?.findLast(([tick]) => tick <= this.ticks)?.[1]);
    }
  }

  // Moves a ghost to its cell nearest to a place, m, before the first tick.
  placeGhost(number, x, y) {
    const cell = this.#nearestCell(x, y, () => true);
    this.engine.call("place_ghost", number, cell);
    this.moves.placed = { ...this.moves.placed, [number]: [...this.#cell(cell)] };
    this.#observe();
    this.snapshots = [this.#snapshot()];
  }

  #cell(cell) { return this.engine.array("level", "ghost_xy").subarray(2 * cell, 2 * cell + 2); }

  #nearestCell(x, y, may) {
    const places = this.engine.array("level", "ghost_xy");
    let [best, least] = [-1, Infinity];
    for (let cell = 0; cell < places.length / 2; cell++) {
      const distance = (places[2 * cell] - x) ** 2 + (places[2 * cell + 1] - y) ** 2;
      if (distance < least && may(cell)) [best, least] = [cell, distance];
    }
    return best;
  }

  // The cell nearest to a place that a ghost can reach.
  ghostCell(number, x, y) {
    const part = this.engine.array("level", "ghost_part");
    const length = this.engine.array("ghosts", "paths").length / this.behaviours.length;
    const index = this.engine.field("ghosts", "ghosts", "path_index", number)[0];
    const current = part[this.engine.array("ghosts", "paths")[number * length + Number(index)]];
    return this.#nearestCell(x, y, (cell) => part[cell] === current);
  }

  // The allowed candidate nearest to a place, or null if none is within 1 m.
  nearest(x, y) {
    const places = this.engine.facts.candidates;
    const far = places.map(([px, py], number) => (this.#allowed(number) ? Math.hypot(px - x, py - y) : Infinity));
    const least = Math.min(...far);
    return least <= NEAR_M ? far.indexOf(least) : null;
  }

  // The state after a tick, as a message `frame` (docs/dev/web_protocol.md).
  #snapshot() {
    const { engine } = this;
    const game = (name) => this.#game(name);
    const alive = Array.from(engine.array("play", "rules.alive").subarray(0, this.pellets), Boolean);
    const scores = engine.array("judge", "logits");
    const pose = ["x", "y", "heading"].map(game);
    const ghost = (k, name) => engine.field("ghosts", "ghosts", name, k)[0];
    const places = this.behaviours.map((_, k) => [ghost(k, "x"), ghost(k, "y")]);
    const time_s = game("step") * engine.facts.physics_step_s;
    return {
      kind: "frame", state: "running", time_s, score: game("score"), collected: game("collected"),
      spawned: this.pellets, goal: game("pursued") < 0 ? -1 : this.#pageNumber(game("pursued")), over: this.over,
      true: pose, believed: [...engine.array("situation", "robot")],
      velocity: [...engine.array("situation", "robot_velocity")], ghosts: places, ghost_goals: this.ghostGoals(pose),
      alive, scores: this.numbers.map((candidate) => rounded(scores[candidate])), plan: this.#plan(),
      ...(this.caught ? { ...this.#caughtFields(places, time_s, alive), ghosts_caught: game("caught") } : {}),
    };
  }

  #caughtFields(places, time_s, alive) {
    const { facts } = this.engine;
    const obstacles = this.engine.array("play", "rules.obstacles");
    const until_s = places.map((_, k) => [3, 4].map((column) => obstacles[5 * k + column] * facts.physics_step_s));
    return this.caught.update(places, until_s, time_s, facts.power.filter((pellet) => alive[pellet]).length);
  }

  // Where people have sent ghosts; null: not sent.
  ghostGoals(robot, sent = this.#sent) {
    return this.behaviours.map((_, k) => {
      const cell = sent[k] ?? null;
      if (cell === null) return [null, null];
      return cell === FOLLOW ? robot.slice(0, 2) : [...this.#cell(cell)];
    });
  }

  #plan() {
    const paths = this.engine.array("play", "paths");
    const last = this.#game("nav_state") === 1 ? this.#game("nav_points") : 0;
    const first = Math.min(this.#game("nav_at"), last);
    const count = Math.min(last - first, MOST_PLAN_POINTS);
    const at = (k) => first + Math.round((k * (last - first - 1)) / Math.max(1, count - 1));
    return Array.from({ length: count }, (_, k) => [rounded(paths[2 * at(k)]), rounded(paths[2 * at(k) + 1])]);
  }
}
