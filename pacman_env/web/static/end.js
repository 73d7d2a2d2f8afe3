// The card at the end of a round: its result, and what to do next. Best times and streaks are kept in the browser.

import { request } from "./connection.js";
import { $, clock, counted, make, stored, write, writeOrHide } from "./dom.js";
import { on, source, state } from "./state.js";

const KEY = "pacman_env.best";
const ROUND_TIMEOUT_MS = 120000;
const LIVES = 3; // of a new game

let ended = null; // the recorded round that the card shows, null: none yet
let lastState = "";

const myGhost = ({ ghosts_played: played = [] }) => played.find((ghost) => state.role === `ghost-${ghost}`);
const policyOf = ({ policies: [policy] = ["the policy"] }) => policy;

// A result in words; to the person who played a ghost in that round it is the ghost's.
function resultWords(entry) {
  const { result, catcher } = entry;
  if (myGhost(entry) === undefined) return state.hello.results[result] ?? result;
  if (result !== "caught") return "It got away";
  const by = `ghost-${catcher}`;
  return by === state.role ? "You caught it" : `${state.hello.roles[by]?.name ?? "A ghost"} caught it`;
}

function isWon(entry) {
  return myGhost(entry) === undefined ? ["complete", "cleared"].includes(entry.result) : entry.result === "caught";
}

// Who has played, as far as records count.
function playerOf(entry) {
  if (myGhost(entry) !== undefined) return "you as a ghost";
  if (entry.player !== "person") return policyOf(entry);
  return state.role === "robot" ? "you" : "a person";
}

// Adds a round to the records of this browser. Returns them in words.
function keep(entry) {
  let records = {};
  try {
    records = JSON.parse(stored("localStorage", KEY) ?? "{}");
  } catch {
    // written by another page: they begin again
  }
  const name = [playerOf(entry), entry.map, state.scene?.ghosts.length ?? 1].join("|");
  const { best = Infinity, streak = 0 } = records[name] ?? {};
  const won = isWon(entry);
  const faster = won && entry.time_s < best;
  records[name] = { best: faster ? entry.time_s : best, streak: won ? streak + 1 : 0 };
  stored("localStorage", KEY, JSON.stringify(records));
  const now = records[name];
  return [
    Number.isFinite(now.best) ? `Best time ${clock(now.best)}${faster && Number.isFinite(best) ? ", a new record" : ""}.` : "",
    now.streak > 1 ? `${now.streak} wins in a row.` : "",
  ].filter(Boolean).join(" ");
}

function close() {
  $("end").hidden = true;
}

// Shows how a round has ended: as the game reports it, and again with all actions once its recording is there.
export function showResult(entry, comparison = "") {
  const recorded = entry.story !== undefined;
  if (ended && (!recorded || entry.story === ended.story)) return;
  ended = recorded ? entry : null;
  const { collected, spawned, time_s: time, ghosts_caught: caught } = entry;
  const title = resultWords(entry);
  const text = `${collected} of ${spawned} pellets${caught ? ` and ${counted(caught, "ghost")}` : ""} in ${clock(time)}`;
  const box = $("result");
  if (box.textContent !== title + text) box.replaceChildren(make("strong", { text: title }), text);
  $("end").dataset.won = String(isWon(entry));
  writeOrHide($("end-other"), comparison);
  writeOrHide($("end-lives"), livesWords(entry));
  writeOrHide($("end-best"), recorded ? keep(entry) : "");
  $("end").hidden = Boolean(state.story);
  showActions();
}

// What a round means in the game of the person who plays the robot: levels to climb, with three lives.
function livesWords({ result, player }) {
  const { lives, round, score } = state.frame ?? {};
  if (lives === undefined || (player !== undefined && player !== "person") || result !== "caught") return "";
  if (!lives) return `Game over in level ${round}, score ${score}.`;
  return `${lives === 1 ? "One life" : `${lives} lives`} left: try level ${round} again.`;
}

function nextWords() {
  const { round = 1, lives } = state.frame ?? {};
  if (lives === undefined) return round > 1 ? `Round ${round}, faster ghosts` : "Next round";
  if (!lives || (round === 1 && lives === LIVES)) return "New game";
  const speed = state.scene?.clyde_speed_mps;
  return `Level ${round}${speed ? `, Clyde ${speed.toFixed(2)} m/s` : ""}`;
}

function showActions() {
  const second = ended?.policies?.[1];
  $("end-again").hidden = !ended || source() === "ros" || state.frame?.lives !== undefined; // levels are a game of its own
  $("end-moment").hidden = !ended;
  $("end-compare").hidden = !second || second === policyOf(ended) || ended.player === "person" || !$("end-other").hidden;
  write($("end-compare"), `How does ${second} do?`);
  write($("end-next").lastElementChild, nextWords());
}

function otherWords(policy, { result, collected, time_s: time }) {
  if (result === "complete") return `${policy} collects all pellets in ${clock(time)}.`;
  const how = result === "caught" ? "is caught" : "runs out of time";
  return `${policy} ${how} after ${clock(time)}, with ${counted(collected, "pellet")}.`;
}

$("end-compare").onclick = async () => {
  const entry = ended;
  writeOrHide($("end-other"), "Playing the same round.");
  showActions();
  const answer = await request({ do: "compare", story: entry.story }, ROUND_TIMEOUT_MS);
  if (entry !== ended) return;
  writeOrHide($("end-other"), !answer ? "" : answer.data ? otherWords(entry.policies[1], answer.data)
    : "A person has changed this round, so no policy can repeat it.");
  showActions();
};
$("end-again").onclick = async () => {
  close();
  if (await request({ do: "setup", seed: ended.seed }, ROUND_TIMEOUT_MS)) request({ do: "start" });
};
$("end-next").onclick = () => {
  close();
  request({ do: "start" });
};
$("end-close").onclick = close;
export const onMoment = (open) => {
  $("end-moment").onclick = () => open(ended);
};

on("frame", (frame) => {
  if (frame.state === lastState) return;
  lastState = frame.state;
  const result = { complete: "complete", dying: "caught" }[lastState];
  if (result && !state.role.startsWith("ghost")) showResult({ ...frame, result });
  if (["starting", "running"].includes(lastState)) {
    close();
    ended = null;
  }
  if (!$("end").hidden) showActions();
});
on("scene", () => $("end").hidden || showActions());
on("story", (story) => story && close());
