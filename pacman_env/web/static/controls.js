// Run the game: Start, Pause, Reset, speed, STOP; its state and result; who has control.

import { ask, isOpen, request } from "./connection.js";
import { $, clock, dismiss, make, notice, question, setIcon, slider, write, writeOrHide } from "./dom.js";
import { state } from "./page.js";

const STOP_TIMEOUT_MS = 900;
const STOP_TRIES = 3;

$("start").onclick = () => request({ do: "start" });
$("reset").onclick = async () => {
  if (!state.roundRuns || await question("Reset ends the current round. Continue?")) request({ do: "reset" });
};
$("pause").onclick = () => request({ do: "pause", on: !state.frame?.paused });
// The offered speed nearest to one of the slider.
const speedOf = (times) => (state.hello?.choices?.speeds ?? [times]).reduce((best, one) => (
  Math.abs(one - times) < Math.abs(best - times) ? one : best));
const showSpeed = slider($("speed"), (times) => `×${speedOf(times)}`,
  (times) => request({ do: "speed", times: speedOf(times) }), 150);
state.on("hello", ({ choices }) => ($("speed").max = String(choices?.speeds?.at(-1) ?? 50)));

// The figures at the top by id: name, and value in the shown and the newest frame; hidden if undefined.
const FIGURES = {
  score: ["Score", ({ score }) => (state.story || state.demo ? "–" : score)],
  pellets: ["Pellets", ({ collected, spawned }) => (spawned ? `${collected}/${spawned}` : "–")],
  caught: ["Ghosts", (frame) => frame.ghosts_caught],
  time: ["Time", (frame) => clock(frame.time_s)],
  lives: ["Lives", (_, { lives }) => lives],
  round: ["Round", ({ round }) => round],
};
$("figures").append(...Object.entries(FIGURES).map(([id, [name]]) => (
  make("div", { hidden: true }, make("dt", { text: name }), make("dd", { id })))));

// The word of the game's state, and the kind that its colour follows.
function stateOf(frame) {
  if (state.story) return ["Replay", "story"];
  if (state.demo) return ["Demo ×4", "story"];
  if (frame.stopped) return ["Stopped", "stopped"];
  return [frame.paused && frame.state === "running" ? "Paused" : state.hello.states[frame.state], frame.state];
}

function hintFor(frame) {
  if (frame.stopped) return "Stopped: press Release to continue.";
  if (state.story || state.role !== "none") return ""; // the map says what a player can do
  const start = $("start").disabled ? $("start").title : "Press Start: the robot collects the pellets.";
  return { menu: start, starting: "Get ready." }[frame.state] ?? "";
}

state.on("frame story demo role people", () => {
  const frame = state.shownFrame;
  if (!frame) return;
  const live = state.frame ?? frame;
  const [word, kind] = stateOf(frame);
  write($("state"), word);
  $("state").dataset.state = kind;
  for (const [id, [, figure]] of Object.entries(FIGURES)) {
    const value = figure(frame, live);
    $(id).parentElement.hidden = value === undefined;
    write($(id), String(value ?? "–"));
  }
  write($("round").previousElementSibling, live.lives === undefined ? "Round" : "Level");
  const count = state.story ? undefined : live.begins_in_s;
  writeOrHide($("countdown"), count > 0 ? String(Math.ceil(count)) : "");
  write($("hint"), hintFor(live));
  showSpeed(Math.round(live.speed));
  const pause = $("pause");
  if (pause.getAttribute("aria-pressed") !== String(live.paused)) {
    pause.setAttribute("aria-pressed", String(live.paused));
    write(pause.lastElementChild, live.paused ? "Resume" : "Pause");
    setIcon(pause, live.paused ? "play" : "pause");
  }
});
state.on("scene", ({ preparing, notice: hint }) => {
  if (preparing) write($("state"), "Preparing");
  if (hint) write($("hint"), hint);
});

let stopPending = false; // a STOP that the server has not confirmed

function stopConfirmed() {
  stopPending = false;
  dismiss("stop");
}

async function stop() {
  stopPending = true;
  for (let k = 0; k < STOP_TRIES && stopPending && isOpen(); k++) {
    if (!(await ask({ do: "stop" }, STOP_TIMEOUT_MS)).ok) continue;
    stopConfirmed();
    notice("Stopped. The robot stands until it is released.", { key: "stopped" });
    return;
  }
  if (!stopPending) return;
  const byHand = state.source === "ros" ? " Use the robot's own buttons." : "";
  const words = `STOP was NOT delivered: no connection.${byHand} STOP is sent as soon as the connection is back.`;
  $("lost").classList.add("loud");
  if (!isOpen()) writeOrHide($("lost"), words);
  notice(`STOP was NOT confirmed.${byHand}`, { bad: true, stays: true, key: "stop" });
}

// What Escape closes in the simulator, and the button that does it; on the robot it always stops.
const CLOSED_BY = {
  "layers-list": "layers", guide: "guide-close", welcome: "welcome-close", end: "end-close", "story-bar": "story-close",
};
addEventListener("keydown", ({ key, repeat, defaultPrevented }) => {
  if (key !== "Escape" || repeat) return;
  const open = state.source !== "ros" && Object.keys(CLOSED_BY).find((id) => !$(id).hidden);
  if (state.source !== "ros" && (defaultPrevented || $("ask").open)) return; // it closes itself
  if (open) $(CLOSED_BY[open]).click();
  else stop();
});
$("stop").onclick = stop;
$("release").onclick = async () => await request({ do: "release" }) && dismiss("stopped");
state.on("connection", () => state.connected && stopPending && stop());
state.on("frame", ({ stopped }) => {
  $("release").hidden = !stopped;
  if (stopped && stopPending) stopConfirmed();
});

async function control(what) {
  if (await request({ do: "control", what }) && what === "ask") notice("You have asked for control.");
}
for (const what of ["take", "ask", "give"]) $(`lease-${what}`).onclick = () => control(what);

let lastOperator = null;
let lastAsking = "";
let asked = false; // this person, who has no answer yet
state.on("hello people connection", () => {
  const { operator, asking, viewers, roles, away } = state.people;
  const may = state.hello?.access === "operator" && state.connected;
  const mine = operator === state.me;
  const holder = operator === null ? "Control is free" : mine ? "You have control"
    : `${operator} ${away ? "has left, control is free soon" : "has control"}`;
  write($("lease-words"), !state.hello ? "" : operator === null && !may ? "View only" : holder);
  $("lease-words").classList.toggle("important", operator !== null && !mine);
  $("lease-take").hidden = !may || operator !== null;
  $("lease-ask").hidden = !may || operator === null || mine || away || asking.includes(state.me);
  $("lease-give").hidden = !may || !state.inControl;
  write($("viewers"), String(viewers));
  const others = state.inControl ? asking.filter((name) => name !== state.me).join(", ") : "";
  if (others && others !== lastAsking) {
    const buttons = [["Hand over", () => control("give")], ["Keep control", () => control("keep")]];
    notice(`${others} asks for control.`, { stays: true, key: "asking", buttons });
  } else if (!others) dismiss("asking");
  lastAsking = others;
  if (asked && operator && !mine && !asking.includes(state.me)) notice(`${operator} keeps control.`, { key: "kept" });
  asked = state.connected && asking.includes(state.me);
  if (lastOperator !== null && mine && lastOperator !== state.me) notice("You have control.");
  lastOperator = operator;
  const players = Object.entries(roles).filter(([, name]) => name)
    .map(([role, name]) => `${state.hello.roles[role].name}: ${name}`);
  write($("people-words"), [
    `${viewers} ${viewers === 1 ? "viewer" : "viewers"}. You are ${state.me ?? "not connected"}. ${holder}.`,
    asking.length ? `${asking.join(", ")} asks for control.` : "",
    players.length ? `Roles: ${players.join(", ")}.` : "",
  ].filter(Boolean).join(" "));
});
