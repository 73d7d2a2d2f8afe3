// The card at the end of a round: its result, and what to do next. Best times and streaks are kept in the browser.

import { request } from "./connection.js";
import { $, clock, counted, make, stored, write, writeOrHide } from "./dom.js";
import { on, source, state } from "./state.js";

const KEY = "pacman_env.best";
const ROUND_TIMEOUT_MS = 120000;
const LIVES = 3; // of a new game

let ended = null; // the round that the card shows: an entry of the finished rounds, or a robot's last frame
let lastState = "";

const playsGhost = ({ ghosts_played: played = [] }) => played.some((ghost) => state.role === `ghost-${ghost}`);
const isWon = (entry) => (playsGhost(entry) ? entry.result === "caught" : ["complete", "cleared"].includes(entry.result));

// A result in words; to the person who played a ghost in that round it is the ghost's.
function titleOf(entry) {
  const { result, catcher } = entry;
  const by = state.hello.roles[`ghost-${catcher}`]?.name;
  const words = state.hello.results[result] ?? result;
  if (playsGhost(entry) && result !== "caught") return `You lost: ${words.toLowerCase()}`;
  if (playsGhost(entry)) return state.role === `ghost-${catcher}` ? "You won: you caught the robot" : `${by} caught the robot`;
  return result === "caught" && by ? `Caught by ${by}` : words;
}

// Adds a round to the records of this browser. Returns them in words.
function recordsWith(entry) {
  const person = state.role === "robot" ? "you" : "a person";
  const player = playsGhost(entry) ? "you as a ghost" : entry.player === "person" ? person : entry.policies[0];
  const name = [player, entry.map, state.scene?.ghosts.length ?? 1].join("|");
  const records = JSON.parse(stored("localStorage", KEY) ?? "{}");
  const before = records[name]?.best ?? Infinity;
  const won = isWon(entry);
  const [best, streak] = won ? [Math.min(before, entry.time_s), (records[name]?.streak ?? 0) + 1] : [before, 0];
  stored("localStorage", KEY, JSON.stringify({ ...records, [name]: { best, streak } }));
  const record = best < before && before < Infinity ? ", a new record" : "";
  return (best < Infinity ? `Best time ${clock(best)}${record}. ` : "") + (streak > 1 ? `${streak} wins in a row.` : "");
}

const close = () => {
  $("end").hidden = true;
};

// Shows how a round has ended.
export function showResult(entry) {
  ended = entry;
  const { collected, spawned, time_s: time, ghosts_caught: caught, story, second } = entry;
  const text = `${collected} of ${spawned} pellets${caught ? ` and ${counted(caught, "ghost")}` : ""} in ${clock(time)}`;
  $("result").replaceChildren(make("strong", { text: titleOf(entry) }), text);
  $("end").dataset.won = String(isWon(entry));
  writeOrHide($("end-other"), second ? comparison(entry) : "");
  writeOrHide($("end-lives"), livesWords(entry));
  writeOrHide($("end-best"), story ? recordsWith(entry) : "");
  $("end").hidden = Boolean(state.story);
  showActions();
}

// What a round means in the game of the person who plays the robot: levels to climb, with three lives.
function livesWords({ result, player }) {
  const { lives, round, score } = state.frame;
  if (lives === undefined || player !== "person" || result !== "caught") return "";
  if (!lives) return `Game over in level ${round}, score ${score}.`;
  return `${lives === 1 ? "One life" : `${lives} lives`} left: try level ${round} again.`;
}

function nextWords() {
  const { round, lives, state: now } = state.frame;
  const next = ended?.result === "complete" && now !== "menu" ? round + 1 : round; // it counts up at home
  if (lives === undefined) return next > 1 ? `Round ${next}, faster ghosts` : "Next round";
  if (!lives || (round === 1 && lives === LIVES)) return "New game";
  return `Level ${round}, Clyde ${state.scene.clyde_speed_mps.toFixed(2)} m/s`;
}

function showActions() {
  const [first, second] = ended?.policies ?? [];
  const noStory = !ended?.story;
  $("end-again").hidden = noStory || state.frame.lives !== undefined; // levels are a game of its own
  $("end-moment").hidden = noStory;
  $("end-compare").hidden = !second || second === first || ended.player === "person" || !$("end-other").hidden;
  write($("end-compare"), `How does ${second} do?`);
  write($("end-next").lastElementChild, nextWords());
}

function otherWords(policy, { result, collected, time_s: time }) {
  if (result === "complete") return `${policy} collects all pellets in ${clock(time)}.`;
  const how = result === "caught" ? "is caught" : "runs out of time";
  return `${policy} ${how} after ${clock(time)}, with ${counted(collected, "pellet")}.`;
}

// Compares a round that a person has played with the policy's.
function comparison(entry) {
  // A complete round is better than any other, and the faster the better.
  const rank = ({ result, collected, time_s: time }) => (result === "complete" ? 1e6 - time : collected);
  const lead = rank(entry) - rank(entry.second);
  const [policy] = entry.policies;
  const better = lead ? `${lead > 0 ? "You were" : `${policy} was`} better` : "It is a draw";
  return `${better}: ${otherWords(policy, entry.second)}`;
}

$("end-compare").onclick = async () => {
  const entry = ended;
  writeOrHide($("end-other"), "Playing the same round.");
  showActions();
  const answer = await request({ do: "compare", story: entry.story }, ROUND_TIMEOUT_MS);
  if (entry !== ended) return;
  const unlike = "A person has changed this round, so no policy can repeat it.";
  writeOrHide($("end-other"), answer && (answer.data ? otherWords(entry.policies[1], answer.data) : unlike));
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
  if (result && source() === "ros") showResult({ ...frame, result });
  if (["starting", "running"].includes(lastState)) close();
  if (!$("end").hidden) showActions();
});
on("scene", () => $("end").hidden || showActions());
on("story", (story) => story && close());
