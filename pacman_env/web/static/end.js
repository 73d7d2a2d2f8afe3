// The card at the end of a round: its result, and what to do next. Best times and streaks are kept in the browser.

import { SLOW_MS, request } from "./connection.js";
import { $, clock, counted, focusMap, make, stored, write, writeOrHide } from "./dom.js";
import { state } from "./page.js";

const KEY = "pacman_env.best";
const NEXT = { // words of the main button, by what it starts
  retry: () => "Try again",
  shared: () => "Play this round",
  game: () => "New game",
  level: (number) => `Level ${number}`,
  round: (number) => (number > 1 ? `Round ${number}, faster ghosts` : "Next round"),
};

let ended = null; // the round that the card shows: an entry of the finished rounds, or a robot's last frame
let isShared = false; // another person's round, opened by a link
let lastState = "";
let last = {}; // frame of the round's end: at home, lives and level are of the next round

const playsGhost = ({ ghosts_played: played = [] }) => played.some((ghost) => state.role === `ghost-${ghost}`);
const isPlayersWin = ({ result }) => ["complete", "cleared"].includes(result); // of the robot
const isWon = (entry) => (playsGhost(entry) ? entry.result === "caught" : isPlayersWin(entry));

// A result in words; to the person who played a ghost in that round it is the ghost's.
function titleOf(entry) {
  const { result, catcher } = entry;
  const by = state.hello.roles[`ghost-${catcher}`]?.name;
  const words = state.resultWords(result);
  if (isShared) return `A shared round: ${words.toLowerCase()}`;
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

const close = () => ($("end").hidden = true);

// Shows how a round has ended, or a round that a link has opened.
export function showResult(entry, shared = false) {
  [ended, isShared] = [entry, shared];
  const { collected, spawned, time_s: time, ghosts_caught: caught, story, second } = entry;
  const text = `${collected} of ${spawned} pellets${caught ? ` and ${counted(caught, "ghost")}` : ""} in ${clock(time)}`;
  $("result").replaceChildren(make("strong", { text: titleOf(entry) }), text);
  $("end").dataset.won = String(isWon(entry));
  writeOrHide($("end-other"), second ? comparison(entry) : "");
  writeOrHide($("end-best"), story && !shared ? recordsWith(entry) : "");
  $("end").hidden = Boolean(state.story) && !shared;
  showActions();
  if (shared) return;
  state.emit("ended", entry.result);
  if (state.role !== "none") focusMap($("end-next"));
}

// The game of the person who plays the robot has levels and three lives; for all others it is a row of rounds.
const playsRobot = () => state.role === "robot" && state.frame.lives !== undefined;

// What a lost round means for the person who plays the robot; people without control read who starts the next one.
function nextLine({ result, player }) {
  if (!state.mayControl) return state.people.operator ? `${state.people.operator} starts the next round.` : "";
  const { lives, round, score } = last;
  if (isShared) return "";
  if (!playsRobot() || lives === undefined || player !== "person" || result !== "caught") return "";
  if (!lives) return `Game over in level ${round}, score ${score}.`;
  return `${lives === 1 ? "One life" : `${lives} lives`} left: try level ${round} again.`;
}

// What the main button starts, and the number of the level or round.
function next() {
  const { round, state: now } = state.frame;
  const number = isPlayersWin(ended) && now !== "menu" ? round + 1 : round; // it counts up at home
  if (isShared) return ["shared", number];
  if (!playsRobot()) return ["round", number];
  if (isPlayersWin(ended)) return ["level", number];
  return [ended.result === "caught" && last.lives ? "retry" : "game", number];
}

function showActions() {
  if (!ended) return;
  const [first, second] = ended.policies ?? [];
  const noStory = !ended.story;
  const [what, number] = next();
  writeOrHide($("end-lives"), nextLine(ended));
  $("end-next").hidden = !state.mayControl;
  $("end-next").dataset.starts = what;
  $("end-again").hidden = noStory || !state.mayControl || isShared;
  $("end-moment").hidden = $("end-share").hidden = noStory;
  const worse = ended.worse?.length ?? 0;
  $("end-worse").hidden = noStory || !worse;
  write($("end-worse"), counted(worse, "risky goal"));
  const byPerson = ended.player === "person" || ended.ghosts_played?.length > 0; // no policy can repeat the round
  $("end-compare").hidden = !second || second === first || byPerson || !state.mayControl || !$("end-other").hidden;
  write($("end-compare"), `How does ${second} do?`);
  write($("end-next").lastElementChild, NEXT[what](number));
}

function otherWords(policy, { result, collected, time_s: time }) {
  const words = state.resultWords(result).toLowerCase();
  return `${policy}: ${words} after ${clock(time)}, with ${counted(collected, "pellet")}.`;
}

// Compares a round that a person has played with the policy's.
function comparison(entry) {
  // A complete round is better than any other, and the faster the better.
  const rank = ({ result, collected, time_s: time }) => (result === "complete" ? 1e6 - time : collected);
  const lead = rank(entry) - rank(entry.second);
  const [policy] = entry.policies;
  const player = state.role === "robot" ? "You were" : `${state.people.roles.robot ?? "The player"} was`;
  const better = lead ? `${lead > 0 ? player : `${policy} was`} better` : "It is a draw";
  return `${better}. ${otherWords(policy, entry.second)}`;
}

$("end-compare").onclick = async () => {
  const entry = ended;
  writeOrHide($("end-other"), "Playing the same round.");
  showActions();
  const answer = await request({ do: "compare", story: entry.story }, SLOW_MS);
  if (entry !== ended) return;
  const unlike = "A person has changed this round, so no policy can repeat it.";
  writeOrHide($("end-other"), answer && (answer.data ? otherWords(entry.policies[1], answer.data) : unlike));
  showActions();
};
$("end-again").onclick = () => {
  close();
  request({ do: "start", same: true }, SLOW_MS);
};
$("end-next").onclick = () => {
  close();
  if (isShared) state.emit("play", ended);
  else request({ do: "start" }, SLOW_MS);
};
$("end-close").onclick = close;
for (const name of ["moment", "worse", "share"]) $(`end-${name}`).onclick = () => state.emit(name, ended);

state.on("frame", (frame) => {
  if (["dying", "returning_home"].includes(frame.state)) last = frame;
  if (frame.state === lastState) return;
  // A robot's game is in the state "complete" for less time than passes between two frames.
  const won = frame.state === "complete" || (lastState === "running" && frame.state === "returning_home");
  lastState = frame.state;
  const result = won ? "complete" : lastState === "dying" && "caught";
  if (result && state.source === "ros") showResult({ ...frame, result });
  if (["starting", "running"].includes(lastState)) close();
  if (!$("end").hidden) showActions();
});
state.on("scene people role", () => $("end").hidden || showActions());
state.on("story", (story) => story && !(isShared && story.entry === ended) && close());
state.on("demo", (invites) => invites && close());
