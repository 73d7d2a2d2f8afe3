// The current and the next round: a form, map upload, Clyde's speed and place; and on a robot, why it stands and its pose.

import { SLOW_MS, address, request } from "./connection.js";
import { $, button, facts, make, notice, option, question, showMap, slider, write, writeOrHide } from "./dom.js";
import { state, updateControls } from "./page.js";
import { changedSettings, hasSettings, showPreset, showSettings } from "./settings.js";

const SELECTS = ["map", "preset", "policy", "second"];
const MOST_GHOSTS = 4;
const MOST_UPLOAD = 5.5e6;

const edited = new Set(); // ids of fields that the user has changed since the last scene

const field = (name) => $(`setup-${name}`);
const ghostChoices = () => [...$("setup-ghosts").querySelectorAll("select")].map((select) => select.value);

const behaviours = () => state.hello.choices?.behaviours ?? [];
const presetOf = (name) => state.hello.choices.presets?.[name] ?? { ghosts: [], settings: {} };

function select(list, value) {
  if (![...list.options].some((one) => one.value === value)) list.append(option(value));
  list.value = value;
}

const showLevel = () => (field("level").parentElement.hidden = field("map").value !== "generated");

state.on("hello", ({ choices = {} }) => {
  const { maps = [], presets = {}, policies = [], settings = [], levels = 2 ** 31 } = choices;
  [maps, Object.keys(presets), policies, policies].forEach((values, k) => {
    const list = field(SELECTS[k]);
    const chosen = list.value;
    list.replaceChildren(...values.map((value) => option(value, value === "generated" ? "a generated house" : value)));
    if (values.includes(chosen)) list.value = chosen;
    list.parentElement.hidden = !values.length;
  });
  field("level").max = String(levels - 1);
  $("setup-ghosts-field").hidden = !behaviours().length;
  $("setup").hidden = !policies.length && !maps.length && !settings.length;
  showSettings(settings);
  showLevel();
});

function showScene(scene) {
  const { map, level, policy, second, seed, preset, ghosts } = scene;
  if (scene.preparing) return;
  for (const name of SELECTS) {
    const value = name === "map" ? map?.name : scene[name];
    if (value && !edited.has(`setup-${name}`)) select(field(name), value);
  }
  if (!edited.has("setup-level") && level !== null) field("level").value = String(level ?? 0);
  if (!edited.has("setup-seed")) field("seed").value = "";
  if (!edited.has("setup-ghosts") && ghosts.length) showGhosts(ghosts.map(({ behaviour }) => behaviour));
  if (!edited.has("setup-preset") && !$("setup").contains(document.activeElement)) {
    showPreset(presetOf(preset).settings, scene.settings ?? {});
  }
  showLevel();
  $("facts").replaceChildren(...facts([
    ["Map", map && (level ?? null) !== null ? `${map.name}, level ${level}` : map?.name], ["Policy", policy],
    ["Compared with", second], ["Seed", seed], ["Preset", preset],
    ["Ghosts", ghosts.map(({ name, behaviour }) => `${name} ${behaviour}`).join(", ")],
  ]));
  const chosen = $("place-ghost").value;
  $("place-ghost").replaceChildren(...ghosts.map(({ name }, k) => option(String(k), name)));
  if (Number(chosen) < ghosts.length) $("place-ghost").value = chosen || "0";
  write($("place"), ghosts.length > 1 ? "Place a ghost" : "Place Clyde");
}
state.on("scene", showScene);

function editGhosts(choices) {
  edited.add("setup-ghosts");
  showGhosts(choices);
}

function showGhosts(choices) {
  if (ghostChoices().join() === choices.join()) return;
  $("setup-ghosts").replaceChildren(...choices.map((behaviour, k) => {
    const { name, colour } = state.hello.roles[`ghost-${k}`];
    const data = { needs: "control" };
    const options = behaviours().map((value) => option(value));
    const list = make("select", { "aria-label": `Behaviour of ${name}`, data }, ...options);
    select(list, behaviour);
    const remove = button("Remove", { "aria-label": `Remove ${name}`, data, hidden: choices.length === 1,
      onclick: () => editGhosts(ghostChoices().filter((_, at) => at !== k)) });
    return make("div", { class: "ghost-row" }, make("span", { class: "dot", colour }),
      make("span", { class: "ghost-name", text: name }), list, remove);
  }));
  $("setup-ghost-add").hidden = choices.length >= MOST_GHOSTS;
  updateControls();
}

// What the form asks for, as a message; null if a field is invalid.
function setupMessage() {
  if (!$("setup").reportValidity()) return null;
  const message = { do: "setup" };
  for (const name of SELECTS) {
    const { value, parentElement } = field(name);
    if (value && !parentElement.hidden) message[name] = value;
  }
  if (message.map === "generated" && field("level").value !== "") message.level = Number(field("level").value);
  if (ghostChoices().length && behaviours().length) message.ghosts = ghostChoices();
  if (field("seed").value !== "") message.seed = Number(field("seed").value);
  if (hasSettings()) message.settings = changedSettings();
  return message;
}

async function apply(start) {
  const message = setupMessage();
  if (!message) return;
  if (state.roundRuns && !(await question("The new settings end the current round. Continue?"))) return;
  const close = notice("Preparing the round.", { key: "setup", stays: true });
  const answer = await request(message, SLOW_MS);
  close();
  if (!answer) return;
  edited.clear();
  if (state.scene) showScene(state.scene);
  if (start) request({ do: "start" });
}

$("setup").onsubmit = (event) => {
  event.preventDefault();
  apply(true);
};
$("setup-only").onclick = () => apply(false);
$("setup").oninput = ({ target }) => {
  edited.add(target.id || "setup-ghosts"); // only the lists of the ghosts have no id
  showLevel();
};
field("preset").onchange = ({ target }) => {
  const { ghosts, settings } = presetOf(target.value);
  editGhosts(ghosts);
  showPreset(settings);
};
$("setup-dice").onclick = () => {
  field("seed").value = String(crypto.getRandomValues(new Uint32Array(1))[0]);
  edited.add("setup-seed");
};
$("setup-ghost-add").onclick = () => editGhosts([...ghostChoices(), ghostChoices().at(-1)]);

// Uploads the chosen map; returns the text to show.
async function upload() {
  const files = [...$("upload-files").files];
  const yaml = files.find(({ name }) => /\.ya?ml$/i.test(name));
  const image = files.find(({ name }) => /\.(pgm|png)$/i.test(name));
  if (!yaml || !image) return "Choose two files: the YAML and its image (PGM or PNG).";
  if (image.size > MOST_UPLOAD) {
    return `The image is ${(image.size / 1e6).toFixed(1)} MB large: at most ${MOST_UPLOAD / 1e6} MB.`;
  }
  const bytes = Array.from(new Uint8Array(await image.arrayBuffer()), (byte) => String.fromCharCode(byte));
  const name = $("upload-name").value.trim() || yaml.name.replace(/\.ya?ml$/i, "");
  const body = JSON.stringify({ name, yaml: await yaml.text(), image: btoa(bytes.join("")) });
  const headers = { "Content-Type": "application/json" };
  const answer = await (await fetch(address("map"), { method: "POST", headers, body })).json();
  if (!answer.ok) return answer.words || "Refused.";
  select(field("map"), answer.map);
  edited.add("setup-map");
  showLevel();
  notice(`The map ${answer.map} is chosen. Press "Apply and start".`);
  return answer.words || "Added.";
}

$("upload-send").onclick = async () => {
  writeOrHide($("upload-words"), "Checking the map.");
  write($("upload-words"), await upload().catch(() => "The map could not be uploaded: no answer from the server."));
};

const showClydeSpeed = slider($("clyde-speed"), (mps) => `${mps.toFixed(2)} m/s`,
  (mps) => request({ do: "clyde_speed", mps }), 250);
state.on("scene", ({ clyde_speed_mps: mps }) => showClydeSpeed(mps));

// Waits for a click on the map, whose place `act` gets; without words it waits no longer.
function awaitClick(words = "", act = null) {
  Object.assign(state, { placing: words, place: act, stands: null });
  const ghost = act === placeGhost;
  $("place").setAttribute("aria-pressed", String(ghost));
  $("set-pose").setAttribute("aria-pressed", String(act === poseRobot));
  $("place-words").hidden = !ghost;
  $("place-ghost").parentElement.hidden = !ghost || (state.scene?.ghosts.length ?? 0) < 2;
  state.emit("placing");
}
$("place").onclick = () => (state.placing ? awaitClick() : awaitClick("Click where the ghost starts", placeGhost));
$("continue").onclick = async () => await request({ do: "continue" }) && awaitClick();
$("set-pose").onclick = () => {
  showMap();
  if (state.placing) awaitClick();
  else awaitClick("Click where the robot stands", poseRobot);
};
state.on("frame", (frame) => state.place === placeGhost && frame.state !== "menu" && awaitClick());

async function placeGhost([x, y]) {
  if (await request({ do: "place_clyde", x, y, ghost: Number($("place-ghost").value || 0) })) awaitClick();
}

async function poseRobot([x, y]) {
  const [left, top] = state.stands ?? [];
  if (left === undefined) {
    awaitClick("Click a place that it faces", poseRobot);
    state.stands = [x, y];
  } else if (await request({ do: "set_pose", x: left, y: top, heading: Math.atan2(y - top, x - left) })) awaitClick();
}

let shown = ""; // of the alert

state.on("scene", ({ alerts = [], pose_lost: lost = false }) => {
  const asks = alerts.some((one) => one.asks);
  const words = alerts.map(({ words: what, remedy, asks: answered }) =>
    `${what[0].toUpperCase()}${what.slice(1)}${answered ? ". Where is the robot?" : `: ${remedy}.`}`);
  if (words.join("\n") !== shown) $("alert-words").replaceChildren(...words.map((text) => make("p", { text })));
  shown = words.join("\n");
  $("alert").hidden = !alerts.length;
  document.body.classList.toggle("pose-lost", lost);
  $("alert-answers").hidden = !asks;
  if (!asks && state.place === poseRobot) awaitClick();
});
