// Plays rounds with the modules of the page, in a browser or in Node, and reports the numbers of all their frames.
import { Engine, unpack } from "./engine.js";
import { Round } from "./round.js";

// `load` returns the bytes of a file of the build. Results: outcome, choices, numbers (T+1, n) and their SHA-256.
export async function play(load, rounds) {
  const bytes = new Blob([await load("game.wasm.bin")]).stream().pipeThrough(new DecompressionStream("gzip"));
  const module = await WebAssembly.compile(await new Response(bytes).arrayBuffer());
  const network = await unpack(await load("network.bin"));
  const engines = {};
  const results = [];
  for (const { place, moves, played, ...setup } of rounds) {
    const engine = engines[place] ??= new Engine(module, network, await unpack(await load(`maps/${place}.bin`)));
    const round = new Round(engine, setup, played);
    round.replay(moves, 0); // places ghosts
    const rows = [row(round)];
    let ms = 0;
    while (!round.over) {
      const before = performance.now();
      round.replay(moves, round.ticks + 1);
      ms += performance.now() - before;
      rows.push(row(round));
    }
    const hash = new Uint8Array(await crypto.subtle.digest("SHA-256", new Float64Array(rows.flat())));
    const sha256 = Array.from(hash, (byte) => byte.toString(16).padStart(2, "0")).join("");
    const choices = round.choices.map(([goal]) => goal);
    results.push({ outcome: round.result, choices, sha256, tick_ms: ms / round.ticks, numbers: rows });
  }
  return results;
}

function row(round) {
  const frame = round.snapshots.at(-1);
  const logits = round.engine.array("judge", "logits");
  const scores = round.numbers.map((candidate) => (Number.isFinite(logits[candidate]) ? logits[candidate] : 0));
  return [...frame.true, ...frame.believed, ...frame.velocity, ...frame.ghosts.flat(), frame.collected, ...scores];
}

if (globalThis.process) { // node rounds.mjs: rounds as JSON on the input, results as JSON
  const { readFileSync } = await import("fs");
  const results = await play((name) => readFileSync(new URL(name, import.meta.url)), JSON.parse(readFileSync(0)));
  process.stdout.write(JSON.stringify(results));
}
