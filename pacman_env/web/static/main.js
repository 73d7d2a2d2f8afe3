// The page: what the server says goes in here, and to the parts that show it.

import { isLight, setUpTheme } from "./colours.js";
import { Connection } from "./connection.js";
import { setUpControls, setUpResult, showResult } from "./controls.js";
import { $, clock, isTyping, make, write } from "./dom.js";
import { sameFrame } from "./frame.js";
import { setUpGates } from "./gates.js";
import { copyLink, followLink } from "./link.js";
import { GameMap, layers, view } from "./map.js";
import { notice } from "./notices.js";
import { setUpReady } from "./ready.js";
import { Roles } from "./roles.js";
import { Setup } from "./setup.js";
import { setUpShow } from "./show.js";
import { Sounds } from "./sounds.js";
import { on, state, tell } from "./state.js";
import { Stories } from "./stories.js";
import { Why } from "./why.js";

const MOST_LOG = 60;
const count = { frames_drawn: 0, frames_per_second: 0, messages: 0, frames: 0, last_frame: -1, notes: 0, lit: 0, connections: 0, first_view_ms: null, errors: [] };
const token = new URLSearchParams(location.search).get("token");
let latest = null; // JSON of the newest frame
let again = sessionStorage.again ?? ""; // the key by which the server knows us after a break

addEventListener("error", (event) => count.errors.push(String(event.message)));
addEventListener("unhandledrejection", (event) => count.errors.push(String(event.reason)));

const connection = new Connection(
  () => {
    const query = new URLSearchParams();
    if (token) query.set("token", token);
    if (again) query.set("again", again);
    return `${location.protocol === "https:" ? "wss" : "ws"}://${location.host}/ws${query.size ? `?${query}` : ""}`;
  },
  { opened, lost, text, frame },
);
const map = new GameMap({ token, count, actions: (world, candidate) => roles.tapped(world, candidate) });
setUpGates();
setUpControls(connection);
setUpResult();
setUpShow(connection, count);
setUpReady(connection);
const setup = new Setup(connection, token);
const roles = new Roles(connection, map, setup);
const why = new Why(connection);
const stories = new Stories(connection, map, token, (entry) => {
  showResult(entry);
  roles.ended(entry);
});
const sounds = new Sounds(count);
window.pacman = { count, state, sounds, connection, view };
setUpTheme($("theme"), () => map.repaint());
setUpTabs();
setUpKeys();

$("share").addEventListener("click", () => {
  if (state.scene?.link) copyLink(state.scene.link);
  else notice("This round cannot be reproduced by a link: a person plays it, or a ghost was placed by hand.");
});
addEventListener("hashchange", () => followLink(location.hash, connection, setup.settings, stories));
on("layers tab", watch);
on("frame", describe);

function opened() {
  count.connections++;
  if (count.connections > 1) notice("The connection is back.", { key: "connection" });
  $("lost").hidden = true;
  $("lost").classList.remove("loud");
}

function lost(reason) {
  const first = state.connected;
  state.connected = false;
  if (!$("lost").classList.contains("loud")) write($("lost"), `No connection to the server${reason ? ` (${reason})` : ""}. The page tries again by itself.`);
  $("lost").hidden = false;
  write($("state"), "No connection");
  $("state").dataset.state = "stopped";
  latest = null;
  if (first) tell("connection");
}

function text(message) {
  count.messages++;
  switch (message.kind) {
    case "hello": {
      state.hello = message;
      sessionStorage.again = again = message.again ?? again;
      state.connected = true;
      tell("hello", message);
      tell("connection");
      watch();
      break;
    }
    case "scene":
      state.scene = { pellets: [], refuges: [], candidates: [], robot: {}, ...message };
      state.scene.ghosts = (message.ghosts ?? []).map((ghost) => ({ ...ghost, ...state.hello.roles[ghost.role] }));
      tell("scene", state.scene);
      if (!state.story) map.show(state.scene);
      linkOnce();
      break;
    case "people":
      state.people = message;
      tell("people", message);
      break;
    case "news":
      news(message.items);
      break;
    case "refused":
      notice(message.words, { bad: true });
      break;
  }
}

let linked = false;
function linkOnce() {
  if (linked || state.scene.preparing || !state.hello) return;
  linked = true;
  if (location.hash.length > 1) setTimeout(() => followLink(location.hash, connection, setup.settings, stories), 300);
}

function news(items) {
  for (const item of items) {
    if (item.why && !state.story) tell("why", (state.why = item.why));
    if (item.words) {
      $("log").prepend(make("li", { text: item.words }));
      while ($("log").children.length > MOST_LOG) $("log").lastElementChild.remove();
    }
  }
  tell("news", items);
}

function frame(data) {
  count.messages++;
  count.frames++;
  const same = sameFrame(latest, data);
  latest = data;
  if (document.hidden || same) return;
  show();
}

function show() {
  if (!latest) return;
  state.frame = JSON.parse(latest);
  count.last_frame = state.frame.number;
  count.first_view_ms ??= performance.now();
  if (!state.story) map.take(state.frame);
  tell("frame", state.frame);
}

document.addEventListener("visibilitychange", () => {
  if (!document.hidden) show();
});

function watch() {
  connection.say({ do: "watch", why: !$("panel-why").hidden, lidar: layers.lidar });
}

// The map in words, for those who do not see it; not spoken by itself.
let described = 0;
function describe(frame) {
  if (performance.now() - described < 2000) return;
  described = performance.now();
  const ghosts = frame.ghosts.map(([x, y], k) => `${state.scene?.ghosts[k]?.name ?? "ghost"} at ${x.toFixed(1)}, ${y.toFixed(1)}`);
  const robot = frame.true ?? frame.believed;
  write($("map-words"), [`${frame.collected} of ${frame.spawned} pellets after ${clock(frame.time_s)}.`,
    robot ? `Robot at ${robot[0].toFixed(1)}, ${robot[1].toFixed(1)} metres.` : "", ghosts.length ? `${ghosts.join(". ")}.` : ""].join(" "));
}

function setUpTabs() {
  const tabs = [...document.querySelectorAll("[role=tab]")];
  const narrow = matchMedia("(max-width: 820px)");
  const panel = document.querySelector(".panel");
  const choose = (tab, open = true) => {
    for (const one of tabs) {
      one.setAttribute("aria-selected", String(one === tab));
      one.tabIndex = one === tab ? 0 : -1;
      $(one.getAttribute("aria-controls")).hidden = one !== tab;
    }
    panel.classList.toggle("open", open);
    tell("tab", tab.id.slice(4));
    why.show();
    if (tab.id === "tab-why") stories.askWhy();
  };
  for (const tab of tabs) {
    tab.addEventListener("click", () => choose(tab, !(narrow.matches && panel.classList.contains("open") && tab.getAttribute("aria-selected") === "true")));
    tab.addEventListener("keydown", ({ key }) => {
      const step = { ArrowRight: 1, ArrowLeft: -1, Home: -Infinity, End: Infinity }[key];
      if (step === undefined) return;
      const at = tabs.indexOf(tab);
      const next = tabs[Number.isFinite(step) ? (at + step + tabs.length) % tabs.length : step < 0 ? 0 : tabs.length - 1];
      choose(next);
      next.focus();
    });
  }
}

function setUpKeys() {
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.metaKey || event.altKey || isTyping(event.target) || $("ask").open) return;
    if (event.key === "+" || event.key === "=") map.zoom(1.3);
    else if (event.key === "-") map.zoom(1 / 1.3);
    else if (event.key === "0") map.fit();
    else if (event.key === "f") $("follow").click();
  });
}

$("theme").title = isLight() ? "Dark" : "Light or dark";
