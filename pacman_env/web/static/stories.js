// Finished rounds: the list, the time line with its markers, and links that reproduce a round.

import { address, ask, request, token } from "./connection.js";
import { $, button, clock, counted, isShortcut, make, renderReleased, setIcon, write } from "./dom.js";
import { onMoment, resultWords, showResult } from "./end.js";
import * as map from "./map.js";
import { notice, question } from "./notices.js";
import { parseSetting } from "./settings.js";
import { emit, on, robotPose, source, state } from "./state.js";

const SPEED = 4; // times real time
const STEP_MS = 50; // at least, between two frames
const EXPLAIN_DELAY_MS = 150;
const REPLAY_TIMEOUT_MS = 180000;
const DECIDED_TICKS = 4; // before a catch nothing can be changed any more
const BEFORE_TICKS = 8; // shown before the decisive moment
const THUMB_PX = 16; // of the slider
const NOT_KEPT = "Rounds of a robot are not kept here. Record them in a terminal: pacman-env ros record.";
const NO_LINK = "This round cannot be reproduced by a link: a person played in it, or a ghost was placed by hand.";

const scenes = new Map(); // by revision
let entries = []; // as the server lists them
let playing = 0; // the timer
let explainTimer = 0;

const resultOf = ({ result, collected, spawned }) => `${resultWords(result)}: ${collected} of ${spawned}`;

// Lists the rounds anew. Returns the entry of the one with this number.
async function load(number) {
  const { ok, data } = await ask({ do: "stories" });
  if (ok) entries = data ?? [];
  showList();
  return entries.find(({ story }) => story === number);
}

on("scene", (scene) => scenes.set(scene.revision, scene));
on("hello", () => load());
on("news", async (items) => {
  const ended = items.filter((item) => item.story).at(-1)?.story;
  const entry = ended && await load(ended);
  if (entry) showResult(entry);
});

function showList() {
  write($("stories-words"), source() === "ros" ? NOT_KEPT : entries.length ? "Newest first." : "No round has ended yet.");
  renderReleased($("stories"), () => $("stories").replaceChildren(...entries.map((entry) => {
    const { story, second, parts, policies: [policy] = ["policy"] } = entry;
    const disagree = parts.length ? `policies disagree ${counted(parts.length, "time")}` : "";
    const player = entry.player === "person" ? "played by a person" : policy;
    const caught = entry.ghosts_caught ? `, ${counted(entry.ghosts_caught, "ghost")} caught` : "";
    const details = [entry.map, `seed ${entry.seed}`, player, disagree];
    return make("li", { class: state.story?.entry.story === story ? "open" : "", data: { story } },
      make("span", {}, make("strong", { text: resultOf(entry) }),
        `${caught} in ${clock(entry.time_s)}${second ? `, ${policy} ${second.collected} (${resultWords(second.result).toLowerCase()})` : ""}`),
      button("Open", { "aria-label": `Open round ${story}`, onclick: () => open(story) }),
      make("span", { class: "quiet", text: details.filter(Boolean).join(" · ") }));
  })));
}

// The scene of a round: as it was sent, or the current one if it has the same map.
function sceneOf(entry) {
  const scene = scenes.get(entry.revision);
  if (scene && !scene.preparing) return scene;
  const now = state.scene;
  const same = now?.map?.name === entry.map && now.pellets.length === entry.spawned
    && (entry.map !== "generated" || now.seed === entry.seed);
  return same || entry.map === undefined ? now : null;
}

async function open(number, tick = 0) {
  const entry = entries.find(({ story }) => story === number) ?? await load(number);
  const scene = entry ? sceneOf(entry) : null;
  if (!scene) {
    notice(entry ? `That round was on another map, ${entry.map}. Choose it in the tab Game first.`
      : "That round is no longer stored.", { bad: true });
    return;
  }
  try {
    const response = await fetch(address(`story/${number}.json`));
    if (!response.ok) throw new Error(await response.text());
    const frames = await response.json();
    pause();
    state.story = { entry, frames, index: 0, scene, trail: frames.map(robotPose) };
  } catch (error) {
    notice(`The round could not be loaded: ${error.message.trim()}`, { bad: true });
    return;
  }
  showBar(true);
  $("story-range").max = String(state.story.frames.length - 1);
  write($("story-title"), `Round ${entry.story}: ${resultOf(entry).toLowerCase()}`);
  write($("story-parts"), entry.policies ? `(${entry.policies.join(" and ")})` : "");
  await map.showScene(scene);
  seek(tick);
}

async function close() {
  if (!state.story) return;
  pause();
  state.story = null;
  showBar(false);
  emit("why", (state.why = null));
  emit("story", null);
  await map.showScene(state.scene);
  if (state.frame) map.showFrame(state.frame, { jump: true });
}

function showBar(show) {
  $("story-bar").hidden = !show;
  document.body.classList.toggle("replays", show);
  $("ring").hidden = show;
  showList();
}

function seek(index, smooth = false) {
  const { story } = state;
  if (!story) return;
  story.index = Math.max(0, Math.min(story.frames.length - 1, index));
  const frame = story.frames[story.index];
  map.showFrame(frame, { jump: !smooth, path: story.trail.slice(0, story.index + 1).filter(Boolean) });
  $("story-range").value = String(story.index);
  const text = `${clock(frame.time_s)} of ${clock(story.entry.time_s)}, ${frame.collected} pellets`;
  write($("story-at"), text);
  $("story-range").setAttribute("aria-valuetext", text);
  emit("story", story);
  explain();
}

// Asks for the terms of the decision shown, once the position stays.
function explain() {
  clearTimeout(explainTimer);
  explainTimer = setTimeout(async () => {
    const { story } = state;
    if (!story || $("panel-why").hidden || playing) return;
    const { index, entry } = story;
    const tick = Math.min(index, Math.max(0, entry.ticks - 1));
    const answer = await request({ do: "why", story: entry.story, tick }, 30000);
    if (answer && state.story === story && story.index === index) emit("why", (state.why = answer.data));
  }, EXPLAIN_DELAY_MS);
}
on("tab", explain);

// Shows the timer of the replay, 0: it is paused.
function setPlaying(timer) {
  playing = timer;
  $("story-play").setAttribute("aria-label", playing ? "Pause" : "Play");
  setIcon($("story-play"), playing ? "pause" : "play");
}

function pause() {
  clearInterval(playing);
  setPlaying(0);
  explain();
}

function play() {
  const { frames } = state.story;
  const last = frames.length - 1;
  if (state.story.index >= last) seek(0);
  const frame_ms = Math.max(10, (1000 * (frames[last].time_s - frames[0].time_s)) / Math.max(1, last)) / SPEED;
  const wait = Math.max(STEP_MS, frame_ms);
  setPlaying(setInterval(() => {
    if (document.hidden) return;
    seek(state.story.index + Math.max(1, Math.round(wait / frame_ms)), true);
    if (state.story.index >= last) pause();
  }, wait));
}

// Opens a round shortly before the moment that decided it, and plays it from there: the last choice well before the robot
// was caught, or else where a ghost was nearest to it.
async function openMoment(entry) {
  await open(entry.story);
  if (state.story?.entry.story !== entry.story) return;
  const { frames } = state.story;
  const nearest = (frame) => Math.min(...frame.ghosts.map(([x, y], k) => (
    frame.harmless_s?.[k] > 0 ? Infinity : Math.hypot(x - frame.true[0], y - frame.true[1]))));
  const choice = entry.decisions.filter((tick) => tick < entry.ticks - DECIDED_TICKS).at(-1) ?? 0;
  const distances = frames.map(nearest);
  const moment = entry.result === "caught" ? choice : distances.indexOf(Math.min(...distances));
  seek(Math.max(0, moment - BEFORE_TICKS));
  play();
}
onMoment(openMoment);

// To the next or previous marker: where the policies disagree, or else where the goal changes.
function jump(step) {
  const { entry, index } = state.story;
  pause();
  const marks = entry.parts.length ? entry.parts : entry.decisions;
  const tick = step > 0 ? marks.find((mark) => mark > index) : marks.filter((mark) => mark < index).at(-1);
  if (tick === undefined) notice(step > 0 ? "No later marker." : "No earlier marker.", { key: "mark" });
  else seek(tick);
}

const togglePlaying = () => (playing ? pause() : play());
$("story-close").onclick = close;
$("story-play").onclick = togglePlaying;
$("story-previous").onclick = () => jump(-1);
$("story-next").onclick = () => jump(1);
$("story-share").onclick = () => copyLink(state.story.entry.link, `&tick=${state.story.index}`);
$("share").onclick = () => copyLink(state.scene?.link);
$("story-range").oninput = ({ target }) => {
  pause();
  seek(Number(target.value));
};
addEventListener("keydown", (event) => {
  if (!state.story || !isShortcut(event)) return;
  const { key, target } = event;
  if (key === " " && !target.matches?.("button, input, summary")) togglePlaying();
  else if (key === "n") jump(1);
  else if (key === "p") jump(-1);
  else if (target === $("top") && key === "ArrowRight") seek(state.story.index + 1);
  else if (target === $("top") && key === "ArrowLeft") seek(state.story.index - 1);
  else return;
  event.preventDefault();
});

function drawMarks() {
  if (!state.story) return;
  const { entry, frames } = state.story;
  const canvas = $("story-marks");
  const { clientWidth: width, clientHeight: height } = $("story-range");
  [canvas.width, canvas.height] = [width * devicePixelRatio, height * devicePixelRatio];
  const context = canvas.getContext("2d");
  context.scale(devicePixelRatio, devicePixelRatio);
  const step = (width - THUMB_PX) / Math.max(1, frames.length - 1);
  const marks = [[entry.decisions, "#7f8ba6", height - 9, 6], [entry.parts, "#e0407f", 2, 9]];
  for (const [ticks, colour, y, size] of marks) {
    context.fillStyle = colour;
    for (const tick of ticks) context.fillRect(THUMB_PX / 2 + step * tick - 1.5, y, 3, size);
  }
}
new ResizeObserver(drawMarks).observe($("story-range"));

// Copies the address of a round without the token.
async function copyLink(link, tick = "") {
  if (!link) {
    notice(NO_LINK);
    return;
  }
  const hint = token ? " It contains no token: other users need their own." : "";
  history.replaceState(null, "", `#${link}${tick}`);
  try {
    await navigator.clipboard.writeText(`${location.origin}${location.pathname}#${link}${tick}`);
    notice(`Link copied.${hint}`);
  } catch {
    notice(`The link is in the address bar.${hint}`);
  }
}

// The setup that the server wrote behind the # of a link; null if it is no round.
function readLink() {
  const fields = Object.fromEntries(new URLSearchParams(location.hash.slice(1)));
  const { seed, level, tick, clyde, ghosts, map, preset, policy, second } = fields;
  if (seed === undefined) return null;
  const set = Object.entries(fields).filter(([field]) => field.startsWith("set."))
    .map(([field, value]) => [field.slice(4), parseSetting(field.slice(4), value)]);
  return {
    do: "setup", finish: tick !== undefined, seed: Number(seed), level: level && Number(level), map, preset, policy,
    second, clyde_mps: clyde && Number(clyde), ghosts: ghosts?.split(","), settings: Object.fromEntries(set),
  };
}

// Prepares the round of the address; if it names a tick, plays the round to its end and opens it there.
export async function followLink() {
  const message = readLink();
  if (!message) return;
  const busy = (state.frame && state.frame.state !== "menu") || Object.values(state.people.roles).some(Boolean);
  if (busy && !(await question("This link opens another round and ends the current one. Continue?"))) return;
  const hide = notice("Preparing the linked round.", { stays: true, key: "setup" });
  const answer = await request(message, REPLAY_TIMEOUT_MS);
  hide();
  if (!answer) return;
  const tick = Number(new URLSearchParams(location.hash.slice(1)).get("tick"));
  if (answer.data?.story) await open(answer.data.story, tick || 0);
  else notice("The linked round is ready: press Start.");
}
addEventListener("hashchange", followLink);
