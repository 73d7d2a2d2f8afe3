// Plays the game of the page in Node by simulated time: `node match.mjs FOLDER`, results as JSON.

import { readFile } from "node:fs/promises";

const { Match } = await import(`${process.argv[2]}/match.js`);
const sent = [];
let time = 0;
const host = {
  read: (path) => readFile(`${process.argv[2]}/${path}`),
  pause: () => new Promise(setImmediate),
  now: () => time,
  post: (text) => sent.push(JSON.parse(text)),
};
const match = new Match();
const of = (kind) => sent.filter((message) => message.kind === kind);
const news = () => of("news").flatMap(({ items }) => items);
let id = 0;

async function ask(message) {
  await match.receive(JSON.stringify({ ...message, id: ++id }));
  return sent.findLast((one) => one.kind === "answer" && one.id === id);
}

// Lets time pass until the game is in a state; every second `act` is called.
async function until(state, act = () => null) {
  for (let k = 0; k < 20 * 600 && match.state !== state; k++) {
    time += 50;
    if (k % 20 === 0) await act();
    match.advance();
  }
}

const results = {};
await match.begin(host);
results.kinds = sent.map(({ kind }) => kind);
match.advance();
results.first = of("frame")[0].state;
results.demo = (await ask({ do: "story", story: 0 })).data.length;

// A person plays the robot: to the nearest pellet each second, and by hand for a moment.
await ask({ do: "role", role: "robot" });
await ask({ do: "speed", times: 6 });
await ask({ do: "start" });
await until("running");
let hand = 3;
await until("menu", () => {
  const frame = of("frame").at(-1);
  const pellets = match.scene.pellets.map(([x, y], k) => [frame.alive[k] ? Math.hypot(x - frame.true[0], y - frame.true[1]) : 1e9, k]);
  if (hand-- > 0) return ask({ do: "drive", v: 0.2, omega: 0.5 });
  return ask({ do: "goal", candidate: pellets.sort((a, b) => a[0] - b[0])[0][1] });
});
const [played] = (await ask({ do: "stories" })).data;
const link = Object.fromEntries(new URLSearchParams(played.link));
const setup = {
  do: "setup", finish: true, map: link.map, seed: Number(link.seed), ghosts: link.ghosts.split(","),
  clyde_mps: Number(link.clyde), moves: JSON.parse(JSON.stringify(played.moves)), preset: link.preset, policy: link.policy,
  settings: Object.fromEntries(Object.entries(link).filter(([name]) => name.startsWith("set.")).map(([name, value]) => [name.slice(4), value])),
};
await ask({ do: "role", role: "none" });
const frames = async (story) => (await ask({ do: "story", story })).data.map(({ revision, ...frame }) => frame);
const again = await ask(setup);
results.played = played;
results.same = JSON.stringify(await frames(played.story)) === JSON.stringify(await frames(again.data?.story));
results.why = (await ask({ do: "why", story: played.story, tick: 20 })).data;

// From a moment on.
await ask({ ...setup, finish: false, until: 12 });
results.until = match.round.ticks;

// A person plays a ghost.
await ask({ ...setup, finish: false, moves: undefined, settings: undefined });
await ask({ do: "role", role: "ghost-1" });
await ask({ do: "start" });
await ask({ do: "goal", follow: true });
await until("menu");
results.ghost = (await ask({ do: "stories" })).data[0];
results.ghostSame = JSON.stringify(await frames(results.ghost.story))
  === JSON.stringify(await frames((await ask({ ...setup, seed: results.ghost.seed, moves: results.ghost.moves })).data.story));
await ask({ do: "role", role: "none" });

// Refusals change nothing.
const before = JSON.stringify([match.setup, match.round.setup.seed, match.state]);
results.refusals = [];
for (const message of [
  { do: "setup", map: "moon" }, { do: "setup", map: "generated", level: 3 }, { do: "setup", map: "generated", level: 20 },
  { do: "setup", level: 1 }, { do: "setup", ghosts: ["wander", "shy"] }, { do: "setup", ghosts: [] },
  { do: "setup", clyde_mps: 9 }, { do: "setup", seed: -1 }, { do: "setup", settings: { "robot.radius_m": 1 } },
  { do: "setup", policy: "clyde_aware" }, { do: "setup", moves: { orders: [[0, { goal: 999 }]] } },
  { do: "setup", moves: { orders: [[0, { ghosts: { 3: 1 } }]] } }, { do: "setup", moves: { orders: 3 } },
  { do: "goal", candidate: 1 }, { do: "role", role: "ghost-7" }, { do: "place_clyde", x: 0, y: 0, ghost: 5 },
  { do: "why", story: 99, tick: 0 }, { do: "constructor" }, { do: "story", story: 99 },
]) {
  const { ok, words } = await ask(message);
  results.refusals.push(ok ? null : words);
}
results.unchanged = before === JSON.stringify([match.setup, match.round.setup.seed, match.state]);

// Placed ghosts, a demo of another round, stop and release.
await ask({ do: "place_clyde", x: match.scene.pellets[3][0], y: match.scene.pellets[3][1], ghost: 1 });
results.placed = match.round.moves.placed;
results.otherDemo = (await ask({ do: "story", story: 0 })).data?.length;
results.ready = (await ask({ do: "ready" })).data;
await ask({ do: "start" });
await until("running");
await ask({ do: "stop" });
const at = match.round.ticks;
for (let k = 0; k < 50; k++) {
  time += 50;
  match.advance();
}
results.stopped = match.round.ticks - at;
await ask({ do: "release" });
await ask({ do: "watch", why: true });
await until("menu");
results.events = [...new Set(news().map(({ event, sound, state }) => event ?? sound ?? state))];
results.explained = news().filter(({ why }) => why).length;
results.numbers = of("frame").every(({ number }, k, all) => k === 0 || number === all[k - 1].number + 1);
results.text = of("frame")[0] && Object.keys(of("frame")[0])[0];
console.log(JSON.stringify(results));
