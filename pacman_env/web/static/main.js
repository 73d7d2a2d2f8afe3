// The page: messages of the server, tabs, shortcuts, and the list of what is ready.

import { Choosing } from "./choosing.js";
import { setUpTheme } from "./colours.js";
import * as game from "./connection.js";
import "./controls.js";
import { Demo } from "./demo.js";
import { $, clock, facts, isShortcut, make, narrow, notice, setIcons, write, writeOrHide } from "./dom.js";
import { sounds } from "./effects.js";
import { Guide } from "./guide.js";
import { GameMap, setUpMapControls } from "./map.js";
import { state } from "./page.js";
import { Roles } from "./roles.js";
import "./setup.js";
import { robotPose } from "./state.js";
import { Steering } from "./steering.js";
import { Stories } from "./stories.js";
import { WhyTable } from "./why.js";

const MOST_LOG = 60;
const DESCRIBE_MS = 2000;
const GAMES = { ros: "the robot", simulator: "the simulator", browser: "the simulator, in this browser" };
const READINESS = { ok: "✓ Ready", warning: "! Warning", bad: "✗ Not ready" };

let newest = ""; // JSON of the newest frame

addEventListener("error", ({ message }) => state.count.errors.push(String(message)));
addEventListener("unhandledrejection", ({ reason }) => state.count.errors.push(String(reason)));

setIcons(document);
const map = new GameMap(document, state, { address: (url) => game.address(url).href, failed: notice });
setUpMapControls(map);
new WhyTable(document, state);
new Roles(state, game, new Steering(state, game));
new Choosing(state, game, map);
new Stories(state, game, map);
state.on("ended", (result) => result !== "timeout" && map.showEnd(result !== "caught"));
const guide = new Guide(state);
new Demo(state, game, map);
window.pacman = { count: state.count, state, sounds, view: map.view };

function lost(reason) {
  if (!$("lost").classList.contains("loud")) {
    const [what, remedy] = state.source === "browser" ? ["The game has failed", "Reload the page"]
      : ["No connection to the server", "The page tries again by itself"];
    write($("lost"), `${what}${reason ? ` (${reason})` : ""}. ${remedy}.`);
  }
  $("lost").hidden = false;
  write($("state"), "No connection");
  $("state").dataset.state = "stopped";
  newest = "";
  if (!state.connected) return;
  state.connected = false;
  state.emit("connection");
}

const receive = {
  hello(message) {
    const { hello, frame: before, role } = state;
    $("lost").hidden = true;
    $("lost").classList.remove("loud");
    if (hello) notice("The connection is back.", { key: "connection" });
    if (hello && hello.run !== message.run && (role !== "none" || before?.state !== "menu")) {
      const words = "The server was started again: the round and your role are lost.";
      notice(words, { bad: true, stays: true, key: "restarted" });
    }
    state.hello = message;
    game.remember(message.again);
    state.connected = true;
    state.emit("hello", message);
    state.emit("connection");
  },
  scene(message) {
    const ghosts = (message.ghosts ?? []).map((ghost) => ({ ...ghost, ...state.hello.roles[ghost.role] }));
    state.scene = { pellets: [], refuges: [], candidates: [], robot: {}, ...message, ghosts };
    state.emit("scene", state.scene);
    if (!state.story) map.showScene(state.scene);
  },
  people(message) {
    state.people = message;
    state.emit("people");
  },
  news({ items }) {
    for (const { why, words } of items) {
      if (why && !state.story) state.emit("why", (state.why = why));
      if (words) $("log").prepend(make("li", { text: words }));
    }
    while ($("log").children.length > MOST_LOG) $("log").lastElementChild.remove();
    state.emit("news", items);
  },
  refused: ({ words }) => notice(words, { bad: true }),
};

function frame(data) {
  state.count.frames++;
  newest = data;
  showNewest();
}

// Shows the newest frame; a hidden page shows nothing.
function showNewest() {
  if (document.hidden || !newest) return;
  state.frame = JSON.parse(newest);
  if (!state.story && !state.demo) map.showFrame(state.frame);
  state.emit("frame", state.frame);
}
document.addEventListener("visibilitychange", showNewest);

state.on("layers tab hello", () => (
  game.send({ do: "watch", why: !$("panel-why").hidden, lidar: map.layers.lidar })));

// The picture of a round that runs looks live, even if nothing arrives any more.
setInterval(() => {
  const { connected, roundRuns, frame: now } = state;
  const runs = connected && roundRuns && !now.paused && !now.stopped;
  const silent_s = runs ? Math.floor(game.silence_ms() / 1000) : 0;
  writeOrHide($("late"), silent_s ? `Last message ${silent_s} s ago` : "");
}, 250);

// The map as text for screen readers; not announced by itself.
let described = -Infinity;
state.on("frame", (now) => {
  if (performance.now() - described < DESCRIBE_MS) return;
  described = performance.now();
  const robot = robotPose(now);
  const condition = (k) => (now.away_s?.[k] > 0 ? " (caught)" : now.harmless_s?.[k] > 0 ? " (frightened)" : "");
  const ghosts = now.ghosts.map((pose, k) => [(state.scene?.ghosts[k]?.name ?? "Ghost") + condition(k), pose]);
  const pellets = `${now.collected} of ${now.spawned} pellets after ${clock(now.time_s)}.`;
  const places = [...(robot ? [["Robot", robot]] : []), ...ghosts]
    .map(([name, [x, y]]) => `${name} at ${x.toFixed(1)}, ${y.toFixed(1)} metres.`);
  write($("map-words"), [pellets, ...places].join(" "));
});

const tabs = [...document.querySelectorAll("[role=tab]")];

function chooseTab(tab, open = true) {
  for (const one of tabs) {
    one.setAttribute("aria-selected", String(one === tab));
    one.tabIndex = one === tab ? 0 : -1;
    $(one.getAttribute("aria-controls")).hidden = one !== tab;
  }
  document.body.classList.toggle("panel-open", open);
  state.emit("tab", tab.id);
}

tabs.forEach((tab, k) => {
  const isOpen = () => document.body.classList.contains("panel-open") && tab.getAttribute("aria-selected") === "true";
  tab.onclick = () => chooseTab(tab, !(narrow.matches && isOpen()));
  tab.onkeydown = ({ key }) => {
    const next = tabs.at({ ArrowRight: (k + 1) % tabs.length, ArrowLeft: k - 1, Home: 0, End: -1 }[key] ?? k);
    if (next === tab) return;
    chooseTab(next);
    next.focus();
  };
});

const SHORTCUTS = {
  "+": () => map.zoom(1.3), "=": () => map.zoom(1.3), "-": () => map.zoom(1 / 1.3), 0: () => map.fit(),
  f: () => $("follow").click(), "?": () => guide.toggle(),
};
addEventListener("keydown", (event) => isShortcut(event) && SHORTCUTS[event.key]?.());

const row = (result, mark, name, ...words) => make("li", { data: { state: result } },
  make("span", { class: `mark ${result}`, text: mark }), make("strong", { text: name }), make("p", {}, ...words));

async function checkReadiness() {
  const again = $("ready-check");
  write(again, "Checking");
  const answer = await game.request({ do: "ready" }, 30000);
  write(again, "Check again");
  if (!answer) return;
  $("ready").replaceChildren(...(answer.data ?? []).map(({ name, state: result, words, remedy }) => row(
    result, READINESS[result] ?? result, name, words, remedy ? make("strong", { text: ` What to do: ${remedy}.` }) : "")));
}
$("ready-check").onclick = checkReadiness;
state.on("tab hello", () => state.connected && !$("panel-ready").hidden && checkReadiness());
// The processes of a robot's game and the page's connection, as a list and as lamps; a lamp has its name if it is off.
state.on("scene connection", () => {
  const { connected, scene } = state;
  const known = Object.entries(connected ? scene?.processes ?? {} : {});
  const processes = [...known, ["page", connected ? "" : "no connection"]];
  $("lamps").replaceChildren(...processes.map(([name, why]) => make("li", {
    class: why ? "bad" : "ok", title: `${name}: ${why || "runs"}`,
  }, make("span", { class: why ? "" : "hidden", text: `${name} ${why ? "off" : "runs"}` }))));
  $("processes").replaceChildren(...processes.map(([name, why]) => (
    row(why ? "bad" : "ok", why ? "✗ Off" : "✓ Runs", name, why))));
});

state.on("hello", ({ version, source, access, you }) => $("about").replaceChildren(...facts([
  ["Version", version], ["Game", GAMES[source]], ["Your name", you],
  ["Access", access === "operator" ? "operator: can run the game" : "viewer: can view, and STOP"],
])));

setUpTheme($("theme"), () => state.emit("theme"));
game.connect({ lost, frame, message: (message) => receive[message.kind]?.(message) });
