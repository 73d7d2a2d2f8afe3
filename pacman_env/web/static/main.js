// The page: messages of the server, tabs, shortcuts, and the list of what is ready.

import { setUpTheme } from "./colours.js";
import { connect, remember, request, send } from "./connection.js";
import "./controls.js";
import { toggleGuide } from "./guide.js";
import { $, clock, facts, isShortcut, make, narrow, write } from "./dom.js";
import { sounds } from "./effects.js";
import * as map from "./map.js";
import { notice } from "./notices.js";
import "./roles.js";
import { count, emit, on, robotPose, state } from "./state.js";
import { followLink } from "./stories.js";
import "./why.js";

const MOST_LOG = 60;
const DESCRIBE_MS = 2000;
const READINESS = { ok: "✓ Ready", warning: "! Warning", bad: "✗ Not ready" };

let newest = ""; // JSON of the newest frame
let followed = false; // the link by which the page was opened

addEventListener("error", ({ message }) => count.errors.push(String(message)));
addEventListener("unhandledrejection", ({ reason }) => count.errors.push(String(reason)));
window.pacman = { count, state, sounds, view: map.view };

function opened() {
  if (state.hello) notice("The connection is back.", { key: "connection" });
  $("lost").hidden = true;
  $("lost").classList.remove("loud");
}

function lost(reason) {
  if (!$("lost").classList.contains("loud")) {
    write($("lost"), `No connection to the server${reason ? ` (${reason})` : ""}. The page tries again by itself.`);
  }
  $("lost").hidden = false;
  write($("state"), "No connection");
  $("state").dataset.state = "stopped";
  newest = "";
  if (!state.connected) return;
  state.connected = false;
  emit("connection");
}

const receive = {
  hello(message) {
    state.hello = message;
    remember(message.again);
    state.connected = true;
    emit("hello", message);
    emit("connection");
    watch();
  },
  scene(message) {
    const ghosts = (message.ghosts ?? []).map((ghost) => ({ ...ghost, ...state.hello.roles[ghost.role] }));
    state.scene = { pellets: [], refuges: [], candidates: [], robot: {}, ...message, ghosts };
    emit("scene", state.scene);
    if (!state.story) map.showScene(state.scene);
    if (!message.preparing && !followed) setTimeout(followLink, 300);
    followed ||= !message.preparing;
  },
  people(message) {
    state.people = message;
    emit("people");
  },
  news({ items }) {
    for (const { why, words } of items) {
      if (why && !state.story) emit("why", (state.why = why));
      if (words) $("log").prepend(make("li", { text: words }));
    }
    while ($("log").children.length > MOST_LOG) $("log").lastElementChild.remove();
    emit("news", items);
  },
  refused: ({ words }) => notice(words, { bad: true }),
};

function frame(data) {
  count.frames++;
  newest = data;
  showNewest();
}

// Shows the newest frame; a hidden page shows nothing.
function showNewest() {
  if (document.hidden || !newest) return;
  state.frame = JSON.parse(newest);
  if (!state.story) map.showFrame(state.frame);
  emit("frame", state.frame);
}
document.addEventListener("visibilitychange", showNewest);

function watch() {
  send({ do: "watch", why: !$("panel-why").hidden, lidar: map.layers.lidar });
}
on("layers tab", watch);

// The map as text for screen readers; not announced by itself.
let described = -Infinity;
on("frame", (now) => {
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
  emit("tab", tab.id);
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
  "+": () => map.zoom(1.3), "=": () => map.zoom(1.3), "-": () => map.zoom(1 / 1.3), 0: map.fit,
  f: () => $("follow").click(), "?": toggleGuide,
};
addEventListener("keydown", (event) => isShortcut(event) && SHORTCUTS[event.key]?.());

async function checkReadiness() {
  const again = $("ready-check");
  write(again, "Checking");
  const answer = await request({ do: "ready" }, 30000);
  write(again, "Check again");
  if (!answer) return;
  $("ready").replaceChildren(...(answer.data ?? []).map(({ name, state: result, words, remedy }) =>
    make("li", { data: { state: result } },
      make("span", { class: `mark ${result}`, text: READINESS[result] ?? result }), make("strong", { text: name }),
      make("p", {}, words, remedy ? make("strong", { text: ` What to do: ${remedy}.` }) : null))));
}
$("ready-check").onclick = checkReadiness;
on("tab hello", () => state.connected && !$("panel-ready").hidden && checkReadiness());
on("hello", ({ version, source, access, you }) => $("about").replaceChildren(...facts([
  ["Version", version], ["Game", source === "ros" ? "the robot" : "the simulator"], ["Your name", you],
  ["Access", access === "operator" ? "operator: can run the game" : "viewer: can view, and STOP"],
])));

setUpTheme($("theme"), () => {
  map.repaint();
  emit("theme");
});
connect({ opened, lost, frame, message: (message) => receive[message.kind]?.(message) });
